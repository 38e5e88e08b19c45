//! Symptoms of manual 16.3 on a simulated bus: an application sends, then `ecan diag` explains the gateway.

use std::path::Path;
use std::time::Duration;

use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_sim::{ClockKind, Scenario, SimOptions};
use ecan_tool_support::diagnosis::{Depth, ReadError, Snapshot};

use crate::support::{ends, fails, good, json_of, scenario, setting, simulated};

const CYCLES: u32 = 1_000;
const CHECK: &str = "next   compare bit rates, sample points (nominal and data), TDC and bit rate switch (BRS) with \
                     each peer; then watch the error counters and check the termination\n  manual 16.3\n";

/// Report of `ecan diag` after an application has sent frames on channel 0, to a node with these keys.
fn report(gateway: &str, node: &str, channel: ChannelConfig) -> String {
    let text =
        format!("[[gateway]]\n{gateway}\n[[node]]\nkind = \"echo\"\nbus = \"0.0\"\n{node}\n");
    let scenario = Scenario::from_toml(&text, "symptom", Path::new(".")).unwrap();
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
    let adapter = AdapterConfig::new(1).with_multiplier(8).with_cycle(Duration::from_millis(1));
    let port = PortConfig::uniform(1, GatewayConfig::on_channel(0, channel));
    let mut port = Port::open(&backend.ecrt, (adapter, port)).unwrap();
    port.wait_ready().unwrap();
    let id = CanId::standard(0x123).unwrap();
    let frame = match channel.can.fd {
        true => CanFrame::fd(id, &[0x5A; 16], true, false).unwrap(),
        false => CanFrame::classic(id, &[0x5A; 8]).unwrap(),
    };
    for _ in 0..CYCLES {
        let mut cycle = port.next_cycle();
        cycle.received().for_each(drop);
        let channel = cycle.channel(0, 0).unwrap();
        let _ = cycle.send(channel, &frame);
        assert_eq!(cycle.finish().error(), None);
    }
    let snapshot = backend.simulation.unwrap().with_world(|world| {
        let read = |gateway: &mut ecan_sim::Gateway, now| {
            let mut bytes = Vec::new();
            let mut snapshot = Snapshot::read(Depth::Findings, |key| {
                gateway
                    .sdo_upload(now, key.index, key.subindex, &mut bytes)
                    .map_err(|code| ReadError::Rejected(code.to_string()))?;
                let mut value = [0; 4];
                value[..bytes.len()].copy_from_slice(&bytes);
                Ok(u32::from_le_bytes(value))
            });
            snapshot.al_state = gateway.al_state().raw();
            snapshot
        };
        world.with_gateway(0, read).unwrap()
    });
    explain(&snapshot)
}

/// The findings that `ecan diag` prints for a bundle with this snapshot.
fn explain(snapshot: &Snapshot) -> String {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bundle.json").display().to_string();
    simulated(&["diag", "--record", &path]);
    let mut bundle: serde_json::Value = json_of(&std::fs::read_to_string(&path).unwrap());
    bundle["gateways"][0]["snapshot"] = serde_json::to_value(snapshot).unwrap();
    std::fs::write(&path, bundle.to_string()).unwrap();
    ends(1, &["diag", "--brief", "--from", &path])
}

#[track_caller]
fn has(report: &str, texts: &[&str]) {
    for text in texts {
        assert!(report.contains(text), "{text}: {report}");
    }
}

fn fd() -> ChannelConfig {
    ChannelConfig::fd(1_000_000, 5_000_000)
}

/// Shift 13 ns: each 25th frame fails, and is repeated.
#[test]
fn slightly_different_sample_points_are_repeated_data_phase_errors() {
    let report = report("", "sample_point = 88.8\ndata_sample_point = 87.5", fd());
    has(
        &report,
        &[
            "[data-phase-error] CAN0: ",
            "in the data phase of CAN FD frames, none in the arbitration phase; ",
            " errors are logged (ECR)",
            "1. the sample points of the data phase differ, or the nominal ones, at which it begins",
            "this channel: 1000 kbit/s, sample point 87.5 to 87.5 %, data phase 5000 kbit/s, 87.5 to 87.5 %, \
             TDC on, automatic",
            CHECK,
        ],
    );
    assert!(!report.contains("fault ["), "frames arrive: {report}");
}

/// The channel is 75 ns late in frames of the node: it misses the switch, and only the state and the counters
/// show that.
#[test]
fn received_frames_at_earlier_sample_point_lead_to_bit_timing() {
    let report = report("", "sample_point = 80\ndata_sample_point = 87.5", fd());
    has(
        &report,
        &[
            "fault [error-passive] CAN0: ",
            "1. bit rate or sample point differs from the other nodes; this channel: 1000 kbit/s, sample point 87.5",
            "then compare bit rates, sample points, TDC and BRS with each peer\n  manual 16.3\n",
        ],
    );
    assert!(!report.contains("data-phase-error"), "{report}");
}

