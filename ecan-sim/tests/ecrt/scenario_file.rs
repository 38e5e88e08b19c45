//! Scenario files and settings: accepted values, and messages for invalid ones.

use std::path::Path;

use ecan_can_io::recording::{ReadOptions, RecordingError, ScreenTimes};
use ecan_protocol::can::SamplePoint;
use ecan_protocol::device::AlStatusCode;
use ecan_sim::{
    BackendError, ClockKind, DelayCompensation, EcrtSetting, EcrtVersion, Fault, FaultyConfig,
    GatewayFault, LibraryCall, LossDirection, NodeKind, PhysicalLayer, Scenario, ScriptedFault,
    SimOptions, Sync0Window, Topology, WakeUpDelay, When, open,
};

fn read(text: &str) -> Result<Scenario, String> {
    Scenario::from_toml(text, "test", Path::new("/logs")).map_err(|error| error.to_string())
}

#[test]
fn every_key_arrives() {
    let scenario = read(
        r#"
name = "cell"
seed = 42
clock = "stepped"
wake_up_us = { typical = 5, p99 = 50, longest = 500 }
version = "1.5"
carries_large_pdos = true
reserved = true
topology = "star"

[[gateway]]
alias = 3
serial = 77
firmware = [1, 2]
boot_ms = 900
service_delay_us = 40
release_jitter_us = 9
mailbox_delay_us = 350
transceiver_ns = 210
tx_pressure_percent = 100
sii_sm2 = { start = 0x1180 }
sii_sm3 = { start = 0x1D00, size = 1024, control = 0x20 }
sync0_window = { before_us = 40, after_us = 5, missed_limit = 3, al_status = 0x2C }
buses = ["arm", "arm", "tool", "spare"]

[[node]]
kind = "echo"
bus = "arm"
name = "drive"
bitrate = 1000000
data_bitrate = 5000000
sample_point = 80
data_sample_point = 87.5
tdc_offset_ns = 120
cable_ns = 40
transceiver_ns = 180

[[node]]
kind = "replay"
bus = "tool"
file = "tool.log"
time_stamps = "d"

[[node]]
kind = "faulty"
bus = "spare"
drop_permille = 10
corrupt_permille = 20
repeat_permille = 30
babble_us = 400

[[node]]
kind = "silent"
bus = "spare"
sample_point = 75.25
tdc = false

[[fault]]
cycle = 100
kind = "lost_frame"
way = "return"
cycles = 3

[[fault]]
at_ms = 20
kind = "sdo_abort"
gateway = 0
index = 0x8010
subindex = 1
code = 0x06090030

[[fault]]
cycle = 7
kind = "library_error"
call = "domain_state"
errno = "EINTR"
times = 2

[[fault]]
cycle = 8
kind = "library_error"
call = "receive"
errno = 5

[[fault]]
at_ms = 30
kind = "requests_held"
for_ms = 9000
"#,
    )
    .unwrap();
    assert_eq!((scenario.name.as_str(), scenario.seed), ("cell", 42));
    assert_eq!(scenario.clock, Some(ClockKind::Stepped));
    let wake_up = WakeUpDelay { typical_ns: 5_000, p99_ns: 50_000, longest_ns: 500_000 };
    assert_eq!(scenario.wake_up, Some(wake_up));
    assert_eq!(scenario.version, EcrtVersion::V1_5);
    assert_eq!(scenario.topology, Topology::Star);
    assert!(scenario.carries_large_pdos && scenario.reserved);
    let gateway = &scenario.gateways[0];
    assert_eq!((gateway.alias, gateway.config.serial), (3, 77));
    assert_eq!((gateway.config.firmware, gateway.config.boot_ms), ((1, 2), 900));
    assert_eq!(gateway.config.service_delay_ns, 40_000);
    assert_eq!(gateway.config.release_jitter_ns, 9_000);
    assert_eq!(gateway.config.mailbox_delay_ns, 350_000);
    assert_eq!(gateway.config.tx_pressure_percent, 100);
    assert_eq!(gateway.config.transceiver_ns, 210);
    let window = Sync0Window {
        before_ns: 40_000,
        after_ns: 5_000,
        missed_limit: 3,
        al_status: AlStatusCode::FATAL_SYNC,
    };
    assert_eq!(gateway.config.sync0_window, window);
    let [sm2, sm3] = gateway.sii_sync_managers;
    assert_eq!((sm2.start, sm2.length, sm2.control), (0x1180, 3072, 0x66));
    assert_eq!((sm3.start, sm3.length, sm3.control), (0x1D00, 1024, 0x20));
    assert_eq!(gateway.buses, ["arm", "arm", "tool", "spare"]);
    let node = &scenario.nodes[0];
    assert_eq!((node.name.as_str(), node.bitrate), ("drive", Some(1_000_000)));
    let layer = PhysicalLayer {
        compensation: Some(DelayCompensation { offset_ns: 120, filter_ns: 0 }),
        cable_ns: 40,
        transceiver_ns: 180,
        ..PhysicalLayer::new(SamplePoint(8_000), SamplePoint(8_750))
    };
    assert_eq!(node.physical_layer, Some(layer));
    assert_eq!(scenario.nodes[1].physical_layer, None);
    let layer = PhysicalLayer::new(SamplePoint(7_525), SamplePoint(7_525));
    let layer = PhysicalLayer { compensation: None, ..layer };
    assert_eq!(scenario.nodes[3].physical_layer, Some(layer));
    let options = ReadOptions { format: None, screen_times: Some(ScreenTimes::SincePrevious) };
    assert_eq!(scenario.nodes[1].kind, NodeKind::Replay { file: "/logs/tool.log".into(), options });
    let faulty = FaultyConfig {
        drop_permille: 10,
        corrupt_permille: 20,
        repeat_permille: 30,
        babble_us: 400,
    };
    assert_eq!(scenario.nodes[2].kind, NodeKind::Faulty(faulty));
    let fault = |when, fault| ScriptedFault { when, fault };
    let abort = GatewayFault::SdoAbort { index: 0x8010, subindex: 1, code: 0x0609_0030, times: 1 };
    let library_error = |call, errno, times| Fault::LibraryError { call, errno, times };
    let expected = [
        fault(When::Cycle(100), Fault::LostFrame { direction: LossDirection::Return, cycles: 3 }),
        fault(When::At(20_000_000), Fault::Gateway { gateway: 0, fault: abort }),
        fault(When::Cycle(7), library_error(LibraryCall::DomainState, 4, 2)),
        fault(When::Cycle(8), library_error(LibraryCall::Receive, 5, 1)),
        fault(When::At(30_000_000), Fault::RequestsHeld { for_ms: 9_000 }),
    ];
    assert_eq!(scenario.faults, expected);
}

