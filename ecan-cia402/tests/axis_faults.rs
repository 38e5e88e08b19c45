//! What goes wrong in the field, with axes in motion: what they see, how they come back, and by the
//! drives' own testimony that nothing jumped.
#![allow(missing_docs)]

use std::time::Duration;

use crate::axes::{Fixture, START, axes, axis, with_quirk};
use ecan_canopen::{CobId, DriveState, NmtCommand, NmtState, StepFault};
use ecan_cia402::{
    AxisCommand, AxisConfig, AxisError, AxisPhase, AxisTimeout, Cia402, Cia402Config, Cia402Error,
    Decision, HoldReason, InputObject, StopKind,
};
use ecan_mcan_port::Session;
use ecan_protocol::can::FrameRef;
use ecan_protocol::object::AbortCode;
use ecan_sim::{DriveFault, Fault, GatewayFault, LossDirection, SdoDirection, SdoEffect, SdoRule};
use tracing_test::traced_test;

fn moving(count: usize) -> Vec<AxisConfig> {
    axes(count).into_iter().map(|axis| axis.with_target_step(100)).collect()
}

/// Axes in motion.
fn in_motion(count: usize) -> Fixture {
    let mut fixture = Fixture::single(moving(count)).started();
    fixture.steps(100);
    assert!(fixture.cia402.all_running());
    fixture
}

fn held_for(cia402: &Cia402, axis: usize) -> Option<HoldReason> {
    cia402.axis(axis).unwrap().statistics().last_hold
}

/// Takes every axis up again and moves on.
fn recover(fixture: &mut Fixture) {
    fixture.cia402.command_all(AxisCommand::Enable).unwrap();
    fixture.until(5_000, Cia402::all_running);
    let before: Vec<_> =
        (0..fixture.cia402.axis_count()).map(|n| fixture.axis(n).target()).collect();
    fixture.steps(100);
    for (n, before) in before.into_iter().enumerate() {
        assert!(fixture.axis(n).target() > before, "axis {n} moves on");
    }
    fixture.check();
}

fn start_fails(fixture: &mut Fixture) -> AxisTimeout {
    match fixture.cia402.blocking(&mut fixture.port, START).start_up() {
        Err(Cia402Error::AxisTimeout(axes)) => axes,
        other => panic!("{other:?}"),
    }
}

#[test]
#[traced_test]
fn fault_holds_its_axis_until_a_reset_edge() {
    let mut fixture = in_motion(2);
    fixture.strike(0, DriveFault::Error { code: 0x2310 });
    fixture.until(50, |cia402| !cia402.axis(0).unwrap().is_running());
    assert!(matches!(held_for(&fixture.cia402, 0), Some(HoldReason::LeftOperationEnabled(_))));
    fixture.until(500, |cia402| cia402.axis(0).unwrap().drive_state() == Some(DriveState::Fault));
    let error = fixture.axis(0).error();
    assert_eq!(error, Some(AxisError::Fault { error_code: 0x2310 }));
    assert!(fixture.axis(1).is_running(), "the other axis continues");
    // Enabling does not reset.
    fixture.axis_mut(0).enable().unwrap();
    fixture.steps(50);
    assert_eq!(fixture.axis(0).drive_state(), Some(DriveState::Fault));
    fixture.axis_mut(0).reset_fault().unwrap();
    fixture.until(200, |cia402| {
        cia402.axis(0).unwrap().drive_state() == Some(DriveState::SwitchOnDisabled)
    });
    fixture.steps(50);
    assert_eq!(fixture.axis(0).drive_state(), Some(DriveState::SwitchOnDisabled), "by itself");
    recover(&mut fixture);
    assert_eq!(fixture.axis(0).statistics().faults, 1);
    logs_assert(|lines: &[&str]| {
        let texts = ["axis 0: active", "axis 1: active", "axis 0: fault (0x2310)"];
        let has = |text: &&&str| lines.iter().any(|line| line.contains(**text));
        let missing: Vec<_> = texts.iter().filter(|text| !has(text)).collect();
        if missing.is_empty() { Ok(()) } else { Err(format!("{missing:?}")) }
    });
}

