//! Modes of operation, homing and what is scheduled at a phase of Sync0.
#![allow(missing_docs)]

use std::time::Duration;

use crate::axes::{Fixture, axes, axis, with_quirk};
use ecan_canopen::{DriveState, OperatingMode, SyncConfig, object};
use ecan_cia402::{
    AxisConfig, AxisError, AxisPhase, Cia402, Cia402Config, CommandError, Decision, HomingConfig,
    HomingState, LoadWarning, ScheduleError, StopKind,
};
use ecan_host::{AdapterConfig, DcSync};
use ecan_mcan_port::NotSchedulable;
use ecan_sim::{DriveFault, Fault};

fn in_mode(mode: OperatingMode) -> Fixture {
    Fixture::single(vec![axis(0, 0, 1).with_mode(mode)]).started()
}

fn finish(fixture: &mut Fixture) -> Result<(), ecan_cia402::Cia402Error> {
    fixture.cia402.blocking(&mut fixture.port, Duration::from_secs(60)).finish()
}

#[test]
fn velocity_starts_and_ends_at_zero() {
    let mut fixture = in_mode(OperatingMode::CyclicVelocity);
    assert_eq!(fixture.axis(0).target(), Some(0));
    fixture.axis_mut(0).set_target(2_000).unwrap();
    fixture.idle(1);
    assert!(matches!(fixture.axis(0).decision(), Decision::Reject(_)), "beyond the step limit");
    let before = fixture.axis(0).actual().unwrap();
    for n in 1..=20 {
        fixture.axis_mut(0).set_target(n * 1_000).unwrap();
        fixture.idle(1);
        assert_eq!(fixture.axis(0).decision(), Decision::Target(n * 1_000));
    }
    fixture.idle(200);
    assert!(fixture.axis(0).actual().unwrap() > before + 5_000, "{:?}", fixture.axis(0).actual());
    fixture.axis_mut(0).halt();
    fixture.idle(30);
    assert_eq!(fixture.axis(0).target(), Some(0));
    assert!(fixture.axis(0).is_at_rest());
    fixture.idle(100);
    assert!(fixture.drive(0, |drive| drive.velocity()).abs() < 10.0);
    assert_eq!(fixture.axis(0).drive_state(), Some(DriveState::OperationEnabled));
}

#[test]
fn holding_velocity_axis_is_stopped() {
    let mut fixture = in_mode(OperatingMode::CyclicVelocity);
    for n in 1..=20 {
        fixture.axis_mut(0).set_target(n * 1_000).unwrap();
        fixture.idle(1);
    }
    fixture.idle(100);
    fixture.inject(Fault::LostFrame { direction: ecan_sim::LossDirection::Outward, cycles: 6 });
    fixture.idle(300);
    assert!(!fixture.axis(0).is_running());
    let (state, velocity) = fixture.drive(0, |drive| (drive.state(), drive.velocity()));
    assert_ne!(state, DriveState::OperationEnabled);
    assert!(velocity.abs() < 10.0, "{velocity}");
    fixture.axis_mut(0).enable().unwrap();
    fixture.until(2_000, Cia402::all_running);
    assert_eq!(fixture.axis(0).target(), Some(0));
}

#[test]
fn torque_starts_at_zero() {
    let mut fixture = in_mode(OperatingMode::CyclicTorque);
    assert_eq!(fixture.axis(0).target(), Some(0));
    let before = fixture.axis(0).actual().unwrap();
    fixture.axis_mut(0).set_target(300).unwrap();
    fixture.idle(200);
    assert!(fixture.axis(0).actual().unwrap() > before);
    fixture.axis_mut(0).halt();
    fixture.idle(10);
    assert_eq!(fixture.axis(0).target(), Some(0));
}

