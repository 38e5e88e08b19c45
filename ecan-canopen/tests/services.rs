//! LSS, node guarding and TIME over a simulated gateway, with simulated drives.
#![allow(missing_docs)]

use std::time::Duration;

use ecan_canopen::{
    Configurator, ErrorHistory, FastscanFilter, GuardErrors, GuardingConfig, Heartbeat,
    HistoryEntry, Lss, LssAddress, LssAddressRange, LssBitRate, LssCommand, LssConfig, LssFault,
    LssResult, LssStartError, Network, NetworkConfig, NmtCommand, NmtState, NodeAction,
    NodeAddress, NodeConfig, NodeHandle, NodeId, ParameterGroup, Step, TimeConfig, TimeReference,
    WaitError, run_cycle_until,
};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_sim::{
    Backend, ClockKind, DriveConfig, DriveSpec, GatewaySpec, NodeKind, NodeSpec, Scenario,
    SimOptions, Simulation,
};

const LONG: Duration = Duration::from_secs(20);

fn node_id(id: u8) -> NodeId {
    NodeId::new(id).unwrap()
}

/// Drives on the first channel of a gateway, named by their serial number, 1 and up.
fn drives(count: u32, change: impl Fn(&mut DriveConfig)) -> Scenario {
    let drive = |serial: u32| {
        let mut config = DriveConfig { serial, ..DriveConfig::new(node_id(serial as u8)) };
        change(&mut config);
        NodeSpec {
            name: serial.to_string(),
            bus: "0.0".to_owned(),
            kind: NodeKind::Drive(Box::new(DriveSpec { config, eds: None })),
            bitrate: Some(500_000),
            data_bitrate: None,
            physical_layer: None,
        }
    };
    Scenario {
        gateways: vec![GatewaySpec::at(0)],
        nodes: (1..=count).map(drive).collect(),
        ..Scenario::default()
    }
}

fn identity(serial: u32) -> LssAddress {
    LssAddress { vendor: 0x5349_4D00, product: 402, revision: 0x0001_0000, serial }
}

struct Bench {
    backend: Backend,
    port: Port,
    network: Network,
}

impl Bench {
    fn new(scenario: Scenario) -> Self {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
        let port = open_port(&backend, 500_000);
        let mut network = Network::new(NetworkConfig::default());
        network.add_channel(0, 0).unwrap();
        Self { backend, port, network }
    }

    fn simulation(&self) -> &Simulation {
        self.backend.simulation.as_ref().unwrap()
    }

    fn lss(&mut self, command: LssCommand) -> Result<LssResult, WaitError> {
        self.network.lss_blocking(&mut self.port, (0, 0), command, LONG)
    }

    fn lss_ok(&mut self, command: LssCommand) -> LssResult {
        self.lss(command).unwrap_or_else(|error| panic!("{error}"))
    }

    fn fault(&mut self, command: LssCommand) -> LssFault {
        match self.lss(command) {
            Err(WaitError::Lss(failure)) => failure.fault,
            other => panic!("{other:?}"),
        }
    }

    fn add_node(&mut self, id: u8, config: NodeConfig) -> NodeHandle {
        let address = NodeAddress { slave: 0, channel: 0, node: node_id(id) };
        self.network.add_node(address, config).unwrap()
    }

    fn until(&mut self, what: &str, mut done: impl FnMut(&mut Network) -> bool) {
        run_cycle_until(&mut self.port, LONG, |cycle, now_ns| {
            self.network.serve(cycle, now_ns, |network| done(network).then_some(()))
        })
        .unwrap_or_else(|error| panic!("{what}: {error}"));
    }

    fn pass(&mut self, cycles: usize) {
        let mut left = cycles;
        self.until("time", |_| {
            left -= 1;
            left == 0
        });
    }

    fn read(&mut self, node: NodeHandle, index: u16, subindex: u8) -> u64 {
        let data = self
            .network
            .upload_blocking(&mut self.port, node, (index, subindex), LONG)
            .unwrap_or_else(|error| panic!("{error}"));
        data.iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte))
    }

    fn write(&mut self, node: NodeHandle, (index, subindex): (u16, u8), value: &[u8]) {
        self.network
            .download_blocking(&mut self.port, node, (index, subindex), value, LONG)
            .unwrap_or_else(|error| panic!("{error}"));
    }
}

