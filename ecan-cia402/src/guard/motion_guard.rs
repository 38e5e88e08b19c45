//! Decision when an axis gets a target, and which.

use ecan_canopen::DriveState;

use super::drain::Drain;
use super::terms::{
    Actual, ChannelView, Decision, GuardInput, GuardLimits, GuardState, HoldReason, PositionRange,
    PositionUnavailable, TargetKind, TargetRejection, WaitReason,
};

/// Positions at rest before the one that ends `Reading`. Each may be one cycle older than it could
/// be.
const READINGS: u8 = 2;

/// Cycles, apart from those of the drain, from the sample of a position until a target made of it takes effect: the
/// drive must rest for so long that it is still there.
const EFFECT_CYCLES: u16 = 2;

/// Prevents jumps of an axis: decides when it gets a target, and which. A pure state machine
/// without time, frames and memory of the bus; its input is the status of each cycle.
///
/// In each cycle, call [`observe`](Self::observe) once, then [`decide`](Self::decide) with the
/// application's target, then [`sent`](Self::sent) if the Port accepted the frame, or
/// [`rejected`](Self::rejected) if not. All are real-time safe.
///
/// # States
///
/// **Activation** ([`activate`](Self::activate), from any state but `Armed` and `Running`):
/// 1. `Draining`. Nothing is sent. It ends when every frame that was sent before has certainly
///    left the gateway: the gateway is ready, no image is unconfirmed, the channel runs without
///    transmit pressure, its count of waiting frames is not saturated (7) and not larger than the
///    number of frames confirmed after the last target, by a status word that is at least two
///    images newer. Bus-off, an unconfirmed image, discarded frames or a lost session restart it.
/// 2. `Reading`. Nothing is sent. It needs [`Actual::Fresh`] positions of three cycles, each at most
///    `standstill` from the first and from the one before: the third was produced after the first was read, so after
///    the drain, and the axis is at standstill. A position further away becomes the first. The last one comes at
///    least `drain_images` + 2 cycles after the first, the time until a target takes effect: an axis that moves
///    slowly would be elsewhere by then.
/// 3. `Armed`. While the drive is not enabled, [`Decision::Track`] with the fresh position of the
///    cycle accompanies the control commands; in cycles without one nothing is sent. An axis that
///    moves more than `standstill` in that time returns to `Reading`. When the
///    statusword reports Operation Enabled, the fresh position of that cycle is
///    [`Decision::First`]; after it is sent, the axis is `Running`. If the drive was enabled before and its last
///    target is inside the bounds, a position beyond them by `standstill` or less is moved to the bound. An axis whose drive was enabled
///    all the time gets its `First` at once, unless it is further than `step` from the last
///    target, after a reason on the path also from the one before, since the last may be lost: then
///    the drive must be switched off and enabled again
///    ([`WaitReason::HoldsOldTarget`]).
///
/// **Running**. A target is sent if
/// - it is at most `step` from the last one sent ([`TargetRejection::Step`]),
/// - it is at most `window` from the last known actual position ([`TargetRejection::Window`]),
/// - it is inside `bounds`, or nearer to them than the last one ([`TargetRejection::Bounds`]),
/// - the working counter of this cycle is complete, no image is unconfirmed, the last one had space
///   for every frame of the channel, no frames of earlier images wait in the gateway, and this cycle
///   had no target yet ([`Decision::Wait`]).
///
/// A rejected target changes nothing: the next is compared with the last one *sent*. An
/// application that continues its motion while nothing is sent gets rejections; the axis does not
/// follow it.
///
/// **Holding**. From `Armed` and `Running` the axis holds, and no target is sent until it is
/// activated again, when
///
/// | event | reason |
/// | --- | --- |
/// | the gateway is no longer ready (OP lost, hold limit of the Port exceeded) | `GatewayLost` |
/// | frames for the gateway were discarded, by any part of the application | `FramesDiscarded` |
/// | the working counter was incomplete in more than `wc_misses` cycles in a row, skipped ones included; after fewer the axis only waits, while the Port repeats the last image | `WorkingCounter` |
/// | the channel went bus-off, or left the bus otherwise | `BusOff`, `ChannelStopped` |
/// | the transmit queue rejected a frame of the channel, of any axis or sender | `QueueFull` |
/// | the gateway reported a target of the axis as not sent | `TargetLost` |
/// | the watched heartbeat timed out | `HeartbeatLost` |
/// | the connection to the drive was lost and its configuration is not verified yet | `Unverified` |
/// | the node restarted, or is not Operational | `NotOperational` |
/// | no usable TPDO arrived in more than `tpdo_timeout` cycles in a row; a TPDO of an incomplete or changed image, or after a backlog, is not usable | `TpdoLost` |
///
/// and from `Running` also when
///
/// | event | reason |
/// | --- | --- |
/// | the statusword reports anything but Operation Enabled | `LeftOperationEnabled` |
/// | statusword bit 12 was set and fell: the drive stopped following | `NotFollowing` |
/// | statusword bit 13: the drive reports a following error | `FollowingError` |
/// | TPDOs were missing for two SYNC periods or more, no target was sent for more than four target periods, and a drive that follows positions is not at rest at its last target | `NotAtTarget` |
///
/// During activation the same events only delay the guard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MotionGuard {
    limits: GuardLimits,
    state: GuardState,
    drain: Drain,
    standstill: Standstill,
    fresh: Option<i32>,
    /// The last usable actual position, and how many cycles ago it came.
    actual: Option<i32>,
    actual_age: u16,
    no_actual: PositionUnavailable,
    misses: u16,
    /// Incomplete working counters in a row before this cycle ended them, with those of skipped cycles.
    longest_misses: u16,
    waits: Option<WaitReason>,
    hindrance: Option<HoldReason>,
    is_enabled: bool,
    was_following: bool,
    decided: Option<i32>,
    sent: SentTargets,
}

