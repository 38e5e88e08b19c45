//! Session of a gateway: verification each time it reaches OP.
//!
//! The master configures a slave that returns, but does not check the result. Each time a gateway
//! reaches OP, the session therefore resets its sequence memory and reads back profiles and channels,
//! with SDO requests that run in the cycle, before a frame is sent.

use std::fmt;

use ecan_host::{Adapter, Delivery, Error, RequestState, SdoRequestId};
use ecan_protocol::mapping::Direction;

use crate::port_config::GatewayConfig;
use crate::session::verification::{Check, SERIAL_CHECKS, SdoTransfer, VerificationFault, checks};

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
/// Time in OP without any process data after which a gateway is asked for its identity, in
/// nanoseconds. The master's slave state lags by seconds.
const UNMAPPED_NS: u64 = 3_000_000_000;
/// Largest age of the sequence that a gateway reports, in images, besides the time of the transfer.
const SEQUENCE_MARGIN: u16 = 16;
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
    /// A configuration of the Port that has the gateway.
    Configuration,
    /// The slave does not answer at its address.
    Answer,
    /// The master does not see the slave in OP.
    Operational,
    /// The slave is in the same state below OP longer than a startup lasts. The master stops a
    /// startup when one of its SDOs or a change of state fails, and tries again only on
    /// [`Port::retry_startup`](crate::Port::retry_startup).
    StartupRetry,
    /// The slave is in OP, but the delivery of its outputs is not confirmed.
    ProcessData,
    /// Another slave exchanges the same process data: it had this position while a branch of the bus
    /// was away, until the master configures it again.
    ExclusiveProcessData,
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
            Self::Configuration => f.write_str("a reconfiguration of the Port that includes it"),
            Self::Answer => {
                f.write_str("the slave to answer at its address; check its power and the cables")
            }
            Self::Operational => f.write_str("OP"),
            Self::StartupRetry => f.write_str(
                "another attempt of its startup (retry_startup), since the last one failed",
            ),
            Self::ProcessData => f.write_str("its process data to arrive"),
            Self::ExclusiveProcessData => {
                f.write_str("another slave to leave its process data (working counter too high)")
            }
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
    /// Sequence numbers between those of two gateways.
    sequence_distance: u16,
    /// Sequence of the last image when the check of the sequence began.
    sequence_at_start: u16,
    /// Whether the gateway reports the sequence of its last image; `None` before the first
    /// verification, when positions are those of the configuration.
    reports_sequence: Option<bool>,
    /// Its serial number is programmed.
    has_serial: bool,
    /// In OP without any process data since then.
    unmapped_since_ns: Option<u64>,
    /// This attempt only identifies a gateway without process data.
    is_identifying: bool,
    /// State below OP and its begin, and the longest time that a startup lasts.
    below_op: Option<(u8, u64)>,
    startup_ns: u64,
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
        let serial = adapter.serial_number(slave)?;
        let slaves = adapter.slave_count().max(1);
        let checks = checks(config, profiles, serial, slaves == 1);
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
            // infallible: at most 65536
            sequence_distance: u16::try_from(0x1_0000 / slaves).unwrap_or(u16::MAX),
            sequence_at_start: 0,
            reports_sequence: None,
            has_serial: serial != 0,
            unmapped_since_ns: None,
            is_identifying: false,
            below_op: None,
            startup_ns: u64::try_from(adapter.startup_timeout().as_nanos()).unwrap_or(u64::MAX),
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
                () if !self.is_online(adapter) => PendingStep::Answer,
                () if self.is_held(adapter) => PendingStep::StartupRetry,
                () if !self.is_operational(adapter) => PendingStep::Operational,
                () if adapter.shares_process_data(self.slave) => PendingStep::ExclusiveProcessData,
                () if !self.outputs_arrive(adapter) => PendingStep::ProcessData,
                () => PendingStep::NextAttempt,
            }),
        }
    }

    /// Sequence number with which the images of a verification begin that starts in this cycle. No
    /// other gateway has images of this number at the same time.
    pub(crate) fn first_sequence(&self, cycle: u64) -> u16 {
        let slave = u16::try_from(self.slave).unwrap_or_default();
        // Wraps on purpose.
        self.sequence_distance.wrapping_mul(slave).wrapping_add(cycle as u16)
    }

    /// One step, once a cycle; `is_lost`: too many images in a row did not arrive; `published`:
    /// sequence of the last image.
    pub(crate) fn step(&mut self, adapter: &mut Adapter, is_lost: bool, published: u16) -> Event {
        self.cycles += 1;
        let is_due = self.cycles.is_multiple_of(WATCH_CYCLES);
        match self.state {
            Session::Ready if is_lost || (is_due && self.has_left_op(adapter)) => self.lose(),
            Session::Ready => Event::None,
            Session::Verifying | Session::Failed(_) if is_lost && !self.is_identifying => {
                self.lose()
            }
            Session::Verifying => match self.verify(adapter, published) {
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
                    self.unmapped_since_ns = None;
                    if fault == VerificationFault::ProcessData && self.has_serial {
                        // Its identity is verified: no gateway in use leaves OP. A rejected request is repeated by the next attempt.
                        let _ = adapter.request_reconfiguration(self.slave);
                    }
                    Event::Failed
                }
            },
            Session::Failed(_) if adapter.clock().now_ns() < self.retry_at_ns => Event::None,
            Session::Waiting | Session::Failed(_) => {
                if is_due {
                    self.watch_startup(adapter);
                }
                self.start_if_operational(adapter)
            }
        }
    }

    /// Since when the slave is in its state below OP, or in OP without process data.
    fn watch_startup(&mut self, adapter: &Adapter) {
        let now_ns = adapter.clock().now_ns();
        let state = adapter.slave_state(self.slave).ok().filter(|state| state.online);
        let below_op = state.filter(|state| !state.operational).map(|state| state.al_state);
        let last = self.below_op;
        self.below_op = below_op.map(|al_state| match last {
            Some((before, since_ns)) if before == al_state => (al_state, since_ns),
            _ => (al_state, now_ns),
        });
        let is_unmapped = state.is_some_and(|state| state.operational)
            && adapter.domain_report(self.slave).outputs == Delivery::Missed;
        self.unmapped_since_ns = is_unmapped.then(|| self.unmapped_since_ns.unwrap_or(now_ns));
        if self.is_identifying && !is_unmapped {
            self.is_identifying = false;
            self.state = Session::Waiting;
        }
    }

    fn has_lasted(since_ns: Option<u64>, limit_ns: u64, adapter: &Adapter) -> bool {
        since_ns.is_some_and(|since| adapter.clock().now_ns().saturating_sub(since) >= limit_ns)
    }

    fn is_held(&self, adapter: &Adapter) -> bool {
        let since_ns = self.below_op.map(|(_, since_ns)| since_ns);
        Self::has_lasted(since_ns, self.startup_ns, adapter)
    }

    fn is_online(&self, adapter: &Adapter) -> bool {
        adapter.slave_state(self.slave).is_ok_and(|state| state.online)
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
        let outputs_arrive = self.outputs_arrive(adapter);
        let is_unmapped =
            self.has_serial && Self::has_lasted(self.unmapped_since_ns, UNMAPPED_NS, adapter);
        if !(outputs_arrive || is_unmapped) || !self.is_operational(adapter) {
            return Event::None;
        }
        self.is_identifying = !outputs_arrive;
        (self.below_op, self.unmapped_since_ns) = (None, None);
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
    fn verify(&mut self, adapter: &mut Adapter, published: u16) -> Result<bool, VerificationFault> {
        if self.is_identifying && self.next == SERIAL_CHECKS {
            return Err(VerificationFault::ProcessData);
        }
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
            self.sequence_at_start = published;
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
        let value = u32::from_le_bytes(value);
        check.verify(value, &mut self.layout_crc)?;
        if matches!(check, Check::Sequence) && !self.check_sequence(value, published)? {
            return Ok(false);
        }
        self.next += 1;
        Ok(self.next == self.checks.len())
    }

    /// Whether the gateway receives the images that the Port publishes to it, by the sequence that
    /// it reports. `false` for a transfer that took so long that nothing follows; it is repeated.
    fn check_sequence(&mut self, found: u32, published: u16) -> Result<bool, VerificationFault> {
        let window = published.wrapping_sub(self.sequence_at_start).saturating_add(SEQUENCE_MARGIN);
        if window > self.sequence_distance / 2 {
            return Ok(false);
        }
        let is_own = u64::from(found) <= u64::from(u16::MAX)
            && published.wrapping_sub(found as u16) <= window;
        if self.reports_sequence.is_none() && !is_own {
            tracing::warn!(
                slave = self.slave,
                "slave {}: the gateway does not report the sequence of its last image; that process \
                 data reach the right gateway is not verified",
                self.slave
            );
        }
        match *self.reports_sequence.get_or_insert(is_own) {
            true if !is_own => Err(VerificationFault::ProcessData),
            _ => Ok(true),
        }
    }
}