fn open_port(backend: &Backend, bit_per_s: u32) -> Port {
    let gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(bit_per_s));
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let mut port = Port::open(&backend.ecrt, (adapter, PortConfig::uniform(1, gateway))).unwrap();
    port.wait_ready().unwrap_or_else(|error| panic!("{error}"));
    port
}

#[test]
fn fastscan_gives_node_ids_to_all_drives() {
    let mut bench = Bench::new(drives(3, |drive| drive.quirks.without_node_id = true));
    bench.pass(100);
    assert_eq!(bench.lss_ok(LssCommand::IdentifyNonConfigured), LssResult::Found);
    let scan = LssCommand::Fastscan(FastscanFilter::default());
    for serial in 1..=3 {
        // The lowest address first.
        let found = LssResult::Address(identity(serial));
        assert_eq!(bench.lss_ok(scan), found);
        assert_eq!(bench.lss_ok(LssCommand::InquireNodeId), LssResult::NodeId(None));
        let node = node_id(10 + serial as u8);
        assert_eq!(bench.lss_ok(LssCommand::ConfigureNodeId(Some(node))), LssResult::Done);
        assert_eq!(bench.lss_ok(LssCommand::Store), LssResult::Done);
        assert_eq!(
            bench.lss_ok(LssCommand::SwitchGlobal { configuration: false }),
            LssResult::Done
        );
    }
    assert_eq!(bench.lss_ok(scan), LssResult::NotFound);
    assert_eq!(bench.lss_ok(LssCommand::IdentifyNonConfigured), LssResult::NotFound);
    for serial in 1..=3 {
        let node = bench.add_node(10 + serial, NodeConfig::default());
        assert_eq!(bench.read(node, 0x1018, 4), u64::from(serial));
    }
    assert_eq!(bench.network.statistics().lss_strays, 0);
}

#[test]
fn known_vendor_and_product_shorten_the_scan() {
    let mut bench = Bench::new(drives(1, |drive| drive.quirks.without_node_id = true));
    bench.pass(100);
    let before = bench.network.statistics().lss_sent;
    let LssAddress { vendor, product, revision, .. } = identity(1);
    let filter = FastscanFilter {
        vendor: Some(vendor),
        product: Some(product),
        revision: Some(revision),
        serial: None,
    };
    let scan = LssCommand::Fastscan(filter);
    assert_eq!(bench.lss_ok(scan), LssResult::Address(identity(1)));
    assert_eq!(bench.network.statistics().lss_sent - before, 1 + 3 + 33);
    let other = FastscanFilter { product: Some(1), ..filter };
    bench.lss_ok(LssCommand::SwitchGlobal { configuration: false });
    assert_eq!(bench.lss_ok(LssCommand::Fastscan(other)), LssResult::NotFound);
}

#[test]
fn selected_drive_reports_identity_and_gets_another_node_id() {
    let mut bench = Bench::new(drives(2, |_| {}));
    bench.pass(100);
    let range = LssAddressRange::of_product(0x5349_4D00, 402);
    assert_eq!(bench.lss_ok(LssCommand::Identify(range)), LssResult::Found);
    let others = LssAddressRange { serial: (3, u32::MAX), ..range };
    assert_eq!(bench.lss_ok(LssCommand::Identify(others)), LssResult::NotFound);
    assert_eq!(bench.lss_ok(LssCommand::SwitchSelective(identity(2))), LssResult::Done);
    assert_eq!(bench.lss_ok(LssCommand::InquireAddress), LssResult::Address(identity(2)));
    let node = LssResult::NodeId(NodeId::new(2));
    assert_eq!(bench.lss_ok(LssCommand::InquireNodeId), node);
    bench.lss_ok(LssCommand::ConfigureNodeId(NodeId::new(20)));
    bench.lss_ok(LssCommand::SwitchGlobal { configuration: false });
    let old = bench.add_node(2, NodeConfig::default());
    let new = bench.add_node(20, NodeConfig::default());
    bench.network.nmt(old, NmtCommand::ResetCommunication).unwrap();
    bench.until("boot-up of node 20", |network| network.status(new).unwrap().boot_ups == 1);
    assert_eq!(bench.read(new, 0x1018, 4), 2);
    assert_eq!(bench.network.status(old).unwrap().boot_ups, 0);
}

