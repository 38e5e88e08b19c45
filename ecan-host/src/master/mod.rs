//! Safe handles of a libethercat: the master and everything that is created from it.
//!
//! The only module of this crate with `unsafe` code: the calls of the C interface, and the
//! scheduling of the cycle's thread.
#![allow(unsafe_code)]

/// Declares methods that pass their arguments to a function of the library, about a slave
/// configuration or about the master. `status`: a function that returns nothing in version 1.5.
macro_rules! library_calls {
    ($(
        $(#[$meta:meta])*
        $about:ident fn $name:ident($($argument:ident: $type:ty),*) = $kind:ident $function:ident;
    )+) => { $(
        library_calls!(@$about [$(#[$meta])*] $name($($argument: $type),*) $kind $function);
    )+ };
    (@config [$($meta:tt)*] $name:ident($($argument:ident: $type:ty),*) $kind:ident $f:ident) => {
        $($meta)*
        pub fn $name(&mut self, config: SlaveConfigId, $($argument: $type),*) -> Result<(), Errno> {
            let raw = self.slave_config_raw(config)?;
            // SAFETY: the configuration belongs to this master and is current, so it is valid.
            Errno::check(unsafe {
                library_calls!(@$kind self.ecrt.functions().$f, raw $(, $argument)*)
            })
        }
    };
    (@master [$($meta:tt)*] $name:ident($($argument:ident: $type:ty),*) $kind:ident $f:ident) => {
        $($meta)*
        pub fn $name(&mut self, $($argument: $type),*) -> Result<(), Errno> {
            // SAFETY: the master is valid as long as `self`.
            Errno::check(unsafe {
                library_calls!(@$kind self.ecrt.functions().$f, self.raw.as_ptr() $(, $argument)*)
            })
        }
    };
    (@status $function:expr, $($argument:expr),+) => { status!($function, $($argument),+) };
    (@direct $function:expr, $($argument:expr),+) => { ($function)($($argument),+) };
}

mod bus;
mod clocks;
mod configuration;
mod open_error;
mod pdo_assignment;
mod process_data;
mod register;
mod requests;
mod scheduling;
mod sdo;

use ecrt_sys::{Ecrt, Errno, ec_domain_t, ec_master_t, ec_slave_config_t};
use std::fmt;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU64, Ordering};

pub use bus::{LinkState, MasterInfo, MasterState, PortInfo, PortKind, SlaveInfo};
pub use configuration::{SlaveConfigState, SyncDirection, WatchdogMode};
pub use open_error::{NodeOwner, OpenError, OpenFailure};
pub use pdo_assignment::{AssignedPdo, PdoEntry};
pub use process_data::{DomainState, WcState};
pub use requests::RequestState;
pub use scheduling::leave_real_time;
pub(crate) use scheduling::set_fifo_priority;
pub use sdo::SdoError;

use process_data::{Domain, Image};
use register::RegRequest;
use requests::SdoRequest;

macro_rules! id {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        ///
        /// Valid for the [`Master`] that created it, until that is deactivated or dropped; any
        /// other use returns `EBADF`.
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

/// Names a part of a domain's process image. After deactivation it names none, or one of the next
/// configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ImageId(usize);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ownership {
    /// Reserved and released by the SDK.
    Reserved,
    /// Opened without reservation, and released, by the SDK.
    Opened,
    /// Reserved by the application, which activates, sends, receives and releases.
    Attached,
}

/// Distinguishes the handles of one configuration from those of every other, in all masters.
fn next_generation() -> u64 {
    static GENERATION: AtomicU64 = AtomicU64::new(0);
    GENERATION.fetch_add(1, Ordering::Relaxed)
}

/// A master of a libethercat: its handle and everything that was created from it.
///
/// Owns domains, slave configurations and requests, and names them by ids. A master may move to
/// another thread, but only one thread uses it at a time (`Send`, not `Sync`), because the library
/// has no locks. For diagnostics in parallel with the cycle thread, open a second handle
/// ([`Master::open`]). Dropping it releases the master, unless it is attached
/// ([`Master::from_raw`]).
///
/// Methods marked "Real-time safe" neither block on the master's semaphore nor allocate. Call the
/// others before activation or outside the cycle thread. With a 1.5 library, calls that report
/// nothing there count as successful.
///
/// An error is the number that the library or the kernel module gives: `EINTR` when interrupted,
/// `EPERM` for a master that is not reserved, `ENOMEM`. The methods that only the owner of an
/// attached master may call give `EPERM` there, and every method `EBADF` for a stale id.
///
/// ```no_run
/// use ecan_host::{Ecrt, Master};
///
/// let master = Master::open(&Ecrt::load(None)?, 0)?;
/// println!("{} slaves", master.info()?.slave_count);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Master {
    ecrt: Ecrt,
    raw: NonNull<ec_master_t>,
    ownership: Ownership,
    active: bool,
    generation: u64,
    /// Cycles of the application; see [`register`].
    cycles: u64,
    domains: Vec<Domain>,
    images: Vec<Image>,
    slave_configs: Vec<NonNull<ec_slave_config_t>>,
    sdo_requests: Vec<SdoRequest>,
    reg_requests: Vec<RegRequest>,
}

// SAFETY: the handles are plain pointers into memory that the library allocates; neither the
// library nor the contract of `Functions` ties them to a thread, only to one user at a time,
// which `Master` being `!Sync` and its slices borrowing from it ensure.
unsafe impl Send for Master {}

impl Master {
    fn new(ecrt: Ecrt, raw: NonNull<ec_master_t>, ownership: Ownership) -> Self {
        Self {
            ecrt,
            raw,
            ownership,
            active: false,
            generation: next_generation(),
            cycles: 0,
            domains: Vec::new(),
            images: Vec::new(),
            slave_configs: Vec::new(),
            sdo_requests: Vec::new(),
            reg_requests: Vec::new(),
        }
    }

    /// Reserves a master for this process, which is required to configure and drive the bus. May
    /// block while the master is busy.
    ///
    /// # Errors
    /// The device node is missing or not permitted, another application has reserved the master,
    /// the master waits for its network interface, or library and kernel module have different
    /// versions.
    pub fn request(ecrt: &Ecrt, index: u32) -> Result<Self, OpenError> {
        Self::obtain(ecrt, index, Ownership::Reserved, Ecrt::request_master)
    }

    /// Opens a master without reservation, for information, states and SDO transfers in parallel
    /// with the application that drives it.
    ///
    /// # Errors
    /// As [`Master::request`], except that a reserved master can be opened.
    pub fn open(ecrt: &Ecrt, index: u32) -> Result<Self, OpenError> {
        Self::obtain(ecrt, index, Ownership::Opened, Ecrt::open_master)
    }

    fn obtain(
        ecrt: &Ecrt,
        index: u32,
        ownership: Ownership,
        call: impl FnOnce(&Ecrt, u32) -> *mut ec_master_t,
    ) -> Result<Self, OpenError> {
        Errno::clear_last();
        NonNull::new(call(ecrt, index))
            .map(|raw| Self::new(ecrt.clone(), raw, ownership))
            .ok_or_else(|| OpenError::find_cause(index, Errno::last(), ecrt))
    }

    /// Wraps a master that the application has reserved and continues to drive.
    ///
    /// The result adds domains and slave configurations and exchanges them; activating,
    /// deactivating, sending and receiving stay with the owner (these methods return `EPERM`), and
    /// dropping it releases nothing. After the owner has activated the master,
    /// [`Master::refresh_domain_data`] makes the process data available.
    ///
    /// # Errors
    /// `EINVAL` for a null pointer.
    ///
    /// # Safety
    ///
    /// - `raw` is a reserved master made by the same library (or simulation) as `ecrt`.
    /// - The result is dropped before the owner deactivates or releases the master.
    /// - `refresh_domain_data` is called only after the owner has activated the master.
    /// - While a slice from [`Master::domain_data`] or [`Master::domain_data_mut`] lives, the
    ///   owner does not receive; and owner and result are never used at the same time.
    pub unsafe fn from_raw(ecrt: Ecrt, raw: *mut ec_master_t) -> Result<Self, Errno> {
        let raw = NonNull::new(raw).ok_or(Errno::EINVAL)?;
        Ok(Self::new(ecrt, raw, Ownership::Attached))
    }

    /// The library's own handle, for calls that this type does not offer. Valid as long as the
    /// master.
    pub fn as_raw(&self) -> *mut ec_master_t {
        self.raw.as_ptr()
    }

    /// The library of the master.
    pub fn ecrt(&self) -> &Ecrt {
        &self.ecrt
    }

    /// Returns whether the master is reserved for this process, by the SDK or by the application.
    pub fn is_reserved(&self) -> bool {
        self.ownership != Ownership::Opened
    }

    /// Returns whether the application owns the master ([`Master::from_raw`]).
    pub fn is_attached(&self) -> bool {
        self.ownership == Ownership::Attached
    }

    /// Returns whether [`Master::activate`] has succeeded since the last deactivation.
    pub fn is_active(&self) -> bool {
        self.active
    }

    /// Rejects what only the master's owner may do.
    fn need_owned(&self) -> Result<(), Errno> {
        if self.is_attached() { Err(Errno::EPERM) } else { Ok(()) }
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

    /// Drops every handle created from the master, and makes every id stale.
    fn forget_handles(&mut self) {
        self.generation = next_generation();
        self.domains.clear();
        self.images.clear();
        self.slave_configs.clear();
        self.sdo_requests.clear();
        self.reg_requests.clear();
    }
}

impl Drop for Master {
    fn drop(&mut self) {
        if !self.is_attached() {
            // SAFETY: the SDK owns the master and releases it exactly once; every handle made from it
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

/// Memory for a result of the library, with a reserve: patched libraries have extended some
/// structures at the end without a new version.
#[repr(C)]
struct Answer<T> {
    value: T,
    _reserve: [u64; 16],
}

impl<T: Default> Answer<T> {
    fn new() -> Self {
        Self { value: T::default(), _reserve: [0; 16] }
    }

    /// The library's pointer; valid for the whole `Answer`, reserve included.
    fn target(&mut self) -> *mut T {
        std::ptr::from_mut(self).cast()
    }
}
