//! Enabling, configuration and recovery of an axis during and after its stop.
#![allow(missing_docs)]

use crate::axes::{Fixture, START};
use crate::support::stops::{
    HostHeartbeat, QUICK, RATE_AND_PROFILE_MODES, REACTION_MS, REST, RETURN_MS, Sample, Trace,
    at_speed, at_speed_with, axis_in, drives, now_ms, open, state, velocity,
};
use ecan_canopen::{DriveState, FaultReaction, OperatingMode, Step, object};
use ecan_cia402::{AxisPhase, Cia402, CommandError, HomingConfig, StopKind};
use ecan_sim::{DriveFault, Fault, LossDirection, MasterBehaviour, Scenario};

#[test]
fn enable_in_the_cycle_of_a_quick_stop_waits_for_rest() {
    use OperatingMode as M;
    for mode in [M::CyclicVelocity, M::CyclicTorque, M::ProfileVelocity, M::CyclicPosition] {
        let mut fixture = at_speed(mode, HostHeartbeat::On);
        fixture.axis_mut(0).set_target_step(0);
        fixture.axis_mut(0).stop(StopKind::QuickStop);
        fixture.axis_mut(0).enable().unwrap();
        let trace = Trace::of(&mut fixture);
        println!("{mode}: {trace}");
        trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
        trace.assert_not_enabled_before_rest().assert_quick_deceleration();
        fixture.until(2_000, |cia402| cia402.axis(0).unwrap().is_running());
        fixture.idle(100);
        assert!(velocity(&fixture).abs() < REST, "{mode}: {}/s", velocity(&fixture));
    }
}

#[test]
fn enable_during_quick_stop_braking_does_not_coast() {
    for cycles in [1, 3, 10, 40, 90] {
        let mut fixture = at_speed(OperatingMode::CyclicPosition, HostHeartbeat::On);
        fixture.axis_mut(0).stop(StopKind::QuickStop);
        fixture.steps(cycles);
        fixture.axis_mut(0).set_target_step(0);
        fixture.axis_mut(0).enable().unwrap();
        let trace = Trace::of(&mut fixture);
        println!("enabled {cycles} cycles after the quick stop: {trace}");
        trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
        trace.assert_not_enabled_before_rest();
        fixture.until(2_000, |cia402| cia402.axis(0).unwrap().is_running());
        fixture.check();
    }
}

/// The command may be rejected, or wait for the end of the stop.
fn ignore<E>(_: Result<(), E>) {}

#[test]
fn other_commands_during_quick_stop_braking_do_not_coast() {
    type Command = fn(&mut Cia402);
    let commands: [(&str, Command); 6] = [
        ("disable", |cia402| cia402.axis_mut(0).unwrap().stop(StopKind::Disable)),
        ("configure", |cia402| ignore(cia402.axis_mut(0).unwrap().configure())),
        ("change mode", |cia402| {
            ignore(cia402.axis_mut(0).unwrap().change_mode(OperatingMode::ProfilePosition))
        }),
        ("home", |cia402| ignore(cia402.axis_mut(0).unwrap().home(HomingConfig::new(35)))),
        ("reset fault", |cia402| ignore(cia402.axis_mut(0).unwrap().reset_fault())),
        ("shutdown", Cia402::begin_shutdown),
    ];
    for (name, command) in commands {
        let mut fixture = at_speed(OperatingMode::CyclicPosition, HostHeartbeat::On);
        fixture.axis_mut(0).stop(StopKind::QuickStop);
        fixture.steps(10);
        command(&mut fixture.cia402);
        let trace = Trace::of(&mut fixture);
        println!("{name} 10 cycles after the quick stop: {trace}");
        trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
        trace.assert_not_enabled_before_rest();
    }
}

