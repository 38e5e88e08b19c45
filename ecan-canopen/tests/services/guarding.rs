//! Node guarding and life guarding.

use std::time::Duration;

use ecan_canopen::{GuardErrors, GuardingConfig, Heartbeat, NmtCommand, NmtState, NodeConfig};

use super::bench::{Bench, drives};

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
