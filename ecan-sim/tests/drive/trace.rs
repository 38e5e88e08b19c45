//! The trace of the drive.

use ecan_canopen::{Command, Controlword, DriveState, OperatingMode};
use ecan_sim::{CommandSource, DriveConfig, TraceCause, TraceEvent};

use super::fixture::{Fixture, MS, config};

const BY_SDO: TraceCause = TraceCause::Command(CommandSource::Sdo);

fn traced(trace: usize) -> Fixture {
    Fixture::with(&DriveConfig { trace, ..config() })
}

fn events(fixture: &Fixture, since: u64) -> Vec<TraceEvent> {
    fixture.drive.trace().since(since).map(|record| record.event).collect()
}

#[test]
fn trace_shows_enabling_stop_and_release_with_causes() {
    let mut fixture = traced(1_000);
    fixture.enable(OperatingMode::CyclicVelocity);
    let since = fixture.drive.trace().recorded();
    fixture.write(0x60FF, 0, 100_000, 4).unwrap();
    fixture.pass_ms(20);
    fixture.command(Command::QuickStop);
    fixture.pass_ms(20);
    let events = events(&fixture, since);
    let motion = |event: &&TraceEvent| matches!(event, TraceEvent::Motion(_));
    let samples = events.iter().filter(motion).count();
    assert!((21..40).contains(&samples), "one per ms until the motor is at rest: {samples}");
    let others: Vec<_> = events.iter().filter(|event| !motion(event)).copied().collect();
    let [target, controlword, state, stop, off, release] = others[..] else {
        panic!("{others:#?}")
    };
    assert!(matches!(target, TraceEvent::Target(record) if record.followed));
    let word = Controlword::of(Command::QuickStop);
    assert_eq!(controlword, TraceEvent::Controlword { word, source: CommandSource::Sdo });
    let stopping = DriveState::QuickStopActive;
    assert_eq!(state, TraceEvent::State { state: stopping, cause: BY_SDO });
    assert_eq!(stop, TraceEvent::Stop { deceleration: 50_000_000.0, cause: BY_SDO });
    let cause = TraceCause::Drive;
    assert_eq!(off, TraceEvent::State { state: DriveState::SwitchOnDisabled, cause });
    assert!(
        matches!(release, TraceEvent::Release { velocity, cause: TraceCause::Drive } if velocity.abs() < 655.36)
    );
}

#[test]
fn trace_samples_every_controller_period() {
    let mut fixture = traced(1_000);
    fixture.start_csp(1_000);
    let since = fixture.drive.trace().recorded();
    for n in 1..=10 {
        fixture.pass(MS / 3);
        fixture.cycle(0x0F, 1_000 + n);
    }
    fixture.pass_ms(1);
    let mut times: Vec<u64> = Vec::new();
    for record in fixture.drive.trace().since(since) {
        if let TraceEvent::Motion(_) = record.event {
            times.push(record.time_ns);
        }
    }
    assert!(times.iter().all(|time| time.is_multiple_of(MS)), "{times:?}");
    assert!(times.windows(2).all(|pair| pair[1] == pair[0] + MS), "{times:?}");
    let repeated = |event: &&TraceEvent| matches!(event, TraceEvent::Controlword { .. });
    assert_eq!(events(&fixture, since).iter().filter(repeated).count(), 0);
    let (time, word, source) = fixture.drive.trace().last_controlword().unwrap();
    assert!(fixture.now - time <= 2 * MS + MS / 3);
    assert_eq!((word.0, source), (0x0F, CommandSource::Pdo));
}

#[test]
fn trace_is_bounded_and_counts_all_events() {
    let mut fixture = traced(8);
    fixture.enable(OperatingMode::CyclicPosition);
    fixture.pass_ms(100);
    let trace = fixture.drive.trace();
    assert_eq!(trace.iter().len(), 8);
    assert!(trace.recorded() > 100);
    assert_eq!(trace.since(trace.recorded() - 3).count(), 3);
    assert_eq!(trace.since(0).count(), 8);
}

#[test]
fn trace_without_depth_records_nothing() {
    let mut fixture = traced(0);
    fixture.enable(OperatingMode::CyclicPosition);
    fixture.pass_ms(10);
    let trace = fixture.drive.trace();
    assert_eq!((trace.recorded(), trace.iter().len()), (0, 0));
    assert_eq!(trace.last_controlword().map(|(_, word, _)| word.0), Some(0x0F));
}
