//! Reading a gateway, and the snapshot in a file.

use ecan_tool_support::diagnosis::{Depth, ObjectKey, ReadError, Snapshot, findings};

#[test]
fn full_depth_reads_more_entries() {
    let read = |depth| {
        Snapshot::read(depth, |key| {
            Ok(if (key.index, key.subindex) == (0x1C12, 0) { 3 } else { 0 })
        })
    };
    let (few, all) = (read(Depth::Findings), read(Depth::Everything));
    assert!(few.values.keys().all(|key| all.values.contains_key(key)));
    assert!(all.values.len() > few.values.len() + 150);
    assert_eq!((all.get(0x1C12, 3), all.get(0x1C12, 4)), (Some(0), None));
    // Commands have no value, windows and reserved entries no meaning.
    for (index, subindex) in [(0x8001, 1), (0xB000, 4), (0x8001, 43), (0x8004, 60), (0x9011, 16)] {
        assert_eq!(all.get(index, subindex), None, "0x{index:04X}:{subindex}");
    }
    for subindex in [41, 49, 55] {
        assert_eq!(all.get(0x8001, subindex), Some(0), "the lengths of the lists: {subindex}");
    }
}

/// Number of entries that are read of a gateway that shows these values, and else 0.
fn read_count(shown: &[(u16, u8, u32)]) -> usize {
    let value = |key: ObjectKey| {
        shown
            .iter()
            .find(|shown| (shown.0, shown.1) == (key.index, key.subindex))
            .map_or(0, |shown| shown.2)
    };
    Snapshot::read(Depth::Findings, |key| Ok(value(key))).values.len()
}

#[test]
fn idle_gateway_needs_few_entries() {
    assert_eq!(read_count(&[]), 47);
    // A running channel, an active profile, dropped frames.
    assert_eq!(read_count(&[(0x9001, 9, 2)]), 47 + 11 + 13 + 8 + 1);
    assert_eq!(read_count(&[(0x8010, 9, 1024)]), 47 + 2 + 13);
    assert_eq!(read_count(&[(0x9001, 9, 2), (0x9021, 5, 7)]), 47 + 33 + 3);
}

#[test]
fn failed_apply_reads_more_entries() {
    let read = |status| {
        Snapshot::read(Depth::Findings, |key| {
            Ok(if (key.index, key.subindex) == (0x8002, 2) { status } else { 0 })
        })
    };
    let (well, failed) = (read(0), read(3));
    for subindex in [7, 19, 25, 36, 62, 73] {
        assert_eq!(well.get(0x8002, subindex), None, "{subindex}");
        assert_eq!(failed.get(0x8002, subindex), Some(0), "{subindex}");
        assert_eq!(failed.get(0x8001, subindex), None, "{subindex}");
    }
    assert_eq!((well.get(0x8000, 7), failed.get(0x8000, 7)), (None, Some(0)), "the clock");
}

#[test]
fn no_entry_is_read_twice() {
    for depth in [Depth::Findings, Depth::Everything] {
        let mut read = std::collections::BTreeSet::new();
        // Everything is active.
        Snapshot::read(depth, |key| {
            assert!(read.insert(key), "{key}");
            Ok(3)
        });
    }
}

#[test]
fn rejections_are_kept_and_silence_ends_reading() {
    let snapshot = Snapshot::read(Depth::Findings, |key| match (key.index, key.subindex) {
        (0x8010, 15) => Err(ReadError::Rejected("no such entry".into())),
        (0x8000, 4) => Err(ReadError::Silent("timed out".into())),
        _ => Ok(0),
    });
    let key = ObjectKey { index: 0x8010, subindex: 15 };
    assert_eq!(snapshot.rejected[&key], "no such entry");
    assert_eq!(snapshot.silence.as_deref(), Some("timed out"));
    assert!(snapshot.get(0x8004, 2).is_some() && snapshot.get(0xB000, 2).is_none());
}

#[test]
fn file_round_trips_the_snapshot() {
    let mut snapshot =
        Snapshot { al_state: 0x12, al_status_code: Some(0x1D), ..Snapshot::default() };
    snapshot.set(0x8010, 2, 5);
    let text = serde_json::to_string(&snapshot).unwrap();
    assert!(text.contains("\"0x8010:02\":5"), "{text}");
    let back: Snapshot = serde_json::from_str(&text).unwrap();
    assert_eq!(back, snapshot);
    assert_eq!(findings(&back), findings(&snapshot));
    for wrong in ["8010:02", "0x8010", "0x8010:256", "0x18010:1", "0x:"] {
        assert!(wrong.parse::<ObjectKey>().is_err(), "{wrong}");
    }
}
