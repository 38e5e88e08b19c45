//! Tests of `ecan dump` with a replay node.

use crate::support::{Scenario, all_fail, json_of};

/// Milliseconds and frame.
const FRAMES: [(u64, &str); 5] = [
    (0, "123#DEADBEEF"),
    (500, "124#4142"),
    (600, "12345678#R4"),
    (1700, "7FF#1122334455667788"),
    (1800, "000#"),
];

fn bus() -> Scenario {
    Scenario::replaying(&FRAMES, "")
}

#[test]
fn screen_matches_candump() {
    let expected = "\
\x20\x20can0  123   [4]  DE AD BE EF
  can0  124   [2]  41 42
  can0  12345678   [4]  remote request
  can0       7FF   [8]  11 22 33 44 55 66 77 88
  can0       000   [0] 
";
    assert_eq!(bus().good(&["dump", "-n", "5"]), expected);
    let expected = "\
\x20(000.000000)  can0  123   [4]  DE AD BE EF
 (000.500000)  can0  124   [2]  41 42
 (000.100000)  can0  12345678   [4]  remote request
";
    assert_eq!(bus().good(&["dump", "-n", "3", "-t", "d"]), expected);
    let expected = "\
\x20(000.000000000)  can0  RX - -  123   [4]  DE AD BE EF               '....'
 (000.500000000)  can0  RX - -  124   [2]  41 42                     'AB'
";
    assert_eq!(bus().good(&["dump", "-n", "2", "-t", "z", "-N", "-x", "-a"]), expected);
}

#[test]
fn log_matches_candump_on_screen_and_in_file() {
    let bus = bus();
    let shown = bus.good(&["dump", "-n", "5", "-L"]);
    assert_eq!(bus.good(&["dump", "-n", "5", "--record", &bus.path("out.log")]), "");
    assert_eq!(bus.read("out.log"), shown);
    let records: Vec<_> = shown
        .lines()
        .map(|line| ecan_can_io::candump::parse_line(line).unwrap().unwrap())
        .collect();
    let first = records[0].time_ns;
    // The log grammar has its own round-trip tests.
    for ((ms, frame), (record, line)) in FRAMES.iter().zip(records.iter().zip(shown.lines())) {
        assert_eq!(record.to_string(), line);
        assert_eq!(record.interface, "can0");
        assert_eq!(ecan_can_io::candump::FrameText(&record.frame).to_string(), *frame);
        assert_eq!(record.time_ns - first, ms * 1_000_000);
    }
    bus.good(&["dump", "-n", "5", "--record", &bus.path("out.blf")]);
    let blf = std::fs::read(bus.path("out.blf")).unwrap();
    let blf = ecan_can_io::recording::Recording::read(&blf, &Default::default()).unwrap();
    let texts = blf
        .frames
        .iter()
        .map(|frame| (frame.time_ns, ecan_can_io::candump::FrameText(&frame.frame).to_string()));
    let expected = FRAMES.map(|(ms, text)| (ms * 1_000_000, text.to_owned()));
    assert_eq!(texts.collect::<Vec<_>>(), expected);
    let screen = bus.good(&["dump", "-n", "1", "-l", &bus.path("out.log"), "--screen", "--force"]);
    assert_eq!(screen, "  can0  123   [4]  DE AD BE EF\n");
}

#[test]
fn filters_select_frames() {
    let table: [(&[&str], &[&str]); 6] = [
        (&["123:7FF"], &["123#DEADBEEF"]),
        (&["123:7FF,124:7FF"], &["123#DEADBEEF", "124#4142"]),
        (&["123:7FF", "124:7FF"], &["123#DEADBEEF", "124#4142"]),
        (&["120:7F0", "124~7FF", "j"], &["123#DEADBEEF"]),
        (&["0:80000000", "j", "7FF~7FF", "000~7FF"], &["123#DEADBEEF", "124#4142"]),
        (&["12345678:9FFFFFFF"], &["12345678#R4"]),
    ];
    for (filters, expected) in table {
        let shown = bus().good(&[&["dump", "-L", "-T", "9000"][..], filters].concat());
        let frames: Vec<_> = shown.lines().filter_map(|line| line.split(' ').nth(2)).collect();
        assert_eq!(frames, expected, "{filters:?}");
    }
}

