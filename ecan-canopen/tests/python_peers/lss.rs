//! LSS in both directions, and what its peers have besides: guarding requests, TIME, SDO blocks.

use std::time::{Duration, Instant};

use ecan_canopen::{
    FastscanFilter, Lss, LssAddress, LssBitRate, LssCommand, LssConfig, LssResult, NmtState,
    NodeId, SdoFault, TimeConfig, TimeOfDay, TimeReference,
};
use ecan_protocol::object::AbortCode;
use ecan_sim::{BridgeSpec, DriveConfig, DriveSpec, GatewaySpec, Scenario};

use super::{CYCLE, Client, DriveAndBridge, aborted};
use crate::python_peer::{PATIENCE, Peer, python};

/// The package's LSS master in front of our drive without node-ID.
#[test]
fn python_lss_master_configures_the_simulated_drive() {
    let Some(python) = python() else { return };
    let mut config = DriveConfig { serial: 77, ..DriveConfig::new(NodeId::new(1).unwrap()) };
    config.quirks.without_node_id = true;
    config.quirks.missing = vec![0x1016, 0x1017];
    let peers = DriveAndBridge::new(DriveSpec { config, eds: None });
    let arguments = [("port", peers.port()), ("node", 42)];
    let mut peer = Peer::start(&python, "lss_master.py", &arguments);
    assert_eq!(peer.wait_line(), "ask time");
    let sent = TimeOfDay::new(15_668, 49_500_250).ok();
    let begun = Instant::now();
    let received =
        || peers.simulation.with_world(|world| world.drive("drive").unwrap().time_of_day());
    while received() != sent {
        assert!(begun.elapsed() < PATIENCE, "TIME does not arrive: {:?}", received());
        std::thread::sleep(CYCLE);
    }
    peer.answer();
    assert_eq!(peer.wait_line(), "passed");
    let active =
        peers.simulation.with_world(|world| world.drive("drive").unwrap().active_node_id());
    assert_eq!(active, NodeId::from_raw(42));
    assert_eq!(peers.bridge.statistics().dropped_to_clients, 0);
}

/// Our LSS master in front of a slave that logs each request after its response.
struct LssBench {
    client: Client,
    peer: Peer,
    /// Lines of the slave that the test has not read.
    log: Vec<String>,
    requests: u64,
}

impl LssBench {
    /// Cycles in which a request reaches the slave.
    const TRANSPORT: u32 = 5;

    /// Executes a command. Simulated time waits until the slave has processed each request.
    fn lss(&mut self, command: LssCommand) -> LssResult {
        let Self { client, peer, log, requests } = self;
        client.network.start_lss(0, 0, command).unwrap();
        let peer_sent = client.clock.peer_sent.clone();
        let mut waited = 0;
        client.until("the end of the LSS command", |network| {
            if network.statistics().lss_sent > *requests {
                waited += 1;
                if waited < Self::TRANSPORT {
                    return false;
                }
                waited = 0;
                *requests += 1;
                loop {
                    let line = peer.wait_line();
                    // The frames that the slave has sent follow a request.
                    let request = line.strip_prefix("lss ").and_then(|rest| rest.split_once(' '));
                    let Some((request, sent)) = request else {
                        log.push(line);
                        continue;
                    };
                    log.push(format!("lss {request}"));
                    peer_sent.set(sent.parse().unwrap());
                    break;
                }
            }
            network.lss_state(0, 0) != Lss::Busy && network.statistics().lss_sent == *requests
        });
        match client.network.lss_state(0, 0) {
            Lss::Done(result) => result,
            _ => panic!("{}", client.network.lss_failure(0, 0).unwrap()),
        }
    }

    fn take_log(&mut self) -> Vec<String> {
        std::mem::take(&mut self.log)
    }
}

