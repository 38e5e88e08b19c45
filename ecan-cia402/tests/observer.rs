//! The axes' part of a snapshot, and quick stops from other threads.
#![allow(missing_docs)]

use std::thread;
use std::time::Duration;

use crate::axes::{Fixture, START, axes, axis, node};
use ecan_canopen::{CobId, Controlword, OperatingMode};
use ecan_cia402::{
    AxesSnapshot, AxisCommand, AxisPhase, Cia402, Cia402Config, Cia402Error, HomingConfig,
    StopCause, StopKind,
};
use ecan_host::{AdapterConfig, CommandTicket, Observer, Snapshot};
use ecan_sim::{DriveFault, Fault, LossDirection};

#[track_caller]
fn assert_last_cycle(fixture: &Fixture, snapshot: &mut Snapshot) {
    snapshot.update().unwrap();
    assert_eq!(snapshot.cycle(), fixture.port.adapter().cycle_number());
    let view = AxesSnapshot::of(snapshot).unwrap();
    assert_eq!(view.axis_count(), fixture.cia402.axis_count());
    for axis in 0..view.axis_count() {
        let found = fixture.axis(axis);
        let status = view.axis(axis).unwrap();
        assert_eq!(status, found.status());
        let progress = found.progress();
        assert_eq!((status.phase, status.elapsed), (progress.phase, progress.elapsed));
        assert_eq!(status.error, progress.error.map(Into::into));
        assert_eq!(status.drive_state(), found.drive_state());
        assert_eq!(status.following_error(), found.following_error());
        assert_eq!(status.actual_degrees(), found.status().actual_degrees());
        assert_eq!(status.actual_radians(), found.status().actual_radians());
        assert_eq!(status.is_target_reached, found.is_target_reached());
    }
    assert_eq!(view.axis(view.axis_count()), None);
    assert_eq!(view.axes().count(), view.axis_count());
}

fn steps(fixture: &mut Fixture, snapshot: &mut Snapshot, cycles: usize) {
    for _ in 0..cycles {
        fixture.step();
        assert_last_cycle(fixture, snapshot);
    }
}

#[test]
fn snapshot_equals_the_getters_from_start_to_faults() {
    let mut table: Vec<_> = axes(6).into_iter().map(|axis| axis.with_target_step(50)).collect();
    table[2].mode = OperatingMode::ProfilePosition;
    table[3].mode = OperatingMode::CyclicVelocity;
    table[4].scale = ecan_cia402::Scale::steps_per_turn(-1000.0).with_origin(7);
    let mut fixture = Fixture::single(table);
    let mut snapshot = fixture.port.adapter().observer().snapshot();
    // Each operation without its wait: every cycle is compared.
    let run = |fixture: &mut Fixture, snapshot: &mut Snapshot, done: fn(&Cia402) -> bool| {
        let mut cycles = 0;
        while !done(&fixture.cia402) {
            steps(fixture, snapshot, 1);
            cycles += 1;
            assert!(cycles < 5_000);
        }
    };
    steps(&mut fixture, &mut snapshot, 20);
    fixture.cia402.command_all(AxisCommand::Configure).unwrap();
    run(&mut fixture, &mut snapshot, |table| {
        (0..6).all(|axis| table.axis(axis).unwrap().is_configured())
    });
    fixture.cia402.command_all(AxisCommand::Enable).unwrap();
    run(&mut fixture, &mut snapshot, Cia402::all_running);
    for target in [100, 5_000_000] {
        fixture.axis_mut(2).set_target(target).unwrap();
        fixture.axis_mut(1).set_target(target).unwrap();
        fixture.axis_mut(3).set_target(target).unwrap();
        for _ in 0..100 {
            fixture.idle(1);
            assert_last_cycle(&fixture, &mut snapshot);
        }
    }
    fixture.axis_mut(4).home(HomingConfig::new(37)).unwrap();
    fixture.axis_mut(5).stop(StopKind::QuickStop);
    fixture.axis_mut(0).halt();
    steps(&mut fixture, &mut snapshot, 500);
    fixture.strike(1, DriveFault::Error { code: 0x8611 });
    steps(&mut fixture, &mut snapshot, 300);
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 20 });
    steps(&mut fixture, &mut snapshot, 300);
    let view = AxesSnapshot::of(&snapshot).unwrap();
    assert_eq!(view.axis(1).unwrap().error_code, 0x8611);
    assert_eq!(view.axis(5).unwrap().stop_cause, Some(StopCause::QuickStop));
    // A cycle that does not serve the axes.
    drop(fixture.port.next_cycle());
    snapshot.update().unwrap();
    assert!(AxesSnapshot::of(&snapshot).is_none());
}

