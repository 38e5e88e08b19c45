//! Session of a gateway: verification each time it reaches OP.
//!
//! The master configures a slave that returns, but does not check the result. Each time a gateway
//! reaches OP, the session therefore resets its sequence memory and reads back profiles and channels,
//! with SDO requests that run in the cycle, before a frame is sent.

use std::fmt;

use ecan_host::{Adapter, Delivery, Error, RequestState, SdoRequestId};
use ecan_protocol::mapping::Direction;

use crate::port_config::GatewayConfig;
use crate::session::verification::{Check, SdoTransfer, VerificationFault, checks};

/// Cycles between checks of the slave's state while the gateway is ready.
const WATCH_CYCLES: u64 = 64;
/// Timeout of a request in the master's queue, in milliseconds.
const REQUEST_TIMEOUT_MS: u32 = 2_000;
/// Longest wait of an attempt for a request, in nanoseconds: the timeout and the transfer itself with
/// the master's own response timeout. The master checks its timeout only when it processes the
/// request, so it may never end one.
const REQUEST_LIMIT_NS: u64 = (REQUEST_TIMEOUT_MS as u64 + 2_000) * NS_PER_MS;
/// Pause before a failed verification is repeated, in nanoseconds.
const RETRY_NS: u64 = 1_000_000_000;
const NS_PER_MS: u64 = 1_000_000;

/// State of a gateway's session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Session {
    /// The slave is not in OP, or its process data are not confirmed.
    #[default]
    Waiting,
    /// In OP, being verified; only empty images are sent.
    Verifying,
    /// Verified; frames can be sent.
    Ready,
    /// Verification failed; it is repeated every second.
    Failed(VerificationFault),
}

impl fmt::Display for Session {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Waiting => f.write_str("waiting for OP"),
            Self::Verifying => f.write_str("being verified"),
            Self::Ready => f.write_str("ready"),
            Self::Failed(fault) => write!(f, "not ready: {fault}"),
        }
    }
}

/// Step that a gateway waits for until it is ready.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PendingStep {
    /// The master does not see the slave in OP.
    Operational,
    /// The slave is in OP, but the delivery of its outputs is not confirmed.
    ProcessData,
    /// A transfer of the verification.
    Transfer(SdoTransfer),
    /// A transfer of an earlier attempt that the master has not ended.
    EarlierTransfer(SdoTransfer),
    /// The next attempt, after a failed one.
    NextAttempt,
}

