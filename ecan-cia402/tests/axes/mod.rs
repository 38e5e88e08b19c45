//! Axes behind simulated gateways, in stepped time, and the drives' own testimony about them.
#![allow(dead_code)]

use std::time::Duration;

use ecan_canopen::{NodeAddress, NodeId};
use ecan_cia402::{AxisConfig, AxisHandle, AxisRef, Cia402, Cia402Config};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{
    ChannelConfig, Cycle, GatewayConfig, Port, PortConfig, Session, SlaveStatistics,
};
use ecan_sim::{
    ClockKind, Drive, DriveAxis, DriveConfig, DriveFault, DriveQuirks, Fault, NodeKind, Scenario,
    SimOptions, Simulation, TargetRecord,
};

pub const START: Duration = Duration::from_secs(10);

pub fn node(id: u8) -> NodeId {
    NodeId::new(id).unwrap()
}

pub fn address(slave: usize, channel: u8, id: u8) -> NodeAddress {
    NodeAddress { slave, channel, node: node(id) }
}

pub fn axis(slave: usize, channel: u8, id: u8) -> AxisConfig {
    AxisConfig::new(address(slave, channel, id))
}

/// The first `count` axes of the built-in scenario `drives`, on as few channels as possible.
pub fn axes(count: usize) -> Vec<AxisConfig> {
    (0..count).map(|n| axis(n / 16, (n / 4 % 4) as u8, (n % 4) as u8 + 1)).collect()
}

/// Number of cases of a property test: few, unless the environment asks for many, which proptest
/// obeys only where no number is given.
pub fn cases(few: u32) -> u32 {
    let many = std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok());
    many.unwrap_or(few)
}

pub struct Fixture {
    pub port: Port,
    pub cia402: Cia402,
    pub simulation: Simulation,
}

/// The scenario `drives` for these axes, each drive changed by `change`.
pub fn scenario(slaves: usize, change: impl Fn(&mut DriveConfig)) -> Scenario {
    let mut scenario = ecan_sim::drives(slaves, 4);
    for node in &mut scenario.nodes {
        if let NodeKind::Drive(drive) = &mut node.kind {
            change(&mut drive.config);
        }
    }
    scenario
}

pub fn with_quirk(slaves: usize, id: u8, quirk: impl Fn(&mut DriveQuirks)) -> Scenario {
    scenario(slaves, |settings| {
        if settings.node.get() == id {
            quirk(&mut settings.quirks);
        }
    })
}

impl Fixture {
    /// One gateway, one channel's drives, 2 ms.
    pub fn single(axes: Vec<AxisConfig>) -> Self {
        Self::with(ecan_sim::drives(1, 4), axes)
    }

    pub fn with(scenario: Scenario, axes: Vec<AxisConfig>) -> Self {
        Self::open(scenario, AdapterConfig::new(1).with_cycle(Duration::from_millis(2)), axes)
    }

    pub fn open(scenario: Scenario, adapter: AdapterConfig, axes: Vec<AxisConfig>) -> Self {
        Self::open_with(scenario, adapter, axes, Cia402Config::default())
    }

    pub fn open_with(
        scenario: Scenario,
        adapter: AdapterConfig,
        axes: Vec<AxisConfig>,
        settings: Cia402Config,
    ) -> Self {
        let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
        Self::open_on(scenario, adapter, gateway, axes, settings)
    }

    pub fn open_on(
        scenario: Scenario,
        adapter: AdapterConfig,
        gateway: GatewayConfig,
        axes: Vec<AxisConfig>,
        settings: Cia402Config,
    ) -> Self {
        let slaves = adapter.slaves.len();
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
        let config = PortConfig::uniform(slaves, gateway);
        let mut port =
            Port::open(&backend.ecrt, (adapter, config)).unwrap_or_else(|e| panic!("{e}"));
        port.wait_ready().unwrap_or_else(|e| panic!("{e}"));
        let cia402 = Cia402::new(&port, axes, settings).unwrap_or_else(|e| panic!("{e}"));
        Self { port, cia402, simulation: backend.simulation.unwrap() }
    }

