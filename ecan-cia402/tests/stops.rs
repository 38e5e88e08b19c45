//! Stops in every state and mode, judged by velocity and state of the simulated drive.
#![allow(missing_docs)]

use std::time::Duration;

use crate::axes::{Fixture, START, node};
use crate::support::stops::{
    HostHeartbeat, PROFILE, QUICK, RATE_AND_PROFILE_MODES, REACTION_MS, REST, RETURN_MS, SPEED,
    Trace, assert_runs_again, assert_stays_stopped, at_speed, at_speed_with, config, drives,
    now_ms, open, replace_owner, silence, state, table, until_reached, velocity,
};
use ecan_canopen::{DriveState, OperatingMode, QuickStopOption, SyncConfig};
use ecan_cia402::{
    AxisCommand, AxisConfig, AxisOwner, AxisPhase, Cia402, Cia402Config, HomingConfig, StopCause,
    StopKind,
};
use ecan_host::{AdapterConfig, DcSync};
use ecan_mcan_port::{ChannelConfig, GatewayConfig};
use ecan_sim::{
    DriveFault, Fault, LibraryCall, LossDirection, Simulation, TraceEvent, TraceRecord,
};

// A stop acts in every state of the axis

/// A stop call on the axis.
type StopCall = (&'static str, fn(&mut Cia402), f64);

fn stop_all(cia402: &mut Cia402, kind: StopKind) {
    cia402.command_all(AxisCommand::Stop(kind)).unwrap();
}

const STOP_CALLS: [StopCall; 4] = [
    ("quick_stop", |cia402| cia402.axis_mut(0).unwrap().stop(StopKind::QuickStop), QUICK),
    ("quick stop of all", |cia402| stop_all(cia402, StopKind::QuickStop), QUICK),
    ("disable", |cia402| cia402.axis_mut(0).unwrap().stop(StopKind::Disable), PROFILE),
    ("disable all", |cia402| stop_all(cia402, StopKind::Disable), PROFILE),
];

#[test]
fn stop_after_a_failed_configuration_reaches_the_drive() {
    for (name, stop, deceleration) in STOP_CALLS {
        for once in [true, false] {
            let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
            silence(&fixture, 3_000);
            let silent_ms = now_ms(&fixture);
            fixture.steps(5);
            fixture.axis_mut(0).configure().unwrap();
            fixture.steps(900);
            let before = velocity(&fixture);
            let start_ms = now_ms(&fixture);
            stop(&mut fixture.cia402);
            while now_ms(&fixture) < silent_ms + 3_000.0 {
                if !once {
                    stop(&mut fixture.cia402);
                }
                fixture.step();
            }
            let returned_ms = now_ms(&fixture) - start_ms;
            let trace = Trace::of(&mut fixture);
            println!(
                "{name}, once {once}: {before:.0}/s at the call, returned {returned_ms:.0} ms \
                 later: {trace}"
            );
            trace.assert_rest(RETURN_MS, deceleration).assert_no_coasting();
            assert_stays_stopped(&mut fixture);
        }
    }
}

#[test]
fn stop_of_a_drive_of_an_earlier_owner_reaches_it() {
    for (name, stop, deceleration) in STOP_CALLS {
        for mode in RATE_AND_PROFILE_MODES {
            let mut fixture = at_speed(mode, HostHeartbeat::Off);
            replace_owner(&mut fixture, mode, HostHeartbeat::Off);
            stop(&mut fixture.cia402);
            let trace = Trace::of(&mut fixture);
            println!("{name}, {mode}: {trace}");
            trace.assert_rest(RETURN_MS, deceleration).assert_no_coasting();
            assert_stays_stopped(&mut fixture);
        }
    }
}

#[test]
fn configure_of_a_moving_axis_does_not_coast() {
    for mode in [OperatingMode::CyclicVelocity, OperatingMode::CyclicPosition] {
        let mut fixture = at_speed(mode, HostHeartbeat::On);
        fixture.axis_mut(0).configure().unwrap();
        let trace = Trace::of(&mut fixture);
        println!("configure, {mode}: {trace}");
        trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
        fixture.until(2_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Standby);
    }
}

/// A target that waits in the drive for its SYNC must not undo the stop that a configuration begins.
#[test]
fn waiting_target_does_not_undo_the_stop_of_configure() {
    for (cycles, sync_ns) in (0..8).flat_map(|cycles| [(cycles, None), (cycles, Some(50_000))]) {
        let mode = OperatingMode::CyclicVelocity;
        let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
        adapter.dc = Some(DcSync::new(Duration::from_millis(1), Duration::from_micros(700)));
        let mut axes = table(mode, HostHeartbeat::Off);
        axes[0].step_limit = SPEED as u32;
        axes[0].drive.quick_stop = Some(QuickStopOption::QuickStopAndStay);
        let settings = Cia402Config { motion_div: 4, ..config(HostHeartbeat::Off) };
        let traced = drives(|drive| drive.trace = 100_000);
        let mut fixture = Fixture::open_with(traced, adapter, axes, settings);
        fixture.cia402.set_scheduled_tx(&fixture.port, Some(100_000), sync_ns).unwrap();
        let mut fixture = at_speed_with(fixture, mode);
        fixture.steps(cycles);
        let call = LibraryCall::DomainState;
        fixture.inject(Fault::LibraryError { call, errno: 4, times: 2 });
        fixture.axis_mut(0).configure().unwrap();
        let before = fixture.drive_axis(0, |axis| axis.trace().recorded());
        let trace = Trace::of(&mut fixture);
        println!("configure {cycles} cycles later: {trace}");
        trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
        let enabled = fixture.drive_axis(0, |axis| {
            let is_enable =
                |record: &&TraceRecord| matches!(record.event, TraceEvent::Enable { .. });
            axis.trace().since(before).find(is_enable).copied()
        });
        assert_eq!(enabled, None, "configure {cycles} cycles later");
        fixture.until(2_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Standby);
    }
}

#[test]
fn quick_stop_during_configuration_stops_the_motor() {
    for cycles in [0, 1, 2, 3, 5, 8, 20, 40] {
        let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
        fixture.axis_mut(0).configure().unwrap();
        fixture.steps(cycles);
        fixture.axis_mut(0).stop(StopKind::QuickStop);
        let trace = Trace::of(&mut fixture);
        println!("quick stop {cycles} cycles after configure: {trace}");
        trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
        assert_stays_stopped(&mut fixture);
    }
}

#[test]
fn quick_stop_while_the_mode_is_set_keeps_the_drive_off() {
    let scenario = drives(|drive| drive.quirks.mode_delay_ms = 300);
    let mut fixture = open(scenario, OperatingMode::CyclicVelocity, HostHeartbeat::On);
    fixture.cia402.command_all(AxisCommand::Configure).unwrap();
    fixture.until(1_000, |cia402| {
        matches!(cia402.axis(0).unwrap().phase(), AxisPhase::SettingMode(_))
    });
    fixture.axis_mut(0).stop(StopKind::QuickStop);
    assert_stays_stopped(&mut fixture);
    fixture.axis_mut(0).configure().unwrap();
    fixture.until(1_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Standby);
    assert_runs_again(&mut fixture);
}

/// The drive ran on while its gateway was away: its configuration has to be verified first.
#[test]
fn quick_stop_during_verification_stops_the_motor() {
    for mode in [OperatingMode::CyclicVelocity, OperatingMode::ProfileVelocity] {
        for cycles in [0, 1, 2, 5] {
            let mut fixture = at_speed(mode, HostHeartbeat::Off);
            fixture.inject(Fault::PowerCycle { gateway: 0, off_ms: 200 });
            fixture.steps(100);
            fixture.axis_mut(0).stop(StopKind::QuickStop);
            until_reached(&mut fixture);
            fixture.steps(cycles);
            fixture.axis_mut(0).stop(StopKind::QuickStop);
            let trace = Trace::of(&mut fixture);
            println!("{mode}, {cycles} cycles after the return of the gateway: {trace}");
            trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
            assert_stays_stopped(&mut fixture);
        }
    }
}

#[test]
fn quick_stop_while_enabling_ends_off() {
    for cycles in [0, 1, 2, 5, 20, 45, 60] {
        let scenario = drives(|drive| drive.enable_ms = 100);
        let mut fixture =
            open(scenario, OperatingMode::CyclicVelocity, HostHeartbeat::On).started();
        fixture.axis_mut(0).stop(StopKind::Disable);
        fixture.until(500, |cia402| {
            cia402.axis(0).unwrap().drive_state() == Some(DriveState::SwitchOnDisabled)
        });
        fixture.axis_mut(0).enable().unwrap();
        fixture.steps(cycles);
        fixture.axis_mut(0).stop(StopKind::QuickStop);
        assert_stays_stopped(&mut fixture);
        assert_runs_again(&mut fixture);
    }
}

#[test]
fn quick_stop_during_homing_stops_the_motor() {
    let mut fixture = open(drives(|_| {}), OperatingMode::CyclicPosition, HostHeartbeat::On);
    fixture.start();
    fixture.axis_mut(0).home(HomingConfig::new(19)).unwrap();
    let mut limit = 5_000;
    while velocity(&fixture).abs() < 100_000.0 && limit > 0 {
        fixture.idle(1);
        limit -= 1;
    }
    assert!(matches!(fixture.axis(0).phase(), AxisPhase::Homing(_)));
    fixture.axis_mut(0).stop(StopKind::QuickStop);
    let trace = Trace::of(&mut fixture);
    println!("homing: {trace}");
    trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
    assert_stays_stopped(&mut fixture);
}

#[test]
fn quick_stop_during_a_mode_change_stops_the_motor() {
    for cycles in [0, 1, 3, 20, 60, 100, 120, 140] {
        let mut fixture = at_speed(OperatingMode::CyclicPosition, HostHeartbeat::On);
        fixture.axis_mut(0).change_mode(OperatingMode::ProfilePosition).unwrap();
        fixture.steps(cycles);
        fixture.axis_mut(0).stop(StopKind::QuickStop);
        let trace = Trace::of(&mut fixture);
        println!("quick stop {cycles} cycles after change_mode: {trace}");
        trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
        assert_stays_stopped(&mut fixture);
    }
}

#[test]
fn quick_stop_in_fault_reaction_does_not_coast() {
    for cycles in [0, 5, 20, 150] {
        let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
        fixture.strike(0, DriveFault::Error { code: 0x2310 });
        fixture.steps(cycles);
        fixture.axis_mut(0).stop(StopKind::QuickStop);
        let trace = Trace::of(&mut fixture);
        println!("quick stop {cycles} cycles after the fault: {trace}");
        trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
        assert_stays_stopped(&mut fixture);
    }
}

#[test]
fn quick_stop_during_a_fault_reset_keeps_the_drive_off() {
    for cycles in [0, 1, 3, 6, 10] {
        let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
        fixture.strike(0, DriveFault::Error { code: 0x2310 });
        fixture
            .until(500, |cia402| cia402.axis(0).unwrap().drive_state() == Some(DriveState::Fault));
        fixture.axis_mut(0).reset_fault().unwrap();
        fixture.steps(cycles);
        fixture.axis_mut(0).stop(StopKind::QuickStop);
        assert_stays_stopped(&mut fixture);
        fixture.axis_mut(0).reset_fault().unwrap();
        fixture.steps(50);
        assert_runs_again(&mut fixture);
    }
}

// A stop acts while nothing can be sent

#[test]
fn quick_stop_during_bus_off_acts_on_recovery() {
    use OperatingMode as M;
    for mode in [M::CyclicVelocity, M::CyclicTorque, M::ProfileVelocity, M::CyclicPosition] {
        for cycles in [0, 1, 3] {
            let mut fixture = at_speed(mode, HostHeartbeat::Off);
            fixture.inject(Fault::BusOff { gateway: 0, channel: 0 });
            fixture.steps(cycles);
            fixture.axis_mut(0).stop(StopKind::QuickStop);
            let trace = Trace::of(&mut fixture);
            println!("{mode}, {cycles} cycles after bus-off: {trace}");
            trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
            assert_stays_stopped(&mut fixture);
        }
    }
}

#[test]
fn quick_stop_while_frames_are_lost_acts_on_return() {
    for direction in [LossDirection::Outward, LossDirection::Return] {
        for mode in RATE_AND_PROFILE_MODES {
            let mut fixture = at_speed(mode, HostHeartbeat::Off);
            fixture.inject(Fault::LostFrame { direction, cycles: 150 });
            fixture.steps(2);
            fixture.axis_mut(0).stop(StopKind::QuickStop);
            fixture.steps(148);
            until_reached(&mut fixture);
            let trace = Trace::of(&mut fixture);
            println!("{mode}, {direction:?}: {trace}");
            trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
            assert_stays_stopped(&mut fixture);
        }
    }
}

#[test]
fn quick_stop_of_a_silent_drive_acts_and_is_confirmed() {
    let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
    silence(&fixture, 1_000);
    fixture.steps(2);
    fixture.axis_mut(0).stop(StopKind::QuickStop);
    // The drive receives, although it sends nothing.
    Trace::of(&mut fixture).assert_rest(REACTION_MS, QUICK).assert_no_coasting();
    fixture.until(1_000, |cia402| {
        cia402.axis(0).unwrap().drive_state() == Some(DriveState::SwitchOnDisabled)
    });
    assert_stays_stopped(&mut fixture);
}

#[test]
fn shutdown_stops_an_unconfigured_moving_axis() {
    for mode in RATE_AND_PROFILE_MODES {
        let mut fixture = at_speed(mode, HostHeartbeat::Off);
        replace_owner(&mut fixture, mode, HostHeartbeat::Off);
        let result = fixture.cia402.blocking(&mut fixture.port, START).shut_down();
        let (state, velocity) = (state(&fixture), velocity(&fixture));
        println!("{mode}: {result:?}, {velocity:.0}/s in {state}");
        assert!(velocity.abs() < REST, "{mode}: {velocity}/s in {state}");
        assert_eq!(state, DriveState::SwitchOnDisabled, "{mode}");
        result.unwrap();
    }
}

#[test]
fn shutdown_reports_a_moving_axis_that_it_cannot_reach() {
    let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::Off);
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 100_000 });
    replace_owner(&mut fixture, OperatingMode::CyclicVelocity, HostHeartbeat::Off);
    let limit = Duration::from_secs(2);
    let result = fixture.cia402.blocking(&mut fixture.port, limit).shut_down();
    println!("{result:?}, {:.0}/s", velocity(&fixture));
    assert!(result.is_err(), "{:.0}/s in {}", velocity(&fixture), state(&fixture));
}