#[test]
fn count_and_timeout_set_exit_status() {
    assert_eq!(bus().good(&["dump", "-n", "1"]).lines().count(), 1);
    let message = bus().fails(1, &["dump", "-T", "100"]);
    let words = "ecan: no frame received; check that the other nodes use 500000/5000000 bit/s";
    assert_eq!(message, words);
    let message = bus().fails(1, &["dump", "-T", "9000", "-n", "9"]);
    assert_eq!(message, "ecan: 5 of 9 frames received");
    assert_eq!(bus().good(&["dump", "-T", "9000", "-n", "5"]).lines().count(), 5);
    let message = bus().fails(1, &["dump", "-T", "9000", "700:7FF"]);
    assert_eq!(message, "ecan: no received frame passes the filters");
    // The other channels have no frames.
    bus().fails(1, &["dump", "-T", "9000", "--channel", "1,2,3"]);
}

#[test]
fn json_frames_have_device_time() {
    let shown = bus().good(&["dump", "-n", "3", "--json", "-H"]);
    let frames: Vec<serde_json::Value> = shown.lines().map(json_of).collect();
    assert_eq!(frames[0]["id"], 0x123);
    assert_eq!(frames[0]["data"], "DEADBEEF");
    assert_eq!(frames[0]["kind"], "data");
    assert!(frames[0]["device_time"].is_u64());
    assert_eq!((&frames[2]["kind"], &frames[2]["length"]), (&"remote".into(), &4.into()));
    assert_eq!(frames[2]["is_extended"], true);
    let shown = bus().good(&["dump", "-n", "1", "-H"]);
    let (columns, time) = shown.trim_end().rsplit_once("  +").unwrap();
    assert_eq!(columns, "  can0  123   [4]  DE AD BE EF");
    assert!(time.parse::<u16>().is_ok());
}

#[test]
fn can_fd_is_shown() {
    let frames = [(0, "123##1AABB"), (10, "124##0112233445566778899AABBCC")];
    let bus = Scenario::replaying(&frames, "");
    let expected = "\
\x20\x20can0  RX B -  123  [02]  AA BB
  can0  RX - -  124  [12]  11 22 33 44 55 66 77 88 99 AA BB CC
";
    assert_eq!(bus.good(&["dump", "-n", "2", "-x", "--data-bitrate", "2000000"]), expected);
}

#[test]
fn listen_only_does_not_acknowledge() {
    // Only the node and the listening gateway are on the bus: no frame is acknowledged.
    let alone = |mode: &[&str]| {
        let node = "[[node]]\nkind = \"replay\"\nbus = \"0.0\"\nfile = \"bus.log\"\n";
        let bus = Scenario::new(node);
        bus.write("bus.log", "(0.000000) can0 123#11\n(8.000000) can0 124#22\n");
        bus.run(&[&["dump", "-n", "1", "-T", "9000", "124:7FF"][..], mode].concat())
    };
    assert_eq!(alone(&[]).status.code(), Some(0));
    assert_eq!(alone(&["--listen-only"]).status.code(), Some(1));
}

/// The number of the listening mode selects another mode.
#[test]
fn programs_report_no_frame_of_a_channel_that_does_not_listen() {
    let bus = Scenario::new("[gateway.variant]\nnode_modes = \"loopback_first\"\n");
    let commands: [&[&str]; 3] = [
        &["dump", "--listen-only", "-T", "9000"],
        &["monitor", "--listen-only", "--once"],
        &["bridge", "--listen-only", "--slcan", "127.0.0.1:0"],
    ];
    for command in commands {
        let output = bus.run(command);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(5), "{command:?}: {message}");
        let words = "node mode 1 puts channel 0 into internal loopback, not into listen-only (assumption H9";
        assert!(message.contains(words), "{command:?}: {message}");
        assert_eq!(output.stdout, b"", "{command:?}");
    }
}