#[test]
fn profile_position_is_accepted_and_reached() {
    let mut fixture = in_mode(OperatingMode::ProfilePosition);
    let from = fixture.axis(0).actual().unwrap();
    fixture.idle(100);
    assert_eq!(fixture.axis(0).actual(), Some(from), "enabling moves nothing");
    for to in [from + 30_000, from - 10_000] {
        fixture.axis_mut(0).set_target(to).unwrap();
        let mut cycles = 0;
        while !fixture.axis(0).is_target_reached() || fixture.axis(0).target() != Some(to) {
            fixture.idle(1);
            cycles += 1;
            assert!(cycles < 10_000, "{:?}", fixture.axis(0).actual());
        }
        assert!((fixture.axis(0).actual().unwrap() - to).abs() < 50);
    }
}

#[test]
fn profile_velocity_turns_and_halts() {
    let mut fixture = in_mode(OperatingMode::ProfileVelocity);
    fixture.axis_mut(0).set_target(50_000).unwrap();
    fixture.idle(1_000);
    let velocity = fixture.drive(0, |drive| drive.velocity());
    assert!((velocity - 50_000.0).abs() < 2_000.0, "{velocity}");
    fixture.axis_mut(0).halt();
    fixture.idle(1_000);
    assert!(fixture.drive(0, |drive| drive.velocity()).abs() < 10.0);
    assert_eq!(fixture.axis(0).drive_state(), Some(DriveState::OperationEnabled));
}

#[test]
fn halt_comes_to_rest_by_the_ramp_and_resume_goes_on() {
    let table = vec![axis(0, 0, 1).with_target_step(400)];
    let mut fixture = Fixture::single(table).started();
    fixture.steps(100);
    fixture.axis_mut(0).halt();
    let mut last = fixture.axis(0).target().unwrap();
    let mut step = i64::MAX;
    while !fixture.axis(0).is_at_rest() {
        fixture.step();
        let target = fixture.axis(0).target().unwrap();
        let made = i64::from(target - last);
        assert!(made < step && made >= 0, "{made} after {step}");
        (last, step) = (target, made);
    }
    fixture.steps(50);
    assert_eq!(fixture.axis(0).target(), Some(last));
    fixture.axis_mut(0).resume();
    fixture.steps(50);
    assert!(fixture.axis(0).target().unwrap() > last);
    fixture.check();
}

#[test]
fn mode_changes_at_rest_and_the_axis_continues() {
    let table = vec![axis(0, 0, 1).with_target_step(200)];
    let mut fixture = Fixture::single(table).started();
    fixture.steps(100);
    fixture.axis_mut(0).change_mode(OperatingMode::ProfilePosition).unwrap();
    assert_eq!(fixture.axis_mut(0).enable(), Err(CommandError::Busy { axis: 0 }));
    finish(&mut fixture).unwrap();
    assert_eq!(fixture.axis(0).mode(), OperatingMode::ProfilePosition);
    assert!(fixture.axis(0).is_running());
    let at = fixture.axis(0).actual().unwrap();
    fixture.axis_mut(0).set_target(at + 20_000).unwrap();
    fixture.idle(3_000);
    assert!(fixture.axis(0).is_target_reached());
    fixture.axis_mut(0).change_mode(OperatingMode::CyclicPosition).unwrap();
    finish(&mut fixture).unwrap();
    fixture.steps(50);
    assert!(fixture.axis(0).is_running());
    let rejected = fixture.axis_mut(0).change_mode(OperatingMode::CyclicVelocity);
    assert!(matches!(rejected, Err(CommandError::ModeNotMapped { axis: 0, .. })), "{rejected:?}");
    // A set-point of PP is far by its nature; those of CSP before and behind it are not.
    let firsts: Vec<_> =
        fixture.history(0).iter().filter(|r| r.first).map(|r| r.offset()).collect();
    assert_eq!(firsts.len(), 3);
    assert!(firsts[0] <= 40 && firsts[2] <= 40, "{firsts:?}");
}

