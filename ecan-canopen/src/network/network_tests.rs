//! The network on a recording sink: every frame that it hands over, with rejections at will.

use std::time::Duration;

use ecan_mcan_port::{
    AddressError, Backpressure, ReceiveSource, ReceivedFrame, SendError, SendOptions, SendTicket,
};
use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameRef};
use ecan_protocol::image::{Schedule, Timestamp};

use super::service_sender::FrameSink;
use super::{
    GuardingConfig, Heartbeat, HostHeartbeat, Lss, LssCommand, LssFault, LssResult, Network,
    NetworkConfig, NetworkError, NmtError, NodeAddress, NodeConfig, NodeHandle, Sdo, SdoConfig,
    SdoFault, SyncConfig, TimeConfig, TimeReference,
};
use crate::{EmcyClass, NmtCommand, NmtState, NodeId};

pub(super) const MS: u64 = 1_000_000;

/// What was handed over: slave, channel, identifier, data.
pub(super) type Sent = (usize, u8, u32, Vec<u8>);

pub(super) struct RecordingSink {
    pub(super) sent: Vec<Sent>,
    pub(super) schedules: Vec<Option<Schedule>>,
    /// Remote frames: channel, identifier, requested length.
    pub(super) remote: Vec<(u8, u32, usize)>,
    /// Frames rejected before one is taken again.
    rejections: usize,
    /// Frames that still fit.
    pub(super) room_frames: usize,
    pub(super) pending: u8,
    pub(super) room: usize,
    pub(super) ready: [bool; 3],
    /// Slaves whose last image is repeated.
    holding: [bool; 3],
    /// The rejection in place of "no room".
    pub(super) error: Option<SendError>,
}

impl RecordingSink {
    pub(super) fn new() -> Self {
        Self {
            sent: Vec::new(),
            schedules: Vec::new(),
            remote: Vec::new(),
            rejections: 0,
            room_frames: usize::MAX,
            pending: 0,
            room: 1000,
            ready: [true; 3],
            holding: [false; 3],
            error: None,
        }
    }

    pub(super) fn ids(&mut self) -> Vec<u32> {
        self.sent.drain(..).map(|(_, _, id, _)| id).collect()
    }
}

impl FrameSink for RecordingSink {
    fn send(
        &mut self,
        slave: usize,
        channel: u8,
        frame: FrameRef<'_>,
        options: SendOptions,
    ) -> Result<SendTicket, SendError> {
        if !self.ready[slave] {
            return Err(SendError::NotReady { slave });
        }
        if let Some(error) = self.error {
            return Err(error);
        }
        if self.rejections > 0 {
            self.rejections -= 1;
            return Err(SendError::Backpressure { slave, channel, what: Backpressure::Queue });
        }
        if self.room_frames == 0 {
            return Err(SendError::Backpressure { slave, channel, what: Backpressure::Image });
        }
        self.room_frames -= 1;
        if frame.is_remote() {
            self.remote.push((channel, frame.id().raw(), frame.len()));
            return Ok(SendTicket { slave, sequence: 0, index: 0 });
        }
        self.sent.push((slave, channel, frame.id().raw(), frame.data().to_vec()));
        self.schedules.push(options.schedule);
        Ok(SendTicket { slave, sequence: 0, index: 0 })
    }

    fn pending(&self, _slave: usize, _channel: u8) -> u8 {
        self.pending
    }

    fn room(&self, _slave: usize, _channel: u8) -> usize {
        self.room
    }

    fn is_ready(&self, slave: usize) -> bool {
        self.ready[slave]
    }

    fn is_unconfirmed(&self, slave: usize) -> bool {
        self.holding[slave]
    }
}

pub(super) fn address(slave: usize, channel: u8, node: u8) -> NodeAddress {
    NodeAddress { slave, channel, node: NodeId::new(node).unwrap() }
}

pub(super) fn received(slave: usize, channel: u8, id: u16, data: &[u8]) -> ReceivedFrame {
    let id = CanId::standard(id).unwrap();
    with_frame(slave, channel, CanFrame::classic(id, data).unwrap())
}

fn with_frame(slave: usize, channel: u8, frame: CanFrame) -> ReceivedFrame {
    let (timestamp, source) = (Timestamp::None, ReceiveSource::default());
    ReceivedFrame { slave, channel, frame, timestamp, source }
}

