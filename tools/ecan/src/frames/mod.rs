//! A running gateway, for the frame commands.

mod capture;
mod channels;
mod link;
mod options;
mod port_link;
mod prepared;
mod printer;
mod sender;
mod service;
mod service_link;
mod settings;
pub mod signals;

pub use channels::{
    ChannelArgument, Channels, Recorded, RecordedLog, can_config, names_channel, parse_channel,
    read_recording,
};
pub use link::{BusFrame, Event, FrameLink, Outcome, Ticket};
pub use options::{FrameOptions, GatewayOptions, SetupOptions, WATCHDOG};
pub use port_link::wait_ready;
pub use prepared::Prepared;
pub use printer::{Destination, Printer, Screen, Style, TimedFrame};
pub use sender::{Due, Record, Sender, TransmitTracker};
pub use service::{LOSS_INTERVAL, Service, ServiceEvents, failure};
pub use service_link::ServiceLink;
pub use settings::{
    GatewayRequirements, Planned, ServiceSetup, Settings, gateways_of_service, of_file_offline,
    of_service, of_whole_file,
};
pub use signals::{DbcOption, Signals};
