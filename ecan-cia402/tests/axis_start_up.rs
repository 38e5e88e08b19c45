//! From drives in whatever state to axes that follow targets.
#![allow(missing_docs)]

use std::time::Duration;

use crate::axes::{Fixture, axes, axis, with_quirk};
use ecan_canopen::DriveState;
use ecan_cia402::{
    AxisConfig, AxisFault, AxisFaults, AxisPhase, Cia402, Cia402Config, Cia402Error, Shutdown,
};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_protocol::config::TxMode;
use ecan_protocol::image::BudgetPolicy;
use ecan_protocol::mapping::Direction;
use ecan_sim::variant::RxBudgetPolicy;
use ecan_sim::{ClockKind, SimOptions};

#[test]
fn enabling_does_not_move_the_axis() {
    let mut fixture = Fixture::single(vec![axis(0, 0, 1)]).started();
    let before = fixture.drive(0, |drive| drive.mechanical_position());
    fixture.idle(500);
    assert_eq!(fixture.axis(0).drive_state(), Some(DriveState::OperationEnabled));
    assert_eq!(fixture.axis(0).phase(), AxisPhase::Running);
    let after = fixture.drive(0, |drive| drive.mechanical_position());
    assert!((after - before).abs() < 0.5, "from {before} to {after}");
    fixture.check();
    let statistics = fixture.axis(0).statistics();
    assert_eq!((statistics.activations, statistics.lost_tpdos, statistics.holds), (1, 0, 0));
}

#[test]
fn four_axes_follow_their_steps() {
    let table = axes(4).into_iter().map(|axis| axis.with_target_step(100)).collect();
    let mut fixture = Fixture::single(table).started();
    let before: Vec<_> = (0..4).map(|n| fixture.axis(n).actual().unwrap()).collect();
    fixture.steps(500);
    for (n, before) in before.into_iter().enumerate() {
        let (target, actual) =
            (fixture.axis(n).target().unwrap(), fixture.axis(n).actual().unwrap());
        assert!(target - before > 48_000, "axis {n} from {before} to {target}");
        assert!((target - actual).abs() < 1_000, "axis {n} at {actual} for {target}");
        let statistics = fixture.axis(n).statistics();
        assert_eq!((statistics.lost_tpdos, statistics.holds, statistics.waits), (0, 0, 0));
    }
    fixture.check();
}

/// Three gateways, so that SM3 is still full when the service runs: each image is one cycle older.
#[test]
fn axes_follow_their_steps_when_images_are_published_after_a_read() {
    let mut scenario = ecan_sim::drives(3, 4);
    for gateway in &mut scenario.gateways {
        gateway.config.publishes_after_read = true;
    }
    let table =
        (0..10).map(|n| axis(n / 4, (n % 4) as u8, 1).with_target_step(100)).collect::<Vec<_>>();
    let adapter = AdapterConfig::new(3).with_cycle(Duration::from_millis(4));
    let mut fixture = Fixture::open(scenario, adapter, table).started();
    fixture.steps(500);
    for n in 0..10 {
        let statistics = fixture.axis(n).statistics();
        assert_eq!((statistics.lost_tpdos, statistics.holds), (0, 0), "axis {n}");
    }
    fixture.check();
}

#[test]
fn shutdown_leaves_drives_at_rest_without_fault() {
    let table = axes(4).into_iter().map(|axis| axis.with_target_step(200)).collect();
    let mut fixture = Fixture::single(table).started();
    fixture.steps(200);
    let ended = fixture.cia402.blocking(&mut fixture.port, Duration::from_secs(10)).shut_down();
    ended.unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(fixture.cia402.shutdown_state(), Shutdown::Done);
    fixture.check();
    // The host is gone: no cycle for two seconds.
    fixture.simulation.pass_ns(2_000_000_000);
    for n in 0..4 {
        let (state, velocity) = fixture.drive(n, |drive| (drive.state(), drive.velocity()));
        assert_eq!(state, DriveState::SwitchOnDisabled, "axis {n}");
        assert!(velocity.abs() < 10.0, "axis {n} at {velocity} increments per second");
    }
}

#[test]
fn drives_detect_a_stopped_host() {
    let table = axes(2).into_iter().map(|axis| axis.with_target_step(200)).collect();
    let mut fixture = Fixture::single(table).started();
    fixture.steps(200);
    fixture.simulation.pass_ns(1_000_000_000);
    for n in 0..2 {
        let state = fixture.drive(n, |drive| drive.state());
        assert_ne!(state, DriveState::OperationEnabled, "axis {n}");
    }
}

#[test]
fn drives_without_optional_objects_start() {
    let scenario = with_quirk(1, 1, |quirks| {
        quirks.missing = vec![0x1006, 0x1016, 0x1017, 0x6007, 0x60C2];
    });
    let mut fixture = Fixture::with(scenario, axes(2)).started();
    fixture.idle(100);
    assert!(fixture.cia402.all_running());
    fixture.check();
}

