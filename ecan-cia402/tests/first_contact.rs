//! A new owner of drives that another one left: it stops or adopts them before it feeds them.
#![allow(missing_docs)]

use std::time::Duration;

use crate::axes::{Fixture, START};
use crate::support::stops::{
    HostHeartbeat, QUICK, RATE_AND_PROFILE_MODES, REST, RETURN_MS, SPEED, Trace, accelerate,
    assert_runs_again, assert_stays_stopped, at_speed, at_speed_with, config, drives, now_ms, open,
    replace_owner, state, table, velocity,
};
use ecan_canopen::{
    CobId, Command, DriveState, NodeId, OperatingMode, QuickStopOption, SyncConfig, object,
};
use ecan_cia402::{AxisCommand, AxisPhase, Cia402, Cia402Config, StopKind, Takeover};
use ecan_host::{AdapterConfig, DcSync};
use ecan_protocol::object::AbortCode;
use ecan_sim::{CommandSource, DriveFault, Fault, SdoDirection, SdoEffect, SdoRule, TraceEvent};

/// COB-IDs of SYNC and of the heartbeat of the host, by which a drive continues.
fn feeds(frame: &ecan_sim::BusFrame) -> bool {
    let id = frame.frame.id();
    id == CobId::SYNC.can_id() || id == CobId::heartbeat(NodeId::MAX).can_id()
}

#[test]
fn new_owner_stops_moving_drives_before_it_feeds_them() {
    for heartbeat in [HostHeartbeat::On, HostHeartbeat::Off] {
        for mode in RATE_AND_PROFILE_MODES {
            let mut fixture = at_speed(mode, heartbeat);
            fixture.simulation.with_world(|world| world.record_bus_of(0, 0));
            replace_owner(&mut fixture, mode, heartbeat);
            // Frames of the old owner, which the Port and the gateway still hold.
            fixture.steps(3);
            fixture.simulation.with_world(ecan_sim::World::take_recorded);
            let mut before_stop = Vec::new();
            let mut limit = 2_500;
            while state(&fixture) == DriveState::OperationEnabled && limit > 0 {
                fixture.step();
                limit -= 1;
                let frames = fixture.simulation.with_world(ecan_sim::World::take_recorded);
                if state(&fixture) == DriveState::OperationEnabled {
                    before_stop.extend(frames.into_iter().filter(|frame| frame.is_from_channel));
                }
            }
            let fed = before_stop.iter().filter(|frame| feeds(frame)).count();
            let trace = Trace::of(&mut fixture);
            println!("{mode}, host heartbeat {heartbeat:?}: {fed} frames fed, {trace}");
            assert!(limit > 2_450, "stopped within 100 ms: {trace}");
            trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
            assert_eq!(fed, 0, "SYNC and heartbeats before the stop");
            assert_stays_stopped(&mut fixture);
            fixture.start();
            accelerate(&mut fixture, mode);
        }
    }
}

/// A target of the earlier owner waits in the drive for a SYNC, which follows the first contact.
#[test]
fn waiting_target_does_not_undo_a_stop_at_first_contact() {
    for takeover in [Takeover::Stop, Takeover::Adopt] {
        let mode = OperatingMode::CyclicVelocity;
        let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
        adapter.dc = Some(DcSync::new(Duration::from_millis(2), Duration::from_micros(700)));
        let mut axes = table(mode, HostHeartbeat::Off);
        axes[0].drive.quick_stop = Some(QuickStopOption::QuickStopAndStay);
        let settings = config(HostHeartbeat::Off);
        let mut fixture = Fixture::open_with(drives(|_| {}), adapter, axes, settings);
        // After the SYNC of its cycle.
        fixture.cia402.set_scheduled_tx(&fixture.port, Some(200_000), None).unwrap();
        let mut fixture = at_speed_with(fixture, mode);
        let settings = Cia402Config { takeover, ..config(HostHeartbeat::Off) };
        let new = Cia402::new(&fixture.port, table(mode, HostHeartbeat::Off), settings);
        fixture.cia402 = new.unwrap_or_else(|error| panic!("{error}"));
        fixture.axis_mut(0).stop(StopKind::QuickStop);
        let trace = Trace::of(&mut fixture);
        println!("{takeover:?}: {trace}");
        trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
        assert_stays_stopped(&mut fixture);
        assert_eq!(state(&fixture), DriveState::SwitchOnDisabled, "{takeover:?}");
        assert!(fixture.axis(0).is_stopped(), "{takeover:?}");
    }
}

