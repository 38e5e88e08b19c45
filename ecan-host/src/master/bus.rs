//! The bus as the master sees it: links, slaves, their PDOs, and SDO transfers that wait for the answer.

use std::fmt;

use ecrt_sys::{
    EC_PORT_EBUS, EC_PORT_MII, EC_PORT_NOT_CONFIGURED, Errno, ec_master_info_t,
    ec_master_link_state_t, ec_master_state_t, ec_pdo_entry_info_t, ec_pdo_info_t, ec_slave_info_t,
    ec_sync_info_t, status,
};

use super::handle::Master;
use super::raw::Answer;

/// General information about a master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MasterInfo {
    /// Slaves found by the last scan.
    pub slave_count: u32,
    /// The main link is up.
    pub link_up: bool,
    /// A scan is running: slave information may be outdated.
    pub scan_busy: bool,
    /// Application time last given to the master, ns since 2000-01-01.
    pub app_time_ns: u64,
}

/// State of all links of a master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MasterState {
    /// Slaves that answer, over all links.
    pub slaves_responding: u32,
    /// AL states that occur: bit 0 INIT, 1 PREOP, 2 SAFEOP, 3 OP.
    pub al_states: u8,
    /// At least one link is up.
    pub link_up: bool,
}

/// State of one link of a master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinkState {
    /// Slaves that answer on this link.
    pub slaves_responding: u32,
    /// AL states that occur on this link, bits as in [`MasterState::al_states`].
    pub al_states: u8,
    /// This link is up.
    pub link_up: bool,
}

/// Information about a slave on the bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SlaveInfo {
    /// Position on the bus, from 0.
    pub position: u16,
    /// Vendor ID in the slave's EEPROM.
    pub vendor_id: u32,
    /// Product code in the slave's EEPROM.
    pub product_code: u32,
    /// Revision in the slave's EEPROM.
    pub revision_number: u32,
    /// Serial number in the slave's EEPROM.
    pub serial_number: u32,
    /// Station alias, 0 when none is set.
    pub alias: u16,
    /// Current the slave takes from the E-bus, mA.
    pub current_on_ebus_ma: i16,
    /// AL state: 1 INIT, 2 PREOP, 4 SAFEOP, 8 OP; bit 4 marks an error.
    pub al_state: u8,
    /// The master met an error with this slave and keeps it in its state.
    pub error_flag: bool,
    /// Sync managers in the EEPROM.
    pub sync_count: u8,
    /// Objects in the dictionary, when it was fetched.
    pub sdo_count: u16,
    /// Device name; what is not UTF-8 is replaced.
    pub name: String,
    /// The four ports.
    pub ports: [PortInfo; 4],
}

/// A port of a slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortInfo {
    /// Kind of port.
    pub kind: PortKind,
    /// A link is established.
    pub link_up: bool,
    /// The port returns frames instead of passing them on.
    pub loop_closed: bool,
    /// A signal arrives.
    pub signal_detected: bool,
    /// Local time at which the delay measurement frame came in, ns.
    pub receive_time_ns: u32,
    /// Position of the neighbour at this port.
    pub next_slave: Option<u16>,
    /// Delay to the next slave with distributed clocks, ns.
    pub delay_to_next_dc_ns: u32,
}

/// Kind of a slave port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortKind {
    /// The slave controller does not have it.
    NotImplemented,
    /// The port is not configured.
    NotConfigured,
    /// Backplane.
    EBus,
    /// Ethernet.
    Mii,
}

/// A PDO that a sync manager has assigned.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AssignedPdo {
    /// Index of the mapping object.
    pub index: u16,
    /// Mapped objects.
    pub entries: Vec<PdoEntry>,
}

/// An object that a PDO maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PdoEntry {
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// Length in bits.
    pub bits: u8,
}

/// Contents of the target before an upload, and before its repetition. IgH 1.6.2 reports success if
/// the slave answers with a mailbox error; then the target is unchanged and the size undefined.
const FILLS: [u8; 2] = [0xA5, 0x5A];

/// Error of an SDO transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SdoError {
    /// The library's error: `EIO` aborted or failed on the bus, `EINVAL` no such slave,
    /// `EOVERFLOW` or `ENOBUFS` answer larger than the target.
    pub errno: Errno,
    /// Abort code of the slave.
    pub abort_code: Option<u32>,
}

impl SdoError {
    fn new(errno: Errno, abort_code: u32) -> Self {
        // The library sets the code with EIO only, and 0 is no code: the transfer failed
        // without an answer.
        let aborted = errno == Errno::EIO && abort_code != 0;
        Self { errno, abort_code: aborted.then_some(abort_code) }
    }
}

impl fmt::Display for SdoError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.abort_code {
            Some(code) => write!(f, "aborted by the slave with code 0x{code:08x}"),
            None => self.errno.fmt(f),
        }
    }
}

