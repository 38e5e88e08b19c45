//! The methods of a service: names, access, parameters and results.
//!
//! Lists in parameters are checked for limit, range and duplicates while they are read, so that a longer list
//! takes no memory.

use std::fmt;
use std::fmt::Debug;
use std::marker::PhantomData;

use ecan_protocol::can::CanFrame;
use ecan_protocol::mapping::CHANNELS;
use serde::de::{DeserializeOwned, Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::frames::{FrameEvent, fields_of};
use super::rpc::{INVALID_PARAMS, RpcError};
use super::state::{
    Access, ActiveConfig, AssignedParams, AssignedPdo, Axes, BusState, Hello, HelloParams, Link,
    LinkParams, ServiceStats, Slave, SlaveParams, State,
};

/// Parameters or result without members.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Empty {}

/// A method with the types of its parameters and result.
pub trait Method {
    /// Name in the request.
    const NAME: &'static str;
    /// Access that a client needs.
    const ACCESS: Access;
    /// Parameters.
    type Params: Serialize + DeserializeOwned;
    /// Result.
    type Result: Serialize + DeserializeOwned;
}

macro_rules! methods {
    ($( $(#[$doc:meta])* $type:ident = $name:literal, $access:ident, $params:ty => $result:ty; )+) => {
        /// Markers of the methods, as type parameters of a typed request.
        pub mod methods {
            use super::*;
            $(
                $(#[$doc])*
                #[derive(Debug, Clone, Copy)]
                pub struct $type;
                impl Method for $type {
                    const NAME: &'static str = $name;
                    const ACCESS: Access = Access::$access;
                    type Params = $params;
                    type Result = $result;
                }
            )+
        }
        /// Names of the methods of version 1, with the access that they need. Extensions have
        /// further ones.
        pub const METHODS: &[(&str, Access)] = &[$( ($name, Access::$access), )+];
    };
}

methods! {
    /// Introduces the client; the first request.
    SayHello = "hello", Read, HelloParams => Hello;
    /// State of the master and its links.
    ReadBusState = "bus.state", Read, Empty => BusState;
    /// State of one link.
    ReadLink = "bus.link", Read, LinkParams => Link;
    /// All slaves.
    ReadSlaves = "bus.slaves", Read, Empty => Vec<Slave>;
    /// One slave.
    ReadSlave = "bus.slave", Read, SlaveParams => Slave;
    /// Uploads an object.
    UploadSdo = "sdo.upload", Read, UploadParams => Upload;
    /// Downloads an object.
    DownloadSdo = "sdo.download", Control, DownloadParams => Empty;
    /// PDOs that a sync manager has assigned.
    ReadAssigned = "pdo.assigned", Read, AssignedParams => Vec<AssignedPdo>;
    /// The last cycle.
    ReadState = "state", Read, Empty => State;
    /// The axes in the last cycle.
    ReadAxes = "axes", Read, Empty => Axes;
    /// The active configuration.
    ReadConfig = "config", Read, Empty => ActiveConfig;
    /// Subscribes to frames.
    SubscribeFrames = "frames.subscribe", Read, Subscription => Empty;
    /// Ends the subscription to frames.
    UnsubscribeFrames = "frames.unsubscribe", Read, Empty => Empty;
    /// Subscribes to images.
    SubscribeImages = "images.subscribe", Read, ImageSubscription => Empty;
    /// Ends the subscription to images.
    UnsubscribeImages = "images.unsubscribe", Read, Empty => Empty;
    /// Counters of the service and its clients.
    ReadServiceStats = "service.stats", Read, Empty => ServiceStats;
    /// What happened to the bus and the service.
    ReadEvents = "events", Read, Empty => RecordedEvents;
    /// Sends an NMT command.
    SendNmt = "nmt", Control, NmtParams => Empty;
}

/// Largest object of a transfer, in bytes.
pub const MAX_SDO_BYTES: u32 = 16 << 10;

/// Parameters of `sdo.upload`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UploadParams {
    /// Position of the slave.
    pub slave: u16,
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// Largest length in bytes; default and maximum [`MAX_SDO_BYTES`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_bytes: Option<u32>,
    /// One attempt. By default a transfer without response is repeated for up to 5 s.
    #[serde(default)]
    pub once: bool,
}

impl UploadParams {
    /// Largest length of the object in bytes.
    ///
    /// # Errors
    /// `max_bytes` is out of range.
    pub fn checked_max_bytes(&self) -> Result<usize, RpcError> {
        let max_bytes = self.max_bytes.unwrap_or(MAX_SDO_BYTES);
        if !(1..=MAX_SDO_BYTES).contains(&max_bytes) {
            let text =
                format!("max_bytes {max_bytes} is out of range; allowed: 1 to {MAX_SDO_BYTES}");
            return Err(RpcError::new(INVALID_PARAMS, text));
        }
        Ok(max_bytes as usize)
    }
}

/// Result of `sdo.upload`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Upload {
    /// The object.
    #[serde(with = "hex::serde")]
    pub data: Vec<u8>,
}

impl DownloadParams {
    /// Checks length and subindex.
    ///
    /// # Errors
    /// The object is too long, or Complete Access does not begin at subindex 0.
    pub fn check(&self) -> Result<(), RpcError> {
        let (bytes, subindex) = (self.data.len(), self.subindex);
        if bytes > MAX_SDO_BYTES as usize {
            let text =
                format!("object of {bytes} bytes is too long; allowed: at most {MAX_SDO_BYTES}");
            return Err(RpcError::new(INVALID_PARAMS, text));
        }
        if self.complete && subindex != 0 {
            let text =
                format!("subindex {subindex} with complete access is out of range; allowed: 0");
            return Err(RpcError::new(INVALID_PARAMS, text));
        }
        Ok(())
    }
}

/// Parameters of `sdo.download`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DownloadParams {
    /// Position of the slave.
    pub slave: u16,
    /// Object index.
    pub index: u16,
    /// Object subindex; 0 with `complete`.
    pub subindex: u8,
    /// The object.
    #[serde(with = "hex::serde")]
    pub data: Vec<u8>,
    /// One attempt. By default a transfer without response is repeated for up to 5 s.
    #[serde(default)]
    pub once: bool,
    /// Complete Access from subindex 0, whose entry has 16 bits; always one attempt.
    #[serde(default)]
    pub complete: bool,
}

/// NMT command (CiA 301).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NmtCommand {
    /// To Operational.
    Start,
    /// To Stopped.
    Stop,
    /// To Pre-operational.
    EnterPreOperational,
    /// Restarts the application of the node.
    ResetNode,
    /// Restarts the communication of the node.
    ResetCommunication,
}

