//! The network over a simulated gateway, in stepped time. Echo nodes send back what reaches the
//! bus, in the order in which it got there; a replay node plays a CANopen node.

use std::path::PathBuf;
use std::time::Duration;

use ecan_canopen::{
    Configurator, Heartbeat, HostHeartbeat, Network, NetworkConfig, NmtCommand, NmtState,
    NodeAction, NodeAddress, NodeConfig, NodeHandle, NodeId, Sdo, SdoConfig, SdoFault, Step,
    SyncConfig, WaitError, run_cycle_until,
};
use ecan_host::{AdapterConfig, DcSync};
use ecan_mcan_port::{
    ChannelConfig, Cycle, GatewayConfig, Port, PortConfig, ReceivedFrame, SendError,
};
use ecan_protocol::can::CanId;
use ecan_protocol::can::FrameRef;
use ecan_protocol::image::{BudgetPolicy, Schedule};
use ecan_sim::{ClockKind, Fault, LossDirection, NodeKind, Scenario, SimOptions, Simulation};

const READY: Duration = Duration::from_secs(20);

fn open(scenario: Scenario, adapter: AdapterConfig, slaves: usize) -> (Port, Simulation) {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
    let mut gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
    // One channel can fill an image.
    gateway.rx_budget = BudgetPolicy::SharedOnly;
    let config = PortConfig::uniform(slaves, gateway);
    let mut port = Port::open(&backend.ecrt, (adapter, config)).unwrap_or_else(|e| panic!("{e}"));
    port.wait_ready().unwrap_or_else(|e| panic!("{e}"));
    (port, backend.simulation.unwrap())
}

fn address(slave: usize, channel: u8, node: u8) -> NodeAddress {
    NodeAddress { slave, channel, node: NodeId::new(node).unwrap() }
}

fn id(raw: u16) -> CanId {
    CanId::standard(raw).unwrap()
}