/// A link that is away at the begin of a shutdown, without a watch of the host by the drive.
#[test]
fn shutdown_waits_for_a_path_that_returns() {
    for mode in RATE_AND_PROFILE_MODES {
        for is_shutdown in [true, false] {
            let mut fixture = at_speed(mode, HostHeartbeat::Off);
            fixture.inject(Fault::LinkLoss { gateway: 0, for_ms: 50 });
            fixture.steps(5);
            let limit = Duration::from_secs(12);
            let Fixture { cia402, port, .. } = &mut fixture;
            let result = match is_shutdown {
                true => cia402.blocking(port, limit).shut_down(),
                false => cia402.blocking(port, limit).stop(),
            };
            result.unwrap_or_else(|error| panic!("{mode}: {error}"));
            // The program ends.
            fixture.simulation.pass_ns(1_000_000_000);
            let (state, velocity) = (state(&fixture), velocity(&fixture));
            assert!(velocity.abs() < REST, "{mode}: {velocity}/s in {state}");
            assert_eq!(state, DriveState::SwitchOnDisabled, "{mode}");
        }
    }
}

/// The whole time is used, and the axes are named that did not confirm their stop.
#[test]
fn stop_without_a_path_uses_its_time_and_names_the_axis() {
    for (is_shutdown, limit_ms) in [(true, 1_000), (true, 3_000), (false, 1_000)] {
        let mut fixture = at_speed(OperatingMode::ProfileVelocity, HostHeartbeat::Off);
        fixture.inject(Fault::LinkLoss { gateway: 0, for_ms: 60_000 });
        let begin_ms = now_ms(&fixture);
        let limit = Duration::from_millis(limit_ms);
        let Fixture { cia402, port, .. } = &mut fixture;
        let result = match is_shutdown {
            true => cia402.blocking(port, limit).shut_down(),
            false => cia402.blocking(port, limit).stop(),
        };
        let text = result.unwrap_err().to_string();
        let waited = now_ms(&fixture) - begin_ms;
        assert!(waited >= limit_ms as f64 && waited < limit_ms as f64 + 20.0, "{waited} ms");
        for part in ["1 axis not", "may still move", "axis 0, node 1", "uncontrolled"] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }
}

