//! The motion guard over random sequences, against a judge that knows only the record of what
//! went in and came out.

use ecan_canopen::DriveState;
use proptest::prelude::*;

use super::motion_guard::MotionGuard;
use super::terms::PositionRange;
use super::terms::{Actual, ChannelView, DriveView, GuardInput, PathStatus, PositionUnavailable};
use super::terms::{Decision, GuardLimits, GuardState, TargetKind, WaitReason};

/// What happens in one cycle.
#[derive(Debug, Clone)]
struct CycleEvents {
    input: GuardInput,
    requested: Option<i32>,
    /// The Port takes the frame.
    taken: bool,
    take_up: bool,
    release: bool,
}

#[derive(Debug, Clone)]
struct Record {
    what: CycleEvents,
    decision: Decision,
}

impl Record {
    fn sent(&self) -> bool {
        self.what.taken && self.decision.target().is_some()
    }
}

fn limits() -> impl Strategy<Value = GuardLimits> {
    let range = prop_oneof![
        Just(PositionRange::Linear),
        Just(PositionRange::Wrapping),
        Just(PositionRange::Modulo { min: -100, max: 99 }),
    ];
    let kind = prop_oneof![4 => Just(TargetKind::Position), 1 => Just(TargetKind::Rate)];
    let bounds = prop_oneof![Just(None), Just(Some((-60, 60)))];
    (range, kind, bounds, 1..30_u32, 5..60_u32, 0..10_u32, 0..4_u16, 0..4_u16, 0..4_u16).prop_map(
        |(range, kind, bounds, step, window, standstill, tpdo_timeout, wc_misses, drain_images)| {
            GuardLimits {
                kind,
                range,
                step,
                window,
                bounds,
                standstill,
                tpdo_timeout,
                wc_misses,
                drain_images,
            }
        },
    )
}

fn rarely() -> impl Strategy<Value = bool> {
    prop::bool::weighted(0.03)
}

fn actual() -> impl Strategy<Value = Actual> {
    let position = prop_oneof![8 => -8..8_i32, 1 => -110..110_i32, 1 => any::<i32>()];
    (position, 0..20_u8).prop_map(|(position, how)| match how {
        0 => Actual::Late(position),
        1 => Actual::None(PositionUnavailable::NoTpdo),
        2 => Actual::None(PositionUnavailable::Incomplete),
        _ => Actual::Fresh(position),
    })
}

fn channel() -> impl Strategy<Value = ChannelView> {
    prop_oneof![
        1 => Just(ChannelView::BusOff),
        1 => Just(ChannelView::NotRunning),
        3 => Just(ChannelView::NotSeen),
        60 => (0..3_u8, prop::bool::weighted(0.02))
            .prop_map(|(pending, pressure)| ChannelView::Running { pending, pressure }),
    ]
}

fn drive() -> impl Strategy<Value = DriveView> {
    let state = prop_oneof![
        40 => Just(Some(DriveState::OperationEnabled)),
        1 => Just(Some(DriveState::Fault)),
        6 => Just(Some(DriveState::SwitchedOn)),
        1 => Just(None),
    ];
    let seen = (rarely(), rarely());
    (state, rarely(), seen, prop::bool::weighted(0.95), rarely()).prop_map(
        |(state, heartbeat_lost, (not_operational, unverified), follows, following_error)| {
            DriveView {
                state,
                heartbeat_lost,
                not_operational,
                unverified,
                follows,
                following_error,
            }
        },
    )
}

fn happening() -> impl Strategy<Value = CycleEvents> {
    let path = (
        prop::bool::weighted(0.98),
        prop::bool::weighted(0.93),
        prop::bool::weighted(0.05),
        rarely(),
        (rarely(), rarely()),
        rarely(),
        channel(),
    );
    let requested = prop_oneof![
        2 => Just(None),
        8 => (-60..60_i32).prop_map(Some),
        1 => any::<i32>().prop_map(Some),
    ];
    let app = (requested, prop::bool::weighted(0.9), prop::bool::weighted(0.4), rarely());
    (path, drive(), actual(), app).prop_map(|(path, drive, actual, app)| {
        let (is_ready, is_complete, is_unconfirmed, discarded, full, target_lost, channel) = path;
        let (queue_rejected, image_full) = full;
        let (requested, taken, take_up, release) = app;
        let path = PathStatus {
            is_ready,
            is_complete,
            is_unconfirmed,
            discarded,
            queue_rejected,
            image_full,
            target_lost,
            channel,
            ..PathStatus::CLEAR
        };
        let input = GuardInput { path, drive, actual };
        CycleEvents { input, requested, taken, take_up, release }
    })
}

