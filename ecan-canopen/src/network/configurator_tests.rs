//! Configurations of many nodes at once, against servers written by hand.

use std::collections::BTreeMap;
use std::time::Duration;

use ecan_protocol::can::CanId;
use ecan_protocol::object::AbortCode;
use proptest::prelude::*;

use super::network_tests::{MS, RecordingSink, address, cycle, received};
use super::{
    Configurator, Configuring, Expectation, Network, NetworkConfig, NodeAccessError, NodeAction,
    NodeConfig, NodeHandle, ParameterGroup, PdoDirection, PdoMapping, PdoMappingError, SdoConfig,
    SdoFault, Step, StepFault,
};
use crate::{MappingEntry, NmtCommand, NmtState, TransmissionType};

#[path = "../../tests/reference/mod.rs"]
mod reference;
use reference::{Block, Server};

/// Nodes behind a network, each a reference server that minds the rules of PDO objects.
struct Fixture {
    network: Network,
    handles: Vec<NodeHandle>,
    servers: Vec<Server>,
    sink: RecordingSink,
    now_ns: u64,
    /// Every SDO request, in text.
    trace: Vec<String>,
    /// Answers that get lost, by their number.
    lost: Vec<usize>,
    answers: usize,
}

const COUNT: u8 = 4;

impl Fixture {
    fn new() -> Self {
        let mut network = Network::new(NetworkConfig::default());
        let sdo = SdoConfig { timeout: Duration::from_millis(10), ..SdoConfig::default() };
        let settings = NodeConfig { sdo, ..NodeConfig::default() };
        let handles = (1..=COUNT)
            .map(|node| network.add_node(address(0, node % 2, node), settings).unwrap())
            .collect();
        let server = |node: u8| {
            Server::new(Block::Rejected(0x0504_0001))
                .with(0x1018, 1, &0x1234_u32.to_le_bytes())
                .with(0x1400, 1, &(0x4000_0200 + u32::from(node)).to_le_bytes())
                .with(0x1400, 2, &[255])
                .with(0x1600, 0, &[1])
                .with(0x1600, 1, &0x6040_0010_u32.to_le_bytes())
                .with(0x6060, 0, &[0])
                .with(0x60C2, 1, &[0])
        };
        Self {
            network,
            handles,
            servers: (1..=COUNT).map(server).collect(),
            sink: RecordingSink::new(),
            now_ns: 0,
            trace: Vec::new(),
            lost: Vec::new(),
            answers: 0,
        }
    }

    /// One cycle: the configuration, what goes out, what comes back.
    fn cycle(&mut self, configurator: &mut Configurator) -> Configuring {
        self.now_ns += MS;
        let outcome = configurator.step(&mut self.network, self.now_ns);
        cycle(&mut self.network, &mut self.sink, self.now_ns);
        for (slave, channel, id, data) in std::mem::take(&mut self.sink.sent) {
            let node = (id & 0x7F) as u8;
            if id & !0x7F != 0x600 {
                continue;
            }
            let frame: [u8; 8] = data.try_into().unwrap();
            let server = &mut self.servers[usize::from(node - 1)];
            let answers = match rejection(server, frame) {
                Some(answer) => vec![answer],
                None => server.request(frame),
            };
            self.trace.push(format!("{node} {}", text(frame)));
            for answer in answers {
                self.answers += 1;
                if !self.lost.contains(&(self.answers - 1)) {
                    let frame = received(slave, channel, 0x580 + u16::from(node), &answer);
                    assert!(self.network.take(&frame, self.now_ns));
                }
            }
        }
        outcome
    }

    fn run(&mut self, configurator: &mut Configurator) -> Configuring {
        for _ in 0..5_000 {
            match self.cycle(configurator) {
                Configuring::Running => {}
                outcome => return outcome,
            }
        }
        panic!("never done: {:?}", configurator.progress(self.now_ns).collect::<Vec<_>>());
    }

    fn trace_of(&self, node: u8) -> Vec<&str> {
        let mark = format!("{node} ");
        self.trace.iter().filter_map(|line| line.strip_prefix(&mark)).collect()
    }
}