/// The last status, of a drive that was off, is older than the command.
#[test]
fn stop_needs_a_status_that_is_newer_than_the_command() {
    let mode = OperatingMode::ProfileVelocity;
    let mut fixture = open(drives(|_| {}), mode, HostHeartbeat::Off);
    fixture.start();
    fixture.cia402.blocking(&mut fixture.port, START).stop().unwrap();
    fixture.inject(Fault::LinkLoss { gateway: 0, for_ms: 60_000 });
    // The last status is still fresh.
    fixture.steps(5);
    let limit = Duration::from_millis(500);
    let stopped = fixture.cia402.blocking(&mut fixture.port, limit).stop();
    assert!(stopped.is_err(), "nothing confirmed it");
}

fn velocity_in(simulation: &Simulation) -> f64 {
    simulation.with_world(|world| world.drive_at(0, 0, node(1)).unwrap().velocity())
}

/// The end of a scope, for example by an error.
#[test]
fn dropped_owner_stops_its_axes() {
    for mode in RATE_AND_PROFILE_MODES {
        let Fixture { port, cia402, simulation } = at_speed(mode, HostHeartbeat::Off);
        simulation.inject(Fault::LinkLoss { gateway: 0, for_ms: 50 });
        drop(AxisOwner::new(port, cia402));
        simulation.pass_ns(1_000_000_000);
        assert!(velocity_in(&simulation).abs() < REST, "{mode}: {}/s", velocity_in(&simulation));
    }
}

