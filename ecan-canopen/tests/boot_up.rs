//! Boot-up of the drives of simulated gateways, in stepped time (CiA 302-2).

use std::sync::Arc;
use std::time::Duration;

use ecan_canopen::{
    BootConfig, BootError, BootPhase, BootProgress, BootReset, BootState, ConfigurationDate,
    GuardingConfig, Heartbeat, IdentityCheck, Network, NetworkConfig, NmtState, NodeAddress,
    NodeConfig, NodeHandle, NodeId, Parameter, ParameterError, ParameterSet, RevisionCheck, object,
    run_cycle_until,
};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_sim::{
    ClockKind, DriveConfig, DriveFault, Fault, NodeKind, Scenario, SimOptions, Simulation,
};

const LIMIT: Duration = Duration::from_secs(60);
const VENDOR: u32 = 0x5349_4D00;
const PRODUCT: u32 = 402;
const REVISION: u32 = 0x0001_0000;
const DATE: ConfigurationDate = ConfigurationDate { days: 15_668, milliseconds: 34_200_000 };

struct Fixture {
    port: Port,
    simulation: Simulation,
    network: Network,
    nodes: Vec<NodeHandle>,
    now_ns: u64,
}

/// Drives on all channels, each changed by `change`.
fn scenario(slaves: usize, per_channel: u8, change: impl Fn(&mut DriveConfig)) -> Scenario {
    let mut scenario = ecan_sim::drives(slaves, per_channel);
    for node in &mut scenario.nodes {
        if let NodeKind::Drive(drive) = &mut node.kind {
            change(&mut drive.config);
        }
    }
    scenario
}

fn name(address: NodeAddress) -> String {
    format!("drive {}.{}/{}", address.slave, address.channel, address.node)
}

impl Fixture {
    fn new(scenario: Scenario, slaves: usize) -> Self {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
        let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(1_000_000));
        let adapter = AdapterConfig::new(slaves as u16).with_cycle(Duration::from_millis(2));
        let mut port =
            Port::open(&backend.ecrt, (adapter, PortConfig::uniform(slaves, gateway))).unwrap();
        port.wait_ready().unwrap();
        Self {
            port,
            simulation: backend.simulation.unwrap(),
            network: Network::new(NetworkConfig::default()),
            nodes: Vec::new(),
            now_ns: 0,
        }
    }

    /// Adds nodes 1 to `per_channel` of every channel.
    fn add_all(
        &mut self,
        slaves: usize,
        per_channel: u8,
        config: impl Fn(NodeAddress) -> BootConfig,
    ) {
        for slave in 0..slaves {
            for channel in 0..4 {
                for node in (1..=per_channel).filter_map(NodeId::from_raw) {
                    let address = NodeAddress { slave, channel, node };
                    let handle = self.network.add_node(address, NodeConfig::default()).unwrap();
                    self.network.boot(handle, config(address));
                    self.nodes.push(handle);
                }
            }
        }
    }

    /// Runs until the condition holds.
    fn run_until(
        &mut self,
        what: &str,
        mut condition: impl FnMut(&Network, &[BootProgress]) -> bool,
    ) {
        let Self { port, network, now_ns, .. } = self;
        let ended = run_cycle_until(port, LIMIT, |cycle, now| {
            *now_ns = now;
            network.serve(cycle, now, |_| {});
            let progress: Vec<_> = network.boot_progress(now).collect();
            condition(network, &progress).then_some(())
        });
        if let Err(error) = ended {
            let texts: Vec<_> =
                self.network.boot_progress(self.now_ns).map(|node| node.to_string()).collect();
            panic!("{what}: {error}\n{}", texts.join("\n"));
        }
    }

    fn run_to_the_end(&mut self) -> BootState {
        self.run_until("end of the boot-up", |_, progress| {
            progress.iter().all(|node| matches!(node.phase, BootPhase::Booted | BootPhase::Failed))
        });
        self.network.boot_state()
    }

    fn text(&self, nth: usize) -> String {
        self.network.boot_progress_of(self.nodes[nth], self.now_ns).unwrap().to_string()
    }

    fn error(&self, nth: usize) -> BootError {
        let progress = self.network.boot_progress_of(self.nodes[nth], self.now_ns).unwrap();
        progress.error.unwrap_or_else(|| panic!("{}: no error", self.text(nth)))
    }

    fn object(&self, address: NodeAddress, index: u16, subindex: u8) -> Option<i64> {
        self.simulation
            .with_world(|world| world.drive(&name(address)).unwrap().object(index, subindex))
    }

    fn drive_fault(&self, address: NodeAddress, fault: DriveFault) {
        self.simulation.inject(Fault::Drive { node: name(address), fault });
    }
}

