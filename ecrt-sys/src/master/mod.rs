//! The safe handle of a master.

mod bus;
mod clocks;
mod configuration;
mod process_data;
mod register;
mod requests;
mod sdo;

use std::fmt;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::bindings::{ec_domain_t, ec_master_t, ec_slave_config_t};
use crate::ecrt::Ecrt;
use crate::errno::Errno;

pub use bus::{
    LinkState, MasterInfo, MasterState, PdoEntryInfo, PdoInfo, PortInfo, PortKind, ScanProgress,
    SlaveInfo, SyncManagerInfo,
};
pub use configuration::{SlaveConfigState, SyncDirection, WatchdogMode};
pub use process_data::{DomainState, WcState};
pub use requests::RequestState;
pub use sdo::SdoError;

use process_data::Domain;
use register::RegRequest;
use requests::SdoRequest;

macro_rules! id {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        ///
        /// It is good for the [`Master`] that made it, until that is deactivated or dropped;
        /// anywhere else it gets `EBADF`.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub struct $name {
            generation: u64,
            index: usize,
        }
    };
}

id! {
    /// Names a domain.
    DomainId
}
id! {
    /// Names the configuration of a slave.
    SlaveConfigId
}
id! {
    /// Names an SDO request.
    SdoRequestId
}
id! {
    /// Names a register request.
    RegRequestId
}

/// How a handle came about, and with that what may be done with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ownership {
    /// Reserved by us, released by us.
    Reserved,
    /// Opened by us for looking, released by us.
    Opened,
    /// Reserved by the application, which activates, sends, receives and releases.
    Foreign,
}

/// Tells the handles of one configuration from those of every other, in all masters.
fn next_generation() -> u64 {
    static GENERATION: AtomicU64 = AtomicU64::new(0);
    GENERATION.fetch_add(1, Ordering::Relaxed)
}

/// A master of a libethercat: the handle and everything that was made from it.
///
/// Domains, slave configurations and requests are owned by the master and named by ids. One
/// thread uses a master at a time. Dropping it releases the master, unless it is foreign
/// ([`Master::from_raw`]).
///
/// Methods say "cycle" when they may be called in the real-time cycle: they neither block on
/// the master's semaphore nor allocate. The others belong before activation or beside the
/// cycle. With a 1.5 library the calls that report nothing there count as successful.
pub struct Master {
    ecrt: Ecrt,
    raw: NonNull<ec_master_t>,
    ownership: Ownership,
    active: bool,
    generation: u64,
    domains: Vec<Domain>,
    slave_configs: Vec<NonNull<ec_slave_config_t>>,
    sdo_requests: Vec<SdoRequest>,
    reg_requests: Vec<RegRequest>,
}

// SAFETY: the handles are plain pointers into memory that the library allocates; neither the
// library nor the contract of `Functions` ties them to a thread, only to one user at a time,
// which `Master` being `!Sync` and its slices borrowing from it ensure.
unsafe impl Send for Master {}

impl Master {
    pub(crate) fn new(ecrt: Ecrt, raw: NonNull<ec_master_t>, ownership: Ownership) -> Self {
        Self {
            ecrt,
            raw,
            ownership,
            active: false,
            generation: next_generation(),
            domains: Vec::new(),
            slave_configs: Vec::new(),
            sdo_requests: Vec::new(),
            reg_requests: Vec::new(),
        }
    }

    /// Wraps a master that the application has reserved itself and goes on driving.
    ///
    /// Domains and slave configurations can be added and exchanged through the result;
    /// activating, deactivating, sending and receiving stay with the owner (these methods
    /// return `EPERM`), and dropping it releases nothing. After the owner has activated,
    /// [`Master::refresh_domain_data`] makes the process image available.
    ///
    /// # Errors
    ///
    /// `EINVAL` for a null pointer.
    ///
    /// # Safety
    ///
    /// - `raw` is a reserved master made by the same library (or simulation) as `ecrt`.
    /// - The result is dropped before the owner deactivates or releases the master.
    /// - `refresh_domain_data` is called only after the owner has activated.
    /// - While a slice from [`Master::domain_data`] or [`Master::domain_data_mut`] lives, the
    ///   owner does not receive; and owner and result are never used at the same time.
    pub unsafe fn from_raw(ecrt: Ecrt, raw: *mut ec_master_t) -> Result<Self, Errno> {
        let raw = NonNull::new(raw).ok_or(Errno::EINVAL)?;
        Ok(Self::new(ecrt, raw, Ownership::Foreign))
    }