#[test]
fn dropped_owner_waits_at_most_its_stop_time() {
    for stop_ms in [0, 500] {
        let Fixture { port, mut cia402, simulation } =
            at_speed(OperatingMode::ProfileVelocity, HostHeartbeat::Off);
        simulation.inject(Fault::LinkLoss { gateway: 0, for_ms: 60_000 });
        cia402.set_stop_time(Duration::from_millis(stop_ms));
        let clock = port.adapter().ecrt().clock().clone();
        let begin_ns = clock.now_ns();
        drop(AxisOwner::new(port, cia402));
        let waited_ms = (clock.now_ns() - begin_ns) / 1_000_000;
        // The gateways are taken out of OP afterwards, in at most 20 cycles.
        assert!((stop_ms..stop_ms + 60).contains(&waited_ms), "{waited_ms} ms");
    }
}

#[test]
fn panic_does_not_wait_for_axes() {
    let Fixture { port, cia402, simulation } =
        at_speed(OperatingMode::ProfileVelocity, HostHeartbeat::Off);
    let clock = port.adapter().ecrt().clock().clone();
    let begin_ns = clock.now_ns();
    let panicked = std::thread::spawn(move || {
        let _owner = AxisOwner::new(port, cia402);
        panic!("as a fault of the application");
    });
    assert!(panicked.join().is_err());
    assert_eq!(clock.now_ns(), begin_ns, "no cycle has run");
    assert!(velocity_in(&simulation) > 0.9 * SPEED, "{}/s", velocity_in(&simulation));
}