fn address(slave: usize, channel: u8, node: u8) -> NodeAddress {
    NodeAddress { slave, channel, node: NodeId::new(node).unwrap() }
}

fn identity() -> IdentityCheck {
    IdentityCheck {
        device_type: Some(0x0002_0192),
        vendor_id: Some(VENDOR),
        product_code: Some(PRODUCT),
        revision: RevisionCheck::Compatible(REVISION),
        serial_number: None,
    }
}

fn parameters(node: u8) -> ParameterSet {
    let value = |index, value: u32, name: &str| Parameter {
        name: Arc::from(name),
        ..Parameter::new((index, 0), value.to_le_bytes())
    };
    ParameterSet {
        parameters: vec![
            value(object::PROFILE_VELOCITY, 1_000 + u32::from(node), "Profile velocity"),
            value(object::PROFILE_ACCELERATION, 2_000, "Profile acceleration"),
            Parameter::new((0x2001, 0), *b"gripper, left"),
        ],
        date: None,
        saves: false,
    }
}

fn config(address: NodeAddress) -> BootConfig {
    BootConfig {
        identity: identity(),
        software: Some(1),
        parameters: Arc::new(parameters(address.node.get())),
        ..BootConfig::default()
    }
}

#[test]
fn forty_nodes_on_three_gateways_boot_in_parallel() {
    let mut fixture = Fixture::new(ecan_sim::drives(3, 4), 3);
    fixture.add_all(3, 4, config);
    assert_eq!(fixture.run_to_the_end(), BootState::Booted);
    let longest =
        fixture.network.boot_progress(fixture.now_ns).map(|node| node.elapsed).max().unwrap();
    assert!(longest < Duration::from_millis(500), "{longest:?}");
    for (nth, handle) in fixture.nodes.iter().enumerate() {
        let address = fixture.network.address(*handle).unwrap();
        let velocity = fixture.object(address, object::PROFILE_VELOCITY, 0);
        assert_eq!(velocity, Some(1_000 + i64::from(address.node.get())));
        assert_eq!(fixture.object(address, object::PRODUCER_HEARTBEAT, 0), Some(100));
        assert_eq!(fixture.network.nmt_state(*handle), Some(NmtState::Operational));
        let text = fixture.text(nth);
        assert!(text.contains("booted after") && text.contains("3 parameters"), "{text}");
    }
}

#[test]
fn wrong_identity_is_named_and_the_others_boot() {
    let mut fixture = Fixture::new(ecan_sim::drives(1, 1), 1);
    fixture.add_all(1, 1, |address| {
        let mut config = config(address);
        let identity = &mut config.identity;
        match address.channel {
            0 => identity.serial_number = Some(1_008),
            1 => identity.serial_number = Some(4),
            2 => identity.revision = RevisionCheck::Exactly(REVISION + 1),
            _ => identity.device_type = Some(0x0004_0191),
        }
        config
    });
    assert_eq!(fixture.run_to_the_end(), BootState::Failed);
    assert!(fixture.text(0).contains("booted"), "{}", fixture.text(0));
    let letters = [1, 2, 3].map(|nth| fixture.error(nth).cia302_status());
    assert_eq!(letters, ['O', 'N', 'C']);
    let text = fixture.text(1);
    for part in ["node 1 (slave 0, channel 1)", "(status O)", "serial number", "0x2B00", "0x4"] {
        assert!(text.contains(part), "{text}");
    }
    // Nothing was written to a node of another identity.
    let velocity = |channel| fixture.object(address(0, channel, 1), object::PROFILE_VELOCITY, 0);
    assert_eq!(velocity(0), Some(1_001));
    assert!((1..4).all(|channel| velocity(channel) != Some(1_001)));
}

#[test]
fn optional_and_absent_nodes_do_not_stop_the_network() {
    let mut fixture = Fixture::new(ecan_sim::drives(1, 1), 1);
    fixture.add_all(1, 2, |address| BootConfig {
        is_mandatory: address.node.get() == 1,
        boot_timeout: Duration::from_millis(700),
        ..config(address)
    });
    fixture
        .run_until("the mandatory nodes", |network, _| network.boot_state() == BootState::Booted);
    assert_eq!(fixture.run_to_the_end(), BootState::Booted);
    let error = fixture.error(1);
    assert!(matches!(error, BootError::NoResponse { .. }) && error.is_temporary(), "{error}");
    assert_eq!(error.cia302_status(), 'B');
}

#[test]
fn nodes_boot_in_their_order() {
    let mut fixture = Fixture::new(ecan_sim::drives(1, 3), 1);
    fixture
        .add_all(1, 3, |address| BootConfig { order: 4 - address.node.get(), ..config(address) });
    let mut violations = 0;
    fixture.run_until("all nodes", |network, progress| {
        for node in progress {
            let later = progress.iter().filter(|other| other.address.node < node.address.node);
            let has_begun = later.filter(|other| other.phase != BootPhase::Waiting).count() > 0;
            violations += usize::from(node.phase != BootPhase::Booted && has_begun);
        }
        network.boot_state() == BootState::Booted
    });
    assert_eq!(violations, 0);
}

