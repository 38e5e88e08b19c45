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
mod config;
mod config_check;
mod cycle;
mod error;
mod gateway;
mod measured_on;
mod plan;
mod port;
mod port_config;
mod receive;
mod schedule;
mod session;
mod sharing;
mod snapshot;
mod statistics;
mod transmit;
mod wait;

pub use address::{AddressError, ChannelHandle, GatewayHandle};
pub use config::Config;
pub use config_check::PortConfigFault;
pub use cycle::{Cycle, CycleSummary, MAX_FAILED_CYCLES};
pub use error::PortError;
pub use measured_on::MeasuredOn;
pub use plan::{
    ChannelLoad, ChannelPlan, CpuCost, Elements, FrameRate, FrameRoute, FrameStream, GatewayPlan,
    ImageFill, ImagePlan, PortPlan, PortPlanError, PortWarning, SettingWarning,
};
pub use port::Port;
pub use port_config::{
    AcceptanceFilter, ChannelConfig, ChannelFilter, GatewayConfig, MAX_FILTERS, MAX_GATEWAYS,
    PortConfig, Traffic,
};
pub use receive::items::ReceivedItems;
pub use receive::received::{ReceiveSource, Received, ReceivedFrame, ReceivedView, TransmitReport};
pub use receive::report::{CycleReport, ImageReport};
pub use schedule::account::ScheduleAccount;
pub use schedule::config::{MarginCheck, ScheduleConfig};
pub use schedule::diagnostics::{ChannelDrops, ScheduleDiagnostics};
pub use schedule::fault::ScheduleFault;
pub use schedule::margin::{NotSchedulable, RECOMMENDED_OFFSET_NS, ScheduleMargin, THIN_MARGIN_NS};
pub use session::machine::Session;
pub use session::pending_step::PendingStep;
pub use session::verification::{SdoTransfer, VerificationFault};
pub use sharing::image_stream::{ImageEvent, ImageRecord, ImageStream, QueuedFrames};
pub use sharing::transmit_queue::{QueueError, TransmitQueues};
pub use snapshot::{PortSnapshot, SessionState};
pub use statistics::{ChannelStatistics, SlaveStatistics};
pub use transmit::error::{Backpressure, OkOrTemporary, SendError};
pub use transmit::options::{SendOptions, SendTicket, TransmitFrame, TransmitHint};
pub use transmit::send::Batch;