/// Standstill of an axis in `Reading` and `Armed`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Standstill {
    /// Number of positions of `Reading` at rest.
    readings: u8,
    /// Position from which the axis has not moved more than `standstill`, and how many cycles ago it came.
    anchor: i32,
    anchor_age: u16,
    last_position: i32,
}

impl Standstill {
    fn set_anchor(&mut self, position: i32) {
        (self.anchor, self.anchor_age, self.last_position) = (position, 0, position);
    }

    /// Returns whether a position shows the axis at rest.
    fn includes(&self, position: i32, limits: &GuardLimits) -> bool {
        let is_near = |before: i32| {
            let distance = limits.range.distance(before, position).unsigned_abs();
            distance <= u64::from(limits.standstill)
        };
        is_near(self.anchor) && is_near(self.last_position)
    }
}

/// Targets that were sent, and which of them the drive holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct SentTargets {
    last: Option<i32>,
    /// The last target sent since the drive was seen not enabled: the one that it holds.
    held: Option<i32>,
    /// The target sent before: the drive holds it if the last image was lost.
    held_before: Option<i32>,
    /// The axis held for a reason on the path: the drive may not have received its last targets.
    may_be_lost: bool,
    /// Actual position of an axis with lost targets when its stop began, in a position mode.
    rest: Option<i32>,
}

impl SentTargets {
    fn push(&mut self, target: i32) {
        self.last = Some(target);
        self.held_before = self.held.replace(target);
        self.may_be_lost = false;
        self.rest = None;
    }

    /// Targets that the drive may hold.
    fn possible(&self) -> impl Iterator<Item = i32> {
        self.held.into_iter().chain(self.held_before.filter(|_| self.may_be_lost))
    }
}

