//! Signals of DBC files in `dump`, `send` and `monitor`.

use serde_json::{Value, json};

use crate::support::{SIM, Scenario, fails, json_of};

const DBC: &str = "\
BO_ 291 Engine: 4 ECU
 SG_ Speed : 0|16@1+ (0.1,0) [0|6553.5] \"km/h\" Tool
 SG_ Gear : 16|4@1+ (1,0) [0|15] \"\" Tool

BO_ 2566834709 Status: 2 ECU
 SG_ Page M : 0|8@1+ (1,0) [0|255] \"\" Tool
 SG_ Current m1 : 15|8@0- (0.5,0) [0|0] \"A\" Tool

VAL_ 291 Gear 0 \"Neutral\" 1 \"First\" ;
";

/// CAN ID of the message `Status`.
const STATUS: &str = "18FECA15";

fn bus() -> Scenario {
    let status = format!("{STATUS}#01FF");
    let frames = [(0, "123#E8030100"), (500, "124#01"), (600, &status), (700, "123#E803")];
    let bus = Scenario::replaying(&frames, "");
    bus.write("cell.dbc", DBC);
    bus
}

#[test]
fn dump_shows_signals_below_frames() {
    let bus = bus();
    let dbc = bus.path("cell.dbc");
    let expected = "\
\x20\x20can0  123   [4]  E8 03 01 00
          Engine
            Speed  100.0 km/h
            Gear   1 (First)
  can0  124   [1]  01
  can0  18FECA15   [2]  01 FF
          Status
            Page     1
            Current  -0.5 A
  can0       123   [2]  E8 03
          Engine, frame too short, signals missing: 1
            Speed  100.0 km/h
";
    let shown = bus.good(&["dump", "-n", "4", "--dbc", &dbc]);
    assert_eq!(shown, expected);
    // What is shown can be replayed.
    let read = ecan_can_io::recording::Recording::parse(&shown, &Default::default()).unwrap();
    assert_eq!(read.frames.len(), 4);
    let other = bus.good(&["dump", "-n", "1", "--dbc", &format!("1={dbc}")]);
    assert_eq!(other, "  can0  123   [4]  E8 03 01 00\n");
    let shown = bus.good(&["dump", "-n", "2", "--json", "--dbc", &format!("can0={dbc}")]);
    let lines: Vec<Value> = shown.lines().map(json_of).collect();
    assert_eq!(lines[0]["message"], "Engine");
    let signals = json!([
        { "name": "Speed", "value": 100.0, "unit": "km/h", "text": null },
        { "name": "Gear", "value": 1, "unit": "", "text": "First" },
    ]);
    assert_eq!(lines[0]["signals"], signals);
    assert_eq!(lines[0]["missing_signals"], 0);
    assert_eq!(lines[1].get("message"), None);
}

#[test]
fn send_encodes_signals() {
    let bus = Scenario::new("[[node]]\nkind = \"silent\"\nbus = \"0.0\"\n");
    let dbc = bus.write("cell.dbc", DBC);
    let send = |words: &[&str]| bus.good(&[&["send", "--dbc", &dbc], words].concat());
    let expected = "\
can0 123#E8030100 sent
          Engine
            Speed  100.0 km/h
            Gear   1 (First)
can0 18FECA15#01FF sent
          Status
            Page     1
            Current  -0.5 A
can0 124#01 sent
";
    let words = ["Engine", "Speed=100", "Gear=first", "Status", "Current=-0.5", "124#01"];
    assert_eq!(send(&words), expected);
    let shown = json_of(&send(&["Engine", "124#", "--json"]));
    assert_eq!(shown["frames"], json!(["123#00000000", "124#"]));
    assert_eq!(shown["messages"][0]["signals"][1]["text"], "Neutral");
    assert_eq!(shown["messages"][1], Value::Null);
}

