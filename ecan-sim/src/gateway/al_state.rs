//! EtherCAT state machine: the transitions and what each one requires (manual 5.4.6, 14; AL status codes of
//! ETG.1000.6), and the process data watchdog.

use ecan_protocol::device::{AlState, AlStatusCode};

use super::NS_PER_MS;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Requirement {
    Nothing,
    /// Valid mailboxes; otherwise this error.
    Mailboxes(AlStatusCode),
    /// Active profiles (requested ones are applied) and valid process data sync managers.
    Profiles,
    /// Valid process data sync managers and, if Sync0 is configured, its first pulse.
    ProcessDataAndSync,
}

#[derive(Clone, Debug)]
pub(super) struct AlStateMachine {
    pub(super) state: AlState,
    pub(super) has_error: bool,
    pub(super) status_code: AlStatusCode,
    /// Since when OP is requested and the first Sync0 pulse awaited.
    pub(super) awaiting_sync_since: Option<u64>,
}

impl AlStateMachine {
    pub(super) fn new() -> Self {
        Self {
            state: AlState::Init,
            has_error: false,
            status_code: AlStatusCode::OK,
            awaiting_sync_since: None,
        }
    }

    pub(super) fn is_op(&self) -> bool {
        self.state == AlState::Op
    }

    pub(super) fn exchanges_process_data(&self) -> bool {
        exchanges_process_data(self.state)
    }

    /// Acknowledges a pending error and ends the wait for Sync0, as each request does.
    pub(super) fn acknowledge(&mut self) {
        self.has_error = false;
        self.status_code = AlStatusCode::OK;
        self.awaiting_sync_since = None;
    }

    pub(super) fn fail(&mut self, code: AlStatusCode) {
        self.has_error = true;
        self.status_code = code;
    }

    /// The error is the AL status code of a transition that does not exist.
    pub(super) fn requirement(&self, to: AlState) -> Result<Requirement, AlStatusCode> {
        use AlState::{Boot, Init, Op, PreOp, SafeOp};
        Ok(match (self.state, to) {
            (from, to) if from == to => Requirement::Nothing,
            (Init, PreOp) => Requirement::Mailboxes(AlStatusCode::MAILBOX_CONFIGURATION),
            (Init, Boot) => Requirement::Mailboxes(AlStatusCode::BOOT_MAILBOX_CONFIGURATION),
            (_, Init) | (SafeOp | Op, PreOp) | (Op, SafeOp) => Requirement::Nothing,
            (PreOp, SafeOp) => Requirement::Profiles,
            (SafeOp, Op) => Requirement::ProcessDataAndSync,
            _ => return Err(AlStatusCode::INVALID_STATE_CHANGE),
        })
    }

    pub(super) fn enter(&mut self, to: AlState) -> StateChange {
        StateChange { from: std::mem::replace(&mut self.state, to), to }
    }
}

fn exchanges_process_data(state: AlState) -> bool {
    matches!(state, AlState::SafeOp | AlState::Op)
}

#[derive(Clone, Copy, Debug)]
pub(super) struct StateChange {
    from: AlState,
    to: AlState,
}

impl StateChange {
    pub(super) fn leaves_op(self) -> bool {
        self.from == AlState::Op && self.to != AlState::Op
    }

    pub(super) fn stops_mailbox(self) -> bool {
        self.from.has_mailbox() && !self.to.has_mailbox()
    }

    pub(super) fn starts_process_data(self) -> bool {
        !exchanges_process_data(self.from) && exchanges_process_data(self.to)
    }

    pub(super) fn stops_process_data(self) -> bool {
        exchanges_process_data(self.from) && !exchanges_process_data(self.to)
    }
}

const DEFAULT_TIMEOUT_NS: u64 = 100 * NS_PER_MS;

/// Process data watchdog. Each complete SM2 write feeds it.
#[derive(Clone, Debug)]
pub(super) struct Watchdog {
    /// 0 disables it.
    pub(super) timeout_ns: u64,
    /// Since power-on or reboot.
    pub(super) expirations: u32,
    /// It has expired and was not fed since.
    pub(super) is_expired: bool,
    pub(super) fed_at: u64,
}