/// So many cycles; the application sends its targets before SYNC and service frames. Gives the
/// frames that were not the network's.
fn cycles(
    port: &mut Port,
    network: &mut Network,
    count: usize,
    mut targets: impl FnMut(&mut Cycle<'_>),
) -> Vec<ReceivedFrame> {
    let mut frames = Vec::new();
    let mut left = count;
    run_cycle_until(port, READY, |cycle, now_ns| {
        network.receive(cycle, now_ns, |item| frames.extend(item.frame().copied()));
        targets(cycle);
        network.send_sync(cycle);
        network.send(cycle, now_ns);
        left -= 1;
        (left == 0).then_some(())
    })
    .unwrap_or_else(|error| panic!("{error}"));
    frames
}

fn ids(frames: &[ReceivedFrame], channel: u8) -> Vec<u32> {
    frames.iter().filter(|f| f.channel == channel).map(|f| f.frame.id().raw()).collect()
}

#[test]
fn targets_then_sync_then_service_frames_reach_the_bus() {
    let (mut port, _) =
        open(ecan_sim::echo(1), AdapterConfig::new(1).with_cycle(Duration::from_millis(2)), 1);
    let host = HostHeartbeat { node: NodeId::new(127).unwrap(), period: Duration::from_millis(10) };
    let config = NetworkConfig { host_heartbeat: Some(host), ..NetworkConfig::default() };
    let mut network = Network::new(config);
    let add = |network: &mut Network, channel, node| {
        network.add_node(address(0, channel, node), NodeConfig::default()).unwrap()
    };
    let nodes: Vec<NodeHandle> = (1..=3).map(|node| add(&mut network, 0, node)).collect();
    add(&mut network, 2, 9);
    network.set_sync(Some(SyncConfig { every_cycles: 5, ..SyncConfig::default() })).unwrap();
    network.nmt_all(NmtCommand::EnterPreOperational).unwrap();
    for node in nodes {
        network.start_upload(node, 0x1000, 0).unwrap();
    }
    let can0 = port.channel(0, 0).unwrap();
    let mut number = 0;
    let back = cycles(&mut port, &mut network, 9, |cycle| {
        number += 1;
        // Not in the last cycles, so that all echoes are back.
        if number <= 5 {
            for node in 1..=3 {
                cycle
                    .send(can0, FrameRef::classic(id(0x200 + node), &[number, 0]).unwrap())
                    .unwrap();
            }
        }
    });
    let targets = [0x201, 0x202, 0x203];
    let mut expected = Vec::new();
    expected.extend(targets);
    expected.extend([0x080, 0x000, 0x77F, 0x601]);
    expected.extend(targets);
    expected.extend([0x602, 0x603]);
    expected.extend(targets);
    expected.extend(targets);
    expected.extend(targets);
    // Sixth cycle: the second SYNC, and the heartbeat after 10 ms.
    expected.extend([0x080, 0x77F]);
    assert_eq!(ids(&back, 0), expected, "{:X?}", ids(&back, 0));
    assert_eq!(ids(&back, 2), [0x080, 0x000, 0x77F, 0x080, 0x77F]);
    assert_eq!(ids(&back, 1), [] as [u32; 0], "no node, no frame");
    let statistics = network.statistics();
    assert_eq!((statistics.sdo_sent, statistics.nmt_sent), (3, 2));
    assert_eq!((statistics.syncs_sent, statistics.heartbeats_sent), (4, 4));
    assert_eq!(statistics.waited, 0);
}

#[test]
fn scheduled_sync_meets_its_phase_or_is_rejected() {
    let schedule = Some(Schedule { tag: 1, offset_ns: 300_000 });
    let settings = SyncConfig { schedule, ..SyncConfig::default() };
    let with_sync = |port: &mut Port| {
        let mut network = Network::new(NetworkConfig::default());
        network.add_node(address(0, 0, 1), NodeConfig::default()).unwrap();
        network.set_sync(Some(settings)).unwrap();
        let back = cycles(port, &mut network, 20, |_| {});
        (network, back)
    };
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(2));
    let mut dc = adapter;
    dc.dc = Some(DcSync::new(Duration::from_millis(2), Duration::from_micros(500)));
    let (mut port, _) = open(ecan_sim::echo(1), dc, 1);
    let (network, back) = with_sync(&mut port);
    assert_eq!(network.statistics().syncs_sent, 20);
    assert!(ids(&back, 0).len() >= 16, "{} came back", back.len());
    let (mut port, _) = open(ecan_sim::echo(1), adapter, 1);
    let (network, back) = with_sync(&mut port);
    assert_eq!(back.len(), 0);
    let rejection = network.statistics().last_rejection;
    assert!(matches!(rejection, Some(SendError::NotSchedulable { slave: 0, .. })), "{rejection:?}");
}

#[test]
fn unconfirmed_image_does_not_accumulate_syncs() {
    let (mut port, simulation) =
        open(ecan_sim::echo(1), AdapterConfig::new(1).with_cycle(Duration::from_millis(2)), 1);
    let mut network = Network::new(NetworkConfig::default());
    network.add_node(address(0, 0, 1), NodeConfig::default()).unwrap();
    let settings = SyncConfig { counter_overflow: Some(240), ..SyncConfig::default() };
    network.set_sync(Some(settings)).unwrap();
    let can0 = port.channel(0, 0).unwrap();
    let mut held = 0;
    // A target goes out only when it does so at once, as the axes have it.
    let mut target = |cycle: &mut Cycle<'_>| {
        if cycle.cycle_report(can0.gateway()).is_unconfirmed {
            held += 1;
        } else {
            cycle.send(can0, FrameRef::classic(id(0x201), &[]).unwrap()).unwrap();
        }
    };
    let mut back = cycles(&mut port, &mut network, 10, &mut target);
    simulation.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 6 });
    back.extend(cycles(&mut port, &mut network, 20, &mut target));
    assert_eq!(held, 6);
    network.set_sync(None).unwrap();
    back.extend(cycles(&mut port, &mut network, 5, |_| {}));
    let on_bus = ids(&back, 0);
    assert_eq!(on_bus.len(), 2 * 24, "{on_bus:X?}");
    assert!(on_bus.chunks(2).all(|pair| pair == [0x201, 0x080]), "{on_bus:X?}");
    let syncs = back.iter().filter(|frame| frame.frame.id() == id(0x080));
    let counters: Vec<u8> = syncs.map(|frame| frame.frame.data()[0]).collect();
    assert_eq!(counters, (1..=24).collect::<Vec<u8>>(), "no number is left out");
    let statistics = network.statistics();
    assert_eq!((statistics.syncs_sent, statistics.syncs_late), (24, 6));
}

