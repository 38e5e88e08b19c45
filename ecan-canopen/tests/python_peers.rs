//! Peers that no one here wrote: Python's packages `canopen`, `durand` and `python-can`, joined to the
//! simulated bus by the simulator's bridges.
//!
//! Other programs take part here, and they live in real time: deadlines are generous, and nothing is
//! asserted of durations.

mod lss;

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use ecan_canopen::{
    Commissioning, DeviceFile, Heartbeat, Network, NetworkConfig, NmtCommand, NmtState,
    NodeAddress, NodeConfig, NodeHandle, NodeId, Sdo, SdoConfig, SdoFault, run_cycle_until,
};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_protocol::object::AbortCode;
use ecan_sim::{
    Backend, BridgeProtocol, BridgeSpec, ClockKind, DriveConfig, DriveFault, DriveSpec, Fault,
    GatewaySpec, NodeKind, NodeSpec, RealTimeRunner, Scenario, SimOptions, Simulation,
};

use crate::python_peer::{PATIENCE, Peer, python};
use ecan_sim::bridge::{BridgeInfo, bridges};

/// Cycle of the master.
const CYCLE: Duration = Duration::from_millis(2);

fn open(scenario: Scenario, clock: ClockKind) -> Backend {
    let options = SimOptions {
        clock: Some(clock),
        bridges: Some(ecan_sim::bridge::make),
        ..SimOptions::default()
    };
    ecan_sim::open_scenario(scenario, &options).unwrap()
}

/// The node `drive` and a bridge on bus 0.0, in real time.
struct DriveAndBridge {
    _runner: RealTimeRunner,
    simulation: Simulation,
    bridge: BridgeInfo,
}

impl DriveAndBridge {
    fn new(drive: DriveSpec) -> Self {
        let node = |name: &str, kind| NodeSpec {
            name: name.to_owned(),
            bus: "0.0".to_owned(),
            kind,
            bitrate: Some(500_000),
            data_bitrate: None,
            physical_layer: None,
        };
        let scenario = Scenario {
            gateways: vec![GatewaySpec::at(0)],
            nodes: vec![
                node("drive", NodeKind::Drive(Box::new(drive))),
                node("bridge", NodeKind::Bridge(BridgeSpec::default())),
            ],
            ..Scenario::default()
        };
        let simulation = open(scenario, ClockKind::Real).simulation.unwrap();
        let runner = simulation.keep_running().unwrap();
        let (_, bridge) = bridges(&simulation).remove(0);
        Self { _runner: runner, simulation, bridge }
    }

    fn port(&self) -> u16 {
        self.bridge.address().port()
    }
}

/// A master with one gateway and a CANopen client for one node.
///
/// The clock is stepped, at the pace of real time at most: where the machine has no time for the
/// cycle, simulated time stands still, and the gateway's watchdog has no reason to bite.
struct Client {
    port: Port,
    simulation: Simulation,
    network: Network,
    node: NodeHandle,
    clock: NetworkClock,
}

/// Time of the network. It stops while frames that the peer has sent are not on the bus, so that a busy machine
/// does not turn a response into silence.
#[derive(Default)]
struct NetworkClock {
    bridge: Option<BridgeInfo>,
    /// Frames that the peer has sent, as it reports.
    peer_sent: Rc<Cell<u64>>,
    last_ns: u64,
    stopped_ns: u64,
}

impl NetworkClock {
    fn at(&mut self, now_ns: u64) -> u64 {
        let is_stopped = self
            .bridge
            .as_ref()
            .is_some_and(|bridge| bridge.statistics().sent < self.peer_sent.get());
        if is_stopped {
            self.stopped_ns += now_ns - self.last_ns;
        }
        self.last_ns = now_ns;
        now_ns - self.stopped_ns
    }
}

impl Client {
    fn new(scenario: Scenario, node: NodeId) -> Self {
        let backend = open(scenario, ClockKind::Stepped);
        let gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(500_000));
        let adapter = AdapterConfig::new(1).with_cycle(CYCLE);
        let mut port =
            Port::open(&backend.ecrt, (adapter, PortConfig::uniform(1, gateway))).unwrap();
        port.wait_ready().unwrap();
        let mut network = Network::new(NetworkConfig::default());
        let settings = NodeConfig {
            heartbeat_timeout: Duration::from_millis(2_000),
            // Another program answers, on a machine that may have much to do.
            sdo: SdoConfig { timeout: Duration::from_millis(20_000), ..SdoConfig::default() },
            ..NodeConfig::default()
        };
        let address = NodeAddress { slave: 0, channel: 0, node };
        let node = network.add_node(address, settings).unwrap();
        let (simulation, clock) = (backend.simulation.unwrap(), NetworkClock::default());
        Self { port, simulation, network, node, clock }
    }

    /// Runs the cycle until something has happened.
    fn until(&mut self, what: &str, mut done: impl FnMut(&mut Network) -> bool) {
        run_cycle_until(&mut self.port, PATIENCE, |cycle, now_ns| {
            std::thread::sleep(CYCLE);
            self.network.serve(cycle, self.clock.at(now_ns), |network| done(network).then_some(()))
        })
        .unwrap_or_else(|error| panic!("{what}: {error}"));
    }

    fn finish(&mut self) -> Result<(), SdoFault> {
        let node = self.node;
        self.until("the end of the transfer", |network| network.sdo_state(node) != Sdo::Busy);
        self.network.sdo_failure(node).map_or(Ok(()), |failure| Err(failure.fault))
    }

    fn read(&mut self, index: u16, subindex: u8) -> Result<Vec<u8>, SdoFault> {
        self.network.start_upload(self.node, index, subindex).unwrap();
        self.finish().map(|()| self.network.sdo_data(self.node).to_vec())
    }

    fn read_block(&mut self, index: u16, subindex: u8) -> Result<Vec<u8>, SdoFault> {
        self.network.start_block_upload(self.node, index, subindex).unwrap();
        self.finish().map(|()| self.network.sdo_data(self.node).to_vec())
    }

    fn write(&mut self, index: u16, subindex: u8, value: &[u8]) -> Result<(), SdoFault> {
        self.network.start_download(self.node, index, subindex, value).unwrap();
        self.finish()
    }
}

