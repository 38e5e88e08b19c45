//! State of the bus and SDO transfers in parallel with the cycle, on a second, unreserved handle.

use std::panic::resume_unwind;
use std::sync::Barrier;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Scope, ScopedJoinHandle};
use std::{fmt, thread};

use ecan_protocol::device::AlState;
use ecan_protocol::object::AbortCode;
use ecrt_sys::{Clock, Ecrt, Errno};

use crate::config::AdapterConfig;
use crate::error::{Error, SdoDirection};
use crate::master::{AssignedPdo, LinkState, Master, MasterInfo, MasterState, SdoError, SlaveInfo};

/// Time in which a transfer without response is repeated, in nanoseconds: a master collides with
/// its own mailbox traffic for about a second per slave while it reads the SDO dictionaries after a
/// scan.
const REPEAT_NS: u64 = 5_000_000_000;
/// Pause before the first repetition, in nanoseconds; each one doubles it, up to the longest. The
/// library writes a line to stderr for each transfer that fails.
const FIRST_PAUSE_NS: u64 = 50_000_000;
const LONGEST_PAUSE_NS: u64 = 400_000_000;

/// Returns whether a transfer can succeed soon: it got no response, or the master scans the bus.
fn may_pass(error: &Error) -> bool {
    matches!(
        error,
        Error::Sdo { errno: Errno::EIO, abort_code: None, .. }
            | Error::NoSuchSlave { is_scanning: true, .. }
    )
}

/// State and blocking SDO transfers of the configured slaves, on a handle of its own.
///
/// Every call may block on the master's semaphore: never call it from the cycle. Once the master
/// is active, mailbox traffic moves only with the application's sending and receiving, so an SDO
/// transfer on the thread that runs the cycle would never end: use it from another thread, or
/// through [`Adapter::diagnose`](crate::Adapter::diagnose).
#[derive(Debug)]
pub struct Diagnostics {
    access: Box<dyn SlaveAccess>,
    addresses: Vec<(u16, u16)>,
}

impl Diagnostics {
    /// A handle on the slaves of a configuration, by their index in it, also while another handle of this
    /// process drives the bus.
    ///
    /// # Errors
    /// [`Error::Open`].
    pub fn open(ecrt: &Ecrt, config: &AdapterConfig) -> Result<Self, Error> {
        let access = Box::new(Master::open(ecrt, config.master_index)?);
        let mut diagnostics = Self { access, addresses: Vec::new() };
        diagnostics.set_addresses(config);
        Ok(diagnostics)
    }

    /// A function that opens another handle, on the thread that calls it.
    pub(crate) fn opener(
        ecrt: &Ecrt,
        config: &AdapterConfig,
    ) -> impl FnOnce() -> Result<Self, Error> + Send + use<> {
        let (ecrt, config) = (ecrt.clone(), *config);
        move || Self::open(&ecrt, &config)
    }

    /// A handle on every slave of the bus, configured or not: the index of a slave is its position.
    /// For tools that inspect a bus that no application or another one drives.
    ///
    /// Blocks while the bus is scanned.
    pub fn of_bus(ecrt: &Ecrt, master_index: u32) -> Result<Self, Error> {
        Self::of_access(Box::new(Master::open(ecrt, master_index)?))
    }

    /// As [`of_bus`](Self::of_bus), through any access to the bus.
    pub fn of_access(access: Box<dyn SlaveAccess>) -> Result<Self, Error> {
        let count = access.master_state()?.slaves_responding;
        let addresses = (0..count).filter_map(|at| Some((0, u16::try_from(at).ok()?))).collect();
        Ok(Self { access, addresses })
    }

    /// Clock of the bus, or of this host if another program drives the bus.
    pub fn clock(&self) -> &dyn Clock {
        self.access.clock()
    }

    /// Number of its slaves.
    pub fn slave_count(&self) -> usize {
        self.addresses.len()
    }

    pub(crate) fn set_addresses(&mut self, config: &AdapterConfig) {
        self.addresses = config.slaves.iter().map(|s| (s.alias, s.position)).collect();
    }

    /// Number of responding slaves, AL states present on the bus, link.
    pub fn master_state(&self) -> Result<MasterState, Error> {
        self.access.master_state()
    }

    /// Checks that the network interface of the master has a link.
    ///
    /// # Errors
    /// [`Error::NoLink`], or the library's error.
    pub fn require_link(&self) -> Result<(), Error> {
        if self.master_state()?.link_up { Ok(()) } else { Err(Error::NoLink) }
    }

