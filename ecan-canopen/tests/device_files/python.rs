//! The Python package `canopen` reads the files that are written here, and finds the same values.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use ecan_canopen::{DataType, DataValue, DeviceFile, FileValue, ObjectEntry, ObjectType};

use super::foreign::foreign_files;
use super::{EVERYTHING, everything, node};
use crate::python_peer::python;
use ecan_test_support::Killed;

const NODE: u8 = 17;

/// Data type, access, default and value of an entry, as Python shows them.
type Row = (u16, String, String, String);

/// Output of the script for a text; its last words if it rejects the text.
fn run(python: &Path, text: &str, options: &[&str]) -> Result<String, String> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/device_file.py");
    let mut child = Killed::spawn(
        Command::new(python)
            .arg("-B")
            .arg(script)
            .arg(format!("--node={NODE}"))
            .args(options)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped()),
    );
    let mut input = child.stdin.take().expect("piped");
    let writer = std::thread::spawn({
        let text = text.to_owned();
        move || input.write_all(text.as_bytes())
    });
    let output = child.output();
    writer.join().expect("a thread").expect("written");
    if !output.status.success() {
        let words = String::from_utf8_lossy(&output.stderr);
        return Err(words.lines().last().unwrap_or_default().to_owned());
    }
    Ok(String::from_utf8(output.stdout).expect("UTF-8"))
}

/// Entries that Python reads from a text.
fn load(python: &Path, text: &str) -> Result<BTreeMap<(u16, u8), Row>, String> {
    let output = run(python, text, &[])?;
    let row = |line: &str| {
        let columns: Vec<_> = line.split('\t').collect();
        let [index, subindex, data_type, access, default, value] = columns[..] else {
            panic!("{line}");
        };
        let hexadecimal = |text| u16::from_str_radix(text, 16).expect("a number");
        let key = (hexadecimal(index), hexadecimal(subindex) as u8);
        (key, (hexadecimal(data_type), access.into(), default.into(), value.into()))
    };
    Ok(output.lines().map(row).collect())
}

/// A value as Python shows it; `None` if it reads such values in another way.
fn shown(entry: &ObjectEntry, value: Option<&FileValue>) -> Option<String> {
    let Some(value) = value else { return Some("-".to_owned()) };
    // It does not read the node-ID alone.
    if matches!(value, FileValue::NodeId { offset: 0 }) {
        return None;
    }
    let value = value.resolve(entry.data_type, node(NODE));
    Some(match value {
        DataValue::Bytes(bytes) => bytes.iter().map(|byte| format!("{byte:02x}")).collect(),
        DataValue::Real32(real) => f64::from(real).to_string(),
        DataValue::Time { days, milliseconds } => {
            (u64::from(days) << 32 | u64::from(milliseconds)).to_string()
        }
        // It cuts a text at a semicolon.
        DataValue::Text(text) if text.contains(" ;") => return None,
        // It leaves the hexadecimal digits of a negative number unsigned.
        DataValue::Signed(number) => entry.data_type.mask(number as u64).to_string(),
        value => value.to_string(),
    })
}

/// Compares a file with what Python reads from its text. Returns why Python rejects it.
fn compare(python: &Path, file: &DeviceFile, text: &str, name: &str) -> Result<(), String> {
    let rows = load(python, text)?;
    let mut compared = 0;
    for object in file.objects().filter(|object| object.index >= 0x1000) {
        // It reads only the first sub-object of an array that is described in short form.
        let is_array = object.object_type == ObjectType::Array;
        let first_only = object.is_compact && is_array;
        let is_known = matches!(
            object.object_type,
            ObjectType::Var | ObjectType::Domain | ObjectType::Array | ObjectType::Record
        );
        for entry in object.entries().filter(|_| is_known) {
            let key = (entry.index, entry.subindex);
            if object.is_compact && (!is_array || entry.subindex != 1) {
                continue;
            }
            let Some((data_type, access, default, value)) = rows.get(&key) else {
                panic!("{name}: {key:04X?} is missing");
            };
            // It takes types that it does not have as domains.
            if !matches!(entry.data_type, DataType::Other(_)) {
                assert_eq!(*data_type, entry.data_type.index(), "{name}: {key:04X?}");
            }
            assert_eq!(access, entry.access.word(), "{name}: {key:04X?}");
            let has_raw_text = entry.extra.iter().any(|(key, _)| key.ends_with("Value"));
            if let Some(expected) = shown(entry, entry.default.as_ref())
                && !has_raw_text
            {
                same(entry, default, &expected, &format!("{name}: {key:04X?} default"));
            }
            // The values of objects in short form are in sections that it does not read.
            if let Some(expected) = shown(entry, entry.parameter.as_ref())
                && !first_only
            {
                same(entry, value, &expected, &format!("{name}: {key:04X?} value"));
            }
            compared += 1;
        }
    }
    assert!(compared > 0, "{name}");
    println!("{name}: {compared} entries are the same in Python");
    Ok(())
}