#[test]
fn lss_faults_are_typed_and_explained() {
    let mut bench = Bench::new(drives(1, |drive| drive.quirks.no_lss_store = true));
    bench.pass(100);
    let waited = |fault| match fault {
        LssFault::TimedOut { waited } | LssFault::NotSelected { waited } => waited.as_millis(),
        other => panic!("{other}"),
    };
    assert!((500..510).contains(&waited(bench.fault(LssCommand::InquireNodeId))));
    let fault = bench.fault(LssCommand::SwitchSelective(identity(7)));
    assert!(matches!(fault, LssFault::NotSelected { .. }), "{fault}");
    bench.lss_ok(LssCommand::SwitchSelective(identity(1)));
    assert_eq!(bench.fault(LssCommand::Store), LssFault::StoreNotSupported);
    let rejected = bench.lss(LssCommand::ConfigureBitRate(LssBitRate::Automatic)).unwrap_err();
    assert_eq!(
        rejected.to_string(),
        "LSS on slave 0 channel 0, configure bit rate automatic: the slave does not support automatic"
    );
    assert!(matches!(bench.network.lss_state(0, 0), Lss::Failed(_)));

    // Rejections before the start
    bench.network.start_lss(0, 0, LssCommand::Store).unwrap();
    let busy = LssStartError::Busy { slave: 0, channel: 0 };
    assert_eq!(bench.network.start_lss(0, 0, LssCommand::Store), Err(busy));
    bench.network.cancel_lss(0, 0);
    assert_eq!(bench.network.lss_failure(0, 0).unwrap().fault, LssFault::Cancelled);
    let unknown = LssStartError::UnknownChannel { slave: 0, channel: 1 };
    assert_eq!(bench.network.start_lss(0, 1, LssCommand::Store), Err(unknown));
}

#[test]
fn too_short_scan_time_is_detected() {
    let mut bench = Bench::new(drives(1, |drive| drive.quirks.without_node_id = true));
    bench.pass(100);
    let scan_time = Duration::from_micros(10);
    bench.network.set_lss_config(0, 0, LssConfig { scan_time, ..LssConfig::default() });
    match bench.lss(LssCommand::Fastscan(FastscanFilter::default())) {
        // No response in time at all, or some of them.
        Ok(LssResult::NotFound) => {}
        Err(WaitError::Lss(failure)) => {
            assert!(matches!(failure.fault, LssFault::Inconsistent { .. }), "{failure}");
        }
        other => panic!("{other:?}"),
    }
    bench.pass(10);
    assert!(bench.network.statistics().lss_strays > 0, "the responses were late");
}

#[test]
fn bit_rate_of_a_bus_changes_with_the_gateway() {
    let mut bench = Bench::new(drives(2, |_| {}));
    bench.pass(100);
    bench.lss_ok(LssCommand::SwitchGlobal { configuration: true });
    // Both drives respond to the configuration.
    bench.lss_ok(LssCommand::ConfigureBitRate(LssBitRate::Rate250k));
    bench.pass(10);
    bench.lss_ok(LssCommand::Store);
    bench.pass(10);
    bench.lss_ok(LssCommand::ActivateBitRate { delay_ms: 50 });
    drop(bench.port);
    bench.port = open_port(&bench.backend, 250_000);
    bench.lss_ok(LssCommand::SwitchGlobal { configuration: false });
    for id in [1, 2] {
        let node = bench.add_node(id, NodeConfig::default());
        assert_eq!(bench.read(node, 0x1018, 4), u64::from(id));
    }
    bench.network.nmt_channel(0, 0, NmtCommand::ResetNode).unwrap();
    bench.pass(100);
    let node = bench.network.handles().next().unwrap();
    assert_eq!(bench.read(node, 0x1018, 4), 1, "stored");
}

const GUARDING: GuardingConfig =
    GuardingConfig { guard_time: Duration::from_millis(20), life_time_factor: 3 };