#[test]
fn documented_keys_are_accepted() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/SIMULATION.md");
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("skipped: {} is not there", path.display());
        return;
    };
    let (_, rest) = text.split_once("```toml\n").unwrap();
    let (example, _) = rest.split_once("```").unwrap();
    let scenario = read(example).unwrap();
    assert_eq!((scenario.gateways.len(), scenario.nodes.len(), scenario.faults.len()), (1, 3, 4));
}

/// Text, line and part of the message.
#[test]
fn scenario_fault_is_reported_with_its_line() {
    for (text, line, reason) in [
        ("sead = 1", 1, "unknown field `sead`"),
        ("seed = 1\nclock = \"fast\"", 2, "unknown variant `fast`"),
        ("seed = \"one\"", 1, "invalid type"),
        ("seed = 1\nwake_up_us = { typical = 5, p99 = 4, longest = 9 }", 2, "typical <= p99"),
        ("wake_up_us = { typical = 5 }", 1, "missing field `p99`"),
        ("[[gateway]]\nalias = 70000", 2, "70000"),
        ("[[gateway]]\nbuses = [\"a\"]", 1, "has 1 buses; needed: 4"),
        ("[[gateway]]\ntx_pressure_percent = 0", 1, "1 to 100"),
        ("[[gateway]]\ntx_pressure_percent = 101", 1, "1 to 100"),
        ("[[gateway]]\nsync0_window = { al_status = 0x1B }", 1, "allowed: 0x1A, 0x2C"),
        ("[[gateway]]\nsync0_window.before_us = 4294968", 1, "`before_us` is out of range"),
        ("[[gateway]]\n[gateway.sync0_window]\nwidth_us = 1", 3, "unknown field `width_us`"),
        ("[[gateway]]\ncolour = 1", 2, "unknown field `colour`"),
        ("[[gateway]]\ntransceiver_ns = 1001", 1, "`transceiver_ns` 1001 is out of range"),
        ("[[gateway", 1, ""),
        ("[[node]]\nkind = \"echo\"\nbus = \"x\"", 1, "there are no gateways"),
        (
            "[[gateway]]\n[[node]]\nkind = \"echo\"\nbus = \"1.0\"",
            2,
            "there are: 0.0, 0.1, 0.2, 0.3",
        ),
        ("[[gateway]]\n[[fault]]\nkind = \"lost_frame\"", 2, "one of `cycle`, `at_ms`, `after_ms`"),
    ] {
        let error = read(text).unwrap_err();
        assert!(error.starts_with(&format!("line {line}: ")), "{text}: {error}");
        assert!(error.contains(reason), "{text}: {error}");
    }
    // Nodes of bus 0.0 and faults of cycle 1.
    for (kind, keys, reason) in [
        ("echo", "file = \"x\"", "\"replay\""),
        ("replay", "", "needs `file`"),
        ("replay", "file = \"x\"\nformat = \"blf\"", "`format`: expected log, screen, asc or trc"),
        ("silent", "babble_us = 3", "\"faulty\""),
        ("faulty", "drop_permille = 1001", "0 to 1000"),
        ("echo", "data_bitrate = 1", "needs `bitrate`"),
        ("echo", "cable_ns = 1", "needs `sample_point`"),
        ("echo", "sample_point = 45", "`sample_point` 45 is out of range; allowed: 50 to 95"),
        (
            "echo",
            "sample_point = 80\ndata_sample_point = 95.1",
            "`data_sample_point` 95.1 is out of range; allowed: 50 to 95",
        ),
        (
            "echo",
            "sample_point = 80\ncable_ns = 10001",
            "`cable_ns` 10001 is out of range; allowed: 0 to 10000",
        ),
        (
            "echo",
            "sample_point = 80\ntdc = false\ntdc_offset_ns = 100",
            "`tdc_offset_ns` needs `tdc`",
        ),
        ("lost_frame", "at_ms = 1", "only one of `cycle`, `at_ms`"),
        ("al_error", "gateway = 0\ncode = 65536", "0 to 0xFFFF"),
        ("bus_off", "", "needs `channel`"),
        ("power_cycle", "gateway = 1", "there are 1"),
        ("lost_frame", "gateway = 0", "`gateway` does not belong"),
        ("bus_off", "gateway = 0\nchannel = 4", "channel 4"),
        ("library_error", "errno = 4", "needs `call`"),
        ("library_error", "call = \"send\"", "needs `errno`"),
        ("library_error", "call = \"send\"\nerrno = \"EWHAT\"", "one of: EPERM"),
        ("library_error", "call = \"send\"\nerrno = 4096", "1 to 4095"),
        ("lost_frame", "errno = 4", "`errno` does not belong"),
        ("node_silent", "node = \"x\"\nfor_ms = 1", "node \"x\" does not exist"),
    ] {
        let (table, place) = match kind {
            "echo" | "replay" | "silent" | "faulty" => ("node", "bus = \"0.0\""),
            _ => ("fault", "cycle = 1"),
        };
        let text = format!("[[{table}]]\nkind = \"{kind}\"\n{place}\n{keys}");
        let error = read(&format!("[[gateway]]\n{text}")).unwrap_err();
        assert!(error.starts_with("line 2: "), "{text}: {error}");
        assert!(error.contains(reason), "{text}: {error}");
    }
}

