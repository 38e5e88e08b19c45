//! Access of a frame command to the gateways.

use std::fmt;

use ecan_host::AdapterConfig;
use ecan_mcan_port::{GatewayCondition, PortConfig, SendTicket, SlaveStatistics};
use ecan_protocol::can::CanFrame;
use ecan_protocol::image::{ChannelStatus, ResultCode, Timestamp};
use ecan_protocol::mapping::Direction;
use ecan_service::protocol::RejectReason;

use crate::context::Result;

/// Identifies a sent frame; its transmit result has the same ticket.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Ticket(u64);

impl Ticket {
    /// Ticket of a frame that was sent through a service.
    pub fn of_service(tag: u32) -> Self {
        Self(tag.into())
    }
}

impl From<SendTicket> for Ticket {
    fn from(SendTicket { slave, sequence, index }: SendTicket) -> Self {
        Self((slave as u64) << 32 | u64::from(sequence) << 8 | u64::from(index))
    }
}

/// Result of a frame that was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Result of the gateway.
    Result(ResultCode),
    /// A service reports success, or the gateway reports no results.
    Sent,
    /// The result is not known and will not be.
    Unknown,
    /// A service did not send the frame.
    Rejected(RejectReason),
}

impl Outcome {
    pub fn is_success(self) -> bool {
        match self {
            Self::Result(code) => code.is_success(),
            Self::Sent => true,
            Self::Unknown | Self::Rejected(_) => false,
        }
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Result(code) => code.fmt(f),
            Self::Sent => f.write_str("sent"),
            Self::Unknown => f.write_str("transmit result not known; the frame may have been sent"),
            Self::Rejected(reason) => reason.fmt(f),
        }
    }
}

/// A CAN frame of a bus. A gateway is its index in the command.
#[derive(Clone, Copy, Debug)]
pub struct BusFrame {
    pub gateway: usize,
    pub channel: u8,
    pub frame: CanFrame,
    /// Time stamp of the gateway.
    pub timestamp: Timestamp,
    /// Sent by a program on this bus; false for a received frame.
    pub is_sent: bool,
}

#[derive(Clone, Copy, Debug)]
pub enum Event {
    /// Received, or sent by another program.
    Frame(BusFrame),
    Result {
        /// `None` for a frame of another program.
        ticket: Option<Ticket>,
        outcome: Outcome,
    },
}

#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Time of the cycle clock in nanoseconds.
    pub time_ns: u64,
    pub event: Event,
}

/// Gateways with a running cycle, of this program or of the program that holds the master.
///
/// A program without a service runs the cycle itself, and no server in its own process. Measured with 10,000
/// frames at 1 ms on the simulator: the transmit result and the echo of a frame arrive 2 and 3 cycles later,
/// always. On two busy cores, through a server on another thread they arrive 3 and 4 cycles later in the median and up to 32 and
/// 34 later, and in stepped time, where the cycle does not wait for the server, 76 later in the median. The
/// protocol also has neither the time stamps of a gateway nor the cause of a failed verification.
pub trait FrameLink: fmt::Debug {
    fn adapter_config(&self) -> &AdapterConfig;

    fn port_config(&self) -> &PortConfig;

    /// Time of the cycle clock in nanoseconds.
    fn now_ns(&self) -> u64;

    /// Offset from the cycle clock to the time since 1970; 0 for stepped time.
    fn since_1970_ns(&self) -> u64;

    fn is_real_time(&self) -> bool;

    /// Cycles since the start whose frames this program has read, for a cycle of another program.
    fn cycles(&self) -> Option<u64> {
        None
    }

    /// Waits for a cycle and appends what arrived. Returns the start of the cycle.
    fn begin(&mut self, arrivals: &mut Vec<Arrival>) -> u64;

    /// Sends a frame; `None` without space in this cycle.
    fn send(&mut self, gateway: usize, channel: u8, frame: &CanFrame) -> Result<Option<Ticket>>;

    /// Ends the cycle.
    fn end(&mut self) -> Result;

    /// A gateway in this cycle, with its counters since the start of the command.
    fn condition(&self, gateway: usize) -> GatewayCondition;

    fn statistics(&self, gateway: usize) -> SlaveStatistics {
        self.condition(gateway).statistics
    }

    /// "Disabled" for a channel that is not enabled.
    fn channel_status(&self, gateway: usize, channel: u8) -> ChannelStatus {
        let status = self.condition(gateway).channels.get(usize::from(channel)).copied();
        status.flatten().unwrap_or_default()
    }

    /// Passes the images of this cycle: gateway, time, image.
    fn images(&self, direction: Direction, visit: &mut dyn FnMut(usize, u64, &[u8]));

    /// Uploads an object of at most 4 bytes in parallel with the cycle.
    fn upload(&mut self, gateway: usize, index: u16, subindex: u8) -> Result<u32>;
}
