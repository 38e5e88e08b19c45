//! Session of a gateway: verification each time it reaches OP.
//!
//! The master configures a slave that returns, but does not check the result. Each time a gateway
//! reaches OP, the session therefore resets its sequence memory and reads back profiles and channels,
//! with SDO requests that run in the cycle, before a frame is sent.
//!
//! When the startup of a gateway is requested again.
//!
//! A master does not repeat a startup that failed, and the cycle cannot ask whether it did: the error
//! flag is behind the master's semaphore. A request has no effect on a slave that is in OP or is being
//! configured.

use std::fmt;

use ecan_host::{Adapter, Delivery, Error, Phase, Slave};
use ecan_protocol::device::{AlState, CCCR, Capabilities};
use ecan_protocol::mapping::Direction;

use super::check_runner::{CheckRunner, warn_unverified};
use super::startup::{ProfileRestore, RESTORE_NS, SAFEOP_NS};
use super::verification::{
    Check, ControllerStep, PendingStep, SERIAL_CHECKS, SdoTransfer, VerificationFault, checks,
};
use crate::config::GatewayConfig;

/// Cycles between checks of the slave's state while the gateway is ready.
const WATCH_CYCLES: u64 = 64;
/// Pause before a failed verification is repeated, in nanoseconds.
const RETRY_NS: u64 = 1_000_000_000;
/// Time in OP without any process data after which a gateway is asked for its identity, in
/// nanoseconds. The master's slave state lags by seconds.
const UNMAPPED_NS: u64 = 3_000_000_000;

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
    runner: CheckRunner,
    /// Fault of the last attempt, until one succeeds.
    last_fault: Option<VerificationFault>,
    /// Two attempts in a row read the same wrong value.
    fault_lasts: bool,
    retry_at_ns: u64,
    cycles: u64,
    /// The serial number of the gateway is programmed.
    has_serial: bool,
    /// The gateway was below OP when its AL status was read last. The master's state lags.
    is_below_op: bool,
    /// In OP without any process data since then.
    unmapped_since_ns: Option<u64>,
    /// This attempt only identifies a gateway without process data.
    is_identifying: bool,
    /// Begin of the present stay below OP in one AL state.
    below_op_since_ns: Option<u64>,
    /// The last AL state below OP; a number that is always set, since memcheck reports the comparison of one in
    /// an `Option`.
    below_op_state: u8,
    startup_retry: StartupRetry,
    profile_restore: ProfileRestore,
}

/// Returns whether a check reads an entry that the gateway does not have.
fn is_of_missing_entry(check: Check, slave: &Slave) -> bool {
    let SdoTransfer { index, subindex, .. } = check.transfer();
    if let Check::Controller { .. } = check {
        // A channel is read with all its steps or not at all.
        let lacks = |step: ControllerStep| slave.lacks_object(index, step.subindex());
        return ControllerStep::of_register(0).into_iter().any(lacks);
    }
    match index {
        Capabilities::INDEX => !slave.reports_capability(subindex),
        _ => slave.lacks_object(index, subindex),
    }
}

impl SessionMachine {
    /// Creates the requests; the Adapter must be configured and not yet active.
    pub(crate) fn new(
        adapter: &mut Adapter,
        slave: usize,
        config: &GatewayConfig,
    ) -> Result<Self, Error> {
        let settings = &adapter.config().slaves[slave];
        let profiles = [
            config.profile(Direction::TxPdo, settings.tx_multiplier),
            config.profile(Direction::RxPdo, settings.rx_multiplier),
        ];
        let unit = adapter.slave(slave)?;
        let serial = unit.serial_number();
        let mut checks = checks(config, profiles, serial, adapter.slave_count() == 1);
        checks.retain(|check| {
            let is_missing = is_of_missing_entry(*check, unit);
            if let Check::Controller { channel, step: ControllerStep::Offset(CCCR) } = *check
                && is_missing
            {
                warn_unverified(slave, channel);
            }
            !is_missing
        });
        Ok(Self {
            slave,
            state: Session::Waiting,
            runner: CheckRunner::new(adapter, slave, checks)?,
            last_fault: None,
            fault_lasts: false,
            retry_at_ns: 0,
            cycles: 0,
            has_serial: serial != 0,
            is_below_op: false,
            unmapped_since_ns: None,
            is_identifying: false,
            below_op_since_ns: None,
            below_op_state: 0,
            startup_retry: StartupRetry::default(),
            profile_restore: ProfileRestore::new(adapter, slave, profiles)?,
        })
    }

    pub(crate) fn state(&self) -> Session {
        self.state
    }

    #[inline]
    pub(crate) fn is_ready(&self) -> bool {
        self.state == Session::Ready
    }

    pub(crate) fn set_below_op(&mut self, is_below_op: bool) {
        self.is_below_op = is_below_op;
    }

    /// Returns whether all requests of its verification are in the master's queue.
    pub(crate) fn has_queued_requests(&self) -> bool {
        self.state == Session::Verifying && self.runner.has_begun()
    }