impl MotionGuard {
    /// Creates a guard of an axis that is not active.
    pub fn new(limits: GuardLimits) -> Self {
        Self {
            limits,
            state: GuardState::Idle,
            drain: Drain::default(),
            standstill: Standstill::default(),
            fresh: None,
            actual: None,
            actual_age: u16::MAX,
            no_actual: PositionUnavailable::NoTpdo,
            misses: 0,
            longest_misses: 0,
            waits: None,
            hindrance: None,
            is_enabled: false,
            was_following: false,
            decided: None,
            sent: SentTargets::default(),
        }
    }

    /// Current state.
    pub fn state(&self) -> GuardState {
        self.state
    }

    /// Limits in force.
    pub fn limits(&self) -> &GuardLimits {
        &self.limits
    }

    /// Changes the limits. The axis becomes idle as after [`release`](Self::release), since its
    /// state may not meet the new limits.
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

    /// Reason that delays the activation; `None` if nothing does, or without an activation.
    pub fn hindrance(&self) -> Option<HoldReason> {
        self.hindrance
    }

    /// A target that moves nothing, to accompany a command that stops or resets the drive: the
    /// actual position of a drive that is not enabled, or that may not have received its last targets, else
    /// the last target sent. `None` if neither
    /// is known.
    pub fn resting_target(&self) -> Option<i32> {
        if self.is_enabled && self.sent.held.is_some() {
            return self.sent.rest.or(self.sent.held);
        }
        match self.state {
            GuardState::Armed { target } | GuardState::Running { target } => Some(target),
            _ if self.limits.kind == TargetKind::Rate => Some(0),
            _ => self.sent.last.or(self.actual),
        }
    }

    /// The drive is being stopped: fixes the target that accompanies the commands.
    pub(crate) fn begin_stop(&mut self) {
        if self.sent.may_be_lost && self.limits.kind == TargetKind::Position {
            self.sent.rest = self.sent.rest.or(self.actual);
        }
    }

    /// Starts to activate the axis at its actual position. Does nothing if it is active or the
    /// activation runs.
    pub fn activate(&mut self) {
        if matches!(self.state, GuardState::Idle | GuardState::Holding { .. }) {
            self.begin_activation();
        }
    }

    /// Begins a running activation again: a position that was read before does not count.
    pub(crate) fn restart_activation(&mut self) {
        if matches!(
            self.state,
            GuardState::Draining | GuardState::Reading | GuardState::Armed { .. }
        ) {
            self.begin_activation();
        }
    }

    fn begin_activation(&mut self) {
        self.state = GuardState::Draining;
        self.drain = Drain::default();
        self.standstill.readings = 0;
        self.decided = None;
        self.was_following = false;
    }

    /// Ends targets: the axis becomes idle, not holding.
    pub fn release(&mut self) {
        self.state = GuardState::Idle;
        self.decided = None;
    }

    /// Holds on command of the application: no targets until the axis is activated again.
    pub fn hold(&mut self) {
        self.trip(HoldReason::Commanded);
    }

    /// The drive is not at its last target: others were lost.
    pub(crate) fn lose_target(&mut self) -> HoldReason {
        self.trip(HoldReason::NotAtTarget);
        HoldReason::NotAtTarget
    }

    fn trip(&mut self, reason: HoldReason) {
        self.state = GuardState::Holding { reason };
        self.sent.may_be_lost |= reason.is_on_path();
        self.decided = None;
    }

