//! A running gateway, for the frame commands.

mod bit_rates;
mod capture;
mod channels;
mod format;
mod link;
mod options;
mod port_link;
mod prepared;
mod printer;
pub mod recording;
mod sender;
mod service;
mod service_link;
mod service_setup;
mod settings;
pub mod signals;
mod status_watch;
mod summary;
mod timestamp;
mod transmit_tracker;

pub use channels::{ChannelArgument, Channels, can_config, names_channel, parse_channel};
pub use format::{Screen, TimedFrame};
pub use link::{BusFrame, Event, FrameLink, Outcome, SessionState, Ticket};
pub use options::{FrameOptions, GatewayOptions, SetupOptions, WATCHDOG};
pub use prepared::Prepared;
pub use printer::{Destination, Printer};
pub use sender::{Due, Record, Sender};
pub use service::{Service, failure};
pub use service_link::ServiceLink;
pub use service_setup::{ServiceSetup, gateways_of_service, of_service};
pub use settings::{GatewayRequirements, Planned, Settings, of_file_offline, of_whole_file};
pub use signals::{DbcOption, Signals};
pub use status_watch::Losses;
pub use timestamp::Style;
pub use transmit_tracker::TransmitTracker;