    /// Checks that the master has a link and any slave responds.
    ///
    /// # Errors
    /// [`Error::NoLink`], [`Error::NoSlaves`], or the library's error.
    pub fn require_slaves(&self) -> Result<(), Error> {
        self.require_link()?;
        if self.master_state()?.slaves_responding > 0 { Ok(()) } else { Err(Error::NoSlaves) }
    }

    /// Link of the main device (`device` = 0) or the backup device (1).
    pub fn link_state(&self, device: u32) -> Result<LinkState, Error> {
        self.access.link_state(device)
    }

    /// Information about a slave: identity, AL state, error flag, name.
    pub fn slave_info(&self, slave: usize) -> Result<SlaveInfo, Error> {
        let position = self.ring_position(slave)?;
        self.access.slave_info(position).map_err(|error| error.of_slave(slave, 1))
    }

    /// AL state of a slave as the master last saw it; `None` for a value that is no state.
    pub fn al_state(&self, slave: usize) -> Result<Option<AlState>, Error> {
        Ok(AlState::from_status(self.slave_info(slave)?.al_state.into()))
    }

    /// PDOs that a sync manager of a slave had assigned when the master scanned the bus, or that a
    /// program assigned since. Without SDO transfers.
    pub(crate) fn assigned_pdos(&self, slave: usize, sync: u8) -> Result<Vec<AssignedPdo>, Error> {
        let position = self.ring_position(slave)?;
        self.access.assigned_pdos(position, sync).map_err(|error| error.of_slave(slave, 1))
    }

    /// Uploads an object into `data` and returns its length in bytes. Blocks. A transfer without a
    /// response, or while the master scans the bus, is repeated for up to 5 s.
    ///
    /// # Errors
    /// [`Error::Sdo`] with the abort code if the slave rejected it, and the number of attempts;
    /// [`Error::NoSuchSlave`].
    pub fn sdo_upload(
        &self,
        slave: usize,
        index: u16,
        subindex: u8,
        data: &mut [u8],
    ) -> Result<usize, Error> {
        self.repeat(slave, |position| self.access.sdo_upload(position, index, subindex, data))
    }

    /// Uploads an object of at most 4 bytes as a little-endian number; repeated as
    /// [`sdo_upload`](Self::sdo_upload).
    ///
    /// # Errors
    /// As [`sdo_upload`](Self::sdo_upload).
    pub fn sdo_upload_u32(&self, slave: usize, index: u16, subindex: u8) -> Result<u32, Error> {
        let mut data = [0; 4];
        self.repeat(slave, |position| {
            match self.access.sdo_upload(position, index, subindex, &mut data)? {
                // The library reports a mailbox error as success without data.
                0 => Err(Error::Sdo {
                    slave,
                    direction: SdoDirection::Upload,
                    index,
                    subindex,
                    errno: Errno::EIO,
                    abort_code: None,
                    attempts: 1,
                }),
                _ => Ok(()),
            }
        })?;
        Ok(u32::from_le_bytes(data))
    }

    /// Downloads an object; repeated as [`sdo_upload`](Self::sdo_upload).
    ///
    /// # Errors
    /// As [`sdo_upload`](Self::sdo_upload).
    pub fn sdo_download(
        &self,
        slave: usize,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), Error> {
        self.repeat(slave, |position| self.access.sdo_download(position, index, subindex, data))
    }

    fn repeat<R>(
        &self,
        slave: usize,
        mut transfer: impl FnMut(u16) -> Result<R, Error>,
    ) -> Result<R, Error> {
        let clock = self.clock();
        let end_ns = clock.now_ns().saturating_add(REPEAT_NS);
        let (mut attempts, mut pause_ns) = (0, FIRST_PAUSE_NS);
        loop {
            let result = self.ring_position(slave).and_then(|position| {
                attempts += 1;
                transfer(position).map_err(|error| error.of_slave(slave, attempts))
            });
            match result {
                Err(error) if may_pass(&error) => {
                    while !self.wait_for_mailbox(slave, pause_ns) && clock.now_ns() < end_ns {}
                    pause_ns = LONGEST_PAUSE_NS.min(2 * pause_ns);
                    if clock.now_ns() >= end_ns {
                        return Err(error);
                    }
                }
                result => return result,
            }
        }
    }

