//! Connection of an axis with its drive: what the drive reported, and how the host reaches it.

use ecan_canopen::{
    Controlword, Heartbeat, Network, NmtCommand, NmtState, NodeStatus, Statusword, object,
};

use super::config::Takeover;
use super::drive_status::{DrivePoll, DriveStatus, GONE_ATTEMPTS, Round, is_energised};
use super::pdo_layout::Feedback;
use super::plan::{AxisEvent, AxisPlan};
use super::power::Stop;
use super::script::Script;
use super::takeover::{FirstContact, Situation};
use crate::guard::terms::GuardInput;

/// Pause between two equal NMT commands to a node that does not report their effect; longer than
/// its heartbeat takes to show the effect of the first one.
const NMT_PAUSE_NS: u64 = 500_000_000;

/// Attempts without an answer after which the node of a drive may be in NMT Stopped, if it has no life sign. Process
/// data have carried a stop for 200 ms by then.
const WAKE_ATTEMPTS: u32 = 2;

/// Parts of the connection to a drive that work, by the last status.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Reachability {
    pub(crate) gateway: bool,
    heartbeat: bool,
    /// The node is in Operational, if the host has a report of its state.
    pub(crate) operational: bool,
}

impl Reachability {
    fn of(input: &GuardInput) -> Self {
        Self {
            gateway: input.path.is_ready,
            heartbeat: !input.drive.heartbeat_lost,
            operational: !input.drive.not_operational,
        }
    }

    /// Returns whether a part of the connection is lost since `before`; a part that remains lost
    /// does not count, so that a verification can complete.
    fn is_lost_since(self, before: Self) -> bool {
        before.gateway && !self.gateway
            || before.heartbeat && !self.heartbeat
            || before.operational && !self.operational
    }
}

/// Connection of an axis with its drive.
#[derive(Debug)]
pub(crate) struct DriveLink {
    drive: DriveStatus,
    poll: DrivePoll,
    contact: FirstContact,
    reachability: Reachability,
    /// Longest age of a present status.
    fresh_ns: u64,
    /// Earliest time of the next NMT start command.
    next_start_ns: u64,
    /// Earliest time of the next NMT command to a node that may be in Stopped.
    next_wake_ns: u64,
}

impl DriveLink {
    pub(crate) fn new(plan: &AxisPlan) -> Self {
        Self {
            drive: DriveStatus::default(),
            poll: DrivePoll::new(plan.config.node_axis),
            contact: FirstContact::default(),
            reachability: Reachability::default(),
            fresh_ns: plan.fresh_ns,
            next_start_ns: 0,
            next_wake_ns: 0,
        }
    }

    /// What the drive reported last.
    pub(crate) fn drive(&self) -> &DriveStatus {
        &self.drive
    }

    pub(crate) fn reachability(&self) -> Reachability {
        self.reachability
    }

    pub(crate) fn begin_cycle(&mut self) {
        self.drive.arrived = None;
    }

    /// Stores the content of the first TPDO.
    pub(crate) fn store_feedback(&mut self, feedback: Feedback) {
        self.drive.arrived = Some(feedback);
    }

    /// Evaluates the TPDO of this cycle.
    #[inline]
    pub(crate) fn update(&mut self, plan: &AxisPlan, now_ns: u64) {
        self.drive.update(plan.config.range, plan.config.standstill, now_ns);
    }

    /// Stores which parts of the connection work. Returns whether one was lost in this cycle.
    #[inline]
    pub(crate) fn update_reachability(&mut self, input: &GuardInput) -> bool {
        let before = std::mem::replace(&mut self.reachability, Reachability::of(input));
        self.reachability.is_lost_since(before)
    }

    /// Forgets the status that the drive reported under another configuration.
    pub(crate) fn forget_drive(&mut self) {
        self.drive.forget();
    }

    /// Restarts the detection of standstill: only later positions count.
    pub(crate) fn restart_rest(&mut self) {
        self.drive.rest.restart();
    }

    /// Returns whether the drive ever reported its state.
    pub(crate) fn has_reported(&self) -> bool {
        self.drive.heard_ns.is_some()
    }

    /// Returns whether the last status of the drive is present.
    pub(crate) fn is_fresh(&self, now_ns: u64) -> bool {
        self.drive.is_fresh(now_ns, self.fresh_ns)
    }

    /// Returns whether present positions show the drive at rest.
    pub(crate) fn is_at_rest(&self, now_ns: u64) -> bool {
        self.drive.is_at_rest(now_ns, self.fresh_ns)
    }

    /// Returns whether the drive reported earlier, may have moved then, and has no present status.
    pub(crate) fn is_silent_in_motion(&self, now_ns: u64) -> bool {
        self.drive.state.is_none_or(is_energised) && self.has_reported() && !self.is_fresh(now_ns)
    }

    /// Returns whether the drive is off and its motor was not seen at rest: two positions of a short cycle do
    /// not show a slow motion.
    pub(crate) fn coasts(&self, now_ns: u64) -> bool {
        self.drive.state == Some(ecan_canopen::DriveState::SwitchOnDisabled)
            && !self.drive.rest.is_empty()
            && !self.is_at_rest(now_ns)
    }

    /// Returns whether the drive cannot be reached at present.
    pub(crate) fn is_gone(&self) -> bool {
        !self.reachability.gateway || self.poll.unanswered() >= GONE_ATTEMPTS
    }

    /// Returns whether the drive answered no SDO transfer, or only that it lacks an object.
    pub(crate) fn is_absent(&self) -> bool {
        self.poll.is_answered() || self.poll.unanswered() >= GONE_ATTEMPTS
    }

    // SDO transfers

    pub(crate) fn is_polling(&self) -> bool {
        self.poll.is_running()
    }