#[test]
fn new_owner_configures_a_moving_drive_after_its_stop() {
    for heartbeat in [HostHeartbeat::On, HostHeartbeat::Off] {
        let mode = OperatingMode::CyclicVelocity;
        let mut fixture = at_speed(mode, heartbeat);
        replace_owner(&mut fixture, mode, heartbeat);
        fixture.cia402.command_all(AxisCommand::Configure).unwrap();
        let trace = Trace::of(&mut fixture);
        println!("host heartbeat {heartbeat:?}: {trace}");
        trace.assert_rest(RETURN_MS, QUICK).assert_no_coasting();
        fixture.until(2_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Standby);
        assert_runs_again(&mut fixture);
    }
}

#[test]
fn new_owner_leaves_drives_off_that_were_off() {
    let mode = OperatingMode::CyclicVelocity;
    let mut fixture = open(drives(|_| {}), mode, HostHeartbeat::On).started();
    fixture.axis_mut(0).stop(StopKind::Disable);
    fixture.until(500, |cia402| {
        cia402.axis(0).unwrap().drive_state() == Some(DriveState::SwitchOnDisabled)
    });
    replace_owner(&mut fixture, mode, HostHeartbeat::On);
    assert_stays_stopped(&mut fixture);
    fixture.start();
}

/// A drive that does not answer SDO requests must not keep the channel from its SYNC.
#[test]
fn new_owner_continues_without_a_mute_drive() {
    let rule = SdoRule {
        index: object::STATUSWORD,
        subindex: None,
        direction: SdoDirection::Read,
        effect: SdoEffect::Abort(AbortCode::NO_OBJECT),
        times: None,
    };
    let scenario = drives(|drive| {
        if drive.node.get() == 1 {
            drive.quirks.sdo_rules.push(rule);
        }
    });
    let mut fixture = open(scenario, OperatingMode::CyclicVelocity, HostHeartbeat::On);
    fixture.start();
    fixture.check();
}

/// Replaces the owner by one that adopts enabled drives.
fn adopt(fixture: &mut Fixture, mode: OperatingMode) {
    let settings = Cia402Config { takeover: Takeover::Adopt, ..config(HostHeartbeat::On) };
    let new = Cia402::new(&fixture.port, table(mode, HostHeartbeat::On), settings);
    fixture.cia402 = new.unwrap_or_else(|error| panic!("{error}"));
}

#[test]
fn drive_at_rest_is_adopted_without_being_switched_off() {
    for mode in ADOPTED_MODES.into_iter().chain([OperatingMode::CyclicPosition]) {
        let mut fixture = open(drives(|_| {}), mode, HostHeartbeat::On);
        fixture.start();
        fixture.idle(100);
        adopt(&mut fixture, mode);
        let begin_ms = now_ms(&fixture);
        while !fixture.axis(0).is_configured() {
            fixture.step();
            assert_eq!(state(&fixture), DriveState::OperationEnabled, "{mode}");
            assert!(now_ms(&fixture) < begin_ms + 250.0, "{mode}: {:?}", fixture.axis(0).phase());
        }
        println!("{mode}: adopted after {:.0} ms", now_ms(&fixture) - begin_ms);
        fixture.idle(200);
        assert_eq!(state(&fixture), DriveState::OperationEnabled, "{mode}");
        fixture.axis_mut(0).enable().unwrap();
        fixture.until(500, Cia402::all_running);
        assert_eq!(state(&fixture), DriveState::OperationEnabled, "{mode}");
        fixture.check();
    }
}