/// Compares texts; integers by the bits of their type, reals by their value.
fn same(entry: &ObjectEntry, found: &str, expected: &str, context: &str) {
    let is_same = if entry.data_type.is_integer() {
        let bits = |text: &str| {
            text.parse::<i128>().map(|number| entry.data_type.mask(number as u64)).ok()
        };
        bits(found) == bits(expected)
    } else if matches!(entry.data_type, DataType::Real32 | DataType::Real64) {
        let real = |text: &str| text.parse::<f64>().map(|real| real as f32).ok();
        real(found) == real(expected)
    } else {
        found == expected
    };
    assert!(is_same, "{context}: {found}, expected {expected}");
}

#[test]
fn python_reads_the_same_values() {
    let Some(python) = python() else { return };
    let file = everything();
    // It does not read octal numbers.
    let text = EVERYTHING.replace("DefaultValue=017", "DefaultValue=15");
    compare(&python, &file, &text, "everything.dcf").unwrap();
    compare(&python, &file, &file.write(), "everything.dcf, written").unwrap();
}

/// A DCF with values that a node returned.
#[test]
fn python_reads_values_of_node() {
    let Some(python) = python() else { return };
    let mut file = everything();
    assert_eq!(file.set_parameter(0x2004, 0, &(-77i32).to_le_bytes()), Ok(true));
    assert_eq!(file.set_parameter(0x200F, 0, b"left\0"), Ok(true));
    assert_eq!(file.set_parameter(0x2010, 0, &[0xDE, 0xAD]), Ok(true));
    assert_eq!(file.set_parameter(0x200D, 0, &2.5f32.to_le_bytes()), Ok(true));
    assert_eq!(file.set_parameter(0x7FFF, 0, &[]), Ok(false));
    assert!(file.set_parameter(0x2004, 0, &[1]).is_err());
    let rows = load(&python, &file.write()).unwrap();
    let value = |index| rows[&(index, 0)].3.as_str();
    assert_eq!(value(0x2004), "-77");
    assert_eq!(value(0x200F), "left");
    assert_eq!(value(0x2010), "dead");
    assert_eq!(value(0x200D), "2.5");
    compare(&python, &file, &file.write(), "everything.dcf with values").unwrap();
}

/// In the other direction: the DCF that Python writes.
#[test]
fn dcf_of_python_is_read() {
    let Some(python) = python() else { return };
    let file = everything();
    let text = run(&python, &file.write(), &["--export"]).unwrap();
    let again = DeviceFile::parse(text.as_bytes()).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(again.node_id(), Some(node(NODE)));
    assert_eq!(again.device_info.vendor_number, file.device_info.vendor_number);
    assert_eq!(again.device_info.bit_rates, file.device_info.bit_rates);
    assert_eq!(again.comments, file.comments);
    let mut compared = 0;
    for object in file.objects().filter(|object| !object.is_compact) {
        for entry in object.entries() {
            let other = again.entry(entry.index, entry.subindex).expect("an entry");
            let key = (entry.index, entry.subindex);
            assert_eq!(other.name, entry.name, "{key:04X?}");
            assert_eq!(other.data_type, entry.data_type, "{key:04X?}");
            assert_eq!(other.access, entry.access, "{key:04X?}");
            assert_eq!(other.pdo_mapping, entry.pdo_mapping, "{key:04X?}");
            assert_eq!(other.default, entry.default, "{key:04X?}");
            assert_eq!(other.parameter, entry.parameter, "{key:04X?}");
            compared += 1;
        }
    }
    assert!(compared > 35, "{compared}");
}

#[test]
fn python_reads_foreign_files_likewise() {
    let Some(python) = python() else { return };
    for (path, bytes) in foreign_files() {
        let file = DeviceFile::parse(&bytes).unwrap();
        let name = path.display().to_string();
        // It is stricter in some points.
        if let Err(words) = compare(&python, &file, &String::from_utf8_lossy(&bytes), &name) {
            println!("{name}: rejected by Python: {words}");
        }
        compare(&python, &file, &file.write(), &format!("{name}, written")).unwrap();
    }
}