impl NmtCommand {
    /// Command specifier in the frame.
    pub const fn specifier(self) -> u8 {
        match self {
            Self::Start => 1,
            Self::Stop => 2,
            Self::EnterPreOperational => 128,
            Self::ResetNode => 129,
            Self::ResetCommunication => 130,
        }
    }
}

/// Parameters of `nmt`. The response reports that the frame is queued.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NmtParams {
    /// Index of the gateway.
    pub gateway: u16,
    /// Channel, 0 to 3.
    pub channel: u8,
    /// Node-ID, 1 to 127; 0 for all nodes.
    pub node: u8,
    /// Command.
    pub command: NmtCommand,
}

/// Number of events that a service keeps.
pub const MAX_EVENTS: usize = 100;

/// Result of `events`: the last [`MAX_EVENTS`] events, the oldest first.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct RecordedEvents {
    /// Earlier events, which are not kept.
    pub dropped: u64,
    /// The events.
    pub events: Vec<RecordedEvent>,
}

/// An event of the bus or of the service.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct RecordedEvent {
    /// Time, as in a frame record; up to 50 ms late.
    pub time_ns: u64,
    /// Kind.
    pub kind: RecordedKind,
    /// Index of the gateway; `None` if the event concerns the service.
    pub gateway: Option<u16>,
    /// Channel, 0 to 3, of a change of its condition.
    pub channel: Option<u8>,
    /// Duration of the outage that ended, in nanoseconds.
    pub duration_ns: Option<u64>,
    /// Text with the cause, as far as it is known.
    pub text: String,
}

/// Kind of a recorded event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RecordedKind {
    /// A gateway was lost.
    Lost,
    /// A lost gateway has waited for a cause for some seconds.
    Waits,
    /// The verification of a gateway failed.
    Failed,
    /// A gateway is ready.
    Ready,
    /// A gateway was lost and is ready again.
    Interrupted,
    /// The condition of a channel changed, for example to bus-off.
    Channel,
    /// Images or frames were lost.
    Losses,
    /// A client was rejected or disconnected, or lost frames.
    Client,
    /// A cycle began or ended.
    Cycle,
    /// The program that serves recorded it.
    Program,
    /// A kind of a later version.
    #[default]
    #[serde(other)]
    Other,
}

/// Kind of a frame event to subscribe to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// Received from the bus.
    Received,
    /// Sent with success.
    Transmitted,
    /// Sent, and failed.
    Failed,
    /// Sent to a gateway without transmit results.
    Published,
    /// Sent, without a result that is known.
    Unknown,
}

/// Filter for CAN IDs as in SocketCAN: `can_id & mask == id & mask`, with the format bits of
/// `linux/can.h`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IdFilter {
    /// CAN ID with its format bits.
    pub id: u32,
    /// Bits to compare.
    pub mask: u32,
}