#[test]
fn persistent_fault_is_reported_after_a_reset() {
    let scenario = with_quirk(1, 1, |quirks| quirks.stuck_in_fault = true);
    let mut fixture = Fixture::with(scenario, moving(1)).started();
    fixture.strike(0, DriveFault::Error { code: 0x7305 });
    fixture.until(500, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Fault);
    fixture.axis_mut(0).reset_fault().unwrap();
    fixture.until(2_000, |cia402| {
        cia402.axis(0).unwrap().error() == Some(AxisError::ResetFailed { error_code: 0x7305 })
    });
    fixture.check();
}

#[test]
fn quick_stop_stops_and_can_be_left() {
    let mut fixture = in_motion(1);
    fixture.axis_mut(0).stop(StopKind::QuickStop);
    fixture.until(500, |cia402| {
        cia402.axis(0).unwrap().drive_state() != Some(DriveState::OperationEnabled)
    });
    fixture.steps(300);
    assert!(fixture.drive(0, |drive| drive.velocity()).abs() < 10.0);
    assert_eq!(fixture.axis(0).decision(), Decision::Closed);
    recover(&mut fixture);
}

#[test]
fn silent_drive_holds_by_tpdo_then_by_heartbeat() {
    let mut fixture = in_motion(2);
    let name = "drive 0.0/1".to_owned();
    let known = fixture.simulation.with_world(|world| world.drive(&name).is_some());
    assert!(known, "the scenario's name of the first drive");
    fixture.inject(Fault::NodeSilent { node: name, for_ms: 600 });
    let cycles = fixture.until(50, |cia402| !cia402.axis(0).unwrap().is_running());
    assert!(cycles <= 10, "{cycles}");
    assert!(matches!(held_for(&fixture.cia402, 0), Some(HoldReason::TpdoLost(_))));
    fixture.axis_mut(0).enable().unwrap();
    fixture.steps(200);
    let text = fixture.axis(0).progress().to_string();
    assert!(text.contains("heartbeat"), "{text}");
    assert!(fixture.axis(1).is_running());
    fixture.until(1_000, |cia402| cia402.axis(0).unwrap().is_running());
    recover(&mut fixture);
}

#[test]
fn emergency_message_alone_stops_nothing() {
    let mut fixture = in_motion(1);
    fixture.strike(0, DriveFault::Emcy { code: 0x4210, register: 8 });
    fixture.steps(50);
    assert_eq!(fixture.axis(0).statistics().emergencies, 1);
    assert!(fixture.axis(0).is_running());
    fixture.check();
}

#[test]
fn drive_power_loss_in_motion_needs_a_new_configuration() {
    let mut fixture = in_motion(2);
    fixture.strike(0, DriveFault::PowerCycle { off_ms: 300 });
    fixture.until(50, |cia402| !cia402.axis(0).unwrap().is_running());
    fixture.until(1_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::NotConfigured);
    assert_eq!(fixture.axis(0).error(), Some(AxisError::Restarted));
    assert!(fixture.axis_mut(0).enable().is_err(), "not configured");
    assert!(fixture.axis(1).is_running());
    fixture.cia402.command_all(AxisCommand::Configure).unwrap();
    fixture.until(1_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Standby);
    recover(&mut fixture);
}

#[test]
fn rejected_object_is_reported_with_its_abort_code() {
    let rule = SdoRule {
        index: 0x6065,
        subindex: None,
        direction: SdoDirection::Write,
        effect: SdoEffect::Abort(AbortCode::RANGE),
        times: None,
    };
    let scenario = with_quirk(1, 2, |quirks| quirks.sdo_rules.push(rule));
    let mut table = moving(2);
    for axis in &mut table {
        axis.drive.following_error = Some((10_000, 10));
    }
    let mut fixture = Fixture::with(scenario, table);
    let text = start_fails(&mut fixture).to_string();
    for part in ["1 axis not configured", "axis 1", "node 2", "0x6065", "0x06090030"] {
        assert!(text.contains(part), "{text}");
    }
    assert!(fixture.axis(0).phase() == AxisPhase::Standby, "the other one is configured");
}

