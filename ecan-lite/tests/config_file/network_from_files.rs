//! Networks that are described by files only, on simulated gateways in stepped time: from the start
//! to enabled axes and booted nodes.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use ecan_canopen::{
    BootPhase, BootState, Heartbeat, NodeAddress, NodeHandle, NodeId, object, run_cycle_until,
};
use ecan_cia402::{AxisCommand, AxisPhase, AxisRef, Cia402, Shutdown};
use ecan_lite::config::{load, load_axes, load_network_settings, load_nodes};
use ecan_mcan_port::Port;
use ecan_sim::{
    ClockKind, DriveConfig, DriveFault, DriveSpec, Fault, NodeKind, Scenario, SimOptions,
    Simulation,
};
use tempfile::TempDir;

const LIMIT: Duration = Duration::from_secs(60);

fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/network").join(name)
}

/// Gateways with four channels of 1 Mbit/s and a cycle of 2 ms.
fn gateways(count: usize) -> String {
    let channels: String =
        (0..4).map(|channel| format!("can{channel} = {{ bitrate = 1_000_000 }}\n")).collect();
    format!("cycle_us = 2000\n{}", format!("[[gateway]]\nn = 4\n{channels}").repeat(count))
}

struct Machine {
    _directory: TempDir,
    port: Port,
    simulation: Simulation,
    cia402: Cia402,
    /// Handles of the nodes without an axis.
    nodes: BTreeMap<String, NodeHandle>,
    now_ns: u64,
}

fn name(address: NodeAddress) -> String {
    format!("drive {}.{}/{}", address.slave, address.channel, address.node)
}

fn has_failed(cia402: &Cia402, axis: usize) -> bool {
    cia402.axis(axis).unwrap().error().is_some()
}

impl Machine {
    fn new(scenario: Scenario, text: &str) -> Self {
        let directory = tempfile::tempdir().unwrap();
        for file in ["servo_drive.eds", "gripper.eds"] {
            std::fs::copy(example(file), directory.path().join(file)).unwrap();
        }
        let path = directory.path().join("machine.toml");
        std::fs::write(&path, text).unwrap();
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
        let file = load(&path).unwrap_or_else(|error| panic!("{error}"));
        let mut port = Port::open(&backend.ecrt, (file.adapter, file.port)).unwrap();
        port.wait_ready().unwrap();
        let axes = load_axes(&path).unwrap();
        let settings = load_network_settings(&path).unwrap();
        let node_config = settings.cia402.node;
        let mut cia402 = Cia402::new(&port, axes, settings.cia402).unwrap();
        let mut nodes = BTreeMap::new();
        for node in load_nodes(&path).unwrap() {
            let network = cia402.network_mut();
            let handle = network.add_node(node.address, node_config).unwrap();
            network.boot(handle, node.boot_config().unwrap());
            nodes.insert(node.title(), handle);
        }
        let simulation = backend.simulation.unwrap();
        Self { _directory: directory, port, simulation, cia402, nodes, now_ns: 0 }
    }

    /// Runs until the condition holds.
    fn run_until(
        &mut self,
        what: &str,
        mut condition: impl FnMut(&mut Cia402) -> bool,
    ) -> Duration {
        let Self { port, cia402, now_ns, .. } = self;
        let begin = port.adapter().clock().now_ns();
        let ended = run_cycle_until(port, LIMIT, |cycle, now| {
            *now_ns = now;
            cia402.process_rx(cycle);
            let is_over = condition(cia402);
            cia402.send_targets_all(cycle);
            is_over.then_some(())
        });
        if let Err(error) = ended {
            let mut text = format!("{what}: {error}");
            for axis in self.cia402.axes().map(AxisRef::progress) {
                let _ = write!(text, "\n{axis}");
            }
            for node in self.cia402.network().boot_progress(self.now_ns) {
                let _ = write!(text, "\n{node}");
            }
            panic!("{text}");
        }
        Duration::from_nanos(self.now_ns - begin)
    }

    /// Every axis is configured or has failed.
    fn configure(&mut self) -> Duration {
        // The first contact with the drives.
        self.cia402.command_all(AxisCommand::Configure).unwrap();
        self.run_until("configuration", |cia402| {
            (0..cia402.axis_count())
                .all(|axis| cia402.axis(axis).unwrap().is_configured() || has_failed(cia402, axis))
        })
    }

    fn object(&self, address: NodeAddress, index: u16, subindex: u8) -> Option<i64> {
        self.simulation
            .with_world(|world| world.drive(&name(address)).unwrap().object(index, subindex))
    }
}

