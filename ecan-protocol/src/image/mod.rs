//! PDO images: header, packets, reader and writer (manual 6 to 10).

mod crc;
mod diagnosis;
mod header;
mod packet;
mod packets;
mod reader;
mod writer;

pub use crate::object::pdo_profile::{
    BudgetPolicy, EncapsulationProfile, FrameBudget, OptionFlags, PdoProfile, ProfileError,
};
#[doc(hidden)]
pub use crc::crc16_use_portable;
pub use crc::{crc16, crc16_is_accelerated, crc16_portable};
pub use diagnosis::{ImageFault, ParseDiagnosis, PdoError};
pub use header::{
    CRC_ALG_CCITT_FALSE, CRC_ALG_NONE, ChannelState, ChannelStatus, Header, HeaderFlags, VER_IHL,
};
pub use packet::{FramePacket, Packet, ResultCode, Schedule, Timestamp, TxResult};
pub use packets::{PacketCursor, Packets};
pub use reader::{Arrival, Image, ImageReader, SequenceTracker};
pub use writer::{CommitFields, ImageWriter, PushError};