/// The rules of CiA 301 for RPDO 1: its mapping changes only while the PDO does not exist and the
/// count is 0; the COB-ID changes only while the PDO does not exist.
fn rejection(server: &Server, frame: [u8; 8]) -> Option<[u8; 8]> {
    if frame[0] & 0xE0 != 0x20 {
        return None;
    }
    let key = (u16::from_le_bytes([frame[1], frame[2]]), frame[3]);
    let value = u32::from_le_bytes([frame[4], frame[5], frame[6], frame[7]]);
    let old = |index, subindex| {
        let mut bytes = [0; 4];
        let value = server.value(index, subindex);
        bytes[..value.len()].copy_from_slice(value);
        u32::from_le_bytes(bytes)
    };
    let exists = old(0x1400, 1) >> 31 == 0;
    let code = match key {
        (0x1400, 1) if exists && (value ^ old(0x1400, 1)) & 0x7FFF_FFFF != 0 => 0x0609_0030,
        (0x1400, 2) | (0x1600, _) if exists => 0x0800_0022,
        (0x1600, 1..) if old(0x1600, 0) != 0 => 0x0601_0003,
        _ => return None,
    };
    Some(reference::abort(key, code))
}

fn text(frame: [u8; 8]) -> String {
    let key = format!("{:04X}:{:02X}", u16::from_le_bytes([frame[1], frame[2]]), frame[3]);
    let value = u32::from_le_bytes([frame[4], frame[5], frame[6], frame[7]]);
    match frame[0] {
        0x40 => format!("read {key}"),
        0x80 => format!("abort {key}"),
        head => {
            let width = 2 * (4 - usize::from(head >> 2 & 3));
            format!("write {key} = {value:0width$X}")
        }
    }
}

fn targets(node: u8) -> PdoMapping {
    PdoMapping {
        direction: PdoDirection::Receive,
        number: 1,
        cob_id: CanId::standard(0x300 + u16::from(node)).unwrap(),
        transmission: TransmissionType::Synchronous(1),
        inhibit_time: None,
        event_timer_ms: None,
        sync_start: None,
        entries: vec![MappingEntry::new(0x6040, 0, 16), MappingEntry::new(0x607A, 0, 32)],
    }
}

#[test]
fn pdo_mapping_keeps_the_order_of_cia_301() {
    let mut fixture = Fixture::new();
    let mut configurator = Configurator::new();
    configurator.add(&fixture.network, fixture.handles[0], targets(1).steps().unwrap());
    assert_eq!(fixture.run(&mut configurator), Configuring::Done);
    assert_eq!(
        fixture.trace_of(1),
        [
            "read 1400:01",
            "write 1400:01 = C0000201",
            "write 1400:02 = 01",
            "write 1600:00 = 00",
            "write 1600:01 = 60400010",
            "write 1600:02 = 607A0020",
            "write 1600:00 = 02",
            "read 1400:02",
            "read 1600:00",
            "read 1600:01",
            "read 1600:02",
            "read 1400:01",
            "write 1400:01 = 40000301",
            "read 1400:01",
        ]
    );
    assert_eq!(targets(1).length(), 6);
}

#[test]
fn many_nodes_are_configured_in_parallel() {
    let mut fixture = Fixture::new();
    let mut alone = Configurator::new();
    alone.add(&fixture.network, fixture.handles[0], targets(1).steps().unwrap());
    fixture.run(&mut alone);
    let alone_ns = fixture.now_ns;
    let mut fixture = Fixture::new();
    let mut all = Configurator::new();
    for (node, handle) in (1..=COUNT).zip(&fixture.handles) {
        all.add(&fixture.network, *handle, targets(node).steps().unwrap());
    }
    assert_eq!(fixture.run(&mut all), Configuring::Done);
    assert_eq!(fixture.now_ns, alone_ns, "two channels, two frames a cycle each");
    for (node, server) in (1..=COUNT).zip(&fixture.servers) {
        assert_eq!(server.value(0x1400, 1), (0x4000_0300 + u32::from(node)).to_le_bytes());
    }
}