/// A controlword of the adoption would enable it again if it had stopped by its own watch before.
#[test]
fn drive_that_stays_in_quick_stop_is_not_adopted() {
    let mode = OperatingMode::CyclicVelocity;
    let mut axes = table(mode, HostHeartbeat::On);
    axes[0].drive.quick_stop = Some(QuickStopOption::QuickStopAndStay);
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    let settings = config(HostHeartbeat::On);
    let fixture = Fixture::open_with(drives(|_| {}), adapter, axes, settings);
    let mut fixture = fixture.started();
    adopt(&mut fixture, mode);
    fixture.until(1_000, Cia402::all_stopped);
    assert!(!fixture.axis(0).is_configured());
    assert_ne!(state(&fixture), DriveState::OperationEnabled);
}

const ADOPTED_MODES: [OperatingMode; 4] = [
    OperatingMode::ProfileVelocity,
    OperatingMode::CyclicVelocity,
    OperatingMode::Velocity,
    OperatingMode::ProfilePosition,
];

/// An axis that moves at a velocity or to a set-point far away, whose motor is blocked, so that it rests.
fn blocked_with_target(mode: OperatingMode, adapter: AdapterConfig) -> Fixture {
    let scenario = drives(|drive| drive.trace = 50_000);
    let axes = table(mode, HostHeartbeat::On);
    let fixture = Fixture::open_with(scenario, adapter, axes, config(HostHeartbeat::On));
    block_with_target(fixture, mode)
}

fn block_with_target(fixture: Fixture, mode: OperatingMode) -> Fixture {
    let mut fixture = fixture.started();
    let target = match mode {
        OperatingMode::ProfilePosition => fixture.axis(0).actual().unwrap() + 100_000_000,
        OperatingMode::CyclicVelocity => 20_000,
        OperatingMode::Velocity => 1_000,
        _ => 100_000,
    };
    fixture.axis_mut(0).set_target(target).unwrap();
    fixture.steps(300);
    assert!(velocity(&fixture) > 10_000.0, "{mode}: {}/s", velocity(&fixture));
    fixture.strike(0, DriveFault::Blocked { for_ms: 3_000 });
    fixture.steps(50);
    assert!(velocity(&fixture).abs() < REST, "{mode}: blocked");
    assert_eq!(state(&fixture), DriveState::OperationEnabled, "{mode}");
    fixture
}

/// The fastest motion of the drive since a time.
fn fastest_since(fixture: &Fixture, since_ns: u64) -> f64 {
    let new = |drive: &ecan_sim::Drive| {
        let records = drive.trace().iter().filter(|record| record.time_ns >= since_ns);
        let speed = |event| match event {
            TraceEvent::Motion(sample) => Some(sample.velocity.abs()),
            _ => None,
        };
        records.filter_map(|record| speed(record.event)).fold(0.0, f64::max)
    };
    fixture.drive(0, new)
}

/// The drive rests only because its motor is blocked. What the earlier owner commanded must not be in force
/// when it is free again.
#[test]
fn adopted_drive_does_not_continue_the_motion_of_an_earlier_owner() {
    for mode in &ADOPTED_MODES[..3] {
        let mode = *mode;
        let cycle = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
        let mut fixture = blocked_with_target(mode, cycle);
        adopt(&mut fixture, mode);
        let since_ns = fixture.now_ns();
        // The demand of a profile mode returns by the ramp of the drive.
        fixture.until(500, |cia402| cia402.axis(0).unwrap().is_configured());
        assert_eq!(state(&fixture), DriveState::OperationEnabled, "{mode}: adopted");
        // The motor is free after 3 s.
        fixture.steps(2_000);
        let fastest = fastest_since(&fixture, since_ns);
        assert!(fastest < REST, "{mode}: {fastest}/s, {}", fixture.axis(0).progress());
        fixture.axis_mut(0).enable().unwrap();
        fixture.until(500, Cia402::all_running);
        fixture.steps(200);
        let fastest = fastest_since(&fixture, since_ns);
        assert!(fastest < REST, "{mode}: {fastest}/s after it was enabled");
        assert_eq!(state(&fixture), DriveState::OperationEnabled, "{mode}");
        assert_moves_again(&mut fixture, mode);
    }
}

