//! Nodes that join and leave the bus of a running gateway.

use std::sync::{Arc, Mutex};

use crate::ecrt_support::Program;
use ecan_protocol::can::CanFrame;
use ecan_sim::{GatewaySpec, Node, NodeOutput, Scenario, StationConfig};

fn frame(data: u8) -> CanFrame {
    crate::ecrt_support::frame(0x123, &[data])
}

/// Records its bit rates and what it receives; answers frame 1 with frame 2.
#[derive(Clone, Default)]
struct Recorder(Arc<Mutex<(Vec<u32>, Vec<CanFrame>)>>);

impl Node for Recorder {
    fn configured(&mut self, _now: u64, config: &StationConfig) {
        self.0.lock().unwrap().0.push(config.nominal_bitrate);
    }

    fn received(&mut self, _now: u64, received: &CanFrame, out: &mut NodeOutput) {
        self.0.lock().unwrap().1.push(*received);
        if *received == frame(1) {
            out.send(frame(2));
        }
    }
}

/// No other node is on the bus: only the attached one acknowledges the gateway's frames.
#[test]
fn attached_node_takes_part_until_dropped() {
    let scenario = Scenario { gateways: vec![GatewaySpec::at(0)], ..Scenario::default() };
    let mut program = Program::new(crate::ecrt_support::stepped(scenario), &[3]).into_op();
    let simulation = program.simulation().clone();
    let on_bus = || simulation.with_world(|world| world.counters(0)).unwrap().frames_on_bus;
    let recorder = Recorder::default();
    let attach = || simulation.attach_node("0.0", "recorder", Box::new(recorder.clone())).unwrap();
    let handle = attach();
    program.cycle_with(&[(0, 0, frame(1))]);
    program.receive_frames(1);
    assert_eq!(program.received, [(0, 0, frame(2))]);
    assert_eq!(*recorder.0.lock().unwrap(), (vec![500_000], vec![frame(1)]));
    assert_eq!(on_bus(), 1);
    drop(handle);
    program.cycle_with(&[(0, 0, frame(3))]);
    program.cycles(50);
    assert_eq!(on_bus(), 1);
    let _handle = attach();
    program.cycles(50);
    assert_eq!(on_bus(), 2);
    assert_eq!(recorder.0.lock().unwrap().1, [frame(1), frame(3)]);
}

/// Notes when it runs, in the same list as others.
struct Ticker {
    due: u64,
    runs: Arc<Mutex<Vec<u64>>>,
}

impl Node for Ticker {
    fn started(&mut self, now: u64, _out: &mut NodeOutput) {
        self.due += now;
    }

    fn received(&mut self, _now: u64, _frame: &CanFrame, _out: &mut NodeOutput) {}

    fn next_event(&self) -> Option<u64> {
        Some(self.due)
    }

    fn advance(&mut self, now: u64, _out: &mut NodeOutput) {
        self.runs.lock().unwrap().push(now);
        self.due = now + 100_000;
    }
}

/// Nodes of an application can connect buses with each other, or with those of another process.
#[test]
fn attached_nodes_of_several_buses_run_in_the_order_of_time() {
    let scenario = Scenario { gateways: vec![GatewaySpec::at(0)], ..Scenario::default() };
    let mut program = Program::new(crate::ecrt_support::stepped(scenario), &[3]).into_op();
    let runs = Arc::new(Mutex::new(Vec::new()));
    let attach = |(bus, due)| {
        let node = Box::new(Ticker { due, runs: Arc::clone(&runs) });
        program.simulation().attach_node(bus, "ticker", node).unwrap()
    };
    let _nodes = [("0.0", 70_000), ("0.1", 40_000)].map(attach);
    program.cycles(3);
    let runs = runs.lock().unwrap();
    assert!(runs.len() > 20, "{runs:?}");
    assert!(runs.is_sorted(), "{runs:?}");
}