/// One cycle at `now_ns`: gateways, time, SYNC, sending.
pub(super) fn cycle(network: &mut Network, sink: &mut RecordingSink, now_ns: u64) {
    network.watch_gateways(sink);
    network.tick(now_ns);
    network.send_sync_to(sink, |_, _| true);
    network.send_to(sink, now_ns);
}

fn network(config: NetworkConfig, nodes: &[NodeAddress]) -> (Network, Vec<NodeHandle>) {
    let mut network = Network::new(config);
    let settings =
        NodeConfig { heartbeat_timeout: Duration::from_millis(100), ..NodeConfig::default() };
    let handles = nodes.iter().map(|node| network.add_node(*node, settings).unwrap()).collect();
    (network, handles)
}

#[test]
fn nodes_are_checked_as_they_are_added() {
    let host = HostHeartbeat { node: NodeId::new(127).unwrap(), period: Duration::from_millis(50) };
    let config = NetworkConfig { host_heartbeat: Some(host), ..NetworkConfig::default() };
    let (mut network, handles) = network(config, &[address(0, 1, 5), address(1, 1, 5)]);
    let mut add = |address| network.add_node(address, NodeConfig::default());
    let again = address(0, 1, 5);
    assert_eq!(add(again), Err(NetworkError::Duplicate { address: again }));
    let beyond = address(0, 4, 5);
    assert_eq!(add(beyond), Err(NetworkError::Channel { address: beyond }));
    let own = address(0, 0, 127);
    assert_eq!(add(own), Err(NetworkError::HostNode { address: own }));
    assert_eq!(network.find(address(1, 1, 5)), Some(handles[1]));
    assert_eq!(network.find(address(1, 1, 6)), None);
    assert_eq!(network.find(address(7, 1, 5)), None);
    assert_eq!(handles[1].index(), 1);
}

#[test]
fn nmt_then_heartbeat_then_sdo_and_sync_before_all() {
    let host = HostHeartbeat { node: NodeId::new(100).unwrap(), period: Duration::from_millis(50) };
    let config = NetworkConfig { host_heartbeat: Some(host), ..NetworkConfig::default() };
    let (mut network, nodes) = network(config, &[address(0, 0, 1), address(0, 0, 2)]);
    let mut sink = RecordingSink::new();
    network.set_sync(Some(SyncConfig::default())).unwrap();
    network.start_upload(nodes[0], 0x1000, 0).unwrap();
    network.nmt(nodes[1], NmtCommand::EnterPreOperational).unwrap();
    cycle(&mut network, &mut sink, 0);
    assert_eq!(
        sink.sent,
        [
            (0, 0, 0x080, vec![]),
            (0, 0, 0x000, vec![0x80, 2]),
            (0, 0, 0x764, vec![5]),
            (0, 0, 0x601, vec![0x40, 0, 0x10, 0, 0, 0, 0, 0]),
        ]
    );
    sink.sent.clear();
    cycle(&mut network, &mut sink, 10 * MS);
    assert_eq!(sink.ids(), [0x080]);
    cycle(&mut network, &mut sink, 50 * MS);
    assert_eq!(sink.ids(), [0x080, 0x764]);
}

#[test]
fn broadcast_is_sent_once_per_channel_with_nodes() {
    let nodes = [address(0, 0, 1), address(0, 0, 2), address(0, 3, 1), address(1, 2, 9)];
    let (mut network, handles) = network(NetworkConfig::default(), &nodes);
    let mut sink = RecordingSink::new();
    network.nmt_all(NmtCommand::Start).unwrap();
    assert!(network.nmt_is_pending());
    assert_eq!(network.status(handles[0]).unwrap().expected_nmt_state, None, "not sent yet");
    cycle(&mut network, &mut sink, 0);
    let frame = |slave, channel| (slave, channel, 0, vec![1, 0]);
    assert_eq!(sink.sent, [frame(0, 0), frame(0, 3), frame(1, 2)]);
    assert!(!network.nmt_is_pending());
    for handle in handles {
        let status = network.status(handle).unwrap();
        assert_eq!(status.expected_nmt_state, Some(NmtState::Operational));
        assert_eq!(status.nmt_state, None, "no node has said so");
    }
}

