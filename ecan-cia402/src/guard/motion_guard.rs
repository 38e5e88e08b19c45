//! "Nothing jumps": when an axis may get a target, and which.

use ecan_canopen::DriveState;

use super::drain::Drain;
use super::input::{Actual, ChannelView, GuardInput, HoldReason, PositionUnavailable};
use super::position_range::PositionRange;
use super::terms::{Decision, GuardLimits, GuardState, TargetKind, TargetRejection, WaitReason};

/// Keeps an axis from jumping. A pure state machine: no time, no frames, no memory of the bus; it
/// is told what each cycle brought and says what may go out.
///
/// In each cycle [`observe`](Self::observe) comes first, once, then [`decide`](Self::decide) with the
/// application's target, then [`sent`](Self::sent) if the frame was taken by the Port, and
/// [`refused`](Self::refused) if not. All are real-time safe.
///
/// # What happens when
///
/// **Taking up** ([`take_up`](Self::take_up), from any state but `Armed` and `Running`):
/// 1. `Draining`. Nothing goes out. It ends when every frame that was sent before is known to
///    have left the gateway: the gateway is in service, no image is held, the channel runs
///    without transmit pressure, its count of waiting frames is not at its end (7) and not
///    larger than the number of frames delivered behind the last target, by a status word that
///    is at least two images newer. Bus-off, a held image, discarded frames or a lost session
///    start it over.
/// 2. `Reading`. Nothing goes out. Two [`Actual::Fresh`] positions in different cycles are needed,
///    at most `standstill` apart: the second was produced after the first was read, so after the
///    drain, and the axis stands. A position further away becomes the first of a new pair.
/// 3. `Armed`. While the drive is not enabled, [`Decision::Track`] with the fresh position of the
///    cycle accompanies the control commands; in cycles without one nothing goes out. An axis that
///    moves more than `standstill` between two fresh positions goes back to `Reading`. Once the
///    statusword says Operation Enabled, the fresh position of that cycle is
///    [`Decision::First`], and with it sent the axis is `Running`. An axis whose drive was enabled
///    all the time gets its `First` at once, unless it stands further than `step` from the last
///    target: then the drive must be switched off and enabled anew
///    ([`WaitReason::HoldsOldTarget`]).
///
/// **Running**. A target goes out if
/// - it is at most `step` from the last one sent ([`TargetRejection::Step`]),
/// - it is at most `window` from the last known actual position ([`TargetRejection::Window`]),
/// - it is inside `bounds`, or nearer to them than the last one ([`TargetRejection::Bounds`]),
/// - the working counter of this cycle is complete, no image is held, the last one had room for
///   every frame of the channel, and this cycle has had no target yet ([`Decision::Wait`]).
///
/// A target not taken changes nothing: the next is judged against the last one *sent*. So an
/// application that goes on by itself while nothing is sent is refused, not followed.
///
/// **Holding**. From `Armed` and `Running` the axis holds, and no target goes out until it is taken
/// up again, when
///
/// | what happened | reason |
/// | --- | --- |
/// | the gateway went out of service (OP lost, hold limit of the Port passed) | `GatewayLost` |
/// | frames for the gateway were given up, by whomever | `FramesDiscarded` |
/// | the working counter was incomplete in more than `wc_misses` cycles in a row; fewer only make it wait, while the Port repeats the last image | `WorkingCounter` |
/// | the channel went bus-off, or left the bus otherwise | `BusOff`, `ChannelStopped` |
/// | the transmit queue refused a frame of the channel, of whichever axis or sender | `QueueFull` |
/// | the gateway reported a target of the axis as not sent | `TargetLost` |
/// | the heartbeat that is watched timed out | `HeartbeatLost` |
/// | the drive was out of sight and its configuration is not verified yet | `Unverified` |
/// | the node restarted, or is known not to be Operational | `NotOperational` |
/// | no usable TPDO came in more than `tpdo_timeout` cycles in a row; a TPDO of an incomplete or changed image, or behind a backlog, is not usable | `TpdoLost` |
///
/// and from `Running` also when
///
/// | what happened | reason |
/// | --- | --- |
/// | the statusword says anything but Operation Enabled | `LeftOperationEnabled` |
/// | statusword bit 12 was set and fell: the drive stopped following | `NotFollowing` |
/// | statusword bit 13: the drive reports a following error | `FollowingError` |
///
/// While being taken up the same events only keep the guard from getting further.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MotionGuard {
    limits: GuardLimits,
    state: GuardState,
    drain: Drain,
    /// The first of the two positions of `Reading`.
    first: Option<i32>,
    /// The fresh position of this cycle.
    fresh: Option<i32>,
    /// The last usable actual position, and how many cycles ago it came.
    actual: Option<i32>,
    actual_age: u16,
    no_actual: PositionUnavailable,
    misses: u16,
    waits: Option<WaitReason>,
    hindrance: Option<HoldReason>,
    is_enabled: bool,
    was_following: bool,
    decided: Option<i32>,
    /// The last target sent since the drive was seen not enabled: the one that it holds.
    held: Option<i32>,
    last_sent: Option<i32>,
}

