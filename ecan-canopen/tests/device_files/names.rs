//! Entries by name.

use ecan_canopen::FindError;

use super::everything;

#[test]
fn entries_are_found_by_name_and_index() {
    let file = everything();
    let cases = [
        ("Device type", (0x1000, 0)),
        ("device TYPE", (0x1000, 0)),
        ("Identity object/Vendor-ID", (0x1018, 1)),
        ("identity object/1", (0x1018, 1)),
        ("Vendor-ID", (0x1018, 1)),
        ("COB-ID used by RPDO", (0x1400, 1)),
        ("valves", (0x1600, 2)),
        ("0x1018:2", (0x1018, 2)),
        ("1018sub1", (0x1018, 1)),
        ("1005", (0x1005, 0)),
    ];
    for (name, (index, subindex)) in cases {
        let entry = file.find(name).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((entry.index, entry.subindex), (index, subindex), "{name}");
    }
}

#[test]
fn labels_are_found_again() {
    let file = everything();
    for entry in file.entries() {
        let label = file.label(entry);
        assert_eq!(file.find(&label), Ok(entry), "{label}");
    }
}

#[test]
fn wrong_names_are_answered_with_similar_ones() {
    let file = everything();
    let cases = [
        ("Devise type", "no object `Devise type`; similar: `Device type`"),
        (
            "Number of entries",
            "`Number of entries` is the name of several entries; use one of `Identity \
             object/Number of entries`, `Unsigned48 and 56/Number of entries`",
        ),
        (
            "Identity object",
            "object `Identity object` has sub-objects; use one of `Identity object/Number of \
             entries`, `Identity object/Vendor-ID`, `Identity object/Product code`",
        ),
        (
            "xyz",
            "no object `xyz`; allowed: `Object`, `Object/Sub-object`, a unique name of a \
             sub-object, or an index like 0x6040 or 0x1018:1",
        ),
    ];
    for (name, text) in cases {
        assert_eq!(file.find(name).unwrap_err().to_string(), text);
    }
    assert!(matches!(file.find("0x1018:9"), Err(FindError::NotFound { .. })));
    assert!(file.find("").is_err());
    assert!(file.find("é/é").is_err());
}