#[test]
fn configuration_date_skips_an_unchanged_download() {
    let mut fixture = Fixture::new(ecan_sim::drives(1, 1), 1);
    let dated = |address: NodeAddress| BootConfig {
        reset: BootReset::Node,
        parameters: Arc::new(ParameterSet {
            date: Some(DATE),
            saves: true,
            ..parameters(address.node.get())
        }),
        ..config(address)
    };
    fixture.add_all(1, 1, dated);
    assert_eq!(fixture.run_to_the_end(), BootState::Booted);
    assert!(fixture.text(0).ends_with("3 parameters"), "{}", fixture.text(0));
    let again = |fixture: &mut Fixture| {
        for handle in fixture.nodes.clone() {
            fixture.network.boot_again(handle, fixture.now_ns);
        }
        fixture.run_to_the_end()
    };
    assert_eq!(again(&mut fixture), BootState::Booted);
    for nth in 0..4 {
        assert!(fixture.text(nth).ends_with("parameters unchanged"), "{}", fixture.text(nth));
    }
    // A newer configuration is written.
    let node = fixture.nodes[2];
    let mut newer = dated(address(0, 2, 1));
    let parameters = Arc::make_mut(&mut newer.parameters);
    parameters.date = Some(ConfigurationDate { milliseconds: 0, ..DATE });
    fixture.network.boot(node, newer);
    fixture.run_to_the_end();
    assert!(fixture.text(2).ends_with("3 parameters"), "{}", fixture.text(2));
    assert_eq!(fixture.object(address(0, 2, 1), object::CONFIGURATION_DATE, 2), Some(0));
}

#[test]
fn restored_node_has_defaults_before_its_parameters() {
    let mut fixture = Fixture::new(ecan_sim::drives(1, 1), 1);
    let velocity = Parameter::new((object::PROFILE_DECELERATION, 0), 77_u32.to_le_bytes());
    let set = ParameterSet { parameters: vec![velocity], saves: true, ..ParameterSet::default() };
    fixture.add_all(1, 1, |address| BootConfig {
        reset: BootReset::Node,
        parameters: Arc::new(set.clone()),
        ..config(address)
    });
    let first = address(0, 0, 1);
    let default = fixture.object(first, object::PROFILE_DECELERATION, 0);
    assert_eq!(fixture.run_to_the_end(), BootState::Booted);
    assert_eq!(fixture.object(first, object::PROFILE_DECELERATION, 0), Some(77));
    let node = fixture.nodes[0];
    let restored = BootConfig { restores: Some(1), ..config(first) };
    fixture.network.boot(node, restored);
    assert_eq!(fixture.run_to_the_end(), BootState::Booted);
    assert_eq!(fixture.object(first, object::PROFILE_DECELERATION, 0), default);
    assert_eq!(fixture.object(first, object::PROFILE_VELOCITY, 0), Some(1_001));
}

#[test]
fn value_that_the_node_rejects_or_changes_is_named() {
    let rule = |index, effect| ecan_sim::SdoRule {
        index,
        subindex: None,
        direction: ecan_sim::SdoDirection::Write,
        effect,
        times: None,
    };
    let abort = ecan_sim::SdoEffect::Abort(ecan_protocol::object::AbortCode::DEVICE_STATE);
    let scenario = scenario(1, 1, |drive| {
        if drive.serial % 100_000 < 10_000 {
            drive.quirks.sdo_rules.push(rule(object::PROFILE_ACCELERATION, abort));
        }
    });
    let mut fixture = Fixture::new(scenario, 1);
    fixture.add_all(1, 1, |address| {
        let mut config = config(address);
        if address.channel == 1 {
            // The configuration date is 0 after any other write.
            let downloads = &mut Arc::make_mut(&mut config.parameters).parameters;
            downloads
                .insert(0, Parameter::new((object::CONFIGURATION_DATE, 1), 5_u32.to_le_bytes()));
        }
        config
    });
    assert_eq!(fixture.run_to_the_end(), BootState::Failed);
    let text = fixture.text(0);
    for part in ["(status J)", "0x6083:00 (Profile acceleration)", "aborted by the node"] {
        assert!(text.contains(part), "{text}");
    }
    let BootError::Parameters(ParameterError::Mismatch { .. }) = fixture.error(1) else {
        panic!("{}", fixture.text(1))
    };
    assert!(fixture.text(1).contains("was written, 0x00000000 read back"), "{}", fixture.text(1));
    assert!(fixture.text(2).contains("booted") && fixture.text(3).contains("booted"));
}

