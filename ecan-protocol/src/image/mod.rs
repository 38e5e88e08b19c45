//! PDO images: header, packets, reader and writer (manual 6 to 10).

mod commit_fields;
mod crc;
mod diagnosis;
mod header;
mod packet;
mod packets;
mod profile;
mod push_error;
mod reader;
mod schedule;
mod sequence;
mod status;
mod timestamp;
mod tx_result;
mod writer;

pub use crate::object::pdo_profile::{BudgetPolicy, EncapsulationProfile, OptionFlags, PdoProfile};
pub use commit_fields::CommitFields;
#[doc(hidden)]
pub use crc::crc16_use_portable;
pub use crc::{crc16, crc16_is_accelerated, crc16_portable};
pub use diagnosis::{ImageFault, ParseDiagnosis, PdoError};
pub use header::{CRC_ALG_CCITT_FALSE, CRC_ALG_NONE, Header, HeaderFlags, VER_IHL};
pub use packet::{FramePacket, Packet};
pub use packets::{PacketCursor, Packets};
pub use profile::ProfileError;
pub use push_error::PushError;
pub use reader::{Image, ImageReader};
pub use schedule::Schedule;
pub use sequence::{Arrival, SequenceTracker};
pub use status::{ChannelState, ChannelStatus};
pub use timestamp::Timestamp;
pub use tx_result::{ResultCode, TxResult};
pub use writer::ImageWriter;