#[test]
fn full_image_delays_frames_in_order() {
    let (mut network, nodes) = network(NetworkConfig::default(), &[address(0, 0, 1)]);
    let mut sink = RecordingSink::new();
    sink.room_frames = 0;
    network.nmt(nodes[0], NmtCommand::ResetNode).unwrap();
    network.nmt(nodes[0], NmtCommand::Start).unwrap();
    network.start_download(nodes[0], 0x6040, 0, &[6, 0]).unwrap();
    for ms in 0..2_000 {
        cycle(&mut network, &mut sink, ms * MS);
    }
    assert_eq!(sink.sent, []);
    assert!(network.statistics().waited >= 2_000);
    assert_eq!(network.sdo_state(nodes[0]), Sdo::Busy, "no timeout of what was never sent");
    for ms in 2_000..2_003 {
        sink.room_frames = 1;
        cycle(&mut network, &mut sink, ms * MS);
    }
    assert_eq!(
        sink.sent,
        [
            (0, 0, 0, vec![0x81, 1]),
            (0, 0, 0, vec![1, 1]),
            (0, 0, 0x601, vec![0x2B, 0x40, 0x60, 0, 6, 0, 0, 0]),
        ]
    );
}

#[test]
fn sdo_frame_does_not_overtake_a_waiting_nmt_command() {
    let (mut network, nodes) = network(NetworkConfig::default(), &[address(0, 0, 1)]);
    let mut sink = RecordingSink::new();
    for _ in 0..3 {
        network.nmt(nodes[0], NmtCommand::Stop).unwrap();
    }
    network.start_upload(nodes[0], 0x1000, 0).unwrap();
    cycle(&mut network, &mut sink, 0);
    assert_eq!(sink.ids(), [0, 0], "two service frames a cycle");
    cycle(&mut network, &mut sink, MS);
    assert_eq!(sink.ids(), [0, 0x601]);

    network.nmt(nodes[0], NmtCommand::Start).unwrap();
    network.take(&received(0, 0, 0x581, &[0x4F, 0, 0x10, 0, 1, 0, 0, 0]), 2 * MS);
    network.start_upload(nodes[0], 0x1001, 0).unwrap();
    sink.rejections = 1;
    cycle(&mut network, &mut sink, 2 * MS);
    assert_eq!(sink.ids(), [] as [u32; 0], "there is room again, and still the order holds");
    cycle(&mut network, &mut sink, 3 * MS);
    assert_eq!(sink.ids(), [0, 0x601]);
}

#[test]
fn full_nmt_queue_returns_error() {
    let config = NetworkConfig { nmt_queue: 2, ..NetworkConfig::default() };
    let (mut network, nodes) = network(config, &[address(0, 3, 1), address(1, 0, 1)]);
    network.nmt(nodes[0], NmtCommand::Start).unwrap();
    network.nmt_all(NmtCommand::Start).unwrap();
    let full = Err(NmtError::QueueFull { slave: 0, channel: 3 });
    assert_eq!(network.nmt(nodes[0], NmtCommand::Start), full);
    assert_eq!(network.nmt_all(NmtCommand::Start), full);
    let mut sink = RecordingSink::new();
    cycle(&mut network, &mut sink, 0);
    assert_eq!(sink.sent.len(), 3, "the rejected broadcast is not sent");
    assert_eq!(network.nmt(NodeHandle(9), NmtCommand::Start), Err(NmtError::UnknownNode));
}

#[test]
fn each_channel_has_its_budget_and_its_nodes_take_turns() {
    let nodes: Vec<_> = (1..=5).map(|node| address(0, 0, node)).collect();
    let (mut network, handles) = network(NetworkConfig::default(), &nodes);
    let other = network.add_node(address(0, 1, 9), NodeConfig::default()).unwrap();
    for handle in handles.iter().chain([&other]) {
        network.start_upload(*handle, 0x1000, 0).unwrap();
    }
    let mut sink = RecordingSink::new();
    cycle(&mut network, &mut sink, 0);
    assert_eq!(sink.ids(), [0x601, 0x602, 0x609]);
    cycle(&mut network, &mut sink, MS);
    assert_eq!(sink.ids(), [0x603, 0x604]);
    // The first is ready for another, but the fifth has waited longer.
    network.take(&received(0, 0, 0x581, &[0x43, 0, 0x10, 0, 1, 2, 3, 4]), 2 * MS);
    network.start_upload(handles[0], 0x1000, 0).unwrap();
    cycle(&mut network, &mut sink, 2 * MS);
    assert_eq!(sink.ids(), [0x605, 0x601]);
}

