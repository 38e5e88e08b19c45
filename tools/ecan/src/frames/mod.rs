//! A running gateway, for the frame commands.

mod arrival;
mod bit_rates;
mod capture;
mod channels;
mod format;
mod options;
mod prepared;
mod printer;
pub mod recording;
mod sender;
mod service;
mod settings;
mod single_gateway;
mod status_watch;
mod summary;
mod timestamp;
mod transmit_tracker;

pub use channels::{ChannelArgument, Channels, names_channel, parse_channel};
pub use format::{Screen, TimedFrame};
pub use options::{FrameOptions, GatewayOptions, SetupOptions, WATCHDOG};
pub use prepared::Prepared;
pub use printer::{Destination, Printer};
pub use sender::{Due, Record, Sender};
pub use service::{Service, failure};
pub use settings::{GatewayRequirements, Planned, Settings};
pub use single_gateway::{channel_status, session};
pub use timestamp::Style;
pub use transmit_tracker::TransmitTracker;
