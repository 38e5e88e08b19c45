//! What can go wrong outside the cycle, with the fields that locate it.

use std::time::Duration;

use ecan_protocol::device::{AlState, Recognition};
use ecan_protocol::object::{AbortCode, describe};
use ecan_protocol::sequence::Expectation;
use ecrt_sys::Errno;
use thiserror::Error;

use crate::adapter::Phase;
use crate::config::{ConfigFault, Faults, Identity};
use crate::cycle::CycleError;
use crate::master::{OpenError, SdoError};
use crate::operation_report::NotOperational;

/// Direction of an SDO transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SdoDirection {
    /// From the slave.
    Upload,
    /// To the slave.
    Download,
}

impl SdoDirection {
    fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Upload => ("upload", "from"),
            Self::Download => ("download", "to"),
        }
    }
}

/// Errors of the Adapter outside the cycle.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// The configuration has faults; nothing was touched.
    #[error(transparent)]
    Config(#[from] Faults<ConfigFault>),
    /// The master could not be requested or opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// A call of the master library failed.
    #[error("{call}{} failed: {errno}", for_slave(*slave))]
    Library {
        /// Name of the library function.
        call: &'static str,
        /// Slave index, where the call concerns one.
        slave: Option<usize>,
        /// What the system said.
        errno: Errno,
    },
    /// No slave at the configured place.
    #[error(
        "slave {slave} (alias {alias}, position {position}) is not on the bus: {}",
        if *is_scanning {
            "the master is still scanning it".into()
        } else {
            format!("{responding} slave(s) found; check power and cabling, and `ethercat slaves`")
        }
    )]
    NoSuchSlave {
        /// Slave index.
        slave: usize,
        /// Configured alias.
        alias: u16,
        /// Configured position.
        position: u16,
        /// Number of slaves that the master found.
        responding: u32,
        /// Whether the master is still scanning the bus.
        is_scanning: bool,
    },
    /// Two configured slaves are one and the same.
    #[error("slaves {first} and {second} are the same one, at ring position {position}")]
    SameSlave {
        /// Index of the first.
        first: usize,
        /// Index of the second.
        second: usize,
        /// Where both are.
        position: u16,
    },
    /// Another master than the one that is reserved.
    #[error("the Adapter has reserved master {is} and cannot change to master {wanted}")]
    OtherMaster {
        /// The master in use.
        is: u32,
        /// The master asked for.
        wanted: u32,
    },
    /// An attached Adapter needs the handle of an owner, and only such a one.
    #[error("attach needs a handle that another owner drives (Master::from_raw)")]
    OwnedMaster,
    /// The call is for attached Adapters.
    #[error("{call} is for an Adapter that is attached to its owner's master")]
    NotAttached {
        /// The call.
        call: &'static str,
    },
    /// The slave has another identity than the configured one.
    #[error("slave {slave} is {found}, configured is {wanted}")]
    WrongIdentity {
        /// Slave index.
        slave: usize,
        /// Configured identity.
        wanted: Identity,
        /// Identity on the bus.
        found: Identity,
    },
    /// The slave is something else than an ECAN-Lite.
    #[error(
        "slave {slave} is not an ECAN-Lite: 0xF000 tells header versions 0x{:04X}, PDO unit {} \
         bytes, header {} bytes, where an ECAN-Lite has 0x0002, 128 and 24",
        found.header_version_mask, found.size_unit_bytes, found.header_bytes
    )]
    NotAnEcanLite {
        /// Slave index.
        slave: usize,
        /// What the slave tells about itself.
        found: Recognition,
    },
    /// The slave does not tell what it is.
    #[error("slave {slave} cannot be recognised as an ECAN-Lite: {cause}")]
    Unrecognised {
        /// Slave index.
        slave: usize,
        /// Why 0xF000 could not be read.
        #[source]
        cause: Box<Error>,
    },
    /// The slave offers other PDO chunks than the manual's (5.1).
    #[error(
        "slave {slave}: PDO 0x{pdo:04X} entry {entry} maps object 0x{found_index:04X} with \
         {found_bits} bits, expected 0x{expected_index:04X} with 128 bits (manual 5.1.1)"
    )]
    Mapping {
        /// Slave index.
        slave: usize,
        /// PDO map object, 0x1600.. or 0x1A00...
        pdo: u16,
        /// Entry subindex, from 1.
        entry: u8,
        /// Object that the slave maps.
        found_index: u16,
        /// Its length in bits.
        found_bits: u8,
        /// Object that the manual maps.
        expected_index: u16,
    },
    /// A PDO with another number of entries than the manual's 8 (5.1).
    #[error("slave {slave}: PDO 0x{pdo:04X} has {found} entries, expected 8 (manual 5.1.1)")]
    MappingCount {
        /// Slave index.
        slave: usize,
        /// PDO map object.
        pdo: u16,
        /// Entries that it has.
        found: u32,
    },
    /// The domain does not lay the chunks out as one continuous buffer.
    #[error(
        "slave {slave}: the master placed object 0x{index:04X} at domain offset {found}, \
         expected {expected}: the chunks are not continuous"
    )]
    Layout {
        /// Slave index.
        slave: usize,
        /// Data object.
        index: u16,
        /// Offset that the master gave.
        found: usize,
        /// Offset that makes the buffer continuous.
        expected: usize,
    },
    /// The slave does not come to PREOP, where it could be configured.
    #[error(
        "slave {slave} did not reach PREOP within {} ms: it is in {}{}", timeout.as_millis(),
        al_state_words(*al_state), if *error_flag { " with its error flag set" } else { "" }
    )]
    NotInPreop {
        /// Slave index.
        slave: usize,
        /// AL state it is in, as a number.
        al_state: u8,
        /// Whether its error flag is set.
        error_flag: bool,
        /// Time waited.
        timeout: Duration,
    },
    /// An SDO transfer failed.
    #[error(
        "SDO {} {} {} slave {slave} {}", direction.words().0, describe(*index, *subindex),
        direction.words().1, sdo_cause(abort_code, errno)
    )]
    Sdo {
        /// Slave index.
        slave: usize,
        /// Direction.
        direction: SdoDirection,
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// What the system said.
        errno: Errno,
        /// Why the slave refused, if it answered.
        abort_code: Option<AbortCode>,
    },
    /// An object reads back something else than its configuration demands.
    #[error(
        "{} of slave {slave} reads {}, expected {}",
        describe(*index, *subindex),
        value_words(*index, *subindex, *found),
        expected_words(*index, *subindex, *expected)
    )]
    Readback {
        /// Slave index.
        slave: usize,
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// What was expected.
        expected: Expectation,
        /// Value that was read.
        found: u32,
    },
    /// Not every slave reached OP in time.
    #[error(transparent)]
    NotOperational(Box<NotOperational>),
    /// The call does not fit the phase that the Adapter is in.
    #[error("{call} needs the Adapter {needed}, it is {is}")]
    Phase {
        /// The call.
        call: &'static str,
        /// Phase that it needs.
        needed: Phase,
        /// Phase that the Adapter is in.
        is: Phase,
    },
    /// The call belongs to the owner of the master that the Adapter is attached to.
    #[error("{call} is the business of the master's owner: this Adapter is attached to its handle")]
    Attached {
        /// The call.
        call: &'static str,
    },
    /// A slave index that is not configured.
    #[error("slave index {slave} is out of range: {count} slave(s) are configured")]
    SlaveIndex {
        /// The index.
        slave: usize,
        /// Number of configured slaves.
        count: usize,
    },
    /// The application gave up waiting, see
    /// [`Adapter::stop_waiting_when`](crate::Adapter::stop_waiting_when).
    #[error("given up by the application")]
    Stopped,
    /// The cycle failed while waiting.
    #[error(transparent)]
    Cycle(#[from] CycleError),
}

