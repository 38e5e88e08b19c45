//! Axes of drives without heartbeat: node guarding in both directions.
#![allow(missing_docs)]

mod axes;

use std::time::Duration;

use axes::{Fixture, axes, scenario};
use ecan_canopen::{DriveState, GuardErrors, GuardingConfig, Heartbeat, NodeConfig};
use ecan_cia402::{AxisConfig, Cia402Config};
use ecan_host::AdapterConfig;
use ecan_sim::DriveFault;

const GUARDING: GuardingConfig =
    GuardingConfig { guard_time: Duration::from_millis(20), life_time_factor: 5 };

/// Two axes whose drives have neither heartbeat producer nor consumer.
fn started() -> Fixture {
    let scenario = scenario(1, |drive| drive.quirks.missing = vec![0x1016, 0x1017]);
    let mut table: Vec<AxisConfig> = axes(2);
    for axis in &mut table {
        axis.drive.further = GUARDING.steps().to_vec();
    }
    let node = NodeConfig { guarding: Some(GUARDING), ..NodeConfig::default() };
    let settings = Cia402Config { node, ..Cia402Config::default() };
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    Fixture::open_with(scenario, adapter, table, settings).started()
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