/// Drives made from the device file, with a serial number by address.
fn drives_from_file(slaves: usize, change: impl Fn(&mut DriveConfig, usize)) -> Scenario {
    let mut scenario = ecan_sim::drives(slaves, 4);
    for (nth, node) in scenario.nodes.iter_mut().enumerate() {
        if let NodeKind::Drive(drive) = &mut node.kind {
            let DriveSpec { config, eds } = drive.as_mut();
            *eds = Some(example("servo_drive.eds"));
            change(config, nth);
        }
    }
    scenario
}

/// `[[node]]` tables of forty drives: four on the channels of the first gateway, three on the others.
fn forty_drives() -> String {
    let mut text = gateways(3);
    for slave in 0..3 {
        for channel in 0..4 {
            for node in 1..=(if slave == 0 { 4 } else { 3 }) {
                let _ = write!(
                    text,
                    "[[node]]\nname = \"joint {slave}.{channel}.{node}\"\ngateway = {slave}\n\
                     channel = {channel}\nnode = {node}\ndevice_file = \"servo_drive.eds\"\n\
                     revision = \"compatible\"\nserial_number = {}\n\
                     [node.parameters]\n\"Following error window\" = {}\nLabel = \"joint {node}\"\n\
                     [node.axis]\nsteps_per_turn = 65536\n",
                    serial(slave, channel, node),
                    20_000 + node
                );
            }
        }
    }
    text
}

/// Of the built-in scenario `drives`.
fn serial(slave: usize, channel: usize, node: usize) -> usize {
    100_000 * slave + 10_000 * channel + 1_000 * node + 8
}

#[test]
fn forty_drives_start_from_files_in_parallel() {
    let mut machine = Machine::new(drives_from_file(3, |_, _| {}), &forty_drives());
    assert_eq!(machine.cia402.axis_count(), 40);
    let configured = machine.configure();
    let errors: Vec<_> =
        machine.cia402.axes().map(AxisRef::progress).filter(|axis| axis.error.is_some()).collect();
    assert!(errors.is_empty(), "{errors:?}");
    machine.cia402.command_all(AxisCommand::ReadPosition).unwrap();
    machine.run_until("positions", |cia402| {
        cia402.axes().all(|axis| axis.phase() == AxisPhase::Ready)
    });
    machine.cia402.command_all(AxisCommand::Enable).unwrap();
    let enabled = machine.run_until("enabling", |cia402| cia402.all_running());
    println!("forty drives: configured after {configured:?}, enabled after {enabled:?}");
    for axis in 0..40 {
        let address = machine.cia402.axis(axis).unwrap().config().address;
        let window = machine.object(address, object::FOLLOWING_ERROR_WINDOW, 0);
        assert_eq!(window, Some(20_000 + i64::from(address.node.get())));
    }
    assert!(configured < Duration::from_secs(3), "{configured:?}");
}

#[test]
fn wrong_and_restarting_drives_are_named_and_the_others_run() {
    const REPLACED: usize = 5;
    let scenario = drives_from_file(3, |drive, nth| {
        drive.sdo_delay_us = 3_000;
        if nth == REPLACED {
            drive.serial = 4_711;
        }
    });
    let mut text = forty_drives();
    let newer = format!("serial_number = {}\n", serial(2, 1, 2));
    text = text.replace(&newer, &format!("{newer}revision_number = 0x0001_0001\n"));
    let mut machine = Machine::new(scenario, &text);
    let restarting = NodeAddress { slave: 1, channel: 2, node: NodeId::new(3).unwrap() };
    machine.cia402.command_all(AxisCommand::Configure).unwrap();
    let axis_of = |cia402: &Cia402, address: NodeAddress| {
        (0..cia402.axis_count())
            .find(|axis| cia402.axis(*axis).unwrap().config().address == address)
    };
    let axis = axis_of(&machine.cia402, restarting).unwrap();
    machine.run_until("its download", |cia402| {
        cia402.axis(axis).unwrap().progress().to_string().contains("write the parameters")
    });
    machine.simulation.inject(Fault::Drive {
        node: name(restarting),
        fault: DriveFault::PowerCycle { off_ms: 50 },
    });
    machine.run_until("configuration", |cia402| {
        (0..40).all(|axis| cia402.axis(axis).unwrap().is_configured() || has_failed(cia402, axis))
    });
    let texts: Vec<String> = machine
        .cia402
        .axes()
        .map(AxisRef::progress)
        .filter(|axis| axis.error.is_some())
        .map(|axis| axis.to_string())
        .collect();
    let expected = [
        ("node 2 (slave 0, channel 1)", "serial number"),
        ("node 3 (slave 1, channel 2)", "restarted"),
        ("node 2 (slave 2, channel 1)", "revision number"),
    ];
    assert_eq!(texts.len(), expected.len(), "{texts:#?}");
    for (text, (node, reason)) in texts.iter().zip(expected) {
        assert!(text.contains(node) && text.contains(reason), "{text}");
    }
    // The restarted drive is configured again, the others run.
    machine.run_until("its boot-up", |cia402| {
        let network = cia402.network();
        let handle = network.find(restarting).unwrap();
        network.status(handle).unwrap().boot_ups > 0
    });
    machine.cia402.axis_mut(axis).unwrap().configure().unwrap();
    machine.run_until("its configuration", |cia402| cia402.axis(axis).unwrap().is_configured());
    let running: Vec<_> =
        (0..40).filter(|axis| machine.cia402.axis(*axis).unwrap().is_configured()).collect();
    assert_eq!(running.len(), 38);
    for axis in &running {
        machine.cia402.axis_mut(*axis).unwrap().read_position().unwrap();
    }
    machine.run_until("positions", |cia402| {
        running.iter().all(|axis| cia402.axis(*axis).unwrap().phase() == AxisPhase::Ready)
    });
    for axis in &running {
        machine.cia402.axis_mut(*axis).unwrap().enable().unwrap();
    }
    machine.run_until("enabling", |cia402| {
        running.iter().all(|axis| cia402.axis(*axis).unwrap().is_running())
    });
}

