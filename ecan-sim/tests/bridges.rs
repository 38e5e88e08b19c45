//! Bridges as their clients see them: over TCP, mostly in real time.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use ecan_can_io::bridge::{BridgeInfo, ServerError};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_sim::bridge::{BridgeError, attach, bridges};
use ecan_sim::{
    BackendError, BridgeProtocol, BridgeSpec, ClockKind, Fault, FaultyConfig, GatewaySpec,
    NodeKind, NodeSpec, RunnerError, Scenario, SimOptions, Simulation,
};

/// Timeout of a failing test.
const TIMEOUT: Duration = Duration::from_secs(300);

fn node(name: &str, bus: &str, kind: NodeKind, bitrate: Option<u32>) -> NodeSpec {
    NodeSpec {
        name: name.to_owned(),
        bus: bus.to_owned(),
        kind,
        bitrate,
        data_bitrate: None,
        physical_layer: None,
    }
}

/// A gateway without configured channels, and nodes with their own bit rates on its first bus.
fn simulation(kinds: Vec<NodeKind>) -> Simulation {
    let kinds = kinds.into_iter().enumerate();
    let scenario = Scenario {
        gateways: vec![GatewaySpec::at(0)],
        nodes: kinds.map(|(i, kind)| node(&format!("n{i}"), "0.0", kind, Some(500_000))).collect(),
        ..Scenario::default()
    };
    open(scenario, ClockKind::Real)
}

fn open(scenario: Scenario, clock: ClockKind) -> Simulation {
    let options = SimOptions {
        clock: Some(clock),
        bridges: Some(ecan_sim::bridge::make),
        ..SimOptions::default()
    };
    ecan_sim::open_scenario(scenario, &options).unwrap().simulation.unwrap()
}

fn bridge(spec: BridgeSpec) -> NodeKind {
    NodeKind::Bridge(spec)
}

fn only_bridge(simulation: &Simulation) -> BridgeInfo {
    let bridges = bridges(simulation);
    assert_eq!(bridges.len(), 1);
    bridges[0].1.clone()
}

/// A client without protocol.
struct Client(TcpStream);

impl Client {
    fn connect(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(TIMEOUT)).unwrap();
        stream.set_write_timeout(Some(TIMEOUT)).unwrap();
        Self(stream)
    }

    /// An slcan client with an open channel.
    fn slcan(address: SocketAddr) -> Self {
        let mut client = Self::connect(address);
        client.send("O\r");
        client.expect("\r");
        client
    }

    fn send(&mut self, text: &str) {
        self.0.write_all(text.as_bytes()).unwrap();
    }

    /// Reads exactly this text.
    fn expect(&mut self, text: &str) {
        let mut bytes = vec![0; text.len()];
        self.0.read_exact(&mut bytes).unwrap();
        assert_eq!(String::from_utf8_lossy(&bytes), text);
    }

    /// Returns whether the server has closed the connection.
    fn is_closed(&mut self) -> bool {
        matches!(self.0.read(&mut [0]), Ok(0) | Err(_))
    }
}