#[test]
fn bus_changes_are_reported_on_stderr() {
    let fault = "[[fault]]\nat_ms = 7000\nkind = \"bus_off\"\ngateway = 0\nchannel = 0\n";
    let bus = Scenario::replaying(&FRAMES, fault);
    let output = bus.run(&["dump", "--channel", "0", "-T", "9000"]);
    let errors = String::from_utf8(output.stderr).unwrap();
    let comments: Vec<_> = errors.lines().filter(|line| line.starts_with("# (")).collect();
    assert!(comments[0].ends_with(") can0: bus-off, at 500000/5000000 bit/s"), "{errors}");
    assert!(!String::from_utf8(output.stdout).unwrap().contains('#'));
}

#[test]
fn lost_images_are_reported_on_stderr() {
    let fault = |at_ms, cycles| {
        let kind = "kind = \"lost_frame\"\nway = \"return\"";
        format!("[[fault]]\n{kind}\nat_ms = {at_ms}\ncycles = {cycles}\n")
    };
    let frames: Vec<(u64, &str)> = (0..4000).map(|at| (at, "123#11")).collect();
    let bus =
        Scenario::replaying(&frames, &[fault(9000, 3), fault(9500, 1), fault(11_000, 2)].concat());
    let output = bus.run(&["dump", "-T", "9000"]);
    let errors = String::from_utf8(output.stderr).unwrap();
    let told: Vec<_> = errors.lines().filter_map(|line| line.split(") ").nth(1)).collect();
    // The second report follows a second after the first.
    let expected =
        [3, 1, 2].map(|n| format!("gateway: {n} images lost, received frames may be missing"));
    assert_eq!(told, expected, "{errors}");
    let shown = String::from_utf8(output.stdout).unwrap();
    let (gaps, lines): (Vec<_>, Vec<_>) = shown.lines().partition(|line| line.starts_with('#'));
    assert_eq!(lines.len(), 4000 - 6);
    let expected = [("3", "s"), ("1", ""), ("2", "s")].map(|(count, plural)| {
        format!(
            "# gap: {count} image{plural} of the gateway lost or incomplete, frames may be missing"
        )
    });
    assert_eq!(gaps, expected);
    let options = ["dump", "-T", "9000", "--record", &bus.path("gaps.blf")];
    bus.good(&[&options[..], &["--capture", &bus.path("gaps.pcapng")]].concat());
    let marks = |bytes: &[u8]| bytes.windows(5).filter(|bytes| *bytes == b"gap: ").count();
    assert_eq!(marks(&std::fs::read(bus.path("gaps.pcapng")).unwrap()), 3);
    let blf = std::fs::read(bus.path("gaps.blf")).unwrap();
    let blf = ecan_can_io::recording::Recording::read(&blf, &Default::default()).unwrap();
    assert_eq!((blf.frames.len(), blf.skipped.len()), (4000 - 6, 0));
    let message = bus.fails(6, &["dump", "--record", &bus.path("frames.asc")]);
    assert!(message.contains("frames.asc is not written: this program writes BLF"), "{message}");
    assert!(!std::path::Path::new(&bus.path("frames.asc")).exists());

    // A pending report at the end, and damaged images, which count once.
    let damaged = |kind: &str, at_ms| {
        format!("[[fault]]\nkind = \"{kind}\"\ngateway = 0\nat_ms = {at_ms}\ntimes = 1\n")
    };
    let damages = [damaged("crc_error", 9600), damaged("torn_image", 9700)].concat();
    let faults = format!("{}{damages}", fault(9500, 1));
    let bus = Scenario::replaying(&frames, &faults);
    let output = bus.run(&["dump", "-n", "1700"]);
    let errors = String::from_utf8(output.stderr).unwrap();
    let told: Vec<_> = errors.lines().filter_map(|line| line.split("gateway: ").nth(1)).collect();
    assert_eq!(
        told,
        [
            "1 images lost, received frames may be missing",
            "2 images lost, received frames may be missing"
        ],
        "{errors}"
    );
}