impl Error {
    pub(crate) fn library(call: &'static str, slave: Option<usize>, errno: Errno) -> Self {
        Self::Library { call, slave, errno }
    }

    pub(crate) fn sdo(
        slave: usize,
        direction: SdoDirection,
        (index, subindex): (u16, u8),
        error: SdoError,
    ) -> Self {
        Self::Sdo {
            slave,
            direction,
            index,
            subindex,
            errno: error.errno,
            abort_code: error.abort_code.map(AbortCode),
        }
    }
}

/// An AL state by name, or as the number it is.
pub(crate) fn al_state_words(raw: u8) -> String {
    AlState::from_status(raw.into())
        .map_or_else(|| format!("state {raw}"), |state| state.to_string())
}

fn for_slave(slave: Option<usize>) -> String {
    slave.map_or_else(String::new, |s| format!(" for slave {s}"))
}

fn sdo_cause(abort_code: &Option<AbortCode>, errno: &Errno) -> String {
    match abort_code {
        Some(code) => format!("aborted: {code}"),
        None => format!("failed: {errno}"),
    }
}

fn expected_words(index: u16, subindex: u8, expected: Expectation) -> String {
    match expected {
        Expectation::Equals(value) => value_words(index, subindex, value as u32),
        other => other.to_string(),
    }
}

/// A value with its meaning from the object dictionary, where it has one.
pub fn value_words(index: u16, subindex: u8, value: u32) -> String {
    let meaning =
        ecan_protocol::object::lookup(index, subindex).and_then(|(_, entry)| entry.meaning(value));
    match meaning {
        Some(words) => format!("{value} ({words})"),
        None if value > 9 => format!("{value} (0x{value:X})"),
        None => value.to_string(),
    }
}