/// Our LSS master and SDO client in front of a node of the package `durand`, which logs what it receives.
#[test]
fn our_lss_master_configures_a_node_of_the_durand_package() {
    let Some(python) = python() else { return };
    let scenario = Scenario { gateways: vec![GatewaySpec::at(0)], ..Scenario::default() };
    let mut client = Client::new(scenario, NodeId::new(9).unwrap());
    let bridge =
        ecan_sim::bridge::attach(&client.simulation, "0.0", &BridgeSpec::default()).unwrap();
    let port = u32::from(bridge.info.address().port());
    let arguments = [("port", port), ("serial", ADDRESS.serial)];
    let mut peer = Peer::start(&python, "responder_node.py", &arguments);
    assert_eq!(peer.wait_line(), "ready");
    // The package sends a boot-up message of node 255, which shows that its connection is open.
    client.until("the connection", |_| bridge.info.statistics().sent > 0);
    let config = LssConfig {
        timeout: Duration::from_millis(20_000),
        scan_time: Duration::from_millis(60),
        ..LssConfig::default()
    };
    client.network.set_lss_config(0, 0, config);
    client.clock.bridge = Some(bridge.info.clone());
    let mut bench = LssBench { client, peer, log: Vec::new(), requests: 0 };

    // Searches
    assert_eq!(bench.lss(LssCommand::Fastscan(FastscanFilter::default())), scanned());
    let frames = bench.take_log();
    assert_eq!(frames.len(), 133);
    assert_eq!(frames[0], "lss 5100000000800000");
    assert_eq!(frames[1], "lss 51000000001f0000");
    // The vendor-ID begins with 0100 0100; bit 30 was found missing, then bit 29 is tested.
    assert_eq!(frames[2], "lss 51000000001e0000");
    assert_eq!(frames[3], "lss 51000000401d0000");
    assert_eq!(frames[33], "lss 5141525544000001");
    assert_eq!(frames[132], "lss 510300ffff000300");
    // Configuration
    assert_eq!(bench.lss(LssCommand::InquireNodeId), LssResult::NodeId(None));
    assert_eq!(bench.lss(LssCommand::InquireAddress), scanned());
    let node = NodeId::from_raw(9);
    assert_eq!(bench.lss(LssCommand::ConfigureNodeId(node)), LssResult::Done);
    let bit_rate = LssCommand::ConfigureBitRate(LssBitRate::Rate500k);
    assert_eq!(bench.lss(bit_rate), LssResult::Done);
    assert_eq!(bench.lss(LssCommand::Store), LssResult::Done);
    let waiting = LssCommand::SwitchGlobal { configuration: false };
    assert_eq!(bench.lss(waiting), LssResult::Done);
    let expected = [
        "lss 5e00000000000000",
        "lss 5a00000000000000",
        "lss 5b00000000000000",
        "lss 5c00000000000000",
        "lss 5d00000000000000",
        "lss 1109000000000000",
        "lss 1300020000000000",
        "store 500000 9",
        "lss 1700000000000000",
        "lss 0400000000000000",
    ];
    assert_eq!(bench.take_log(), expected);
    let handle = bench.client.node;
    bench.client.until("the boot-up message", |network| {
        network.nmt_state(handle) == Some(NmtState::PreOperational)
    });
    // A slave with node-ID is selected by its address.
    assert_eq!(bench.lss(LssCommand::SwitchSelective(ADDRESS)), LssResult::Done);
    assert_eq!(bench.lss(LssCommand::InquireNodeId), LssResult::NodeId(node));
    assert_eq!(bench.lss(waiting), LssResult::Done);
    let expected = [
        "lss 4041525544000000",
        "lss 4105000000000000",
        "lss 4201000080000000",
        "lss 430300ffff000000",
        "lss 5e00000000000000",
        "lss 0400000000000000",
    ];
    assert_eq!(bench.take_log(), expected);

    let LssBench { mut client, mut peer, .. } = bench;
    // TIME
    let bus_ns = client.port.adapter().ecrt().clock().now_ns();
    let reference = TimeReference { unix_ns: 1_795_527_900_250_000_000, bus_ns };
    let time = TimeConfig { period: Duration::from_secs(3_600), reference };
    client.network.set_time(Some(time)).unwrap();
    client.until("TIME", |network| network.statistics().times_sent == 1);
    let line = peer.wait_line();
    assert!(line.starts_with("time ") && line.ends_with("343d"), "day 15668: {line}");

    // Block transfer in both directions; lengths around a segment and a block of 127
    let long: Vec<u8> = (0..1_000_u32).map(|byte| (byte * 7 + byte / 256) as u8).collect();
    for length in [64, 69, 70, 71, 888, 889, 890, 1_000] {
        let value = &long[..length];
        client.write(0x2000, 0, value).unwrap();
        assert_eq!(peer.wait_line(), "block download");
        assert_eq!(client.read(0x2000, 0).unwrap(), value, "{length} bytes");
        let by_block = client.read_block(0x2000, 0);
        if length % 7 == 0 {
            // The package reports seven unused bytes for a full last segment: less than it announced.
            assert_eq!(by_block, Err(SdoFault::Violated(AbortCode::LENGTH)), "{length} bytes");
        } else {
            assert_eq!(by_block.unwrap(), value, "{length} bytes");
        }
    }
    assert_eq!(client.read_block(0x2001, 0).unwrap(), (1..200).collect::<Vec<u8>>());
    assert_eq!(client.write(0x2001, 0, &long), aborted(0x0601_0002));
    while peer.try_finish().is_none() {
        std::thread::sleep(CYCLE);
    }
}

/// LSS address of the node in `responder_node.py`.
const ADDRESS: LssAddress =
    LssAddress { vendor: 0x4455_5241, product: 5, revision: 0x8000_0001, serial: 0xFFFF_0003 };

fn scanned() -> LssResult {
    LssResult::Address(ADDRESS)
}