/// Parameters of `frames.subscribe`; it replaces an earlier subscription. An empty list selects
/// everything. No entry is there twice. Records of a client's own frames need no subscription.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Subscription {
    /// Indices of gateways, 0 to 255.
    #[serde(deserialize_with = "read_list")]
    pub gateways: Vec<u16>,
    /// Channels, 0 to 3.
    #[serde(deserialize_with = "read_list")]
    pub channels: Vec<u8>,
    /// Kinds of events.
    #[serde(deserialize_with = "read_list")]
    pub kinds: Vec<EventKind>,
    /// Filters, at most [`MAX_FILTERS`](super::MAX_FILTERS); a frame that one of them accepts is selected.
    #[serde(deserialize_with = "read_list")]
    pub filters: Vec<IdFilter>,
}

impl Subscription {
    /// Returns whether the subscription selects a frame.
    pub fn selects(&self, gateway: u16, channel: u8, event: FrameEvent, frame: &CanFrame) -> bool {
        let kind = match event {
            FrameEvent::Received => EventKind::Received,
            FrameEvent::Transmitted => EventKind::Transmitted,
            FrameEvent::Failed(_) => EventKind::Failed,
            FrameEvent::Published => EventKind::Published,
            FrameEvent::Unknown => EventKind::Unknown,
            FrameEvent::Rejected(_) => return false,
        };
        let (can_id, _, _) = fields_of(frame);
        contains(&self.gateways, &gateway)
            && contains(&self.channels, &channel)
            && contains(&self.kinds, &kind)
            && (self.filters.is_empty()
                || self.filters.iter().any(|filter| (can_id ^ filter.id) & filter.mask == 0))
    }
}

fn contains<T: PartialEq>(list: &[T], item: &T) -> bool {
    list.is_empty() || list.contains(item)
}

/// Direction of images to subscribe to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImageDirection {
    /// From the gateway: TxPDO.
    Received,
    /// To the gateway: RxPDO.
    Published,
}

/// Parameters of `images.subscribe`; an empty list selects everything.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImageSubscription {
    /// Indices of gateways, 0 to 255.
    #[serde(deserialize_with = "read_list")]
    pub gateways: Vec<u16>,
    /// Directions.
    #[serde(deserialize_with = "read_list")]
    pub directions: Vec<ImageDirection>,
}

impl ImageSubscription {
    /// Returns whether the subscription selects an image.
    pub fn selects(&self, gateway: u16, direction: ImageDirection) -> bool {
        contains(&self.gateways, &gateway) && contains(&self.directions, &direction)
    }
}

/// Most filters of a subscription.
pub const MAX_FILTERS: usize = 256;
/// Most gateways of a subscription, and the first index that is out of range.
pub const MAX_GATEWAYS: usize = 256;

/// Entry of a list. A list has at most [`MAX`](Self::MAX) different ones.
pub(crate) trait Entry: Debug + PartialEq {
    const LIST: &'static str;
    const MAX: usize;

    fn is_in_range(&self) -> bool {
        true
    }
}

/// Index of a gateway.
impl Entry for u16 {
    const LIST: &'static str = "gateways";
    const MAX: usize = MAX_GATEWAYS;

    fn is_in_range(&self) -> bool {
        usize::from(*self) < MAX_GATEWAYS
    }
}

/// Channel of a gateway.
impl Entry for u8 {
    const LIST: &'static str = "channels";
    const MAX: usize = CHANNELS;

    fn is_in_range(&self) -> bool {
        usize::from(*self) < CHANNELS
    }
}

impl Entry for EventKind {
    const LIST: &'static str = "kinds";
    const MAX: usize = 5;
}

impl Entry for IdFilter {
    const LIST: &'static str = "filters";
    const MAX: usize = MAX_FILTERS;
}

impl Entry for ImageDirection {
    const LIST: &'static str = "directions";
    const MAX: usize = 2;
}

/// Reads a list of different entries in their range.
pub(crate) fn read_list<'de, D, T>(from: D) -> Result<Vec<T>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de> + Entry,
{
    from.deserialize_seq(ListVisitor(PhantomData))
}

struct ListVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de> + Entry> Visitor<'de> for ListVisitor<T> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a list of {} with at most {} entries", T::LIST, T::MAX)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<Vec<T>, A::Error> {
        let mut list = Vec::new();
        while let Some(entry) = entries.next_element::<T>()? {
            if !entry.is_in_range() {
                return Err(A::Error::custom(format_args!(
                    "{}: {entry:?} is out of range; allowed: 0 to {}",
                    T::LIST,
                    T::MAX - 1
                )));
            }
            if list.contains(&entry) {
                return Err(A::Error::custom(format_args!(
                    "{}: {entry:?} is in the list twice; allowed: each entry once",
                    T::LIST
                )));
            }
            if list.len() == T::MAX {
                return Err(A::Error::custom(format_args!(
                    "{}: more than {} entries; allowed: at most {}",
                    T::LIST,
                    T::MAX,
                    T::MAX
                )));
            }
            list.push(entry);
        }
        Ok(list)
    }
}