#[test]
fn lost_gateway_recovers() {
    let fault = "[[fault]]\nat_ms = 10000\nkind = \"power_cycle\"\ngateway = 0\noff_ms = 300\n";
    let bus = Scenario::replaying(&[(0, "123#01"), (11_000, "123#02")], fault);
    let output = bus.run(&["dump", "--channel", "0", "-n", "2", "-T", "19000", "-L"]);
    assert_eq!(output.status.code(), Some(0));
    let shown = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<_> = shown.lines().collect();
    assert!(lines[0].ends_with("123#01") && lines[2].ends_with("123#02"), "{shown}");
    assert!(lines[1].starts_with("# gap: ") && lines.len() == 3, "{shown}");
    let errors = String::from_utf8(output.stderr).unwrap();
    let comments: Vec<_> = errors.lines().filter_map(|line| line.split_once(") ")).collect();
    let words: Vec<_> = comments.into_iter().map(|(_, words)| words).collect();
    let is_unknown =
        |words: &str| words.starts_with("gateway: up to ") && words.contains("unknown");
    let (unknown, words): (Vec<&str>, Vec<&str>) =
        words.into_iter().partition(|word| is_unknown(word));
    assert_eq!(unknown.len(), 1, "its images before the power cycle: {errors}");
    let course = ["gateway: lost, waits for its process data to arrive", "gateway: ready after "];
    let is_course = words.iter().zip(course).all(|(words, course)| words.starts_with(course));
    assert!(is_course && words.len() == course.len(), "{words:?}");
}

#[test]
fn dump_ends_cleanly_on_signal_or_closed_output() {
    let frames: Vec<(u64, &str)> = (0..1500).map(|at| (at * 20, "123#11")).collect();
    let bus = Scenario::replaying(&frames, "");
    // In real time, the frames are sent from the start.
    let log = bus.read("bus.log").replacen("(0.000000) can0 000#\n", "", 1);
    bus.write("bus.log", &log);
    let [mut stopped, mut unread] = [(); 2].map(|()| bus.start(&["dump"]));
    assert_eq!(stopped.line(), "  can0  123   [1]  11");
    assert_eq!(unread.line(), "  can0  123   [1]  11");
    stopped.terminate();
    unread.close_stdout();
    for mut running in [stopped, unread] {
        let errors = running.ends(0);
        assert_eq!(errors.lines().filter(|line| !line.starts_with("SIMULATED")).count(), 0);
    }
}

#[test]
fn invalid_use_has_message_and_status() {
    all_fail(&[
        (2, &["dump", "can0"], "ecan dump --channel can0`"),
        (2, &["dump", "can2,123:7FF"], "ecan dump --channel can2 123:7FF`"),
        (2, &["dump", "123"], "expected ID:MASK or ID~MASK"),
        (2, &["dump", "12G:7FF"], "expected ID:MASK or ID~MASK"),
        (2, &["dump", "--channel", "4"], "expected channels 0 to 3"),
        (2, &["dump", "-n", "0"], "0 is not in 1.."),
        (2, &["dump", "-t", "x"], "possible values: a, d, z, A"),
        (2, &["dump", "-L", "-a"], "cannot be used with"),
        (2, &["dump", "--screen"], "--record"),
        (
            2,
            &["--ecrt", "sim", "dump", "--pdo-n", "25"],
            "N = 25 is out of range; allowed: 1 to 24",
        ),
        (2, &["--ecrt", "sim", "dump", "--bitrate", "333"], "bit/s"),
        (2, &["dump", "--sample-point", "120"], "expected a percentage"),
        (6, &["--ecrt", "sim", "dump", "-l", "/nonexistent/a.log"], "cannot write /nonexistent/a"),
    ]);
}
