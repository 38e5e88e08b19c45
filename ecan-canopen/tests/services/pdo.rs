//! Times and SYNC counter of mapped PDOs.

use ecan_canopen::{
    CobId, MappingEntry, NmtCommand, NodeAction, NodeConfig, PdoDirection, PdoMapping,
    PdoMappingError, Step, SyncConfig, TransmissionType, run_cycle_until,
};

use super::bench::{Bench, LONG, drives, node_id, run_steps};

/// TPDO 1 with statusword and actual position.
fn feedback(id: u8) -> PdoMapping {
    PdoMapping {
        direction: PdoDirection::Transmit,
        number: 1,
        cob_id: CobId::tpdo(node_id(id), 1).can_id(),
        transmission: TransmissionType::EventProfile,
        inhibit_time: None,
        event_timer_ms: None,
        sync_start: None,
        entries: vec![MappingEntry::new(0x6041, 0, 16), MappingEntry::new(0x6064, 0, 32)],
    }
}

/// Times in milliseconds of the TPDOs of node 1 in this number of cycles of 1 ms.
fn feedback_times(bench: &mut Bench, cycles: u64) -> Vec<u64> {
    let Bench { network, port, .. } = bench;
    let (mut times, mut number) = (Vec::new(), 0);
    run_cycle_until(port, LONG, |cycle, now_ns| {
        network.receive(cycle, now_ns, |item| {
            let frame = item.frame().filter(|frame| frame.frame.id() == feedback(1).cob_id);
            times.extend(frame.map(|_| number));
        });
        network.send_sync(cycle);
        network.send(cycle, now_ns);
        number += 1;
        (number == cycles).then_some(())
    })
    .unwrap();
    times
}

fn differences(times: &[u64]) -> Vec<u64> {
    times.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

#[test]
fn event_timer_and_inhibit_time_of_a_mapping_are_kept() {
    let mut bench = Bench::new(drives(1, |_| {}));
    let node = bench.add_node(1, NodeConfig::default());
    bench.pass(100);
    let start = Step::device(NodeAction::Nmt(NmtCommand::Start));
    let mut steps = PdoMapping { event_timer_ms: Some(20), ..feedback(1) }.steps().unwrap();
    steps.push(start);
    run_steps(&mut bench, node, &steps).unwrap();
    let times = feedback_times(&mut bench, 210);
    assert!((10..=11).contains(&times.len()), "{times:?}");
    assert!(differences(&times[1..]).iter().all(|ms| (19..=21).contains(ms)), "{times:?}");

    // The position changes in every controller period: the inhibit time limits the TPDOs.
    let stop = Step::device(NodeAction::Nmt(NmtCommand::EnterPreOperational));
    let mut steps = vec![stop];
    let mapping = PdoMapping { inhibit_time: Some(100), event_timer_ms: Some(0), ..feedback(1) };
    steps.extend(mapping.steps().unwrap());
    steps.push(start);
    run_steps(&mut bench, node, &steps).unwrap();
    bench.write(node, (0x6060, 0), &[3]);
    for controlword in [6u16, 7, 15] {
        bench.write(node, (0x6040, 0), &controlword.to_le_bytes());
    }
    bench.write(node, (0x60FF, 0), &100_000i32.to_le_bytes());
    let times = feedback_times(&mut bench, 205);
    assert!((20..=21).contains(&times.len()), "{times:?}");
    assert!(differences(&times).iter().all(|ms| (9..=11).contains(ms)), "{times:?}");
}

#[test]
fn sync_counter_selects_the_start_of_a_synchronous_pdo() {
    let mut bench = Bench::new(drives(1, |_| {}));
    let node = bench.add_node(1, NodeConfig::default());
    bench.pass(100);
    let sync = SyncConfig { every_cycles: 1, counter_overflow: Some(40), ..SyncConfig::default() };
    let transmission = TransmissionType::Synchronous(4);
    let mapping = PdoMapping { transmission, sync_start: Some(7), ..feedback(1) };
    let mut steps = vec![sync.counter_step()];
    steps.extend(mapping.steps().unwrap());
    steps.push(Step::device(NodeAction::Nmt(NmtCommand::Start)));
    run_steps(&mut bench, node, &steps).unwrap();
    bench.pass(10);
    bench.network.set_sync(Some(sync)).unwrap();
    let times = feedback_times(&mut bench, 40);
    // The counter is 7 in the seventh cycle; the TPDO arrives a few cycles later.
    assert!((7..=10).contains(&times[0]), "{times:?}");
    assert!(differences(&times).iter().all(|ms| *ms == 4), "{times:?}");
    let emergencies = bench.network.emcy(node).unwrap();
    assert_eq!(emergencies.count(), 0, "no SYNC of an unexpected length");
    let invalid = PdoMapping { sync_start: Some(241), ..mapping };
    assert_eq!(invalid.steps(), Err(PdoMappingError::SyncStart { value: 241 }));
}