/// The set-point of the earlier owner is pending: its axis was halted.
#[test]
fn adopted_drive_does_not_continue_to_a_pending_set_point() {
    let mode = OperatingMode::ProfilePosition;
    let mut fixture = open(drives(|drive| drive.trace = 50_000), mode, HostHeartbeat::On);
    fixture.start();
    let far = fixture.axis(0).actual().unwrap() + 100_000_000;
    fixture.axis_mut(0).set_target(far).unwrap();
    fixture.steps(300);
    fixture.axis_mut(0).halt();
    fixture.until(2_000, |cia402| cia402.axis(0).unwrap().is_at_rest());
    fixture.steps(50);
    assert!(velocity(&fixture).abs() < REST, "{}/s", velocity(&fixture));
    adopt(&mut fixture, mode);
    let since_ns = fixture.now_ns();
    fixture.until(200, |cia402| cia402.axis(0).unwrap().is_configured());
    fixture.steps(500);
    fixture.axis_mut(0).enable().unwrap();
    fixture.until(500, Cia402::all_running);
    fixture.steps(500);
    let fastest = fastest_since(&fixture, since_ns);
    assert!(fastest < REST, "{fastest}/s, {}", fixture.axis(0).progress());
    assert_eq!(state(&fixture), DriveState::OperationEnabled);
    assert_moves_again(&mut fixture, mode);
}

/// A blocked motor far from the demand of its drive would go there as soon as it is free.
#[test]
fn blocked_drive_far_from_its_demand_is_not_adopted() {
    let mode = OperatingMode::ProfilePosition;
    let cycle = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    let mut fixture = blocked_with_target(mode, cycle);
    adopt(&mut fixture, mode);
    let since_ns = fixture.now_ns();
    fixture.until(1_000, Cia402::all_stopped);
    fixture.steps(1_500);
    assert!(!fixture.axis(0).is_configured());
    let fastest = fastest_since(&fixture, since_ns);
    assert!(fastest < REST, "{fastest}/s in {}", state(&fixture));
}

/// The axis follows the targets of its new owner.
fn assert_moves_again(fixture: &mut Fixture, mode: OperatingMode) {
    let from = fixture.axis(0).actual().unwrap();
    let target = match mode {
        OperatingMode::ProfilePosition => from + 50_000,
        OperatingMode::Velocity => 500,
        _ => 20_000,
    };
    fixture.axis_mut(0).set_target(target).unwrap();
    fixture.steps(500);
    assert!(fixture.axis(0).actual().unwrap() > from + 1_000, "{mode}");
}

/// A drive whose frames can be scheduled at a phase of Sync0.
fn open_with_dc(mode: OperatingMode) -> Fixture {
    let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    adapter.dc = Some(DcSync::new(Duration::from_millis(2), Duration::from_micros(700)));
    let scenario = drives(|drive| drive.trace = 50_000);
    let axes = table(mode, HostHeartbeat::On);
    Fixture::open_with(scenario, adapter, axes, config(HostHeartbeat::On))
}

/// The last RPDO of the earlier owner waits in the drive for the first SYNC of the new one.
#[test]
fn waiting_target_does_not_move_an_adopted_drive() {
    let mode = OperatingMode::CyclicVelocity;
    let mut fixture = open_with_dc(mode);
    // After the SYNC of its cycle.
    fixture.cia402.set_scheduled_tx(&fixture.port, Some(200_000), None).unwrap();
    let mut fixture = fixture.started();
    fixture.axis_mut(0).set_target(20_000).unwrap();
    fixture.steps(1);
    adopt(&mut fixture, mode);
    // Frames of the old owner, which the Port and the gateway still hold.
    fixture.steps(3);
    let since_ns = fixture.now_ns();
    fixture.until(200, |cia402| cia402.axis(0).unwrap().is_configured());
    fixture.steps(500);
    let fastest = fastest_since(&fixture, since_ns);
    assert!(fastest < REST, "{fastest}/s");
    assert_eq!(state(&fixture), DriveState::OperationEnabled);
}

