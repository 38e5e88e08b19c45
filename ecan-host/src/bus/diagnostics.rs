//! A second, unreserved handle for state and SDO transfers in parallel with the cycle.

use ecan_protocol::device::AlState;
use ecrt_sys::{Clock, Ecrt, Errno};

use super::slave_access::SlaveAccess;
use crate::config::AdapterConfig;
use crate::error::{Error, SdoDirection};
use crate::master::{AssignedPdo, LinkState, Master, MasterState, SlaveInfo};

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