fn aborted<T>(code: u32) -> Result<T, SdoFault> {
    Err(SdoFault::Aborted(AbortCode(code)))
}

/// Our client in front of the package's node.
#[test]
fn our_client_probes_a_node_of_the_canopen_package() {
    let Some(python) = python() else { return };
    let scenario = Scenario { gateways: vec![GatewaySpec::at(0)], ..Scenario::default() };
    let mut client = Client::new(scenario, NodeId::new(5).unwrap());
    let bridge =
        ecan_sim::bridge::attach(&client.simulation, "0.0", &BridgeSpec::default()).unwrap();
    let arguments = [("port", bridge.info.address().port()), ("node", 5)];
    let mut peer = Peer::start(&python, "local_node.py", &arguments);

    let node = client.node;
    client.until("the boot-up message", |network| {
        assert_eq!(peer.line(), None);
        network.nmt_state(node) == Some(NmtState::PreOperational)
    });

    // Expedited
    assert_eq!(client.read(0x1000, 0).unwrap(), 0x0002_0192_u32.to_le_bytes());
    assert_eq!(client.read(0x1018, 4).unwrap(), 99_u32.to_le_bytes());
    assert_eq!(client.read(0x2001, 0).unwrap(), (-2_i16).to_le_bytes());
    client.write(0x2000, 0, &0xDEAD_BEEF_u32.to_le_bytes()).unwrap();
    assert_eq!(client.read(0x2000, 0).unwrap(), 0xDEAD_BEEF_u32.to_le_bytes());
    client.write(0x2003, 0, &[1]).unwrap();

    // Segmented, of lengths around those of a segment
    assert_eq!(client.read(0x1008, 0).unwrap(), b"A node made in Python");
    for length in [5, 6, 7, 8, 13, 14, 15, 63] {
        let value: Vec<u8> = (0..length).map(|byte| byte * 3).collect();
        client.write(0x2002, 0, &value).unwrap();
        assert_eq!(client.read(0x2002, 0).unwrap(), value);
    }

    // The package has no block transfer: a download it rejects, an upload it answers in segments.
    let long: Vec<u8> = (0..1000_u32).map(|byte| (byte * 7) as u8).collect();
    client.write(0x2002, 0, &long).unwrap();
    assert_eq!(client.read(0x2002, 0).unwrap(), long);
    assert_eq!(client.read_block(0x2002, 0).unwrap(), long);

    // Rejected
    assert_eq!(client.read(0x2FFF, 0), aborted(0x0602_0000));
    assert_eq!(client.read(0x1018, 9), aborted(0x0609_0011));
    assert_eq!(client.read(0x2003, 0), aborted(0x0601_0001));
    assert_eq!(client.write(0x1000, 0, &[0; 4]), aborted(0x0601_0002));
    assert_eq!(client.write(0x2000, 0, &[0; 2]), aborted(0x0607_0010));

    // Heartbeat and NMT
    assert_eq!(client.network.heartbeat(node), Heartbeat::Unknown);
    client.write(0x1017, 0, &50_u16.to_le_bytes()).unwrap();
    client.until("a heartbeat", |network| network.heartbeat(node) == Heartbeat::Active);
    for (command, state) in [
        (NmtCommand::Start, NmtState::Operational),
        (NmtCommand::Stop, NmtState::Stopped),
        (NmtCommand::EnterPreOperational, NmtState::PreOperational),
    ] {
        client.network.nmt(node, command).unwrap();
        client.until("the NMT state", |network| network.nmt_state(node) == Some(state));
    }

    // EMCY
    for (code, register) in [(0x8130_u16, 0x20), (0x0000, 0)] {
        let before = client.network.emcy(node).unwrap().count();
        client.write(0x2010, 0, &code.to_le_bytes()).unwrap();
        client.until("the emergency", |n| n.emcy(node).unwrap().count() > before);
        let emcy = client.network.emcy(node).unwrap().last().unwrap().emcy;
        assert_eq!((emcy.code, emcy.register.0), (code, register));
        assert_eq!(emcy.manufacturer, [1, 2, 3, 4, 5]);
    }

    // The peer dies
    peer.kill();
    client.until("the silence", |network| network.heartbeat(node) == Heartbeat::TimedOut);
    let statistics = bridge.info.statistics();
    assert_eq!((statistics.dropped_to_bus, statistics.dropped_to_clients), (0, 0));
}