#[test]
fn invalid_table_is_rejected_with_every_fault() {
    let port = Fixture::single(axes(1)).port;
    let rejected = |table: Vec<AxisConfig>| {
        Cia402::new(&port, table, Cia402Config::default()).unwrap_err().to_string()
    };
    let mut bad = axes(3);
    bad[0].step_limit = 0;
    bad[2].following_window = 1;
    let text = rejected(bad);
    assert!(text.contains("axis 0") && text.contains("axis 2"), "{text}");
    assert!(rejected(vec![axis(1, 0, 1)]).contains("slave 1"));
    assert!(rejected(vec![axis(0, 0, 1), axis(0, 0, 1)]).contains("node 1"));
    assert!(rejected(vec![axis(0, 0, 127)]).contains("heartbeat"));
    let mut queue = ChannelConfig::classic(1_000_000);
    queue.can.ram.tx_mode = TxMode::Queue;
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(ecan_sim::drives(1, 4), &options).unwrap();
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, queue));
    let port = Port::open(&backend.ecrt, (AdapterConfig::new(1), config)).unwrap();
    let error = Cia402::new(&port, axes(1), Cia402Config::default()).unwrap_err();
    assert!(matches!(only_fault(error), AxisFault::TransmitQueue { .. }));
    let error = Cia402::new(&port, vec![axis(0, 1, 1)], Cia402Config::default()).unwrap_err();
    assert!(matches!(only_fault(error), AxisFault::ChannelNotEnabled { channel: 1, .. }));
}

fn only_fault(error: Cia402Error) -> AxisFault {
    match error {
        Cia402Error::Axes(AxisFaults { faults }) if faults.len() == 1 => faults[0].1,
        other => panic!("{other}"),
    }
}

#[test]
fn faults_of_values_and_addresses_are_reported_together() {
    let port = Fixture::single(axes(1)).port;
    let mut table =
        vec![axis(0, 0, 1), axis(7, 0, 2), axis(0, 2, 3), axis(0, 0, 1), axis(0, 0, 127)];
    table[0].step_limit = 0;
    table[2].following_window = 1;
    let error = Cia402::new(&port, table, Cia402Config::default()).unwrap_err();
    let Cia402Error::Axes(AxisFaults { faults }) = error else { panic!("{error}") };
    let found = |axis: usize| faults.iter().filter(|(index, _)| *index == axis).collect::<Vec<_>>();
    assert!(found(0).iter().any(|(_, fault)| *fault == AxisFault::NoStep), "{faults:?}");
    assert!(matches!(found(1)[..], [(_, AxisFault::NoSuchSlave { slave: 7, .. })]), "{faults:?}");
    assert!(matches!(found(2)[..], [(_, AxisFault::Window { .. })]), "{faults:?}");
    assert!(matches!(found(3)[..], [(_, AxisFault::SameNode { other: 0, .. })]), "{faults:?}");
    assert!(matches!(found(4)[..], [(_, AxisFault::HostNode { .. })]), "{faults:?}");
}

#[test]
fn axis_on_a_channel_of_one_direction_is_rejected() {
    let channel = ChannelConfig::classic(1_000_000);
    let both = GatewayConfig::on_channel(0, channel).with_channel(1, channel);
    for (masks, number, missing) in
        [((0b01, 0b11), 1, Direction::TxPdo), ((0b11, 0b01), 1, Direction::RxPdo)]
    {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::drives(1, 4), &options).unwrap();
        let config = PortConfig::uniform(1, both.with_channel_masks(masks.0, masks.1));
        let port = Port::open(&backend.ecrt, (AdapterConfig::new(1), config)).unwrap();
        let table = vec![axis(0, number, 1)];
        let error = Cia402::new(&port, table, Cia402Config::default()).unwrap_err();
        let fault = AxisFault::ChannelDirection { slave: 0, channel: 1, direction: missing };
        assert_eq!(only_fault(error), fault);
        Cia402::new(&port, vec![axis(0, 0, 1)], Cia402Config::default()).unwrap();
    }
}

/// Two axes on each channel of an RxPDO of 104 bytes, of which a channel has 26 with equal shares.
#[test]
fn axes_of_a_gateway_that_applies_the_budget_lose_no_frame() {
    for budget in [BudgetPolicy::SharedOnly, BudgetPolicy::Balanced, BudgetPolicy::Deterministic] {
        let mut scenario = ecan_sim::drives(1, 16);
        scenario.gateways[0].config.variant.rx_budget = RxBudgetPolicy::Applied;
        let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2)).with_multiplier(1);
        let mut gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
        gateway.rx_budget = budget;
        let axes = (0..8).map(|n| axis(0, n / 2, n % 2 + 1).with_target_step(200)).collect();
        let mut fixture =
            Fixture::open_on(scenario, adapter, gateway, axes, Cia402Config::default()).started();
        let positions = |fixture: &Fixture| [0, 7].map(|n| fixture.axis(n).actual().unwrap());
        let before = positions(&fixture);
        fixture.steps(400);
        let moved: Vec<_> =
            positions(&fixture).iter().zip(before).map(|(now, then)| now - then).collect();
        assert!(moved.iter().all(|steps| *steps > 70_000), "{budget:?}: {moved:?}");
        let losses = fixture.simulation.with_world(|world| world.counters(0).unwrap());
        assert_eq!(losses.transmit_losses.over_budget, 0, "{budget:?}");
    }
}
