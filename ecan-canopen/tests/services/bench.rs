//! A gateway with simulated drives on its first channel, and the network of the host.

use std::time::Duration;

use ecan_canopen::{
    Configurator, LssAddress, LssCommand, LssFault, LssResult, Network, NetworkConfig, NodeAddress,
    NodeConfig, NodeHandle, NodeId, Step, WaitError, run_cycle_until,
};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_sim::{
    Backend, ClockKind, DriveConfig, DriveSpec, GatewaySpec, NodeKind, NodeSpec, Scenario,
    SimOptions, Simulation,
};

pub const LONG: Duration = Duration::from_secs(20);

pub fn node_id(id: u8) -> NodeId {
    NodeId::new(id).unwrap()
}

/// Drives on the first channel of a gateway, named by their serial number, 1 and up.
pub fn drives(count: u32, change: impl Fn(&mut DriveConfig)) -> Scenario {
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

pub fn identity(serial: u32) -> LssAddress {
    LssAddress { vendor: 0x5349_4D00, product: 402, revision: 0x0001_0000, serial }
}

pub struct Bench {
    pub backend: Backend,
    pub port: Port,
    pub network: Network,
}

impl Bench {
    pub fn new(scenario: Scenario) -> Self {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
        let port = open_port(&backend, 500_000);
        let mut network = Network::new(NetworkConfig::default());
        network.add_channel(0, 0).unwrap();
        Self { backend, port, network }
    }

    pub fn simulation(&self) -> &Simulation {
        self.backend.simulation.as_ref().unwrap()
    }

    pub fn lss(&mut self, command: LssCommand) -> Result<LssResult, WaitError> {
        self.network.blocking(&mut self.port, LONG).lss((0, 0), command)
    }

    pub fn lss_ok(&mut self, command: LssCommand) -> LssResult {
        self.lss(command).unwrap_or_else(|error| panic!("{error}"))
    }

    pub fn fault(&mut self, command: LssCommand) -> LssFault {
        match self.lss(command) {
            Err(WaitError::Lss(failure)) => failure.fault,
            other => panic!("{other:?}"),
        }
    }

    pub fn add_node(&mut self, id: u8, config: NodeConfig) -> NodeHandle {
        let address = NodeAddress { slave: 0, channel: 0, node: node_id(id) };
        self.network.add_node(address, config).unwrap()
    }

    pub fn until(&mut self, what: &str, mut done: impl FnMut(&mut Network) -> bool) {
        run_cycle_until(&mut self.port, LONG, |cycle, now_ns| {
            self.network.serve(cycle, now_ns, |network| done(network).then_some(()))
        })
        .unwrap_or_else(|error| panic!("{what}: {error}"));
    }

    pub fn pass(&mut self, cycles: usize) {
        let mut left = cycles;
        self.until("time", |_| {
            left -= 1;
            left == 0
        });
    }

    pub fn read(&mut self, node: NodeHandle, index: u16, subindex: u8) -> u64 {
        let data = self
            .network
            .blocking(&mut self.port, LONG)
            .upload(node, (index, subindex))
            .unwrap_or_else(|error| panic!("{error}"));
        data.iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte))
    }

    pub fn write(&mut self, node: NodeHandle, (index, subindex): (u16, u8), value: &[u8]) {
        self.network
            .blocking(&mut self.port, LONG)
            .download(node, (index, subindex), value)
            .unwrap_or_else(|error| panic!("{error}"));
    }
}

pub fn open_port(backend: &Backend, bit_per_s: u32) -> Port {
    let gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(bit_per_s));
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let mut port = Port::open(&backend.ecrt, (adapter, PortConfig::uniform(1, gateway))).unwrap();
    port.wait_ready().unwrap_or_else(|error| panic!("{error}"));
    port
}

pub fn run_steps(bench: &mut Bench, node: NodeHandle, steps: &[Step]) -> Result<(), WaitError> {
    let mut configurator = Configurator::new();
    configurator.add(&bench.network, node, steps.iter().copied());
    bench.network.blocking(&mut bench.port, LONG).configure(&mut configurator, |_| {})
}
