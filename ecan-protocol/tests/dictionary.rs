//! The object dictionary compared with numbers copied from the manual by hand (chapter 13).

use ecan_protocol::config::{
    BusOffRecovery, CacheDepth, CrcTest, CriticalFrames, DataSize, ExtendedMatch, FifoMode,
    FilterAction, FilterCommand, FilterWindow, NodeMode, NonMatch, RxBudget, RxOverflow, Sides,
    StandardMatch, TxMode, TxOverflow,
};
use ecan_protocol::image::EncapsulationProfile;
use ecan_protocol::object::{
    Access, Entry, ObjectType, describe, lookup, object, objects, pdo_mapping_entry,
};

fn entry(index: u16, subindex: u8) -> &'static Entry {
    lookup(index, subindex).unwrap_or_else(|| panic!("{index:04X}:{subindex}")).1
}

#[test]
fn every_object_of_chapter_13_has_its_subindices() {
    // First index, number of objects, subindices in the manual's table, highest of them, saved in
    // the Flash.
    let manual: [(u16, u16, usize, u8, bool); 15] = [
        (0x8000, 1, 14, 15, true),
        (0x8001, 4, 86, 87, true),
        (0x8010, 1, 16, 16, true),
        (0x8011, 1, 16, 16, true),
        (0x8020, 1, 10, 10, true),
        (0x8021, 4, 20, 20, true),
        (0x8030, 1, 10, 10, false),
        (0x9000, 4, 16, 16, false),
        (0x9011, 1, 24, 24, false),
        (0x9020, 4, 20, 20, false),
        (0xA000, 4, 7, 7, false),
        (0xB000, 1, 12, 12, false),
        (0xF000, 1, 32, 32, false),
        (0x1018, 1, 4, 4, false),
        (0x1600, 24, 8, 8, false),
    ];
    for (first, count, subindices, highest, is_saved) in manual {
        let object = object(first).unwrap();
        assert_eq!((object.first, object.count), (first, count));
        assert_eq!(object.is_saved, is_saved, "0x{first:04X}");
        // Subindex 0 is not in the manual's tables.
        assert_eq!(object.entries.len(), subindices + 1, "0x{first:04X}");
        assert_eq!(object.highest_subindex(), highest, "0x{first:04X}");
        assert_eq!(object.entry(0).unwrap().default, Some(u32::from(highest)));
    }
    // The two gaps of the manual.
    assert!(lookup(0x8000, 2).is_none());
    assert!(lookup(0x8001, 35).is_none());
}

#[test]
fn objects_and_subindices_ascend_without_overlap() {
    let mut next = 0u32;
    for object in objects() {
        assert!(u32::from(object.first) >= next, "{}", object.name);
        let last = u32::from(object.first) + u32::from(object.count - 1) * u32::from(object.stride);
        next = last + 1;
        assert!(!object.entries.is_empty(), "{}", object.name);
        assert!(
            object.entries.windows(2).all(|pair| pair[0].subindex < pair[1].subindex),
            "{}",
            object.name
        );
        if let Some(apply) = object.apply {
            assert!(object.entry(apply.command).unwrap().access.can_write());
            assert!(object.entry(apply.status).unwrap().access.can_read());
        }
    }
}

#[test]
fn defaults_lie_in_range_and_have_a_meaning() {
    for object in objects() {
        for entry in object.entries {
            let place = format!("{}:{}", object.name, entry.subindex);
            assert!(entry.min <= entry.max, "{place}");
            if entry.ty.is_integer() {
                assert!(entry.max <= entry.ty.max_value(), "{place}");
            }
            if let Some(default) = entry.default {
                assert!(entry.accepts(default), "{place}");
            }
            for &(value, _) in entry.values {
                assert!((entry.min..=entry.max).contains(&value), "{place}");
            }
            if entry.access == Access::Rw && !entry.bits.is_empty() {
                assert_eq!(entry.bit_mask(), entry.max, "{place}");
            }
        }
    }
}

