//! A second, unreserved handle for state and SDO transfers beside the cycle.

use std::thread;

use ecan_protocol::AlState;
use ecrt_sys::{Ecrt, LinkState, Master, MasterState, SlaveInfo};

use crate::adapter::{Adapter, Phase};
use crate::cycle::CycleError;
use crate::error::{Error, SdoDirection};

/// State and blocking SDO transfers of the configured slaves, on a handle of its own.
///
/// Every call may block on the master's semaphore: never call it from the cycle. Once the master
/// is active, mailbox traffic moves only with the application's sending and receiving, so an SDO
/// transfer on the thread that runs the cycle would never end: use it from another thread, or
/// through [`Adapter::diagnose`].
#[derive(Debug)]
pub struct Diagnostics {
    master: Master,
    /// Ring position of each configured slave.
    positions: Vec<u16>,
}

impl Diagnostics {
    pub(crate) fn open(ecrt: &Ecrt, master_index: u32, positions: Vec<u16>) -> Result<Self, Error> {
        Ok(Self { master: ecrt.open_master(master_index)?, positions })
    }

    pub(crate) fn master(&self) -> &Master {
        &self.master
    }

    pub(crate) fn set_positions(&mut self, positions: Vec<u16>) {
        self.positions = positions;
    }

    /// Number of responding slaves, AL states present on the bus, link.
    ///
    /// # Errors
    /// The library's error.
    pub fn master_state(&self) -> Result<MasterState, Error> {
        self.master.state().map_err(|e| Error::library("ecrt_master_state", None, e))
    }

    /// Link of the main device (`device` = 0) or the backup device (1).
    ///
    /// # Errors
    /// The library's error, also where there is no such device.
    pub fn link_state(&self, device: u32) -> Result<LinkState, Error> {
        self.master
            .link_state(device)
            .map_err(|e| Error::library("ecrt_master_link_state", None, e))
    }

    /// What the master knows of a slave: identity, AL state, error flag, name.
    ///
    /// # Errors
    /// An index out of range, or the library's error (the slave is gone).
    pub fn slave_info(&self, slave: usize) -> Result<SlaveInfo, Error> {
        let position = self.position(slave)?;
        self.master
            .slave_info(position)
            .map_err(|e| Error::library("ecrt_master_get_slave", Some(slave), e))
    }

    /// AL state of a slave as the master last saw it; `None` for a value that is no state.
    ///
    /// # Errors
    /// As [`slave_info`](Self::slave_info).
    pub fn al_state(&self, slave: usize) -> Result<Option<AlState>, Error> {
        Ok(AlState::from_status(self.slave_info(slave)?.al_state.into()))
    }

    /// Uploads an object into `data` and returns its length in bytes.
    ///
    /// # Errors
    /// The abort code where the slave refused; else the library's error.
    pub fn sdo_upload(
        &self,
        slave: usize,
        index: u16,
        subindex: u8,
        data: &mut [u8],
    ) -> Result<usize, Error> {
        let position = self.position(slave)?;
        self.master
            .sdo_upload(position, index, subindex, data)
            .map_err(|e| Error::sdo(slave, SdoDirection::Upload, (index, subindex), e))
    }

    /// Uploads an object of at most 4 bytes as a little-endian number.
    ///
    /// # Errors
    /// As [`sdo_upload`](Self::sdo_upload).
    pub fn sdo_upload_u32(&self, slave: usize, index: u16, subindex: u8) -> Result<u32, Error> {
        let mut data = [0; 4];
        self.sdo_upload(slave, index, subindex, &mut data)?;
        Ok(u32::from_le_bytes(data))
    }

    /// Downloads an object.
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
        let position = self.position(slave)?;
        self.master
            .sdo_download(position, index, subindex, data)
            .map_err(|e| Error::sdo(slave, SdoDirection::Download, (index, subindex), e))
    }

    pub(crate) fn position(&self, slave: usize) -> Result<u16, Error> {
        self.positions
            .get(slave)
            .copied()
            .ok_or(Error::SlaveIndex { slave, count: self.positions.len() })
    }
}

impl Adapter {
    /// Runs `work` with a diagnostics handle of its own, while the cycle goes on.
    ///
    /// On an active bus `work` runs on another thread and `cycle` on this one, every cycle, until
    /// `work` is done; otherwise `work` just runs. Blocks; for SDO transfers in or between
    /// cycles use [`create_sdo_request`](Self::create_sdo_request).
    ///
    /// # Errors
    /// The handle cannot be opened. Errors of single cycles do not end the work.
    pub fn diagnose<R: Send>(
        &mut self,
        mut cycle: impl FnMut(&mut Self) -> Result<(), CycleError>,
        work: impl FnOnce(&Diagnostics) -> R + Send,
    ) -> Result<R, Error> {
        if self.phase != Phase::Active {
            return Ok(work(&self.diagnostics));
        }
        let diagnostics = self.open_diagnostics()?;
        let clock = self.ecrt.clock().clone();
        let cycle_ns = u64::from(self.config.cycle_ns);
        thread::scope(|scope| {
            let worker = scope.spawn(move || work(&diagnostics));
            let mut next = clock.now_ns();
            while !worker.is_finished() {
                // The transfer needs the bus to go on, whatever a single cycle says.
                let _ = cycle(self);
                next += cycle_ns;
                clock.sleep_until_ns(next);
            }
            worker.join().map_err(|panic| std::panic::resume_unwind(panic))
        })
    }
}
