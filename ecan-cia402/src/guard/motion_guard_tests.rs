//! Each rule of the motion guard by itself.

use ecan_canopen::DriveState;

use super::motion_guard::MotionGuard;
use super::terms::PositionRange;
use super::terms::{
    Actual, ChannelView, DriveView, GuardInput, HoldReason, PathStatus, PositionUnavailable,
};
use super::terms::{Decision, GuardLimits, GuardState, TargetKind, TargetRejection, WaitReason};

const LIMITS: GuardLimits = GuardLimits {
    kind: TargetKind::Position,
    range: PositionRange::Linear,
    step: 100,
    window: 1000,
    bounds: None,
    standstill: 5,
    tpdo_timeout: 3,
    wc_misses: 2,
    drain_images: 2,
};

/// A quiet channel, an enabled drive at `position`.
fn good(position: i32) -> GuardInput {
    GuardInput {
        path: PathStatus { confirmed: 50, covered: 50, ..PathStatus::CLEAR },
        drive: DriveView {
            state: Some(DriveState::OperationEnabled),
            heartbeat_lost: false,
            not_operational: false,
            unverified: false,
            follows: true,
            following_error: false,
        },
        actual: Actual::Fresh(position),
    }
}

fn in_state(state: DriveState, position: i32) -> GuardInput {
    let mut input = good(position);
    input.drive.state = Some(state);
    input
}

fn cycle(guard: &mut MotionGuard, input: &GuardInput, requested: Option<i32>) -> Decision {
    guard.observe(input);
    let decision = guard.decide(requested);
    if decision.target().is_some() {
        guard.sent();
    }
    decision
}

/// Active and running at `position`.
fn running_with(limits: GuardLimits, position: i32) -> MotionGuard {
    let mut guard = MotionGuard::new(limits);
    guard.activate();
    for _ in 0..20 {
        if let Decision::First(first) = cycle(&mut guard, &good(position), Some(123_456)) {
            let expected = if limits.kind == TargetKind::Rate { 0 } else { position };
            assert_eq!(first, expected);
            return guard;
        }
    }
    panic!("not active: {:?}", guard.state());
}

fn running(position: i32) -> MotionGuard {
    running_with(LIMITS, position)
}

#[test]
fn inactive_axis_gets_nothing() {
    let mut guard = MotionGuard::new(LIMITS);
    for _ in 0..10 {
        assert_eq!(cycle(&mut guard, &good(7), Some(7)), Decision::Closed);
    }
}

#[test]
fn disabled_drive_gets_its_actual_position() {
    let mut guard = MotionGuard::new(LIMITS);
    guard.activate();
    let mut tracked = Vec::new();
    for position in 1000..1013 {
        let input = in_state(DriveState::SwitchedOn, position);
        if let Decision::Track(target) = cycle(&mut guard, &input, Some(0)) {
            assert_eq!(target, position);
            tracked.push(target);
        }
    }
    assert!(tracked.len() > 5, "{tracked:?}");
    assert_eq!(cycle(&mut guard, &good(1013), Some(0)), Decision::First(1013));
    assert_eq!(cycle(&mut guard, &good(1013), Some(1100)), Decision::Target(1100));
}

/// Two positions do not show that an axis rests, however far apart they are.
#[test]
fn rare_positions_are_read_three_times() {
    let mut guard = MotionGuard::new(GuardLimits { tpdo_timeout: 50, ..LIMITS });
    guard.activate();
    while guard.state() != GuardState::Reading {
        guard.observe(&good(7));
    }
    let none = Actual::None(PositionUnavailable::NoTpdo);
    let mut armed = (1..=3).map(|_| {
        (0..20).for_each(|_| _ = guard.observe(&GuardInput { actual: none, ..good(7) }));
        guard.observe(&good(7));
        matches!(guard.state(), GuardState::Armed { .. })
    });
    assert_eq!(
        [armed.next(), armed.next(), armed.next()].map(Option::unwrap),
        [false, false, true]
    );
}

#[test]
fn first_target_is_always_the_actual_position() {
    let guard = running(777);
    assert_eq!(guard.state(), GuardState::Running { target: 777 });
}

