//! Guarding, LSS and TIME of the network on a recording sink.

use std::time::Duration;

use crate::{NmtCommand, NmtState, NodeId};

use super::network_tests::{MS, RecordingSink, address, cycle, received};
use super::{
    GuardingConfig, Heartbeat, HostHeartbeat, Lss, LssCommand, LssFault, LssResult, Network,
    NetworkConfig, NetworkError, NodeConfig, SyncConfig, TimeConfig, TimeReference,
};

const GUARDING: GuardingConfig =
    GuardingConfig { guard_time: Duration::from_millis(10), life_time_factor: 2 };

#[test]
fn guarding_requests_share_the_service_frames_of_a_cycle() {
    let mut network = Network::new(NetworkConfig::default());
    let settings = NodeConfig { guarding: Some(GUARDING), ..NodeConfig::default() };
    let nodes = [1, 2, 3].map(|id| network.add_node(address(0, 1, id), settings).unwrap());
    let mut sink = RecordingSink::new();
    for ms in 0..3 {
        cycle(&mut network, &mut sink, ms * MS);
    }
    let expected = [(1, 0x701, 1), (1, 0x702, 1), (1, 0x703, 1)];
    assert_eq!(sink.remote, expected, "two in the first cycle, one in the second");
    assert_eq!(sink.sent, []);
    network.take(&received(0, 1, 0x701, &[0x05]), 3 * MS);
    network.take(&received(0, 1, 0x702, &[0x85]), 3 * MS);
    assert_eq!(network.heartbeat(nodes[0]), Heartbeat::Active);
    assert_eq!(network.nmt_state(nodes[1]), Some(NmtState::Operational));
    for ms in 4..=24 {
        cycle(&mut network, &mut sink, ms * MS);
    }
    let lost = nodes.map(|node| network.heartbeat(node));
    assert_eq!(lost, [Heartbeat::TimedOut; 3], "3 never responded, 1 and 2 once");
    network.take(&received(0, 1, 0x701, &[0x05]), 25 * MS);
    network.take(&received(0, 1, 0x701, &[0x05]), 26 * MS);
    assert_eq!(network.status(nodes[0]).unwrap().guard_errors.toggle, 1);
    assert_eq!(network.heartbeat(nodes[0]), Heartbeat::Active);
}

#[test]
fn guarding_with_heartbeat_or_wrong_times_is_rejected() {
    let mut network = Network::new(NetworkConfig::default());
    let settings = NodeConfig { guarding: Some(GUARDING), ..NodeConfig::default() };
    let both = NodeConfig { heartbeat_timeout: Duration::from_millis(100), ..settings };
    let at = address(0, 0, 1);
    let error = NetworkError::HeartbeatAndGuarding { address: at };
    assert_eq!(network.add_node(at, both), Err(error));
    let guarding = GuardingConfig { life_time_factor: 0, ..GUARDING };
    let error =
        network.add_node(at, NodeConfig { guarding: Some(guarding), ..settings }).unwrap_err();
    assert_eq!(
        error.to_string(),
        "node 1 (slave 0, channel 0): guard time 10000 us with life time factor 0 is out of range; allowed: 1 ms to \
         65535 ms in whole milliseconds, factor 1 to 255"
    );
    let node = network.add_node(at, settings).unwrap();
    assert_eq!(network.set_guarding(node, Some(guarding)), Err(error));
    assert_eq!(network.heartbeat(node), Heartbeat::Unknown);
    network.set_guarding(node, None).unwrap();
    assert_eq!(network.heartbeat(node), Heartbeat::Unconfigured);
    network.set_heartbeat_timeout(node, Duration::from_millis(100));
    network.take(&received(0, 0, 0x701, &[0x05]), 0);
    assert_eq!(network.heartbeat(node), Heartbeat::Active);
}

#[test]
fn channel_without_nodes_gets_lss_and_nmt_only() {
    let host = HostHeartbeat { node: NodeId::new(127).unwrap(), period: Duration::from_millis(5) };
    let config = NetworkConfig { host_heartbeat: Some(host), ..NetworkConfig::default() };
    let mut network = Network::new(config);
    network.set_sync(Some(SyncConfig::default())).unwrap();
    network.add_channel(0, 2).unwrap();
    let error = NetworkError::NoChannel { slave: 0, channel: 4 };
    assert_eq!(network.add_channel(0, 4), Err(error));
    let reference = TimeReference { unix_ns: 1_795_527_900_000_000_000, bus_ns: 0 };
    let time = TimeConfig { period: Duration::from_millis(50), reference };
    network.set_time(Some(time)).unwrap();
    network.start_lss(0, 2, LssCommand::Store).unwrap();
    network.nmt_all(NmtCommand::Start).unwrap();
    let mut sink = RecordingSink::new();
    cycle(&mut network, &mut sink, 0);
    let store = vec![0x17, 0, 0, 0, 0, 0, 0, 0];
    assert_eq!(sink.sent, [(0, 2, 0, vec![1, 0]), (0, 2, 0x7E5, store)]);
    network.take(&received(0, 2, 0x7E4, &[0x17, 0, 0, 0, 0, 0, 0, 0]), MS);
    assert_eq!(network.lss_state(0, 2), Lss::Done(LssResult::Done));
    // The first node adds the others.
    network.add_node(address(0, 2, 1), NodeConfig::default()).unwrap();
    sink.sent.clear();
    network.tick(2 * MS);
    cycle(&mut network, &mut sink, 2 * MS);
    assert_eq!(sink.ids(), [0x080, 0x77F, 0x100]);
    sink.ready[0] = false;
    network.start_lss(0, 2, LssCommand::Store).unwrap();
    cycle(&mut network, &mut sink, 3 * MS);
    assert_eq!(network.lss_failure(0, 2).unwrap().fault, LssFault::GatewayLost);
}
