//! `ecan send`, `gen` and `replay`: frames that leave, and frames that do not.

use crate::support::{Scenario, all_fail, assert_has, fails, json_of, simulated};

#[test]
fn frames_are_sent_and_confirmed() {
    assert_eq!(simulated(&["send", "123#DEADBEEF"]), "can0 123#DEADBEEF sent\n");
    // The gateway is set to CAN FD, so it goes without a bit rate.
    assert_eq!(simulated(&["send", "--channel", "can1", "123##1AABB"]), "can1 123##1AABB sent\n");
    let several = ["send", "--channel", "2", "1FFFFFFF#", "7FF#R3", "000#01.02.03"];
    let expected = "can2 1FFFFFFF# sent\ncan2 7FF#R3 sent\ncan2 000#010203 sent\n";
    assert_eq!(simulated(&several), expected);
    let fd = ["send", "--data-bitrate", "2000000", "123##1AABB", "--json"];
    let sent = json_of(&simulated(&fd));
    let expected =
        serde_json::json!({ "is_simulated": true, "channel": 0, "frames": ["123##1AABB"] });
    assert_eq!(sent, expected);
    // More than an image holds.
    let many: Vec<String> = (0..200).map(|id| format!("{id:03X}#1122334455667788")).collect();
    let arguments: Vec<&str> =
        ["send"].into_iter().chain(many.iter().map(String::as_str)).collect();
    assert_eq!(simulated(&arguments).lines().count(), 200);
}

#[test]
fn selected_gateway_sends() {
    let second = "[[gateway]]\nalias = 7\n[[node]]\nkind = \"echo\"\nbus = \"1.0\"\n";
    let bus = Scenario::new(second);
    assert_eq!(bus.good(&["send", "123#", "--slave", "alias=7"]), "can0 123# sent\n");
    // The first has nobody on its bus.
    bus.fails(1, &["send", "123#", "--slave", "0", "--timeout", "100"]);
}

#[test]
fn unacknowledged_frame_is_not_sent() {
    let alone = Scenario::new("");
    let message = alone.fails(1, &["send", "123#11", "124#22", "--timeout", "300"]);
    assert!(message.contains("can0: run, warning: error passive"), "{message}");
    assert!(message.contains("2 of 2 frames not sent within 300 ms"), "{message}");
    assert!(message.contains("check for another node with 500000/5000000 bit/s"), "{message}");
}

/// The channel status does not count the frame that the controller repeats without end.
#[test]
fn unacknowledged_frame_in_the_controller_is_not_sent() {
    let alone = Scenario::new("[gateway.variant]\ntx_pending = \"without_running\"\n");
    let message = alone.fails(1, &["send", "123#11", "--timeout", "300"]);
    assert!(message.contains("1 of 1 frames not sent within 300 ms"), "{message}");
    assert!(message.contains("channel 0 gets no acknowledgement"), "{message}");
}

#[test]
fn missing_transmit_results_name_the_assumption() {
    let node = "[[node]]\nkind = \"echo\"\nbus = \"0.0\"\n";
    let bus = Scenario::new(&format!("[gateway.variant]\ntx_results = \"failures_only\"\n{node}"));
    for command in [&["send", "123#11"][..], &["gen", "-n", "5"]] {
        let message = bus.fails(1, command);
        assert!(message.contains("no transmit result arrived"), "{message}");
        assert!(message.contains("(assumption H17)"), "{message}");
    }
}

#[test]
fn bus_off_channel_is_reported() {
    let fault = "[[fault]]\nat_ms = 1100\nkind = \"bus_off\"\ngateway = 0\nchannel = 0\n";
    let alone = Scenario::new(fault);
    let message = alone.fails(1, &["send", "123#11", "--timeout", "1000"]);
    assert!(message.contains("can0: bus-off"), "{message}");
    let words = "1 of 1 frames not sent within 1000 ms: channel 0 went bus-off";
    assert!(message.contains(words), "{message}");
}

#[test]
fn frequent_changes_are_limited() {
    // The others have another bit rate: warnings and bus-off alternate.
    let others = "[[node]]\nkind = \"echo\"\nbus = \"0.0\"\nbitrate = 250000\n";
    let bus = Scenario::new(others);
    let message = bus.fails(1, &["send", "123#11", "--timeout", "3000"]);
    let lines = message.lines().filter(|line| line.starts_with("# (")).count();
    assert!((1..=8).contains(&lines), "{message}");
    assert!(message.contains("at 500000/5000000 bit/s"), "{message}");
}

