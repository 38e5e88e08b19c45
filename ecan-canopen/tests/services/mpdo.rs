//! Multiplexed PDOs.

use ecan_canopen::{
    CobId, DispatcherEntry, Mpdo, MpdoAddress, MpdoConfig, MpdoMode, NmtCommand, NodeAction,
    NodeConfig, PdoDirection, ScannerEntry, Step, run_cycle_until,
};
use ecan_protocol::can::FrameRef;

use super::bench::{Bench, LONG, drives, node_id, run_steps};

/// CAN ID of the MPDOs to all drives: RPDO 2 of node 127, which does not exist.
fn to_drives() -> CobId {
    CobId::rpdo(node_id(127), 2)
}

fn consumer() -> MpdoConfig {
    MpdoConfig {
        direction: PdoDirection::Receive,
        number: 2,
        cob_id: to_drives().can_id(),
        inhibit_time: None,
        mode: MpdoMode::Destination,
    }
}

fn producer(id: u8, entries: Vec<ScannerEntry>) -> MpdoConfig {
    MpdoConfig {
        direction: PdoDirection::Transmit,
        number: 3,
        cob_id: CobId::tpdo(node_id(id), 3).can_id(),
        inhibit_time: Some(0),
        mode: MpdoMode::Scanner(entries),
    }
}

#[test]
fn host_writes_objects_of_one_and_of_all_drives() {
    let mut bench = Bench::new(drives(3, |_| {}));
    let nodes = [1, 2, 3].map(|id| bench.add_node(id, NodeConfig::default()));
    bench.pass(100);
    let start = Step::device(NodeAction::Nmt(NmtCommand::Start));
    for node in nodes {
        let mut steps = consumer().steps().unwrap();
        steps.push(start);
        run_steps(&mut bench, node, &steps).unwrap();
    }
    let send = |bench: &mut Bench, address: MpdoAddress, velocity: u32| {
        let mpdo = Mpdo::new(address, (0x6081, 0), &velocity.to_le_bytes()).unwrap();
        let Bench { network, port, .. } = bench;
        let channel = port.channel(0, 0).unwrap();
        let mut left = 10;
        run_cycle_until(port, LONG, |cycle, now_ns| {
            network.receive(cycle, now_ns, |_| {});
            if left == 10 {
                let bytes = mpdo.to_bytes();
                let frame = FrameRef::classic(to_drives().can_id(), &bytes).unwrap();
                cycle.send(channel, frame).unwrap();
            }
            network.send(cycle, now_ns);
            left -= 1;
            (left == 0).then_some(())
        })
        .unwrap();
        nodes.map(|node| bench.read(node, 0x6081, 0))
    };
    let all = MpdoAddress::Destination(None);
    assert_eq!(send(&mut bench, all, 70_000), [70_000; 3]);
    let second = MpdoAddress::Destination(Some(node_id(2)));
    assert_eq!(send(&mut bench, second, 80_000), [70_000, 80_000, 70_000]);
}

#[test]
fn dispatcher_list_translates_objects_of_the_drives() {
    let mut bench = Bench::new(drives(2, |_| {}));
    let nodes = [1, 2].map(|id| bench.add_node(id, NodeConfig::default()));
    bench.pass(100);
    // Mode display and actual position
    let entries: Vec<_> =
        [0x6061, 0x6064].map(|index| ScannerEntry { index, subindex: 0, count: 1 }).to_vec();
    // The host keeps them in 0x2100 and 0x2101, subindex 1 for drive 1, 2 for drive 2.
    let dispatcher: Vec<_> = [1, 2]
        .into_iter()
        .flat_map(|id| {
            [(0x6061, 0x2100), (0x6064, 0x2101)].map(|(index, local_index)| DispatcherEntry {
                producer: node_id(id),
                index,
                subindex: 0,
                local_index,
                local_subindex: id,
                count: 1,
            })
        })
        .collect();
    for (id, node) in (1..).zip(nodes) {
        let mut steps = producer(id, entries.clone()).steps().unwrap();
        steps.push(Step::device(NodeAction::Nmt(NmtCommand::Start)));
        run_steps(&mut bench, node, &steps).unwrap();
    }
    bench.pass(10);
    bench.network.start_download(nodes[1], 0x6060, 0, &[8]).unwrap();
    let mut received = Vec::new();
    let Bench { network, port, .. } = &mut bench;
    let mut left = 50;
    run_cycle_until(port, LONG, |cycle, now_ns| {
        network.receive(cycle, now_ns, |item| {
            let Some(frame) = item.frame() else { return };
            let Ok(mpdo) = Mpdo::parse(frame.frame.data()) else { return };
            let target = dispatcher.iter().find_map(|entry| entry.target(&mpdo));
            received.extend(target.map(|target| (target, mpdo.data)));
        });
        network.send(cycle, now_ns);
        left -= 1;
        (left == 0).then_some(())
    })
    .unwrap();
    assert_eq!(received, [((0x2100, 2), [8, 0, 0, 0])], "only the mode of drive 2 changed");
}