/// Time in a cycle at which another thread gives a command.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Moment {
    BeforeWait,
    BeforeBegin,
    BeforeReceive,
    BeforeSend,
    BeforeEnd,
    AfterEnd,
}

const MOMENTS: [Moment; 6] = [
    Moment::BeforeWait,
    Moment::BeforeBegin,
    Moment::BeforeReceive,
    Moment::BeforeSend,
    Moment::BeforeEnd,
    Moment::AfterEnd,
];

/// One cycle in which `at` is called at every moment.
fn cycle(fixture: &mut Fixture, mut at: impl FnMut(Moment)) {
    at(Moment::BeforeWait);
    fixture.port.wait_next_cycle();
    at(Moment::BeforeBegin);
    let mut cycle = fixture.port.begin_cycle();
    at(Moment::BeforeReceive);
    fixture.cia402.process_rx(&mut cycle);
    at(Moment::BeforeSend);
    fixture.cia402.send_target_step(&mut cycle);
    at(Moment::BeforeEnd);
    cycle.end().unwrap();
    at(Moment::AfterEnd);
}

#[test]
fn quick_stop_reaches_the_bus_within_two_cycles() {
    let cycle_ns = 2_000_000;
    let commands: [fn(&Observer) -> CommandTicket; 2] =
        [|observer| observer.quick_stop(0).unwrap(), Observer::quick_stop_all];
    for moment in MOMENTS {
        for command in commands {
            let mut fixture = Fixture::single(vec![axis(0, 0, 1).with_target_step(50)]).started();
            fixture.steps(50);
            let observer = fixture.port.adapter().observer();
            let mut snapshot = observer.snapshot();
            fixture.simulation.with_world(|world| world.record_bus_of(0, 0));
            let clock = fixture.port.adapter().ecrt().clock().clone();
            let mut given = None;
            cycle(&mut fixture, |now| {
                if now == moment {
                    let ticket =
                        thread::scope(|scope| scope.spawn(|| command(&observer)).join().unwrap());
                    given = Some((ticket, clock.now_ns()));
                }
            });
            let (ticket, given_ns) = given.unwrap();
            let mut cycles = 1;
            snapshot.update().unwrap();
            while !snapshot.has_executed(ticket) {
                cycle(&mut fixture, |_| ());
                snapshot.update().unwrap();
                cycles += 1;
            }
            assert!(cycles <= 2, "{moment:?}: {cycles} cycles");
            let status = AxesSnapshot::of(&snapshot).unwrap().axis(0).unwrap();
            assert_eq!(status.stop_cause, Some(StopCause::QuickStop), "{moment:?}");
            fixture.steps(3);
            let rpdo = CobId::rpdo(node(1), 1).can_id();
            let quick_stop = Controlword::of(ecan_canopen::Command::QuickStop).0.to_le_bytes();
            let frames = fixture.simulation.with_world(ecan_sim::World::take_recorded);
            let sent = frames.iter().find(|sent| {
                sent.frame.id() == rpdo && sent.frame.data().get(..2) == Some(&quick_stop[..])
            });
            let sent = sent.expect("the quick stop on the bus");
            let delay_ns = sent.start_ns.saturating_sub(given_ns);
            println!("{moment:?}: image after {cycles} cycles, bus after {delay_ns} ns");
            assert!(delay_ns <= 2 * cycle_ns, "{moment:?}: {delay_ns} ns");
        }
    }
}

#[test]
fn concurrent_quick_stops_are_all_executed() {
    let mut fixture = Fixture::single(axes(4)).started();
    let observer = &fixture.port.adapter().observer();
    let fixture = &mut fixture;
    for _ in 0..20 {
        fixture.cia402.command_all(AxisCommand::Enable).unwrap();
        fixture.until(2_000, Cia402::all_running);
        let tickets = thread::scope(|scope| {
            let givers: Vec<_> = (0..4)
                .map(|axis| scope.spawn(move || observer.quick_stop(axis).unwrap()))
                .collect();
            fixture.steps(1);
            givers.into_iter().map(|giver| giver.join().unwrap()).collect::<Vec<_>>()
        });
        fixture.steps(1);
        let mut snapshot = observer.snapshot();
        fixture.steps(1);
        snapshot.update().unwrap();
        assert!(tickets.iter().all(|ticket| snapshot.has_executed(*ticket)));
        assert!(
            (0..4).all(|axis| fixture.axis(axis).status().stop_cause == Some(StopCause::QuickStop))
        );
        fixture.steps(200);
    }
    assert!(observer.quick_stop(4).is_err());
}