    /// Pauses; returns whether the slave has a mailbox then, in the state that the master reports.
    fn wait_for_mailbox(&self, slave: usize, pause_ns: u64) -> bool {
        self.clock().sleep_until_ns(self.clock().now_ns().saturating_add(pause_ns));
        self.slave_info(slave).is_ok_and(|info| {
            let state = AlState::from_raw(info.al_state);
            state.is_some_and(|state| state.has_mailbox())
        })
    }

    /// Downloads a command that must not be executed twice, for example a restart: never repeated.
    /// Without an abort code in the error, the slave may have executed it.
    ///
    /// # Errors
    /// The abort code if the slave rejected it.
    pub fn sdo_download_once(
        &self,
        slave: usize,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), Error> {
        let position = self.ring_position(slave)?;
        let result = self.access.sdo_download(position, index, subindex, data);
        result.map_err(|error| error.of_slave(slave, 1))
    }

    /// Downloads an object by Complete Access, from subindex 0 on, of which the entry has 16 bits. Never repeated.
    ///
    /// # Errors
    /// The abort code if the slave rejected it; one without Complete Access has 0x06010000.
    pub fn sdo_download_complete(
        &self,
        slave: usize,
        index: u16,
        data: &[u8],
    ) -> Result<(), Error> {
        let position = self.ring_position(slave)?;
        let result = self.access.sdo_download_complete(position, index, data);
        result.map_err(|error| error.of_slave(slave, 1))
    }

    /// Current position of a configured slave: alias 0 counts from the start, another one from
    /// the slave that has it.
    pub(crate) fn ring_position(&self, slave: usize) -> Result<u16, Error> {
        let count = self.addresses.len();
        let (alias, position) =
            self.addresses.get(slave).copied().ok_or(Error::SlaveIndex { slave, count })?;
        let info = self.access.master_info()?;
        // The list of a master that does not scan keeps slaves that are gone.
        let state = self.master_state()?;
        let responding =
            if info.scan_busy { 0 } else { info.slave_count.min(state.slaves_responding) };
        let on_bus = u16::try_from(responding).unwrap_or(u16::MAX);
        let has_alias =
            |p: &u16| self.access.slave_info(*p).is_ok_and(|found| found.alias == alias);
        let base = if alias == 0 { Some(0) } else { (0..on_bus).find(has_alias) };
        base.and_then(|base| base.checked_add(position)).filter(|p| *p < on_bus).ok_or(
            Error::NoSuchSlave { slave, alias, position, responding, is_scanning: info.scan_busy },
        )
    }
}

/// State of a bus and blocking SDO transfers, each in one attempt. [`Diagnostics`] adds the
/// addresses of the slaves and the repetition.
///
/// Implemented by [`Master`]; a program that reaches a bus in another way implements it too. A
/// slave is its position on the bus, in the arguments and in the errors. Calls may block.
///
/// # Errors
/// [`Error::Sdo`] of a transfer, [`Error::Library`] of the other calls;
/// [`Error::NotPermitted`] and [`Error::Disconnected`] of an access through another program.
///
/// [`Diagnostics`]: crate::Diagnostics
pub trait SlaveAccess: fmt::Debug + Send {
    /// Clock for pauses and time limits.
    fn clock(&self) -> &dyn Clock;

    /// General information about the master.
    fn master_info(&self) -> Result<MasterInfo, Error>;

    /// Number of responding slaves, AL states present on the bus, link.
    fn master_state(&self) -> Result<MasterState, Error>;

    /// State of the main link (`device` = 0) or the redundant one (1).
    fn link_state(&self, device: u32) -> Result<LinkState, Error>;

    /// Information about a slave.
    fn slave_info(&self, position: u16) -> Result<SlaveInfo, Error>;

    /// PDOs that a sync manager of a slave has assigned; without SDO transfers.
    fn assigned_pdos(&self, position: u16, sync: u8) -> Result<Vec<AssignedPdo>, Error>;

    /// Uploads an object into `data` and returns its length; the bytes after it become 0.
    fn sdo_upload(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        data: &mut [u8],
    ) -> Result<usize, Error>;

    /// Downloads an object.
    fn sdo_download(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), Error>;

    /// Downloads an object by Complete Access, from subindex 0 on.
    fn sdo_download_complete(&self, position: u16, index: u16, data: &[u8]) -> Result<(), Error>;
}

impl SlaveAccess for Master {
    fn clock(&self) -> &dyn Clock {
        self.ecrt().clock().as_ref()
    }

