//! What goes over the CAN bus while one axis starts up, as a readable trace: NMT, SDO, mapping,
//! enabling. A second channel of the gateway, wired to the same bus, listens.
//!
//! With `UPDATE_GOLDEN=1` the trace is written anew instead of compared.
#![allow(missing_docs)]

use ecan_cia402::AxisCommand;
use std::path::Path;

use crate::axes::{Fixture, axis, node};
use ecan_canopen::{
    ClientFrame, CobId, Controlword, Initiate, NmtRequest, NodeId, ServerFrame, Service,
    Statusword, parse_heartbeat,
};
use ecan_mcan_port::Received;
use ecan_protocol::can::CanFrame;
use ecan_sim::Scenario;

/// Drive 1 alone on a bus with channels 0 and 1 of the gateway.
fn scenario() -> Scenario {
    let mut scenario = ecan_sim::drives(1, 1);
    let bus = scenario.gateways[0].buses[0].clone();
    scenario.nodes.retain(|node| node.bus == bus);
    scenario.gateways[0].buses[1] = bus;
    scenario
}

fn value(initiate: Initiate) -> String {
    match initiate {
        Initiate::Expedited { data, length } => {
            let length = usize::from(length.unwrap_or(4));
            let number = u32::from_le_bytes(data);
            format!("0x{number:0width$X}", width = 2 * length)
        }
        Initiate::Segmented { size } => format!("{size:?} bytes in segments"),
    }
}

fn client(frame: ClientFrame) -> String {
    match frame {
        ClientFrame::Upload { index, subindex } => format!("read  0x{index:04X}:{subindex:02}"),
        ClientFrame::Download { index, subindex, initiate } => {
            format!("write 0x{index:04X}:{subindex:02} = {}", value(initiate))
        }
        other => format!("{other:?}"),
    }
}

fn server(frame: ServerFrame) -> String {
    match frame {
        ServerFrame::Upload { initiate, .. } => value(initiate),
        ServerFrame::Download { .. } => "ok".into(),
        ServerFrame::Abort { code, .. } => format!("abort {code}"),
        other => format!("{other:?}"),
    }
}

/// A frame in text; `None` for what comes in every cycle and says nothing new.
fn text(frame: &CanFrame, host: NodeId) -> Option<String> {
    let data = frame.data();
    Some(match CobId::classify(frame.id())? {
        Service::Nmt => {
            let request = NmtRequest::parse(data)?;
            let whom = request.node.map_or("all".into(), |node| node.to_string());
            format!("NMT   {}, node {whom}", request.command)
        }
        Service::Heartbeat(node) if node == host => return None,
        Service::Heartbeat(node) => format!("node {node} is {}", parse_heartbeat(data)?),
        Service::SdoClient(_) => client(ClientFrame::parse(data).ok()?),
        Service::SdoServer(_) => format!("      {}", server(ServerFrame::parse(data).ok()?)),
        Service::Rpdo(_, number) => {
            let [low, high, target @ ..] = data else { return None };
            let control = Controlword(u16::from_le_bytes([*low, *high]));
            let target = i32::from_le_bytes(target.try_into().ok()?);
            format!("RPDO{number} controlword 0x{:04X}, target {target}", control.0)
        }
        Service::Tpdo(_, number) => {
            let [low, high, actual @ ..] = data else { return None };
            let status = Statusword(u16::from_le_bytes([*low, *high]));
            let state = status.state().map_or("unknown".into(), |state| state.to_string());
            let actual = i32::from_le_bytes(actual.try_into().ok()?);
            format!("TPDO{number} statusword 0x{:04X} {state}, actual {actual}", status.0)
        }
        other => format!("{other:?}"),
    })
}

/// The trace without what repeats: each kind of PDO and heartbeat only when it changes.
#[derive(Default)]
struct Trace {
    lines: Vec<String>,
    last: std::collections::HashMap<u32, String>,
}

impl Trace {
    fn add(&mut self, frame: &CanFrame) {
        let Some(line) = text(frame, NodeId::MAX) else { return };
        let repeats = !matches!(
            CobId::classify(frame.id()),
            Some(Service::SdoClient(_) | Service::SdoServer(_) | Service::Nmt)
        );
        if repeats && self.last.insert(frame.id().raw(), line.clone()).as_ref() == Some(&line) {
            return;
        }
        if line != "Sync" {
            self.lines.push(line);
        }
    }
}

#[test]
fn axis_startup_matches_the_golden_trace() {
    let mut fixture = Fixture::with(scenario(), vec![axis(0, 0, 1)]);
    let mut trace = Trace::default();
    let mut run = |fixture: &mut Fixture, what: &str, done: &dyn Fn(&Fixture) -> bool| {
        trace.lines.push(format!("-- {what}"));
        for _ in 0..3_000 {
            if done(fixture) {
                return;
            }
            let mut cycle = fixture.port.next_cycle();
            fixture.cia402.process_rx_with(&mut cycle, |item| {
                if let Received::Frame(received) = item
                    && received.channel == 1
                {
                    trace.add(&received.frame);
                }
            });
            fixture.cia402.send_targets_all(&mut cycle);
            assert_eq!(cycle.finish().error(), None);
        }
        panic!("{what}: {}", fixture.axis(0).progress());
    };
    let phase =
        |text: &'static str| move |fixture: &Fixture| fixture.axis(0).phase().to_string() == text;
    fixture.cia402.command_all(AxisCommand::Configure).unwrap();
    run(&mut fixture, "configure", &phase("configured"));
    fixture.cia402.command_all(AxisCommand::ReadPosition).unwrap();
    run(&mut fixture, "read the actual position", &phase("ready at its actual position"));
    fixture.cia402.command_all(AxisCommand::Enable).unwrap();
    run(&mut fixture, "enable", &phase("following targets"));
    let drive = fixture
        .simulation
        .with_world(|world| *world.drive_at(0, 0, node(1)).unwrap().targets().sums());
    assert_eq!((drive.largest_first_offset, drive.largest_step), (0, 0), "nothing jumped");

    let text = trace.lines.join("\n") + "\n";
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/start_up.trace");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&golden, &text).unwrap();
    }
    let expected = std::fs::read_to_string(&golden).unwrap();
    for (number, (now, then)) in text.lines().zip(expected.lines()).enumerate() {
        assert_eq!(now, then, "line {} of {}", number + 1, golden.display());
    }
    assert_eq!(text.lines().count(), expected.lines().count());
}