impl std::error::Error for SdoError {}

impl Master {
    /// General information. May block.
    pub fn info(&self) -> Result<MasterInfo, Errno> {
        let mut answer = Answer::<ec_master_info_t>::new();
        // SAFETY: the master is valid as long as `self`, and the target is writable.
        let status = unsafe { (self.ecrt.functions().master)(self.raw.as_ptr(), answer.target()) };
        Errno::check(status)?;
        let info = answer.value;
        Ok(MasterInfo {
            slave_count: info.slave_count,
            link_up: info.link_up() != 0,
            scan_busy: info.scan_busy != 0,
            app_time_ns: info.app_time,
        })
    }

    /// State of all links; lags the bus by seconds. Real-time safe.
    pub fn state(&self) -> Result<MasterState, Errno> {
        let mut answer = Answer::<ec_master_state_t>::new();
        // SAFETY: as in `info`.
        let status = unsafe {
            status!(self.ecrt.functions().master_state, self.raw.as_ptr(), answer.target())
        };
        Errno::check(status)?;
        let state = answer.value;
        Ok(MasterState {
            slaves_responding: state.slaves_responding,
            al_states: state.al_states() as u8,
            link_up: state.link_up() != 0,
        })
    }

    /// State of one link: 0 is the main link, 1 the first redundant one. Real-time safe if the link
    /// exists: the library writes to stderr otherwise.
    ///
    /// # Errors
    /// `EINVAL` for a link that is not configured.
    pub fn link_state(&self, device: u32) -> Result<LinkState, Errno> {
        let mut answer = Answer::<ec_master_link_state_t>::new();
        // SAFETY: as in `info`.
        let status = unsafe {
            (self.ecrt.functions().master_link_state)(self.raw.as_ptr(), device, answer.target())
        };
        Errno::check(status)?;
        let state = answer.value;
        Ok(LinkState {
            slaves_responding: state.slaves_responding,
            al_states: state.al_states() as u8,
            link_up: state.link_up() != 0,
        })
    }

    /// The slave at a ring position. May block; allocates the name.
    ///
    /// # Errors
    /// `EINVAL` where there is no slave.
    pub fn slave_info(&self, position: u16) -> Result<SlaveInfo, Errno> {
        let mut answer = Answer::<ec_slave_info_t>::new();
        // SAFETY: as in `info`.
        let status = unsafe {
            (self.ecrt.functions().master_get_slave)(self.raw.as_ptr(), position, answer.target())
        };
        Errno::check(status)?;
        let info = answer.value;
        Ok(SlaveInfo {
            position: info.position,
            vendor_id: info.vendor_id,
            product_code: info.product_code,
            revision_number: info.revision_number,
            serial_number: info.serial_number,
            alias: info.alias,
            current_on_ebus_ma: info.current_on_ebus,
            al_state: info.al_state,
            error_flag: info.error_flag != 0,
            sync_count: info.sync_count,
            sdo_count: info.sdo_count,
            name: name(&info.name.map(|character| character as u8)),
            ports: info.ports.map(|port| PortInfo {
                kind: match port.desc {
                    EC_PORT_NOT_CONFIGURED => PortKind::NotConfigured,
                    EC_PORT_EBUS => PortKind::EBus,
                    EC_PORT_MII => PortKind::Mii,
                    _ => PortKind::NotImplemented,
                },
                link_up: port.link.link_up != 0,
                loop_closed: port.link.loop_closed != 0,
                signal_detected: port.link.signal_detected != 0,
                receive_time_ns: port.receive_time,
                next_slave: (port.next_slave != u16::MAX).then_some(port.next_slave),
                delay_to_next_dc_ns: port.delay_to_next_dc,
            }),
        })
    }

    /// PDOs that a sync manager had assigned when the master scanned the slave, or was given by a
    /// configuration since; empty for a sync manager that the slave does not have. May block.
    pub(crate) fn assigned_pdos(&self, position: u16, sync: u8) -> Result<Vec<AssignedPdo>, Errno> {
        // The library writes to stderr when it is asked for what does not exist.
        if sync >= self.slave_info(position)?.sync_count {
            return Ok(Vec::new());
        }
        let (functions, master) = (self.ecrt.functions(), self.raw.as_ptr());
        let mut found = Answer::<ec_sync_info_t>::new();
        // SAFETY: the master is valid as long as `self`, and the target is writable.
        let status =
            unsafe { (functions.master_get_sync_manager)(master, position, sync, found.target()) };
        Errno::check(status)?;
        let pdo = |at| {
            let mut found = Answer::<ec_pdo_info_t>::new();
            // SAFETY: as above.
            let status =
                unsafe { (functions.master_get_pdo)(master, position, sync, at, found.target()) };
            Errno::check(status)?;
            let entry = |entry| {
                let mut found = Answer::<ec_pdo_entry_info_t>::new();
                // SAFETY: as above.
                let status = unsafe {
                    (functions.master_get_pdo_entry)(
                        master,
                        position,
                        sync,
                        at,
                        entry,
                        found.target(),
                    )
                };
                Errno::check(status)?;
                let ec_pdo_entry_info_t { index, subindex, bit_length } = found.value;
                Ok(PdoEntry { index, subindex, bits: bit_length })
            };
            let count = u16::try_from(found.value.n_entries).unwrap_or(u16::MAX);
            let entries = (0..count).map(entry).collect::<Result<_, Errno>>()?;
            Ok(AssignedPdo { index: found.value.index, entries })
        };
        (0..u16::try_from(found.value.n_pdos).unwrap_or(u16::MAX)).map(pdo).collect()
    }