#[test]
fn generated_frames_are_counted() {
    let shown = simulated(&["gen", "-n", "3", "-g", "4", "-I", "42A", "-L", "1", "-D", "i", "-v"]);
    let lines: Vec<_> = shown.lines().collect();
    let frames = ["  can0  42A   [1]  00", "  can0  42A   [1]  01", "  can0  42A   [1]  02"];
    assert_eq!(lines[..3], frames);
    assert!(lines[3].starts_with("3 frames sent, 0 lost, "), "{shown}");
    assert!(lines[3].ends_with(" frames/s"), "{shown}");

    let json = simulated(&["gen", "-n", "1000", "-g", "0", "-L", "8", "--seed", "1", "--json"]);
    let summary = json_of(&json);
    assert_eq!((&summary["sent"], &summary["lost"]), (&1000.into(), &0.into()));
    // A frame of 8 bytes takes 108 bits and more; half of the bus is the echo's.
    let rate = summary["frames_per_second"].as_f64().unwrap();
    assert!((1500.0..500_000.0 / 108.0).contains(&rate), "{rate}");

    let mixed = ["gen", "-n", "300", "-g", "0.5", "-m", "--data-bitrate", "4000000", "--seed", "7"];
    assert!(simulated(&mixed).starts_with("300 frames sent, 0 lost, "));
}

#[test]
fn unsent_generated_frames_are_lost() {
    let alone = Scenario::new("");
    for count in ["3", "1000"] {
        let output = alone.run(&[
            "gen",
            "--seed",
            "1",
            "-n",
            count,
            "-g",
            "0",
            "--timeout",
            "300",
            "--json",
        ]);
        assert_eq!(output.status.code(), Some(1));
        let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(summary["sent"], 0);
        let behind = summary["lost"].as_u64().unwrap() + summary["not_tried"].as_u64().unwrap();
        assert_eq!(behind.to_string(), count);
        let errors = String::from_utf8(output.stderr).unwrap();
        let words = format!("{count} of {count} frames not confirmed as sent: channel 0 gets");
        assert!(errors.contains(&words), "{errors}");
    }
}

const SIM: &str = "--ecrt=sim";
const CLASSIC: &str = "--bitrate=500000";

const LOG: &str = "\
(1000.000000) can0 100#00
(1000.250000) can1 12345678#R4
# a comment
(1000.260000) can0 7FF#1122334455667788
(1001.000000) can7 123#41
";

#[test]
fn replay_keeps_times_and_records_echo() {
    let bus = Scenario::new("[[node]]\nkind = \"echo\"\nbus = \"0.0\"\n");
    let (log, back) = (bus.write("drive.log", LOG), bus.path("back.log"));
    let shown = bus.good(&["replay", &log, "--record", &back]);
    assert!(shown.starts_with("4 frames sent, 0 lost, 4 received in 1."), "{shown}");
    let records = |text: &str| {
        let records =
            text.lines().filter_map(|line| ecan_can_io::candump::parse_line(line).unwrap());
        records.map(|record| (record.time_ns, record.frame)).collect::<Vec<_>>()
    };
    let (sent, echoed) = (records(LOG), records(&bus.read("back.log")));
    assert_eq!(echoed.len(), 4);
    for ((sent_ns, frame), (echoed_ns, echo)) in sent.iter().zip(&echoed) {
        assert_eq!(frame, echo);
        // Cycles of a millisecond, a frame out and one back.
        let since = |time_ns: u64, first_ns: u64| time_ns.abs_diff(first_ns);
        let shift = since(*sent_ns, sent[0].0).abs_diff(since(*echoed_ns, echoed[0].0));
        assert!(shift <= 2_000_000, "{shift}");
    }
    let shown = bus.good(&["replay", &log, "--speed", "100", "--loop", "3"]);
    assert!(shown.starts_with("12 frames sent, 0 lost, "), "{shown}");
}

#[test]
fn replay_maps_interfaces_to_channels() {
    let nodes: String = (0..4)
        .map(|channel| format!("[[node]]\nkind = \"echo\"\nbus = \"0.{channel}\"\n"))
        .collect();
    let bus = Scenario::new(&nodes);
    let (log, back) = (bus.write("drive.log", LOG), bus.path("back.log"));
    let shown = bus.good(&["replay", &log, "--channel", "all", "--record", &back]);
    // can7 is no channel.
    assert!(shown.starts_with("3 frames sent, 0 lost, 3 received"), "{shown}");
    let text = bus.read("back.log");
    let places: Vec<_> = text.lines().filter_map(|line| line.split_once(") ")).collect();
    let places: Vec<_> = places.into_iter().map(|(_, rest)| rest).collect();
    assert_eq!(places, ["can0 100#00", "can1 12345678#R4", "can0 7FF#1122334455667788"]);
    let shown = bus.good(&["replay", &log, "--channel", "1,2"]);
    assert!(shown.starts_with("1 frames sent, 0 lost, 1 received"), "{shown}");
}