fn run(limits: GuardLimits, happenings: Vec<CycleEvents>) -> (MotionGuard, Vec<Record>) {
    let mut guard = MotionGuard::new(limits);
    let mut records = Vec::new();
    for (n, mut what) in happenings.into_iter().enumerate() {
        // One SYNC per cycle, after all frames.
        what.input.path.confirmed = n as u64 + 100;
        what.input.path.covered = n as u64 + 98;
        guard.observe(&what.input);
        if what.release {
            guard.release();
        }
        if what.take_up {
            guard.activate();
        }
        let decision = guard.decide(what.requested);
        if decision.target().is_some() {
            if what.taken {
                guard.sent();
            } else {
                guard.rejected();
            }
        }
        records.push(Record { what, decision });
    }
    (guard, records)
}

/// Returns whether the record of one cycle alone forbids any target of a running axis.
fn is_breach(input: &GuardInput) -> bool {
    let path = &input.path;
    !path.is_ready
        || path.discarded
        || matches!(path.channel, ChannelView::BusOff | ChannelView::NotRunning)
        || path.queue_rejected
        || path.target_lost
        || input.drive.heartbeat_lost
        || input.drive.not_operational
        || input.drive.unverified
}

/// Incomplete cycles in a row up to and including `n`.
fn misses(records: &[Record], n: usize) -> usize {
    records[..=n].iter().rev().take_while(|r| !r.what.input.path.is_complete).count()
}

/// Cycles since the last TPDO that could be used, at `n`.
fn silence(records: &[Record], n: usize) -> usize {
    records[..=n]
        .iter()
        .rev()
        .take_while(|r| matches!(r.what.input.actual, Actual::None(_)))
        .count()
}

fn last_actual(records: &[Record], n: usize) -> Option<i32> {
    records[..=n].iter().rev().find_map(|r| match r.what.input.actual {
        Actual::Fresh(position) | Actual::Late(position) => Some(position),
        Actual::None(_) => None,
    })
}

fn check_records(limits: &GuardLimits, records: &[Record]) -> Result<(), TestCaseError> {
    for (n, record) in records.iter().enumerate() {
        if !record.sent() {
            continue;
        }
        let input = &record.what.input;
        prop_assert!(
            input.path.is_ready && input.path.is_complete && !input.path.is_unconfirmed,
            "at {}",
            n
        );
        prop_assert!(!input.path.image_full, "at {}", n);
        prop_assert!(!is_breach(input), "at {n}: {record:?}");
        let enabled = input.drive.state == Some(DriveState::OperationEnabled);
        match record.decision {
            Decision::Track(target) => {
                prop_assert!(!enabled);
                check_beginning(limits, records, n, target)?;
            }
            Decision::First(target) => {
                prop_assert!(enabled);
                check_beginning(limits, records, n, target)?;
            }
            Decision::Target(target) => check_running(limits, records, n, target)?,
            other => prop_assert!(false, "{other:?} is no target"),
        }
    }
    Ok(())
}

/// A target that is not the application's.
fn check_beginning(
    limits: &GuardLimits,
    records: &[Record],
    n: usize,
    target: i32,
) -> Result<(), TestCaseError> {
    let Actual::Fresh(position) = records[n].what.input.actual else {
        return Err(TestCaseError::fail(format!("at {n}: the position is not of this cycle")));
    };
    let expected = match (limits.kind, limits.bounds) {
        (TargetKind::Rate, _) => 0,
        // A position that is beyond the bounds by noise is moved to them.
        (TargetKind::Position, Some((min, max)))
            if matches!(records[n].decision, Decision::First(_))
                && position.clamp(min, max).abs_diff(position) <= limits.standstill
                && target != position =>
        {
            position.clamp(min, max)
        }
        _ => position,
    };
    prop_assert_eq!(target, expected);
    let fresh = |r: &Record| match r.what.input.actual {
        Actual::Fresh(position) => Some(position),
        _ => None,
    };
    // Since the axis was last activated there was a quiet time and a position before this one.
    let last_target = records[..n]
        .iter()
        .rposition(|r| r.sent() && matches!(r.decision, Decision::Target(_) | Decision::First(_)));
    let since = last_target.map_or(0, |at| at + 1);
    let between = &records[since..n];
    prop_assert!(between.iter().any(|r| r.what.take_up), "at {n}: not activated");
    let statuses = between
        .iter()
        .filter(|r| matches!(r.what.input.path.channel, ChannelView::Running { .. }))
        .count();
    prop_assert!(statuses > usize::from(limits.drain_images), "at {n}: not drained");
    let before: Vec<i32> = between.iter().rev().filter_map(fresh).take(2).collect();
    prop_assert_eq!(before.len(), 2, "at {}: too few positions seen", n);
    if limits.kind == TargetKind::Position {
        let moved = limits.range.distance(before[0], position);
        prop_assert!(moved.unsigned_abs() <= u64::from(limits.standstill), "at {n}: in motion");
    }
    Ok(())
}

