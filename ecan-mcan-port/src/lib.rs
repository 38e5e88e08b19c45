//! The MCAN Port: CAN and CAN FD frames through ECAN-Lite gateways (manual 15.1, 15.4, 15.5).
//!
//! A [`Port`] works on an [`Adapter`](ecan_host::Adapter). It configures the PDO profiles and CAN
//! channels of the gateways, and converts between frames and PDO images in every [`Cycle`]:
//!
//! ```text
//! let can0 = port.channel(0, 0)?;          checks the address once
//! let mut cycle = port.next_cycle();       waits, receives, checks the images
//! for received in cycle.received() { .. }  CAN frames and transmit results
//! cycle.send(can0, &frame)?;               directly into the PDO image
//! cycle.end()?;                            padding, CRC, header, sequence; queue and send
//! ```
//!
//! [`PortPlan`] calculates offline what a configuration costs for a given traffic.
//!
//! In a cycle nothing allocates, locks or panics.
#![deny(missing_docs)]
#![deny(clippy::print_stdout, clippy::print_stderr)]
#![forbid(unsafe_code)]

mod address;
mod al_watch;
mod bus_watch;
mod config;
mod config_check;
mod cycle;
mod cycle_state;
mod error;
mod gateway;
mod image_stream;
mod plan;
mod port;
mod received;
mod receiver;
mod schedule;
mod session;
mod snapshot;
mod statistics;
mod transmit;
mod transmit_queue;
mod wait;
mod word_ring;

pub use address::{AddressError, ChannelHandle, GatewayHandle};
pub use bus_watch::{
    BusChange, BusEvent, BusWatch, ChannelChange, GatewayCondition, GatewayWatch, ImageLoss,
    ImageLossWatch, LASTING_CAUSE, LossWatch, NotDelivered, check_delivery,
};
pub use config::{
    AcceptanceFilter, ChannelConfig, ChannelFilter, Config, GatewayConfig, MAX_FILTERS,
    MAX_GATEWAYS, MarginCheck, MeasuredOn, PortConfig, ScheduleConfig, Traffic,
};
pub use config_check::PortConfigFault;
pub use cycle::{Cycle, MAX_FAILED_CYCLES};
pub use cycle_state::CycleSummary;
pub use error::PortError;
pub use image_stream::{ImageEvent, ImageRecord, ImageStream, QueuedFrames};
pub use plan::finding::{Elements, PortPlanError, PortWarning, SettingWarning};
pub use plan::image::{CpuCost, ImageFill, ImagePlan};
pub use plan::load::{ChannelLoad, FrameRate, FrameRoute, FrameStream};
pub use plan::{ChannelPlan, GatewayPlan, PortPlan};
pub use port::Port;
pub use received::{
    ReceiveSource, Received, ReceivedFrame, ReceivedItems, ReceivedView, TransmitReport,
};
pub use receiver::{CycleReport, ImageReport};
pub use schedule::account::{ScheduleAccount, ScheduleFault};
pub use schedule::diagnostics::{ChannelDrops, ScheduleDiagnostics};
pub use schedule::margin::{NotSchedulable, RECOMMENDED_OFFSET_NS, ScheduleMargin, THIN_MARGIN_NS};
pub use session::machine::Session;
pub use session::verification::{PendingStep, SdoTransfer, VerificationFault};
pub use snapshot::{PortSnapshot, SessionState};
pub use statistics::{ChannelStatistics, Counter, SlaveStatistics};
pub use transmit::options::{
    Backpressure, OkOrTemporary, SendError, SendOptions, SendTicket, TransmitFrame, TransmitHint,
};
pub use transmit::send::Batch;
pub use transmit_queue::{QueueError, TransmitQueues};