#[test]
fn node_that_restarts_in_the_middle_of_the_download_boots_again() {
    let slow = scenario(1, 2, |drive| drive.sdo_delay_us = 10_000);
    let mut fixture = Fixture::new(slow, 1);
    fixture.add_all(1, 2, config);
    let restarting = address(0, 3, 2);
    let nth = 7;
    fixture.run_until("the download", |_, progress| {
        progress[nth].phase == BootPhase::Parameters && progress[nth].done == 1
    });
    fixture.drive_fault(restarting, DriveFault::PowerCycle { off_ms: 50 });
    assert_eq!(fixture.run_to_the_end(), BootState::Booted);
    let progress: Vec<_> = fixture.network.boot_progress(fixture.now_ns).collect();
    assert_eq!(progress.iter().map(|node| node.restarts).sum::<u32>(), progress[nth].restarts);
    assert_eq!(progress[nth].restarts, 1, "{}", progress[nth]);
    assert_eq!(fixture.object(restarting, object::PROFILE_VELOCITY, 0), Some(1_002));
}

#[test]
fn node_that_never_stops_restarting_fails() {
    let slow = scenario(1, 1, |drive| drive.sdo_delay_us = 10_000);
    let mut fixture = Fixture::new(slow, 1);
    fixture.add_all(1, 1, config);
    let mut cycles = 0;
    let simulation = fixture.simulation.clone();
    fixture.run_until("the end", |_, progress| {
        cycles += 1;
        if progress[0].phase == BootPhase::Parameters && cycles % 40 == 0 {
            let fault = DriveFault::PowerCycle { off_ms: 20 };
            simulation.inject(Fault::Drive { node: name(address(0, 0, 1)), fault });
        }
        progress[0].phase == BootPhase::Failed
    });
    assert_eq!(fixture.error(0), BootError::Restarts { restarts: 4 });
}

#[test]
fn booted_node_that_restarts_is_booted_again() {
    let mut fixture = Fixture::new(ecan_sim::drives(1, 2), 1);
    fixture.add_all(1, 2, config);
    assert_eq!(fixture.run_to_the_end(), BootState::Booted);
    let other = fixture.network.status(fixture.nodes[1]).unwrap();
    let lost = address(0, 0, 1);
    fixture.drive_fault(lost, DriveFault::PowerCycle { off_ms: 100 });
    fixture.run_until("the second boot-up", |_, progress| {
        progress[0].restarts == 1 && progress[0].phase == BootPhase::Booted
    });
    assert_eq!(fixture.object(lost, object::PROFILE_VELOCITY, 0), Some(1_001));
    assert_eq!(fixture.network.nmt_state(fixture.nodes[0]), Some(NmtState::Operational));
    let status = fixture.network.status(fixture.nodes[1]).unwrap();
    assert_eq!((status.boot_ups, status.nmt_state), (other.boot_ups, other.nmt_state));
}

#[test]
fn node_switched_on_late_boots() {
    let mut fixture = Fixture::new(ecan_sim::drives(1, 1), 1);
    let late = address(0, 1, 1);
    fixture.drive_fault(late, DriveFault::PowerCycle { off_ms: 3_000 });
    fixture.add_all(1, 1, |address| BootConfig {
        is_mandatory: address != late,
        boot_timeout: Duration::from_millis(500),
        ..config(address)
    });
    assert_eq!(fixture.run_to_the_end(), BootState::Booted);
    assert!(matches!(fixture.error(1), BootError::NoResponse { .. }));
    fixture.run_until("the late node", |_, progress| progress[1].phase == BootPhase::Booted);
    assert_eq!(fixture.object(late, object::PROFILE_VELOCITY, 0), Some(1_001));
}

#[test]
fn node_without_heartbeat_is_guarded() {
    let scenario = scenario(1, 1, |drive| drive.quirks.missing.push(object::PRODUCER_HEARTBEAT));
    let mut fixture = Fixture::new(scenario, 1);
    let guarding = GuardingConfig { guard_time: Duration::from_millis(20), life_time_factor: 3 };
    fixture.add_all(1, 1, |address| BootConfig {
        guarding: (address.channel > 0).then_some(guarding),
        is_mandatory: address.channel > 0,
        ..config(address)
    });
    assert_eq!(fixture.run_to_the_end(), BootState::Booted);
    assert_eq!(fixture.error(0).cia302_status(), 'K', "{}", fixture.text(0));
    for nth in 1..4 {
        assert_eq!(fixture.network.heartbeat(fixture.nodes[nth]), Heartbeat::Active);
        assert_eq!(fixture.network.nmt_state(fixture.nodes[nth]), Some(NmtState::Operational));
    }
}