fn guarded() -> NodeConfig {
    NodeConfig { guarding: Some(GUARDING), ..NodeConfig::default() }
}

#[test]
fn guarded_drive_reports_state_and_loss() {
    let scenario = drives(2, |drive| drive.quirks.missing = vec![0x1016, 0x1017]);
    let mut bench = Bench::new(scenario);
    let nodes = [1, 2].map(|id| bench.add_node(id, guarded()));
    bench.until("the life sign", |network| {
        nodes.iter().all(|node| network.heartbeat(*node) == Heartbeat::Active)
    });
    assert_eq!(bench.network.nmt_state(nodes[0]), Some(NmtState::PreOperational));
    for node in nodes {
        bench.write(node, (0x100C, 0), &20u16.to_le_bytes());
        bench.write(node, (0x100D, 0), &[3]);
    }
    bench.network.nmt_all(NmtCommand::Start).unwrap();
    bench.until("Operational", |network| {
        nodes.iter().all(|node| network.nmt_state(*node) == Some(NmtState::Operational))
    });
    bench.pass(1_000);
    let status = bench.network.status(nodes[0]).unwrap();
    assert_eq!((status.heartbeat, status.heartbeat_timeouts), (Heartbeat::Active, 0));
    assert_eq!(status.guard_errors, GuardErrors::default());
    assert_eq!(status.emcy_count, 0, "the drive sees the host");

    // The drive loses its supply: toggle bit and state start over.
    bench.simulation().inject(ecan_sim::Fault::Drive {
        node: "1".to_owned(),
        fault: ecan_sim::DriveFault::PowerCycle { off_ms: 100 },
    });
    bench.until("the loss", |network| network.heartbeat(nodes[0]) == Heartbeat::TimedOut);
    assert_eq!(bench.network.heartbeat(nodes[1]), Heartbeat::Active);
    bench.until("the return", |network| network.heartbeat(nodes[0]) == Heartbeat::Active);
    let status = bench.network.status(nodes[0]).unwrap();
    assert_eq!((status.heartbeat_timeouts, status.boot_ups), (1, 1));
    assert_eq!(status.nmt_state, Some(NmtState::PreOperational));
    assert_eq!(status.guard_errors, GuardErrors::default());
}

#[test]
fn guarding_pause_lets_the_drive_lose_the_host() {
    let scenario = drives(1, |drive| drive.quirks.missing = vec![0x1016, 0x1017]);
    let mut bench = Bench::new(scenario);
    let node = bench.add_node(1, guarded());
    bench.until("the life sign", |network| network.heartbeat(node) == Heartbeat::Active);
    bench.write(node, (0x100C, 0), &20u16.to_le_bytes());
    bench.write(node, (0x100D, 0), &[3]);
    // No fault, so that the error clears with the next request.
    bench.write(node, (0x6007, 0), &0u16.to_le_bytes());
    bench.pass(100);
    bench.network.set_paused(0, 0, true);
    bench.pass(200);
    let status = bench.network.status(node).unwrap();
    assert_eq!(status.error_code, 0x8130, "life guarding");
    assert_eq!(status.heartbeat_timeouts, 0, "the host did not ask");
    bench.network.set_paused(0, 0, false);
    bench.pass(100);
    let status = bench.network.status(node).unwrap();
    assert_eq!((status.heartbeat, status.error_code), (Heartbeat::Active, 0));
}

#[test]
fn time_of_the_host_reaches_the_drive() {
    let mut bench = Bench::new(drives(1, |_| {}));
    let node = bench.add_node(1, NodeConfig::default());
    bench.pass(100);
    bench.write(node, (0x1012, 0), &0x8000_0100_u32.to_le_bytes());
    let clock = bench.port.adapter().ecrt().clock().clone();
    // 2026-11-24T13:45:00Z
    let reference = TimeReference { unix_ns: 1_795_527_900_000_000_000, bus_ns: clock.now_ns() };
    let config = TimeConfig { period: Duration::from_millis(100), reference };
    bench.network.set_time(Some(config)).unwrap();
    bench.pass(1_010);
    assert_eq!(bench.network.statistics().times_sent, 11);
    let time = bench.simulation().with_world(|world| world.drive("1").unwrap().time_of_day());
    let time = time.unwrap();
    assert_eq!(time.days(), 15_668);
    let after_ms = time.ms() - 49_500_000;
    assert!((1_000..1_010).contains(&after_ms), "{after_ms} ms");
}

