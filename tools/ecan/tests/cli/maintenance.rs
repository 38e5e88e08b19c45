//! `reg`, `filter`, `pins`, `reboot`, `plan` and the replacement of a gateway, used and misused.

use crate::support::{assert_has, ends, fails, good, json_of, scenario, setting, simulated};

#[test]
fn registers_are_read_by_name_and_offset() {
    let expected =
        "CAN0 PSR (0x0044) = 0x00000707: synchronising, error active, last error: no change\n";
    assert_eq!(simulated(&["reg", "read", "PSR", "--channel", "0"]), expected);
    assert_eq!(simulated(&["reg", "read", "0x44", "--channel", "can0"]), expected);
    assert_eq!(
        simulated(&["reg", "read", "0x0C4", "--channel", "3"]),
        "CAN3 TXFQS (0x00C4) = 0x00000000: 0 elements free\n"
    );
    let json = json_of(&simulated(&["reg", "read", "endn", "--channel", "1", "--json"]));
    assert_eq!((&json["value"], &json["name"]), (&0x8765_4321_u32.into(), &"ENDN".into()));
}

#[test]
fn whitelisted_registers_are_written() {
    assert_eq!(
        simulated(&["reg", "write", "IE", "0x3", "--channel", "2"]),
        "CAN2 IE (0x0054) = 0x00000003\n"
    );
    let listed = good(&["reg", "list"]);
    assert!(listed.contains("0x0018  CCCR    rw  control\n"), "{listed}");
    assert!(listed.contains("0x0044  PSR     ro  protocol status\n"), "{listed}");
    // A protected register keeps its value outside INIT and CCE: said, and told by the status.
    let arguments = ["--ecrt", "sim", "reg", "write", "GFC", "0x3F", "--channel", "0"];
    assert_has(&fails(1, &arguments), "GFC does not contain 0x0000003F");
}

#[test]
fn filters_are_listed_and_added() {
    let none = "\
CAN0 standard: no filters; other frames: RX FIFO0
CAN0 extended: no filters; other frames: RX FIFO0
";
    assert_eq!(simulated(&["filter", "list", "--channel", "0"]), none);
    assert_eq!(simulated(&["filter", "clear", "--channel", "0", "--no-apply"]), none);
    for (wanted, line) in [
        (&["--range", "0x180", "0x1FF"][..], "  0  0x180 to 0x1FF  RX FIFO0\n"),
        (&["--id", "0x80", "--to", "priority-fifo0"], "  0  0x080  RX FIFO0, priority mark\n"),
        (&["--id", "1", "2", "--to", "reject"], "  0  0x001 and 0x002  rejected\n"),
        (&["--id", "5", "--buffer", "3"], "  0  0x005  RX buffer 3\n"),
        (
            &["--extended", "--mask", "0x18FF0000", "0x1FFF0000", "--to", "fifo1", "--sync"],
            "  0  0x18FF0000 in the bits of 0x1FFF0000  RX FIFO1  sync message\n",
        ),
        (
            &["--extended", "--range", "1", "9", "--unmasked"],
            "  0  0x00000001 to 0x00000009, without global mask  RX FIFO0\n",
        ),
    ] {
        let listed = simulated(&[&["filter", "add", "--channel", "0"], wanted].concat());
        assert!(listed.contains(line), "{wanted:?}: {listed}");
        assert!(listed.contains(": 1 filter; other frames: RX FIFO0\n"), "{listed}");
    }
}

#[test]
fn pins_are_shown_and_rotated() {
    let shown = simulated(&["pins"]);
    assert!(shown.starts_with("rotation   0 of 0, 1, 2, 3\nrequested  0, apply status 0\n"));
    let rotated = simulated(&["pins", "3"]);
    assert!(rotated.starts_with("rotation   3 of 0, 1, 2, 3\n"), "{rotated}");
    assert!(rotated.contains("CAN0       pin group 3\nCAN1       pin group 0\n"), "{rotated}");
}

#[test]
fn rotation_that_is_not_active_is_reported() {
    for effect in ["start", "channel_apply"] {
        let bus = format!("[[gateway]]\n[gateway.variant]\nrotation_effect = \"{effect}\"\n");
        let bus = scenario(&bus);
        let message = fails(5, &["--ecrt", &setting(&bus), "pins", "1"]);
        let expected =
            "rotation not applied: status 0 (0x8000:15), active rotation 0; the firmware may";
        assert!(message.contains(expected) && message.contains("H47"), "{message}");
    }
}

