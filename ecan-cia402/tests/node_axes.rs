//! Several axes of one node: drives with two axes, each with its own objects, PDOs and motor.
#![allow(missing_docs)]

use std::time::Duration;

use crate::axes::{Fixture, START, axis, scenario};
use ecan_canopen::{DriveState, GuardingConfig, NmtCommand, object};
use ecan_cia402::{
    AxisCommand, AxisConfig, AxisFault, AxisPhase, AxisRef, Cia402, Cia402Config, Cia402Error,
    PdoCobIds, StopCause, StopKind,
};
use ecan_protocol::can::CanId;
use ecan_sim::{DriveFault, Scenario};

const MS: u64 = 1_000_000;

fn two_axes() -> Scenario {
    scenario(1, |drive| {
        drive.axes = 2;
        drive.trace = 20_000;
    })
}

/// Both axes of the first two nodes, each with another step.
fn table() -> Vec<AxisConfig> {
    let of_node = |id| [axis(0, 0, id), axis(0, 0, id).with_node_axis(1, 2)];
    let steps = [100, -60, 40, -90];
    let all = [1, 2].into_iter().flat_map(of_node).zip(steps);
    all.map(|(axis, step)| axis.with_target_step(step)).collect()
}

fn in_motion() -> Fixture {
    let mut fixture = Fixture::with(two_axes(), table()).started();
    fixture.steps(100);
    assert!(fixture.cia402.all_running());
    fixture
}

fn state(fixture: &Fixture, axis: usize) -> DriveState {
    fixture.drive_axis(axis, |drive| drive.state())
}

fn is_off(fixture: &Fixture, axis: usize) -> bool {
    state(fixture, axis) == DriveState::SwitchOnDisabled
}

#[test]
fn axes_of_a_node_start_together_and_move_alone() {
    let mut fixture = in_motion();
    // Pre-operational and start, once for each node.
    assert_eq!(fixture.cia402.network().statistics().nmt_sent, 4);
    assert_eq!(fixture.cia402.network().handles().count(), 2);
    fixture.steps(200);
    fixture.check();
    for (axis, step) in [100, -60, 40, -90].into_iter().enumerate() {
        let velocity = fixture.drive_axis(axis, |drive| drive.velocity());
        let expected = f64::from(step) * 500.0;
        assert!((velocity - expected).abs() < 2_000.0, "axis {axis}: {velocity}");
    }
    let (device_type, of_second) =
        fixture.drive(0, |drive| (drive.object(object::DEVICE_TYPE, 0), drive.object(0x6FFF, 0)));
    assert_eq!((device_type, of_second), (Some(0xFFFF_0192), Some(0x0002_0192)));
}

/// CiA 301 gives 64 PDOs to each axis of a node; the predefined connection set has four.
#[test]
fn pdos_above_four_have_configured_cob_ids() {
    let id = |raw| CanId::standard(raw).unwrap();
    let mut table = table();
    for (axis, rpdo, tpdo) in [(1, 0x301, 0x281), (3, 0x510, 0x490)] {
        table[axis].pdos.number = 65;
        table[axis].pdos.cob_ids = PdoCobIds { rpdos: vec![id(rpdo)], tpdos: vec![id(tpdo)] };
    }
    let mut fixture = Fixture::with(two_axes(), table).started();
    fixture.steps(200);
    assert!(fixture.cia402.all_running());
    fixture.check();
    let cob_id = |index| fixture.drive(2, |drive| drive.object(index, 1));
    assert_eq!((cob_id(0x1440), cob_id(0x1840)), (Some(0x510), Some(0x490)));
    let text = fixture.cia402.bus_load(&fixture.port)[0].to_string();
    assert!(text.contains("4 axes"), "{text}");
}

#[test]
fn fault_of_one_axis_leaves_the_other_running() {
    let mut fixture = in_motion();
    fixture.strike(1, DriveFault::AxisError { axis: 1, code: 0x2310 });
    fixture.until(50, |cia402| !cia402.axis(1).unwrap().is_running());
    fixture.steps(200);
    assert_eq!(fixture.axis(1).phase(), AxisPhase::Fault);
    for axis in [0, 2, 3] {
        assert!(fixture.axis(axis).is_running(), "axis {axis}");
        assert_eq!(fixture.axis(axis).statistics().holds, 0, "axis {axis}");
    }
    fixture.axis_mut(1).recover().unwrap();
    fixture.until(1_000, Cia402::all_running);
    fixture.steps(50);
    fixture.check();
}

