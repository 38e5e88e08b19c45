//! `config schema` and `config init`.

use std::path::Path;
use std::process::Command;

use crate::support::python::python_with;
use crate::support::{Scenario, good, simulated};

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples");

#[test]
fn first_file_is_short_and_can_be_used() {
    let files = Scenario::new("");
    let text = good(&["config", "init"]);
    assert!(text.lines().count() <= 13, "{text}");
    let file = files.write("cell.toml", &text);
    let checked = good(&["config", "check", &file]);
    // The default of N is that of classic CAN.
    assert!(checked.contains("  RxPDO  N = 3: 384 bytes"), "{checked}");
    assert!(checked.contains("nominal  500000 bit/s"), "{checked}");
    let applied = simulated(&["config", "apply", &file]);
    assert!(applied.starts_with("slave 0: configured as gateway 0 of "), "{applied}");
    let sent = simulated(&["send", "--config", &file, "123#00"]);
    assert_eq!(sent, "can0 123#00 sent\n");
}

#[test]
fn python_validates_files_with_the_schema() {
    let Some(python) = python_with(&["jsonschema", "tomllib"], "jsonschema") else { return };
    let files = Scenario::new("");
    let schema = files.write("schema.json", &good(&["config", "schema"]));
    let example = good(&["config", "example"]);
    // Every key, also those that the example has as comments only.
    let commented = example.lines().map(|line| {
        let is_table = |line: &str| line.starts_with('[') && line.ends_with(']');
        let is_key = |line: &str| {
            line.starts_with(|c: char| c.is_ascii_lowercase() || c == '"') && line.contains(" = ")
        };
        line.strip_prefix("# ").filter(|line| is_table(line) || is_key(line)).unwrap_or(line)
    });
    let commented: String = commented.map(|line| format!("{line}\n")).collect();
    let valid = [
        files.write("init.toml", &good(&["config", "init"])),
        files.write("example.toml", &example),
        files.write("every_key.toml", &commented),
        format!("{EXAMPLES}/network/machine.toml"),
    ];
    let gateway = "[[gateway]]\ncan0 = { bitrate = 500_000 }\n";
    let wrong = [
        ("nonsense = 1", "Additional properties are not allowed ('nonsense' was unexpected)"),
        ("[[gateway]]\nn = 30", "30 is greater than the maximum of 24"),
        ("[[gateway]]\nn = \"8\"", "'8' is not of type 'integer'"),
        ("[[gateway]]\ncan0 = {}", "'bitrate' is a required property"),
        ("[[gateway]]\ncan0 = { bitrate = 1, node_mode = 'loud' }", "'loud' is not one of ["),
        ("[[axis]]\ngateway = 0\nchannel = 4\nnode = 1", "4 is greater than the maximum of 3"),
        ("[dc]\nsource = 'hst'", "'hst' is not one of ['host', 'reference']"),
    ];
    let wrong_files = wrong.iter().zip(0..).map(|((text, _), number)| {
        let text = if text.contains("gateway]]") {
            (*text).to_owned()
        } else {
            format!("{text}\n{gateway}")
        };
        files.write(&format!("wrong{number}.toml"), &text)
    });
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/python/validate.py");
    let mut command = Command::new(python);
    command.arg("-B").arg(script).arg(&schema).args(&valid).args(wrong_files);
    let output = command.output().unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{errors}");
    let printed = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<_> = printed.lines().collect();
    assert_eq!(lines.len(), valid.len() + wrong.len(), "{printed}");
    for (file, line) in valid.iter().zip(&lines) {
        assert_eq!(*line, "valid", "{file}");
    }
    for ((text, expected), line) in wrong.iter().zip(&lines[valid.len()..]) {
        assert!(line.contains(expected), "{text}: {line}");
    }
}