    pub(crate) fn last_fault(&self) -> Option<VerificationFault> {
        self.last_fault
    }

    /// Returns whether the verification fails by a value that does not change.
    pub(crate) fn fails_for_good(&self) -> bool {
        self.fault_lasts
    }

    pub(crate) fn pending_step(&self, adapter: &Adapter) -> Option<PendingStep> {
        match self.state {
            Session::Ready => None,
            Session::Verifying => Some(self.runner.pending_step()),
            Session::Waiting | Session::Failed(_) => Some(match () {
                () if adapter.phase() != Phase::Active => PendingStep::Operational,
                () if !adapter.has_link() => PendingStep::Link,
                () if !self.is_online(adapter) => PendingStep::Answer,
                () if self.is_restoring(adapter) => PendingStep::Operational,
                () if self.startup_retry.is_due() || self.startup_retry.requests() > 0 => {
                    PendingStep::StartupRetry
                }
                () if !self.is_operational(adapter) => PendingStep::Operational,
                () if adapter.domain_report(self.slave).is_shared() => {
                    PendingStep::ExclusiveProcessData
                }
                () if !self.outputs_arrive(adapter) => PendingStep::ProcessData,
                () => PendingStep::NextAttempt,
            }),
        }
    }

    /// See [`CheckRunner::first_sequence`].
    pub(crate) fn first_sequence(&self, cycle: u64) -> u16 {
        self.runner.first_sequence(cycle)
    }

    /// One step, once a cycle; `is_lost`: too many images in a row did not arrive; `published`:
    /// sequence of the last image.
    pub(crate) fn step(&mut self, adapter: &mut Adapter, is_lost: bool, published: u16) -> Event {
        self.cycles += 1;
        let is_due = self.cycles.is_multiple_of(WATCH_CYCLES);
        let is_lost = is_lost || self.is_below_op;
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
                    self.fault_lasts = false;
                    Event::Ready
                }
                Ok(false) => Event::None,
                Err(fault) => {
                    self.state = Session::Failed(fault);
                    let is_repeated = self.last_fault == Some(fault) && fault.is_of_the_device();
                    // Until it is stopped, the channel may take part in its bus.
                    let is_urgent = matches!(fault, VerificationFault::NodeMode { .. });
                    self.fault_lasts = is_repeated || is_urgent;
                    self.last_fault = Some(fault);
                    self.retry_at_ns = adapter.clock().now_ns() + RETRY_NS;
                    self.unmapped_since_ns = None;
                    if fault == VerificationFault::ProcessData && self.has_serial {
                        // Its identity is verified: no gateway in use leaves OP. A rejected request is repeated by the next attempt.
                        let _ = adapter.requests().reconfigure(self.slave);
                    }
                    Event::Failed
                }
            },
            Session::Failed(_) if adapter.clock().now_ns() < self.retry_at_ns => Event::None,
            Session::Waiting | Session::Failed(_) => {
                if is_due {
                    self.watch_startup(adapter);
                }
                if is_due || self.cycles == 1 && self.state == Session::Waiting {
                    self.runner.occupy_queue(adapter);
                }
                self.restore_profiles(adapter);
                self.start_if_operational(adapter)
            }
        }
    }

    fn restore_profiles(&mut self, adapter: &mut Adapter) {
        let since_ns = self.safeop_since_ns();
        if since_ns.is_none() {
            self.profile_restore.reset();
        } else if Self::has_lasted(since_ns, SAFEOP_NS, adapter) {
            self.profile_restore.step(adapter);
        }
    }

    fn safeop_since_ns(&self) -> Option<u64> {
        let state = AlState::from_status(self.below_op_state.into());
        self.below_op_since_ns.filter(|_| state == Some(AlState::SafeOp))
    }

    /// Returns whether the profiles are being restored in SAFEOP, or will be.
    fn is_restoring(&self, adapter: &Adapter) -> bool {
        let since_ns = self.safeop_since_ns();
        since_ns.is_some()
            && !self.profile_restore.has_ended()
            && !Self::has_lasted(since_ns, RESTORE_NS, adapter)
    }

    /// Since when the slave is in its state below OP, or in OP without process data.
    fn watch_startup(&mut self, adapter: &Adapter) {
        let now_ns = adapter.clock().now_ns();
        let state = adapter.slave_state(self.slave).ok().filter(|state| state.online);
        let below_op = state.filter(|state| !state.operational).map(|state| state.al_state);
        self.below_op_since_ns = below_op.map(|al_state| {
            let is_same = std::mem::replace(&mut self.below_op_state, al_state) == al_state;
            self.below_op_since_ns.filter(|_| is_same).unwrap_or(now_ns)
        });
        match self.below_op_since_ns {
            Some(_) if self.is_restoring(adapter) => self.startup_retry.postpone(),
            Some(since_ns) => self.startup_retry.watch(since_ns, now_ns),
            None => self.startup_retry.reset(),
        }
        let is_unmapped = state.is_some_and(|state| state.operational)
            && adapter.domain_report(self.slave).outputs == Delivery::Missed;
        self.unmapped_since_ns = is_unmapped.then(|| self.unmapped_since_ns.unwrap_or(now_ns));
        if self.is_identifying && !is_unmapped {
            self.is_identifying = false;
            self.state = Session::Waiting;
        }
    }

    /// Returns whether the startup of the slave should be requested again.
    pub(crate) fn needs_startup(&self) -> bool {
        self.startup_retry.is_due()
    }

    /// The startup of all slaves was requested again. Returns whether this one needed it.
    pub(crate) fn record_startup_request(&mut self, now_ns: u64) -> bool {
        let requests = self.startup_retry.record_request(now_ns);
        if let Some(requests) = requests {
            let slave = self.slave;
            tracing::info!(slave, "slave {slave}: startup requested again (request {requests})");
        }
        requests.is_some()
    }

    fn has_lasted(since_ns: Option<u64>, limit_ns: u64, adapter: &Adapter) -> bool {
        since_ns.is_some_and(|since| adapter.clock().now_ns().saturating_sub(since) >= limit_ns)
    }

    fn is_online(&self, adapter: &Adapter) -> bool {
        adapter.slave_state(self.slave).is_ok_and(|state| state.online)
    }

    /// The state that was read counts only while process data arrive: without them it is not read
    /// again, and the master may have started the slave since.
    fn is_operational(&self, adapter: &Adapter) -> bool {
        let is_below_op = self.is_below_op && self.outputs_arrive(adapter);
        !is_below_op && adapter.slave_state(self.slave).is_ok_and(|state| state.operational)
    }

    fn outputs_arrive(&self, adapter: &Adapter) -> bool {
        adapter.domain_report(self.slave).outputs == Delivery::Confirmed
    }

    /// Returns whether the master reports the slave in another state. While it rescans the bus it reports no
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
        (self.below_op_since_ns, self.unmapped_since_ns) = (None, None);
        self.startup_retry.reset();
        self.state = Session::Verifying;
        self.runner.restart(adapter.clock().now_ns());
        Event::Started
    }

    fn lose(&mut self) -> Event {
        self.state = Session::Waiting;
        Event::Lost
    }

    /// Continues the checks; true when all have passed.
    fn verify(&mut self, adapter: &mut Adapter, published: u16) -> Result<bool, VerificationFault> {
        let count = if self.is_identifying { SERIAL_CHECKS } else { usize::MAX };
        let passed = self.runner.advance(adapter, count, published)?;
        if passed && self.is_identifying {
            return Err(VerificationFault::ProcessData);
        }
        Ok(passed)
    }
}