#[test]
fn full_image_loses_and_doubles_no_frame() {
    // N = 1: 104 bytes for packets, eight frames of 12 bytes.
    let adapter = AdapterConfig::new(1).with_multiplier(1).with_cycle(Duration::from_millis(4));
    let (mut port, _) = open(ecan_sim::echo(1), adapter, 1);
    let mut network = Network::new(NetworkConfig::default());
    let node = network.add_node(address(0, 0, 1), NodeConfig::default()).unwrap();
    network.start_upload(node, 0x1000, 0).unwrap();
    network.nmt_all(NmtCommand::Start).unwrap();
    let mut taken = Vec::new();
    let can0 = port.channel(0, 0).unwrap();
    let back = cycles(&mut port, &mut network, 20, |cycle| {
        if taken.len() < 5 {
            let data = [taken.len() as u8; 8];
            taken.push(0);
            while cycle.send(can0, FrameRef::classic(id(0x201), &data).unwrap()).is_ok() {
                *taken.last_mut().unwrap() += 1;
            }
        }
    });
    // The NMT command fits behind the targets of the first image, the SDO request into none that
    // targets have filled.
    let targets = taken.iter().sum();
    assert!(taken[0] == 8 && targets > 3 * 8, "{taken:?}");
    let mut expected = vec![0x201; targets];
    expected.insert(8, 0x000);
    expected.push(0x601);
    assert_eq!(ids(&back, 0), expected);
    assert!(network.statistics().waited >= 5);
}

#[test]
fn power_cycle_of_a_gateway_ends_transfers_and_recovers() {
    let (mut port, simulation) =
        open(ecan_sim::echo(2), AdapterConfig::new(2).with_cycle(Duration::from_millis(1)), 2);
    let mut network = Network::new(NetworkConfig::default());
    let sdo = SdoConfig { timeout: Duration::from_millis(60_000), ..SdoConfig::default() };
    let settings = NodeConfig { sdo, ..NodeConfig::default() };
    let nodes = [0, 1].map(|slave| network.add_node(address(slave, 0, 1), settings).unwrap());
    for node in nodes {
        network.start_upload(node, 0x1000, 0).unwrap();
    }
    cycles(&mut port, &mut network, 10, |_| {});
    simulation.inject(Fault::PowerCycle { gateway: 1, off_ms: 50 });
    cycles(&mut port, &mut network, 100, |_| {});
    assert_eq!(network.sdo_state(nodes[0]), Sdo::Busy);
    let failure = network.sdo_failure(nodes[1]).unwrap();
    assert_eq!(failure.fault, SdoFault::GatewayLost);
    assert_eq!(
        failure.to_string(),
        "SDO upload 0x1000:00 from node 1 (slave 1, channel 0): the gateway was lost"
    );
    network.start_upload(nodes[1], 0x1001, 0).unwrap();
    let sent = network.statistics().sdo_sent;
    let mut echoed = None;
    run_cycle_until(&mut port, READY, |cycle, now_ns| {
        network.receive(cycle, now_ns, |item| {
            if let Some(frame) = item.frame().filter(|frame| frame.slave == 1) {
                echoed = Some(*frame);
            }
        });
        network.send(cycle, now_ns);
        echoed
    })
    .unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(network.statistics().sdo_sent, sent + 1, "what waited went out once");
    assert_eq!(echoed.unwrap().frame.data()[..4], [0x40, 0x01, 0x10, 0x00]);
}