/// A hold of the guard stops the axis in a rate mode; an operator enables it at once.
#[test]
fn enable_after_an_unsent_automatic_stop_waits_for_rest() {
    let faults = [
        // Shorter than the time in which the drive detects the loss of the host, and longer.
        Fault::LostFrame { direction: LossDirection::Outward, cycles: 100 },
        Fault::LostFrame { direction: LossDirection::Outward, cycles: 150 },
        Fault::LostFrame { direction: LossDirection::Return, cycles: 100 },
        Fault::BusOff { gateway: 0, channel: 0 },
        Fault::LinkLoss { gateway: 0, for_ms: 300 },
        Fault::PowerCycle { gateway: 0, off_ms: 300 },
    ];
    for fault in faults {
        for heartbeat in [HostHeartbeat::On, HostHeartbeat::Off] {
            let mut fixture = at_speed(OperatingMode::CyclicVelocity, heartbeat);
            fixture.inject(fault.clone());
            fixture.until(500, |cia402| !cia402.axis(0).unwrap().is_running());
            fixture.axis_mut(0).enable().unwrap();
            let injected_ms = now_ms(&fixture);
            let mut trace = Trace(Vec::new());
            let (mut syncs, mut gap_ms, mut back_ms) = (0, 0.0, 0.0);
            // Until all is back and the axis runs as the operator commanded.
            for _ in 0..15_000 {
                let ms = (now_ms(&fixture) - injected_ms).round();
                let sample = Sample { ms, state: state(&fixture), velocity: velocity(&fixture) };
                trace.0.push(sample);
                // The end of the last gap of 20 ms without frames of the host.
                let received = fixture.drive(0, |drive| drive.syncs());
                if std::mem::replace(&mut syncs, received) != received {
                    if ms > gap_ms + 20.0 {
                        back_ms = ms;
                    }
                    gap_ms = ms;
                }
                if fixture.axis(0).is_running() && ms > back_ms + 500.0 {
                    break;
                }
                fixture.step();
            }
            println!("{fault:?}, host heartbeat {heartbeat:?}: back at {back_ms} ms, {trace}");
            trace.assert_no_coasting().assert_not_enabled_before_rest();
            trace.assert_rest(back_ms + RETURN_MS, QUICK);
            assert!(fixture.axis(0).is_running(), "{:?}", fixture.axis(0).progress());
            assert!(velocity(&fixture).abs() < REST, "{}/s", velocity(&fixture));
        }
    }
}

#[test]
fn enable_during_automatic_braking_does_not_coast() {
    for cycles in [1, 3, 10, 40] {
        let mut fixture = at_speed(OperatingMode::CyclicVelocity, HostHeartbeat::On);
        fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
        fixture.until(500, |cia402| !cia402.axis(0).unwrap().is_running());
        let mut limit = 100;
        while state(&fixture) == DriveState::OperationEnabled && limit > 0 {
            fixture.step();
            limit -= 1;
        }
        fixture.steps(cycles);
        fixture.axis_mut(0).enable().unwrap();
        let trace = Trace::of(&mut fixture);
        println!("enabled {cycles} cycles into the braking: {trace}");
        trace.assert_rest(REACTION_MS, QUICK).assert_no_coasting();
        trace.assert_not_enabled_before_rest();
        fixture.until(2_000, |cia402| cia402.axis(0).unwrap().is_running());
    }
}

/// A drive that coasts in Fault must not be enabled while it moves.
#[test]
fn coasting_drive_is_not_enabled_before_rest() {
    for master in [MasterBehaviour::IDEAL, MasterBehaviour::IGH] {
        let mut axis = axis_in(OperatingMode::CyclicVelocity);
        let coasts = FaultReaction::Disable.raw();
        axis.drive.further.push(Step::write(object::FAULT_REACTION_OPTION, 0, coasts));
        let fixture = Fixture::with(Scenario { master, ..drives(|_| {}) }, vec![axis]);
        let mut fixture = at_speed_with(fixture, OperatingMode::CyclicVelocity);
        fixture.strike(0, DriveFault::Error { code: 0x2310 });
        fixture
            .until(500, |cia402| cia402.axis(0).unwrap().drive_state() == Some(DriveState::Fault));
        fixture.axis_mut(0).reset_fault().unwrap();
        fixture.steps(50);
        assert_ne!(state(&fixture), DriveState::Fault);
        fixture.axis_mut(0).enable().unwrap();
        Trace::of(&mut fixture).assert_rest(0.0, 100_000.0).assert_not_enabled_before_rest();
        fixture.until(2_000, |cia402| cia402.axis(0).unwrap().is_running());
    }
}