    /// The library's own handle, for calls that this crate does not make. It is valid as long as
    /// the master is.
    #[must_use]
    pub fn as_raw(&self) -> *mut ec_master_t {
        self.raw.as_ptr()
    }

    /// The library that the master belongs to.
    #[must_use]
    pub fn ecrt(&self) -> &Ecrt {
        &self.ecrt
    }

    /// Whether the master is reserved for this process, by us or by the application.
    #[must_use]
    pub fn reserved(&self) -> bool {
        self.ownership != Ownership::Opened
    }

    /// Whether the application owns the master ([`Master::from_raw`]).
    #[must_use]
    pub fn is_foreign(&self) -> bool {
        self.ownership == Ownership::Foreign
    }

    /// Whether [`Master::activate`] has been called with success since the last deactivation.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.active
    }

    /// Refuses what belongs to the master's owner.
    fn owned(&self) -> Result<(), Errno> {
        if self.is_foreign() { Err(Errno::EPERM) } else { Ok(()) }
    }

    #[inline]
    fn domain(&self, id: DomainId) -> Result<&Domain, Errno> {
        self.current(id.generation)?;
        self.domains.get(id.index).ok_or(Errno::EBADF)
    }

    fn domain_raw(&self, id: DomainId) -> Result<*mut ec_domain_t, Errno> {
        Ok(self.domain(id)?.raw.as_ptr())
    }

    fn slave_config_raw(&self, id: SlaveConfigId) -> Result<*mut ec_slave_config_t, Errno> {
        self.current(id.generation)?;
        let config = self.slave_configs.get(id.index).ok_or(Errno::EBADF)?;
        Ok(config.as_ptr())
    }

    fn sdo_request(&self, id: SdoRequestId) -> Result<&SdoRequest, Errno> {
        self.current(id.generation)?;
        self.sdo_requests.get(id.index).ok_or(Errno::EBADF)
    }

    fn sdo_request_mut(&mut self, id: SdoRequestId) -> Result<&mut SdoRequest, Errno> {
        self.current(id.generation)?;
        self.sdo_requests.get_mut(id.index).ok_or(Errno::EBADF)
    }

    fn reg_request(&self, id: RegRequestId) -> Result<&RegRequest, Errno> {
        self.current(id.generation)?;
        self.reg_requests.get(id.index).ok_or(Errno::EBADF)
    }

    fn reg_request_mut(&mut self, id: RegRequestId) -> Result<&mut RegRequest, Errno> {
        self.current(id.generation)?;
        self.reg_requests.get_mut(id.index).ok_or(Errno::EBADF)
    }

    #[inline]
    fn current(&self, generation: u64) -> Result<(), Errno> {
        if generation == self.generation { Ok(()) } else { Err(Errno::EBADF) }
    }

    /// Forgets every handle made from the master, and makes every id stale.
    fn forget_handles(&mut self) {
        self.generation = next_generation();
        self.domains.clear();
        self.slave_configs.clear();
        self.sdo_requests.clear();
        self.reg_requests.clear();
    }
}

impl Drop for Master {
    fn drop(&mut self) {
        if self.ownership != Ownership::Foreign {
            // SAFETY: the master is ours and released exactly once; every handle made from it
            // ends with `self`, and no slice of its memory can outlive it.
            unsafe { (self.ecrt.functions().release_master)(self.raw.as_ptr()) }
        }
    }
}

impl fmt::Debug for Master {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Master")
            .field("ecrt", &self.ecrt)
            .field("ownership", &self.ownership)
            .field("active", &self.active)
            .field("domains", &self.domains.len())
            .field("slave_configs", &self.slave_configs.len())
            .field("sdo_requests", &self.sdo_requests.len())
            .field("reg_requests", &self.reg_requests.len())
            .finish_non_exhaustive()
    }
}

/// Room for an answer of the library, with reserve behind it: patched libraries have grown some
/// structures at the end without saying so.
#[repr(C)]
struct Answer<T> {
    value: T,
    _reserve: [u64; 16],
}

impl<T: Default> Answer<T> {
    fn new() -> Self {
        Self { value: T::default(), _reserve: [0; 16] }
    }

    /// Where the library writes; valid for the whole `Answer`, reserve included.
    fn target(&mut self) -> *mut T {
        std::ptr::from_mut(self).cast()
    }
}
