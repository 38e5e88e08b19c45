//! The LSS master of one channel (CiA 305).

use std::fmt;
use std::time::Duration;

use ecan_mcan_port::SendError;
use thiserror::Error;

use super::producers::nanoseconds;
use crate::{
    Fastscan, FastscanFilter, FastscanStep, LssAddress, LssAddressRange, LssBitRate,
    LssConfirmation, LssPart, LssRequest, LssResponse, NodeId, RangePart, UNCONFIGURED_NODE_ID,
};

/// Waiting times of the LSS master.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LssConfig {
    /// Longest time for a response, and the whole waiting time of a search by range.
    pub timeout: Duration,
    /// Longest time for the response to [`LssCommand::Store`].
    pub store_timeout: Duration,
    /// Waiting time of each request of a fastscan. All slaves must respond within it: a response that is later
    /// counts for the next bit.
    pub scan_time: Duration,
}

impl Default for LssConfig {
    /// 500 ms, 5 s, 25 ms.
    fn default() -> Self {
        Self {
            timeout: Duration::from_millis(500),
            store_timeout: Duration::from_millis(5_000),
            scan_time: Duration::from_millis(25),
        }
    }
}

/// State of an LSS master.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Lss {
    /// No command was started yet.
    #[default]
    Idle,
    /// A command is running.
    Busy,
    /// The last command succeeded.
    Done(LssResult),
    /// The last command failed.
    Failed(LssFault),
}

impl fmt::Display for Lss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Idle => f.write_str("idle"),
            Self::Busy => f.write_str("busy"),
            Self::Done(LssResult::Done) => f.write_str("done"),
            Self::Done(LssResult::Address(address)) => address.fmt(f),
            Self::Done(LssResult::NodeId(Some(node))) => write!(f, "node-ID {node}"),
            Self::Done(LssResult::NodeId(None)) => f.write_str("no node-ID"),
            Self::Done(LssResult::Found) => f.write_str("found"),
            Self::Done(LssResult::NotFound) => f.write_str("not found"),
            Self::Failed(fault) => write!(f, "failed: {fault}"),
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Running {
    /// Frames of the command that were sent.
    sent: usize,
    /// End of the waiting time of the last frame; `None` while a frame is to be sent.
    deadline_ns: Option<u64>,
    /// Start of the waiting time.
    since_ns: u64,
    /// A slave responded to a search.
    has_response: bool,
    address: LssAddress,
    scan: Fastscan,
}

/// LSS master of one channel (CiA 305), without a bus: its owner transports its frames.
///
/// ```text
/// start      begins a command
/// frame      the frame to send next, if any
/// sent       it was sent: the time for the response runs
/// receive    a slave sent a frame
/// tick       time passed
/// state      result
/// ```
///
/// A command is not repeated: whether a slave has executed it before its response was lost is unknown.
/// Responses that fit no request are ignored and counted. Real-time safe; it allocates no memory.
#[derive(Debug)]
pub struct LssMaster {
    config: LssConfig,
    command: LssCommand,
    running: Option<Running>,
    outcome: Lss,
    strays: u64,
}

impl LssMaster {
    /// Creates a master without a command.
    pub const fn new(config: LssConfig) -> Self {
        let command = LssCommand::SwitchGlobal { configuration: false };
        Self { config, command, running: None, outcome: Lss::Idle, strays: 0 }
    }

    /// Changes the waiting times, from the next frame on.
    pub const fn set_config(&mut self, config: LssConfig) {
        self.config = config;
    }

    /// Starts a command. Returns `false` if another one is running.
    pub fn start(&mut self, command: LssCommand) -> bool {
        if self.running.is_some() {
            return false;
        }
        let filter = match command {
            LssCommand::Fastscan(filter) => filter,
            _ => FastscanFilter::default(),
        };
        self.command = command;
        self.running = Some(Running {
            sent: 0,
            deadline_ns: None,
            since_ns: 0,
            has_response: false,
            address: LssAddress::default(),
            scan: Fastscan::new(filter),
        });
        true
    }

