//! State of the bus: the master, its links, the slaves.

use ecrt_sys::{
    EC_PORT_EBUS, EC_PORT_MII, EC_PORT_NOT_CONFIGURED, Errno, ec_master_info_t,
    ec_master_link_state_t, ec_master_state_t, ec_slave_info_t, status,
};

use super::{Answer, Master};

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
    /// It is not configured.
    NotConfigured,
    /// Backplane.
    EBus,
    /// Ethernet.
    Mii,
}

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
}

/// A name up to its closing zero; the whole field where that is missing.
fn name(field: &[u8]) -> String {
    let bytes = field.split(|&byte| byte == 0).next().unwrap_or_default();
    String::from_utf8_lossy(bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::name;

    #[test]
    fn name_ends_at_the_zero_or_with_the_field() {
        assert_eq!(name(b"ECAN-Lite\0rest"), "ECAN-Lite");
        assert_eq!(name(b"full"), "full");
        assert_eq!(name(b""), "");
        assert_eq!(name(b"\xb5C\0"), "\u{fffd}C");
    }
}