#[test]
fn gateway_restarts_and_responds() {
    assert_eq!(simulated(&["reboot"]), "slave 0: restarting\n");
    let back = json_of(&simulated(&["reboot", "--wait", "--json"]));
    assert_eq!((&back["is_back"], &back["firmware"]), (&true.into(), &"2.2.1".into()));
    assert!(back["after_ms"].as_u64().unwrap() >= 200, "it boots for 200 ms");
    // One that boots for longer than the patience.
    let file = scenario("[[gateway]]\nboot_ms = 9000\n");
    let arguments = ["--ecrt", &setting(&file), "reboot", "--wait", "--timeout", "2s"];
    assert_has(&fails(4, &arguments), "slave 0 does not respond 2 s after the restart");
    // Without any patience nothing is known of it.
    let message = fails(4, &["--ecrt", "sim", "reboot", "--wait", "--timeout", "0"]);
    let expected =
        "slave 0 is still on the bus after 0 s; it accepted the command and may still restart";
    assert!(message.contains(expected), "{message}");
}

#[test]
fn restart_counts_without_an_answer() {
    let lost = "[[fault]]\nkind = \"sdo_response_lost\"\ngateway = 0\nindex = 0x8000\n\
                subindex = 1\nat_ms = 0\n";
    for bus in [
        // The gateway restarts before its answer is fetched.
        "[[gateway]]\nreboot_delay_ms = 0\n".to_owned(),
        format!("[[gateway]]\n{lost}"),
        format!("[master]\nlike = \"igh\"\n[[gateway]]\n{lost}"),
        // It is back before the master reports that there is no answer.
        format!("[[gateway]]\nboot_ms = 1\nreboot_delay_ms = 0\n{lost}"),
    ] {
        let file = scenario(&bus);
        let back = good(&["--ecrt", &setting(&file), "reboot", "--wait"]);
        let ends_well = back.ends_with(" ms, firmware 2.2.1\n");
        assert!(back.starts_with("slave 0: restarted in ") && ends_well, "{bus}: {back}");
    }
}

#[test]
fn missing_restart_is_reported() {
    let abort = |code: &str| {
        let kind = "[[fault]]\nkind = \"sdo_abort\"\ngateway = 0\nindex = 0x8000\nsubindex = 1";
        scenario(&format!("[[gateway]]\n{kind}\ncode = {code}\nat_ms = 0\n"))
    };
    // Without an abort code: the gateway has not received the command.
    let file = abort("0");
    let arguments = ["--ecrt", &setting(&file), "reboot"];
    assert!(good(&arguments).contains("no answer to the command, which a restart explains"));
    assert_has(
        &fails(5, &[&arguments[..], &["--wait"]].concat()),
        "slave 0 did not answer the command and did not restart",
    );
    let file = abort("0x08000022");
    assert_has(&fails(5, &["--ecrt", &setting(&file), "reboot", "--wait"]), "0x08000022");
}

#[test]
fn plan_prints_configuration() {
    let plan =
        good(&["plan", "--pdo-n", "5", "--cycle-us", "1000", "--slaves", "3", "--channel", "all"]);
    assert!(plan.starts_with("plan for 3 gateway(s), cycle 1000.0 us\n"), "{plan}");
    assert!(plan.contains("slave 2 can3"), "{plan}");
    let plan =
        good(&["plan", "--fd", "5000000", "--pdo-n", "8", "--cycle-us", "1000", "--bytes", "64"]);
    assert!(plan.contains("FD"), "{plan}");
    let note = "note: from N = 6, outputs and inputs of a gateway are two datagrams";
    assert!(plan.contains(note) && plan.contains("needs a kernel with PREEMPT_RT"), "{plan}");
    let small = good(&["plan", "--pdo-n", "5", "--cycle-us", "4000"]);
    assert!(!small.contains("note:"), "{small}");
    let plan = ends(1, &["plan", "--pdo-n", "12"]);
    assert!(plan.contains("fault: slave 0: RxPDO size N = 12 needs 1536 bytes"), "{plan}");
    let json = json_of(&ends(1, &["plan", "--frames", "100", "--cycle-us", "1000", "--json"]));
    assert!(json["channels"][0]["most_load"].as_f64().unwrap() > 1.0);
    assert!(
        json["faults"]
            .as_array()
            .unwrap()
            .iter()
            .any(|fault| { fault.as_str().unwrap().contains("of the bus") })
    );
}