#[test]
fn nodes_boot_in_parallel_with_axes() {
    let mut scenario = drives_from_file(1, |_, _| {});
    for (nth, node) in scenario.nodes.iter_mut().enumerate() {
        if let NodeKind::Drive(drive) = &mut node.kind
            && nth % 4 == 3
        {
            drive.eds = Some(example("gripper.eds"));
        }
    }
    let mut text = gateways(1);
    for channel in 0..4 {
        let _ = write!(
            text,
            "[[node]]\ngateway = 0\nchannel = {channel}\nnode = 1\n\
             device_file = \"servo_drive.eds\"\n[node.axis]\nsteps_per_turn = 65536\n\
             [[node]]\nname = \"gripper {channel}\"\ngateway = 0\nchannel = {channel}\nnode = 4\n\
             device_file = \"gripper.eds\"\nheartbeat_ms = 0\nguard_time_ms = 20\n\
             parameters = {{ \"Grip force\" = 120 }}\n\
             [[node.rpdo]]\nnumber = 1\ntransmission = 1\nobjects = [\"Grip force\"]\n\
             [[node.tpdo]]\nnumber = 1\ntransmission = 1\nobjects = [\"Jaw position\"]\n"
        );
    }
    let mut machine = Machine::new(scenario, &text);
    machine.cia402.command_all(AxisCommand::Configure).unwrap();
    machine.run_until("axes and nodes", |cia402| {
        cia402.network().boot_state() == BootState::Booted
            && (0..4).all(|axis| cia402.axis(axis).unwrap().is_configured())
    });
    let progress: Vec<_> = machine.cia402.network().boot_progress(machine.now_ns).collect();
    assert!(progress.iter().all(|node| node.phase == BootPhase::Booted), "{progress:?}");
    assert_eq!(machine.nodes.len(), 4);
    for channel in 0..4 {
        let gripper = NodeAddress { slave: 0, channel, node: NodeId::new(4).unwrap() };
        assert_eq!(machine.object(gripper, 0x2000, 0), Some(120));
        assert_eq!(machine.object(gripper, 0x1600, 1), Some(0x2000_0010));
    }
}

