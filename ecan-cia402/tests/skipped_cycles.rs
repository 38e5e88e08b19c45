//! Applications that leave out cycles, take items first, or create the axes again on the same Port.
#![allow(missing_docs)]

use std::time::Duration;

use crate::axes::{Fixture, START, axes, scenario};
use ecan_cia402::{
    AxisCommand, AxisConfig, AxisPhase, Cia402, Cia402Config, Decision, HoldReason, StopKind,
    WaitReason,
};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::OptionFlags;
use ecan_sim::{Fault, LossDirection};

const STEP: i32 = 150;

/// Targets at the limit: a step is the limit.
fn table() -> Vec<AxisConfig> {
    let change = |mut axis: AxisConfig| {
        axis.step_limit = STEP as u32;
        axis.target_step = STEP;
        axis.following_window = 3_000;
        axis.drive.following_error = Some((3_000, 20));
        axis
    };
    axes(2).into_iter().map(change).collect()
}

fn in_motion() -> Fixture {
    let mut fixture = Fixture::single(table()).started();
    fixture.steps(50);
    assert!(fixture.cia402.all_running());
    fixture
}

fn disable_and_enable(fixture: &mut Fixture) {
    fixture.cia402.command_all(AxisCommand::Stop(StopKind::Disable)).unwrap();
    fixture.until(2_000, |cia402| {
        (0..2).all(|axis| cia402.axis(axis).unwrap().phase() == AxisPhase::Standby)
    });
    fixture.cia402.command_all(AxisCommand::Enable).unwrap();
    fixture.until(2_000, Cia402::all_running);
    fixture.check();
}

#[test]
fn axes_can_be_enabled_after_a_skipped_cycle() {
    for sends in [false, true] {
        let mut fixture = in_motion();
        fixture.skip(1, sends);
        fixture.steps(10);
        disable_and_enable(&mut fixture);
    }
}

#[test]
fn axes_can_be_enabled_after_others_took_a_cycle() {
    let mut fixture = in_motion();
    fixture.port.next_cycle().received().for_each(drop);
    fixture.steps(10);
    disable_and_enable(&mut fixture);
}

#[test]
fn second_object_on_a_port_can_enable_its_axes() {
    let mut fixture = in_motion();
    fixture.cia402.command_all(AxisCommand::Stop(StopKind::Disable)).unwrap();
    fixture.until(2_000, |cia402| cia402.axis(0).unwrap().phase() == AxisPhase::Standby);
    fixture.cia402 = Cia402::new(&fixture.port, table(), Cia402Config::default()).unwrap();
    fixture.start();
    fixture.until(2_000, Cia402::all_running);
    disable_and_enable(&mut fixture);
}

/// The gateway's queue is lost with the bus, and the status is good again when it is read.
#[test]
fn bus_off_in_skipped_cycles_holds_the_axes() {
    for sends in [false, true] {
        let mut fixture = in_motion();
        fixture.inject(Fault::BusOff { gateway: 0, channel: 0 });
        // The target of this cycle never reaches the drive.
        fixture.step();
        let can0 = fixture.port.channel(0, 0).unwrap();
        let mut was_off = false;
        for _ in 0..100 {
            fixture.skip(1, sends);
            let is_off = fixture.port.channel_status(can0).bus_off();
            if was_off && !is_off {
                break;
            }
            was_off |= is_off;
        }
        assert!(was_off && !fixture.port.channel_status(can0).bus_off());
        fixture.steps(10);
        fixture.check();
        for axis in 0..2 {
            let reason = fixture.axis(axis).statistics().last_hold;
            assert_eq!(reason, Some(HoldReason::BusOff), "axis {axis}");
        }
        fixture.cia402.command_all(AxisCommand::Enable).unwrap();
        fixture.until(2_000, Cia402::all_running);
        fixture.check();
    }
}

/// Their images are missing, and with them the status of the channel.
#[test]
fn incomplete_working_counters_in_skipped_cycles_hold_the_axes() {
    for (cycles, holds) in [(2, false), (6, true)] {
        let mut fixture = in_motion();
        fixture.inject(Fault::LostFrame { direction: LossDirection::Return, cycles });
        fixture.skip(cycles as usize + 2, true);
        fixture.steps(5);
        fixture.check();
        let reason = fixture.axis(0).statistics().last_hold;
        assert_eq!(reason, holds.then_some(HoldReason::WorkingCounter), "{cycles} cycles");
    }
}