#[test]
fn rejected_mode_keeps_the_old_one_and_disables() {
    let scenario = with_quirk(1, 1, |quirks| quirks.ignored_modes = vec![1]);
    let mut fixture = Fixture::with(scenario, vec![axis(0, 0, 1)]).started();
    fixture.axis_mut(0).change_mode(OperatingMode::ProfilePosition).unwrap();
    let text = finish(&mut fixture).unwrap_err().to_string();
    assert!(text.contains("mode PP"), "{text}");
    assert_eq!(fixture.axis(0).mode(), OperatingMode::CyclicPosition);
    assert_eq!(fixture.axis(0).drive_state(), Some(DriveState::SwitchOnDisabled));
    fixture.axis_mut(0).enable().unwrap();
    fixture.until(1_000, Cia402::all_running);
    fixture.check();
}

#[test]
fn homing_finds_its_place_and_the_axis_is_taken_up_there() {
    for method in [35, 37, 19, 33] {
        let mut fixture = Fixture::single(vec![axis(0, 0, 1)]).started();
        fixture.axis_mut(0).home(HomingConfig::new(method)).unwrap();
        finish(&mut fixture).unwrap_or_else(|error| panic!("method {method}: {error}"));
        assert!(fixture.axis(0).is_running(), "as before");
        assert_eq!(fixture.axis(0).mode(), OperatingMode::CyclicPosition);
        let (target, actual) =
            (fixture.axis(0).target().unwrap(), fixture.axis(0).actual().unwrap());
        assert!((target - actual).abs() < 50, "method {method}: {target} {actual}");
        let before = fixture.drive(0, |drive| drive.mechanical_position());
        fixture.idle(100);
        let after = fixture.drive(0, |drive| drive.mechanical_position());
        assert!((after - before).abs() < 50.0, "method {method}: {before} {after}");
        fixture.check();
    }
}

#[test]
fn homing_timeout_disables_the_drive() {
    let mut fixture = Fixture::single(vec![axis(0, 0, 1)]).started();
    let switch_speed = Some(100);
    const LIMIT: Duration = Duration::from_millis(300);
    let settings = HomingConfig { timeout: LIMIT, switch_speed, ..HomingConfig::new(19) };
    fixture.axis_mut(0).home(settings).unwrap();
    assert!(finish(&mut fixture).is_err());
    let error = fixture.axis(0).error();
    assert!(
        matches!(
            error,
            Some(AxisError::HomingTimedOut { state: HomingState::Running, waited })
                if (LIMIT..LIMIT + Duration::from_millis(100)).contains(&waited)
        ),
        "{error:?}"
    );
    assert_eq!(fixture.axis(0).drive_state(), Some(DriveState::SwitchOnDisabled));
    assert_eq!(fixture.axis(0).mode(), OperatingMode::CyclicPosition);
    fixture.check();
}

#[test]
fn fault_during_homing_is_reported() {
    let mut fixture = Fixture::single(vec![axis(0, 0, 1)]).started();
    fixture.axis_mut(0).home(HomingConfig::new(19)).unwrap();
    fixture.until(2_000, |cia402| matches!(cia402.axis(0).unwrap().phase(), AxisPhase::Homing(_)));
    fixture.strike(0, DriveFault::Error { code: 0x7320 });
    assert!(finish(&mut fixture).is_err());
    assert_eq!(fixture.axis(0).error(), Some(AxisError::Fault { error_code: 0x7320 }));
    assert_eq!(fixture.axis(0).mode(), OperatingMode::CyclicPosition);
    fixture.check();
}