    /// State of the last command.
    pub const fn state(&self) -> Lss {
        if self.running.is_some() { Lss::Busy } else { self.outcome }
    }

    /// The last command.
    pub const fn command(&self) -> LssCommand {
        self.command
    }

    /// Responses that fitted no request.
    pub const fn strays(&self) -> u64 {
        self.strays
    }

    /// Ends the running command.
    pub fn cancel(&mut self, fault: LssFault) {
        if self.running.is_some() {
            self.end(Lss::Failed(fault));
        }
    }

    /// The frame to send next; `None` while a response is due, and without a command. The call changes nothing.
    pub fn frame(&self) -> Option<[u8; 8]> {
        let running = self.running.as_ref()?;
        if running.deadline_ns.is_some() {
            return None;
        }
        let request = match self.command {
            LssCommand::Fastscan(_) => running.scan.request(),
            command => command.request(running.sent)?,
        };
        Some(request.to_bytes())
    }

    /// Takes note that the frame of [`frame`](Self::frame) was sent.
    pub fn sent(&mut self, now_ns: u64) {
        let (command, config) = (self.command, self.config);
        let Some(running) = &mut self.running else { return };
        running.sent += 1;
        let is_last = running.sent >= command.frames();
        let wait = match command {
            LssCommand::SwitchGlobal { .. } => return self.succeed(LssResult::Done),
            LssCommand::SwitchSelective(_) | LssCommand::Identify(_) if !is_last => return,
            LssCommand::ActivateBitRate { delay_ms } => Duration::from_millis(delay_ms.into()) * 2,
            LssCommand::Fastscan(_) => config.scan_time,
            LssCommand::Store => config.store_timeout,
            _ => config.timeout,
        };
        running.has_response = false;
        running.since_ns = now_ns;
        running.deadline_ns = Some(now_ns.saturating_add(nanoseconds(wait)));
    }

    /// Processes the data of a frame of a slave, CAN ID 0x7E4.
    pub fn receive(&mut self, data: &[u8]) {
        let response = LssResponse::parse(data);
        let Some(running) = &mut self.running else { return self.stray() };
        if running.deadline_ns.is_none() {
            return self.stray();
        }
        match (self.command, response) {
            (LssCommand::SwitchSelective(_), Some(LssResponse::Selected)) => {
                self.succeed(LssResult::Done);
            }
            (LssCommand::ConfigureNodeId(node), Some(LssResponse::NodeIdConfigured(result))) => {
                self.confirm(result, |error| {
                    (error == 1).then_some(LssFault::NodeIdRejected { node })
                });
            }
            (
                LssCommand::ConfigureBitRate(bit_rate),
                Some(LssResponse::BitTimingConfigured(result)),
            ) => self.confirm(result, |error| {
                (error == 1).then_some(LssFault::BitRateRejected { bit_rate })
            }),
            (LssCommand::Store, Some(LssResponse::Stored(result))) => {
                self.confirm(result, |error| match error {
                    1 => Some(LssFault::StoreNotSupported),
                    2 => Some(LssFault::StoreFailed),
                    _ => None,
                });
            }
            (LssCommand::InquireNodeId, Some(LssResponse::NodeId { node })) => {
                match (NodeId::from_raw(node), node) {
                    (None, UNCONFIGURED_NODE_ID) => self.succeed(LssResult::NodeId(None)),
                    (None, _) => self.end(Lss::Failed(LssFault::InvalidNodeId { node })),
                    (node, _) => self.succeed(LssResult::NodeId(node)),
                }
            }
            (LssCommand::InquireAddress, Some(LssResponse::Address { part, value }))
                if running.sent == usize::from(part.raw()) + 1 =>
            {
                running.address.set_part(part, value);
                running.deadline_ns = None;
                if part == LssPart::Serial {
                    let address = running.address;
                    self.succeed(LssResult::Address(address));
                }
            }
            (LssCommand::Identify(_) | LssCommand::Fastscan(_), Some(LssResponse::Identified))
            | (LssCommand::IdentifyNonConfigured, Some(LssResponse::NonConfigured)) => {
                running.has_response = true;
            }
            _ => self.stray(),
        }
    }