/// Targets that the drive does not take, and one that it takes but does not keep.
#[test]
fn drive_that_keeps_an_earlier_target_is_stopped() {
    let rule = |index, direction, effect| SdoRule {
        index,
        subindex: None,
        direction,
        effect,
        times: None,
    };
    let abort = SdoEffect::Abort(AbortCode::READ_ONLY);
    for (mode, rule) in [
        (OperatingMode::ProfileVelocity, rule(object::TARGET_VELOCITY, SdoDirection::Write, abort)),
        (OperatingMode::Velocity, rule(object::VL_TARGET_VELOCITY, SdoDirection::Write, abort)),
        (OperatingMode::ProfilePosition, rule(object::TARGET_POSITION, SdoDirection::Write, abort)),
    ] {
        let scenario = drives(|drive| {
            drive.trace = 50_000;
            drive.quirks.sdo_rules.push(rule);
        });
        let fixture = open(scenario, mode, HostHeartbeat::On);
        let mut fixture = block_with_target(fixture, mode);
        adopt(&mut fixture, mode);
        let since_ns = fixture.now_ns();
        fixture.until(1_000, Cia402::all_stopped);
        fixture.steps(1_500);
        assert!(!fixture.axis(0).is_configured(), "{mode}");
        assert_ne!(state(&fixture), DriveState::OperationEnabled, "{mode}");
        let fastest = fastest_since(&fixture, since_ns);
        assert!(fastest < REST, "{mode}: {fastest}/s");
    }
}

#[test]
fn moving_drive_is_not_adopted() {
    let mode = OperatingMode::CyclicVelocity;
    let mut fixture = at_speed(mode, HostHeartbeat::On);
    adopt(&mut fixture, mode);
    Trace::of(&mut fixture).assert_rest(400.0, QUICK).assert_no_coasting();
    assert!(!fixture.axis(0).is_configured());
}

#[test]
fn drive_in_another_mode_is_not_adopted() {
    let mut fixture = open(drives(|_| {}), OperatingMode::CyclicVelocity, HostHeartbeat::On);
    fixture.start();
    adopt(&mut fixture, OperatingMode::CyclicPosition);
    fixture.until(500, Cia402::all_stopped);
    assert!(!fixture.axis(0).is_configured());
    assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
}

#[test]
fn drive_silent_at_the_first_contact_is_stopped_when_it_answers() {
    for is_configured in [false, true] {
        let mode = OperatingMode::CyclicVelocity;
        let mut fixture = at_speed(mode, HostHeartbeat::Off);
        fixture.inject(Fault::NodeSilent { node: "drive 0.0/1".to_owned(), for_ms: 1_500 });
        replace_owner(&mut fixture, mode, HostHeartbeat::Off);
        if is_configured {
            fixture.axis_mut(0).configure().unwrap();
        }
        fixture.steps(725);
        assert!(velocity(&fixture) > 0.9 * SPEED, "it is not reached before");
        Trace::of(&mut fixture).assert_rest(1_000.0, QUICK).assert_no_coasting();
    }
}

#[test]
fn drive_that_opens_its_brake_at_the_takeover_is_switched_off() {
    let scenario = drives(|drive| drive.enable_ms = 100);
    let mode = OperatingMode::CyclicVelocity;
    let mut fixture = open(scenario, mode, HostHeartbeat::Off);
    fixture.cia402.blocking(&mut fixture.port, START).configure().unwrap();
    fixture.axis_mut(0).enable().unwrap();
    fixture
        .until(500, |cia402| cia402.axis(0).unwrap().drive_state() == Some(DriveState::SwitchedOn));
    fixture.steps(5);
    replace_owner(&mut fixture, mode, HostHeartbeat::Off);
    fixture.until(500, Cia402::all_stopped);
    fixture.steps(200);
    assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
}

/// A drive at rest whose adoption begins, with this answer to a request of its velocity offset.
fn adopted_with_offset(effect: SdoEffect) -> Fixture {
    let mode = OperatingMode::CyclicVelocity;
    let rule = SdoRule {
        index: object::VELOCITY_OFFSET,
        subindex: None,
        direction: SdoDirection::Read,
        effect,
        times: None,
    };
    let scenario = drives(|drive| drive.quirks.sdo_rules.push(rule));
    let mut fixture = open(scenario, mode, HostHeartbeat::On);
    fixture.start();
    fixture.idle(100);
    adopt(&mut fixture, mode);
    fixture
}

