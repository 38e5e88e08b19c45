//! Events of a connection.

use crate::protocol::{FrameReport, GatewaysChanged, ImageMessage};
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;
use serde_json::Value;

/// Event from the service.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// A frame: of the subscription, or a result of this client's own frames.
    Frame(FrameReport),
    /// A PDO image of the subscription.
    Image(ReceivedImage),
    /// Data that this client lost at this point: it read too slowly.
    Lost(Lost),
    /// The bus was configured again.
    Gateways(GatewaysChanged),
    /// Another notification.
    Notification {
        /// Its name.
        method: String,
        /// Its parameters.
        params: Value,
    },
}

/// Numbers of lost frames and images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Lost {
    /// Frames that the service could not deliver.
    pub frames: u64,
    /// Images that the service could not deliver.
    pub images: u64,
    /// Frames that found the buffer of this client full, during a request.
    pub frames_in_client: u64,
    /// Images that found the buffer of this client full, during a request.
    pub images_in_client: u64,
}

impl Lost {
    pub(crate) fn add(&mut self, other: Self) {
        self.frames += other.frames;
        self.images += other.images;
        self.frames_in_client += other.frames_in_client;
        self.images_in_client += other.images_in_client;
    }
}

/// A PDO image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReceivedImage {
    /// Start of the cycle, as in a frame.
    pub time_ns: u64,
    /// Number of the cycle.
    pub cycle: u64,
    /// Index of the gateway.
    pub gateway: u16,
    /// Direction.
    pub direction: Direction,
    /// Profile of the image.
    pub profile: PdoProfile,
    /// The image.
    pub image: Box<[u8]>,
}

impl From<ImageMessage<'_>> for ReceivedImage {
    fn from(message: ImageMessage<'_>) -> Self {
        let ImageMessage { time_ns, cycle, gateway, direction, profile, image, .. } = message;
        Self { time_ns, cycle, gateway, direction, profile, image: image.into() }
    }
}