impl MotionGuard {
    /// A guard over an axis that is not taken up.
    pub fn new(limits: GuardLimits) -> Self {
        Self {
            limits,
            state: GuardState::Idle,
            drain: Drain::default(),
            first: None,
            fresh: None,
            actual: None,
            actual_age: u16::MAX,
            no_actual: PositionUnavailable::NoTpdo,
            misses: 0,
            waits: None,
            hindrance: None,
            is_enabled: false,
            was_following: false,
            decided: None,
            held: None,
            last_sent: None,
        }
    }

    /// Where it stands.
    pub fn state(&self) -> GuardState {
        self.state
    }

    /// The rules in force.
    pub fn limits(&self) -> &GuardLimits {
        &self.limits
    }

    /// Changes the rules. The axis holds as after [`release`](Self::release): what was true under
    /// the old rules need not be under the new ones.
    pub fn set_limits(&mut self, limits: GuardLimits) {
        self.limits = limits;
        self.release();
    }

    /// The last usable actual position, however old.
    pub fn actual(&self) -> Option<i32> {
        self.actual
    }

    /// Cycles since the last usable actual position came; 65535 for many or never.
    pub fn actual_age(&self) -> u16 {
        self.actual_age
    }

    /// What keeps an axis that is being taken up from getting further; `None` where it only takes
    /// its time, or is not being taken up.
    pub fn hindrance(&self) -> Option<HoldReason> {
        self.hindrance
    }

    /// Whether this very cycle brought a fresh actual position.
    pub fn is_fresh(&self) -> bool {
        self.fresh.is_some()
    }

    /// A target that moves nothing, to accompany a command that stops or resets the drive: the
    /// actual position of a drive that is not enabled, else the last target sent. `None` while
    /// neither is known.
    pub fn resting_target(&self) -> Option<i32> {
        if self.is_enabled && self.held.is_some() {
            return self.held;
        }
        match self.state {
            GuardState::Armed { target } | GuardState::Running { target } => Some(target),
            _ if self.limits.kind == TargetKind::Rate => Some(0),
            _ => self.last_sent.or(self.actual),
        }
    }

    /// Begins to take the axis up from its actual position. Does nothing while it is being taken
    /// up, or is.
    pub fn take_up(&mut self) {
        if matches!(self.state, GuardState::Idle | GuardState::Holding { .. }) {
            self.begin_take_up();
        }
    }

    fn begin_take_up(&mut self) {
        self.state = GuardState::Draining;
        self.drain = Drain::default();
        self.first = None;
        self.decided = None;
        self.was_following = false;
    }

    /// The axis is meant to rest: no targets, and nothing that must be taken up again.
    pub fn release(&mut self) {
        self.state = GuardState::Idle;
        self.decided = None;
    }

    /// The application stops the axis: no targets until it is taken up again.
    pub fn hold(&mut self) {
        self.trip(HoldReason::Commanded);
    }

    fn trip(&mut self, reason: HoldReason) {
        self.state = GuardState::Holding { reason };
        self.decided = None;
    }

    /// First in the cycle: what it brought. Gives the reason when the axis begins to hold.
    pub fn observe(&mut self, input: &GuardInput) -> Option<HoldReason> {
        self.decided = None;
        self.note(input);
        match self.state {
            GuardState::Idle | GuardState::Holding { .. } => None,
            GuardState::Draining => {
                if self.drain.step(&input.way, self.limits.drain_images) {
                    self.state = GuardState::Reading;
                }
                None
            }
            GuardState::Reading => {
                self.read(input);
                None
            }
            GuardState::Armed { target } => {
                let reason = self.way_broken(input).or_else(|| self.drive_lost(input));
                match (reason, self.fresh) {
                    (Some(reason), _) => self.trip(reason),
                    (None, Some(position)) => self.follow_by_hand(target, position),
                    (None, None) => {}
                }
                reason
            }
            GuardState::Running { .. } => {
                let reason = self
                    .way_broken(input)
                    .or_else(|| self.drive_lost(input))
                    .or_else(|| self.drive_left(input));
                if let Some(reason) = reason {
                    self.trip(reason);
                }
                self.was_following |= input.drive.follows;
                reason
            }
        }
    }