fn run_steps(bench: &mut Bench, node: NodeHandle, steps: &[Step]) -> Result<(), WaitError> {
    let mut configurator = Configurator::new();
    configurator.add(&bench.network, node, steps.iter().copied());
    bench.network.configure_blocking(&mut bench.port, &mut configurator, LONG, |_| {})
}

#[test]
fn parameter_groups_are_stored_and_restored_one_by_one() {
    let mut bench = Bench::new(drives(1, |_| {}));
    let node = bench.add_node(1, NodeConfig::default());
    bench.pass(100);
    let default = bench.read(node, 0x6083, 0);
    let change = |bench: &mut Bench| {
        bench.write(node, (0x1015, 0), &77u16.to_le_bytes());
        bench.write(node, (0x6083, 0), &1_111u32.to_le_bytes());
    };
    let reset = [
        Step::device(NodeAction::Nmt(NmtCommand::ResetNode)),
        Step::device(NodeAction::AwaitBootUp { timeout: Duration::from_secs(1) }),
    ];
    let values = |bench: &mut Bench| (bench.read(node, 0x1015, 0), bench.read(node, 0x6083, 0));
    let (communication, application) = (ParameterGroup::Communication, ParameterGroup::Application);

    change(&mut bench);
    run_steps(&mut bench, node, &communication.store_steps()).unwrap();
    run_steps(&mut bench, node, &reset).unwrap();
    assert_eq!(values(&mut bench), (77, default));
    change(&mut bench);
    run_steps(&mut bench, node, &application.store_steps()).unwrap();
    run_steps(&mut bench, node, &reset).unwrap();
    assert_eq!(values(&mut bench), (77, 1_111));
    run_steps(&mut bench, node, &communication.restore_and_reset_steps(LONG)).unwrap();
    assert_eq!(values(&mut bench), (0, 1_111));
    run_steps(&mut bench, node, &ParameterGroup::All.restore_and_reset_steps(LONG)).unwrap();
    assert_eq!(values(&mut bench), (0, default));
    // A group that the drive does not have
    let error = run_steps(&mut bench, node, &ParameterGroup::Manufacturer(9).store_steps());
    assert_eq!(
        error.unwrap_err().to_string(),
        "node 1 (slave 0, channel 0), step 1 of 2, stores on command (check 0x1010:09): aborted by the node: \
         0x06090011 subindex does not exist"
    );
}

#[test]
fn error_history_is_read_newest_first_and_cleared() {
    let mut bench = Bench::new(drives(1, |_| {}));
    let node = bench.add_node(1, NodeConfig::default());
    bench.pass(100);
    for code in [0x4210, 0x2310] {
        let fault = ecan_sim::DriveFault::Emcy { code, register: 1 };
        bench.simulation().inject(ecan_sim::Fault::Drive { node: "1".to_owned(), fault });
        bench.pass(10);
    }
    let expected = [0x2310, 0x4210].map(|code| HistoryEntry { code, additional: 0 });
    let Bench { network, port, .. } = &mut bench;
    assert_eq!(network.error_history_blocking(port, node, LONG).unwrap(), expected);

    let mut configurator = Configurator::new();
    assert_eq!(ErrorHistory::uploaded(&configurator, node), None);
    configurator.add(network, node, ErrorHistory::steps(4));
    network.configure_blocking(port, &mut configurator, LONG, |_| {}).unwrap();
    assert_eq!(ErrorHistory::uploaded(&configurator, node).unwrap(), expected);
    configurator.clear(network);
    configurator.add(network, node, [ErrorHistory::clearing_step()]);
    configurator.add(network, node, ErrorHistory::steps(4));
    network.configure_blocking(port, &mut configurator, LONG, |_| {}).unwrap();
    assert_eq!(ErrorHistory::uploaded(&configurator, node).unwrap(), []);
}
