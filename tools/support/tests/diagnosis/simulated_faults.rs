//! Faults of the simulated gateway in operation, as the findings tell them.

use std::time::Duration;

use crate::diagnosis::gateway_snapshot::snapshot_of;
use ecan_host::{AdapterConfig, DcSync};
use ecan_mcan_port::{ChannelConfig, Cycle, GatewayConfig, Port, PortConfig};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_sim::{ClockKind, Fault, Scenario, SimOptions, Simulation};
use ecan_tool_support::diagnosis::{Finding, Snapshot, findings};

struct Fixture {
    port: Port,
    simulation: Simulation,
}

impl Fixture {
    /// One ready gateway with all channels at 500 kbit/s, N = 3, cycle 1 ms.
    fn ready(scenario: Scenario) -> Self {
        Self::with_sync0(scenario, None)
    }

    /// The same with a Sync0 shift in microseconds.
    fn with_sync0(scenario: Scenario, shift_us: Option<u64>) -> Self {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
        let gateway = GatewayConfig::on_all_channels(ChannelConfig::classic(500_000));
        let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
        adapter.dc = shift_us.map(|us| DcSync::new(adapter.cycle, Duration::from_micros(us)));
        let config = (adapter, PortConfig::uniform(1, gateway));
        let mut port = Port::open(&backend.ecrt, config).unwrap();
        port.wait_ready().unwrap();
        Self { port, simulation: backend.simulation.unwrap() }
    }

    fn cycles(&mut self, count: usize, mut each: impl FnMut(&mut Cycle<'_>)) {
        for _ in 0..count {
            let mut cycle = self.port.next_cycle();
            cycle.received().for_each(drop);
            each(&mut cycle);
            assert_eq!(cycle.finish().error(), None);
        }
    }

    /// What the gateway shows now.
    fn snapshot(&self) -> Snapshot {
        self.simulation.with_world(|world| world.with_gateway(0, snapshot_of)).unwrap()
    }

    fn found(&self) -> Vec<Finding> {
        findings(&self.snapshot())
    }

    fn ids(&self) -> Vec<&'static str> {
        self.found().iter().map(|finding| finding.id).collect()
    }
}

fn frame() -> CanFrame {
    CanFrame::classic(CanId::standard(0x123).unwrap(), &[1, 2, 3]).unwrap()
}

/// Sends a frame if there is room.
fn send(cycle: &mut Cycle<'_>, channel: u8) {
    let channel = cycle.channel(0, channel).unwrap();
    let _ = cycle.send(channel, &frame());
}

#[test]
fn gateway_in_op_has_no_finding() {
    let mut bench = Fixture::ready(ecan_sim::echo(1));
    bench.cycles(100, |cycle| {
        send(cycle, 1);
    });
    assert_eq!(bench.found(), []);
    let snapshot = bench.snapshot();
    assert_eq!(snapshot.rejected.len(), 0, "{:?}", snapshot.rejected);
    assert_eq!((snapshot.get(0x8011, 9), snapshot.get(0x1C12, 0)), (Some(384), Some(3)));
}

#[test]
fn error_frames_lead_to_a_finding() {
    let mut bench = Fixture::ready(ecan_sim::echo(1));
    bench.simulation.inject(Fault::ErrorFrames { gateway: 0, channel: 0, frames: 14 });
    let is_seen = (0..20).any(|_| {
        bench.cycles(1, |cycle| {
            send(cycle, 0);
        });
        // 14 times 8 is 112; each frame that goes well takes one off.
        bench.ids().contains(&"error-warning")
    });
    assert!(is_seen, "{:#?}", bench.snapshot());
    bench.cycles(100, |cycle| {
        send(cycle, 0);
    });
    assert_eq!(bench.found(), [], "the counters have fallen again");
}

/// The symptom of manual 16.1, as incomplete working counters.
#[test]
fn shift_among_the_arrivals_is_named() {
    // Images arrive 70 us after the start of the cycle: the pulse is shortly before or after them.
    for shift_us in [60, 90, 110] {
        let mut scenario = ecan_sim::echo(1);
        scenario.gateways[0].config.sync0_window.missed_limit = 0;
        let mut bench = Fixture::with_sync0(scenario, Some(shift_us));
        bench.cycles(100, |_| ());
        let found = bench.found();
        assert_eq!(found[0].id, "sync-shift-small", "{shift_us} us: {found:#?}");
        assert!(found[0].causes[0].contains("DC shift is too small"), "{found:#?}");
    }
    let mut bench = Fixture::with_sync0(ecan_sim::echo(1), Some(500));
    bench.cycles(100, |_| ());
    assert_eq!(bench.found(), []);
}