    /// Takes notice of what every state needs.
    fn note(&mut self, input: &GuardInput) {
        self.fresh = None;
        self.actual_age = self.actual_age.saturating_add(1);
        match input.actual {
            Actual::Fresh(position) => {
                self.fresh = Some(position);
                self.actual = Some(position);
                self.actual_age = 0;
            }
            Actual::Late(position) => {
                self.actual = Some(position);
                self.actual_age = 0;
            }
            Actual::None(why) => self.no_actual = why,
        }
        let way = &input.way;
        self.misses = if way.complete { 0 } else { self.misses.saturating_add(1) };
        self.waits = if way.holding {
            Some(WaitReason::ImageHeld)
        } else if !way.complete {
            Some(WaitReason::WorkingCounter)
        } else if way.image_full {
            Some(WaitReason::ImageFull)
        } else {
            None
        };
        self.is_enabled = input.drive.state == Some(DriveState::OperationEnabled);
        if !self.is_enabled {
            self.held = None;
        }
        self.hindrance = match self.state {
            GuardState::Draining | GuardState::Reading => {
                self.way_broken(input).or_else(|| self.drive_lost(input))
            }
            _ => None,
        };
    }

    /// The way to the drive lost its trust.
    fn way_broken(&self, input: &GuardInput) -> Option<HoldReason> {
        let way = &input.way;
        if !way.in_service {
            return Some(HoldReason::GatewayLost);
        }
        if way.discarded {
            return Some(HoldReason::FramesDiscarded);
        }
        match way.channel {
            ChannelView::BusOff => return Some(HoldReason::BusOff),
            ChannelView::NotRunning => return Some(HoldReason::ChannelStopped),
            ChannelView::NotSeen | ChannelView::Running { .. } => {}
        }
        if way.queue_refused {
            return Some(HoldReason::QueueFull);
        }
        if way.target_lost {
            return Some(HoldReason::TargetLost);
        }
        (self.misses > self.limits.wc_misses).then_some(HoldReason::WorkingCounter)
    }

    /// The drive is not heard any more.
    fn drive_lost(&self, input: &GuardInput) -> Option<HoldReason> {
        let drive = &input.drive;
        if drive.heartbeat_lost {
            return Some(HoldReason::HeartbeatLost);
        }
        if drive.unverified {
            return Some(HoldReason::Unverified);
        }
        if drive.not_operational {
            return Some(HoldReason::NotOperational);
        }
        let is_lost = self.actual_age > self.limits.tpdo_timeout;
        is_lost.then_some(HoldReason::TpdoLost(self.no_actual))
    }

    /// The drive does not follow any more.
    fn drive_left(&self, input: &GuardInput) -> Option<HoldReason> {
        let drive = &input.drive;
        if !self.is_enabled {
            let state = drive.state.unwrap_or(DriveState::NotReadyToSwitchOn);
            return Some(HoldReason::LeftOperationEnabled(state));
        }
        if drive.following_error {
            return Some(HoldReason::FollowingError);
        }
        (self.was_following && !drive.follows).then_some(HoldReason::NotFollowing)
    }

    fn read(&mut self, input: &GuardInput) {
        if self.way_broken(input).is_some() {
            // Nothing was sent since the drain, but what broke the way may have broken that too.
            return self.begin_take_up();
        }
        if self.drive_lost(input).is_some() {
            self.first = None;
            return;
        }
        let Some(position) = self.fresh else { return };
        match self.first {
            Some(first) if self.is_at_rest(first, position) => {
                self.first = None;
                self.state = GuardState::Armed { target: self.starting_target(position) };
            }
            _ => self.first = Some(position),
        }
    }

    /// `Armed`: the target follows the axis while it rests.
    fn follow_by_hand(&mut self, before: i32, position: i32) {
        let is_position = self.limits.kind != TargetKind::Rate;
        if is_position && !self.is_at_rest(before, position) {
            self.state = GuardState::Reading;
            self.first = Some(position);
        } else {
            self.state = GuardState::Armed { target: self.starting_target(position) };
        }
    }

    fn is_at_rest(&self, before: i32, now: i32) -> bool {
        let way = self.limits.range.distance(before, now).unsigned_abs();
        way <= u64::from(self.limits.standstill)
    }