    /// Reads an object of the slave at a ring position into `target` and returns how many bytes
    /// it has; the bytes after it become 0. Blocks until the slave answers.
    ///
    /// # Errors
    /// The slave aborts, does not answer or is not there, or the object does not fit.
    pub fn sdo_upload(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        target: &mut [u8],
    ) -> Result<usize, SdoError> {
        for fill in FILLS {
            target.fill(fill);
            let (mut size, mut abort_code) = (0, 0);
            // SAFETY: the master is valid as long as `self`; target and its length belong together,
            // the two results are writable.
            let status = unsafe {
                (self.ecrt.functions().master_sdo_upload)(
                    self.raw.as_ptr(),
                    position,
                    index,
                    subindex,
                    target.as_mut_ptr(),
                    target.len(),
                    &mut size,
                    &mut abort_code,
                )
            };
            Errno::check(status).map_err(|errno| SdoError::new(errno, abort_code))?;
            let is_changed = target.iter().any(|byte| *byte != fill);
            match target.get_mut(size..) {
                Some(rest) if is_changed || size == 0 => {
                    rest.fill(0);
                    return Ok(size);
                }
                None if is_changed => return Err(SdoError::new(Errno::EOVERFLOW, 0)),
                _ => {}
            }
        }
        Err(SdoError::new(Errno::EIO, 0))
    }

    /// Writes an object of the slave at a ring position. Blocks until the slave answers.
    ///
    /// # Errors
    /// The slave aborts, does not answer or is not there.
    pub fn sdo_download(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), SdoError> {
        let mut abort_code = 0;
        // SAFETY: the master is valid as long as `self`; data and its length belong together,
        // the result is writable.
        let status = unsafe {
            (self.ecrt.functions().master_sdo_download)(
                self.raw.as_ptr(),
                position,
                index,
                subindex,
                data.as_ptr(),
                data.len(),
                &mut abort_code,
            )
        };
        Errno::check(status).map_err(|errno| SdoError::new(errno, abort_code))
    }

    /// Writes an object of the slave at a ring position by Complete Access, from subindex 0 on. Blocks until the
    /// slave answers.
    ///
    /// # Errors
    /// As [`sdo_download`](Self::sdo_download); `ENOSYS` if the library lacks the function.
    pub fn sdo_download_complete(
        &self,
        position: u16,
        index: u16,
        data: &[u8],
    ) -> Result<(), SdoError> {
        let function = self.ecrt.functions().master_sdo_download_complete;
        let function = function.ok_or(SdoError::new(Errno::ENOSYS, 0))?;
        let mut abort_code = 0;
        // SAFETY: as in `sdo_download`.
        let status = unsafe {
            function(self.raw.as_ptr(), position, index, data.as_ptr(), data.len(), &mut abort_code)
        };
        Errno::check(status).map_err(|errno| SdoError::new(errno, abort_code))
    }
}

/// A name up to its closing zero; the whole field where that is missing.
fn name(field: &[u8]) -> String {
    let bytes = field.split(|&byte| byte == 0).next().unwrap_or_default();
    String::from_utf8_lossy(bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn name_ends_at_the_zero_or_with_the_field() {
        assert_eq!(name(b"ECAN-Lite\0rest"), "ECAN-Lite");
        assert_eq!(name(b"full"), "full");
        assert_eq!(name(b""), "");
        assert_eq!(name(b"\xb5C\0"), "\u{fffd}C");
    }

    #[test]
    fn abort_code_is_valid_with_eio_only() {
        let abort = |errno, code| SdoError::new(errno, code).abort_code;
        assert_eq!(abort(Errno::EIO, 0x0602_0000), Some(0x0602_0000));
        assert_eq!(abort(Errno::EIO, 0), None);
        assert_eq!(abort(Errno::EINVAL, 0x0602_0000), None);
    }
}