#[test]
fn plan_uses_options_of_frame_commands() {
    let plan = |arguments: &[&str]| {
        let json = good(&[&["plan", "--json"], arguments].concat());
        json_of(&json)
    };
    let plain = plan(&[]);
    assert_eq!(plain["cycle_ns"], 1_000_000);
    assert_eq!(plain["images"][0]["area_bytes"], 3 * 128 - 24);
    assert_eq!(plain["working_counter"], serde_json::json!({ "igh_1_6": 3, "igh_1_5": 3 }));
    assert!(plain["mailbox"]["headroom_bytes"].as_u64().unwrap() > 1000);
    assert_eq!(plain["channels"][0]["tx_budget"], 8);
    let named = ["--bitrate", "500000", "--pdo-n", "3", "--cycle-us", "1000", "--channel", "can0"];
    assert_eq!(plan(&named), plain);
    let fd = ["--bitrate", "1000000"];
    let by_one_name = plan(&[&fd[..], &["--data-bitrate", "5000000", "--pdo-n", "8"]].concat());
    assert_eq!(plan(&[&fd[..], &["--fd", "5000000"]].concat()), by_one_name);
    let channels = plan(&["--channel", "0,can2"])["channels"].clone();
    let channels: Vec<_> =
        channels.as_array().unwrap().iter().map(|entry| &entry["channel"]).cloned().collect();
    assert_eq!(channels, [0, 2]);

    let file = scenario(
        "cycle_us = 2000\n[[gateway]]\nn = 2\n[gateway.can1]\nbitrate = 250_000\n\
         [[gateway]]\nn = 3\n[gateway.can0]\nbitrate = 125_000\n[gateway.can3]\n\
         bitrate = 500_000\ndata_bitrate = 2_000_000\n",
    );
    let path = file.path().to_str().unwrap();
    let cell = plan(&["--config", path, "--bytes", "1"]);
    assert_eq!(cell["cycle_ns"], 2_000_000);
    let places = cell["channels"].as_array().unwrap().iter();
    let places: Vec<_> =
        places.map(|place| (place["slave"].clone(), place["channel"].clone())).collect();
    assert_eq!(places, [(0, 1), (1, 0), (1, 3)].map(|(s, c)| (s.into(), c.into())));
    assert!(
        fails(2, &["plan", "--config", path, "--channel", "2"])
            .contains("no gateway has one of the selected")
    );
    assert!(fails(2, &["plan", "--config", path, "--bitrate", "500000"]).contains("--config"));
    for wrong in ["99", "100001"] {
        assert!(fails(2, &["plan", "--cycle-us", wrong]).contains("not in 100..=100000"));
    }
}

#[test]
fn plan_of_recording_uses_replay_channels() {
    let log = tempfile::NamedTempFile::new().unwrap();
    let path = log.path().to_str().unwrap();
    std::fs::write(log.path(), "(1.000000) vcan7 123#01\n(1.100000) vcan7 123#01\n").unwrap();
    for command in [&["plan", "--replay", path][..], &["--ecrt", "sim", "replay", path]] {
        let message = fails(2, &[command, &["--channel", "all"]].concat());
        assert_eq!(message, format!("ecan: {path} has no frames for the selected channels"));
        good(&[command, &["--channel", "3"]].concat());
    }
    good(&["plan", "--replay", path, "--channel", "all", "--slaves", "2"]);
}

