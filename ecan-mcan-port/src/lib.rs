//! The MCAN Port: CAN and CAN FD frames through ECAN-Lite gateways (manual 15.1, 15.4, 15.5).
//!
//! A [`Port`] sits on an [`Adapter`](ecan_host::Adapter). It configures the gateways' PDO profiles
//! and CAN channels, and in every cycle turns frames into process images and back:
//!
//! ```text
//! port.cycle_begin()            what came back: images checked once, losses counted
//! port.receive(&mut frames)     CAN frames and transmit results
//! port.send_can(..)             straight into the RxPDO part of the domain memory
//! port.cycle_end()              padding, CRC, header, sequence last; queue and send
//! ```
//!
//! [`PortPlan`] tells beforehand what a configuration costs for a given traffic.
//!
//! Between `cycle_begin` and `cycle_end` nothing allocates, locks or panics.
#![deny(missing_docs)]
#![forbid(unsafe_code)]

mod batch;
mod config;
mod config_check;
mod cycle;
mod error;
mod phase_sweep;
mod phase_table;
mod plan;
mod port;
mod received;
mod receiver;
mod schedule_account;
mod schedule_margin;
mod schedule_settings;
mod schedule_watch;
mod send;
mod session;
mod startup;
mod statistics;
mod sync0_phase;
mod transmit_history;
mod transmit_window;
mod transmitter;
mod verification;
mod wait;

pub use batch::{Batch, Exchange};
pub use config::{ChannelConfig, GatewayConfig, PortConfig, Traffic};
pub use config_check::PortConfigFault;
pub use cycle::{CycleReport, ImageReport};
pub use error::PortError;
pub use phase_sweep::{PhaseSweep, PhaseSweepFault};
pub use phase_table::{PhaseMargins, PhasePoint, PhaseTable};
pub use plan::{
    ChannelLoad, ChannelPlan, CpuCost, FrameRate, FrameRoute, FrameStream, GatewayPlan, ImageFill,
    ImagePlan, PortPlan, PortPlanError, PortWarning,
};
pub use port::Port;
pub use received::{ReceiveSource, Received, ReceivedFrame, ReceivedView, TransmitReport};
pub use schedule_account::ScheduleAccount;
pub use schedule_margin::{RECOMMENDED_OFFSET_NS, ScheduleMargin};
pub use schedule_settings::{MarginCheck, ScheduleConfig};
pub use schedule_watch::{ChannelDrops, ScheduleDiagnostics};
pub use send::{
    Backpressure, NotSchedulable, SendError, SendOptions, SendTicket, TransmitFrame, TransmitHint,
};
pub use session::{PendingStep, Session};
pub use statistics::{ChannelStatistics, SlaveStatistics};
pub use verification::{SdoTransfer, VerificationFault};