/// The gateway is away until the drive has stopped by its watch over the host.
#[test]
fn hold_ends_a_mode_change_and_homing() {
    use OperatingMode::{CyclicPosition, ProfilePosition};
    type Command = fn(&mut Cia402) -> Result<(), CommandError>;
    let commands: [(&str, OperatingMode, Command); 4] = [
        ("PP to CSP", ProfilePosition, |axes| {
            axes.axis_mut(0).unwrap().change_mode(CyclicPosition)
        }),
        ("CSP to PP", CyclicPosition, |axes| {
            axes.axis_mut(0).unwrap().change_mode(ProfilePosition)
        }),
        ("homing in PP", ProfilePosition, |axes| {
            axes.axis_mut(0).unwrap().home(HomingConfig::new(35))
        }),
        ("homing in CSP", CyclicPosition, |axes| {
            axes.axis_mut(0).unwrap().home(HomingConfig::new(35))
        }),
    ];
    for (name, mode, command) in commands {
        for (cycles, auto_resume) in [(0, false), (1, false), (1, true), (2, false), (3, false)] {
            let name = format!("{name}, {cycles} cycles, auto-resume {auto_resume}");
            let mut config = axis(0, 0, 1).with_mode(mode).with_target_step(200);
            config.auto_resume = auto_resume;
            let mut fixture = Fixture::single(vec![config]).started();
            if mode == ProfilePosition {
                let at = fixture.axis(0).actual().unwrap();
                fixture.axis_mut(0).set_target(at + 500_000).unwrap();
            }
            fixture.steps(100);
            command(&mut fixture.cia402).unwrap();
            fixture.steps(cycles);
            fixture.inject(Fault::LinkLoss { gateway: 0, for_ms: 600 });
            fixture.steps(200);
            assert!(fixture.drive(0, |drive| drive.state()) != DriveState::OperationEnabled);
            for _ in 0..1_500 {
                fixture.step();
                let state = fixture.drive(0, |drive| drive.state());
                assert_ne!(state, DriveState::OperationEnabled, "{name}");
            }
            assert!(fixture.port.is_ready(), "{name}");
            assert_eq!(fixture.axis(0).mode(), mode, "{name}");
            let error = fixture.axis(0).error();
            let is_named =
                matches!(error, Some(AxisError::Held(_) | AxisError::NotDisabled { .. }));
            assert!(is_named, "{name}: {error:?}");
            fixture.axis_mut(0).enable().unwrap();
            fixture.until(1_000, Cia402::all_running);
        }
    }
}

/// After each stage of a homing and of a mode change.
#[test]
fn mode_before_is_restored_after_a_stop() {
    const MODE: OperatingMode = OperatingMode::CyclicPosition;
    type Command = fn(&mut Cia402) -> Result<(), CommandError>;
    let home: Command = |cia402| cia402.axis_mut(0).unwrap().home(HomingConfig::new(35));
    let change: Command =
        |cia402| cia402.axis_mut(0).unwrap().change_mode(OperatingMode::ProfilePosition);
    for (name, command) in [("homing", home), ("mode change", change)] {
        let mut modes = Vec::new();
        for cycles in 0.. {
            let mut fixture = Fixture::single(vec![axis(0, 0, 1)]).started();
            command(&mut fixture.cia402).unwrap();
            fixture.idle(cycles);
            if !matches!(
                fixture.axis(0).phase(),
                AxisPhase::ChangingMode(_) | AxisPhase::PreparingHoming | AxisPhase::Homing(_)
            ) && cycles > 0
            {
                break;
            }
            let name = format!("{name}, {cycles} cycles");
            let displayed =
                |fixture: &Fixture| fixture.drive(0, |drive| drive.object(object::MODE_DISPLAY, 0));
            modes.push(displayed(&fixture));
            fixture.axis_mut(0).stop(StopKind::QuickStop);
            fixture.until(200, Cia402::all_stopped);
            fixture.axis_mut(0).enable().unwrap();
            fixture.until(500, Cia402::all_running);
            assert_eq!(fixture.axis(0).mode(), MODE, "{name}");
            assert_eq!(displayed(&fixture), Some(MODE.raw().into()), "{name}");
            let at = fixture.axis(0).target().unwrap();
            fixture.axis_mut(0).set_target(at + 50).unwrap();
            fixture.idle(5);
            assert_eq!(fixture.axis(0).target(), Some(at + 50), "{name}");
            fixture.check();
        }
        modes.dedup();
        assert!(modes.len() > 1, "{name}: the drive had one mode, {modes:?}");
    }
}

