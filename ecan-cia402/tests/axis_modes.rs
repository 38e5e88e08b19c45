//! Modes of operation, homing and what is scheduled at a phase of Sync0.
#![allow(missing_docs)]

use std::time::Duration;

mod axes;

use axes::{Fixture, axes, axis, with_quirk};
use ecan_canopen::{DriveState, OperatingMode, SyncConfig};
use ecan_cia402::{
    AxisConfig, AxisError, AxisPhase, Cia402, Cia402Config, CommandError, Decision, HomingConfig,
    HomingState, LoadWarning, ScheduleError,
};
use ecan_host::{AdapterConfig, DcSync};
use ecan_mcan_port::NotSchedulable;
use ecan_sim::{DriveFault, Fault};

fn in_mode(mode: OperatingMode) -> Fixture {
    Fixture::single(vec![axis(0, 0, 1).with_mode(mode)]).started()
}

fn finish(bench: &mut Fixture) -> Result<(), ecan_cia402::Cia402Error> {
    bench.cia402.finish_all_timeout(&mut bench.port, Duration::from_secs(60), |_| {})
}

#[test]
fn velocity_starts_and_ends_at_zero() {
    let mut bench = in_mode(OperatingMode::CyclicVelocity);
    assert_eq!(bench.cia402.target(0), Some(0));
    bench.cia402.set_target(0, 2_000).unwrap();
    bench.idle(1);
    assert!(matches!(bench.cia402.decision(0), Decision::Reject(_)), "beyond the step limit");
    let before = bench.cia402.actual(0).unwrap();
    for n in 1..=20 {
        bench.cia402.set_target(0, n * 1_000).unwrap();
        bench.idle(1);
        assert_eq!(bench.cia402.decision(0), Decision::Target(n * 1_000));
    }
    bench.idle(200);
    assert!(bench.cia402.actual(0).unwrap() > before + 5_000, "{:?}", bench.cia402.actual(0));
    bench.cia402.halt(0).unwrap();
    bench.idle(30);
    assert_eq!(bench.cia402.target(0), Some(0));
    assert!(bench.cia402.is_at_rest(0));
    bench.idle(100);
    assert!(bench.drive(0, |drive| drive.velocity()).abs() < 10.0);
    assert_eq!(bench.cia402.drive_state(0), Some(DriveState::OperationEnabled));
}

#[test]
fn holding_velocity_axis_is_stopped() {
    let mut bench = in_mode(OperatingMode::CyclicVelocity);
    for n in 1..=20 {
        bench.cia402.set_target(0, n * 1_000).unwrap();
        bench.idle(1);
    }
    bench.idle(100);
    bench.inject(Fault::LostFrame { direction: ecan_sim::LossDirection::Outward, cycles: 6 });
    bench.idle(300);
    assert!(!bench.cia402.is_running(0));
    let (state, velocity) = bench.drive(0, |drive| (drive.state(), drive.velocity()));
    assert_ne!(state, DriveState::OperationEnabled);
    assert!(velocity.abs() < 10.0, "{velocity}");
    bench.cia402.enable(0).unwrap();
    bench.until(2_000, Cia402::all_running);
    assert_eq!(bench.cia402.target(0), Some(0));
}

#[test]
fn torque_starts_at_zero() {
    let mut bench = in_mode(OperatingMode::CyclicTorque);
    assert_eq!(bench.cia402.target(0), Some(0));
    let before = bench.cia402.actual(0).unwrap();
    bench.cia402.set_target(0, 300).unwrap();
    bench.idle(200);
    assert!(bench.cia402.actual(0).unwrap() > before);
    bench.cia402.halt(0).unwrap();
    bench.idle(10);
    assert_eq!(bench.cia402.target(0), Some(0));
}

#[test]
fn profile_position_is_accepted_and_reached() {
    let mut bench = in_mode(OperatingMode::ProfilePosition);
    let from = bench.cia402.actual(0).unwrap();
    bench.idle(100);
    assert_eq!(bench.cia402.actual(0), Some(from), "enabling moves nothing");
    for to in [from + 30_000, from - 10_000] {
        bench.cia402.set_target(0, to).unwrap();
        let mut cycles = 0;
        while !bench.cia402.is_target_reached(0) || bench.cia402.target(0) != Some(to) {
            bench.idle(1);
            cycles += 1;
            assert!(cycles < 10_000, "{:?}", bench.cia402.actual(0));
        }
        assert!((bench.cia402.actual(0).unwrap() - to).abs() < 50);
    }
}