#[test]
fn families_contain_their_members() {
    assert_eq!(object(0x8004).unwrap().instance(0x8004), Some(3));
    assert!(object(0x8005).is_none());
    assert!(object(0x9010).is_none());
    assert_eq!(object(0x9023).unwrap().name, "MCAN Data Path Diagnostics");
    // 24 chunks of 8 units, 0x10 apart.
    assert_eq!(object(0x6BF0).unwrap().instance(0x6BF0), Some(191));
    assert!(object(0x6BF1).is_none());
    assert!(object(0x6C00).is_none());
    assert_eq!(object(0x7BF0).unwrap().count, 192);
    assert!(object(0x1618).is_none());
    assert_eq!(entry(0x7010, 1).ty, ObjectType::String16);
}

#[test]
fn spot_values() {
    for (index, subindex, ty, access, default) in [
        (0x8000, 4, ObjectType::U32, Access::Ro, Some(400_000_000)),
        (0x8000, 3, ObjectType::U16, Access::Rw, Some(1275)),
        (0x8002, 20, ObjectType::U32, Access::Rw, Some(5_000_000)),
        (0x8003, 40, ObjectType::U32, Access::Rw, Some(0x1FFF_FFFF)),
        (0x8004, 81, ObjectType::U16, Access::Rw, Some(1)),
        (0x8001, 1, ObjectType::U8, Access::Wo, Some(0)),
        (0x8011, 4, ObjectType::U8, Access::Rw, Some(0x0F)),
        (0x8020, 4, ObjectType::U16, Access::Rw, Some(3)),
        (0x8024, 12, ObjectType::U8, Access::Rw, Some(4)),
        (0x8030, 8, ObjectType::U32, Access::Ro, Some(0x1F)),
        (0x9011, 4, ObjectType::I32, Access::Ro, None),
        (0xB000, 4, ObjectType::U8, Access::Wo, None),
        (0xF000, 12, ObjectType::U32, Access::Ro, Some(0x33)),
        (0xF000, 16, ObjectType::U32, Access::Ro, Some(0x1F3B)),
        (0xF000, 19, ObjectType::U32, Access::Ro, Some(0x15)),
        (0x1C12, 24, ObjectType::U16, Access::Rw, Some(0x1617)),
        (0x1C13, 1, ObjectType::U16, Access::Rw, Some(0x1A00)),
        (0x100A, 0, ObjectType::VisibleString, Access::Ro, None),
    ] {
        let found = entry(index, subindex);
        assert_eq!(
            (found.ty, found.access, found.default),
            (ty, access, default),
            "0x{index:04X}:{subindex}"
        );
    }
    assert_eq!(
        entry(0x8010, 2).meaning(5),
        Some("master mapping reload required: PDO assignment and size multiplier differ")
    );
    assert_eq!(entry(0x8010, 14).meaning(15), Some("bad CRC"));
    assert_eq!(entry(0x8030, 1).meaning(0x4543_414E), Some("test controls allowed"));
}

#[test]
fn only_values_of_the_manual_are_accepted() {
    let accepted = |index, subindex, range: std::ops::Range<u32>| -> Vec<u32> {
        range.filter(|&value| entry(index, subindex).accepts(value)).collect()
    };
    assert_eq!(accepted(0x8010, 5, 0..64), [0, 1, 4, 5]);
    assert_eq!(accepted(0x8021, 7, 0..64), [0, 1, 2, 3, 8, 16, 24, 32]);
    assert_eq!(accepted(0x8030, 2, 0..64), [0, 4, 8, 12, 16, 20, 24, 28]);
    assert_eq!(accepted(0x8010, 3, 0..256), (1..=24).collect::<Vec<_>>());
    assert_eq!(accepted(0x8020, 5, 0..256), [0]);
    assert!(!entry(0x1008, 0).accepts(0));
}

/// An enumeration has exactly the numbers of the dictionary.
fn same_values(index: u16, subindex: u8, known: impl Fn(u8) -> bool) {
    let entry = entry(index, subindex);
    for raw in 0..=255 {
        assert_eq!(known(raw), entry.accepts(raw.into()), "{} {raw}", describe(index, subindex));
    }
}