#[test]
fn moving_axis_is_not_activated() {
    let mut guard = MotionGuard::new(LIMITS);
    guard.activate();
    for n in 0..50 {
        assert_eq!(cycle(&mut guard, &good(n * 6), None), Decision::Closed);
    }
    assert_eq!(guard.state(), GuardState::Reading);
    for _ in 0..3 {
        assert_eq!(cycle(&mut guard, &good(49 * 6), None), Decision::Closed);
    }
    assert_eq!(cycle(&mut guard, &good(49 * 6), None), Decision::First(49 * 6));
}

/// The motor creeps to the target that its enabled drive holds: it would be elsewhere when the first target
/// takes effect.
#[test]
fn slowly_moving_axis_is_not_activated() {
    let mut guard = MotionGuard::new(LIMITS);
    guard.activate();
    for n in 0..50 {
        assert_eq!(cycle(&mut guard, &good(n * 2), None), Decision::Closed);
    }
    for _ in 0..3 {
        cycle(&mut guard, &in_state(DriveState::SwitchedOn, 98), None);
    }
    assert_eq!(guard.state(), GuardState::Armed { target: 98 });
    for n in 1..=4 {
        let input = in_state(DriveState::SwitchedOn, 98 + n * 2);
        let is_tracked = cycle(&mut guard, &input, None).target().is_some();
        assert_eq!(is_tracked, n < 3, "cycle {n}");
    }
}

/// The bound is not passed by noise, nor by the lag of the last motion.
#[test]
fn first_target_of_an_enabled_drive_is_inside_its_bounds() {
    let limits = GuardLimits { bounds: Some((-50, 50)), ..LIMITS };
    for (position, first) in [(54, 50), (50, 50), (-55, -50), (56, 56)] {
        let mut guard = running_with(limits, 0);
        cycle(&mut guard, &good(0), Some(position.clamp(-50, 50)));
        guard.hold();
        guard.activate();
        let mut decisions = (0..20).map(|_| cycle(&mut guard, &good(position), None));
        let decision = decisions.find(|decision| decision.target().is_some());
        assert_eq!(decision, Some(Decision::First(first)), "{position}");
    }
}

#[test]
fn axis_moved_by_hand_is_read_again() {
    let mut guard = MotionGuard::new(LIMITS);
    let off = |position| in_state(DriveState::SwitchOnDisabled, position);
    guard.activate();
    for _ in 0..10 {
        cycle(&mut guard, &off(0), None);
    }
    assert_eq!(guard.state(), GuardState::Armed { target: 0 });
    for _ in 0..4 {
        assert_eq!(cycle(&mut guard, &off(400), None), Decision::Closed);
    }
    assert_eq!(cycle(&mut guard, &off(400), None), Decision::Track(400));
    assert_eq!(cycle(&mut guard, &good(400), None), Decision::First(400));
}

#[test]
fn only_a_fresh_position_begins_anything() {
    for actual in [Actual::Late(5), Actual::None(PositionUnavailable::Incomplete)] {
        let mut guard = MotionGuard::new(LIMITS);
        guard.activate();
        let input = GuardInput { actual, ..good(5) };
        for _ in 0..50 {
            assert_eq!(cycle(&mut guard, &input, None), Decision::Closed);
        }
    }
}

#[test]
fn first_target_needs_the_position_of_its_cycle() {
    let mut guard = MotionGuard::new(LIMITS);
    guard.activate();
    for _ in 0..10 {
        cycle(&mut guard, &in_state(DriveState::SwitchedOn, 9), None);
    }
    let late = GuardInput { actual: Actual::Late(9), ..good(9) };
    let wait = Decision::Wait(WaitReason::NoFreshPosition);
    assert_eq!(cycle(&mut guard, &late, None), wait);
    assert_eq!(cycle(&mut guard, &good(10), None), Decision::First(10));
}

#[test]
fn step_beyond_the_limit_keeps_the_previous_target() {
    let mut guard = running(0);
    assert_eq!(cycle(&mut guard, &good(0), Some(100)), Decision::Target(100));
    let rejection = TargetRejection::Step { step: 101, limit: 100 };
    assert_eq!(cycle(&mut guard, &good(100), Some(201)), Decision::Reject(rejection));
    assert_eq!(cycle(&mut guard, &good(100), Some(200)), Decision::Target(200));
    assert_eq!(cycle(&mut guard, &good(200), None), Decision::Target(200));
    assert_eq!(
        cycle(&mut guard, &good(200), Some(i32::MIN)),
        Decision::Reject(TargetRejection::Step { step: i64::from(i32::MIN) - 200, limit: 100 })
    );
}