impl fmt::Display for PendingStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Operational => f.write_str("OP"),
            Self::ProcessData => f.write_str("its process data to arrive"),
            Self::Transfer(transfer) => write!(f, "the {transfer}"),
            Self::EarlierTransfer(transfer) => {
                write!(f, "the master to end the {transfer} of an earlier attempt")
            }
            Self::NextAttempt => f.write_str("the next attempt"),
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Request {
    id: SdoRequestId,
    /// The last transfer, and its start.
    begun: Option<(SdoTransfer, u64)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Event {
    None,
    Started,
    Ready,
    Failed,
    Lost,
}

#[derive(Debug)]
pub(crate) struct SessionMachine {
    slave: usize,
    state: Session,
    checks: Vec<Check>,
    next: usize,
    /// This attempt has begun the transfer of the next check.
    is_running: bool,
    read: Request,
    command: Request,
    /// Time since which this attempt waits for a request.
    waiting_since_ns: u64,
    layout_crc: [Option<u32>; 2],
    /// Fault of the last attempt, until one succeeds.
    last_fault: Option<VerificationFault>,
    retry_at_ns: u64,
    cycles: u64,
}

impl SessionMachine {
    /// Creates the requests; the Adapter must be configured and not yet active.
    pub(crate) fn new(
        adapter: &mut Adapter,
        slave: usize,
        config: &GatewayConfig,
    ) -> Result<Self, Error> {
        let read = adapter.create_sdo_request(slave, 4)?;
        let command = adapter.create_sdo_request(slave, 1)?;
        for request in [read, command] {
            adapter.sdo_request_timeout(request, REQUEST_TIMEOUT_MS)?;
        }
        let settings = &adapter.config().slaves[slave];
        let profiles = [
            config.profile(Direction::TxPdo, settings.tx_multiplier),
            config.profile(Direction::RxPdo, settings.rx_multiplier),
        ];
        let checks = checks(config, profiles, adapter.serial_number(slave)?);
        Ok(Self {
            slave,
            state: Session::Waiting,
            checks,
            next: 0,
            is_running: false,
            read: Request { id: read, begun: None },
            command: Request { id: command, begun: None },
            waiting_since_ns: 0,
            layout_crc: [None; 2],
            last_fault: None,
            retry_at_ns: 0,
            cycles: 0,
        })
    }

    pub(crate) fn state(&self) -> Session {
        self.state
    }

    pub(crate) fn is_ready(&self) -> bool {
        self.state == Session::Ready
    }

    pub(crate) fn last_fault(&self) -> Option<VerificationFault> {
        self.last_fault
    }

    pub(crate) fn awaited(&self, adapter: &Adapter) -> Option<PendingStep> {
        match self.state {
            Session::Ready => None,
            Session::Verifying => self.checks.get(self.next).map(|check| {
                let request = if check.transfer().is_download { self.command } else { self.read };
                match request.begun {
                    Some((transfer, _)) if !self.is_running => {
                        PendingStep::EarlierTransfer(transfer)
                    }
                    _ => PendingStep::Transfer(check.transfer()),
                }
            }),
            Session::Waiting | Session::Failed(_) => Some(match () {
                () if !self.is_operational(adapter) => PendingStep::Operational,
                () if !self.outputs_arrive(adapter) => PendingStep::ProcessData,
                () => PendingStep::NextAttempt,
            }),
        }
    }

    /// One step, once a cycle; `is_lost`: too many images in a row did not arrive.
    pub(crate) fn step(&mut self, adapter: &mut Adapter, is_lost: bool) -> Event {
        self.cycles += 1;
        let is_due = self.cycles.is_multiple_of(WATCH_CYCLES);
        match self.state {
            Session::Ready if is_lost || (is_due && self.has_left_op(adapter)) => self.lose(),
            Session::Ready => Event::None,
            Session::Verifying | Session::Failed(_) if is_lost => self.lose(),
            Session::Verifying => match self.verify(adapter) {
                Ok(true) => {
                    self.state = Session::Ready;
                    self.last_fault = None;
                    Event::Ready
                }
                Ok(false) => Event::None,
                Err(fault) => {
                    self.state = Session::Failed(fault);
                    self.last_fault = Some(fault);
                    self.retry_at_ns = adapter.clock().now_ns() + RETRY_NS;
                    Event::Failed
                }
            },
            Session::Failed(_) if adapter.clock().now_ns() < self.retry_at_ns => Event::None,
            Session::Waiting | Session::Failed(_) => self.start_if_operational(adapter),
        }
    }

    fn is_operational(&self, adapter: &Adapter) -> bool {
        adapter.slave_state(self.slave).is_ok_and(|state| state.operational)
    }

    fn outputs_arrive(&self, adapter: &Adapter) -> bool {
        adapter.domain_report(self.slave).outputs == Delivery::Confirmed
    }

    /// Whether the master reports the slave in another state. While it rescans the bus it reports no
    /// slave at all although process data continue; that is no loss.
    fn has_left_op(&self, adapter: &Adapter) -> bool {
        adapter.slave_state(self.slave).is_ok_and(|state| state.online && !state.operational)
    }

    fn start_if_operational(&mut self, adapter: &mut Adapter) -> Event {
        if !self.outputs_arrive(adapter) || !self.is_operational(adapter) {
            return Event::None;
        }
        self.state = Session::Verifying;
        self.next = 0;
        // The result of an earlier attempt's request does not apply to this one.
        self.is_running = false;
        self.waiting_since_ns = adapter.clock().now_ns();
        Event::Started
    }

    fn lose(&mut self) -> Event {
        self.state = Session::Waiting;
        Event::Lost
    }

    /// Continues the checks; true when all have passed.
    fn verify(&mut self, adapter: &mut Adapter) -> Result<bool, VerificationFault> {
        let Some(check) = self.checks.get(self.next).copied() else { return Ok(true) };
        let transfer = check.transfer();
        let request = if transfer.is_download { &mut self.command } else { &mut self.read };
        let state = adapter.sdo_request_state(request.id).map_err(VerificationFault::Library)?;
        let now = adapter.clock().now_ns();
        if state == RequestState::Busy {
            // Also a request of an earlier attempt that the master has not ended.
            if now.saturating_sub(self.waiting_since_ns) < REQUEST_LIMIT_NS {
                return Ok(false);
            }
            let (transfer, begun_ns) = request.begun.unwrap_or((transfer, self.waiting_since_ns));
            let waited_ms = now.saturating_sub(begun_ns) / NS_PER_MS;
            return Err(VerificationFault::Unended { transfer, waited_ms });
        }
        if !self.is_running {
            let SdoTransfer { index, subindex, .. } = transfer;
            match check {
                Check::Command(sdo) => {
                    let (bytes, length) = sdo.bytes();
                    let data = bytes.get(..length).unwrap_or_default();
                    adapter.sdo_request_write(request.id, index, subindex, data)
                }
                _ => adapter.sdo_request_read(request.id, index, subindex),
            }
            .map_err(VerificationFault::Library)?;
            request.begun = Some((transfer, now));
            self.waiting_since_ns = now;
            self.is_running = true;
            return Ok(false);
        }
        self.is_running = false;
        request.begun = None;
        if state != RequestState::Success {
            return Err(VerificationFault::Transfer(transfer));
        }
        let mut value = [0; 4];
        for (to, from) in value.iter_mut().zip(adapter.sdo_request_data(request.id)) {
            *to = *from;
        }
        check.verify(u32::from_le_bytes(value), &mut self.layout_crc)?;
        self.next += 1;
        Ok(self.next == self.checks.len())
    }
}