#[test]
fn unanswered_object_is_retried_then_reported() {
    let rule = |times| SdoRule {
        index: 0x1A00,
        subindex: Some(1),
        direction: SdoDirection::Write,
        effect: SdoEffect::Silence,
        times,
    };
    let scenario = with_quirk(1, 1, |quirks| quirks.sdo_rules.push(rule(Some(1))));
    let mut fixture = Fixture::with(scenario, moving(1)).started();
    fixture.check();
    let scenario = with_quirk(1, 1, |quirks| quirks.sdo_rules.push(rule(None)));
    fixture = Fixture::with(scenario, moving(1));
    let text = start_fails(&mut fixture).to_string();
    assert!(text.contains("0x1A00:01") && text.contains("no answer"), "{text}");
}

#[test]
fn fixed_mapping_is_used_as_it_is_or_reported() {
    let scenario = with_quirk(1, 1, |quirks| quirks.fixed_mapping = true);
    let mut axes = moving(1);
    // RPDO 3 has controlword and target position, TPDO 3 statusword and actual position.
    axes[0].pdos.number = 3;
    Fixture::with(scenario.clone(), axes.clone()).started().check();
    axes[0].pdos.inputs.push(InputObject::Torque);
    let mut fixture = Fixture::with(scenario, axes);
    let text = start_fails(&mut fixture).to_string();
    assert!(text.contains("readback (check 0x1A02:00): value is 0x2, expected 0x3"), "{text}");
}

#[test]
fn rejected_mode_is_reported() {
    let scenario = with_quirk(1, 1, |quirks| quirks.ignored_modes = vec![8]);
    let mut fixture = Fixture::with(scenario, moving(1));
    let axes = start_fails(&mut fixture);
    let Some(AxisError::Setup(failure)) = axes.axes[0].error else { panic!("{axes}") };
    assert!(matches!(failure.fault, StepFault::TimedOut { .. }), "{failure}");
    let text = axes.to_string();
    assert!(text.contains("mode CSP") && text.contains("0x6061"), "{text}");
}

#[test]
fn slow_mode_change_is_awaited() {
    let scenario = with_quirk(1, 1, |quirks| quirks.mode_delay_ms = 300);
    Fixture::with(scenario, moving(1)).started().check();
}

#[test]
fn missing_boot_up_is_reported() {
    let scenario = with_quirk(1, 1, |quirks| quirks.never_boots = true);
    let mut fixture = Fixture::with(scenario, moving(2));
    let text = start_fails(&mut fixture).to_string();
    assert!(text.contains("axis 0") && !text.contains("axis 1"), "{text}");
}

#[test]
fn slow_brake_is_reported_as_enable_timeout() {
    let scenario = crate::axes::scenario(1, |settings| settings.enable_ms = 400);
    let mut table = moving(1);
    let mut fixture = Fixture::with(scenario.clone(), table.clone()).started();
    fixture.steps(50);
    fixture.check();
    table[0].enable_timeout = Duration::from_millis(200);
    fixture = Fixture::with(scenario, table);
    let text = start_fails(&mut fixture).to_string();
    assert!(text.contains("not enabled after") && text.contains("switched on"), "{text}");
}

#[test]
fn lost_frame_only_repeats_the_last_image() {
    for way in [LossDirection::Outward, LossDirection::Return] {
        let mut fixture = in_motion(4);
        fixture.inject(Fault::LostFrame { direction: way, cycles: 1 });
        fixture.steps(50);
        for n in 0..4 {
            let statistics = fixture.axis(n).statistics();
            assert_eq!((statistics.holds, statistics.waits), (0, 1), "axis {n}, {way:?}");
        }
        fixture.check();
    }
}