#[test]
fn rejected_step_stops_its_node_and_is_located() {
    let mut fixture = Fixture::new();
    fixture.servers[1].rejected.insert((0x1600, 2), 0x0604_0041);
    let mut configurator = Configurator::new();
    for (node, handle) in (1..=2).zip(&fixture.handles) {
        configurator.add(&fixture.network, *handle, targets(node).steps().unwrap());
    }
    let Configuring::Failed(failure) = fixture.run(&mut configurator) else {
        panic!("not rejected")
    };
    assert_eq!(
        failure.fault,
        StepFault::Access(NodeAccessError::Sdo(SdoFault::Aborted(AbortCode::NOT_MAPPABLE)))
    );
    assert_eq!(
        failure.to_string(),
        "node 2 (slave 0, channel 0), step 5 of 12, mapping (write 0x1600:02 = 0x607A0020): \
         aborted by the node: 0x06040041 object cannot be mapped to a PDO"
    );
    assert_eq!(configurator.failures().count(), 1);
    let first = configurator.progress_of(fixture.handles[0], fixture.now_ns).unwrap();
    assert_eq!(first.to_string(), "node 1 (slave 0, channel 1): all 12 steps done");
    assert!(fixture.trace_of(2).last().unwrap().contains("1600:02"), "nothing after the rejection");
}

#[test]
fn tolerated_step_ignores_a_missing_object() {
    let mut fixture = Fixture::new();
    fixture.servers[0].rejected.insert((0x60C2, 1), 0x0601_0002);
    fixture.servers[0].rejected.insert((0x1016, 1), 0x0602_0000);
    let steps = [
        Step::write(0x1016, 1, 0x007F_0064u32).if_present(),
        Step::write(0x60C2, 1, 1u8).if_accepted(),
        Step::read(0x1018, 1),
        Step::read(0x1018, 9).if_present(),
        Step::write(0x6060, 0, -1i8),
        Step::expect(0x6060, 0, -1i8),
        Step::expect(0x6060, 0, 8i8).if_accepted(),
    ];
    let mut configurator = Configurator::new();
    configurator.add(&fixture.network, fixture.handles[0], steps);
    assert_eq!(fixture.run(&mut configurator), Configuring::Done);
    let read = |subindex| configurator.uploaded(fixture.handles[0], 0x1018, subindex);
    assert_eq!((read(1), read(9), read(2)), (Some(0x1234), None, None));
    assert_eq!(fixture.servers[0].value(0x6060, 0), [0xFF]);

    let mut configurator = Configurator::new();
    configurator.add(
        &fixture.network,
        fixture.handles[0],
        [Step::write(0x60C2, 1, 1u8).if_present().named("interpolation time")],
    );
    let Configuring::Failed(failure) = fixture.run(&mut configurator) else { panic!("forgiven") };
    assert_eq!(
        failure.fault,
        StepFault::Access(NodeAccessError::Sdo(SdoFault::Aborted(AbortCode::READ_ONLY)))
    );
}

#[test]
fn expect_step_detects_another_value() {
    let mut fixture = Fixture::new();
    let mut configurator = Configurator::new();
    configurator.add(&fixture.network, fixture.handles[0], [Step::expect(0x1018, 1, 0x1235u32)]);
    let Configuring::Failed(failure) = fixture.run(&mut configurator) else { panic!("not found") };
    assert_eq!(failure.fault.to_string(), "value is 0x1234, expected 0x1235");
    let mut configurator = Configurator::new();
    configurator.add(
        &fixture.network,
        fixture.handles[0],
        [Step::expect_that(0x1018, 1, Expectation::Masked { value: 0x30, mask: 0xF0 })],
    );
    assert_eq!(fixture.run(&mut configurator), Configuring::Done);
}

fn nmt(command: NmtCommand) -> Step {
    Step::device(NodeAction::Nmt(command))
}