/// The node is 75 ns late in frames of the channel: it destroys them, then it does not acknowledge.
#[test]
fn sent_frames_at_later_sample_point_lead_to_data_phase() {
    let report = report("", "sample_point = 95\ndata_sample_point = 87.5", fd());
    has(
        &report,
        &[
            "fault [no-acknowledge] CAN0: ",
            "sample points, data bit rate or TDC differ from the other nodes (errors in the data phase); this \
             channel: 1000 kbit/s",
            "[data-phase-error] CAN0: ",
            CHECK,
        ],
    );
}

/// The program that sends names the check, too.
#[test]
fn frame_that_a_peer_cannot_sample_is_reported_as_not_sent() {
    let sent_to = |point: f64| {
        let keys = format!("sample_point = {point}\ndata_sample_point = 87.5\n");
        scenario(&format!("[[gateway]]\n[[node]]\nkind = \"echo\"\nbus = \"0.0\"\n{keys}"))
    };
    let send = |ecrt: &str, run: &dyn Fn(&[&str]) -> String| {
        let points = ["--sample-point", "87.5", "--data-sample-point", "87.5"];
        let rates = ["--bitrate", "1000000", "--data-bitrate", "5000000"];
        run(&[&["--ecrt", ecrt, "send"][..], &rates, &points, &["123##1112233"]].concat())
    };
    let message = send(&setting(&sent_to(95.0)), &|arguments| fails(1, arguments));
    let check = "check for another node with 1000000/5000000 bit/s and the same sample points, wiring and \
                 termination";
    assert!(message.contains(check), "{message}");
    assert_eq!(send(&setting(&sent_to(87.5)), &good), "can0 123##1112233 sent\n");
}

#[test]
fn wrong_data_bit_rate_leads_to_data_phase() {
    let report = report("", "bitrate = 1000000\ndata_bitrate = 2000000", fd());
    has(&report, &["fault [no-acknowledge] CAN0: ", "[data-phase-error] CAN0: ", CHECK]);
    has(&report, &["frames with BRS are sent to nodes with another data bit rate"]);
}

/// The node receives, but its own frames fail: 75 % of 200 ns are as long as the delay of its transceiver.
#[test]
fn peer_without_tdc_at_5_mbit_causes_data_phase_errors() {
    let node = "sample_point = 87.5\ndata_sample_point = 75\ntdc = false";
    let report = report("", node, fd());
    has(
        &report,
        &[
            "stuff error in the data phase of CAN FD frames",
            "transmitter delay compensation (TDC) of a peer is off, but needed from 5 Mbit/s",
            CHECK,
        ],
    );
}

/// From 5 Mbit/s the firmware enables TDC itself. 87.5 % at 4 Mbit/s are 218 ns.
#[test]
fn tdc_off_below_5_mbit_is_named_with_its_object() {
    let mut channel = ChannelConfig::fd(1_000_000, 4_000_000);
    channel.can.tdc = false;
    let report = report("transceiver_ns = 230", "sample_point = 87.5", channel);
    has(
        &report,
        &[
            "bit 0 error in the data phase of CAN FD frames",
            "1. the channel reads its own data bits back wrongly: its transmitter delay compensation (TDC)",
            "2. transmitter delay compensation (TDC) is off (0x8001:16 = 0)",
            ", TDC off",
            CHECK,
        ],
    );
}

/// 20 periods of 12.5 ns are longer than a bit.
#[test]
fn unpaired_tdc_offset_is_named_with_its_objects() {
    let mut channel = fd();
    channel.can.tdc_offset = 20;
    let report = report("", "sample_point = 87.5", channel);
    has(
        &report,
        &[
            "bit 0 error in the data phase of CAN FD frames",
            "2. TDC offset and filter are not a pair (0x8001:33 = 20, 0x8001:34 = 0): set both, or both to 0",
            "TDC on, offset 20, filter 0",
            CHECK,
        ],
    );
}

#[test]
fn wrong_bit_rate_is_no_data_phase_error() {
    let report = report("", "bitrate = 250000", ChannelConfig::classic(500_000));
    has(
        &report,
        &[
            "fault [no-acknowledge] CAN0: ",
            "1. no other active node on this bus with this bit rate (off, in listen mode, or with another rate); \
             this channel: 500 kbit/s, sample point 87.5 to 87.5 %",
            "\n  manual 16.3\n",
        ],
    );
    assert!(!report.contains("data-phase-error"), "{report}");
}