#[test]
fn profile_velocity_turns_and_halts() {
    let mut bench = in_mode(OperatingMode::ProfileVelocity);
    bench.cia402.set_target(0, 50_000).unwrap();
    bench.idle(1_000);
    let velocity = bench.drive(0, |drive| drive.velocity());
    assert!((velocity - 50_000.0).abs() < 2_000.0, "{velocity}");
    bench.cia402.halt(0).unwrap();
    bench.idle(1_000);
    assert!(bench.drive(0, |drive| drive.velocity()).abs() < 10.0);
    assert_eq!(bench.cia402.drive_state(0), Some(DriveState::OperationEnabled));
}

#[test]
fn halt_comes_to_rest_by_the_ramp_and_resume_goes_on() {
    let table = vec![axis(0, 0, 1).with_target_step(400)];
    let mut bench = Fixture::single(table).started();
    bench.steps(100);
    bench.cia402.halt(0).unwrap();
    let mut last = bench.cia402.target(0).unwrap();
    let mut step = i64::MAX;
    while !bench.cia402.is_at_rest(0) {
        bench.step();
        let target = bench.cia402.target(0).unwrap();
        let made = i64::from(target - last);
        assert!(made < step && made >= 0, "{made} after {step}");
        (last, step) = (target, made);
    }
    bench.steps(50);
    assert_eq!(bench.cia402.target(0), Some(last));
    bench.cia402.resume(0).unwrap();
    bench.steps(50);
    assert!(bench.cia402.target(0).unwrap() > last);
    bench.judge();
}

#[test]
fn mode_changes_at_rest_and_the_axis_continues() {
    let table = vec![axis(0, 0, 1).with_target_step(200)];
    let mut bench = Fixture::single(table).started();
    bench.steps(100);
    bench.cia402.change_mode(0, OperatingMode::ProfilePosition).unwrap();
    assert_eq!(bench.cia402.enable(0), Err(CommandError::Busy { axis: 0 }));
    finish(&mut bench).unwrap();
    assert_eq!(bench.cia402.mode(0), Some(OperatingMode::ProfilePosition));
    assert!(bench.cia402.is_running(0));
    let at = bench.cia402.actual(0).unwrap();
    bench.cia402.set_target(0, at + 20_000).unwrap();
    bench.idle(3_000);
    assert!(bench.cia402.is_target_reached(0));
    bench.cia402.change_mode(0, OperatingMode::CyclicPosition).unwrap();
    finish(&mut bench).unwrap();
    bench.steps(50);
    assert!(bench.cia402.is_running(0));
    let refused = bench.cia402.change_mode(0, OperatingMode::CyclicVelocity);
    assert!(matches!(refused, Err(CommandError::ModeNotMapped { axis: 0, .. })), "{refused:?}");
    // A set-point of PP is far by its nature; those of CSP before and behind it are not.
    let firsts: Vec<_> = bench.history(0).iter().filter(|r| r.first).map(|r| r.offset()).collect();
    assert_eq!(firsts.len(), 3);
    assert!(firsts[0] <= 40 && firsts[2] <= 40, "{firsts:?}");
}

#[test]
fn rejected_mode_keeps_the_old_one_and_disables() {
    let scenario = with_quirk(1, 1, |quirks| quirks.ignored_modes = vec![1]);
    let mut bench = Fixture::with(scenario, vec![axis(0, 0, 1)]).started();
    bench.cia402.change_mode(0, OperatingMode::ProfilePosition).unwrap();
    let text = finish(&mut bench).unwrap_err().to_string();
    assert!(text.contains("mode PP"), "{text}");
    assert_eq!(bench.cia402.mode(0), Some(OperatingMode::CyclicPosition));
    assert_eq!(bench.cia402.drive_state(0), Some(DriveState::SwitchOnDisabled));
    bench.cia402.enable(0).unwrap();
    bench.until(1_000, Cia402::all_running);
    bench.judge();
}