    fn master_info(&self) -> Result<MasterInfo, Error> {
        self.info().map_err(failed("ecrt_master", None))
    }

    fn master_state(&self) -> Result<MasterState, Error> {
        self.state().map_err(failed("ecrt_master_state", None))
    }

    fn link_state(&self, device: u32) -> Result<LinkState, Error> {
        Master::link_state(self, device).map_err(failed("ecrt_master_link_state", None))
    }

    fn slave_info(&self, position: u16) -> Result<SlaveInfo, Error> {
        Master::slave_info(self, position).map_err(failed("ecrt_master_get_slave", Some(position)))
    }

    fn assigned_pdos(&self, position: u16, sync: u8) -> Result<Vec<AssignedPdo>, Error> {
        let call = "ecrt_master_get_sync_manager";
        Master::assigned_pdos(self, position, sync).map_err(failed(call, Some(position)))
    }

    fn sdo_upload(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        data: &mut [u8],
    ) -> Result<usize, Error> {
        let result = Master::sdo_upload(self, position, index, subindex, data);
        result.map_err(transfer_failed(position, SdoDirection::Upload, (index, subindex)))
    }

    fn sdo_download(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), Error> {
        let result = Master::sdo_download(self, position, index, subindex, data);
        result.map_err(transfer_failed(position, SdoDirection::Download, (index, subindex)))
    }

    fn sdo_download_complete(&self, position: u16, index: u16, data: &[u8]) -> Result<(), Error> {
        let result = Master::sdo_download_complete(self, position, index, data);
        result.map_err(transfer_failed(position, SdoDirection::Download, (index, 0)))
    }
}

fn failed(call: &'static str, position: Option<u16>) -> impl FnOnce(Errno) -> Error {
    move |errno| Error::library(call, position.map(usize::from), errno)
}

fn transfer_failed(
    position: u16,
    direction: SdoDirection,
    (index, subindex): (u16, u8),
) -> impl FnOnce(SdoError) -> Error {
    move |SdoError { errno, abort_code }| Error::Sdo {
        slave: position.into(),
        direction,
        index,
        subindex,
        errno,
        abort_code: abort_code.map(AbortCode),
        attempts: 1,
    }
}

/// Reports the end of the work, also after a panic.
struct WorkerGuard<'a>(&'a AtomicBool);

impl Drop for WorkerGuard<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Starts a thread, which the host may deny.
///
/// # Errors
/// [`Error::Thread`].
pub fn spawn_scoped<'scope, R: Send + 'scope>(
    scope: &'scope Scope<'scope, '_>,
    work: impl FnOnce() -> R + Send + 'scope,
) -> Result<ScopedJoinHandle<'scope, R>, Error> {
    let denied = |error: std::io::Error| Error::Thread {
        errno: Errno::new(error.raw_os_error().unwrap_or_default()),
    };
    thread::Builder::new().spawn_scoped(scope, work).map_err(denied)
}

/// Runs `work` on another thread, with the diagnostics handle that `open` returns there, and
/// `cycle` on this one until `work` is done. `cycle` is one whole cycle including its wait; at
/// least one is run.
///
/// # Errors
/// That of `open`; [`Error::Thread`] before the first cycle.
pub fn run_in_parallel<R: Send>(
    clock: &dyn Clock,
    open: impl FnOnce() -> Result<Diagnostics, Error> + Send,
    work: impl FnOnce(&Diagnostics) -> R + Send,
    mut cycle: impl FnMut(),
) -> Result<R, Error> {
    let is_done = &AtomicBool::new(false);
    // On a stepped clock no cycle runs until the worker has its handle: so every run is the same.
    let opened = &(!clock.is_free_running()).then(|| Barrier::new(2));
    thread::scope(|scope| {
        let worker = spawn_scoped(scope, move || {
            let guard = WorkerGuard(is_done);
            let diagnostics = open();
            opened.as_ref().map(Barrier::wait);
            let diagnostics = diagnostics?;
            let result = work(&diagnostics);
            // Before the handle is released: stepped time moves only when the work is reported done.
            drop(guard);
            Ok(result)
        })?;
        opened.as_ref().map(Barrier::wait);
        loop {
            cycle();
            if is_done.load(Ordering::Acquire) {
                break;
            }
        }
        worker.join().unwrap_or_else(|panic| resume_unwind(panic))
    })
}