#[test]
fn block_download_keeps_the_frame_budget() {
    let (mut network, nodes) = network(NetworkConfig::default(), &[address(0, 0, 1)]);
    network.start_download(nodes[0], 0x1F50, 1, &[7; 700]).unwrap();
    let mut sink = RecordingSink::new();
    cycle(&mut network, &mut sink, 0);
    network.take(&received(0, 0, 0x581, &[0xA4, 0x50, 0x1F, 1, 127, 0, 0, 0]), MS);
    for ms in 1..=50 {
        let before = sink.sent.len();
        cycle(&mut network, &mut sink, ms * MS);
        assert_eq!(sink.sent.len() - before, 2);
    }
    cycle(&mut network, &mut sink, 51 * MS);
    assert_eq!(sink.sent.len(), 101, "all segments are out");
}

#[test]
fn sdo_frames_wait_for_a_full_channel_and_spare_targets() {
    let config = NetworkConfig { reserved_image_bytes: 100, ..NetworkConfig::default() };
    let (mut network, nodes) = network(config, &[address(0, 0, 1)]);
    network.start_upload(nodes[0], 0x1000, 0).unwrap();
    network.nmt(nodes[0], NmtCommand::Start).unwrap();
    let mut sink = RecordingSink { pending: 7, ..RecordingSink::new() };
    cycle(&mut network, &mut sink, 0);
    assert_eq!(sink.ids(), [0], "an NMT command goes all the same");
    sink.pending = 6;
    sink.room = 111;
    cycle(&mut network, &mut sink, MS);
    assert_eq!(sink.ids(), []);
    sink.room = 112;
    cycle(&mut network, &mut sink, 2 * MS);
    assert_eq!(sink.ids(), [0x601]);
}

#[test]
fn permanent_rejection_ends_the_transfer() {
    let (mut network, nodes) = network(NetworkConfig::default(), &[address(0, 2, 1)]);
    let error = SendError::from(AddressError::Disabled { slave: 0, channel: 2 });
    let mut sink = RecordingSink { error: Some(error), ..RecordingSink::new() };
    network.start_upload(nodes[0], 0x1000, 0).unwrap();
    network.nmt(nodes[0], NmtCommand::Start).unwrap();
    cycle(&mut network, &mut sink, 0);
    assert_eq!(network.sdo_state(nodes[0]), Sdo::Failed(SdoFault::Rejected(error)));
    assert!(!network.nmt_is_pending());
    let statistics = network.statistics();
    assert_eq!((statistics.rejected, statistics.last_rejection), (2, Some(error)));
    assert_eq!(
        network.sdo_failure(nodes[0]).unwrap().to_string(),
        "SDO upload 0x1000:00 from node 1 (slave 0, channel 2): the frame was rejected: slave 0: \
         channel 2 is not enabled; enable it in the gateway's configuration"
    );
}

#[test]
fn lost_gateway_ends_its_transfers_and_drops_commands() {
    let (mut network, nodes) =
        network(NetworkConfig::default(), &[address(0, 0, 1), address(1, 0, 1)]);
    let mut sink = RecordingSink::new();
    for node in &nodes {
        network.start_upload(*node, 0x1000, 0).unwrap();
    }
    cycle(&mut network, &mut sink, 0);
    sink.sent.clear();
    sink.ready[1] = false;
    network.nmt(nodes[1], NmtCommand::Start).unwrap();
    cycle(&mut network, &mut sink, MS);
    assert_eq!(network.sdo_state(nodes[0]), Sdo::Busy);
    assert_eq!(network.sdo_state(nodes[1]), Sdo::Failed(SdoFault::GatewayLost));
    assert!(!network.nmt_is_pending(), "out of date when the gateway comes back");
    // What is started now waits for the gateway.
    network.start_upload(nodes[1], 0x1001, 0).unwrap();
    network.nmt(nodes[1], NmtCommand::EnterPreOperational).unwrap();
    for ms in 2..1_000 {
        cycle(&mut network, &mut sink, ms * MS);
    }
    assert_eq!(network.sdo_state(nodes[1]), Sdo::Busy);
    sink.sent.clear();
    sink.ready[1] = true;
    cycle(&mut network, &mut sink, 1_000 * MS);
    let to_second: Vec<_> = sink.sent.iter().filter(|(slave, ..)| *slave == 1).collect();
    assert_eq!(to_second.len(), 2);
    assert_eq!((to_second[0].2, to_second[1].2), (0, 0x601));
}