/// With a velocity offset of the earlier owner, velocity 0 would not be standstill.
#[test]
fn drive_whose_velocity_offset_is_not_known_is_not_adopted() {
    for (effect, is_adopted) in [
        (SdoEffect::Abort(AbortCode::NO_OBJECT), true),
        (SdoEffect::Abort(AbortCode::GENERAL), false),
    ] {
        let mut fixture = adopted_with_offset(effect);
        fixture
            .until(1_000, |cia402| cia402.all_stopped() || cia402.axis(0).unwrap().is_configured());
        assert_eq!(fixture.axis(0).is_configured(), is_adopted);
        let expected =
            if is_adopted { DriveState::OperationEnabled } else { DriveState::SwitchOnDisabled };
        assert_eq!(state(&fixture), expected);
    }
}

/// The drive takes over what it got last with the first SYNC, so that must be the standstill, also if frames wait
/// in the gateway for their time.
#[test]
fn adopted_drive_gets_its_standstill_before_the_first_sync() {
    let node = NodeId::new(1).unwrap();
    let [to_drive, sync] = [CobId::rpdo(node, 1), CobId::SYNC].map(CobId::can_id);
    for mode in ADOPTED_MODES.into_iter().chain([OperatingMode::CyclicPosition]) {
        for target_ns in [None, Some(1_900_000)] {
            let mut fixture = open_with_dc(mode);
            fixture.start();
            fixture.idle(100);
            adopt(&mut fixture, mode);
            fixture.cia402.set_scheduled_tx(&fixture.port, target_ns, None).unwrap();
            // Frames of the old owner, which the Port and the gateway still hold.
            fixture.steps(3);
            fixture.simulation.with_world(|world| world.record_bus_of(0, 0));
            fixture.until(500, |cia402| cia402.axis(0).unwrap().is_configured());
            let recorded = fixture.simulation.with_world(ecan_sim::World::take_recorded);
            let sent = recorded.iter().filter(|frame| frame.is_from_channel);
            let ids = sent.map(|frame| frame.frame.id()).take_while(|id| *id != sync);
            let before = ids.filter(|id| *id == to_drive).count();
            // One in each of two cycles, and one in each further one until SYNC was sent.
            let least = if target_ns.is_some() { 4 } else { 3 };
            assert!(before >= least, "{mode}, {target_ns:?}: {before} frames before SYNC");
        }
    }
}

/// The standstill goes out in consecutive cycles, also if commands are repeated only with each SYNC period.
#[test]
fn adopted_drive_gets_its_standstill_in_consecutive_cycles() {
    let sync = SyncConfig { every_cycles: 5, ..SyncConfig::default() };
    let settings = Cia402Config { sync, ..config(HostHeartbeat::On) };
    let mode = OperatingMode::CyclicVelocity;
    let (axes, adapter) = (table(mode, HostHeartbeat::On), AdapterConfig::new(1));
    let adapter = adapter.with_cycle(Duration::from_millis(2));
    let mut fixture = Fixture::open_with(drives(|_| {}), adapter, axes, settings).started();
    fixture.idle(100);
    let settings = Cia402Config { takeover: Takeover::Adopt, sync, ..config(HostHeartbeat::On) };
    let new = Cia402::new(&fixture.port, table(mode, HostHeartbeat::On), settings);
    fixture.cia402 = new.unwrap_or_else(|error| panic!("{error}"));
    fixture.steps(3);
    fixture.simulation.with_world(|world| world.record_bus_of(0, 0));
    fixture.until(500, |cia402| cia402.axis(0).unwrap().is_configured());
    let to_drive = CobId::rpdo(NodeId::new(1).unwrap(), 1).can_id();
    let recorded = fixture.simulation.with_world(ecan_sim::World::take_recorded);
    let sent = recorded.iter().filter(|frame| frame.frame.id() == to_drive);
    let times: Vec<_> = sent.map(|frame| frame.start_ns).collect();
    assert!(times[1] - times[0] < 3_000_000, "{times:?}");
}

