//! Complete access compared with single accesses, and as masters use it.

use ecan_protocol::object::{AbortCode, objects};

use super::fixture::{Fixture, MAILBOX};

/// The block of an object, from single uploads.
fn block_of_singles(fixture: &mut Fixture, index: u16, first: u8) -> Vec<u8> {
    let object = ecan_protocol::object::object(index).unwrap();
    if object.entries.len() == 1 {
        return fixture.value(index, 0);
    }
    let count = match index {
        0x1C12 | 0x1C13 => fixture.value(index, 0)[0],
        _ => u8::MAX,
    };
    let mut block = Vec::new();
    for entry in object.entries.iter().filter(|entry| entry.subindex <= count) {
        match entry.subindex {
            0 if first == 1 => {}
            0 => block.extend_from_slice(&[fixture.value(index, 0)[0], 0]),
            _ if !entry.access.can_read() => {
                block.resize(block.len() + entry.ty.size_bytes().unwrap(), 0);
            }
            subindex => block.extend_from_slice(&fixture.value(index, subindex)),
        }
    }
    block
}

#[test]
fn gateway_without_complete_access_aborts_it() {
    let mut fixture = Fixture::preop();
    let rejected = Err(AbortCode::UNSUPPORTED_ACCESS);
    assert_eq!(fixture.upload(0x1C12, 0, true), rejected);
    let download = fixture.download(0x1C12, 0, true, &[1, 0, 0x00, 0x16]);
    assert_eq!(download, Err(AbortCode::UNSUPPORTED_ACCESS));
    let long = [0; 200];
    assert_eq!(fixture.download(0x1C12, 0, true, &long), Err(AbortCode::UNSUPPORTED_ACCESS));
    assert_eq!(fixture.value(0x1C12, 0), [24], "nothing has changed");
}

#[test]
fn every_object_is_the_sum_of_its_entries() {
    let mut fixture = Fixture::with_complete_access(MAILBOX);
    let mut compared = 0;
    for object in objects() {
        for index in object.indices() {
            if matches!(index, 0x1008..=0x100A) {
                let rejected = Err(AbortCode::NO_COMPLETE_ACCESS);
                assert_eq!(fixture.upload(index, 0, true), rejected, "a text has no fixed length");
                continue;
            }
            let expected = block_of_singles(&mut fixture, index, 0);
            assert_eq!(fixture.upload(index, 0, true), Ok(expected), "0x{index:04X}");
            compared += 1;
            if object.entries.len() > 1 {
                let expected = block_of_singles(&mut fixture, index, 1);
                assert_eq!(fixture.upload(index, 1, true), Ok(expected), "0x{index:04X} from 1");
            } else {
                assert_eq!(fixture.upload(index, 1, true), Err(AbortCode::NO_SUBINDEX));
            }
            assert_eq!(fixture.upload(index, 2, true), { Err(AbortCode::UNSUPPORTED_ACCESS) });
        }
    }
    assert!(compared > 450, "{compared} objects");
}

#[test]
fn complete_access_skips_gaps_and_reads_commands_as_zero() {
    let mut fixture = Fixture::with_complete_access(MAILBOX);
    let block = fixture.upload(0x8000, 0, true).unwrap();
    // count; :1 write-only; no :2; :3 = 1275 mV; :4 = 400 MHz
    let [c0, c1, c2, c3] = 400_000_000_u32.to_le_bytes();
    assert_eq!(block[..9], [15, 0, 0, 0xFB, 0x04, c0, c1, c2, c3]);
}

#[test]
fn assignment_replaces_any_previous_one() {
    let mut fixture = Fixture::with_complete_access(MAILBOX);
    assert_eq!(fixture.value(0x1C12, 0), [24]);
    for chunks in [3_u16, 1, 8, 24] {
        let mut block = vec![chunks as u8, 0];
        block.extend((0..chunks).flat_map(|chunk| (0x1600 + chunk).to_le_bytes()));
        assert_eq!(fixture.download(0x1C12, 0, true, &block), Ok(()));
        assert_eq!(fixture.upload(0x1C12, 0, true), Ok(block));
    }
    // no chunks, as SOEM and others clear it: expedited, two bytes
    let answer = fixture.coe(&[0x00, 0x20, 0x3B, 0x12, 0x1C, 0x00, 0, 0, 0, 0]);
    assert_eq!(answer[..6], [0x00, 0x30, 0x70, 0x12, 0x1C, 0x00]);
    assert_eq!(fixture.upload(0x1C12, 0, true), Ok(vec![0, 0]));
    // and one chunk in four bytes
    let answer = fixture.coe(&[0x00, 0x20, 0x33, 0x12, 0x1C, 0x00, 1, 0, 0x00, 0x16]);
    assert_eq!(answer[2], 0x70);
    assert_eq!(fixture.upload(0x1C12, 0, true), Ok(vec![1, 0, 0x00, 0x16]));
}

#[test]
fn rejected_assignment_leaves_none() {
    let mut fixture = Fixture::with_complete_access(MAILBOX);
    let foreign = fixture.download(0x1C12, 0, true, &[2, 0, 0x00, 0x16, 0x00, 0x1A]);
    assert_eq!(foreign, Err(AbortCode::NOT_MAPPABLE));
    assert_eq!(fixture.value(0x1C12, 0), [0]);
    let many = fixture.download(0x1C12, 0, true, &[25, 0, 0x00, 0x16]);
    assert_eq!(many, Err(AbortCode::TOO_GREAT));
    assert_eq!(fixture.value(0x1C12, 0), [0]);
}

#[test]
fn entries_of_an_assignment_in_use_are_locked() {
    let mut fixture = Fixture::with_complete_access(MAILBOX);
    let entries = [0x00, 0x16, 0x01, 0x16];
    assert_eq!(fixture.download(0x1C12, 1, true, &entries), Err(AbortCode::SUBINDEX_LOCKED));
    fixture.download(0x1C12, 0, false, &[0]).unwrap();
    assert_eq!(fixture.download(0x1C12, 1, true, &entries), Ok(()));
    assert_eq!(fixture.value(0x1C12, 0), [0], "the count was not in it");
}

#[test]
fn read_only_entries_and_lengths() {
    let mut fixture = Fixture::with_complete_access(MAILBOX);
    let unit = |count| {
        let mut block = vec![count, 0];
        block.extend_from_slice(b"0123456789ABCDEF");
        block
    };
    assert_eq!(fixture.download(0x7000, 0, true, &unit(1)), Ok(()), "the count is what it is");
    assert_eq!(fixture.value(0x7000, 1), b"0123456789ABCDEF");
    assert_eq!(fixture.download(0x7000, 0, true, &unit(2)), Err(AbortCode::READ_ONLY));
    let mut block = fixture.upload(0x8010, 0, true).unwrap();
    assert_eq!(fixture.download(0x8010, 0, true, &block), Err(AbortCode::READ_ONLY), "its status");
    assert_eq!(fixture.download(0x8010, 0, true, &block[..3]), Ok(()), "count and command");
    block.push(0);
    assert_eq!(fixture.download(0x8010, 0, true, &block), Err(AbortCode::TOO_LONG));
    assert_eq!(fixture.download(0x7000, 0, true, &unit(1)[..17]), Err(AbortCode::TOO_SHORT));
    assert_eq!(fixture.download(0x7000, 0, true, &[]), Err(AbortCode::LENGTH));
    assert_eq!(fixture.download(0x1000, 0, true, &[0; 4]), Err(AbortCode::READ_ONLY));
    assert_eq!(fixture.download(0x1234, 0, true, &[0; 4]), Err(AbortCode::NO_OBJECT));
}