#[test]
fn waiting_calls_execute_quick_stops_and_end_on_request() {
    let mut fixture = Fixture::single(axes(1));
    let observer = fixture.port.adapter().observer();
    let mut given = None;
    let error = fixture
        .cia402
        .blocking(&mut fixture.port, START)
        .on_progress(|axis| {
            if matches!(axis.phase, AxisPhase::Enabling(_)) && given.is_none() {
                given = Some(observer.quick_stop_all());
            }
        })
        .start_up()
        .unwrap_err();
    assert!(matches!(error, Cia402Error::AxisTimeout(_)), "{error}");
    assert_eq!(fixture.axis(0).status().stop_cause, Some(StopCause::QuickStop));
    observer.request_stop();
    let error = fixture.cia402.blocking(&mut fixture.port, START).enable().unwrap_err();
    assert!(error.to_string().contains("cancelled"), "{error}");
    // A shutdown is not cancelled.
    fixture.cia402.blocking(&mut fixture.port, START).shut_down().unwrap();
    assert!(fixture.port.adapter().is_stop_requested());
}

#[test]
fn observer_names_the_axes_of_the_last_table() {
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    let mut fixture = Fixture::open(ecan_sim::drives(1, 4), adapter, axes(4));
    let observer = fixture.port.adapter().observer();
    assert_eq!(observer.axis_count(), 4);
    for count in [6, 2, 2] {
        fixture.cia402 = Cia402::new(&fixture.port, axes(count), Cia402Config::default()).unwrap();
        assert_eq!(observer.axis_count(), count);
        let mut snapshot = observer.snapshot();
        steps(&mut fixture, &mut snapshot, 5);
    }
}

#[test]
fn quick_stop_of_ended_axes_is_never_acknowledged() {
    let mut fixture = Fixture::single(axes(2)).started();
    let observer = fixture.port.adapter().observer();
    let mut snapshot = observer.snapshot();
    let dropped = [observer.quick_stop(0).unwrap(), observer.quick_stop_all()];
    // No targets are sent.
    drop(fixture.port.next_cycle());
    snapshot.update().unwrap();
    assert!(!dropped.iter().any(|ticket| snapshot.has_executed(*ticket)));
    let stop = observer.request_stop();
    drop(fixture.port.next_cycle());
    snapshot.update().unwrap();
    assert!(snapshot.has_executed(stop), "it takes effect at once");
    fixture.port.adapter().clear_stop_request();
    fixture.cia402 = Cia402::new(&fixture.port, axes(2), Cia402Config::default()).unwrap();
    for _ in 0..3 {
        fixture.step();
        snapshot.update().unwrap();
        assert!(!dropped.iter().any(|ticket| snapshot.has_executed(*ticket)));
        assert_eq!(fixture.axis(0).status().stop_cause, None);
    }
    let given = observer.quick_stop(1).unwrap();
    fixture.step();
    snapshot.update().unwrap();
    assert!(snapshot.has_executed(given));
    assert!(!dropped.iter().any(|ticket| snapshot.has_executed(*ticket)));
}

#[test]
fn end_of_the_later_table_keeps_commands_of_the_first() {
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    let mut fixture = Fixture::open(ecan_sim::drives(1, 4), adapter, axes(4)).started();
    let observer = fixture.port.adapter().observer();
    let mut snapshot = observer.snapshot();
    let later = Cia402::new(&fixture.port, axes(2), Cia402Config::default()).unwrap();
    let dropped = observer.quick_stop(1).unwrap();
    drop(later);
    fixture.step();
    snapshot.update().unwrap();
    assert!(!snapshot.has_executed(dropped));
    assert!(AxesSnapshot::of(&snapshot).is_none(), "axes of the table created last only");
    assert_eq!(fixture.axis(1).status().stop_cause, None);
    let given = observer.quick_stop(3).unwrap();
    fixture.step();
    snapshot.update().unwrap();
    assert!(snapshot.has_executed(given));
    assert_eq!(fixture.axis(3).status().stop_cause, Some(StopCause::QuickStop));
}
