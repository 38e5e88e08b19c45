//! State machine of the LSS master: frames and time in, frames and results out.

use std::fmt;
use std::time::Duration;

use super::command::{LssCommand, LssResult};
use super::fault::LssFault;
use crate::network::period_timer::nanoseconds;
use crate::{
    Fastscan, FastscanFilter, FastscanStep, LssAddress, LssConfirmation, LssPart, LssResponse,
    NodeId, UNCONFIGURED_NODE_ID,
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
                match (NodeId::new(node), node) {
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