/// The transfer that the stop interrupts is aborted, and the next one can begin at once.
#[test]
fn stop_during_an_adoption_aborts_its_transfer() {
    let mut fixture = adopted_with_offset(SdoEffect::Silence);
    fixture.simulation.with_world(|world| world.record_bus_of(0, 0));
    let to_server = CobId::sdo_client(NodeId::new(1).unwrap()).can_id();
    let request_of = |fixture: &mut Fixture, command: u8| {
        let [low, high] = object::VELOCITY_OFFSET.to_le_bytes();
        let recorded = fixture.simulation.with_world(ecan_sim::World::take_recorded);
        recorded.iter().any(|frame| {
            frame.frame.id() == to_server && frame.frame.data().starts_with(&[command, low, high])
        })
    };
    let mut limit = 500;
    while !request_of(&mut fixture, 0x40) {
        fixture.step();
        limit -= 1;
        assert!(limit > 0, "the offset is not asked for");
    }
    fixture.axis_mut(0).stop(StopKind::Disable);
    fixture.steps(5);
    assert!(request_of(&mut fixture, 0x80), "no abort within 10 ms");
    fixture.until(500, Cia402::all_stopped);
    assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
}

/// Lost responses of the position do not make a drive absent that reported that it is enabled.
#[test]
fn enabled_drive_whose_position_is_not_answered_is_stopped() {
    // Four attempts of the first owner, which finds the drive off, and four of the next one.
    let rule = SdoRule {
        index: object::POSITION_ACTUAL,
        subindex: None,
        direction: SdoDirection::Read,
        effect: SdoEffect::Silence,
        times: Some(8),
    };
    for is_configured in [false, true] {
        let mode = OperatingMode::CyclicVelocity;
        let scenario = drives(|drive| drive.quirks.sdo_rules.push(rule));
        let mut fixture = at_speed_with(open(scenario, mode, HostHeartbeat::Off), mode);
        replace_owner(&mut fixture, mode, HostHeartbeat::Off);
        if is_configured {
            fixture.axis_mut(0).configure().unwrap();
        }
        let trace = Trace::of(&mut fixture);
        println!("configured {is_configured}: {trace}");
        // The first attempt ends after 100 ms.
        trace.assert_rest(2.0 * RETURN_MS, QUICK).assert_no_coasting();
        if is_configured {
            fixture.until(2_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Standby);
            assert_runs_again(&mut fixture);
        } else {
            fixture.until(1_000, Cia402::all_stopped);
            assert_eq!(state(&fixture), DriveState::SwitchOnDisabled);
        }
    }
}

/// The first SYNC of the new owner executes the last RPDO of the earlier one.
#[test]
fn quick_stop_at_the_first_contact_ends_off() {
    let sync = SyncConfig { every_cycles: 2, ..SyncConfig::default() };
    let settings = Cia402Config { sync, ..config(HostHeartbeat::On) };
    for mode in [OperatingMode::CyclicPosition, OperatingMode::ProfileVelocity] {
        let mut axes = table(mode, HostHeartbeat::On);
        axes[0].drive.quick_stop = Some(QuickStopOption::QuickStopAndStay);
        let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
        let mut fixture =
            Fixture::open_with(drives(|_| {}), adapter, axes.clone(), settings.clone());
        fixture.cia402.blocking(&mut fixture.port, START).configure().unwrap();
        fixture.axis_mut(0).enable().unwrap();
        // The cycle after a SYNC sends the first target.
        fixture.until(500, |cia402| cia402.axis(0).unwrap().is_running());
        fixture.cia402 = Cia402::new(&fixture.port, axes, settings.clone()).unwrap();
        fixture.axis_mut(0).stop(StopKind::QuickStop);
        fixture.until(500, |cia402| cia402.axis(0).unwrap().is_stopped());
        let stopped_ns = fixture.now_ns();
        for _ in 0..50 {
            fixture.step();
            assert_ne!(state(&fixture), DriveState::OperationEnabled, "{mode}");
        }
        let last = fixture.drive_axis(0, |drive| drive.trace().last_controlword());
        let (at_ns, word, source) = last.unwrap();
        assert_eq!(
            word.command(word),
            Command::EnableOperation,
            "{mode}: that of the earlier owner"
        );
        assert_eq!(source, CommandSource::Pdo, "{mode}");
        assert!(at_ns > stopped_ns, "{mode}: before the stop");
        assert_eq!(state(&fixture), DriveState::SwitchOnDisabled, "{mode}");
    }
}