#[test]
fn rejected_frame_does_not_count_as_sent() {
    let mut guard = running(0);
    guard.observe(&good(0));
    assert_eq!(guard.decide(Some(80)), Decision::Target(80));
    guard.rejected();
    assert_eq!(guard.decide(Some(80)), Decision::Wait(WaitReason::Rejected), "not in this cycle");
    assert_eq!(guard.state(), GuardState::Running { target: 0 });
    let rejection = TargetRejection::Step { step: 160, limit: 100 };
    assert_eq!(cycle(&mut guard, &good(0), Some(160)), Decision::Reject(rejection));
}

#[test]
fn target_outside_the_following_window_is_rejected() {
    let mut guard = running(0);
    for n in 1..=10 {
        let target = n * 100;
        assert_eq!(cycle(&mut guard, &good(0), Some(target)), Decision::Target(target));
    }
    let rejection = TargetRejection::Window { distance: 1001, window: 1000 };
    assert_eq!(cycle(&mut guard, &good(0), Some(1001)), Decision::Reject(rejection));
    // The axis is pushed away: even the target that stands is outside now.
    let rejection = TargetRejection::Window { distance: 1100, window: 1000 };
    assert_eq!(cycle(&mut guard, &good(-100), None), Decision::Reject(rejection));
}

#[test]
fn bounds_hold_and_let_back_in() {
    let limits = GuardLimits { bounds: Some((-50, 50)), ..LIMITS };
    let mut guard = running_with(limits, 0);
    assert_eq!(cycle(&mut guard, &good(0), Some(50)), Decision::Target(50));
    let rejection = TargetRejection::Bounds { target: 51, min: -50, max: 50 };
    assert_eq!(cycle(&mut guard, &good(0), Some(51)), Decision::Reject(rejection));
    let mut outside = running_with(limits, 80);
    assert!(matches!(cycle(&mut outside, &good(80), Some(81)), Decision::Reject(_)));
    assert_eq!(cycle(&mut outside, &good(80), None), Decision::Target(80));
    assert_eq!(cycle(&mut outside, &good(80), Some(70)), Decision::Target(70));
    assert!(matches!(cycle(&mut outside, &good(70), Some(75)), Decision::Reject(_)));
    assert_eq!(cycle(&mut outside, &good(70), Some(0)), Decision::Target(0));
}

#[test]
fn only_a_wrapping_counter_may_wrap() {
    let wrapping = GuardLimits { range: PositionRange::Wrapping, ..LIMITS };
    let mut guard = running_with(wrapping, i32::MAX);
    let wrapped = Decision::Target(i32::MIN);
    assert_eq!(cycle(&mut guard, &good(i32::MAX), Some(i32::MIN)), wrapped);
    let mut linear = running(i32::MAX);
    let decision = cycle(&mut linear, &good(i32::MAX), Some(i32::MIN));
    assert!(matches!(decision, Decision::Reject(TargetRejection::Step { .. })));
}

#[test]
fn incomplete_cycle_waits_and_too_many_hold() {
    let mut guard = running(0);
    let mut missed = good(0);
    missed.path.is_complete = false;
    missed.path.is_unconfirmed = true;
    missed.actual = Actual::None(PositionUnavailable::NoImage);
    for _ in 0..2 {
        let wait = Decision::Wait(WaitReason::ImageUnconfirmed);
        assert_eq!(cycle(&mut guard, &missed, Some(50)), wait);
        assert!(!guard.wants_discard());
    }
    assert_eq!(cycle(&mut guard, &good(0), Some(50)), Decision::Target(50));
    for _ in 0..2 {
        cycle(&mut guard, &missed, Some(50));
    }
    assert_eq!(guard.observe(&missed), Some(HoldReason::WorkingCounter));
    assert!(guard.wants_discard(), "the held image carries a target");
    let mut unconfirmed = good(0);
    unconfirmed.path.is_unconfirmed = true;
    for received in [unconfirmed, good(0)] {
        guard.observe(&received);
        assert!(!guard.wants_discard(), "its targets were received");
    }
    (0..3).for_each(|_| _ = guard.observe(&missed));
    guard.hold();
    assert!(!guard.wants_discard(), "it holds for another reason");
    for _ in 0..50 {
        assert_eq!(cycle(&mut guard, &good(0), Some(50)), Decision::Closed, "for good");
    }
}

