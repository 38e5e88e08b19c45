//! cantools decodes and encodes the same frames to the same values and bytes.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use ecan_can_io::dbc::{Database, Number};
use ecan_protocol::can::{CanFrame, CanId};

/// Names the interpreter, usually that of a virtual environment.
const PYTHON_VARIABLE: &str = "ECAN_PYTHON";

/// Prints what a script of this name prints; `None` without cantools, with the reason.
fn script(name: &str, arguments: &[&Path]) -> Option<String> {
    let named = std::env::var_os(PYTHON_VARIABLE).filter(|value| !value.is_empty());
    let interpreter = named.as_ref().map_or_else(|| PathBuf::from("python3"), PathBuf::from);
    let imported = Command::new(&interpreter).args(["-c", "import cantools"]).output();
    if !imported.is_ok_and(|output| output.status.success()) {
        assert!(named.is_none(), "{PYTHON_VARIABLE}={}: no cantools", interpreter.display());
        let reason = format!("no cantools; {PYTHON_VARIABLE} may name an interpreter with it");
        let _ = writeln!(std::io::stderr(), "skipped: {reason}");
        return None;
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/dbc/python").join(name);
    let output = Command::new(interpreter).arg("-B").arg(path).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap())
}

fn bytes(hex: &str) -> Vec<u8> {
    let byte = |at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap();
    (0..hex.len()).step_by(2).map(byte).collect()
}

fn is_equal(number: Number, text: &str) -> bool {
    if let Number::Integer(integer) = number {
        return integer.to_string() == text;
    }
    let (ours, other) = (number.as_f64(), text.parse::<f64>().unwrap());
    (ours - other).abs() <= other.abs() * 1e-6
}

#[test]
fn cantools_agrees_on_values_and_bytes() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/dbc/files/signals.dbc");
    let Some(lines) = script("decode.py", &[&file]) else { return };
    let database = Database::parse(&std::fs::read(&file).unwrap()).unwrap();
    let (mut decoded_frames, mut encoded_frames) = (0, 0);
    for line in lines.lines() {
        let mut words = line.split(' ');
        let mut next = || words.next().unwrap();
        let (id, form, data, encoded) = (next(), next(), bytes(next()), bytes(next()));
        let id = CanId::new(u32::from_str_radix(id, 16).unwrap(), form == "E").unwrap();
        let values: Vec<_> = words.map(|word| word.split_once('=').unwrap()).collect();
        let frame = CanFrame::fd(id, &data, false, false).unwrap();
        let ours = database.decode(&frame).unwrap();
        assert_eq!(ours.signals.len(), values.len(), "{line}");
        for (name, value) in &values {
            let signal = ours.signals.iter().find(|other| other.signal.name == *name).expect(line);
            assert!(is_equal(signal.value, value), "{line}: {signal}");
        }
        decoded_frames += 1;
        let is_in_range = |decoded: &ecan_can_io::dbc::DecodedSignal<'_>| {
            let value = decoded.value.as_f64();
            decoded.signal.range.is_none_or(|(least, most)| (least..=most).contains(&value))
        };
        // cantools was asked to ignore the ranges of the file.
        if ours.signals.iter().all(is_in_range) {
            let again = ours.message.encode(&values).unwrap();
            assert_eq!(again.data(), encoded, "{line}");
            encoded_frames += 1;
        }
    }
    assert_eq!(decoded_frames, 450, "50 of each message");
    assert!(encoded_frames >= 400, "{encoded_frames}");
}