    /// Takes the input of a cycle, first in the cycle. Returns the reason if the axis begins to hold.
    pub fn observe(&mut self, input: &GuardInput) -> Option<HoldReason> {
        self.decided = None;
        self.note(input);
        match self.state {
            GuardState::Idle | GuardState::Holding { .. } => None,
            GuardState::Draining => {
                if self.drain.step(&input.path, self.limits.drain_images) {
                    self.state = GuardState::Reading;
                }
                None
            }
            GuardState::Reading => {
                self.read(input);
                None
            }
            GuardState::Armed { .. } => {
                let reason = self.path_broken(input).or_else(|| self.drive_lost(input));
                match (reason, self.fresh) {
                    (Some(reason), _) => self.trip(reason),
                    (None, Some(position)) => self.track(position),
                    (None, None) => {}
                }
                reason
            }
            GuardState::Running { .. } => {
                let reason = self
                    .path_broken(input)
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

    fn note(&mut self, input: &GuardInput) {
        self.fresh = None;
        self.standstill.anchor_age = self.standstill.anchor_age.saturating_add(1);
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
        let path = &input.path;
        self.longest_misses = self
            .misses
            .saturating_add(path.skipped_incomplete)
            .saturating_add(u16::from(!path.is_complete));
        self.misses = if path.is_complete { 0 } else { self.longest_misses };
        self.waits = if path.is_unconfirmed {
            Some(WaitReason::ImageUnconfirmed)
        } else if !path.is_complete {
            Some(WaitReason::WorkingCounter)
        } else if path.image_full {
            Some(WaitReason::ImageFull)
        } else if path.has_backlog {
            Some(WaitReason::Backlog)
        } else {
            None
        };
        self.is_enabled = input.drive.state == Some(DriveState::OperationEnabled);
        if !self.is_enabled {
            (self.sent.held, self.sent.held_before) = (None, None);
        }
        self.hindrance = match self.state {
            GuardState::Draining | GuardState::Reading => {
                self.path_broken(input).or_else(|| self.drive_lost(input))
            }
            _ => None,
        };
    }

    fn path_broken(&self, input: &GuardInput) -> Option<HoldReason> {
        let path = &input.path;
        if !path.is_ready {
            return Some(HoldReason::GatewayLost);
        }
        if path.discarded {
            return Some(HoldReason::FramesDiscarded);
        }
        match path.channel {
            ChannelView::BusOff => return Some(HoldReason::BusOff),
            ChannelView::NotRunning => return Some(HoldReason::ChannelStopped),
            ChannelView::NotSeen | ChannelView::Running { .. } => {}
        }
        if path.queue_rejected {
            return Some(HoldReason::QueueFull);
        }
        if path.target_lost {
            return Some(HoldReason::TargetLost);
        }
        (self.longest_misses > self.limits.wc_misses).then_some(HoldReason::WorkingCounter)
    }

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
        if self.path_broken(input).is_some() {
            // Nothing was sent since the drain, but the cause may have affected the drain, too.
            return self.begin_activation();
        }
        if self.drive_lost(input).is_some() {
            self.standstill.readings = 0;
            return;
        }
        let Some(position) = self.fresh else { return };
        if self.standstill.readings == 0 || !self.standstill.includes(position, &self.limits) {
            return self.begin_reading(position);
        }
        self.standstill.last_position = position;
        self.standstill.readings = self.standstill.readings.saturating_add(1);
        if self.standstill.readings > READINGS && self.has_rested() {
            self.standstill.set_anchor(position);
            self.state = GuardState::Armed { target: self.starting_target(position) };
        }
    }

    fn begin_reading(&mut self, position: i32) {
        self.state = GuardState::Reading;
        self.standstill.readings = 1;
        self.standstill.set_anchor(position);
    }

    /// Returns whether the axis was at rest for the cycles from the sample of a position until a target made of
    /// it takes effect.
    fn has_rested(&self) -> bool {
        let effect_cycles = self.limits.drain_images.saturating_add(EFFECT_CYCLES);
        self.standstill.anchor_age >= effect_cycles
    }

    /// `Armed`: the target follows the axis while it rests.
    fn track(&mut self, position: i32) {
        let is_position = self.limits.kind != TargetKind::Rate;
        if is_position && !self.standstill.includes(position, &self.limits) {
            return self.begin_reading(position);
        }
        self.standstill.last_position = position;
        if self.has_rested() {
            self.standstill.set_anchor(position);
        }
        self.state = GuardState::Armed { target: self.starting_target(position) };
    }

    fn starting_target(&self, position: i32) -> i32 {
        if self.limits.kind == TargetKind::Rate { 0 } else { position }
    }

    /// Returns whether earlier frames that are still on the host should be discarded now: the working
    /// counter made the axis hold, and the repeated image carries an old target.
    pub fn wants_discard(&self) -> bool {
        self.misses > self.limits.wc_misses
            && self.waits == Some(WaitReason::ImageUnconfirmed)
            && self.state == GuardState::Holding { reason: HoldReason::WorkingCounter }
    }

    /// Decides what is sent, second in the cycle. `requested` is the application's target; without one
    /// the last target is sent again.
    pub fn decide(&mut self, requested: Option<i32>) -> Decision {
        let decision = self.evaluate(requested);
        self.decided = decision.target();
        decision
    }

    /// The decision about a target, without taking it.
    pub(crate) fn evaluate(&self, requested: Option<i32>) -> Decision {
        match self.state {
            GuardState::Armed { target } => {
                if let Some(reason) = self.waits {
                    Decision::Wait(reason)
                } else if self.fresh.is_none() {
                    Decision::Wait(WaitReason::NoFreshPosition)
                } else if self.is_enabled && self.holds_old_target(target) {
                    Decision::Wait(WaitReason::HoldsOldTarget)
                } else if self.is_enabled {
                    Decision::First(self.first_inside(target))
                } else {
                    Decision::Track(target)
                }
            }
            GuardState::Running { target } => {
                if let Some(reason) = self.waits {
                    return Decision::Wait(reason);
                }
                let next = requested.unwrap_or(target);
                match self.check(target, next) {
                    Ok(()) => Decision::Target(next),
                    Err(rejection) => Decision::Reject(rejection),
                }
            }
            _ => Decision::Closed,
        }
    }

    /// The first target of a drive that holds a target inside the bounds: its position may be beyond them by noise or
    /// by the lag of its last motion.
    fn first_inside(&self, position: i32) -> i32 {
        let is_position = self.limits.kind == TargetKind::Position;
        match (self.limits.bounds, self.sent.held) {
            (Some((min, max)), Some(held))
                if is_position
                    && beyond(held, min, max) == 0
                    && beyond(position, min, max) <= i64::from(self.limits.standstill) =>
            {
                position.clamp(min, max)
            }
            _ => position,
        }
    }

    /// Returns whether a first target would be further than a step from the one that the drive holds.
    fn holds_old_target(&self, first: i32) -> bool {
        let range = match self.limits.kind {
            TargetKind::Position => self.limits.range,
            TargetKind::Rate => PositionRange::Linear,
            TargetKind::Profile | TargetKind::None => return false,
        };
        let is_far =
            |held| range.distance(held, first).unsigned_abs() > u64::from(self.limits.step);
        self.sent.possible().any(is_far)
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

    /// The frame with the target of [`decide`](Self::decide) was accepted by the Port.
    pub fn sent(&mut self) {
        let Some(target) = self.decided.take() else { return };
        self.waits = Some(WaitReason::Spent);
        self.sent.push(target);
        match self.state {
            GuardState::Armed { .. } if self.is_enabled => {
                self.state = GuardState::Running { target };
                self.was_following = false;
            }
            GuardState::Running { .. } => self.state = GuardState::Running { target },
            _ => {}
        }
    }

    /// The frame with the target of [`decide`](Self::decide) was rejected by the Port. The
    /// previous target stays in force.
    pub fn rejected(&mut self) {
        self.decided = None;
        self.waits = Some(WaitReason::Rejected);
    }
}

/// Distance of a target from the bounds, in steps.
fn beyond(target: i32, min: i32, max: i32) -> i64 {
    let target = i64::from(target);
    (i64::from(min) - target).max(target - i64::from(max)).max(0)
}