#[test]
fn mode_is_written_before_the_drive_is_enabled() {
    let scenario = with_quirk(1, 1, |quirks| quirks.needs_mode = true);
    Fixture::with(scenario, vec![axis(0, 0, 1)]).started().check();
}

#[test]
fn drive_with_an_old_target_does_not_jump() {
    let scenario = with_quirk(1, 1, |quirks| quirks.follows_old_target = true);
    let table = vec![axis(0, 0, 1).with_target_step(100)];
    let mut fixture = Fixture::with(scenario, table).started();
    fixture.steps(200);
    for _ in 0..3 {
        fixture.axis_mut(0).halt();
        fixture.until(100, |cia402| cia402.axis(0).unwrap().is_at_rest());
        fixture.axis_mut(0).stop(StopKind::Disable);
        fixture.until(500, |cia402| {
            cia402.axis(0).unwrap().drive_state() == Some(DriveState::SwitchOnDisabled)
        });
        fixture.axis_mut(0).enable().unwrap();
        fixture.until(500, Cia402::all_running);
        let before = fixture.drive(0, |drive| drive.mechanical_position());
        fixture.idle(50);
        let after = fixture.drive(0, |drive| drive.mechanical_position());
        assert!((after - before).abs() < 30.0, "from {before} to {after}");
        fixture.steps(100);
    }
    fixture.check();
}

// Scheduled transmission

fn with_dc(cycle_us: u32) -> AdapterConfig {
    let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_micros(cycle_us.into()));
    adapter.dc =
        Some(DcSync::new(Duration::from_micros(cycle_us.into()), Duration::from_micros(700)));
    adapter
}

fn moving(count: usize) -> Vec<AxisConfig> {
    axes(count).into_iter().map(|axis| axis.with_target_step(50)).collect()
}

#[test]
fn targets_and_sync_go_out_at_their_phases() {
    for (target, sync) in [
        (Some(100_000), Some(100_000)),
        (Some(300_000), Some(100_000)),
        (Some(100_000), None),
        (None, Some(300_000)),
    ] {
        let mut fixture = Fixture::open(ecan_sim::drives(1, 4), with_dc(2_000), moving(2));
        fixture.cia402.set_scheduled_tx(&fixture.port, target, sync).unwrap();
        fixture.start();
        fixture.steps(500);
        assert!(fixture.cia402.all_running(), "{target:?} {sync:?}");
        let statistics = fixture.axis(0).statistics();
        let lost = (statistics.lost_tpdos, statistics.targets_lost);
        assert_eq!((statistics.holds, lost), (0, (0, 0)), "{target:?} {sync:?}");
        fixture.check();
        let while_running = fixture.cia402.set_scheduled_tx(&fixture.port, None, None);
        assert_eq!(while_running, Err(ScheduleError::Active { axis: 0 }));
    }
}

#[test]
fn impossible_schedule_is_rejected() {
    let mut fixture = Fixture::single(moving(1));
    let rejected = fixture.cia402.set_scheduled_tx(&fixture.port, Some(1), None);
    let reason = NotSchedulable::NoSync0;
    assert_eq!(rejected, Err(ScheduleError::NotSchedulable { slave: 0, offset_ns: 1, reason }));
    let mut fixture = Fixture::open(ecan_sim::drives(1, 4), with_dc(2_000), moving(1));
    let late = fixture.cia402.set_scheduled_tx(&fixture.port, Some(2_000_000), None);
    assert!(matches!(late, Err(ScheduleError::NotSchedulable { .. })), "{late:?}");
}