/// A short bus-off while the gateway's images are damaged is reported by nothing. The path of the application
/// leads away from the last target, which the drive does not have, and past it again.
#[test]
fn targets_lost_without_a_report_hold_the_axis() {
    let holds: Vec<_> = (0..8).map(hold_after_bus_off_behind_damaged_images).collect();
    assert!(holds.contains(&HoldReason::BusOff), "{holds:?}");
    assert!(holds.contains(&HoldReason::NotAtTarget), "{holds:?}");
}

fn hold_after_bus_off_behind_damaged_images(images: u32) -> HoldReason {
    let mut table = moving(1);
    table[0].tolerances.tpdo_timeout = 30;
    let mut fixture = Fixture::single(table).started();
    fixture.steps(100);
    fixture.inject(Fault::BusOff { gateway: 0, channel: 0 });
    let fault = GatewayFault::TornTxPdo { images };
    fixture.inject(Fault::Gateway { gateway: 0, fault });
    for _ in 0..100 {
        fixture.cycle_with(|cia402, cycle| {
            let _ = cia402.axis_mut(0).unwrap().set_target(1_000_000);
            cia402.send_targets_all(cycle)
        });
    }
    fixture.steps(50);
    let hold = held_for(&fixture.cia402, 0).unwrap_or_else(|| panic!("{images}: follows targets"));
    fixture.check();
    recover(&mut fixture);
    hold
}

/// The load keeps the motor from the last increments: within twice its standstill tolerance of the last target, the
/// drive has got that target.
#[test]
fn drive_near_its_last_target_continues_after_missing_answers() {
    for (distance, holds) in [(30, false), (60, true)] {
        let mut table = moving(1);
        assert_eq!(table[0].standstill, 20);
        (table[0].tolerances.tpdo_timeout, table[0].tolerances.wc_misses) = (100, 100);
        let mut fixture = Fixture::single(table).started();
        fixture.strike(0, DriveFault::Blocked { for_ms: 5_000 });
        let target = fixture.axis(0).target().unwrap() + distance;
        fixture.axis_mut(0).set_target(target).unwrap();
        fixture.idle(20);
        assert_eq!(fixture.axis(0).actual().map(|at| target - at), Some(distance));
        fixture.inject(Fault::LostFrame { direction: LossDirection::Return, cycles: 8 });
        fixture.idle(200);
        let reason = held_for(&fixture.cia402, 0);
        assert_eq!(reason, holds.then_some(HoldReason::NotAtTarget), "{distance} away");
        assert_eq!(fixture.axis(0).is_running(), !holds);
    }
}

#[test]
fn lost_working_counter_holds_until_activation() {
    let mut fixture = in_motion(4);
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
    fixture.until(20, |cia402| !cia402.axis(0).unwrap().is_running());
    fixture.steps(50);
    for n in 0..4 {
        let reason = held_for(&fixture.cia402, n);
        assert_eq!(reason, Some(HoldReason::WorkingCounter), "axis {n}");
        assert!(!fixture.axis(n).is_running());
    }
    assert_eq!(fixture.session(), Session::Ready);
    assert!(fixture.statistics().rxpdo_discarded > 0);
    recover(&mut fixture);
}

#[test]
fn axis_resumes_by_itself_after_a_path_error() {
    let mut table = moving(2);
    table[0].auto_resume = true;
    let mut fixture = Fixture::single(table).started();
    fixture.steps(100);
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
    fixture.steps(100);
    assert!(fixture.axis(0).is_running() && !fixture.axis(1).is_running());
    assert_eq!(fixture.axis(0).statistics().activations, 2);
    // What lies in the drive is not for it to decide.
    fixture.strike(0, DriveFault::Error { code: 0x2310 });
    fixture.steps(500);
    assert_eq!(fixture.axis(0).drive_state(), Some(DriveState::Fault));
    fixture.check();
}