    /// Checks the waiting time.
    pub fn tick(&mut self, now_ns: u64) {
        let Some(running) = &mut self.running else { return };
        if running.deadline_ns.is_none_or(|deadline| now_ns <= deadline) {
            return;
        }
        let waited = Duration::from_nanos(now_ns.saturating_sub(running.since_ns));
        let has_response = running.has_response;
        match self.command {
            LssCommand::ActivateBitRate { .. } => self.succeed(LssResult::Done),
            LssCommand::Identify(_) | LssCommand::IdentifyNonConfigured => {
                self.succeed(if has_response { LssResult::Found } else { LssResult::NotFound });
            }
            LssCommand::Fastscan(_) => {
                running.deadline_ns = None;
                match running.scan.advance(has_response) {
                    FastscanStep::Continue => {}
                    FastscanStep::Found(address) => self.succeed(LssResult::Address(address)),
                    FastscanStep::NotFound => self.succeed(LssResult::NotFound),
                    FastscanStep::Inconsistent { part } => {
                        self.end(Lss::Failed(LssFault::Inconsistent { part }));
                    }
                }
            }
            LssCommand::SwitchSelective(_) => {
                self.end(Lss::Failed(LssFault::NotSelected { waited }));
            }
            _ => self.end(Lss::Failed(LssFault::TimedOut { waited })),
        }
    }

    fn confirm(&mut self, result: LssConfirmation, fault: impl FnOnce(u8) -> Option<LssFault>) {
        let LssConfirmation { error, specific } = result;
        self.end(match error {
            0 => Lss::Done(LssResult::Done),
            LssConfirmation::MANUFACTURER => Lss::Failed(LssFault::Manufacturer { code: specific }),
            code => Lss::Failed(fault(code).unwrap_or(LssFault::Undefined { code })),
        });
    }

    fn succeed(&mut self, result: LssResult) {
        self.end(Lss::Done(result));
    }

    fn end(&mut self, outcome: Lss) {
        self.running = None;
        self.outcome = outcome;
    }

    const fn stray(&mut self) {
        self.strays += 1;
    }
}

/// Command of the LSS master. The services that configure or read a slave need it in the configuration state,
/// and no other slave with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LssCommand {
    /// Switches all slaves to the configuration state or the waiting state. No slave responds. A slave without
    /// node-ID that got one boots when it returns to the waiting state.
    SwitchGlobal {
        /// True for the configuration state.
        configuration: bool,
    },
    /// Switches the slave with this address to the configuration state.
    SwitchSelective(LssAddress),
    /// Configures the node-ID; `None` removes it. A slave that has one uses the new one after the NMT command
    /// "reset communication".
    ConfigureNodeId(Option<NodeId>),
    /// Configures the bit rate, which [`ActivateBitRate`](Self::ActivateBitRate) activates.
    ConfigureBitRate(LssBitRate),
    /// Activates the configured bit rates of all slaves in the configuration state. The slaves do not respond:
    /// they switch after the delay and are silent for the same time again. The command ends after both; the
    /// gateway's channel needs the new bit rate then.
    ActivateBitRate {
        /// Delay in milliseconds.
        delay_ms: u16,
    },
    /// Stores node-ID and bit rate in the slave.
    Store,
    /// Reads the address.
    InquireAddress,
    /// Reads the node-ID.
    InquireNodeId,
    /// Searches slaves in a range of addresses.
    Identify(LssAddressRange),
    /// Searches slaves without node-ID.
    IdentifyNonConfigured,
    /// Searches the lowest address among the slaves without node-ID, and switches that slave to the configuration
    /// state.
    Fastscan(FastscanFilter),
}