    fn starting_target(&self, position: i32) -> i32 {
        if self.limits.kind == TargetKind::Rate { 0 } else { position }
    }

    /// Whether frames of before that are still on the host should be given up now: the working
    /// counter made the axis hold, and the image that is repeated carries an old target.
    pub fn wants_discard(&self) -> bool {
        self.misses > self.limits.wc_misses
            && self.waits == Some(WaitReason::ImageHeld)
            && self.state == GuardState::Holding { reason: HoldReason::WorkingCounter }
    }

    /// Second in the cycle: what may go out. `wanted` is the application's target; without one
    /// the last target goes out again.
    pub fn decide(&mut self, wanted: Option<i32>) -> Decision {
        let decision = self.judge(wanted);
        self.decided = decision.target();
        decision
    }

    fn judge(&self, wanted: Option<i32>) -> Decision {
        match self.state {
            GuardState::Armed { target } => {
                if let Some(reason) = self.waits {
                    Decision::Wait(reason)
                } else if self.fresh.is_none() {
                    Decision::Wait(WaitReason::NoFreshPosition)
                } else if self.is_enabled && self.holds_old_target(target) {
                    Decision::Wait(WaitReason::HoldsOldTarget)
                } else if self.is_enabled {
                    Decision::First(target)
                } else {
                    Decision::Track(target)
                }
            }
            GuardState::Running { target } => {
                if let Some(reason) = self.waits {
                    return Decision::Wait(reason);
                }
                let next = wanted.unwrap_or(target);
                match self.check(target, next) {
                    Ok(()) => Decision::Target(next),
                    Err(refusal) => Decision::Refuse(refusal),
                }
            }
            _ => Decision::Closed,
        }
    }

    /// Whether a first target would be further than a step from the one that the drive holds.
    fn holds_old_target(&self, first: i32) -> bool {
        let range = match self.limits.kind {
            TargetKind::Position => self.limits.range,
            TargetKind::Rate => PositionRange::Linear,
            TargetKind::Profile | TargetKind::None => return false,
        };
        self.held.is_some_and(|held| {
            range.distance(held, first).unsigned_abs() > u64::from(self.limits.step)
        })
    }

    fn check(&self, last: i32, next: i32) -> Result<(), TargetRejection> {
        let limits = &self.limits;
        if limits.kind == TargetKind::None && next != last {
            return Err(TargetRejection::NoTargets);
        }
        // A rate has no counter that could wrap.
        let range =
            if limits.kind == TargetKind::Rate { PositionRange::Linear } else { limits.range };
        if !range.contains(next) {
            return Err(TargetRejection::Counter { target: next });
        }
        if let Some((min, max)) = limits.bounds
            && beyond(next, min, max) > 0
            && beyond(next, min, max) >= beyond(last, min, max).max(1)
            && next != last
        {
            return Err(TargetRejection::Bounds { target: next, min, max });
        }
        if matches!(limits.kind, TargetKind::Position | TargetKind::Rate) {
            let step = range.distance(last, next);
            if step.unsigned_abs() > u64::from(limits.step) {
                return Err(TargetRejection::Step { step, limit: limits.step });
            }
        }
        if limits.kind == TargetKind::Position {
            let distance = self.actual.map_or(i64::MAX, |actual| range.distance(actual, next));
            if distance.unsigned_abs() > u64::from(limits.window) {
                return Err(TargetRejection::Window { distance, window: limits.window });
            }
        }
        Ok(())
    }

    /// The frame with the target of [`decide`](Self::decide) was taken by the Port.
    pub fn sent(&mut self) {
        let Some(target) = self.decided.take() else { return };
        self.waits = Some(WaitReason::Spent);
        self.last_sent = Some(target);
        self.held = Some(target);
        match self.state {
            GuardState::Armed { .. } if self.is_enabled => {
                self.state = GuardState::Running { target };
                self.was_following = false;
            }
            GuardState::Running { .. } => self.state = GuardState::Running { target },
            _ => {}
        }
    }

    /// The frame with the target of [`decide`](Self::decide) was not taken by the Port. The
    /// target before it stands.
    pub fn refused(&mut self) {
        self.decided = None;
        self.waits = Some(WaitReason::Refused);
    }
}

/// How far outside the bounds a target is, in steps.
fn beyond(target: i32, min: i32, max: i32) -> i64 {
    let target = i64::from(target);
    (i64::from(min) - target).max(target - i64::from(max)).max(0)
}