#[test]
fn messages_of_a_node_and_of_strangers() {
    let (mut network, nodes) = network(NetworkConfig::default(), &[address(0, 1, 5)]);
    let node = nodes[0];
    let mut take = |slave, channel, id, data: &[u8], now_ns| {
        network.take(&received(slave, channel, id, data), now_ns)
    };
    assert!(take(0, 1, 0x705, &[0], 0), "boot-up");
    assert!(take(0, 1, 0x705, &[0x7F], 10 * MS), "heartbeat");
    assert!(take(0, 1, 0x085, &[0x11, 0x86, 0x21, 1, 2, 3, 4, 5], 20 * MS), "emergency");
    assert!(take(0, 1, 0x085, &[0; 8], 30 * MS), "its end");
    assert!(take(0, 1, 0x705, &[0x33], 30 * MS), "no state");
    assert!(take(0, 1, 0x085, &[1, 2], 30 * MS), "half an emergency");
    assert!(take(0, 1, 0x585, &[0x60, 0, 0, 0], 30 * MS), "an answer to nothing");
    for (slave, channel, id) in
        [(0, 1, 0x185), (0, 1, 0x080), (0, 1, 0x605), (0, 1, 0x706), (0, 0, 0x705), (1, 1, 0x705)]
    {
        assert!(!take(slave, channel, id, &[0], 0), "{slave} {channel} {id:#X} is someone else's");
    }
    let remote = CanFrame::remote(CanId::standard(0x705).unwrap(), Dlc::new(1).unwrap()).unwrap();
    assert!(network.take(&with_frame(0, 1, remote), 0), "a request for what the node sends");
    let extended = CanFrame::classic(CanId::extended(0x705).unwrap(), &[0]).unwrap();
    assert!(!network.take(&with_frame(0, 1, extended), 0));

    let status = network.status(node).unwrap();
    assert_eq!(status.nmt_state, Some(NmtState::PreOperational));
    assert_eq!((status.boot_ups, status.emcy_count), (1, 2));
    assert_eq!(status.heartbeat, Heartbeat::Active);
    let records: Vec<_> = network.emcy(node).unwrap().recent().collect();
    assert_eq!(records.len(), 2);
    assert_eq!(records[0].emcy.class(), EmcyClass::NoError);
    assert_eq!((records[1].at_ns, records[1].emcy.code), (20 * MS, 0x8611));
    let statistics = network.statistics();
    assert_eq!((statistics.malformed, statistics.sdo_strays), (3, 1));
    network.tick(111 * MS);
    assert_eq!(network.heartbeat(node), Heartbeat::TimedOut);
    assert_eq!(network.status(node).unwrap().heartbeat_timeouts, 1);
}

#[test]
fn restarted_node_ends_the_transfer() {
    let (mut network, nodes) = network(NetworkConfig::default(), &[address(0, 0, 1)]);
    let mut sink = RecordingSink::new();
    network.start_upload(nodes[0], 0x1000, 0).unwrap();
    network.take(&received(0, 0, 0x701, &[0]), 0);
    assert_eq!(network.sdo_state(nodes[0]), Sdo::Busy, "it was not asked before it booted");
    cycle(&mut network, &mut sink, 0);
    network.take(&received(0, 0, 0x701, &[0]), MS);
    assert_eq!(network.sdo_state(nodes[0]), Sdo::Failed(SdoFault::NodeRestarted));
    cycle(&mut network, &mut sink, 2 * MS);
    assert_eq!(sink.sent.len(), 1, "nothing to abort");
}

