//! The master: its handle, the phases of its use, and the exchange of process data.

use std::fmt;
use std::ops::Range;
use std::ptr::NonNull;

use ecrt_sys::{
    EC_WC_COMPLETE, EC_WC_INCOMPLETE, Ecrt, Errno, ec_domain_state_t, ec_domain_t, ec_master_t,
    ec_slave_config_t, status,
};

use super::open_error::OpenError;
use super::raw::{Answer, DomainId, ImageId, SlaveConfigId, next_generation};
use super::requests::{MasterRequests, RequestTable};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ownership {
    /// Reserved and released by the SDK.
    Reserved,
    /// Opened without reservation, and released, by the SDK.
    Opened,
    /// Reserved by the application, which activates, sends, receives and releases.
    Attached,
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
    pub(super) ecrt: Ecrt,
    pub(super) raw: NonNull<ec_master_t>,
    ownership: Ownership,
    active: bool,
    pub(super) generation: u64,
    pub(super) domains: Vec<Domain>,
    images: Vec<Image>,
    pub(super) slave_configs: Vec<NonNull<ec_slave_config_t>>,
    pub(super) requests: RequestTable,
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
            domains: Vec::new(),
            images: Vec::new(),
            slave_configs: Vec::new(),
            requests: RequestTable::default(),
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

    pub(super) fn domain_raw(&self, id: DomainId) -> Result<*mut ec_domain_t, Errno> {
        Ok(self.domain(id)?.raw.as_ptr())
    }

    pub(super) fn slave_config_raw(
        &self,
        id: SlaveConfigId,
    ) -> Result<*mut ec_slave_config_t, Errno> {
        self.current(id.generation)?;
        let config = self.slave_configs.get(id.index).ok_or(Errno::EBADF)?;
        Ok(config.as_ptr())
    }

    /// The SDO and register requests that were created from the master.
    pub fn requests(&mut self) -> MasterRequests<'_> {
        let (functions, generation) = (self.ecrt.functions(), self.generation);
        MasterRequests { table: &mut self.requests, functions, generation }
    }

    /// Counts a cycle of the application, in which the library can execute requests.
    pub(crate) fn count_cycle(&mut self) {
        self.requests.count_cycle();
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
        self.requests.clear();
    }

    /// Sets the interval between sends, µs, by which the master plans mailbox traffic. May
    /// block.
    pub fn set_send_interval(&mut self, interval_us: usize) -> Result<(), Errno> {
        self.need_owned()?;
        // SAFETY: the master is valid as long as `self`.
        Errno::check(unsafe {
            (self.ecrt.functions().master_set_send_interval)(self.raw.as_ptr(), interval_us)
        })
    }

    /// Ends configuration and starts the operation phase; from here on the application sends
    /// and receives. Makes the process image available. Blocks.
    ///
    /// # Errors
    /// `EINVAL` when active already. A master whose process image cannot be reached is deactivated
    /// again.
    pub fn activate(&mut self) -> Result<(), Errno> {
        self.need_owned()?;
        if self.active {
            return Err(Errno::EINVAL);
        }
        // SAFETY: the master is valid as long as `self`.
        Errno::check(unsafe { (self.ecrt.functions().master_activate)(self.raw.as_ptr()) })?;
        self.active = true;
        self.refresh_domain_data().inspect_err(|_| {
            // The first error counts.
            let _ = self.deactivate();
        })
    }

    /// Requests OP of every configured slave, also of those that are kept in PREOP after a failed
    /// startup. Takes the master's semaphore: may block.
    pub fn reset(&mut self) -> Result<(), Errno> {
        // SAFETY: the master is valid as long as `self`.
        Errno::check(unsafe { status!(self.ecrt.functions().master_reset, self.raw.as_ptr()) })
    }

    /// Ends the operation phase. Every domain, slave configuration and request is gone, and
    /// every id stale, also if the library reports an error. Blocks.
    ///
    /// # Errors
    /// `EINVAL` when not active.
    pub fn deactivate(&mut self) -> Result<(), Errno> {
        self.need_owned()?;
        if !self.active {
            return Err(Errno::EINVAL);
        }
        self.active = false;
        self.forget_handles();
        // SAFETY: the master is valid as long as `self`. The call frees the handles made from
        // it and unmaps their memory: the tables are empty, and borrowing `self` mutably has
        // ended every slice.
        Errno::check(unsafe { status!(self.ecrt.functions().master_deactivate, self.raw.as_ptr()) })
    }

    /// Fetches where the domains' memory is. [`Master::activate`] does this itself; for a
    /// attached master it is called after the owner has activated. May block.
    ///
    /// # Errors
    /// `EAGAIN` if there are no process data yet, `EIO` if their size is unknown. All
    /// images are empty then.
    pub fn refresh_domain_data(&mut self) -> Result<(), Errno> {
        let fetched = self.fetch_domain_data();
        if fetched.is_err() {
            for domain in &mut self.domains {
                domain.size = 0;
            }
        }
        self.locate_images();
        fetched
    }

    fn locate_images(&mut self) {
        for image in &mut self.images {
            let domain =
                self.domains.get(image.domain).filter(|domain| image.range.end <= domain.size);
            image.size = domain.map_or(0, |_| image.range.len());
            if let Some(domain) = domain {
                // SAFETY: the range ends within the `size` bytes that the library maps there.
                image.data = unsafe { domain.data.add(image.range.start) };
            }
        }
    }

    /// Names a part of a domain's process image.
    pub(crate) fn add_image(&mut self, domain: DomainId, range: Range<usize>) -> ImageId {
        let id = ImageId(self.images.len());
        let (domain, data) = (domain.index, NonNull::dangling());
        self.images.push(Image { domain, range, data, size: 0 });
        id
    }

    /// The process data of an image; empty before activation and after deactivation. Real-time safe.
    #[inline]
    pub(crate) fn image(&self, id: ImageId) -> &[u8] {
        match self.images.get(id.0) {
            // SAFETY: as in `domain_data`; the image lies in its domain.
            Some(image) => unsafe { std::slice::from_raw_parts(image.data.as_ptr(), image.size) },
            None => &[],
        }
    }

    /// The process data of an image for writing; as [`image`](Self::image).
    #[inline]
    pub(crate) fn image_mut(&mut self, id: ImageId) -> &mut [u8] {
        match self.images.get(id.0) {
            // SAFETY: as in `image`, and `self` is borrowed mutably, so this is the only slice.
            Some(image) => unsafe {
                std::slice::from_raw_parts_mut(image.data.as_ptr(), image.size)
            },
            None => &mut [],
        }
    }

    fn fetch_domain_data(&mut self) -> Result<(), Errno> {
        let functions = self.ecrt.functions();
        for domain in &mut self.domains {
            let raw = domain.raw.as_ptr();
            // SAFETY: the domain belongs to this master and is current, so it is valid.
            let size = image_size(unsafe { (functions.domain_size)(raw) })?;
            if size == 0 {
                // Nothing is registered in it; its memory may not exist.
                domain.size = 0;
                continue;
            }
            // SAFETY: as above, and the operation phase has begun.
            let data = unsafe { (functions.domain_data)(raw) };
            match NonNull::new(data) {
                Some(data) if data.as_ptr() as usize >= LOWEST_ADDRESS => {
                    domain.data = data;
                    domain.size = size;
                }
                _ => return Err(Errno::EAGAIN),
            }
        }
        Ok(())
    }

    /// Bytes of a domain's process image, before activation too. May block.
    ///
    /// # Errors
    /// `EIO` if the kernel module does not report the size.
    pub fn domain_size(&self, id: DomainId) -> Result<usize, Errno> {
        let raw = self.domain_raw(id)?;
        // SAFETY: the domain belongs to this master and is current, so it is valid.
        image_size(unsafe { (self.ecrt.functions().domain_size)(raw) })
    }

    /// A domain's process image; empty before activation and for a stale id. Real-time safe.
    #[inline]
    pub fn domain_data(&self, id: DomainId) -> &[u8] {
        match self.domain(id) {
            // SAFETY: the library maps `size` bytes there from activation to deactivation,
            // which needs `self` mutably, as does every call that lets the master write the
            // image (receive, process). With size 0 the pointer is dangling, which is allowed.
            Ok(domain) => unsafe { std::slice::from_raw_parts(domain.data.as_ptr(), domain.size) },
            Err(_) => &[],
        }
    }

    /// A domain's process image for writing; empty before activation and for a stale id. Real-time safe.
    #[inline]
    pub fn domain_data_mut(&mut self, id: DomainId) -> &mut [u8] {
        match self.domain(id) {
            // SAFETY: as in `domain_data`; domains do not overlap, and `self` is borrowed
            // mutably, so this is the only slice.
            Ok(domain) => unsafe {
                std::slice::from_raw_parts_mut(domain.data.as_ptr(), domain.size)
            },
            Err(_) => &mut [],
        }
    }

    /// Evaluates a domain's received datagrams. Real-time safe; call it after [`Master::receive`].
    pub fn domain_process(&mut self, id: DomainId) -> Result<(), Errno> {
        let raw = self.domain_raw(id)?;
        // SAFETY: the domain belongs to this master and is current, so it is valid.
        Errno::check(unsafe { status!(self.ecrt.functions().domain_process, raw) })
    }

    /// Queues a domain's datagrams. Real-time safe; call it before [`Master::send`].
    pub fn domain_queue(&mut self, id: DomainId) -> Result<(), Errno> {
        let raw = self.domain_raw(id)?;
        // SAFETY: as in `domain_process`.
        Errno::check(unsafe { status!(self.ecrt.functions().domain_queue, raw) })
    }

    /// Working counter of a domain's last processed exchange. Real-time safe.
    pub fn domain_state(&self, id: DomainId) -> Result<DomainState, Errno> {
        let raw = self.domain_raw(id)?;
        let mut answer = Answer::<ec_domain_state_t>::new();
        // SAFETY: as in `domain_process`; the target is writable.
        let status = unsafe { status!(self.ecrt.functions().domain_state, raw, answer.target()) };
        Errno::check(status)?;
        Ok(DomainState {
            working_counter: answer.value.working_counter,
            wc_state: match answer.value.wc_state {
                EC_WC_COMPLETE => WcState::Complete,
                EC_WC_INCOMPLETE => WcState::Incomplete,
                _ => WcState::Zero,
            },
            redundancy_active: answer.value.redundancy_active != 0,
        })
    }

    /// Sends everything queued. Real-time safe.
    pub fn send(&mut self) -> Result<(), Errno> {
        self.need_owned()?;
        // SAFETY: the master is valid as long as `self`.
        Errno::check(unsafe { status!(self.ecrt.functions().master_send, self.raw.as_ptr()) })
    }

    /// Processes received frames and writes their data into the domains. Real-time safe.
    pub fn receive(&mut self) -> Result<(), Errno> {
        self.need_owned()?;
        // SAFETY: the master is valid as long as `self`; no slice of an image is alive, since
        // `self` is borrowed mutably.
        Errno::check(unsafe { status!(self.ecrt.functions().master_receive, self.raw.as_ptr()) })
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
        let (sdo_requests, reg_requests) = self.requests.counts();
        f.debug_struct("Master")
            .field("ecrt", &self.ecrt)
            .field("ownership", &self.ownership)
            .field("active", &self.active)
            .field("domains", &self.domains.len())
            .field("slave_configs", &self.slave_configs.len())
            .field("sdo_requests", &sdo_requests)
            .field("reg_requests", &reg_requests)
            .finish_non_exhaustive()
    }
}

