//! Operation phase: activation, process image, exchange.

use std::ops::Range;
use std::ptr::NonNull;

use ecrt_sys::{EC_WC_COMPLETE, EC_WC_INCOMPLETE, Errno, ec_domain_state_t, ec_domain_t, status};

use super::{Answer, DomainId, ImageId, Master};

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
    pub(super) raw: NonNull<ec_domain_t>,
    data: NonNull<u8>,
    size: usize,
}

impl Domain {
    pub(super) fn new(raw: NonNull<ec_domain_t>) -> Self {
        Self { raw, data: NonNull::dangling(), size: 0 }
    }
}

/// Part of a domain's process image, located once so that the cycle need not look for it.
pub(super) struct Image {
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

impl Master {
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
            let domain = self.domains.get(image.domain).filter(|it| image.range.end <= it.size);
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