#[test]
fn cycle_has_one_target() {
    let mut guard = running(0);
    guard.observe(&good(0));
    assert_eq!(guard.decide(Some(50)), Decision::Target(50));
    guard.sent();
    assert_eq!(guard.decide(Some(100)), Decision::Wait(WaitReason::Spent));
    guard.observe(&good(0));
    assert_eq!(guard.decide(Some(100)), Decision::Target(100));
}

#[test]
fn behind_a_full_image_a_cycle_is_left_out() {
    let mut guard = running(0);
    let mut full = good(0);
    full.path.image_full = true;
    let wait = Decision::Wait(WaitReason::ImageFull);
    assert_eq!(cycle(&mut guard, &full, Some(50)), wait);
    assert_eq!(cycle(&mut guard, &good(0), Some(50)), Decision::Target(50));
}

#[test]
fn missing_tpdo_is_tolerated_up_to_the_timeout() {
    let mut guard = running(0);
    let none = GuardInput { actual: Actual::None(PositionUnavailable::NoTpdo), ..good(0) };
    for n in 1..=3 {
        assert_eq!(cycle(&mut guard, &none, Some(n)), Decision::Target(n));
    }
    let lost = HoldReason::TpdoLost(PositionUnavailable::NoTpdo);
    assert_eq!(guard.observe(&none), Some(lost));
    assert_eq!(guard.decide(Some(4)), Decision::Closed);
}

#[test]
fn late_tpdo_keeps_the_axis_running() {
    let mut guard = running(0);
    let late = GuardInput { actual: Actual::Late(0), ..good(0) };
    for n in 1..=50 {
        assert_eq!(cycle(&mut guard, &late, Some(n)), Decision::Target(n));
    }
}

type Change = fn(&mut GuardInput);

#[test]
fn every_breach_holds_at_once_and_until_taken_up() {
    let breaches: [(Change, HoldReason); 13] = [
        (|i| i.path.is_ready = false, HoldReason::GatewayLost),
        (|i| i.path.discarded = true, HoldReason::FramesDiscarded),
        (|i| i.path.channel = ChannelView::BusOff, HoldReason::BusOff),
        (|i| i.path.channel = ChannelView::NotRunning, HoldReason::ChannelStopped),
        (|i| i.path.queue_rejected = true, HoldReason::QueueFull),
        (|i| i.path.target_lost = true, HoldReason::TargetLost),
        (|i| i.drive.heartbeat_lost = true, HoldReason::HeartbeatLost),
        (|i| i.drive.not_operational = true, HoldReason::NotOperational),
        (|i| i.drive.unverified = true, HoldReason::Unverified),
        (
            |i| i.drive.state = Some(DriveState::Fault),
            HoldReason::LeftOperationEnabled(DriveState::Fault),
        ),
        (
            |i| i.drive.state = Some(DriveState::QuickStopActive),
            HoldReason::LeftOperationEnabled(DriveState::QuickStopActive),
        ),
        (|i| i.drive.follows = false, HoldReason::NotFollowing),
        (|i| i.drive.following_error = true, HoldReason::FollowingError),
    ];
    for (change, reason) in breaches {
        let mut guard = running(0);
        cycle(&mut guard, &good(0), None);
        let mut broken = good(0);
        change(&mut broken);
        assert_eq!(guard.observe(&broken), Some(reason));
        assert_eq!(guard.decide(Some(0)), Decision::Closed);
        for _ in 0..20 {
            assert_eq!(guard.observe(&good(40)), None);
            assert_eq!(guard.decide(Some(0)), Decision::Closed, "{reason}");
        }
        assert_eq!(guard.state(), GuardState::Holding { reason });
        guard.activate();
        let decisions: Vec<_> = (0..8).map(|_| cycle(&mut guard, &good(40), Some(1))).collect();
        let first = decisions.iter().position(|d| *d == Decision::First(40));
        assert!(first.is_some_and(|n| n >= 4), "after {reason}: {decisions:?}");
    }
}