#[test]
fn after_bus_off_stale_targets_are_waited_out() {
    let mut fixture = in_motion(4);
    fixture.inject(Fault::BusOff { gateway: 0, channel: 0 });
    fixture.until(20, |cia402| !cia402.axis(0).unwrap().is_running());
    for n in 0..4 {
        assert_eq!(held_for(&fixture.cia402, n), Some(HoldReason::BusOff), "axis {n}");
        assert_eq!(fixture.axis(n).status().hold_reason, Some(HoldReason::BusOff), "axis {n}");
    }
    fixture.steps(500);
    assert!((0..4).all(|n| !fixture.axis(n).is_running()));
    recover(&mut fixture);
}

#[test]
fn gateway_power_loss_in_motion_recovers() {
    let mut fixture = in_motion(4);
    fixture.inject(Fault::PowerCycle { gateway: 0, off_ms: 500 });
    fixture.until(50, |cia402| !cia402.axis(0).unwrap().is_running());
    let mut cycles = 0;
    while fixture.session() != Session::Ready || cycles < 500 {
        fixture.step();
        cycles += 1;
        assert!(cycles < 30_000, "{}", fixture.session());
    }
    for n in 0..4 {
        let (state, operational) =
            fixture.drive(n, |drive| (drive.state(), drive.nmt_state() == NmtState::Operational));
        // It noticed that the host was gone, and stopped by itself.
        assert_eq!((state, operational), (DriveState::SwitchOnDisabled, false), "axis {n}");
        assert!(!fixture.axis(n).is_running());
    }
    recover(&mut fixture);
}

#[test]
fn unnoticed_drive_restart_is_detected() {
    let mut fixture = in_motion(2);
    fixture.inject(Fault::PowerCycle { gateway: 0, off_ms: 500 });
    fixture.steps(20);
    fixture.strike(0, DriveFault::PowerCycle { off_ms: 50 });
    let mut cycles = 0;
    while fixture.session() != Session::Ready || cycles < 500 {
        fixture.step();
        cycles += 1;
        assert!(cycles < 30_000, "{}", fixture.session());
    }
    // Its boot-up message came while nobody listened: only its mapping tells.
    fixture.until(500, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::NotConfigured);
    assert_eq!(fixture.axis(0).error(), Some(AxisError::Restarted));
    assert_ne!(fixture.axis(1).phase(), AxisPhase::NotConfigured, "the other kept it");
    fixture.cia402.command_all(AxisCommand::Configure).unwrap();
    fixture.until(1_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Standby);
    recover(&mut fixture);
}

#[test]
fn unnoticed_restart_during_configuration_is_detected() {
    for steps in [8, 15, 20, 30, 38] {
        let mut fixture = Fixture::single(moving(1));
        fixture.cia402.command_all(AxisCommand::Configure).unwrap();
        fixture.until(500, |cia402| {
            let setup = cia402.axis(0).unwrap().progress().setup;
            setup.is_some_and(|setup| setup.done >= steps)
        });
        // Its boot-up message is lost; the request under way is repeated and answered.
        fixture.strike(0, DriveFault::PowerCycle { off_ms: 50 });
        fixture.inject(Fault::NodeSilent { node: "drive 0.0/1".into(), for_ms: 300 });
        // Or the configuration itself reads back what is missing.
        let is_found = [AxisPhase::NotConfigured, AxisPhase::SetupFailed];
        fixture.until(1_000, |cia402| is_found.contains(&cia402.axis(0).unwrap().phase()));
        fixture.cia402.command_all(AxisCommand::Configure).unwrap();
        fixture.until(1_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Standby);
        recover(&mut fixture);
    }
}

