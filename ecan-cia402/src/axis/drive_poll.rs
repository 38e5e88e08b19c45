//! Commands and reads a drive by SDO, which needs neither mapped PDOs nor NMT Operational.

use ecan_canopen::{
    Configuring, Controlword, Heartbeat, Network, NodeAccessError, NodeHandle, Sdo, SdoFault, Step,
    StepFault, object,
};

use super::script::first_index;
use super::script::{Script, axis_script};

/// Time for an answer before the request is repeated. A drive that was unreachable receives its stop
/// that soon after its return.
const RETRY_NS: u64 = 100_000_000;

/// Every n-th attempt waits longer, for a drive that is slow to answer.
const PATIENT_ATTEMPT: u32 = 4;
const PATIENT_NS: u64 = 500_000_000;

/// Content of a round.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Round {
    /// Writes the controlword, if there is one, then reads statusword and position.
    Stop(Option<Controlword>),
    /// Reads statusword and position.
    Inspect,
    /// Reads mode and quick stop option, too, and the object with the position that the drive keeps, in a position mode.
    InspectForAdoption(Option<u16>),
}

/// Repeats rounds of SDO transfers with a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct DrivePoll {
    /// Axis of the node.
    axis: u8,
    round: Option<Script>,
    /// The round is a [`Round::Stop`].
    is_stop: bool,
    since_ns: u64,
    /// Attempts without an answer in a row.
    unanswered: u32,
    /// The last attempt had an answer.
    is_answered: bool,
    was_alive: bool,
}

impl DrivePoll {
    pub(crate) fn new(axis: u8) -> Self {
        Self { axis, ..Self::default() }
    }

    /// Returns whether a round runs.
    pub(crate) fn is_running(&self) -> bool {
        self.round.is_some()
    }

    pub(crate) fn unanswered(&self) -> u32 {
        self.unanswered
    }

    /// Returns whether the node answered the last round, be it by aborts.
    pub(crate) fn is_answered(&self) -> bool {
        self.is_answered
    }

    pub(crate) fn cancel(&mut self, network: &mut Network, node: NodeHandle) {
        if let Some(round) = self.round.take() {
            round.cancel(network, node);
        }
        self.unanswered = 0;
    }

    /// Continues the round, or begins the next one. Returns whether the drive answered a whole round,
    /// although it may lack some of the objects. `on_read` receives index and value.
    pub(crate) fn step(
        &mut self,
        network: &mut Network,
        node: NodeHandle,
        now_ns: u64,
        next: Round,
        mut on_read: impl FnMut(u16, u64),
    ) -> bool {
        let is_alive = network.heartbeat(node) == Heartbeat::Active;
        let returned = is_alive && !std::mem::replace(&mut self.was_alive, is_alive);
        let axis = self.axis;
        if matches!(next, Round::Stop(_))
            && !self.is_stop
            && let Some(round) = self.round.take()
        {
            // The response of an inspection may be lost; a stop does not wait for it.
            round.cancel(network, node);
        }
        let Some(round) = &mut self.round else {
            self.begin(network, node, now_ns, next);
            return false;
        };
        match round.advance(network, node, now_ns, |index, _, value| {
            on_read(first_index(axis, index), value);
        }) {
            Configuring::Done => self.answered(),
            Configuring::Running => {
                let waited_ns = now_ns.saturating_sub(self.since_ns);
                let is_patient = (self.unanswered + 1).is_multiple_of(PATIENT_ATTEMPT);
                let limit_ns = if is_patient && !returned { PATIENT_NS } else { RETRY_NS };
                if waited_ns > limit_ns {
                    round.cancel(network, node);
                    self.failed()
                } else {
                    false
                }
            }
            Configuring::Failed(failure) if is_abort(&failure.fault) => {
                // It has no statusword: the node is there, but it is not a drive.
                self.answered()
            }
            Configuring::Failed(_) => self.failed(),
        }
    }

    fn begin(&mut self, network: &mut Network, node: NodeHandle, now_ns: u64, round: Round) {
        if network.sdo_state(node) == Sdo::Busy {
            if !matches!(round, Round::Stop(_)) {
                return;
            }
            // A stop does not wait for a transfer of the application.
            network.cancel_sdo(node);
        }
        self.is_stop = matches!(round, Round::Stop(_));
        let read = |index| Step::read(index, 0);
        let status = [read(object::STATUSWORD), read(object::POSITION_ACTUAL).if_present()];
        self.round = Some(match round {
            Round::Stop(word) => {
                let write = |word: Controlword| Step::write(object::CONTROLWORD, 0, word.0);
                let word = word.map(|word| write(word).named("stop").if_accepted());
                axis_script(self.axis, word.into_iter().chain(status))
            }
            Round::Inspect => axis_script(self.axis, status),
            Round::InspectForAdoption(kept) => {
                let more =
                    [object::MODE_DISPLAY, object::QUICK_STOP_OPTION].into_iter().chain(kept);
                let more = more.map(|index| read(index).if_present());
                axis_script(self.axis, status.into_iter().chain(more))
            }
        });
        self.since_ns = now_ns;
    }

    fn answered(&mut self) -> bool {
        self.round = None;
        self.unanswered = 0;
        self.is_answered = true;
        true
    }

    fn failed(&mut self) -> bool {
        self.round = None;
        self.is_answered = false;
        self.unanswered = self.unanswered.saturating_add(1);
        false
    }
}

fn is_abort(fault: &StepFault) -> bool {
    matches!(fault, StepFault::Access(NodeAccessError::Sdo(SdoFault::Aborted(_))))
}