#[test]
fn inactive_bus_is_reported_at_once() {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
    let gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(1_000_000));
    let config = PortConfig::uniform(1, gateway);
    let mut port = Port::open(&backend.ecrt, (AdapterConfig::new(1), config)).unwrap();
    let mut network = Network::new(NetworkConfig::default());
    let node = network.add_node(address(0, 0, 1), NodeConfig::default()).unwrap();
    let error =
        network.blocking(&mut port, Duration::from_secs(60)).upload(node, (0x1000, 0)).unwrap_err();
    assert!(matches!(error, WaitError::Cycle(_)), "{error}");
    assert_eq!(network.sdo_failure(node).unwrap().fault, SdoFault::Cancelled);
}

#[test]
fn lost_ethernet_frames_do_not_end_a_blocking_call() {
    let (mut port, simulation) = open(
        replay("lost_frames", &scripted_node()),
        AdapterConfig::new(1).with_cycle(Duration::from_millis(1)),
        1,
    );
    let mut network = Network::new(NetworkConfig::default());
    let node = network.add_node(address(0, 0, 5), NodeConfig::default()).unwrap();
    network
        .blocking(&mut port, Duration::from_secs(10))
        .wait_nmt_state(NmtState::PreOperational)
        .unwrap();
    simulation.inject(Fault::LostFrame { direction: LossDirection::Outward, cycles: 5 });
    let value =
        network.blocking(&mut port, Duration::from_secs(1)).upload(node, (0x1000, 0)).unwrap();
    assert_eq!(value, [0x92, 0x01, 0x02, 0x00]);
}

/// A scenario whose first channel has a node that plays `log`.
fn replay(name: &str, log: &str) -> Scenario {
    let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.log"));
    std::fs::write(&file, log).unwrap();
    let mut scenario = ecan_sim::echo(1);
    scenario.nodes.truncate(1);
    scenario.nodes[0].kind = NodeKind::Replay { file, options: Default::default() };
    scenario
}

/// A log in candump's format: every `period_ms` from `from_ms` to `to_ms`.
fn every(log: &mut Vec<(u64, String)>, (from_ms, to_ms): (u64, u64), period_ms: u64, frame: &str) {
    let mut at = from_ms;
    while at < to_ms {
        log.push((at, frame.to_owned()));
        at += period_ms;
    }
}

fn candump(mut log: Vec<(u64, String)>) -> String {
    log.sort_by_key(|(at, _)| *at);
    let line = |(ms, frame): &(u64, String)| {
        format!("({}.{:06}) can0 {frame}\n", ms / 1_000, ms % 1_000 * 1_000)
    };
    log.iter().map(line).collect()
}

/// A node that boots 5 s after it is on the bus, sends heartbeats up to 8 s, an emergency at 6 s,
/// and answers SDO requests for 0x1000:00 and 0x1018:01 at fixed times.
fn scripted_node() -> String {
    let mut log = vec![
        (0, "123#00".to_owned()),
        (5_000, "705#00".to_owned()),
        (6_000, "085#1186210102030405".to_owned()),
        (6_500, "185#37060A000000".to_owned()),
    ];
    every(&mut log, (5_100, 8_000), 100, "705#05");
    every(&mut log, (5_000, 60_000), 20, "585#4300100092010200");
    every(&mut log, (5_010, 60_000), 20, "585#8018100100000206");
    candump(log)
}