/// An owner that has shut down, and one whose drives never answered, has nothing to stop.
#[test]
fn owner_without_moving_axes_ends_at_once() {
    let mut fixture = open(drives(|_| {}), OperatingMode::CyclicPosition, HostHeartbeat::On);
    assert!(!fixture.axis(0).may_move());
    fixture.start();
    assert!(fixture.axis(0).may_move());
    fixture.cia402.blocking(&mut fixture.port, START).shut_down().unwrap();
    assert!(!fixture.axis(0).may_move());
    let before = now_ms(&fixture);
    let Fixture { cia402, port, .. } = &mut fixture;
    cia402.stop_before_end(port).unwrap();
    assert_eq!(now_ms(&fixture), before);
}

// Drives with their own mind

#[test]
fn drive_that_ignores_quick_stop_is_stopped_by_disable() {
    let scenario = drives(|drive| drive.quirks.ignores_quick_stop = true);
    let mode = OperatingMode::CyclicVelocity;
    let mut fixture = at_speed_with(open(scenario, mode, HostHeartbeat::On), mode);
    fixture.axis_mut(0).stop(StopKind::QuickStop);
    fixture.steps(250);
    println!("500 ms after an ignored quick stop: {:.0}/s", velocity(&fixture));
    fixture.axis_mut(0).stop(StopKind::Disable);
    Trace::of(&mut fixture).assert_rest(REACTION_MS, PROFILE).assert_no_coasting();
    assert_stays_stopped(&mut fixture);
}

