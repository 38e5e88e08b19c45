//! Methods about the EtherCAT bus and its slaves.

use serde::{Deserialize, Serialize};

/// Result of `bus.state`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct BusState {
    /// Slaves found by the last scan.
    pub slave_count: u32,
    /// Slaves that answer, over all links.
    pub slaves_responding: u32,
    /// AL states that occur: bit 0 INIT, 1 PREOP, 2 SAFEOP, 3 OP.
    pub al_states: u8,
    /// At least one link is up.
    pub link_up: bool,
    /// The main link is up.
    pub main_link_up: bool,
    /// A scan is running: slave information may be outdated.
    pub scan_busy: bool,
    /// Application time last given to the master, in nanoseconds since 2000-01-01.
    pub app_time_ns: u64,
}

/// Parameters of `bus.link`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkParams {
    /// 0 for the main link, 1 for the redundant one.
    pub device: u32,
}

/// Result of `bus.link`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Link {
    /// Slaves that answer on this link.
    pub slaves_responding: u32,
    /// AL states that occur on this link, bits as in [`BusState`].
    pub al_states: u8,
    /// This link is up.
    pub link_up: bool,
}

/// Parameters of `bus.slave`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlaveParams {
    /// Position on the bus, from 0.
    pub slave: u16,
}

/// A slave on the bus.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Slave {
    /// Position on the bus, from 0.
    pub position: u16,
    /// Vendor ID.
    pub vendor_id: u32,
    /// Product code.
    pub product_code: u32,
    /// Revision.
    pub revision_number: u32,
    /// Serial number.
    pub serial_number: u32,
    /// Station alias; 0 for none.
    pub alias: u16,
    /// Current from the E-bus in mA.
    pub current_on_ebus_ma: i16,
    /// AL state: 1 INIT, 2 PREOP, 4 SAFEOP, 8 OP; bit 4 marks an error.
    pub al_state: u8,
    /// The master met an error and keeps the slave in its state.
    pub error_flag: bool,
    /// Sync managers in the EEPROM.
    pub sync_count: u8,
    /// Objects in the dictionary, if the master fetched it.
    pub sdo_count: u16,
    /// Device name.
    pub name: String,
    /// The four ports.
    pub ports: [SlavePort; 4],
}

/// A port of a slave.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlavePort {
    /// Kind of port.
    pub kind: PortKind,
    /// A link is established.
    pub link_up: bool,
    /// The port returns frames.
    pub loop_closed: bool,
    /// A signal arrives.
    pub signal_detected: bool,
    /// Local time at which the delay measurement frame arrived, in nanoseconds.
    pub receive_time_ns: u32,
    /// Position of the neighbour.
    pub next_slave: Option<u16>,
    /// Delay to the next slave with distributed clocks, in nanoseconds.
    pub delay_to_next_dc_ns: u32,
}

/// Kind of a slave port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PortKind {
    /// The slave controller does not have it.
    NotImplemented,
    /// Not configured.
    NotConfigured,
    /// Backplane.
    Ebus,
    /// Ethernet.
    Mii,
}

/// Parameters of `pdo.assigned`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AssignedParams {
    /// Position of the slave.
    pub slave: u16,
    /// Sync manager.
    pub sync: u8,
}

/// An assigned PDO.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AssignedPdo {
    /// Mapping object.
    pub index: u16,
    /// Mapped objects.
    pub entries: Vec<PdoEntry>,
}

/// A mapped object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PdoEntry {
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// Length in bits.
    pub bits: u8,
}