#[test]
fn node_boots_is_watched_read_and_lost() {
    let (mut port, _) = open(
        replay("scripted_node", &scripted_node()),
        AdapterConfig::new(1).with_cycle(Duration::from_millis(1)),
        1,
    );
    let mut network = Network::new(NetworkConfig::default());
    let settings =
        NodeConfig { heartbeat_timeout: Duration::from_millis(250), ..NodeConfig::default() };
    let node = network.add_node(address(0, 0, 5), settings).unwrap();
    assert_eq!(network.heartbeat(node), Heartbeat::Unknown);
    network
        .blocking(&mut port, Duration::from_secs(10))
        .wait_nmt_state(NmtState::Operational)
        .unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(network.status(node).unwrap().boot_ups, 1);
    assert_eq!(network.heartbeat(node), Heartbeat::Active);

    let value =
        network.blocking(&mut port, Duration::from_secs(1)).upload(node, (0x1000, 0)).unwrap();
    assert_eq!(value, [0x92, 0x01, 0x02, 0x00]);
    let error =
        network.blocking(&mut port, Duration::from_secs(1)).upload(node, (0x1018, 1)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "SDO upload 0x1018:01 from node 5 (slave 0, channel 0): aborted by the node: 0x06020000 \
         object does not exist"
    );

    // TPDOs are not the network's.
    let mut tpdos = Vec::new();
    run_cycle_until(&mut port, Duration::from_secs(5), |cycle, now_ns| {
        network.receive(cycle, now_ns, |item| tpdos.extend(item.frame().copied()));
        network.send(cycle, now_ns);
        (!tpdos.is_empty()).then_some(())
    })
    .unwrap();
    assert_eq!(tpdos[0].frame.id(), id(0x185));
    let emcy = network.emcy(node).unwrap();
    assert_eq!(emcy.count(), 1);
    assert_eq!(emcy.last().unwrap().emcy.code, 0x8611);

    // No answer for this one in the node's script.
    let error = network
        .blocking(&mut port, Duration::from_millis(100))
        .upload(node, (0x2000, 0))
        .unwrap_err();
    assert!(
        matches!(error, WaitError::TimedOut { waited } if waited <= Duration::from_millis(102)),
        "{error}"
    );
    assert_eq!(network.sdo_failure(node).unwrap().fault, SdoFault::Cancelled);
    run_cycle_until(&mut port, Duration::from_secs(5), |cycle, now_ns| {
        network.serve(cycle, now_ns, |network| {
            (network.heartbeat(node) == Heartbeat::TimedOut).then_some(())
        })
    })
    .unwrap();
    assert_eq!(network.status(node).unwrap().heartbeat_timeouts, 1);
}

#[test]
fn configuration_reports_progress_and_result() {
    let (mut port, _) = open(
        replay("configured_node", &scripted_node()),
        AdapterConfig::new(1).with_cycle(Duration::from_millis(1)),
        1,
    );
    let mut network = Network::new(NetworkConfig::default());
    let node = network.add_node(address(0, 0, 5), NodeConfig::default()).unwrap();
    let mut configurator = Configurator::new();
    configurator.add(
        &network,
        node,
        [
            Step::device(NodeAction::AwaitBootUp { timeout: Duration::from_secs(10) }),
            Step::read(0x1000, 0).named("device type"),
            Step::read(0x1018, 1).if_present(),
            Step::expect(0x1000, 0, 0x0002_0192u32),
        ],
    );
    let mut text = Vec::new();
    network
        .blocking(&mut port, Duration::from_secs(20))
        .configure(&mut configurator, |progress| {
            let step = progress.step.map_or("done".to_owned(), |step| step.to_string());
            if text.last() != Some(&step) {
                text.push(step);
            }
        })
        .unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(
        text,
        [
            "wait for the boot-up message",
            "device type (read 0x1000:00)",
            "read 0x1018:01",
            "check 0x1000:00",
            "done",
        ]
    );
    assert_eq!(configurator.uploaded(node, 0x1000, 0), Some(0x0002_0192));
    configurator.clear(&mut network);
    configurator.add(&network, node, [Step::expect(0x1000, 0, 1u32)]);
    let error = network
        .blocking(&mut port, Duration::from_secs(5))
        .configure(&mut configurator, |_| {})
        .unwrap_err();
    assert_eq!(
        error.to_string(),
        "node 5 (slave 0, channel 0), step 1 of 1, check 0x1000:00: value is 0x20192, expected 0x1"
    );
}