// What the axis reports

#[test]
fn halted_axis_is_not_running() {
    use OperatingMode as M;
    for mode in [M::CyclicPosition, M::CyclicVelocity, M::ProfileVelocity, M::ProfilePosition] {
        let mut fixture = at_speed(mode, HostHeartbeat::On);
        assert!(fixture.axis(0).is_running() && fixture.cia402.all_running());
        fixture.axis_mut(0).halt();
        fixture.steps(1);
        assert!(!fixture.axis(0).is_running(), "{mode}: while it decelerates");
        fixture.until(2_000, |cia402| cia402.axis(0).unwrap().is_at_rest());
        fixture.steps(10);
        assert!(!fixture.axis(0).is_running() && !fixture.cia402.all_running(), "{mode}: at rest");
        fixture.axis_mut(0).resume();
        fixture.steps(1);
        assert!(fixture.axis(0).is_running() && fixture.cia402.all_running(), "{mode}: resumed");
    }
}

#[test]
fn stop_all_stops_every_axis_and_switches_off_at_rest() {
    for mode in RATE_AND_PROFILE_MODES {
        for is_configured in [true, false] {
            let mut fixture = at_speed(mode, HostHeartbeat::Off);
            if !is_configured {
                replace_owner(&mut fixture, mode, HostHeartbeat::Off);
            }
            fixture.cia402.command_all(AxisCommand::Stop(StopKind::QuickStopThenDisable)).unwrap();
            assert!(!fixture.cia402.all_stopped());
            let trace = Trace::of(&mut fixture);
            println!("{mode}, configured {is_configured}: {trace}");
            trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
            fixture.until(500, Cia402::all_stopped);
            assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
        }
    }
}

#[test]
fn stop_all_timeout_returns_at_rest() {
    let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
    fixture.cia402.blocking(&mut fixture.port, START).stop().unwrap();
    assert!(velocity(&fixture).abs() < REST && fixture.cia402.all_stopped());
    assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
}

