//! SDO information over the whole dictionary, as a master reads it.

use ecan_protocol::object::{AbortCode, Access, Entry, ObjectType, object, objects};

use super::fixture::{Fixture, coe, info};

/// Sends a request, and joins the fragments of the response.
fn ask(fixture: &mut Fixture, opcode: u8, parameters: &[u8]) -> Vec<u8> {
    fixture.write(&coe(&info(opcode, parameters)));
    let mut body = Vec::new();
    let mut expected_left = None;
    loop {
        let message = fixture.read().expect("a fragment");
        assert_eq!(message[6..8], [0x00, 0x80]);
        assert_eq!(message[8] & 0x7F, opcode + 1, "{message:02X?}");
        let left = u16::from_le_bytes([message[10], message[11]]);
        assert_eq!(message[8] & 0x80 != 0, left > 0);
        assert!(expected_left.is_none_or(|expected| expected == left));
        body.extend_from_slice(&message[12..]);
        match left {
            0 => return body,
            _ => expected_left = Some(left - 1),
        }
    }
}

fn list(fixture: &mut Fixture, list_type: u8) -> Vec<u16> {
    let body = ask(fixture, 1, &[list_type, 0]);
    assert_eq!(body[..2], [list_type, 0]);
    body[2..].chunks(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect()
}

fn dictionary() -> Vec<u16> {
    objects().iter().flat_map(|object| object.indices()).collect()
}

#[test]
fn lists_and_their_lengths() {
    let mut fixture = Fixture::preop();
    let lengths = list(&mut fixture, 0);
    let lists: Vec<Vec<u16>> = (1..=5).map(|list_type| list(&mut fixture, list_type)).collect();
    let found: Vec<u16> = lists.iter().map(|list| list.len() as u16).collect();
    assert_eq!(lengths, found);
    assert_eq!(lists[0], dictionary());
    let units = |first: u16| (0..192).map(|unit| first + 16 * unit).collect::<Vec<u16>>();
    assert_eq!(lists[1], units(0x7000));
    assert_eq!(lists[2], units(0x6000));
    let configuration = [
        0x8000, 0x8001, 0x8002, 0x8003, 0x8004, 0x8010, 0x8011, 0x8020, 0x8021, 0x8022, 0x8023,
        0x8024,
    ];
    assert_eq!(lists[3], configuration);
    assert_eq!(lists[4][..2], [0x1C12, 0x1C13]);
    assert_eq!(lists[4][2..], configuration);
}

#[test]
fn walk_finds_every_object_and_entry() {
    for mailbox in [128, 40] {
        let mut fixture = Fixture::with_mailbox(mailbox);
        let mut entries_found = 0;
        for index in list(&mut fixture, 1) {
            let [i0, i1] = index.to_le_bytes();
            let object = object(index).expect("an object of the table");
            let description = ask(&mut fixture, 3, &[i0, i1]);
            assert_eq!(description[..2], [i0, i1]);
            let highest = object.entries.last().unwrap().subindex;
            assert_eq!(description[4], highest, "0x{index:04X}");
            let code = match (index, highest) {
                (_, 0) => 7,
                (0x1C00 | 0x1C12 | 0x1C13, _) => 8,
                _ => 9,
            };
            assert_eq!(description[5], code, "0x{index:04X}");
            let name = std::str::from_utf8(&description[6..]).unwrap();
            assert!(name.starts_with(object.name), "0x{index:04X} is called {name}");
            for subindex in 0..=highest {
                if let Some(entry) = object.entry(subindex) {
                    let description = ask(&mut fixture, 5, &[i0, i1, subindex, 0x7F]);
                    assert_eq!(description[..3], [i0, i1, subindex]);
                    check_entry(&mut fixture, index, entry, &description);
                    entries_found += 1;
                } else {
                    let description = ask(&mut fixture, 5, &[i0, i1, subindex, 0x7F]);
                    let gap = [i0, i1, subindex, 0, 0, 0, 0, 0, 0, 0];
                    assert_eq!(description, gap, "0x{index:04X}:{subindex} is a gap");
                }
            }
        }
        let entries: usize =
            objects().iter().map(|object| usize::from(object.count) * object.entries.len()).sum();
        assert_eq!(entries_found, entries);
    }
}

#[test]
fn subindex_beyond_the_last_is_aborted() {
    let mut fixture = Fixture::preop();
    let answer = fixture.coe(&info(5, &[0x00, 0x80, 16, 0]));
    assert_eq!(answer[2], 7, "an error");
    assert_eq!(answer[6..10], AbortCode::NO_SUBINDEX.0.to_le_bytes());
}

fn check_entry(fixture: &mut Fixture, index: u16, entry: &Entry, description: &[u8]) {
    let what = format!("0x{index:04X}:{}", entry.subindex);
    let word = |at: usize| u16::from_le_bytes([description[at], description[at + 1]]);
    let data_type = match entry.ty {
        ObjectType::I32 => 4,
        ObjectType::U8 => 5,
        ObjectType::U16 => 6,
        ObjectType::U32 => 7,
        ObjectType::VisibleString | ObjectType::String16 => 9,
    };
    assert_eq!(word(4), data_type, "{what}");
    let readable = entry.access != Access::Wo;
    if readable {
        let bits = fixture.value(index, entry.subindex).len() * 8;
        assert_eq!(usize::from(word(6)), bits, "{what}");
    }
    assert_eq!(word(8) & 0x07 == 0x07, readable, "{what}");
    assert_eq!(word(8) & 0x08 != 0, entry.access != Access::Ro, "{what}");
    assert_eq!(word(8) & 0xC0 != 0, entry.ty == ObjectType::String16, "{what}");
    // which values are contained, then the values, then the name
    let size = usize::from(word(6)) / 8;
    let contained = description[3];
    assert_eq!(contained & 0x10 != 0, entry.default.is_some(), "{what}");
    assert_eq!(contained & 0x60, if entry.ty.is_integer() { 0x60 } else { 0 }, "{what}");
    assert_eq!(contained & 0x0F, 0, "{what}");
    let values = &description[10..10 + contained.count_ones() as usize * size];
    if let Some(default) = entry.default {
        assert_eq!(values[..size], default.to_le_bytes()[..size], "{what}");
    }
    assert_eq!(&description[10 + values.len()..], entry.name.as_bytes(), "{what}");
}

#[test]
fn signed_entry_has_signed_limits() {
    let mut fixture = Fixture::preop();
    let description = ask(&mut fixture, 5, &[0x11, 0x90, 4, 0x60]);
    assert_eq!(description[4..8], [4, 0, 32, 0]);
    assert_eq!(description[10..14], i32::MIN.to_le_bytes());
    assert_eq!(description[14..18], i32::MAX.to_le_bytes());
}

#[test]
fn rights_of_entries() {
    let cases = [
        (0xF000, 2, 0x0007, "read-only"),
        (0x8001, 1, 0x0038, "a command that can only be written"),
        (0x8010, 1, 0x003F, "a command is no setting"),
        (0x8020, 2, 0x003F, "nor is this one"),
        (0x8010, 3, 0x033F, "a setting, to be saved"),
        (0x8030, 2, 0x003F, "a test is not to be saved"),
        (0x1C12, 1, 0x021F, "an assignment is made in PREOP or SAFEOP"),
        (0x6000, 1, 0x0087, "a TxPDO maps it"),
        (0x7000, 1, 0x004F, "an RxPDO maps it, and owns it from SAFEOP on"),
        (0x7000, 0, 0x0007, "nothing maps the count"),
    ];
    let mut fixture = Fixture::preop();
    for (index, subindex, rights, what) in cases {
        let [i0, i1] = u16::to_le_bytes(index);
        let description = ask(&mut fixture, 5, &[i0, i1, subindex, 0]);
        let found = u16::from_le_bytes([description[8], description[9]]);
        assert_eq!(found, rights, "0x{index:04X}:{subindex}: {what}");
    }
}

#[test]
fn no_fragment_ends_within_an_index() {
    let expected = dictionary();
    for mailbox in 16..=64 {
        let mut fixture = Fixture::with_mailbox(mailbox);
        fixture.write(&coe(&info(1, &[1, 0])));
        let mut found = Vec::new();
        let mut first = true;
        while let Some(message) = fixture.read() {
            let indices = &message[if first { 14 } else { 12 }..];
            first = false;
            assert!(indices.len().is_multiple_of(2), "mailbox of {mailbox} bytes");
            found.extend(indices.chunks(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])));
        }
        assert_eq!(found, expected, "mailbox of {mailbox} bytes");
    }
}
