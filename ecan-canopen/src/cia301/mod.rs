//! Frames of CiA 301.

mod cob_id;
mod emcy;
mod nmt;
mod pdo;
mod sdo;

pub use cob_id::{CobId, Service};
pub use emcy::{Emcy, EmcyClass, ErrorRegister, HistoryEntry, error_code_text};
pub use nmt::{
    GuardResponse, HeartbeatConsumer, NmtCommand, NmtRequest, NmtState, NodeId, NodeIdError,
    heartbeat_data, parse_heartbeat,
};
pub use pdo::{
    DispatcherEntry, MappingEntry, Mpdo, MpdoAddress, MpdoError, PdoCobId, SYNC_COB_ID,
    ScannerEntry, TimeOfDay, TimeOfDayError, TransmissionType, parse_sync, sync_data,
};
pub use sdo::{
    BlockSegment, ClientFrame, Initiate, MAX_BLOCK_SIZE, SdoDecodeError, Segment, ServerFrame,
    block_crc,
};