#[test]
fn two_nodes_need_two_names() {
    let node = "[[node]]\nkind = \"echo\"\nbus = \"0.0\"\nname = \"twin\"\n";
    let error = read(&format!("[[gateway]]\n{node}{node}")).unwrap_err();
    assert!(error.starts_with("line 6: ") && error.contains("twin"), "{error}");
}

#[test]
fn missing_files_and_bad_logs_are_reported() {
    let directory = std::env::temp_dir().join(format!("ecan-sim-files-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let setting = |name: &str| {
        let path = directory.join(name).to_str().unwrap().to_owned();
        EcrtSetting::Simulated(Some(path))
    };
    let options = SimOptions::default();
    let error = open(&setting("none.toml"), &options).unwrap_err();
    assert!(matches!(error, BackendError::Read(..)));
    assert!(error.to_string().contains("none.toml"));

    std::fs::write(directory.join("bad.toml"), "seed = 1\nsead = 2\n").unwrap();
    let error = open(&setting("bad.toml"), &options).unwrap_err().to_string();
    assert!(error.contains("bad.toml: line 2: unknown field `sead`"), "{error}");

    let replay = "clock = \"stepped\"\n[[gateway]]\n[[node]]\nkind = \"replay\"\nbus = \"0.0\"\n\
                  file = \"frames.log\"\n";
    std::fs::write(directory.join("replay.toml"), replay).unwrap();
    std::fs::write(directory.join("frames.log"), "(1.000000) can0 123#11\nnonsense\n").unwrap();
    let error = open(&setting("replay.toml"), &options).unwrap_err();
    assert!(matches!(error, BackendError::Recording(_, RecordingError { line: 2, .. })), "{error}");

    std::fs::write(directory.join("frames.log"), "(1.000000) can0 123#11\n").unwrap();
    let backend = open(&setting("replay.toml"), &options).unwrap();
    let simulation = backend.simulation.unwrap();
    assert!(simulation.scenario_name().ends_with("replay.toml"));
    std::fs::remove_dir_all(&directory).unwrap();
}

#[test]
fn simulated_run_reports_itself() {
    let options = SimOptions {
        clock: Some(ClockKind::Stepped),
        gateways: vec![0; 2],
        ..SimOptions::default()
    };
    let setting = EcrtSetting::parse("sim");
    let backend = open(&setting, &SimOptions { seed: Some(5), ..options }).unwrap();
    assert!(backend.ecrt.is_simulated());
    assert_eq!(
        backend.simulation.unwrap().banner(),
        "SIMULATED: no EtherCAT master, no hardware. Scenario echo: 2 gateways, 8 nodes, \
         libethercat 1.6, stepped time, seed 5"
    );
}

#[test]
fn missing_library_is_an_error_and_not_a_simulation() {
    let setting = EcrtSetting::parse("/nowhere/libethercat.so.1");
    let error = open(&setting, &SimOptions::default()).unwrap_err();
    assert!(matches!(error, BackendError::Load(_)));
    assert!(error.to_string().contains("/nowhere/libethercat.so.1"));
}