/// Manual 15.5.4: targets and SYNC are scheduled independently. A SYNC before the target of its image applies
/// the target before.
#[test]
fn sync_before_the_target_applies_the_previous_one() {
    let applied = |target_ns, sync_ns, every_cycles| {
        let sync = SyncConfig { every_cycles, ..SyncConfig::default() };
        let settings = Cia402Config { sync, ..Cia402Config::default() };
        let scenario = ecan_sim::drives(1, 4);
        let mut fixture = Fixture::open_with(scenario, with_dc(2_000), moving(1), settings);
        fixture.cia402.set_scheduled_tx(&fixture.port, target_ns, sync_ns).unwrap();
        fixture.start();
        fixture.idle(100);
        let target = fixture.axis(0).target().unwrap() + 7;
        fixture.axis_mut(0).set_target(target).unwrap();
        while fixture.axis(0).decision() != Decision::Target(target) {
            fixture.idle(1);
        }
        let sent_ns = fixture.now_ns();
        fixture.idle(20);
        let history = fixture.history(0);
        history.iter().find(|record| record.target == target).unwrap().time_ns - sent_ns
    };
    for every_cycles in [1, 3] {
        let after = applied(Some(100_000), Some(300_000), every_cycles);
        let before = applied(Some(300_000), Some(100_000), every_cycles);
        let period_ns = u64::from(every_cycles) * 2_000_000;
        assert_eq!(before, after + period_ns - 200_000, "SYNC every {every_cycles} cycles");
    }
}

#[test]
fn fewer_targets_than_cycles_are_a_matter_of_division() {
    let settings = Cia402Config { motion_div: 4, ..Cia402Config::default() };
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let mut fixture = Fixture::open_with(ecan_sim::drives(1, 4), adapter, moving(2), settings);
    fixture.start();
    // The first target may be less than a period before the next target cycle, which then is left out.
    fixture.steps(8);
    let before = fixture.axis(0).statistics().targets_sent;
    fixture.steps(400);
    let sent = fixture.axis(0).statistics().targets_sent - before;
    assert_eq!(sent, 100);
    fixture.check();
}

#[test]
fn sync_may_come_in_every_other_cycle() {
    let sync = SyncConfig { every_cycles: 2, ..SyncConfig::default() };
    let settings = Cia402Config { sync, motion_div: 2, ..Cia402Config::default() };
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let mut fixture = Fixture::open_with(ecan_sim::drives(1, 4), adapter, moving(4), settings);
    fixture.start();
    fixture.steps(1_000);
    assert!(fixture.cia402.all_running());
    assert_eq!(fixture.axis(3).statistics().lost_tpdos, 0);
    fixture.check();
}

// Load

#[test]
fn four_axes_fit_2_ms_and_not_1_ms() {
    for (cycle_us, warning) in [(2_000, None), (1_000, Some(LoadWarning::NoReserve))] {
        let adapter = AdapterConfig::new(1).with_cycle(Duration::from_micros(cycle_us));
        let mut fixture = Fixture::open(ecan_sim::drives(1, 4), adapter, moving(4));
        let load = fixture.cia402.bus_load(&fixture.port);
        assert_eq!(load.len(), 1);
        assert_eq!(load[0].warning(), warning, "{}", load[0]);
        fixture.start();
        fixture.steps(3_000);
        for n in 0..4 {
            let statistics = fixture.axis(n).statistics();
            assert_eq!((statistics.holds, statistics.lost_tpdos), (0, 0), "axis {n} at {cycle_us}");
        }
        fixture.check();
    }
}

#[test]
fn sixteen_axes_on_four_channels_run_at_one_kilohertz() {
    let adapter = with_dc(1_000).with_multiplier(6);
    let mut fixture = Fixture::open(ecan_sim::drives(1, 4), adapter, moving(16)).started();
    fixture.steps(1_000);
    assert!(fixture.cia402.all_running());
    for n in 0..16 {
        let statistics = fixture.axis(n).statistics();
        assert_eq!((statistics.holds, statistics.lost_tpdos), (0, 0), "axis {n}");
    }
    fixture.check();
}
