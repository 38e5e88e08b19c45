//! The network's part of the cycle allocates nothing, with 40 nodes in transfers.

use std::sync::Arc;
use std::time::Duration;

use ecan_canopen::{
    BootConfig, BootPhase, Configurator, FastscanFilter, GuardingConfig, HostHeartbeat,
    IdentityCheck, LssCommand, Network, NetworkConfig, NmtCommand, NodeAction, NodeAddress,
    NodeConfig, NodeId, Parameter, ParameterSet, SdoConfig, Step, SyncConfig, TimeConfig,
    TimeReference, object, run_cycle_until,
};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_sim::{ClockKind, SimOptions};
use ecan_test_support::allocations;

#[test]
fn forty_nodes_in_transfers_allocate_nothing() {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(ecan_sim::echo(3), &options).unwrap();
    let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    let adapter = AdapterConfig::new(3).with_cycle(Duration::from_millis(2));
    let mut port = Port::open(&backend.ecrt, (adapter, PortConfig::uniform(3, gateway))).unwrap();
    port.wait_ready().unwrap();

    let host = HostHeartbeat { node: NodeId::MAX, period: Duration::from_millis(20) };
    let config = NetworkConfig { host_heartbeat: Some(host), ..NetworkConfig::default() };
    let mut network = Network::new(config);
    // Short timeouts, so that failing, aborting and starting over are part of it.
    let sdo = SdoConfig { timeout: Duration::from_millis(20), ..SdoConfig::default() };
    let heartbeat_timeout = Duration::from_millis(100);
    let watched = NodeConfig { heartbeat_timeout, sdo, ..NodeConfig::default() };
    let guarding = GuardingConfig { guard_time: Duration::from_millis(50), life_time_factor: 2 };
    let guarded = NodeConfig { guarding: Some(guarding), sdo, ..NodeConfig::default() };
    let nodes: Vec<_> = (0..40u8)
        .map(|nth| {
            let (slave, channel) = (usize::from(nth % 3), nth / 3 % 4);
            let node = NodeId::new(1 + nth).unwrap();
            let settings = if nth % 2 == 0 { watched } else { guarded };
            network.add_node(NodeAddress { slave, channel, node }, settings).unwrap()
        })
        .collect();
    network.set_sync(Some(SyncConfig::default())).unwrap();
    let reference = TimeReference::from_system_clock(port.adapter().clock().now_ns());
    let time = TimeConfig { period: Duration::from_millis(10), reference };
    network.set_time(Some(time)).unwrap();
    let mut configurator = Configurator::new();
    for node in &nodes {
        let read = Step::read(0x1000, 0).if_accepted();
        let start = Step::device(NodeAction::Nmt(NmtCommand::Start));
        configurator.add(&network, *node, [Step::pause(Duration::from_millis(500)), read, start]);
    }

    let (mut inside, mut others, mut failures) = (0, 0, 0);
    let mut next = port.adapter().clock().now_ns();
    for number in 0..1_000u32 {
        let now = port.adapter().clock().now_ns();
        let before = allocations();
        let mut cycle = port.begin_cycle();
        network.receive(&mut cycle, now, |_| others += 1);
        configurator.step(&mut network, now);
        failures += configurator.progress(now).filter(|node| node.failure.is_some()).count();
        let _ = network.start_lss(0, 0, LssCommand::Fastscan(FastscanFilter::default()));
        for node in &nodes {
            if number % 100 == 0 {
                let _ = network.start_download(*node, 0x1F50, 1, &[7; 200]);
                let _ = network.nmt(*node, NmtCommand::Start);
            }
        }
        network.send_sync(&mut cycle);
        network.send(&mut cycle, now);
        assert_eq!(cycle.finish().error(), None);
        // The simulated world grows its queues to their working size first.
        if number >= 200 {
            inside += allocations() - before;
        }
        next += 2_000_000;
        port.adapter().clock().sleep_until_ns(next);
    }
    let statistics = network.statistics();
    assert!(statistics.sdo_sent > 1_000 && statistics.syncs_sent > 11_000, "{statistics:?}");
    assert!(statistics.heartbeats_sent > 1_000 && statistics.nmt_sent >= 400, "{statistics:?}");
    assert!(statistics.times_sent > 1_000 && statistics.guards_sent > 500, "{statistics:?}");
    assert!(statistics.lss_sent > 10, "{statistics:?}");
    assert!(others > 10_000, "echoes: {others}");
    assert!(failures > 0, "no answers, so the configurations fail in the end");
    assert_eq!(inside, 0);
}

/// One node has a wrong serial number, one is absent, one rejects a value.
#[test]
fn boot_up_allocates_nothing() {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(ecan_sim::drives(1, 4), &options).unwrap();
    let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    let mut port = Port::open(&backend.ecrt, (adapter, PortConfig::uniform(1, gateway))).unwrap();
    port.wait_ready().unwrap();
    let mut network = Network::new(NetworkConfig::default());
    let value =
        |index| Parameter { name: "a value".into(), ..Parameter::new((index, 0), [1, 2, 0, 0]) };
    let good = vec![value(object::PROFILE_VELOCITY), value(object::PROFILE_ACCELERATION)];
    let bad = vec![value(object::DEVICE_NAME)];
    for node in 1..=5 {
        let node = NodeId::new(node).unwrap();
        let address = NodeAddress { slave: 0, channel: 0, node };
        let handle = network.add_node(address, NodeConfig::default()).unwrap();
        let downloads = if node.get() == 2 { bad.clone() } else { good.clone() };
        let serial_number = (node.get() == 3).then_some(0);
        let config = BootConfig {
            identity: IdentityCheck { serial_number, ..IdentityCheck::default() },
            parameters: Arc::new(ParameterSet { parameters: downloads, ..ParameterSet::default() }),
            ..BootConfig::default()
        };
        network.boot(handle, config);
    }
    let mut inside = 0;
    run_cycle_until(&mut port, Duration::from_secs(60), |cycle, now| {
        let before = allocations();
        network.serve(cycle, now, |network| {
            let ended = network
                .boot_progress(now)
                .filter(|node| matches!(node.phase, BootPhase::Booted | BootPhase::Failed))
                .count();
            inside += allocations() - before;
            (ended == 5).then_some(())
        })
    })
    .unwrap();
    let phases: Vec<_> = network.boot_progress(0).map(|node| node.phase).collect();
    let (booted, failed) = (BootPhase::Booted, BootPhase::Failed);
    assert_eq!(phases, [booted, failed, failed, booted, failed]);
    assert_eq!(inside, 0);
}