#[test]
fn drive_with_a_far_target_is_not_activated_enabled() {
    let mut guard = running(0);
    for n in 1..=5 {
        cycle(&mut guard, &good(0), Some(n * 100));
    }
    guard.hold();
    guard.activate();
    for _ in 0..7 {
        assert!(cycle(&mut guard, &good(0), None).target().is_none());
    }
    let far = Decision::Wait(WaitReason::HoldsOldTarget);
    assert_eq!(cycle(&mut guard, &good(0), None), far);
    assert_eq!(guard.resting_target(), Some(500), "what the drive holds moves nothing");
    assert_eq!(cycle(&mut guard, &in_state(DriveState::SwitchedOn, 0), None), Decision::Track(0));
    assert_eq!(cycle(&mut guard, &good(0), None), Decision::First(0));
}

/// The last target may be lost. The drive then holds the one before, which is further from a motor that
/// a feed-forward moved on.
#[test]
fn drive_that_may_hold_an_earlier_target_is_not_activated_enabled() {
    let first = |is_lost: bool, position| {
        let mut guard = running(0);
        cycle(&mut guard, &good(0), Some(100));
        cycle(&mut guard, &good(0), Some(200));
        let mut lost = good(0);
        lost.path.target_lost = is_lost;
        cycle(&mut guard, &lost, None);
        guard.hold();
        guard.activate();
        let mut decisions = (0..8).map(|_| cycle(&mut guard, &good(position), None));
        let is_answer = |decision: &Decision| {
            decision.target().is_some() || *decision == Decision::Wait(WaitReason::HoldsOldTarget)
        };
        decisions.find(is_answer).unwrap()
    };
    assert_eq!(first(true, 200), Decision::First(200), "a step from the target before");
    assert_eq!(first(false, 201), Decision::First(201), "the last target was received");
    assert_eq!(first(true, 201), Decision::Wait(WaitReason::HoldsOldTarget));
}

#[test]
fn drive_without_follow_bit_keeps_running() {
    let mut guard = MotionGuard::new(LIMITS);
    guard.activate();
    let mut input = good(0);
    input.drive.follows = false;
    for _ in 0..10 {
        cycle(&mut guard, &input, None);
    }
    assert_eq!(cycle(&mut guard, &input, Some(5)), Decision::Target(5));
}

#[test]
fn event_during_activation_restarts_it() {
    let mut guard = MotionGuard::new(LIMITS);
    guard.activate();
    for _ in 0..4 {
        cycle(&mut guard, &good(0), None);
    }
    assert_eq!(guard.state(), GuardState::Reading);
    let mut off = good(0);
    off.path.channel = ChannelView::BusOff;
    assert_eq!(cycle(&mut guard, &off, None), Decision::Closed);
    assert_eq!(guard.state(), GuardState::Draining);
    for n in 0..7 {
        assert!(cycle(&mut guard, &good(0), None).target().is_none(), "cycle {n}");
    }
    assert_eq!(cycle(&mut guard, &good(0), None), Decision::First(0));
}

#[test]
fn rate_starts_at_zero_and_never_wraps() {
    let limits = GuardLimits { kind: TargetKind::Rate, range: PositionRange::Wrapping, ..LIMITS };
    let mut guard = running_with(limits, 5000);
    assert_eq!(cycle(&mut guard, &good(5000), Some(100)), Decision::Target(100));
    // In motion, far from the position at its activation: no window for a rate.
    assert_eq!(cycle(&mut guard, &good(50_000), Some(200)), Decision::Target(200));
    assert!(matches!(
        cycle(&mut guard, &good(50_000), Some(301)),
        Decision::Reject(TargetRejection::Step { step: 101, .. })
    ));
}

#[test]
fn profile_target_may_be_far_and_homing_has_none() {
    let limits = GuardLimits { kind: TargetKind::Profile, ..LIMITS };
    let mut guard = running_with(limits, 0);
    assert_eq!(cycle(&mut guard, &good(0), Some(1_000_000)), Decision::Target(1_000_000));
    let limits = GuardLimits { kind: TargetKind::None, ..LIMITS };
    let mut guard = running_with(limits, 0);
    assert_eq!(cycle(&mut guard, &good(0), Some(1)), Decision::Reject(TargetRejection::NoTargets));
    assert_eq!(cycle(&mut guard, &good(0), None), Decision::Target(0));
}