/// Result of an [`LssCommand`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LssResult {
    /// The command was sent, or the slave confirmed it.
    Done,
    /// Address, of [`LssCommand::InquireAddress`] and [`LssCommand::Fastscan`].
    Address(LssAddress),
    /// Node-ID, of [`LssCommand::InquireNodeId`]; `None` if the slave has none.
    NodeId(Option<NodeId>),
    /// At least one slave responded to a search.
    Found,
    /// No slave responded to a search.
    NotFound,
}

const ADDRESS: [LssPart; 4] =
    [LssPart::Vendor, LssPart::Product, LssPart::Revision, LssPart::Serial];

impl LssCommand {
    /// Number of frames; a fastscan counts as one.
    const fn frames(&self) -> usize {
        match self {
            Self::SwitchSelective(_) | Self::InquireAddress => ADDRESS.len(),
            Self::Identify(_) => RangePart::ALL.len(),
            _ => 1,
        }
    }

    /// Frame number `nth` of the command; `None` of a fastscan and after the last one.
    fn request(&self, nth: usize) -> Option<LssRequest> {
        let part = || ADDRESS.get(nth).copied();
        Some(match *self {
            Self::SwitchGlobal { configuration } => LssRequest::SwitchGlobal { configuration },
            Self::SwitchSelective(address) => {
                let part = part()?;
                LssRequest::SwitchSelective { part, value: address.part(part) }
            }
            Self::ConfigureNodeId(node) => LssRequest::node_id(node),
            Self::ConfigureBitRate(bit_rate) => LssRequest::bit_rate(bit_rate),
            Self::ActivateBitRate { delay_ms } => LssRequest::ActivateBitTiming { delay_ms },
            Self::Store => LssRequest::Store,
            Self::InquireAddress => LssRequest::Inquire(part()?),
            Self::InquireNodeId => LssRequest::InquireNodeId,
            Self::Identify(range) => {
                let part = *RangePart::ALL.get(nth)?;
                LssRequest::IdentifyRemote { part, value: range_value(&range, part) }
            }
            Self::IdentifyNonConfigured => LssRequest::IdentifyNonConfigured,
            Self::Fastscan(_) => return None,
        })
    }
}

const fn range_value(range: &LssAddressRange, part: RangePart) -> u32 {
    match part {
        RangePart::Vendor => range.vendor,
        RangePart::Product => range.product,
        RangePart::RevisionLow => range.revision.0,
        RangePart::RevisionHigh => range.revision.1,
        RangePart::SerialLow => range.serial.0,
        RangePart::SerialHigh => range.serial.1,
    }
}

/// `configure node-ID 5`
impl fmt::Display for LssCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SwitchGlobal { configuration: true } => {
                f.write_str("switch all slaves to the configuration state")
            }
            Self::SwitchGlobal { configuration: false } => {
                f.write_str("switch all slaves to the waiting state")
            }
            Self::SwitchSelective(address) => write!(f, "select {address}"),
            Self::ConfigureNodeId(Some(node)) => write!(f, "configure node-ID {node}"),
            Self::ConfigureNodeId(None) => f.write_str("remove the node-ID"),
            Self::ConfigureBitRate(bit_rate) => write!(f, "configure bit rate {bit_rate}"),
            Self::ActivateBitRate { delay_ms } => {
                write!(f, "activate the bit rate after {delay_ms} ms")
            }
            Self::Store => f.write_str("store the configuration"),
            Self::InquireAddress => f.write_str("read the address"),
            Self::InquireNodeId => f.write_str("read the node-ID"),
            Self::Identify(range) => write!(
                f,
                "identify vendor-ID 0x{:X}, product code 0x{:X}",
                range.vendor, range.product
            ),
            Self::IdentifyNonConfigured => f.write_str("identify slaves without node-ID"),
            Self::Fastscan(_) => f.write_str("fastscan"),
        }
    }
}