#[test]
fn all_stopped_is_false_while_a_drive_ignores_the_stop() {
    let scenario = drives(|drive| drive.quirks.ignores_quick_stop = true);
    let mode = OperatingMode::CyclicVelocity;
    let mut fixture = at_speed_with(open(scenario, mode, HostHeartbeat::On), mode);
    fixture.axis_mut(0).stop(StopKind::QuickStop);
    fixture.step();
    while !fixture.cia402.all_stopped() {
        assert!(matches!(fixture.axis(0).phase(), AxisPhase::Stopping(_)));
        fixture.step();
    }
    assert!(velocity(&fixture).abs() < REST);
}

#[test]
fn moving_axis_out_of_reach_is_uncontrolled() {
    let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::Off);
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 500 });
    fixture.steps(250);
    assert!(matches!(fixture.axis(0).phase(), AxisPhase::Uncontrolled(StopCause::Held(_))));
    fixture.axis_mut(0).stop(StopKind::QuickStop);
    fixture.steps(1);
    let commanded = AxisPhase::Uncontrolled(StopCause::QuickStop);
    assert_eq!(fixture.axis(0).phase(), commanded);
    assert_eq!(fixture.axis(0).statistics().uncontrolled, 1);
    assert!(!fixture.cia402.all_stopped());
    fixture.until(2_000, Cia402::all_stopped);
    assert!(velocity(&fixture).abs() < REST);
}

#[test]
fn automatic_stop_reports_its_reason() {
    let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
    fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
    fixture.until(500, |cia402| !cia402.axis(0).unwrap().is_running());
    let reason = fixture.axis(0).statistics().last_hold.unwrap();
    let cause = StopCause::Held(reason);
    assert_eq!(fixture.axis(0).phase(), AxisPhase::Stopping(cause));
    fixture.until(500, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Stopped(cause));
    fixture.axis_mut(0).stop(StopKind::QuickStop);
    fixture.until(500, |cia402| {
        cia402.axis(0).unwrap().phase() == AxisPhase::Stopped(StopCause::QuickStop)
    });
}

#[test]
fn quick_stop_while_the_brake_opens_switches_off() {
    let scenario = drives(|drive| drive.enable_ms = 100);
    let mut fixture = open(scenario, OperatingMode::CyclicVelocity, HostHeartbeat::On);
    let port = &mut fixture.port;
    fixture.cia402.blocking(port, START).configure().unwrap();
    fixture.axis_mut(0).enable().unwrap();
    fixture
        .until(500, |cia402| cia402.axis(0).unwrap().drive_state() == Some(DriveState::SwitchedOn));
    fixture.steps(10);
    fixture.axis_mut(0).stop(StopKind::QuickStop);
    for _ in 0..200 {
        fixture.step();
        assert_ne!(state(&fixture), DriveState::OperationEnabled);
    }
    assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
}

/// Four targets and a SYNC take longer than the cycle: commands in every cycle would occupy the bus.
#[test]
fn quick_stop_leaves_the_bus_free_at_a_short_cycle() {
    let axes = crate::axes::axes(4).into_iter().map(|axis| AxisConfig {
        bounds: Some((-100_000, 100_000)),
        ..axis.with_mode(OperatingMode::CyclicVelocity)
    });
    let settings = Cia402Config {
        sync: SyncConfig { every_cycles: 10, ..SyncConfig::default() },
        ..Cia402Config::default()
    };
    let gateway = GatewayConfig {
        paced: false,
        ..GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000))
    };
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_micros(250));
    let scenario = ecan_sim::drives(1, 4);
    let mut fixture =
        Fixture::open_on(scenario, adapter, gateway, axes.collect(), settings).started();
    let accepted = |fixture: &Fixture| fixture.statistics().channels[0].frames_accepted;
    let before = accepted(&fixture);
    fixture.cia402.command_all(AxisCommand::Stop(StopKind::QuickStop)).unwrap();
    let cycles = fixture.until(400, Cia402::all_stopped) as u64;
    // The commands and SYNC, at once and in each SYNC period; a heartbeat.
    let periods = cycles.div_ceil(10) + 1;
    let sent = accepted(&fixture) - before;
    assert!(sent <= 5 * periods + 2, "{sent} frames in {cycles} cycles");
}