#[test]
fn stop_command_carries_a_resting_target() {
    let mut guard = MotionGuard::new(LIMITS);
    assert_eq!(guard.resting_target(), None);
    guard.observe(&GuardInput { actual: Actual::Late(30), ..good(0) });
    assert_eq!(guard.resting_target(), Some(30));
    let mut guard = running(0);
    cycle(&mut guard, &good(0), Some(60));
    guard.hold();
    guard.observe(&good(40));
    assert_eq!(guard.resting_target(), Some(60), "the drive goes there already");
    assert_eq!(guard.state(), GuardState::Holding { reason: HoldReason::Commanded });
}

/// A disabled drive does not hold its last target; one that waits is at its position.
#[test]
fn stop_of_a_disabled_drive_carries_where_it_is() {
    let mut armed = MotionGuard::new(LIMITS);
    armed.activate();
    for position in 1000..1013 {
        cycle(&mut armed, &in_state(DriveState::SwitchedOn, position), None);
    }
    armed.observe(&in_state(DriveState::SwitchedOn, 1013));
    assert_eq!(armed.resting_target(), Some(1013));
    let limits = GuardLimits { kind: TargetKind::Rate, ..LIMITS };
    let mut rate = running_with(limits, 0);
    cycle(&mut rate, &good(0), Some(80));
    rate.observe(&in_state(DriveState::SwitchOnDisabled, 0));
    assert_eq!(rate.resting_target(), Some(0), "no velocity");
}

/// A drive that may not have received its last target stops where it was when its stop began.
#[test]
fn stop_after_lost_targets_carries_the_position_at_its_begin() {
    let stopped = |kind, is_lost| {
        let mut guard = running_with(GuardLimits { kind, ..LIMITS }, 0);
        cycle(&mut guard, &good(0), Some(60));
        let mut input = good(20);
        input.path.target_lost = is_lost;
        guard.observe(&input);
        if !is_lost {
            guard.hold();
        }
        guard.begin_stop();
        guard.observe(&good(40));
        guard.begin_stop();
        guard.resting_target()
    };
    assert_eq!(stopped(TargetKind::Position, true), Some(20));
    assert_eq!(stopped(TargetKind::Position, false), Some(60));
    assert_eq!(stopped(TargetKind::Rate, true), Some(60), "a velocity is no position");
}

#[test]
fn activation_that_restarts_reads_the_position_again() {
    let mut guard = MotionGuard::new(LIMITS);
    guard.restart_activation();
    assert_eq!(guard.state(), GuardState::Idle, "nothing to restart");
    guard.activate();
    for state in [DriveState::SwitchedOn, DriveState::OperationEnabled] {
        while !matches!(guard.state(), GuardState::Armed { .. }) {
            guard.observe(&in_state(state, 7));
        }
        guard.restart_activation();
        assert_eq!(guard.state(), GuardState::Draining);
    }
    let mut guard = running(7);
    guard.restart_activation();
    assert_eq!(guard.state(), GuardState::Running { target: 7 }, "not while it runs");
}

#[test]
fn age_counts_cycles_since_the_last_position() {
    let mut guard = MotionGuard::new(LIMITS);
    assert_eq!(guard.actual_age(), u16::MAX, "never");
    let none = Actual::None(PositionUnavailable::NoTpdo);
    for (actual, expected) in
        [(Actual::Fresh(1), 0), (none, 1), (none, 2), (Actual::Late(3), 0), (none, 1)]
    {
        guard.observe(&GuardInput { actual, ..good(0) });
        assert_eq!(guard.actual_age(), expected);
    }
}

#[test]
fn words_say_what_is_the_matter() {
    let reason = HoldReason::TpdoLost(PositionUnavailable::Backlog);
    assert_eq!(
        GuardState::Holding { reason }.to_string(),
        "holding: TPDO missing: received frames pile up in the gateway"
    );
    let rejection = TargetRejection::Step { step: -300, limit: 100 };
    assert_eq!(rejection.to_string(), "the step of -300 exceeds the limit of 100 per target");
}