#[test]
fn fault_reset_without_a_fault_changes_nothing() {
    for mode in RATE_AND_PROFILE_MODES {
        let mut fixture = at_speed(mode, HostHeartbeat::On);
        fixture.axis_mut(0).reset_fault().unwrap();
        fixture.steps(100);
        assert!(fixture.axis(0).is_running(), "{mode}: {:?}", fixture.axis(0).phase());
        fixture.axis_mut(0).stop(StopKind::QuickStop);
        fixture.axis_mut(0).reset_fault().unwrap();
        Trace::of(&mut fixture).assert_rest(REACTION_MS, QUICK).assert_no_coasting();
    }
}

#[test]
fn axis_is_configured_again_after_a_shutdown() {
    let mode = OperatingMode::CyclicPosition;
    let mut fixture = open(drives(|_| {}), mode, HostHeartbeat::On);
    fixture.start();
    fixture.cia402.blocking(&mut fixture.port, START).shut_down().unwrap();
    assert!(fixture.axis_mut(0).enable().is_err(), "its drive does not watch the host");
    fixture.axis_mut(0).configure().unwrap();
    fixture.until(500, |cia402| cia402.axis(0).unwrap().is_configured());
    fixture.axis_mut(0).enable().unwrap();
    fixture.until(1_000, Cia402::all_running);
}

#[test]
fn halt_and_configure_end_a_recovery() {
    let mode = OperatingMode::CyclicPosition;
    let mut fixture = open(drives(|_| {}), mode, HostHeartbeat::On);
    fixture.start();
    fixture.axis_mut(0).recover().unwrap();
    fixture.axis_mut(0).halt();
    fixture.steps(100);
    assert_eq!(fixture.axis(0).phase(), AxisPhase::Halted);
    fixture.axis_mut(0).stop(StopKind::QuickStop);
    fixture.axis_mut(0).recover().unwrap();
    fixture.axis_mut(0).configure().unwrap();
    fixture.steps(500);
    assert!(fixture.axis(0).is_configured() && !fixture.axis(0).is_recovering());
    assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
}

#[test]
fn recovery_returns_from_hold_fault_and_restart() {
    let mode = OperatingMode::CyclicVelocity;
    type Strike = fn(&Fixture);
    let faults: [(&str, Strike); 4] = [
        ("hold", |fixture| {
            fixture.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
        }),
        ("fault", |fixture| fixture.strike(0, DriveFault::Error { code: 0x2310 })),
        ("restart", |fixture| fixture.strike(0, DriveFault::PowerCycle { off_ms: 100 })),
        ("gateway", |fixture| fixture.inject(Fault::PowerCycle { gateway: 0, off_ms: 100 })),
    ];
    for (name, fault) in faults {
        let mut fixture = at_speed(mode, HostHeartbeat::On);
        fault(&fixture);
        fixture.until(1_000, |cia402| !cia402.all_running());
        let recovered = fixture.cia402.blocking(&mut fixture.port, START).recover();
        recovered.unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(fixture.cia402.all_running(), "{name}");
    }
}

#[test]
fn recovery_refuses_a_persistent_fault_and_a_shutdown() {
    let scenario = drives(|drive| drive.quirks.stuck_in_fault = true);
    let mut fixture = open(scenario, OperatingMode::CyclicPosition, HostHeartbeat::On);
    fixture.start();
    fixture.strike(0, DriveFault::Error { code: 0x7305 });
    fixture.until(500, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Fault);
    let recovered = fixture.cia402.blocking(&mut fixture.port, START).recover();
    let text = recovered.unwrap_err().to_string();
    assert!(text.contains("0x7305"), "{text}");
    fixture.cia402.begin_shutdown();
    let rejected = fixture.axis_mut(0).recover();
    assert!(matches!(rejected, Err(CommandError::ShuttingDown { axis: 0 })), "{rejected:?}");
}