#[test]
fn node_that_restarts_is_configured_once_for_both_axes() {
    let mut fixture = in_motion();
    let before = fixture.cia402.network().statistics().nmt_sent;
    fixture.strike(0, DriveFault::PowerCycle { off_ms: 200 });
    fixture.until(100, |cia402| {
        !cia402.axis(0).unwrap().is_running() && !cia402.axis(1).unwrap().is_running()
    });
    fixture.idle(300);
    assert!(fixture.axis(2).is_running() && fixture.axis(3).is_running());
    fixture.cia402.command_all(AxisCommand::Recover).unwrap();
    fixture.until(5_000, Cia402::all_running);
    // A third one starts the node for the axes before its first heartbeat.
    let commands = fixture.cia402.network().statistics().nmt_sent - before;
    assert!((2..=3).contains(&commands), "{commands}");
    fixture.steps(100);
    fixture.check();
}

#[test]
fn stop_of_one_axis_leaves_the_other_running() {
    let mut fixture = in_motion();
    fixture.axis_mut(1).stop(StopKind::QuickStop);
    fixture.steps(200);
    assert!(fixture.axis(1).is_stopped() && fixture.axis(0).is_running());
    assert_eq!(fixture.drive_axis(1, |drive| drive.velocity()).abs().round(), 0.0);
    assert_eq!(state(&fixture, 0), DriveState::OperationEnabled);
    fixture.axis_mut(1).enable().unwrap();
    fixture.until(1_000, Cia402::all_running);
    fixture.check();
}

/// In Pre-operational only the one SDO server of a node is left to stop its axes.
#[test]
fn both_axes_are_stopped_by_one_sdo_server() {
    let mut fixture = in_motion();
    fixture.cia402.send_nmt_all(NmtCommand::EnterPreOperational).unwrap();
    fixture.steps(5);
    fixture.cia402.command_all(AxisCommand::Stop(StopKind::QuickStopThenDisable)).unwrap();
    let begin = fixture.now_ns();
    while !fixture.cia402.all_stopped() {
        fixture.step();
        assert!(fixture.now_ns() - begin < 400 * MS, "{:?}", progress(&fixture));
    }
    for axis in 0..4 {
        assert!(is_off(&fixture, axis), "axis {axis}: {}", state(&fixture, axis));
    }
    fixture.check();
}

fn progress(fixture: &Fixture) -> Vec<String> {
    fixture.cia402.axes().map(AxisRef::progress).map(|axis| axis.to_string()).collect()
}

#[test]
fn configuration_of_one_axis_stops_the_other() {
    let mut fixture = in_motion();
    fixture.axis_mut(1).configure().unwrap();
    for axis in [0, 1] {
        assert_eq!(
            fixture.axis(axis).status().stop_cause,
            Some(StopCause::Configure),
            "axis {axis}"
        );
    }
    fixture.until(2_000, |cia402| {
        cia402.axis(0).unwrap().is_configured() && cia402.axis(1).unwrap().is_configured()
    });
    assert!(is_off(&fixture, 0) && is_off(&fixture, 1));
    assert!(fixture.axis(2).is_running() && fixture.axis(3).is_running());
    fixture.cia402.command_all(AxisCommand::Enable).unwrap();
    fixture.until(2_000, Cia402::all_running);
    fixture.check();
}

#[test]
fn failed_step_of_one_axis_fails_the_node() {
    let mut table = table();
    table[1].drive.max_torque = Some(500);
    let scenario = scenario(1, |drive| {
        drive.axes = 2;
        if drive.node.get() == 1 {
            drive.quirks.missing = vec![0x6872];
        }
    });
    let mut fixture = Fixture::with(scenario, table);
    let error = fixture.cia402.blocking(&mut fixture.port, START).configure().unwrap_err();
    let Cia402Error::AxisTimeout(axes) = &error else { panic!("{error}") };
    let failed: Vec<_> = axes.axes.iter().map(|axis| axis.axis).collect();
    assert_eq!(failed, [0, 1]);
    assert!(error.to_string().contains("0x6872:00"), "{error}");
    assert!(fixture.axis(2).is_configured() && fixture.axis(3).is_configured());
}