#[test]
fn homing_finds_its_place_and_the_axis_is_taken_up_there() {
    for method in [35, 37, 19, 33] {
        let mut bench = Fixture::single(vec![axis(0, 0, 1)]).started();
        bench.cia402.home(0, HomingConfig::new(method)).unwrap();
        finish(&mut bench).unwrap_or_else(|error| panic!("method {method}: {error}"));
        assert!(bench.cia402.is_running(0), "as before");
        assert_eq!(bench.cia402.mode(0), Some(OperatingMode::CyclicPosition));
        let (target, actual) = (bench.cia402.target(0).unwrap(), bench.cia402.actual(0).unwrap());
        assert!((target - actual).abs() < 50, "method {method}: {target} {actual}");
        let before = bench.drive(0, |drive| drive.mechanical_position());
        bench.idle(100);
        let after = bench.drive(0, |drive| drive.mechanical_position());
        assert!((after - before).abs() < 50.0, "method {method}: {before} {after}");
        bench.judge();
    }
}

#[test]
fn homing_timeout_disables_the_drive() {
    let mut bench = Fixture::single(vec![axis(0, 0, 1)]).started();
    let switch_speed = Some(100);
    const LIMIT: Duration = Duration::from_millis(300);
    let settings = HomingConfig { timeout: LIMIT, switch_speed, ..HomingConfig::new(19) };
    bench.cia402.home(0, settings).unwrap();
    assert!(finish(&mut bench).is_err());
    let trouble = bench.cia402.error(0);
    assert!(
        matches!(
            trouble,
            Some(AxisError::HomingTimedOut { state: HomingState::Running, waited })
                if (LIMIT..LIMIT + Duration::from_millis(100)).contains(&waited)
        ),
        "{trouble:?}"
    );
    assert_eq!(bench.cia402.drive_state(0), Some(DriveState::SwitchOnDisabled));
    assert_eq!(bench.cia402.mode(0), Some(OperatingMode::CyclicPosition));
    bench.judge();
}

#[test]
fn fault_during_homing_is_reported() {
    let mut bench = Fixture::single(vec![axis(0, 0, 1)]).started();
    bench.cia402.home(0, HomingConfig::new(19)).unwrap();
    bench.until(2_000, |cia402| matches!(cia402.phase(0), Some(AxisPhase::Homing(_))));
    bench.strike(0, DriveFault::Error { code: 0x7320 });
    assert!(finish(&mut bench).is_err());
    assert_eq!(bench.cia402.error(0), Some(AxisError::Fault { error_code: 0x7320 }));
    assert_eq!(bench.cia402.mode(0), Some(OperatingMode::CyclicPosition));
    bench.judge();
}

#[test]
fn mode_is_written_before_the_drive_is_enabled() {
    let scenario = with_quirk(1, 1, |quirks| quirks.needs_mode = true);
    Fixture::with(scenario, vec![axis(0, 0, 1)]).started().judge();
}

#[test]
fn drive_with_an_old_target_does_not_jump() {
    let scenario = with_quirk(1, 1, |quirks| quirks.follows_old_target = true);
    let table = vec![axis(0, 0, 1).with_target_step(100)];
    let mut bench = Fixture::with(scenario, table).started();
    bench.steps(200);
    for _ in 0..3 {
        bench.cia402.halt(0).unwrap();
        bench.until(100, |cia402| cia402.is_at_rest(0));
        bench.cia402.disable(0).unwrap();
        bench.until(500, |cia402| cia402.drive_state(0) == Some(DriveState::SwitchOnDisabled));
        bench.cia402.enable(0).unwrap();
        bench.until(500, Cia402::all_running);
        let before = bench.drive(0, |drive| drive.mechanical_position());
        bench.idle(50);
        let after = bench.drive(0, |drive| drive.mechanical_position());
        assert!((after - before).abs() < 30.0, "from {before} to {after}");
        bench.steps(100);
    }
    bench.judge();
}

// Scheduled transmission

fn with_dc(cycle_us: u32) -> AdapterConfig {
    let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_micros(cycle_us.into()));
    adapter.dc = Some(DcSync::new(cycle_us * 1_000, 700_000));
    adapter
}

fn moving(count: usize) -> Vec<AxisConfig> {
    axes(count).into_iter().map(|axis| axis.with_target_step(50)).collect()
}