/// Cause of the failure of an LSS command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum LssFault {
    /// No slave responded in time.
    #[error(
        "no slave responded after {} ms; switch the slave to the configuration state first",
        waited.as_millis()
    )]
    TimedOut {
        /// Waiting time.
        waited: Duration,
    },
    /// No slave has the address of a selective switch.
    #[error(
        "no slave with this address responded after {} ms; check the address, and that the slave is in the waiting \
         state",
        waited.as_millis()
    )]
    NotSelected {
        /// Waiting time.
        waited: Duration,
    },
    /// The slave rejected the node-ID.
    #[error("the slave rejected node-ID {}", node.map_or(255, NodeId::get))]
    NodeIdRejected {
        /// Node-ID; `None` is 255, no node-ID.
        node: Option<NodeId>,
    },
    /// The slave does not support the bit rate.
    #[error("the slave does not support {bit_rate}")]
    BitRateRejected {
        /// Bit rate.
        bit_rate: LssBitRate,
    },
    /// The slave cannot store its configuration.
    #[error("the slave does not support storing; configure it after each power-on")]
    StoreNotSupported,
    /// The slave could not access its storage.
    #[error("the slave could not access its storage")]
    StoreFailed,
    /// The slave reported an error of its manufacturer.
    #[error("the slave reported manufacturer-specific error {code}; see its manual")]
    Manufacturer {
        /// The code.
        code: u8,
    },
    /// The slave reported an error that CiA 305 does not define.
    #[error("the slave reported error {code}, which CiA 305 does not define")]
    Undefined {
        /// The code.
        code: u8,
    },
    /// The slave reported a node-ID that CiA 301 does not allow.
    #[error("the slave reported node-ID {node}; allowed: 1 to 127, or 255 for none")]
    InvalidNodeId {
        /// The number.
        node: u8,
    },
    /// The result of a fastscan matches no slave: a response was lost or late.
    #[error(
        "the scanned {part} matches no slave: a response was lost or late; scan again, with a longer scan_time"
    )]
    Inconsistent {
        /// Part of the address.
        part: LssPart,
    },
    /// The gateway is no longer ready.
    #[error("the gateway was lost")]
    GatewayLost,
    /// The application cancelled the command.
    #[error("cancelled by the application")]
    Cancelled,
    /// The Port rejected the frame for a permanent reason.
    #[error("the frame was rejected: {0}")]
    Rejected(SendError),
}

impl LssFault {
    /// Returns whether the same command may succeed later without a change by the application.
    pub const fn is_temporary(&self) -> bool {
        matches!(self, Self::GatewayLost | Self::Inconsistent { .. } | Self::TimedOut { .. })
    }
}

/// Failure of an LSS command, with its channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("LSS on slave {slave} channel {channel}, {command}: {fault}")]
pub struct LssFailure {
    /// Slave index of the gateway.
    pub slave: usize,
    /// Channel.
    pub channel: u8,
    /// The command.
    pub command: LssCommand,
    /// Cause.
    pub fault: LssFault,
}

/// Rejection of an LSS command before its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum LssStartError {
    /// Another command is running on the channel.
    #[error("slave {slave} channel {channel}: another LSS command is running; retry after its end")]
    Busy {
        /// Slave index of the gateway.
        slave: usize,
        /// Channel.
        channel: u8,
    },
    /// The network does not have the channel.
    #[error(
        "slave {slave} channel {channel} is not in the network; add a node or call add_channel"
    )]
    UnknownChannel {
        /// Slave index of the gateway.
        slave: usize,
        /// Channel.
        channel: u8,
    },
}

impl LssStartError {
    /// Returns whether the same call may succeed later without a change by the application.
    pub const fn is_temporary(&self) -> bool {
        matches!(self, Self::Busy { .. })
    }
}