#[test]
fn plan_of_recording_uses_mean_rate() {
    let log = tempfile::NamedTempFile::new().unwrap();
    let lines: Vec<_> = (0..=1000)
        .map(|ms| format!("(1700000000.{:06}) can5 123#1122334455667788\n", ms * 999))
        .collect();
    std::fs::write(log.path(), lines.concat()).unwrap();
    let path = log.path().to_str().unwrap();
    let arguments = ["plan", "--slaves", "2", "--channel", "all", "--bitrate", "1000000", "--json"];
    let json = json_of(&good(&[&arguments[..], &["--replay", path]].concat()));
    let load = |slave: u64, channel: u64| {
        let channels = json["channels"].as_array().unwrap();
        let is_place =
            |entry: &&serde_json::Value| entry["slave"] == slave && entry["channel"] == channel;
        channels.iter().find(is_place).unwrap()["least_load"].as_f64().unwrap()
    };
    // 1002 frames a second each way, of 111 bits with the space between, at 1 Mbit/s.
    assert!((load(1, 1) - 2.0 * 1002.0 * 111e-6).abs() < 1e-3, "{json}");
    assert_eq!(load(0, 0), 0.0);
    std::fs::write(log.path(), "no log\n").unwrap();
    assert!(fails(6, &["plan", "--replay", path]).contains("line 1, "));
    std::fs::write(log.path(), "").unwrap();
    assert!(fails(6, &["plan", "--replay", path]).contains("holds no frame"));
}

#[test]
fn invalid_use_has_message_and_status() {
    let small = scenario(
        "[[gateway]]\n[[fault]]\nkind = \"sdo_abort\"\nat_ms = 0\ngateway = 0\nindex = 0x8000\n\
         subindex = 1\ncode = 0x08000022\n",
    );
    let small = setting(&small);
    let sim = "--ecrt";
    let add =
        |rest: &[&'static str]| [&[sim, "sim", "filter", "add", "--channel", "0"], rest].concat();
    let cases: [(i32, Vec<&str>, &str); 20] = [
        (2, vec!["reg", "read", "PSR"], "--channel"),
        (2, vec!["reg", "read", "PSR", "--channel", "4"], "expected a channel, 0 to 3"),
        (2, vec!["reg", "read", "PSX", "--channel", "0"], "unknown register \"PSX\""),
        (2, vec!["reg", "read", "0x45", "--channel", "0"], "multiples of 4"),
        (2, vec!["reg", "read", "0x408", "--channel", "0"], "from 0x0004 to 0x0404"),
        (2, vec!["reg", "write", "PSR", "1", "--channel", "0"], "PSR is not writable"),
        (2, vec!["reg", "write", "IR", "0x100000000", "--channel", "0"], "is out of range"),
        (2, add(&[]), "required"),
        (2, add(&["--id", "0x800"]), "use --extended for 29-bit CAN IDs"),
        (2, add(&["--range", "9", "1"]), "range 0x9..0x1 is empty"),
        (
            2,
            add(&["--id", "1", "--buffer", "12"]),
            "RX buffer 12 does not exist; the layout has 12",
        ),
        (2, add(&["--id", "1", "2", "--buffer", "1"]), "needs exactly one --id"),
        (2, add(&["--id", "1", "--range", "1", "2"]), "cannot be used with"),
        (2, vec![sim, "sim", "filter", "remove", "0", "--channel", "1"], "CAN1: no standard"),
        (2, vec![sim, "sim", "pins", "4"], "rotation 4 is not supported; allowed: 0, 1, 2, 3"),
        (2, vec!["reboot", "--timeout", "3s"], "--wait"),
        (5, vec![sim, &small, "reboot"], "0x08000022"),
        (2, vec!["plan", "--slaves", "0"], "invalid value"),
        (2, vec!["plan", "--channel", "4"], "expected channels 0 to 3"),
        (2, vec!["plan", "--bytes", "9"], "a frame of 9 bytes"),
    ];
    for (status, arguments, words) in cases {
        let message = fails(status, &arguments);
        assert!(message.contains(words), "{arguments:?}: {message}");
    }
    // Each fault once, although one identifier stands in both places.
    let message = fails(2, &add(&["--extended", "--id", "0x20000000"]));
    assert_eq!(
        message,
        "ecan: extended filter: CAN ID 0x20000000 is out of range; allowed: 0 to 0x1FFFFFFF"
    );
}

/// A machine of two gateways by alias, with a file and a log in a directory.
struct Machine {
    directory: tempfile::TempDir,
}

impl Machine {
    fn new() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let file = "[[gateway]]\nalias = 1001\ncan0 = { bitrate = 500_000 }\n\
                    [[gateway]]\nalias = 1002\ncan0 = { bitrate = 250_000 }\n";
        std::fs::write(directory.path().join("cell.toml"), file).unwrap();
        Self { directory }
    }

    fn path(&self, name: &str) -> String {
        self.directory.path().join(name).display().to_string()
    }

    /// Log with serial number, and that of the replaced gateway, of each line.
    fn log(&self) -> Vec<(u64, Option<u64>)> {
        let text = std::fs::read_to_string(self.path("cell.gateways.jsonl")).unwrap();
        let line = |line: &str| {
            let line = json_of(line);
            (line["serial"].as_u64().unwrap(), line["replaces"].as_u64())
        };
        text.lines().map(line).collect()
    }

    /// Arguments for a bus with gateways of these keys.
    fn arguments(&self, gateways: &[&str], more: &[&str]) -> Vec<String> {
        let gateways: String =
            gateways.iter().map(|keys| format!("[[gateway]]\n{keys}\n")).collect();
        let bus = self.path("bus.toml");
        std::fs::write(&bus, gateways).unwrap();
        let words = ["--ecrt", &format!("sim:{bus}"), "config", "replace", &self.path("cell.toml")]
            .map(str::to_owned);
        words.into_iter().chain(more.iter().map(|word| (*word).to_owned())).collect()
    }

    fn replaces(&self, status: i32, gateways: &[&str], more: &[&str]) -> String {
        let arguments = self.arguments(gateways, more);
        let words: Vec<_> = arguments.iter().map(String::as_str).collect();
        match status {
            0 => good(&words),
            status => fails(status, &words),
        }
    }
}