/// Every format of frame through both protocols, as python-can writes and reads them.
#[test]
fn python_can_exchanges_frames_through_two_protocols() {
    let Some(python) = python() else { return };
    let bridge = |name: &str, protocol| NodeSpec {
        name: name.to_owned(),
        bus: "0.0".to_owned(),
        kind: NodeKind::Bridge(BridgeSpec { protocol, ..BridgeSpec::default() }),
        bitrate: Some(500_000),
        data_bitrate: Some(2_000_000),
        physical_layer: None,
    };
    let scenario = Scenario {
        gateways: vec![GatewaySpec::at(0)],
        nodes: vec![
            bridge("one", BridgeProtocol::Slcan),
            bridge("two", BridgeProtocol::Slcan),
            bridge("daemon", BridgeProtocol::Socketcand),
        ],
        ..Scenario::default()
    };
    let simulation = open(scenario, ClockKind::Real).simulation.unwrap();
    let _runner = simulation.keep_running().unwrap();
    let ports: Vec<_> = bridges(&simulation).iter().map(|(_, b)| b.address().port()).collect();
    let arguments = [("slcan", ports[0]), ("other", ports[1]), ("daemon", ports[2])];
    let mut peer = Peer::start(&python, "frames.py", &arguments);
    assert_eq!(peer.wait_line(), "passed");
    for (_, bridge) in bridges(&simulation) {
        assert_eq!(bridge.statistics().dropped_to_clients, 0);
        assert_eq!(bridge.statistics().mismatched, 0);
    }
}

/// The package's CiA 402 master in front of our drive; no EtherCAT master takes part.
#[test]
fn python_402_master_drives_the_simulated_drive() {
    let Some(python) = python() else { return };
    let drive = NodeId::new(7).unwrap();
    let settings = DriveSpec { config: DriveConfig::new(drive), eds: None };
    let peers = DriveAndBridge::new(settings);
    let arguments = [("port", peers.port()), ("node", u16::from(drive.get()))];
    let mut peer = Peer::start(&python, "drive_master.py", &arguments);
    assert_eq!(peer.wait_line(), "ask fault");
    let fault = DriveFault::Error { code: 0x2310 };
    peers.simulation.inject(Fault::Drive { node: "drive".to_owned(), fault });
    peer.answer();
    assert_eq!(peer.wait_line(), "passed");
    assert_eq!(peers.bridge.statistics().dropped_to_bus, 0);
    assert_eq!(peers.bridge.statistics().dropped_to_clients, 0);
}

/// The package configures a drive that is made from the same file, of which it reads the DCF that is
/// written here; the drive then has the values of the DCF.
#[test]
fn python_configures_the_simulated_drive_by_dcf() {
    let Some(python) = python() else { return };
    let text = include_bytes!("device_files/data/servo.dcf");
    let file = DeviceFile::parse(text).unwrap();
    assert_eq!(file.warnings(), []);
    let drive = file.node_id().unwrap();
    let directory = std::env::temp_dir().join(format!("ecan-dcf-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let (eds, dcf) = (directory.join("servo.eds"), directory.join("servo.dcf"));
    let mut defaults = file.to_dcf(Commissioning::default());
    defaults.commissioning = None;
    std::fs::write(&eds, defaults.write()).unwrap();
    std::fs::write(&dcf, file.write()).unwrap();

    let settings = DriveSpec { config: DriveConfig::new(drive), eds: Some(eds) };
    let peers = DriveAndBridge::new(settings);
    let arguments = [
        ("port", peers.port().to_string()),
        ("node", drive.to_string()),
        ("dcf", dcf.display().to_string()),
    ];
    let mut peer = Peer::start(&python, "dcf_master.py", &arguments);
    let parameters: Vec<_> =
        file.entries().filter(|entry| entry.parameter.is_some()).cloned().collect();
    assert_eq!(peer.wait_line(), format!("compared {}", parameters.len()));
    peers.simulation.with_world(|world| {
        let drive_node = world.drive("drive").unwrap();
        for entry in &parameters {
            let expected = entry.parameter_value(drive).unwrap().to_integer().unwrap();
            let found = drive_node.object(entry.index, entry.subindex).unwrap();
            let bits = |number: i128| entry.data_type.mask(number as u64);
            assert_eq!(bits(found.into()), bits(expected), "{:04X}", entry.index);
        }
    });
    std::fs::remove_dir_all(&directory).unwrap();
}