/// A gateway that reports every frame, and rejects what its queue cannot hold.
fn with_results() -> Fixture {
    let mut gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    gateway.tx_options = OptionFlags::TX_RESULT;
    gateway.paced = false;
    let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    adapter.slaves[0].rx_multiplier = 11;
    let settings = Cia402Config::default();
    let mut fixture =
        Fixture::open_on(scenario(1, |_| ()), adapter, gateway, table(), settings).started();
    fixture.steps(50);
    assert!(fixture.cia402.all_running());
    fixture
}

/// One cycle in which other frames fill the channel's queue in the gateway before the targets.
fn flood(fixture: &mut Fixture) {
    let frame = CanFrame::classic(CanId::standard(0x7F0).unwrap(), &[0; 8]).unwrap();
    fixture.cycle_with(|cia402, cycle| {
        let can0 = cycle.channel(0, 0).unwrap();
        for _ in 0..75 {
            cycle.send(can0, &frame).unwrap();
        }
        cia402.send_target_step(cycle)
    });
}

/// A target that the Port has no room for is not lost: the axis waits, and makes the same step later.
#[test]
fn target_without_room_is_counted_as_a_wait() {
    let mut fixture = in_motion();
    let before = [0, 1].map(|axis| (fixture.axis(axis).statistics(), fixture.axis(axis).target()));
    let frame = CanFrame::classic(CanId::standard(0x7F0).unwrap(), &[0; 8]).unwrap();
    fixture.cycle_with(|cia402, cycle| {
        let can0 = cycle.channel(0, 0).unwrap();
        while cycle.send(can0, &frame).is_ok() {}
        cia402.send_target_step(cycle)
    });
    for (axis, (earlier, target)) in before.iter().enumerate() {
        assert_eq!(fixture.axis(axis).decision(), Decision::Wait(WaitReason::Rejected));
        assert_eq!(fixture.axis(axis).target(), *target, "axis {axis}");
        let now = fixture.axis(axis).statistics();
        assert_eq!((now.waits - earlier.waits, now.targets_sent - earlier.targets_sent), (1, 0));
        assert_eq!((now.targets_rejected, now.targets_lost), (0, 0), "axis {axis}");
    }
    fixture.steps(20);
    fixture.check();
}

fn failed(fixture: &Fixture) -> u64 {
    fixture.statistics().channels[0].results_failed
}

/// Targets are lost; `next` is a cycle that brings the results.
fn lose_targets(fixture: &mut Fixture, next: impl Fn(&mut Fixture)) {
    let before = failed(fixture);
    flood(fixture);
    for _ in 0..3 {
        next(fixture);
    }
    assert!(failed(fixture) > before, "frames were lost");
    fixture.steps(20);
    fixture.check();
    for axis in 0..2 {
        let reason = fixture.axis(axis).statistics().last_hold;
        assert_eq!(reason, Some(HoldReason::TargetLost), "axis {axis}");
    }
    fixture.cia402.command_all(AxisCommand::Enable).unwrap();
    fixture.until(2_000, Cia402::all_running);
    fixture.check();
}

#[test]
fn failed_result_of_a_target_is_counted() {
    let mut fixture = with_results();
    let lost = |fixture: &Fixture| [0, 1].map(|n| fixture.axis(n).statistics().targets_lost);
    assert_eq!(lost(&fixture), [0, 0]);
    fixture.inject(Fault::BusOff { gateway: 0, channel: 0 });
    fixture.steps(20);
    // Two targets of each axis, and three times SYNC.
    assert_eq!((lost(&fixture), failed(&fixture)), ([2, 2], 7));
}

#[test]
fn failed_result_in_a_skipped_cycle_holds_the_axes() {
    lose_targets(&mut with_results(), |fixture| fixture.skip(1, true));
}

#[test]
fn failed_result_taken_by_another_consumer_holds_the_axes() {
    lose_targets(&mut with_results(), |fixture| {
        let mut cycle = fixture.port.next_cycle();
        cycle.received().for_each(drop);
        fixture.cia402.process_rx(&mut cycle);
        fixture.cia402.send_target_step(&mut cycle);
    });
}

#[test]
fn reconfiguration_between_two_cycles_holds_the_axes() {
    let mut fixture = in_motion();
    let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    let config = (adapter, ecan_mcan_port::PortConfig::uniform(1, gateway));
    fixture.port.reconfigure(config).unwrap();
    fixture.port.wait_ready_timeout(START).unwrap();
    fixture.steps(20);
    assert!(!fixture.axis(0).is_running());
    assert_eq!(fixture.axis(0).statistics().last_hold, Some(HoldReason::GatewayLost));
    fixture.check();
}