const FIRST: &str = "alias = 1001\nserial = 11";
const SECOND: &str = "alias = 1002\nserial = 12";
const NEW: &str = "serial = 13";

#[test]
fn missing_gateway_is_replaced_by_the_new_one() {
    let machine = Machine::new();
    let noted = machine.replaces(0, &[FIRST, SECOND], &[]);
    assert_has(
        &noted,
        "gateway 1: slave 1, serial number 12, firmware 2.2.1\nno gateway is missing",
    );
    machine.replaces(0, &[FIRST, SECOND], &[]);
    assert_eq!(machine.log(), [(11, None), (12, None)]);

    assert_has(&machine.replaces(2, &[FIRST, NEW], &[]), "use --yes");
    assert_has(
        &machine.replaces(4, &[FIRST], &["--yes"]),
        "gateway 1 (serial number 12) is missing, and the bus has no other gateway",
    );
    let other = format!("{NEW}\nfirmware = [2, 9]");
    let message = machine.replaces(5, &[FIRST, &other], &["--yes"]);
    assert_has(
        &message,
        "expected 2.2.1; nothing was written; use `ecan --slave serial=13 firmware update",
    );
    assert_eq!(machine.log().len(), 2, "nothing was replaced");

    let replaced = machine.replaces(0, &[FIRST, NEW], &["--yes", "--save"]);
    assert_has(&replaced, "slave 1: configured as gateway 1 of ");
    assert_has(&replaced, "  saved in the Flash\n");
    assert_eq!(machine.log(), [(11, None), (12, None), (13, Some(12))]);
    machine.replaces(0, &[FIRST, &format!("alias = 1002\n{NEW}")], &[]);
    assert_eq!(machine.log().len(), 3);
}

#[test]
fn replacement_is_chosen_where_several_are_possible() {
    let machine = Machine::new();
    machine.replaces(0, &[FIRST, SECOND], &[]);
    let spare = "serial = 14";
    assert_has(&machine.replaces(4, &[FIRST, NEW, spare], &["--yes"]), "slaves 1, 2 are new");
    assert_has(&machine.replaces(4, &[NEW, spare], &["--yes"]), "gateways 0 (serial number 11), 1");
    let chosen = ["--yes", "--any-firmware", "--gateway", "1", "--slave", "serial=14"];
    assert_has(
        &machine.replaces(0, &[NEW, spare], &chosen),
        "gateway 1: slave 1, serial number 14",
    );
    let message = machine.replaces(4, &[FIRST, SECOND], &["--yes", "--gateway", "0"]);
    assert_has(&message, "gateway 0 is on the bus");
    assert_has(&machine.replaces(2, &[FIRST], &["--gateway", "2"]), "the file has 2 gateways");
    std::fs::write(machine.path("cell.gateways.jsonl"), "{}\nx\n").unwrap();
    assert_has(&machine.replaces(6, &[FIRST, SECOND], &[]), "line 1: missing field");
}
