//! Protocol of the service of a running ECAN-Lite bus (docs/SERVICE.md): messages and records,
//! without I/O.
//!
//! A connection is a stream of messages ([`MessageReader`], [`header`]): JSON-RPC requests and
//! responses ([`Request`], [`Response`], [`Method`]), batches of CAN frames from the service
//! ([`FrameRecords`]) and to it ([`TransmitRecords`]), and PDO images ([`ImageMessage`]).
//!
//! Any byte string is read or rejected with an error; nothing here panics.

mod frames;
mod message;
mod requests;
mod rpc;
mod state;

pub use frames::{
    CAN_EFF_FLAG, CAN_ERR_FLAG, CAN_RTR_FLAG, CANFD_BRS, CANFD_ESI, CANFD_FDF, RecordError,
};
pub use frames::{
    FRAME_RECORD_BYTES, FrameEvent, FrameRecord, FrameRecords, FrameReport, MAX_FRAME_RECORD_BYTES,
    RejectReason,
};
pub use frames::{IMAGE_HEAD_BYTES, ImageMessage};
pub use frames::{TRANSMIT_RECORD_BYTES, TransmitRecord, TransmitRecords};
pub use message::{
    HEADER_BYTES, HeaderError, MAX_HELLO_PAYLOAD, MAX_METHOD_PAYLOAD, MAX_REQUEST_PAYLOAD,
    MAX_SERVICE_PAYLOAD, MAX_TRANSMIT_PAYLOAD, MessageKind, MessageReader, Sender, header,
    read_header,
};
pub use requests::{DownloadParams, MAX_SDO_BYTES, Upload, UploadParams};
pub use requests::{Empty, METHODS, Method, methods};
pub use requests::{EventKind, IdFilter, ImageDirection, ImageSubscription, Subscription};
pub use requests::{MAX_FILTERS, MAX_GATEWAYS};
pub use requests::{NmtCommand, NmtParams};
pub use rpc::{
    BAD_RECORD, BUS_ERROR, BUSY, DEFAULT_MAX_AGE_MS, EXPIRED, HELLO_FIRST, INTERNAL_ERROR,
    INVALID_PARAMS, INVALID_REQUEST, JSON_RPC, MAX_AGE_MS, METHOD_NOT_FOUND, NOT_AVAILABLE,
    NOT_PERMITTED, PARSE_ERROR, RawRequest, Request, Response, RpcError, WRONG_VERSION,
};
pub use rpc::{BusError, SdoDirection};
pub use state::{
    Access, Channel, Gateway, GatewaysChanged, Hello, HelloParams, MAX_NAME_BYTES,
    PROTOCOL_VERSION, clean_name,
};
pub use state::{
    ActiveConfig, Counters, CycleState, GatewayState, SampledTimes, SessionState, State,
};
pub use state::{
    AssignedParams, AssignedPdo, BusState, Link, LinkParams, PdoEntry, PortKind, Slave,
    SlaveParams, SlavePort,
};
pub use state::{Axes, AxisState};
pub use state::{ClientStats, ServiceStats};