fn await_state(state: NmtState, timeout_ms: u64) -> Step {
    Step::device(NodeAction::AwaitState { state, timeout: Duration::from_millis(timeout_ms) })
}

#[test]
fn steps_wait_for_boot_up_and_states() {
    let mut fixture = Fixture::new();
    let (node, other) = (fixture.handles[0], fixture.handles[1]);
    // A boot-up message from before does not count.
    fixture.network.take(&received(0, 1, 0x701, &[0]), 0);
    let steps = [
        nmt(NmtCommand::ResetNode),
        Step::device(NodeAction::AwaitBootUp { timeout: Duration::from_secs(1) }).named("boot"),
        Step::pause(Duration::from_millis(10)),
        nmt(NmtCommand::Start),
        await_state(NmtState::Operational, 100),
    ];
    let mut configurator = Configurator::new();
    configurator.add(&fixture.network, node, steps);
    configurator.add(&fixture.network, other, steps);
    for _ in 0..500 {
        assert_eq!(fixture.cycle(&mut configurator), Configuring::Running);
    }
    let progress = configurator.progress_of(node, fixture.now_ns).unwrap();
    assert_eq!(
        progress.to_string(),
        "node 1 (slave 0, channel 1): step 2 of 5, boot (wait for the boot-up message), for 499 ms"
    );
    fixture.network.take(&received(0, 1, 0x701, &[0]), fixture.now_ns);
    for _ in 0..10 {
        fixture.cycle(&mut configurator);
    }
    assert_eq!(configurator.progress_of(node, fixture.now_ns).unwrap().done, 2, "the pause");
    for _ in 0..5 {
        fixture.cycle(&mut configurator);
    }
    fixture.network.take(&received(0, 1, 0x701, &[5]), fixture.now_ns);
    let Configuring::Failed(failure) = fixture.run(&mut configurator) else { panic!("no end") };
    assert_eq!(failure.address, address(0, 0, 2));
    assert_eq!(
        failure.fault,
        StepFault::Access(NodeAccessError::NoBootUp { waited: Duration::from_millis(1_001) })
    );
    assert_eq!(configurator.progress_of(node, fixture.now_ns).unwrap().done, 5);

    let mut configurator = Configurator::new();
    configurator.add(&fixture.network, node, [await_state(NmtState::Stopped, 20)]);
    let Configuring::Failed(failure) = fixture.run(&mut configurator) else { panic!("stopped") };
    assert_eq!(failure.fault.to_string(), "after 21 ms the node is still in state operational");
}

#[test]
fn transfer_of_the_application_delays_the_step() {
    let mut fixture = Fixture::new();
    let node = fixture.handles[0];
    fixture.network.start_upload(node, 0x6060, 0).unwrap();
    let mut configurator = Configurator::new();
    configurator.add(&fixture.network, node, [Step::read(0x1018, 1)]);
    assert_eq!(fixture.run(&mut configurator), Configuring::Done);
    assert_eq!(configurator.uploaded(node, 0x1018, 1), Some(0x1234));
    // And one that starts in the very cycle in which the step's answer has come.
    let mut configurator = Configurator::new();
    configurator.add(&fixture.network, node, [Step::read(0x1018, 1)]);
    fixture.cycle(&mut configurator);
    fixture.network.start_upload(node, 0x6060, 0).unwrap();
    assert_eq!(fixture.run(&mut configurator), Configuring::Done);
    assert_eq!(configurator.uploaded(node, 0x1018, 1), Some(0x1234), "not the other's value");
}

#[test]
fn clear_cancels_running_transfers() {
    let mut fixture = Fixture::new();
    let node = fixture.handles[0];
    let mut configurator = Configurator::new();
    configurator.add(&fixture.network, node, [Step::read(0x1018, 1)]);
    fixture.lost = vec![0];
    fixture.cycle(&mut configurator);
    configurator.clear(&mut fixture.network);
    assert_eq!(configurator.progress(0).count(), 0);
    assert_eq!(fixture.network.sdo_failure(node).unwrap().fault, SdoFault::Cancelled);
    fixture.cycle(&mut configurator);
    assert_eq!(fixture.servers[0].aborts, [0x0800_0000]);
}