fn wait_for(what: &str, mut done: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < TIMEOUT, "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Number of threads of the bridge with this port.
fn bridge_threads(port: u16) -> usize {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap();
    let names =
        tasks.filter_map(|task| std::fs::read_to_string(task.ok()?.path().join("comm")).ok());
    names.filter(|name| name.trim() == format!("bridge {port}")).count()
}

#[test]
fn client_receives_node_frames_not_its_own() {
    let simulation = simulation(vec![NodeKind::Echo, bridge(BridgeSpec::default())]);
    let _runner = simulation.keep_running().unwrap();
    let bridge = only_bridge(&simulation);
    assert!(bridge.address().ip().is_loopback());
    let mut client = Client::slcan(bridge.address());
    client.send("t1232AABB\rT012345670\rr1238\r");
    // The first echo may arrive before the last frame is accepted.
    let mut bytes = vec![0; "z\rZ\rz\rt1232AABB\rT012345670\rr1238\r".len()];
    client.0.read_exact(&mut bytes).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    let (taken, echoes): (Vec<_>, Vec<_>) =
        text.split_terminator('\r').partition(|line| line.eq_ignore_ascii_case("z"));
    assert_eq!(taken, ["z", "Z", "z"]);
    assert_eq!(echoes, ["t1232AABB", "T012345670", "r1238"]);
    assert_eq!(bridge.statistics().sent, 3);
    assert_eq!(bridge.statistics().delivered, 3);
}

#[test]
fn clients_receive_each_others_frames() {
    let simulation = simulation(vec![NodeKind::Silent, bridge(BridgeSpec::default())]);
    let _runner = simulation.keep_running().unwrap();
    let bridge = only_bridge(&simulation);
    let mut clients: Vec<_> = (0..3).map(|_| Client::slcan(bridge.address())).collect();
    for sender in 0..3 {
        clients[sender].send(&format!("t10{sender}0\r"));
        clients[sender].expect("z\r");
        for (_, other) in clients.iter_mut().enumerate().filter(|(other, _)| *other != sender) {
            other.expect(&format!("t10{sender}0\r"));
        }
    }
    assert_eq!(bridge.statistics().clients, 3);
    drop(clients);
    wait_for("clients leave", || bridge.statistics().clients == 0);
}

#[test]
fn two_bridges_on_one_bus_use_two_protocols() {
    let simulation = simulation(vec![
        bridge(BridgeSpec::default()),
        bridge(BridgeSpec { protocol: BridgeProtocol::Socketcand, ..BridgeSpec::default() }),
    ]);
    let _runner = simulation.keep_running().unwrap();
    let bridges = bridges(&simulation);
    let mut slcan = Client::slcan(bridges[0].1.address());
    let mut daemon = Client::connect(bridges[1].1.address());
    daemon.expect("< hi >");
    daemon.send("< open can0 >");
    daemon.expect("< ok >");
    daemon.send("< rawmode >");
    daemon.expect("< ok >");
    daemon.send("< send 321 2 1 2 >");
    slcan.expect("t32120102\r");
    slcan.send("t1231FF\r");
    slcan.expect("z\r");
    daemon.expect("< frame 123 ");
}

#[test]
fn malformed_input_is_answered_with_bell() {
    let simulation = simulation(vec![NodeKind::Silent, bridge(BridgeSpec::default())]);
    let bridge = only_bridge(&simulation);
    let mut client = Client::slcan(bridge.address());
    client.send("t12\rwhat?\r\0\u{fffd}\r");
    client.expect("\x07\x07\x07");
    client.send("V\r");
    client.expect("V1010\r");
    assert_eq!(bridge.statistics().rejected, 3);
}

#[test]
fn full_queue_to_the_bus_stops_a_client_that_loses_nothing() {
    let spec = BridgeSpec { queue: Some(8), ..BridgeSpec::default() };
    let nodes = [("silent", NodeKind::Silent), ("bridge", bridge(spec))];
    let scenario = Scenario {
        gateways: vec![GatewaySpec::at(0)],
        nodes: nodes.map(|(name, kind)| node(name, "0.0", kind, Some(500_000))).into(),
        ..Scenario::default()
    };
    // The queue is not emptied before time passes.
    let simulation = open(scenario, ClockKind::Stepped);
    let bridge = only_bridge(&simulation);
    let mut client = Client::slcan(bridge.address());
    client.send(&"t1230\r".repeat(20));
    wait_for("all frames are on the bus", || {
        simulation.pass_ns(1_000_000);
        bridge.statistics().sent == 20
    });
    client.expect(&"z\r".repeat(20));
    assert_eq!(bridge.statistics().dropped_to_bus, 0);
}

/// The writer of a client that does not read blocks in its socket; the bus and the end of the
/// simulation do not.
#[test]
fn client_that_does_not_read_blocks_nothing() {
    let babbler = FaultyConfig { babble_us: 100, ..FaultyConfig::default() };
    let scenario = Scenario {
        gateways: vec![GatewaySpec::at(0)],
        nodes: vec![
            node("babbler", "0.0", NodeKind::Faulty(babbler), Some(1_000_000)),
            node("bridge", "0.0", bridge(BridgeSpec::default()), Some(1_000_000)),
        ],
        ..Scenario::default()
    };
    let simulation = open(scenario, ClockKind::Stepped);
    let info = only_bridge(&simulation);
    let idle_client = Client::slcan(info.address());
    // When the sockets and the queue are full, nothing more is delivered.
    wait_for("the sockets are full", || {
        let before = info.statistics();
        simulation.pass_ns(1_000_000_000);
        let after = info.statistics();
        after.delivered == before.delivered && after.dropped_to_clients > before.dropped_to_clients
    });
    drop(simulation);
    wait_for("its threads end", || bridge_threads(info.address().port()) == 0);
    drop(idle_client);
}

#[test]
fn excess_client_is_rejected_until_another_leaves() {
    let spec = BridgeSpec { max_clients: Some(1), ..BridgeSpec::default() };
    let simulation = simulation(vec![NodeKind::Silent, bridge(spec)]);
    let bridge = only_bridge(&simulation);
    let first = Client::slcan(bridge.address());
    assert!(Client::connect(bridge.address()).is_closed());
    assert_eq!(bridge.statistics().rejected_clients, 1);
    drop(first);
    wait_for("the first leaves", || bridge.statistics().clients == 0);
    Client::slcan(bridge.address());
}

#[test]
fn muted_bridge_keeps_senders_apart() {
    let simulation = simulation(vec![NodeKind::Silent, bridge(BridgeSpec::default())]);
    let _runner = simulation.keep_running().unwrap();
    let info = only_bridge(&simulation);
    let (mut one, mut two) = (Client::slcan(info.address()), Client::slcan(info.address()));
    simulation.inject(Fault::NodeSilent { node: "n1".to_owned(), for_ms: 50 });
    one.send("t1110\r");
    one.expect("z\r");
    simulation.pass_ns(100_000_000);
    two.send("t2220\r");
    two.expect("z\r");
    // BELL: the first frame was confirmed and then lost.
    one.expect("\x07t2220\r");
    one.send("t3330\r");
    one.expect("z\r");
    two.expect("t3330\r");
}

#[test]
fn dropped_bridge_handle_ends_threads() {
    let simulation = simulation(vec![NodeKind::Silent]);
    let _runner = simulation.keep_running().unwrap();
    let handle = attach(&simulation, "0.0", &BridgeSpec::default()).unwrap();
    let address = handle.info.address();
    let clients: Vec<_> = (0..3).map(|_| Client::slcan(address)).collect();
    assert_eq!((bridges(&simulation).len(), handle.info.statistics().clients), (1, 3));
    assert_eq!(bridge_threads(address.port()), 1);
    let info = handle.info.clone();
    drop(handle);
    assert_eq!((bridges(&simulation).len(), info.statistics().clients), (0, 0));
    wait_for("its threads end", || bridge_threads(address.port()) == 0);
    for mut client in clients {
        assert!(client.is_closed());
    }
    assert!(TcpStream::connect(address).is_err());
}

#[test]
fn scenario_without_bridge_factory_reports_the_node() {
    let scenario = Scenario {
        gateways: vec![GatewaySpec::at(0)],
        nodes: vec![node("slcan", "0.0", bridge(BridgeSpec::default()), None)],
        ..Scenario::default()
    };
    let error = ecan_sim::open_scenario(scenario, &SimOptions::default()).unwrap_err();
    assert!(matches!(error, BackendError::NoBridges(_)));
    assert_eq!(
        error.to_string(),
        "node \"slcan\" is a bridge; this program does not support bridges"
    );
}

#[test]
fn dropped_simulation_ends_bridges() {
    let simulation = simulation(vec![bridge(BridgeSpec::default())]);
    let address = only_bridge(&simulation).address();
    let mut client = Client::slcan(address);
    drop(simulation);
    assert!(client.is_closed());
    wait_for("its threads end", || bridge_threads(address.port()) == 0);
}

#[test]
fn impossible_bridges_are_rejected_with_reason() {
    let simulation = simulation(vec![NodeKind::Silent]);
    let error = attach(&simulation, "0.7", &BridgeSpec::default()).unwrap_err();
    assert_eq!(error.to_string(), "bus \"0.7\" does not exist; there are: 0.0, 0.1, 0.2, 0.3");
    let first = attach(&simulation, "0.0", &BridgeSpec::default()).unwrap();
    let taken = BridgeSpec { port: first.info.address().port(), ..BridgeSpec::default() };
    let error = attach(&simulation, "0.1", &taken).unwrap_err();
    let BridgeError::Server(ServerError::Listen(address, _)) = error else { panic!("{error}") };
    assert_eq!(address, first.info.address());
}

#[test]
fn runner_rejects_stepped_clock() {
    let simulation = open(Scenario::default(), ClockKind::Stepped);
    assert!(matches!(simulation.keep_running(), Err(RunnerError::SteppedClock)));
}

/// The program advances stepped time.
#[test]
fn bridge_works_in_stepped_time() {
    let scenario = Scenario {
        gateways: vec![GatewaySpec::at(0)],
        nodes: vec![
            node("echo", "0.0", NodeKind::Echo, Some(500_000)),
            node("bridge", "0.0", bridge(BridgeSpec::default()), Some(500_000)),
        ],
        ..Scenario::default()
    };
    let simulation = open(scenario, ClockKind::Stepped);
    let mut client = Client::slcan(only_bridge(&simulation).address());
    client.send("t1230\r");
    client.expect("z\r");
    simulation.pass_ns(10_000_000);
    client.expect("t1230\r");
}

#[test]
fn scenario_file_configures_bridge() {
    let text = r#"
        [[gateway]]
        [[node]]
        kind = "echo"
        bus = "0.2"
        bitrate = 250000
        [[node]]
        kind = "bridge"
        bus = "0.2"
        bitrate = 250000
        protocol = "socketcand"
        max_clients = 2
        queue = 10
    "#;
    let scenario = Scenario::from_toml(text, "joined", std::path::Path::new(".")).unwrap();
    let spec = BridgeSpec {
        protocol: BridgeProtocol::Socketcand,
        max_clients: Some(2),
        queue: Some(10),
        ..BridgeSpec::default()
    };
    assert_eq!(scenario.nodes[1].kind, bridge(spec));
    let simulation = open(scenario, ClockKind::Real);
    let info = only_bridge(&simulation);
    let address = info.address();
    assert!(address.port() != 0 && address.ip().is_loopback());
    let ending = format!(", socketcand bridge at {address} on bus 0.2");
    assert!(simulation.banner().ends_with(&ending), "{}", simulation.banner());
}

#[test]
fn bridge_keys_are_rejected_for_other_nodes() {
    let rejected = |keys: &str| {
        let text = format!("[[gateway]]\n[[node]]\nbus = \"0.0\"\n{keys}");
        Scenario::from_toml(&text, "wrong", std::path::Path::new(".")).unwrap_err().to_string()
    };
    assert_eq!(
        rejected("kind = \"echo\"\nport = 1"),
        "line 2: `port` belongs to nodes of kind \"bridge\""
    );
    assert_eq!(
        rejected("kind = \"bridge\"\nqueue = 0"),
        "line 2: a bridge needs `max_clients` and `queue` above 0"
    );
    assert!(rejected("kind = \"bridge\"\nport = 70000").starts_with("line 5: "));
    assert!(rejected("kind = \"bridge\"\nprotocol = \"gvret\"").starts_with("line 5: "));
}

/// The bridge does not change frames.
#[test]
fn client_frame_is_sent_unchanged() {
    let frame = CanFrame::classic(CanId::standard(0x123).unwrap(), &[1]).unwrap();
    let simulation = simulation(vec![NodeKind::Silent, bridge(BridgeSpec::default())]);
    let _runner = simulation.keep_running().unwrap();
    let info = only_bridge(&simulation);
    let mut client = Client::slcan(info.address());
    client.send("t123101\r");
    client.expect("z\r");
    wait_for("it is sent", || info.statistics().sent == 1);
    let busy = simulation.with_world(|world| world.bus("0.0").unwrap().statistics().busy_ns);
    let timing = ecan_sim::FrameTiming::of(&frame);
    assert_eq!(busy, timing.duration_ns(500_000, 500_000));
}