#[test]
fn invalid_use_has_message_and_status() {
    let directory = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = directory.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let (good, fd) = (write("good.log", LOG), write("fd.log", "(1.000000) can0 1FF##1AA\n"));
    let (broken, empty) = (write("b.log", "(1.000000) can0 1#\n"), write("e.log", "\n"));
    all_fail(&[
        (2, &["send", "can1", "123#"], "ecan send --channel can1 123#`"),
        (2, &["send"], "<FRAME>"),
        (2, &["send", "123"], "column 4"),
        (2, &["send", "123#1"], "two hex digits"),
        (2, &["send", "800#"], "CAN ID 800"),
        (
            2,
            &[SIM, "send", CLASSIC, "123##1AA"],
            "123##1AA is a CAN FD frame: channel 0 has no data",
        ),
        (2, &["send", "123#", "--channel", "4"], "expected a channel, 0 to 3"),
        (2, &["gen", "-I", "800", "-n", "1"], "CAN ID 0x800 is out of range; allowed: 0 to 0x7FF"),
        (2, &["gen", "-L", "9"], "expected r, i or a length"),
        (2, &["gen", "-L", "12"], "12 data bytes do not fit"),
        (2, &["gen", "-D", "1"], "x for a random digit"),
        (2, &[SIM, "gen", CLASSIC, "-f"], "channel 0 has no data bit rate; set --data-bitrate"),
        (2, &[SIM, "replay", CLASSIC, &fd], "fd.log, line 1 is a CAN FD frame: channel 0 has no"),
        (2, &["replay", &good, "--record", &good], "would overwrite the recording"),
        (2, &["replay", &good, "--speed", "0"], "expected a factor"),
        (2, &["replay", &good, "--channel", "2,3"], "no frames for the selected channels"),
        (6, &["replay", &broken], "b.log, line 1, column"),
        (6, &["replay", &empty], "holds no frame"),
    ]);
    assert!(fails(6, &["replay", "/nonexistent.log"]).contains("cannot read /nonexistent.log"));
}

#[test]
fn replay_reads_other_formats() {
    let bus = Scenario::new("[[node]]\nkind = \"silent\"\nbus = \"0.0\"\n");
    let deltas = "can0  123   [1]  11\n (000.200000)  can0  123   [1]  12\n \
                  (000.100000)  can0  123   [1]  13\n";
    let screen = bus.write("screen.txt", &format!(" (000.000000)  {deltas}"));
    let asc = "base hex timestamps absolute\n0.0 1 123 Rx d 1 11\n0.1 1 ErrorFrame\n\
               0.3 1 123 Rx d 1 13\n";
    let asc = bus.write("a.asc", asc);
    let trc = ";$FILEVERSION=2.0\n;$COLUMNS=N,O,T,I,d,l,D\n 1 0.0 DT 0123 Rx 1 11\n\
               2 300.0 DT 0123 Rx 1 13\n";
    let trc = bus.write("a.trc", trc);
    let deltas = "# time stamps of the recording: deltas; --time-stamps z if they count from the \
                  first frame\n";
    let cases: [(&[&str], &str, &str); 4] = [
        (&[&screen], "3 frames sent, 0 lost", deltas),
        (&[&screen, "--time-stamps", "z"], "3 frames sent, 0 lost", ""),
        (&[&asc, "--format", "asc"], "2 frames sent, 0 lost", "# error frames in the recording"),
        (&[&trc], "2 frames sent, 0 lost", ""),
    ];
    for (arguments, sent, note) in cases {
        let output = bus.run(&[&["replay"], arguments].concat());
        let errors = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {errors}");
        let shown = String::from_utf8(output.stdout).unwrap();
        assert!(shown.starts_with(sent), "{arguments:?}: {shown}");
        assert!(shown.contains(" in 0.3") || arguments.len() == 3, "{arguments:?}: {shown}");
        assert!(errors.contains(note), "{arguments:?}: {errors}");
        assert!(!note.is_empty() || errors.lines().count() == 1, "{arguments:?}: {errors}");
    }
    let unknown = bus.write("a.txt", "nonsense\n");
    assert_has(&bus.fails(6, &["replay", &unknown]), "a.txt, line 1, format not recognized");
}

#[test]
fn replay_skips_error_messages_and_raw_dlc() {
    let bus = Scenario::new("[[node]]\nkind = \"silent\"\nbus = \"0.0\"\n");
    let log = bus.write(
        "errors.log",
        "(1.000000) can0 123#1122334455667788_B\n(1.500000) can0 20000080#0000000000000000\n\
         (2.000000) can0 123#R8_F\n(2.500000) can0 20000004#0000000000000000\n",
    );
    let output = bus.run(&["replay", &log]);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{errors}");
    let note = "# error frames in the recording skipped: 2\n";
    assert!(errors.ends_with(note), "{errors}");
    assert!(String::from_utf8(output.stdout).unwrap().starts_with("2 frames sent, 0 lost"));
    assert!(bus.good(&["plan", "--replay", &log]).contains("frames"));
}
