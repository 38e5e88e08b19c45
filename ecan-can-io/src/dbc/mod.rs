//! Signals of CAN frames as a DBC file describes them.
//!
//! [`Database::parse`] reads a file, [`Database::decode`] gives the signals of a frame, and
//! [`Message::encode`] makes a frame of signal values. Multiplexed signals (also with several
//! multiplexers, `SG_MUL_VAL_`), both byte orders, signed, float and double signals, extended CAN IDs and
//! CAN FD are supported. CAN IDs must be equal: the parameter groups of J1939 with any source address
//! are not recognized.
//!
//! ```
//! use ecan_can_io::dbc::Database;
//! use ecan_protocol::can::{CanFrame, CanId};
//!
//! let file = br#"
//! BO_ 291 Engine: 4 ECU
//!  SG_ Speed : 0|16@1+ (0.1,0) [0|6553.5] "km/h" Vector__XXX
//!  SG_ Gear : 16|4@1+ (1,0) [0|15] "" Vector__XXX
//! VAL_ 291 Gear 0 "Neutral" 1 "First" ;
//! "#;
//! let database = Database::parse(file)?;
//! let frame = CanFrame::classic(CanId::standard(0x123)?, &[0xE8, 0x03, 0x01, 0x00])?;
//! let decoded = database.decode(&frame).expect("a message of the file");
//! let texts: Vec<_> = decoded.signals.iter().map(|signal| signal.to_string()).collect();
//! assert_eq!(texts, ["Speed = 100.0 km/h", "Gear = 1 (First)"]);
//!
//! let values = [("Speed", "100"), ("Gear", "First")];
//! assert_eq!(database.message_named("Engine")?.encode(&values)?, frame);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod database;
mod encode;
mod faults;
mod reader;
mod signal;
mod syntax;

pub use database::{Database, Decoded, DecodedSignal};
pub use encode::{EncodeError, EncodeErrorKind};
pub use faults::{DbcFault, DbcFaults, FaultKind};
pub use signal::{Condition, Message, Number, Signal, SignalKind, UnknownName};