#[test]
fn axes_of_a_node_start_from_a_file() {
    let mut scenario = ecan_sim::drives(1, 4);
    for node in &mut scenario.nodes {
        if let NodeKind::Drive(drive) = &mut node.kind {
            drive.config.axes = 2;
        }
    }
    let text = gateways(1)
        + "[[node]]\nname = \"gantry\"\ngateway = 0\nchannel = 0\nnode = 1\n\
           [[node.axis]]\nsteps_per_turn = 65536\n\
           [[node.axis]]\nsteps_per_turn = 65536\npdo_number = 65\nrpdo_cob_ids = [0x341]\n\
           tpdo_cob_ids = [0x2C1]\n\
           [[axis]]\ngateway = 0\nchannel = 1\nnode = 2\n\
           [[axis]]\ngateway = 0\nchannel = 1\nnode = 2\nnode_axis = 1\npdo_number = 2\n";
    let mut machine = Machine::new(scenario, &text);
    assert!(machine.nodes.is_empty());
    machine.configure();
    machine.cia402.command_all(AxisCommand::ReadPosition).unwrap();
    machine.run_until("positions", |cia402| {
        cia402.axes().all(|axis| axis.phase() == AxisPhase::Ready)
    });
    machine.cia402.command_all(AxisCommand::Enable).unwrap();
    machine.run_until("enabling", |cia402| cia402.all_running());
    let drive = |channel, node| NodeAddress { slave: 0, channel, node: NodeId::new(node).unwrap() };
    let (gantry, other) = (drive(0, 1), drive(1, 2));
    assert_eq!(machine.object(gantry, 0x1440, 1), Some(0x341));
    assert_eq!(machine.object(gantry, 0x1640, 2), Some(0x687A_0020));
    assert_eq!(machine.object(other, 0x1601, 2), Some(0x687A_0020));

    // One axis of each node moves by its targets, the others stay. Tables `[[axis]]` come first.
    let moved = [false, true, true, false];
    let start = [0, 1, 2, 3].map(|axis| machine.cia402.axis(axis).unwrap().actual().unwrap());
    machine.run_until("the motion", |cia402| {
        let mut is_there = true;
        for axis in (0..4).filter(|axis| moved[*axis]) {
            let target = start[axis] + 300;
            cia402.axis_mut(axis).unwrap().set_target(target).unwrap();
            is_there &= cia402
                .axis(axis)
                .unwrap()
                .actual()
                .is_some_and(|actual| actual.abs_diff(target) <= 5);
        }
        is_there
    });
    let drives = [(other, 0x6064), (other, 0x6864), (gantry, 0x6064), (gantry, 0x6864)];
    for (((address, index), start), is_moved) in drives.into_iter().zip(start).zip(moved) {
        let distance = machine.object(address, index, 0).unwrap() - i64::from(start);
        let expected = if is_moved { 295..=305 } else { -5..=5 };
        assert!(expected.contains(&distance), "{address}, 0x{index:04X}: {distance}");
    }
}

#[test]
fn drives_without_heartbeat_are_guarded() {
    let mut scenario = ecan_sim::drives(1, 4);
    for node in &mut scenario.nodes {
        if let NodeKind::Drive(drive) = &mut node.kind {
            let heartbeats = [object::CONSUMER_HEARTBEAT, object::PRODUCER_HEARTBEAT];
            drive.config.quirks.missing.extend(heartbeats);
        }
    }
    let text = gateways(1)
        + "[network]\nsync_cycles = 2\nsync_counter = 10\nhost_heartbeat_ms = 0\n"
        + "[[axis]]\ngateway = 0\nchannel = 0\nnode = 1\nheartbeat_ms = 0\nguard_time_ms = 20\n"
        + "life_time_factor = 4\n"
        + "[[node]]\ngateway = 0\nchannel = 1\nnode = 2\nheartbeat_ms = 0\nguard_time_ms = 30\n"
        + "[node.axis]\nmode = \"csp\"\n";
    let mut machine = Machine::new(scenario, &text);
    machine.configure();
    machine.cia402.command_all(AxisCommand::ReadPosition).unwrap();
    machine.run_until("positions", |cia402| {
        cia402.axes().all(|axis| axis.phase() == AxisPhase::Ready)
    });
    machine.cia402.command_all(AxisCommand::Enable).unwrap();
    machine.run_until("enabling", |cia402| cia402.all_running());
    let drives = [(0, 1), (1, 2)].map(|(channel, node)| NodeAddress {
        slave: 0,
        channel,
        node: NodeId::new(node).unwrap(),
    });
    let times = drives.map(|drive| {
        (
            machine.object(drive, object::GUARD_TIME, 0),
            machine.object(drive, object::LIFE_TIME_FACTOR, 0),
        )
    });
    assert_eq!(times, [(Some(20), Some(4)), (Some(30), Some(3))]);
    let life = |machine: &Machine| {
        let network = machine.cia402.network();
        drives.map(|node| network.status(network.find(node).unwrap()).unwrap().heartbeat)
    };
    assert_eq!(life(&machine), [Heartbeat::Active; 2]);
    let fault = DriveFault::PowerCycle { off_ms: 60_000 };
    machine.simulation.inject(Fault::Drive { node: name(drives[0]), fault });
    machine.run_until("the end of its life time", |cia402| {
        let network = cia402.network();
        let handle = network.find(drives[0]).unwrap();
        network.status(handle).unwrap().heartbeat == Heartbeat::TimedOut
    });
    assert_eq!(
        life(&machine),
        [Heartbeat::TimedOut, Heartbeat::Active],
        "the other one is guarded"
    );
    assert!(
        !machine.cia402.axis(0).unwrap().is_running()
            && machine.cia402.axis(1).unwrap().is_running()
    );

    // A released drive does not react to the end of the host.
    machine.cia402.begin_shutdown();
    machine.run_until("the shutdown", |cia402| cia402.shutdown_state() == Shutdown::Done);
    assert_eq!(machine.object(drives[1], object::LIFE_TIME_FACTOR, 0), Some(0));
}
