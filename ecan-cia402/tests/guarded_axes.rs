//! Axes of drives without heartbeat, by node guarding in both directions; SYNC with a counter.
#![allow(missing_docs)]

use std::time::Duration;

use crate::axes::{Fixture, START, axes, scenario};
use ecan_canopen::{DriveState, GuardErrors, GuardingConfig, Heartbeat, SyncConfig, object};
use ecan_cia402::{AxisConfig, AxisFault, Cia402, Cia402Config, Cia402Error, HostWatch};
use ecan_host::AdapterConfig;
use ecan_sim::DriveFault;

const GUARDING: GuardingConfig =
    GuardingConfig { guard_time: Duration::from_millis(20), life_time_factor: 5 };

/// Two axes whose drives have neither heartbeat producer nor consumer.
fn started() -> Fixture {
    let scenario = scenario(1, |drive| drive.quirks.missing = vec![0x1016, 0x1017]);
    let mut table: Vec<AxisConfig> = axes(2);
    for axis in &mut table {
        axis.drive.guarding = Some(GUARDING);
    }
    Fixture::with(scenario, table).started()
}

#[test]
fn guarded_axes_run_and_detect_a_lost_drive() {
    let mut fixture = started();
    fixture.steps(500);
    let handles: Vec<_> = fixture.cia402.network().handles().collect();
    for handle in &handles {
        let status = fixture.cia402.network().status(*handle).unwrap();
        assert_eq!((status.heartbeat, status.heartbeat_timeouts), (Heartbeat::Active, 0));
        assert_eq!(status.guard_errors, GuardErrors::default());
    }
    assert!(fixture.cia402.all_running());
    fixture.check();
    fixture.strike(0, DriveFault::PowerCycle { off_ms: 2_000 });
    fixture.idle(200);
    let life = |fixture: &Fixture, n: usize| fixture.cia402.network().heartbeat(handles[n]);
    assert_eq!(life(&fixture, 0), Heartbeat::TimedOut);
    assert_eq!(life(&fixture, 1), Heartbeat::Active);
    assert!(!fixture.cia402.all_running());
}

#[test]
fn guarded_drives_detect_a_stopped_host() {
    let fixture = started();
    for axis in 0..2 {
        assert_eq!(fixture.drive(axis, |drive| drive.state()), DriveState::OperationEnabled);
    }
    fixture.simulation.pass_ns(1_000_000_000);
    for axis in 0..2 {
        let (state, code) = fixture.drive(axis, |drive| (drive.state(), drive.error_code()));
        assert_ne!(state, DriveState::OperationEnabled, "axis {axis}");
        assert_eq!(code, 0x8130, "axis {axis}: life guarding");
    }
}

#[test]
fn host_loss_is_reported_by_the_life_time() {
    let mut fixture = started();
    let loss = fixture.axis(0).host_loss();
    assert_eq!(loss.watch, HostWatch::Guarded(Duration::from_millis(100)));
    assert!(loss.reaction.is_controlled_stop(), "{loss}");
    assert_eq!(fixture.cia402.host_loss_risks().count(), 0);
    // A released drive does not detect the end of the host.
    fixture.cia402.blocking(&mut fixture.port, START).shut_down().unwrap();
    let factor = fixture.drive(0, |drive| drive.object(object::LIFE_TIME_FACTOR, 0));
    assert_eq!(factor, Some(0));
    assert_eq!(fixture.axis(0).host_loss().watch, HostWatch::NoEntry);
    fixture.simulation.pass_ns(1_000_000_000);
    for axis in 0..2 {
        assert_eq!(fixture.drive(axis, |drive| drive.error_code()), 0, "axis {axis}");
    }
}

#[test]
fn guard_time_out_of_range_is_rejected() {
    let fixture = started();
    let mut table = axes(1);
    let guarding = GuardingConfig { guard_time: Duration::from_micros(1_500), ..GUARDING };
    table[0].drive.guarding = Some(guarding);
    let error = Cia402::new(&fixture.port, table, Cia402Config::default()).unwrap_err();
    let Cia402Error::Axes(found) = &error else { panic!("{error}") };
    assert_eq!(found.faults, [(0, AxisFault::Guarding { guarding })]);
}

/// A drive whose 0x1019 differs from the host's ignores SYNC. It keeps its values from one owner to the
/// next.
#[test]
fn drives_get_the_sync_counter() {
    let sync = SyncConfig { counter_overflow: Some(10), every_cycles: 2, schedule: None };
    let settings = Cia402Config { sync, ..Cia402Config::default() };
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    let scenario = scenario(1, |_| {});
    let mut fixture = Fixture::open_with(scenario, adapter, axes(2), settings.clone()).started();
    for overflow in [20, 10] {
        let sync = SyncConfig { counter_overflow: Some(overflow), ..sync };
        let settings = Cia402Config { sync, ..settings.clone() };
        fixture.cia402 = Cia402::new(&fixture.port, axes(2), settings).unwrap();
        fixture.start();
        fixture.steps(100);
        fixture.check();
        for axis in 0..2 {
            let object = |index| fixture.drive(axis, |drive| drive.object(index, 0));
            assert_eq!(object(object::SYNC_COUNTER_OVERFLOW), Some(overflow.into()));
            assert_eq!(object(object::COMMUNICATION_CYCLE), Some(4_000));
            assert_eq!(fixture.drive(axis, |drive| drive.error_code()), 0, "SYNC as expected");
        }
    }
}