#[test]
fn invalid_signals_name_what_is_allowed() {
    let bus = bus();
    let dbc = bus.path("cell.dbc");
    let faulty = bus.write("faulty.dbc", "BO_ 9999 A: 8 X\nBO_ 1 B: 99 X\n");
    let cases: [(i32, &[&str], &str); 10] = [
        (2, &["send", "Engine", "Speed=1"], "message Engine needs --dbc FILE; a frame is ID#DATA"),
        (2, &["send", "--dbc", &dbc, "Speed=1"], "follows no message; give MESSAGE Speed=1"),
        (2, &["send", "--dbc", &dbc, "Engin"], "unknown message \"Engin\"; similar: Engine"),
        (
            2,
            &["send", "--dbc", &dbc, "Engine", "Sped=1"],
            "unknown signal \"Sped\"; similar: Speed",
        ),
        (2, &["send", "--dbc", &dbc, "Engine", "Speed=7000"], "allowed: 0 to 6553.5 km/h"),
        (2, &["send", "--dbc", &dbc, "Engine", "Gear=Fist"], "or a text, as in First"),
        (2, &["send", "--dbc", &dbc, "Status", "Page=2", "Current=1"], "Page is 1; given"),
        (2, &["dump", "-L", "--dbc", &dbc], "cannot be used with"),
        (6, &["dump", "--dbc", "/nonexistent.dbc"], "cannot read /nonexistent.dbc"),
        (6, &["dump", "--dbc", &faulty], "faulty.dbc: 2 faults\n  - line 1: CAN ID 9999 is out"),
    ];
    for (status, arguments, words) in cases {
        let message = fails(status, &[&["--ecrt", SIM], arguments].concat());
        assert!(message.contains(words), "{arguments:?}: {message}");
    }
}

/// A message that does not fit a CAN frame, as of J1939, and one with a long name.
#[test]
fn faults_of_a_file_are_warnings() {
    let bus = Scenario::replaying(&[(0, "123#07")], "");
    let name = "a_name_of_more_than_thirty_two_characters";
    let dbc = bus.write(
        "partly.dbc",
        &format!(
            "BO_ 2365475321 L: 1785 E\n SG_ A : 0|8@1+ (1,0) [0|0] \"\" E\nBO_ 291 Cut_0: 8 E\n \
             SG_ A : 0|8@1+ (1,0) [0|0] \"\" E\n\
             BA_ \"SystemMessageLongSymbol\" BO_ 291 \"{name}\";\n"
        ),
    );
    let output = bus.run(&["dump", "-n", "1", "--dbc", &dbc]);
    let errors = String::from_utf8(output.stderr).unwrap();
    let warning =
        "partly.dbc: line 1: message length 1785 is out of range; allowed: 0 to 64 bytes\n";
    assert!(errors.contains(warning) && output.status.success(), "{errors}");
    assert!(errors.contains("the last one counts; faults: 1\n"), "{errors}");
    let shown = String::from_utf8(output.stdout).unwrap();
    assert!(shown.contains(name) && shown.contains("A  7"), "{shown}");
}

#[test]
fn monitor_prints_signals_once() {
    let bus = bus();
    let dbc = bus.path("cell.dbc");
    let view = ["monitor", "--for", "12s", "--view", "ids", "--channel", "0", "--dbc", &dbc];
    let shown = bus.good(&view);
    let signals = "
bus  dir  CAN ID    message                               signal   value
0.0  rx   123       Engine, frame too short, signals missing: 1  Speed    100.0 km/h
0.0  rx   18FECA15  Status                                Page     1
0.0  rx   18FECA15  Status                                Current  -0.5 A
";
    let words = |text: &str| {
        let lines = text.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "));
        lines.collect::<Vec<_>>().join("\n")
    };
    assert!(words(&shown).ends_with(&words(signals)), "{shown}");
    let shown = json_of(&bus.good(&[&view[..], &["--json"]].concat()));
    let status = shown["ids"].as_array().unwrap().iter().find(|id| id["is_extended"] == true);
    assert_eq!(status.unwrap()["signals"][1]["value"], -0.5);
}