#[test]
fn impossible_mapping_is_rejected() {
    let mut mapping = targets(1);
    mapping.number = 513;
    assert_eq!(mapping.steps(), Err(PdoMappingError::Number { number: 513 }));
    let mut mapping = targets(1);
    mapping.entries.push(MappingEntry::new(0x60B1, 0, 32));
    assert_eq!(mapping.steps(), Err(PdoMappingError::Size { bits: 80, entries: 3 }));
    mapping.entries.clear();
    assert_eq!(mapping.steps(), Err(PdoMappingError::Size { bits: 0, entries: 0 }));
    let mapping = PdoMapping { direction: PdoDirection::Transmit, number: 4, ..targets(1) };
    assert_eq!((mapping.communication_index(), mapping.mapping_index()), (0x1803, 0x1A03));
}

#[test]
fn disabling_steps_disable_a_pdo() {
    let mut fixture = Fixture::new();
    let mut configurator = Configurator::new();
    let steps = PdoMapping::disabling_steps(PdoDirection::Receive, 1).unwrap();
    configurator.add(&fixture.network, fixture.handles[2], steps);
    assert_eq!(fixture.run(&mut configurator), Configuring::Done);
    assert_eq!(fixture.servers[2].value(0x1400, 1), 0xC000_0203_u32.to_le_bytes());
}

#[test]
fn node_that_does_not_store_on_command_is_reported() {
    let mut fixture = Fixture::new();
    let node = fixture.handles[0];
    // Stores autonomously.
    fixture.servers[0].objects.insert((0x1010, 1), vec![2, 0, 0, 0]);
    let mut configurator = Configurator::new();
    configurator.add(&fixture.network, node, ParameterGroup::All.store_steps());
    let Configuring::Failed(failure) = fixture.run(&mut configurator) else { panic!("stored") };
    assert_eq!(
        failure.to_string(),
        "node 1 (slave 0, channel 1), step 1 of 2, stores on command (check 0x1010:01): value is 0x2, expected the bits \
         0x1"
    );
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 200,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    /// Lost answers and rejected frames delay a configuration; they never change its result, and
    /// no node gets its steps in another order.
    #[test]
    fn lossy_bus_only_delays_configurations(
        lost in proptest::collection::btree_set(0..70usize, 0..=2),
        room in proptest::collection::vec(0..4usize, 20),
    ) {
        let mut fixture = Fixture::new();
        fixture.lost = lost.into_iter().collect();
        let mut configurator = Configurator::new();
        for (node, handle) in (1..=COUNT).zip(&fixture.handles) {
            configurator.add(&fixture.network, *handle, targets(node).steps().unwrap());
        }
        let mut outcome = Configuring::Running;
        for at in 0..2_000 {
            fixture.sink.room_frames = room.get(at).copied().unwrap_or(4);
            outcome = fixture.cycle(&mut configurator);
            if outcome != Configuring::Running {
                break;
            }
        }
        prop_assert_eq!(outcome, Configuring::Done);
        for (node, server) in (1..=COUNT).zip(&fixture.servers) {
            let expected = (0x4000_0300 + u32::from(node)).to_le_bytes();
            prop_assert_eq!(server.value(0x1400, 1), expected);
            let mapping: BTreeMap<_, _> =
                server.objects.range((0x1600, 0)..(0x1601, 0)).collect();
            prop_assert_eq!(mapping.len(), 3);
            prop_assert_eq!(server.value(0x1600, 2), 0x607A_0020_u32.to_le_bytes());
            let mut writes = fixture.trace_of(node);
            writes.retain(|line| line.starts_with("write 1600"));
            writes.dedup();
            prop_assert_eq!(writes, [
                "write 1600:00 = 00",
                "write 1600:01 = 60400010",
                "write 1600:02 = 607A0020",
                "write 1600:00 = 02",
            ]);
        }
    }
}