    pub(crate) fn cancel_poll(&mut self, plan: &AxisPlan, network: &mut Network) {
        self.poll.cancel(network, plan.node);
    }

    /// Content of the SDO transfers with a drive: the command of a stop, or an inspection.
    pub(crate) fn next_round(&self, plan: &AxisPlan, stop: Option<&Stop>, now_ns: u64) -> Round {
        match stop {
            Some(stop) => {
                let state = self.drive.state.filter(|_| self.is_fresh(now_ns));
                let command = stop.command(state, self.is_at_rest(now_ns));
                Round::Stop(command.map(Controlword::of))
            }
            None if plan.takeover == Takeover::Adopt => {
                Round::InspectForAdoption(plan.kept_position())
            }
            None => Round::Inspect,
        }
    }

    /// Continues the SDO transfers with the drive. Returns whether it answered all of a round.
    pub(crate) fn step_poll(
        &mut self,
        plan: &AxisPlan,
        network: &mut Network,
        now_ns: u64,
        round: Round,
    ) -> bool {
        let Self { poll, drive, contact, .. } = self;
        let config = &plan.config;
        poll.step(network, plan.node, now_ns, round, |index, value| match index {
            object::STATUSWORD => drive.store_statusword(Statusword(value as u16), now_ns),
            object::POSITION_ACTUAL => {
                drive.rest.observe(value as i32, config.range, config.standstill, now_ns);
            }
            _ => contact.note_object(index, value),
        })
    }

    /// Returns whether the node may be in NMT Stopped, by the number of attempts without an answer.
    pub(crate) fn needs_wake(&self) -> bool {
        self.poll.unanswered() >= WAKE_ATTEMPTS
    }

    // First contact

    pub(crate) fn contact(&self) -> &FirstContact {
        &self.contact
    }

    /// Begins the first contact again: the state of the drive is to be read.
    pub(crate) fn restart_contact(&mut self) {
        self.contact.restart();
    }

    pub(crate) fn begin_adoption(&mut self, verification: Script, target: i32) {
        self.contact.begin_adoption(verification, target);
    }

    /// Counts a sent command, which may be a frame of an adoption.
    pub(crate) fn count_frame(&mut self) {
        self.contact.count_frame();
    }

    /// Notes a SYNC on the channel of the axis.
    pub(crate) fn note_sync(&mut self) {
        self.contact.note_sync();
    }

    /// Continues the first contact with the drive.
    pub(crate) fn step_contact(
        &mut self,
        plan: &AxisPlan,
        situation: Situation,
        network: &mut Network,
        next_verification: impl FnOnce() -> Option<Script>,
    ) -> Option<AxisEvent> {
        let Self { contact, drive, poll, .. } = self;
        contact.step(plan, situation, drive, poll, network, next_verification)
    }

    /// Notes that a drive has sent something. If it never answered before, its state is to be read.
    pub(crate) fn on_life_sign(&mut self, is_setup_pending: bool) {
        let is_unknown = !self.has_reported() && !self.poll.is_answered();
        if is_unknown && self.contact.is_done() && !is_setup_pending {
            self.contact.restart();
        }
    }

    // NMT

    /// Starts a node that lost the host's heartbeat: it is in Pre-operational (CiA 301, 0x1029)
    /// and remains there until it receives the NMT command.
    pub(crate) fn start_node(&mut self, plan: &AxisPlan, network: &mut Network, now_ns: u64) {
        // Without heartbeat only missing TPDOs show a node that is not Operational.
        let reports_state = network.status(plan.node).is_some_and(|node| node.nmt_state.is_some());
        let is_silent = !reports_state && !self.is_fresh(now_ns);
        let is_stopped = !self.reachability.operational || is_silent;
        if is_stopped && now_ns >= self.next_start_ns {
            self.next_start_ns = now_ns.saturating_add(NMT_PAUSE_NS);
            // If the queue is full, the next attempt follows after the pause.
            let _ = network.nmt(plan.node, NmtCommand::Start);
        }
    }

    /// Commands Pre-operational to a node that does not answer SDO requests and is, or may be, in NMT
    /// Stopped, where it has no SDO server. Without a life sign nothing reports that state, and another
    /// master may have commanded it; a node that sends TPDOs is not in it. `is_heard` states whether an
    /// axis of the node has a present status.
    pub(crate) fn wake_node(
        &mut self,
        plan: &AxisPlan,
        network: &mut Network,
        is_heard: bool,
        now_ns: u64,
    ) {
        let Some(status) = network.status(plan.node) else { return };
        let is_unwatched = matches!(status.heartbeat, Heartbeat::Unconfigured | Heartbeat::Unknown);
        let is_silent = !self.is_fresh(now_ns) && !is_heard;
        let may_be_stopped = status.nmt_state == Some(NmtState::Stopped)
            || is_unwatched && is_silent && self.reachability.gateway;
        if may_be_stopped && now_ns >= self.next_wake_ns {
            self.next_wake_ns = now_ns.saturating_add(NMT_PAUSE_NS);
            // If the queue is full, the next attempt follows after the pause.
            let _ = network.nmt(plan.node, NmtCommand::EnterPreOperational);
        }
    }
}

/// Returns whether a node is not in Operational. A node with a heartbeat reports its state; of another one, and
/// before the first heartbeat, only the last command is known.
pub(crate) fn has_left_operational(status: &NodeStatus) -> bool {
    let state = match status.heartbeat {
        Heartbeat::Unconfigured | Heartbeat::Unknown => status.expected_nmt_state,
        Heartbeat::Active | Heartbeat::TimedOut => status.nmt_state,
    };
    state.is_some_and(|state| state != NmtState::Operational)
}
