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
    CAN_EFF_FLAG, CAN_ERR_FLAG, CAN_RTR_FLAG, CANFD_BRS, CANFD_ESI, CANFD_FDF, FRAME_RECORD_BYTES,
    FrameEvent, FrameRecord, FrameRecords, FrameReport, IMAGE_HEAD_BYTES, ImageMessage,
    MAX_FRAME_RECORD_BYTES, RecordError, RejectReason, TRANSMIT_RECORD_BYTES, TransmitRecord,
    TransmitRecords,
};
pub use message::{
    HEADER_BYTES, HeaderError, MAX_HELLO_PAYLOAD, MAX_METHOD_PAYLOAD, MAX_REQUEST_PAYLOAD,
    MAX_SERVICE_PAYLOAD, MAX_TRANSMIT_PAYLOAD, MessageKind, MessageReader, Sender, header,
    read_header,
};
pub use requests::{
    DownloadParams, Empty, EventKind, IdFilter, ImageDirection, ImageSubscription, MAX_EVENTS,
    MAX_FILTERS, MAX_GATEWAYS, MAX_SDO_BYTES, METHODS, Method, NmtCommand, NmtParams,
    RecordedEvent, RecordedEvents, RecordedKind, Subscription, Upload, UploadParams, methods,
};
pub use rpc::{
    BAD_RECORD, BUS_ERROR, BUSY, BusError, DEFAULT_MAX_AGE_MS, EXPIRED, HELLO_FIRST,
    INTERNAL_ERROR, INVALID_PARAMS, INVALID_REQUEST, JSON_RPC, MAX_AGE_MS, METHOD_NOT_FOUND,
    NOT_AVAILABLE, NOT_PERMITTED, PARSE_ERROR, RawRequest, Request, Response, RpcError,
    SdoDirection, WRONG_VERSION,
};
pub use state::{
    Access, ActiveConfig, AssignedParams, AssignedPdo, Axes, AxisState, BusState, Channel,
    ChannelChanged, ClientStats, Counters, CycleState, Gateway, GatewayState, GatewaysChanged,
    Hello, HelloParams, Link, LinkParams, MAX_NAME_BYTES, PROTOCOL_VERSION, PdoEntry, PortKind,
    SampledTimes, ServiceStats, SessionState, Slave, SlaveParams, SlavePort, State, clean_name,
};