#[test]
fn targets_and_sync_go_out_at_their_phases() {
    for (target, sync) in
        [(Some(100_000), Some(100_000)), (Some(100_000), None), (None, Some(300_000))]
    {
        let mut bench = Fixture::open(ecan_sim::drives(1, 4), with_dc(2_000), moving(2));
        bench.cia402.set_scheduled_tx(&bench.port, target, sync).unwrap();
        bench.start();
        bench.steps(500);
        assert!(bench.cia402.all_running(), "{target:?} {sync:?}");
        let statistics = bench.cia402.statistics(0);
        assert_eq!((statistics.holds, statistics.lost_tpdos), (0, 0), "{target:?} {sync:?}");
        bench.judge();
        let while_running = bench.cia402.set_scheduled_tx(&bench.port, None, None);
        assert_eq!(while_running, Err(ScheduleError::Active { axis: 0 }));
    }
}

#[test]
fn impossible_schedule_is_rejected() {
    let mut bench = Fixture::single(moving(1));
    let refused = bench.cia402.set_scheduled_tx(&bench.port, Some(1), None);
    let reason = NotSchedulable::NoSync0;
    assert_eq!(refused, Err(ScheduleError::NotSchedulable { slave: 0, offset_ns: 1, reason }));
    let mut bench = Fixture::open(ecan_sim::drives(1, 4), with_dc(2_000), moving(1));
    let late = bench.cia402.set_scheduled_tx(&bench.port, Some(2_000_000), None);
    assert!(matches!(late, Err(ScheduleError::NotSchedulable { .. })), "{late:?}");
    let early = bench.cia402.set_scheduled_tx(&bench.port, Some(200_000), Some(100_000));
    assert!(matches!(early, Err(ScheduleError::SyncFirst { .. })), "{early:?}");
}

#[test]
fn fewer_targets_than_cycles_are_a_matter_of_division() {
    let settings = Cia402Config { motion_div: 4, ..Cia402Config::default() };
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let mut bench = Fixture::open_with(ecan_sim::drives(1, 4), adapter, moving(2), settings);
    bench.start();
    let before = bench.cia402.statistics(0).targets_sent;
    bench.steps(400);
    let sent = bench.cia402.statistics(0).targets_sent - before;
    assert_eq!(sent, 100);
    bench.judge();
}

#[test]
fn sync_may_come_in_every_other_cycle() {
    let sync = SyncConfig { every_cycles: 2, ..SyncConfig::default() };
    let settings = Cia402Config { sync, motion_div: 2, ..Cia402Config::default() };
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let mut bench = Fixture::open_with(ecan_sim::drives(1, 4), adapter, moving(4), settings);
    bench.start();
    bench.steps(1_000);
    assert!(bench.cia402.all_running());
    assert_eq!(bench.cia402.statistics(3).lost_tpdos, 0);
    bench.judge();
}

// Load

#[test]
fn four_axes_fit_2_ms_and_not_1_ms() {
    for (cycle_us, warning) in [(2_000, None), (1_000, Some(LoadWarning::NoReserve))] {
        let adapter = AdapterConfig::new(1).with_cycle(Duration::from_micros(cycle_us));
        let mut bench = Fixture::open(ecan_sim::drives(1, 4), adapter, moving(4));
        let load = bench.cia402.bus_load(&bench.port);
        assert_eq!(load.len(), 1);
        assert_eq!(load[0].warning(), warning, "{}", load[0]);
        bench.start();
        bench.steps(3_000);
        for n in 0..4 {
            let statistics = bench.cia402.statistics(n);
            assert_eq!((statistics.holds, statistics.lost_tpdos), (0, 0), "axis {n} at {cycle_us}");
        }
        bench.judge();
    }
}

#[test]
fn sixteen_axes_on_four_channels_run_at_one_kilohertz() {
    let adapter = with_dc(1_000).with_multiplier(6);
    let mut bench = Fixture::open(ecan_sim::drives(1, 4), adapter, moving(16)).started();
    bench.steps(1_000);
    assert!(bench.cia402.all_running());
    for n in 0..16 {
        let statistics = bench.cia402.statistics(n);
        assert_eq!((statistics.holds, statistics.lost_tpdos), (0, 0), "axis {n}");
    }
    bench.judge();
}