/// Time in one state below OP before the first request, in nanoseconds.
const FIRST_NS: u64 = 2_000_000_000;
/// Longest interval between two requests, in nanoseconds.
const LONGEST_NS: u64 = 30_000_000_000;

#[derive(Debug, Default)]
pub(crate) struct StartupRetry {
    requests: u32,
    next_ns: u64,
    is_due: bool,
}

impl StartupRetry {
    /// The slave is in OP, or gone.
    pub(crate) fn reset(&mut self) {
        *self = Self::default();
    }

    /// The slave has been in one state below OP since `since_ns`.
    pub(crate) fn watch(&mut self, since_ns: u64, now_ns: u64) {
        self.is_due = now_ns >= self.next_ns.max(since_ns.saturating_add(FIRST_NS));
    }

    /// Requests no startup at present: what the slave does may still lead to OP.
    pub(crate) fn postpone(&mut self) {
        self.is_due = false;
    }

    pub(crate) fn is_due(&self) -> bool {
        self.is_due
    }

    /// The startup of all slaves was requested. Returns the number of requests for this one, or
    /// `None` if it was not due.
    pub(crate) fn record_request(&mut self, now_ns: u64) -> Option<u32> {
        if !std::mem::take(&mut self.is_due) {
            return None;
        }
        self.requests = self.requests.saturating_add(1);
        let interval_ns = FIRST_NS.checked_shl(self.requests.min(16)).unwrap_or(LONGEST_NS);
        self.next_ns = now_ns.saturating_add(interval_ns.min(LONGEST_NS));
        Some(self.requests)
    }

    pub(crate) fn requests(&self) -> u32 {
        self.requests
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_follow_at_increasing_intervals_until_op() {
        let mut retry = StartupRetry::default();
        let mut seconds = Vec::new();
        let mut run = |retry: &mut StartupRetry| {
            seconds.clear();
            for second in 10..110 {
                retry.watch(10_000_000_000, second * 1_000_000_000);
                if retry.record_request(second * 1_000_000_000).is_some() {
                    seconds.push(second - 10);
                }
            }
            assert_eq!(seconds, [2, 6, 14, 30, 60, 90]);
        };
        run(&mut retry);
        retry.reset();
        run(&mut retry);
    }
}
