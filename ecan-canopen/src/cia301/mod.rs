//! Frames of CiA 301.

mod cob_id;
mod emcy;
mod error_history;
mod guarding;
mod heartbeat;
mod mpdo;
mod nmt;
mod node_id;
mod pdo;
mod sdo;
mod sdo_block;
mod sdo_client_frame;
mod sdo_server_frame;
mod sync;
mod time_of_day;

pub use cob_id::{CobId, Service};
pub use emcy::{Emcy, EmcyClass, ErrorRegister, error_code_text};
pub use error_history::HistoryEntry;
pub use guarding::GuardResponse;
pub use heartbeat::{HeartbeatConsumer, heartbeat_data, parse_heartbeat};
pub use mpdo::{DispatcherEntry, Mpdo, MpdoAddress, MpdoDecodeError, ScannerEntry};
pub use nmt::{NmtCommand, NmtRequest, NmtState};
pub use node_id::NodeId;
pub use pdo::{MappingEntry, PdoCobId, TransmissionType};
pub use sdo::{Initiate, SdoDecodeError, Segment};
pub use sdo_block::{BlockSegment, MAX_BLOCK_SIZE, block_crc};
pub use sdo_client_frame::ClientFrame;
pub use sdo_server_frame::ServerFrame;
pub use sync::{SYNC_COB_ID, parse_sync, sync_data};
pub use time_of_day::TimeOfDay;
