//! Fields of a failed bus call.

use serde::{Deserialize, Serialize};

/// Direction of an SDO transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SdoDirection {
    /// From the slave.
    Upload,
    /// To the slave.
    Download,
}

/// Fields of a failed bus call: `data` of an error with the code
/// [`BUS_ERROR`](crate::protocol::BUS_ERROR). A slave is its position on the bus, except in `SlaveIndex`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum BusError {
    /// An SDO transfer failed.
    Sdo {
        /// Position of the slave.
        slave: u32,
        /// Direction.
        direction: SdoDirection,
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Error number of the system.
        errno: i32,
        /// Abort code of the slave, if it answered.
        abort_code: Option<u32>,
        /// Number of attempts.
        attempts: u32,
    },
    /// No slave at the address.
    NoSuchSlave {
        /// Index of the slave.
        slave: u32,
        /// Configured alias.
        alias: u16,
        /// Configured position.
        position: u16,
        /// Number of slaves that the master found.
        responding: u32,
        /// The master is still scanning the bus.
        is_scanning: bool,
    },
    /// An index out of range.
    SlaveIndex {
        /// The index.
        slave: u32,
        /// Number of slaves.
        count: u32,
    },
    /// A call of the master library failed.
    Library {
        /// Name of the library function.
        call: String,
        /// Position of the slave, if the call concerns one.
        slave: Option<u32>,
        /// Error number of the system.
        errno: i32,
    },
    /// Another error; the message describes it.
    Other,
}
