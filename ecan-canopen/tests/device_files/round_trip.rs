//! Written files are read again.

use ecan_canopen::DeviceFile;
use proptest::prelude::*;

use super::{EVERYTHING, everything};

#[test]
fn written_file_is_equal_and_correct() {
    let file = everything();
    let text = file.write();
    let again = DeviceFile::parse(text.as_bytes()).unwrap();
    assert_eq!(again.warnings(), [], "{text}");
    assert_eq!(again, file, "{text}");
    assert_eq!(again.write(), text);
    // Compact objects stay compact.
    assert!(text.contains("CompactSubObj=127"));
    assert!(!text.contains("[1F22sub"));
}

fn is_written_and_read(text: &[u8]) {
    let Ok(file) = DeviceFile::parse(text) else { return };
    let written = file.write();
    let again = DeviceFile::parse(written.as_bytes());
    assert_eq!(again.as_ref(), Ok(&file), "{written}");
}

/// Lines of a device file, mostly of objects that the file has.
fn line() -> impl Strategy<Value = String> {
    let section = prop_oneof![
        "\\[(1000|1018|1018sub[0-2]|1600|1600sub[0-2]|2000|2000sub[0-3]|A0|A0sub1)\\]",
        "\\[(1600|2000|1018)(Name|Value|Denotation|ParamRefd|ObjectLinks)\\]",
        "\\[(FileInfo|DeviceInfo|DeviceComissioning|Comments|DummyUsage|Tools|Tool[1-3])\\]",
        "\\[(M[12](ModuleInfo|Comments|FixedObjects|SubExtends|Fixed6000|SubExt6000))\\]",
        "\\[[a-zA-Z0-9]{0,8}\\]?.{0,3}",
    ];
    let key = prop_oneof![
        "ParameterName|ObjectType|DataType|AccessType|PDOMapping|LowLimit|HighLimit|DefaultValue",
        "ParameterValue|SubNumber|CompactSubObj|ObjFlags|Denotation|ParamRefd|UploadFile|Count",
        "NrOfEntries|SupportedObjects|NodeID|Baudrate|BaudRate_125|VendorNumber|Lines?[1-3]?",
        "Dummy000[1-9]|[1-9]|[a-zA-Z]{0,3}",
    ];
    let value = prop_oneof![
        "[0-9]{1,3}",
        "0x[0-9A-F]{0,8}",
        "-?[0-9]{1,6}",
        "(\\$NODEID|0x10)\\+(\\$NODEID|0x10)",
        "rw|ro|const|rww|wo",
        "[a-zä; ]{0,6}",
        "0\\.[0-9]{1,4}|NaN|inf",
    ];
    prop_oneof![2 => section, 5 => (key, value).prop_map(|(key, value)| format!("{key}={value}"))]
}

/// Lines of an object that describes one to three sub-objects together, and of sections that change
/// them.
fn compact_object() -> impl Strategy<Value = Vec<String>> {
    let sections = prop_oneof![
        "\\[2000sub[0-3]\\]",
        "\\[2000(Name|Value|Denotation|ParamRefd|ObjectLinks)\\]"
    ];
    let entry = prop_oneof![
        "ObjectType=[025789]",
        "AccessType=(ro|rw|wo)|PDOMapping=[01]|ObjFlags=[0-3]",
        "(LowLimit|DefaultValue|ParameterValue)=[0-9]",
        "(ParameterName|Denotation|ParamRefd|UploadFile|[a-z])=[a-z]{0,2}",
        "(NrOfEntries|[1-4])=(2000sub[1-4]|2000[1-4]|[a-z]{1,2}|[0-9])",
    ];
    let own = prop::collection::vec(entry.clone(), 0..4);
    let section = (sections, prop::collection::vec(entry, 0..4));
    (1..=3_u8, own, prop::collection::vec(section, 0..4)).prop_map(|(count, own, sections)| {
        let mut lines = vec![format!("[2000]\nCompactSubObj={count}\nDataType=7")];
        lines.extend(own);
        for (name, entries) in sections {
            lines.push(name);
            lines.extend(entries);
        }
        lines
    })
}

proptest! {
    #[test]
    fn compact_object_is_written_and_read(lines in compact_object()) {
        is_written_and_read(lines.join("\n").as_bytes());
    }
}

proptest! {
    #[test]
    fn any_file_is_written_and_read(lines in prop::collection::vec(line(), 0..60)) {
        is_written_and_read(lines.join("\n").as_bytes());
    }

    #[test]
    fn any_bytes_are_written_and_read(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        is_written_and_read(&bytes);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn changed_file_is_written_and_read(
        changes in prop::collection::vec((0..EVERYTHING.lines().count(), line()), 1..20),
    ) {
        let mut lines: Vec<_> = EVERYTHING.lines().map(str::to_owned).collect();
        for (position, line) in changes {
            lines[position] = line;
        }
        let text = lines.join("\n");
        is_written_and_read(text.as_bytes());
        // Each deviation has a line of the file.
        let count = text.lines().count().max(1);
        let deviations = match DeviceFile::parse(text.as_bytes()) {
            Ok(file) => file.warnings().to_vec(),
            Err(faults) => {
                prop_assert!(!faults.faults.is_empty());
                faults.faults
            }
        };
        for deviation in deviations {
            prop_assert!((1..=count).contains(&deviation.line), "{}", deviation);
            prop_assert!(!deviation.problem.to_string().is_empty());
        }
    }
}