impl Watchdog {
    pub(super) fn new() -> Self {
        Self { timeout_ns: DEFAULT_TIMEOUT_NS, expirations: 0, is_expired: false, fed_at: 0 }
    }

    pub(super) fn feed(&mut self, now: u64) {
        self.is_expired = false;
        self.fed_at = now;
    }

    /// When it expires; `None` while it is disabled.
    pub(super) fn expiry(&self) -> Option<u64> {
        (self.timeout_ns > 0).then(|| self.fed_at.saturating_add(self.timeout_ns))
    }

    pub(super) fn expire(&mut self) {
        self.expirations += 1;
        self.is_expired = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use AlState::{Boot, Init, Op, PreOp, SafeOp};

    fn in_state(state: AlState) -> AlStateMachine {
        let mut machine = AlStateMachine::new();
        machine.enter(state);
        machine
    }

    #[test]
    fn upward_transitions_have_requirements() {
        let mailbox = Requirement::Mailboxes(AlStatusCode::MAILBOX_CONFIGURATION);
        let boot = Requirement::Mailboxes(AlStatusCode::BOOT_MAILBOX_CONFIGURATION);
        for (from, to, expected) in [
            (Init, PreOp, mailbox),
            (Init, Boot, boot),
            (PreOp, SafeOp, Requirement::Profiles),
            (SafeOp, Op, Requirement::ProcessDataAndSync),
            (Op, SafeOp, Requirement::Nothing),
            (Op, Init, Requirement::Nothing),
        ] {
            assert_eq!(in_state(from).requirement(to), Ok(expected), "{from} to {to}");
        }
    }

    #[test]
    fn skipped_states_are_rejected() {
        for (from, to) in [(Init, SafeOp), (Init, Op), (PreOp, Op), (Boot, PreOp), (Op, Boot)] {
            let result = in_state(from).requirement(to);
            assert_eq!(result, Err(AlStatusCode::INVALID_STATE_CHANGE), "{from} to {to}");
        }
    }

    #[test]
    fn state_change_reports_what_it_stops_and_starts() {
        let change = |from, to| in_state(from).enter(to);
        assert!(change(Op, SafeOp).leaves_op());
        assert!(!change(Op, SafeOp).stops_process_data());
        assert!(change(PreOp, SafeOp).starts_process_data());
        assert!(change(Op, PreOp).stops_process_data());
        assert!(!change(Op, PreOp).stops_mailbox());
        assert!(change(PreOp, Init).stops_mailbox());
    }

    #[test]
    fn request_acknowledges_a_pending_error() {
        let mut machine = in_state(SafeOp);
        machine.fail(AlStatusCode::SM_WATCHDOG);
        machine.awaiting_sync_since = Some(5);
        assert_eq!((machine.has_error, machine.status_code.0), (true, 0x1B));
        machine.acknowledge();
        assert_eq!((machine.has_error, machine.status_code), (false, AlStatusCode::OK));
        assert_eq!(machine.awaiting_sync_since, None);
    }

    #[test]
    fn expired_watchdog_recovers_when_fed() {
        let mut watchdog = Watchdog::new();
        watchdog.fed_at = 10;
        assert_eq!(watchdog.expiry(), Some(10 + DEFAULT_TIMEOUT_NS));
        watchdog.expire();
        assert_eq!((watchdog.is_expired, watchdog.expirations), (true, 1));
        watchdog.feed(20);
        assert_eq!((watchdog.is_expired, watchdog.expirations), (false, 1));
        assert_eq!(watchdog.fed_at, 20);
    }

    #[test]
    fn zero_timeout_disables_the_watchdog() {
        let mut watchdog = Watchdog::new();
        watchdog.timeout_ns = 0;
        assert_eq!(watchdog.expiry(), None);
    }
}