/// A target of the application.
fn check_running(
    limits: &GuardLimits,
    records: &[Record],
    n: usize,
    target: i32,
) -> Result<(), TestCaseError> {
    let first =
        records[..n].iter().rposition(|r| r.sent() && matches!(r.decision, Decision::First(_)));
    let Some(first) = first else {
        return Err(TestCaseError::fail(format!("at {n}: no first target before it")));
    };
    let mut followed = false;
    for at in first + 1..=n {
        let input = &records[at].what.input;
        prop_assert!(!is_breach(input), "at {n}: breach at {at}");
        prop_assert!(!(at < n && records[at].what.release), "at {n}: released at {at}");
        prop_assert_eq!(input.drive.state, Some(DriveState::OperationEnabled));
        prop_assert!(!input.drive.following_error);
        prop_assert!(!followed || input.drive.follows, "at {n}: not following at {at}");
        followed |= input.drive.follows;
        prop_assert!(misses(records, at) <= usize::from(limits.wc_misses));
        prop_assert!(silence(records, at) <= usize::from(limits.tpdo_timeout));
    }
    let before =
        records[first..n].iter().rev().find(|r| r.sent()).and_then(|r| r.decision.target());
    let Some(before) = before else {
        return Err(TestCaseError::fail("the first target was sent"));
    };
    let is_rate = limits.kind == TargetKind::Rate;
    let range = if is_rate { PositionRange::Linear } else { limits.range };
    let step = range.distance(before, target).unsigned_abs();
    prop_assert!(step <= u64::from(limits.step), "at {n}: step of {step}");
    if !is_rate {
        let actual = last_actual(records, n).expect("it was read before");
        let error = range.distance(actual, target).unsigned_abs();
        prop_assert!(error <= u64::from(limits.window), "at {n}: {error} from the axis");
    }
    if let Some((min, max)) = limits.bounds {
        let outside =
            |p: i32| (i64::from(min) - i64::from(p)).max(i64::from(p) - i64::from(max)).max(0);
        prop_assert!(outside(target) == 0 || target == before || outside(target) < outside(before));
    }
    if let Some(requested) = records[n].what.requested {
        prop_assert_eq!(target, requested, "never anything else than the requested target");
    }
    Ok(())
}

/// A cycle in which everything is well.
fn well(position: i32) -> CycleEvents {
    CycleEvents {
        input: GuardInput {
            path: PathStatus {
                channel: ChannelView::Running { pending: 1, pressure: false },
                ..PathStatus::CLEAR
            },
            drive: DriveView {
                state: Some(DriveState::OperationEnabled),
                heartbeat_lost: false,
                not_operational: false,
                unverified: false,
                follows: true,
                following_error: false,
            },
            actual: Actual::Fresh(position),
        },
        requested: None,
        taken: true,
        take_up: true,
        release: false,
    }
}

proptest! {
    #[test]
    fn guard_sends_only_targets_that_the_record_allows(
        limits in limits(),
        happenings in prop::collection::vec(happening(), 1..160),
    ) {
        let (_, records) = run(limits, happenings);
        check_records(&limits, &records)?;
    }

    #[test]
    fn whatever_happened_a_sound_axis_can_be_taken_up(
        limits in limits(),
        happenings in prop::collection::vec(happening(), 0..60),
        position in -50..50_i32,
    ) {
        let sound = happenings.into_iter().chain((0..25).map(|_| well(position)));
        let (guard, records) = run(limits, sound.collect());
        check_records(&limits, &records)?;
        let is_running = matches!(guard.state(), GuardState::Running { .. });
        // An axis that went on running may stand far from its target by now, and so may one whose
        // drive was enabled all the time.
        let last = records.last().map(|record| record.decision);
        let far = Decision::Wait(WaitReason::HoldsOldTarget);
        let is_stuck = last == Some(far) || matches!(last, Some(Decision::Reject(_)));
        prop_assert!(is_running || is_stuck, "{:?}", guard.state());
    }
}

#[test]
fn random_sequences_reach_the_relevant_states() {
    use proptest::strategy::ValueTree;
    use proptest::test_runner::TestRunner;
    let mut runner = TestRunner::deterministic();
    let (mut firsts, mut targets, mut rejections, mut waits) = (0, 0, 0, 0);
    for _ in 0..600 {
        let limits = limits().new_tree(&mut runner).unwrap().current();
        let happenings =
            prop::collection::vec(happening(), 160).new_tree(&mut runner).unwrap().current();
        for record in run(limits, happenings).1 {
            match record.decision {
                Decision::First(_) => firsts += 1,
                Decision::Target(_) => targets += 1,
                Decision::Reject(_) => rejections += 1,
                Decision::Wait(_) => waits += 1,
                _ => {}
            }
        }
    }
    assert!(
        firsts > 100 && targets > 100 && rejections > 100 && waits > 50,
        "{firsts} {targets} {rejections} {waits}"
    );
}