/// Result of a domain's last exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DomainState {
    /// Working counter, summed over the domain's datagrams.
    pub working_counter: u32,
    /// That sum compared with what the master expects.
    pub wc_state: WcState,
    /// The redundant link carries data.
    pub redundancy_active: bool,
}

/// Evaluation of a domain's working counter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WcState {
    /// No slave exchanged data.
    Zero,
    /// Some of it was exchanged.
    Incomplete,
    /// All of it was exchanged.
    Complete,
}

pub(super) struct Domain {
    raw: NonNull<ec_domain_t>,
    data: NonNull<u8>,
    size: usize,
}

impl Domain {
    pub(super) fn new(raw: NonNull<ec_domain_t>) -> Self {
        Self { raw, data: NonNull::dangling(), size: 0 }
    }
}

/// Part of a domain's process image, located once so that the cycle need not look for it.
struct Image {
    domain: usize,
    range: Range<usize>,
    data: NonNull<u8>,
    /// 0 while there are no process data.
    size: usize,
}

/// Nothing is mapped below: the kernel keeps these addresses free. A pointer into there is an
/// offset that an older library added to the NULL of a process image that does not exist yet.
const LOWEST_ADDRESS: usize = 0x1_0000;

/// Checks a size from the library: an error is `(size_t)-1`, or a negative error number in some
/// versions.
fn image_size(size: usize) -> Result<usize, Errno> {
    if size > isize::MAX as usize { Err(Errno::EIO) } else { Ok(size) }
}