    /// State of an axis.
    pub fn axis(&self, index: usize) -> AxisRef<'_> {
        self.cia402.axis(index).unwrap()
    }

    /// Commands to an axis.
    pub fn axis_mut(&mut self, index: usize) -> AxisHandle<'_> {
        self.cia402.axis_mut(index).unwrap()
    }

    /// Started: every axis follows targets.
    pub fn start(&mut self) {
        let started = self.cia402.blocking(&mut self.port, START).start_up();
        started.unwrap_or_else(|error| panic!("{error}"));
    }

    pub fn started(mut self) -> Self {
        self.start();
        self
    }

    /// Session of the first gateway.
    pub fn session(&self) -> Session {
        self.port.session(self.port.gateway(0).unwrap())
    }

    /// Counters of the first gateway.
    pub fn statistics(&self) -> SlaveStatistics {
        self.port.statistics(self.port.gateway(0).unwrap())
    }

    pub fn now_ns(&self) -> u64 {
        self.port.adapter().clock().now_ns()
    }

    /// One cycle when it is due: everything in, `work`, everything out. An error of the cycle is
    /// what a bus with faults has.
    pub fn cycle_with<T>(&mut self, work: impl FnOnce(&mut Cia402, &mut Cycle<'_>) -> T) -> T {
        let mut cycle = self.port.next_cycle();
        self.cia402.process_rx(&mut cycle);
        work(&mut self.cia402, &mut cycle)
    }

    /// One cycle in which every axis makes its step.
    pub fn step(&mut self) {
        self.cycle_with(|cia402, cycle| cia402.send_target_step(cycle));
    }

    pub fn steps(&mut self, cycles: usize) {
        (0..cycles).for_each(|_| self.step());
    }

    /// One cycle at the application's targets.
    pub fn idle(&mut self, cycles: usize) {
        for _ in 0..cycles {
            self.cycle_with(|cia402, cycle| cia402.send_targets_all(cycle));
        }
    }

    /// Cycles in which nobody receives; `sends` steps all the same.
    pub fn skip(&mut self, cycles: usize, sends: bool) {
        for _ in 0..cycles {
            let mut cycle = self.port.next_cycle();
            if sends {
                self.cia402.send_target_step(&mut cycle);
            }
        }
    }

    /// Cycles with steps until `done`; the number run, or a panic with what the axes do.
    pub fn until(&mut self, limit: usize, done: impl Fn(&Cia402) -> bool) -> usize {
        for cycle in 0..limit {
            if done(&self.cia402) {
                return cycle;
            }
            self.step();
        }
        let axes: Vec<String> =
            self.cia402.axes().map(|axis| axis.progress().to_string()).collect();
        panic!("not after {limit} cycles: {axes:#?}");
    }

    pub fn drive<T>(&self, axis: usize, look: impl FnOnce(&Drive) -> T) -> T {
        let address = self.axis(axis).config().address;
        self.simulation.with_world(|world| {
            let drive = world.drive_at(address.slave, usize::from(address.channel), address.node);
            look(drive.expect("a drive at every axis"))
        })
    }

    /// The axis of the drive that an axis of the table commands.
    pub fn drive_axis<T>(&self, axis: usize, look: impl FnOnce(DriveAxis<'_>) -> T) -> T {
        let number = usize::from(self.axis(axis).config().node_axis);
        self.drive(axis, |drive| look(drive.axis(number).expect("an axis of the drive")))
    }

    pub fn history(&self, axis: usize) -> Vec<TargetRecord> {
        self.drive_axis(axis, |drive| drive.targets().iter().copied().collect())
    }

    pub fn inject(&self, fault: Fault) {
        self.simulation.inject(fault);
    }

    /// A fault in the drive of an axis.
    pub fn strike(&self, axis: usize, fault: DriveFault) {
        let address = self.axis(axis).config().address;
        let node = self.simulation.with_world(|world| {
            let (slave, channel) = (address.slave, usize::from(address.channel));
            world.drive_name(slave, channel, address.node).unwrap().to_owned()
        });
        self.inject(Fault::Drive { node, fault });
    }

    /// By the drives' own testimony: nothing jumped.
    pub fn check(&self) {
        for axis in 0..self.cia402.axis_count() {
            let config = self.axis(axis).config();
            let sums = self.drive_axis(axis, |drive| *drive.targets().sums());
            let text = format!("axis {axis}: {sums:?}");
            assert!(sums.largest_first_offset <= 2 * config.standstill, "first target, {text}");
            assert!(sums.largest_step <= config.step_limit, "step, {text}");
            assert!(sums.largest_offset <= config.following_window, "window, {text}");
            assert_eq!(sums.outside_window, 0, "the drive's window, {text}");
        }
    }
}
