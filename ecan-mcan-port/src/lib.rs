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
#![forbid(unsafe_code)]

mod address;
mod config;
mod config_check;
mod cycle;
mod error;
mod gateway;
mod phase_sweep;
mod phase_table;
mod plan;
mod port;
mod port_config;
mod received;
mod received_items;
mod receiver;
mod report;
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

pub use address::{AddressError, ChannelHandle, GatewayHandle};
pub use config::Config;
pub use config_check::PortConfigFault;
pub use cycle::{Cycle, CycleSummary, MAX_FAILED_CYCLES};
pub use error::PortError;
pub use phase_sweep::{PhaseSweep, PhaseSweepFault};
pub use phase_table::{PhaseMargins, PhasePoint, PhaseTable};
pub use plan::{
    ChannelLoad, ChannelPlan, CpuCost, FrameRate, FrameRoute, FrameStream, GatewayPlan, ImageFill,
    ImagePlan, PortPlan, PortPlanError, PortWarning,
};
pub use port::Port;
pub use port_config::{
    AcceptanceFilter, ChannelConfig, ChannelFilter, GatewayConfig, MAX_FILTERS, MAX_GATEWAYS,
    PortConfig, Traffic,
};
pub use received::{ReceiveSource, Received, ReceivedFrame, ReceivedView, TransmitReport};
pub use received_items::ReceivedItems;
pub use report::{CycleReport, ImageReport};
pub use schedule_account::ScheduleAccount;
pub use schedule_margin::{NotSchedulable, RECOMMENDED_OFFSET_NS, ScheduleMargin};
pub use schedule_settings::{MarginCheck, ScheduleConfig};
pub use schedule_watch::{ChannelDrops, ScheduleDiagnostics};
pub use send::{
    Backpressure, Batch, OkOrTemporary, SendError, SendOptions, SendTicket, TransmitFrame,
    TransmitHint,
};
pub use session::{PendingStep, Session};
pub use statistics::{ChannelStatistics, SlaveStatistics};
pub use verification::{SdoTransfer, VerificationFault};