/// An axis whose node is in NMT Stopped by a command of another master, and has no heartbeat: after a
/// restart, which has cleared it, or configured without one.
fn stopped_without_heartbeat(has_restarted: bool) -> Fixture {
    let mut table = moving(1);
    table[0].drive.heartbeat_ms = if has_restarted { 100 } else { 0 };
    let mut fixture = Fixture::single(table).started();
    if has_restarted {
        fixture.strike(0, DriveFault::PowerCycle { off_ms: 1 });
        fixture.steps(200);
    }
    fixture.cycle_with(|_, cycle| {
        let frame = FrameRef::classic(CobId::NMT.can_id(), &[2, 0]).unwrap();
        let channel = cycle.channel(0, 0).unwrap();
        cycle.send(channel, frame).unwrap();
    });
    fixture.steps(50);
    assert_eq!(fixture.drive(0, |drive| drive.nmt_state()), NmtState::Stopped);
    fixture
}

type Return = fn(&mut Fixture);

#[test]
fn stopped_node_without_heartbeat_returns() {
    let returns: [(&str, Return); 4] = [
        ("recover", |fixture| fixture.axis_mut(0).recover().unwrap()),
        ("stop, then recover", |fixture| {
            fixture.cia402.command_all(AxisCommand::Stop(StopKind::QuickStopThenDisable)).unwrap();
            fixture.until(2_000, Cia402::all_stopped);
            fixture.axis_mut(0).recover().unwrap();
        }),
        ("configure", |fixture| {
            fixture.axis_mut(0).configure().unwrap();
            fixture.until(2_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Standby);
            fixture.axis_mut(0).enable().unwrap();
        }),
        ("new owner", |fixture| {
            let table = vec![fixture.axis(0).config().clone()];
            let owner = Cia402::new(&fixture.port, table, Cia402Config::default());
            fixture.cia402 = owner.unwrap_or_else(|error| panic!("{error}"));
            fixture.start();
        }),
    ];
    for has_restarted in [true, false] {
        for (name, begin_return) in returns {
            println!("{name}, restarted {has_restarted}");
            let mut fixture = stopped_without_heartbeat(has_restarted);
            begin_return(&mut fixture);
            fixture.until(2_500, Cia402::all_running);
            assert_eq!(fixture.drive(0, |drive| drive.nmt_state()), NmtState::Operational);
        }
    }
}

/// The host commanded Stopped, and the last status of the drive is still fresh.
#[test]
fn node_that_was_just_stopped_is_configured() {
    let mut table = moving(1);
    table[0].drive.heartbeat_ms = 0;
    let mut fixture = Fixture::single(table).started();
    fixture.cia402.command_all(AxisCommand::Stop(StopKind::QuickStopThenDisable)).unwrap();
    fixture.until(500, Cia402::all_stopped);
    fixture.cia402.send_nmt_all(NmtCommand::Stop).unwrap();
    fixture.steps(2);
    fixture.axis_mut(0).configure().unwrap();
    fixture.until(1_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Standby);
    assert_eq!(fixture.axis(0).error(), None);
}

#[test]
fn blocked_motor_stops_targets_at_the_window() {
    let mut fixture = in_motion(1);
    fixture.strike(0, DriveFault::Blocked { for_ms: 2_000 });
    fixture.steps(400);
    assert!(fixture.axis(0).statistics().rejected_window > 0 || !fixture.axis(0).is_running());
    fixture.check();
}

#[test]
fn target_beyond_the_limits_is_rejected_with_its_reason() {
    let mut fixture = Fixture::single(vec![axis(0, 0, 1)]).started();
    let at = fixture.axis(0).target().unwrap();
    fixture.axis_mut(0).set_target(at + 1_001).unwrap();
    fixture.idle(5);
    assert!(matches!(fixture.axis(0).decision(), Decision::Reject(_)));
    assert_eq!(fixture.axis(0).target(), Some(at));
    fixture.axis_mut(0).set_target(at + 1_000).unwrap();
    fixture.idle(1);
    assert_eq!(fixture.axis(0).decision(), Decision::Target(at + 1_000));
    assert_eq!(fixture.axis(0).statistics().rejected_step, 5);
    fixture.check();
}