#[test]
fn sync_follows_its_configuration() {
    let (mut network, _) = network(NetworkConfig::default(), &[address(0, 1, 1)]);
    let schedule = Some(Schedule { tag: 3, offset_ns: 250_000 });
    let settings = SyncConfig { every_cycles: 2, counter_overflow: Some(2), schedule };
    let wrong = SyncConfig { counter_overflow: Some(1), ..settings };
    assert_eq!(network.set_sync(Some(wrong)), Err(NetworkError::CounterOverflow { value: 1 }));
    network.set_sync(Some(settings)).unwrap();
    let mut sink = RecordingSink::new();
    let mut sent = Vec::new();
    for ms in 0..6 {
        network.tick(ms * MS);
        sent.push(network.send_sync_to(&mut sink, |_, _| true));
    }
    assert_eq!(sent, [1, 0, 1, 0, 1, 0]);
    let frame = |counter| (0, 1, 0x080, vec![counter]);
    assert_eq!(sink.sent, [frame(1), frame(2), frame(1)]);
    assert_eq!(sink.schedules, [schedule; 3]);
    sink.sent.clear();
    sink.room_frames = 0;
    network.tick(6 * MS);
    assert_eq!(network.send_sync_to(&mut sink, |_, _| true), 0);
    sink.room_frames = 1;
    network.tick(7 * MS);
    assert_eq!(network.send_sync_to(&mut sink, |_, _| true), 1, "late, with its own number");
    assert_eq!(sink.sent, [frame(2)]);
    assert_eq!((network.statistics().syncs_sent, network.statistics().syncs_late), (4, 1));
    network.set_sync(None).unwrap();
    network.tick(8 * MS);
    assert_eq!(network.send_sync_to(&mut sink, |_, _| true), 0);
}

#[test]
fn unconfirmed_image_delays_sync_of_its_gateway_only() {
    let nodes = [address(0, 0, 1), address(1, 0, 1)];
    let (mut network, _) = network(NetworkConfig::default(), &nodes);
    let settings = SyncConfig { every_cycles: 2, counter_overflow: Some(9), schedule: None };
    network.set_sync(Some(settings)).unwrap();
    let mut sink = RecordingSink::new();
    let mut sent = Vec::new();
    for ms in 0..10 {
        sink.holding[0] = (3..=6).contains(&ms);
        network.tick(ms * MS);
        network.send_sync_to(&mut sink, |_, _| true);
        let by_channel = [0, 1].map(|slave| network.has_sent_sync(slave, 0));
        assert_eq!(by_channel, [0, 1].map(|slave| sink.sent.iter().any(|s| s.0 == slave)));
        sent.extend(sink.sent.drain(..).map(|(slave, _, _, data)| (ms, slave, data[0])));
    }
    let of = |slave| sent.iter().filter(|s| s.1 == slave).map(|s| (s.0, s.2)).collect::<Vec<_>>();
    assert_eq!(of(1), [(0, 1), (2, 2), (4, 3), (6, 4), (8, 5)]);
    // Due at 4, and again at 6; one goes out, at 7, and the plan of even cycles goes on.
    assert_eq!(of(0), [(0, 1), (2, 2), (7, 3), (8, 4)]);
    assert_eq!(network.statistics().syncs_late, 3);
}

#[test]
fn settings_reach_the_client() {
    let mut network = Network::new(NetworkConfig::default());
    let sdo = SdoConfig { timeout: Duration::from_millis(5), retries: 0, ..SdoConfig::default() };
    let settings = NodeConfig { sdo, ..NodeConfig::default() };
    let node = network.add_node(address(0, 0, 1), settings).unwrap();
    let mut sink = RecordingSink::new();
    network.start_upload(node, 0x1000, 0).unwrap();
    cycle(&mut network, &mut sink, 0);
    cycle(&mut network, &mut sink, 5 * MS);
    assert_eq!(network.sdo_state(node), Sdo::Busy);
    cycle(&mut network, &mut sink, 6 * MS);
    assert_eq!(
        network.sdo_state(node),
        Sdo::Failed(SdoFault::TimedOut { attempts: 1, stray: None })
    );
    assert_eq!(sink.ids(), [0x601, 0x601], "the request and its abort");
    assert_eq!(network.heartbeat(node), Heartbeat::Unconfigured);
    assert_eq!(network.sdo_state(NodeHandle(5)), Sdo::Idle);
}

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
    let early = TimeReference { unix_ns: 0, bus_ns: 0 };
    let rejected = network.set_time(Some(TimeConfig { reference: early, ..time }));
    assert_eq!(rejected, Err(NetworkError::TimeReference { unix_ns: 0 }));
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
