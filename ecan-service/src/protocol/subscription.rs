//! Subscriptions to frames and images.

use serde::{Deserialize, Serialize};

use ecan_protocol::can::CanFrame;

use crate::protocol::frame_record::FrameEvent;
use crate::protocol::parameter_list::read_list;
use crate::protocol::wire_frame::fields_of;

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
    /// Filters, at most [`MAX_FILTERS`](crate::protocol::MAX_FILTERS); a frame that one of them accepts is selected.
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