#[test]
fn enumerations_match_the_dictionary() {
    same_values(0x8001, 8, |raw| NodeMode::from_raw(raw).is_some());
    same_values(0x8001, 36, |raw| NonMatch::from_raw(raw).is_some());
    same_values(0x8001, 45, |raw| FilterCommand::from_raw(raw).is_some());
    same_values(0x8001, 50, |raw| StandardMatch::from_raw(raw).is_some());
    same_values(0x8001, 56, |raw| ExtendedMatch::from_raw(raw).is_some());
    same_values(0x8001, 57, |raw| FilterAction::from_raw(raw, 0).is_some());
    same_values(0x8001, 61, |raw| FifoMode::from_raw(raw).is_some());
    same_values(0x8001, 65, |raw| DataSize::from_raw(raw).is_some());
    same_values(0x8001, 69, |raw| TxMode::from_raw(raw).is_some());
    same_values(0x8010, 5, |raw| EncapsulationProfile::from_raw(raw).is_some());
    same_values(0x8021, 6, |raw| RxBudget::from_raw(raw).is_some());
    same_values(0x8021, 7, |raw| CacheDepth::from_written(raw).is_some());
    same_values(0x8021, 8, |raw| RxOverflow::from_raw(raw).is_some());
    same_values(0x8021, 9, |raw| CriticalFrames::from_raw(raw.into()).is_some());
    same_values(0x8021, 13, |raw| TxOverflow::from_raw(raw).is_some());
    same_values(0x8021, 14, |raw| BusOffRecovery::from_raw(raw).is_some());
    same_values(0x8030, 4, |raw| CrcTest::from_raw(raw).is_some());
    same_values(0x8030, 5, |raw| Sides::from_raw(raw).is_some());
    for raw in 0..8 {
        let data_size = DataSize::from_raw(raw).unwrap();
        let listed = entry(0x8001, 72).meaning(raw.into()).unwrap();
        assert_eq!(listed, format!("{} bytes", data_size.bytes()));
    }
    for raw in 0..4 {
        let depth = CacheDepth::from_raw(raw).unwrap();
        let listed = entry(0x8021, 7).meaning(raw.into()).unwrap();
        assert_eq!(listed, format!("{} frames", depth.frames()));
        assert_eq!(CacheDepth::from_written(depth.frames()), Some(depth));
    }
}

#[test]
fn mapping_objects_match_the_manual() {
    // Rows of 5.1.1: map, unit, data object.
    for (map, unit, data) in [
        (0x1600, 0, 0x7000u32),
        (0x1600, 7, 0x7070),
        (0x1601, 0, 0x7080),
        (0x1A00, 3, 0x6030),
        (0x1A01, 7, 0x60F0),
        (0x1A17, 7, 0x6BF0),
    ] {
        let mapped = pdo_mapping_entry(map, unit + 1).unwrap();
        assert_eq!((mapped >> 16, mapped & 0xFF), (data, 128));
        let subindex = (mapped >> 8 & 0xFF) as u8;
        assert_eq!(entry(data as u16, subindex).ty.size_bytes(), Some(16));
    }
    assert_eq!(pdo_mapping_entry(0x1600, 0), None);
    assert_eq!(pdo_mapping_entry(0x1600, 9), None);
    assert_eq!(pdo_mapping_entry(0x1618, 1), None);
}

#[test]
fn describe_names_object_and_entry() {
    let text = |index, subindex| describe(index, subindex).to_string();
    assert_eq!(text(0x8010, 3), "0x8010:03 (TxPDO Profile Control, PDO size multiplier)");
    assert_eq!(text(0x8003, 15), "0x8003:15 (MCAN Channel Config 2, FD enable)");
    assert_eq!(text(0x8010, 99), "0x8010:99 (TxPDO Profile Control)");
    assert_eq!(text(0x2000, 1), "0x2000:01");
}

#[test]
fn filter_windows_match_the_dictionary() {
    for (prefix, window) in ["Std", "Ext"].into_iter().zip(FilterWindow::BOTH) {
        let head = [
            (window.max, "list max"),
            (window.index, "current index"),
            (window.command, "entry cmd"),
            (window.status, "entry status"),
            (window.count, "filter count"),
        ];
        let fields = ["filter type", "filter action", "filter sync", "ID1", "ID2"];
        let all = head.into_iter().chain(window.fields().zip(fields));
        for (subindex, name) in all {
            assert_eq!(entry(0x8001, subindex).name, format!("{prefix} {name}"));
        }
        assert_eq!(window.fields().len(), fields.len());
    }
}