#[test]
fn new_owner_stops_both_axes_of_a_node() {
    let mut fixture = in_motion();
    let config = Cia402Config::default();
    fixture.cia402 = Cia402::new(&fixture.port, table(), config).unwrap();
    let begin = fixture.now_ns();
    fixture.cia402.blocking(&mut fixture.port, START).configure().unwrap();
    for axis in 0..4 {
        assert!(is_off(&fixture, axis), "axis {axis}");
        let enabled_since = fixture.drive_axis(axis, |drive| {
            drive.trace().iter().any(|record| {
                record.time_ns > begin + 100 * MS
                    && matches!(record.event, ecan_sim::TraceEvent::Motion(sample)
                        if sample.velocity.abs() > 20_000.0)
            })
        });
        assert!(!enabled_since, "axis {axis} moves 100 ms later");
    }
    fixture.start();
    fixture.steps(50);
    fixture.check();
}

#[test]
fn lost_host_stops_both_axes() {
    let fixture = in_motion();
    fixture.simulation.pass_ns(600 * MS);
    for axis in 0..4 {
        assert_ne!(state(&fixture, axis), DriveState::OperationEnabled, "axis {axis}");
        let velocity = fixture.drive_axis(axis, |drive| drive.velocity());
        assert_eq!(velocity.abs().round(), 0.0, "axis {axis}");
    }
}

#[test]
fn shutdown_releases_a_node_after_both_axes() {
    let mut fixture = in_motion();
    fixture.cia402.blocking(&mut fixture.port, START).shut_down().unwrap();
    for axis in 0..4 {
        assert!(is_off(&fixture, axis), "axis {axis}");
        let watch = fixture.drive(axis, |drive| drive.object(object::CONSUMER_HEARTBEAT, 1));
        assert_eq!(watch, Some(0), "axis {axis}");
    }
    fixture.simulation.pass_ns(1_000 * MS);
    for axis in [0, 2] {
        assert_eq!(fixture.drive(axis, |drive| drive.error_code()), 0);
    }
    fixture.check();
}

/// The faults of a table whose second axis is changed.
fn faults(change: impl FnOnce(&mut AxisConfig)) -> Vec<(usize, AxisFault)> {
    let fixture = Fixture::with(two_axes(), table());
    let mut table = table();
    table.truncate(2);
    change(&mut table[1]);
    match Cia402::new(&fixture.port, table, Cia402Config::default()) {
        Err(Cia402Error::Axes(found)) => found.faults,
        other => panic!("{other:?}"),
    }
}

#[test]
fn axes_of_a_node_must_fit_together() {
    let address = axis(0, 0, 1).address;
    let id = |raw| CanId::standard(raw).unwrap();
    let same = AxisFault::SameCobId { cob_id: id(0x201), other: 0 };
    assert_eq!(faults(|axis| axis.pdos.number = 1), [(1, same)]);
    let other = AxisFault::NodeSettings { address, other: 0 };
    assert_eq!(faults(|axis| axis.drive.heartbeat_ms = 50), [(1, other)]);
    let guarding = GuardingConfig { guard_time: Duration::from_millis(20), life_time_factor: 5 };
    assert_eq!(faults(|axis| axis.drive.guarding = Some(guarding)), [(1, other)]);
    assert_eq!(faults(|axis| axis.node_axis = 8), [(1, AxisFault::NodeAxis { node_axis: 8 })]);
    let node = AxisFault::SameNode { address, other: 0 };
    assert_eq!(faults(|axis| axis.node_axis = 0), [(1, node)]);
    assert_eq!(faults(|axis| axis.pdos.number = 65), [(1, AxisFault::PdoNumber { number: 65 })]);
    let cob_ids = |rpdos: &[u16]| {
        let rpdos = rpdos.iter().map(|raw| id(*raw)).collect();
        faults(|axis| axis.pdos.cob_ids = PdoCobIds { rpdos, tpdos: Vec::new() })
    };
    assert_eq!(cob_ids(&[0x581]), [(1, AxisFault::CobId { cob_id: id(0x581) })]);
    let count = AxisFault::CobIdCount { found: 2, count: 1 };
    assert_eq!(cob_ids(&[0x301, 0x302]), [(1, count)]);
    assert_eq!(cob_ids(&[0x181]), [(1, AxisFault::SameCobId { cob_id: id(0x181), other: 0 })]);
    let same_pdo = faults(|axis| {
        axis.pdos.cob_ids = PdoCobIds { rpdos: vec![id(0x501)], tpdos: vec![id(0x481)] };
        axis.pdos.number = 1;
    });
    assert_eq!(same_pdo, [(1, AxisFault::SamePdo { number: 1, other: 0 })]);
}
