//! SDO access to the whole object dictionary (manual 3.1, 13): permissions, lengths and states.

use super::fixture::{Fixture, MS, chunks};
use ecan_protocol::device::AlState;
use ecan_protocol::object::{AbortCode, Access, Entry, Object, ObjectType, describe, objects};
use ecan_sim::GatewayFault;

/// Every entry of every object.
fn entries() -> impl Iterator<Item = (u16, &'static Object, &'static Entry)> {
    objects().iter().flat_map(|object| {
        (0..object.count).flat_map(move |instance| {
            let index = object.first + instance * object.stride;
            object.entries.iter().map(move |entry| (index, *object, entry))
        })
    })
}

fn bytes(entry: &Entry, value: u32) -> Vec<u8> {
    match entry.ty {
        ObjectType::String16 => vec![0; 16],
        ObjectType::VisibleString => b"text".to_vec(),
        ty => value.to_le_bytes()[..ty.size_bytes().unwrap()].to_vec(),
    }
}

#[test]
fn every_readable_entry_responses_with_its_length() {
    let mut fixture = Fixture::preop();
    for (index, _, entry) in entries().filter(|(_, _, entry)| entry.access.can_read()) {
        let data = fixture.try_upload(index, entry.subindex);
        let data =
            data.unwrap_or_else(|code| panic!("{}: {code}", describe(index, entry.subindex)));
        match entry.ty.size_bytes() {
            Some(size) => assert_eq!(data.len(), size, "{}", describe(index, entry.subindex)),
            None => assert!(!data.is_empty()),
        }
    }
}

#[test]
fn every_default_of_the_table_is_what_a_new_device_reports() {
    let mut fixture = Fixture::preop();
    for (index, _, entry) in entries().filter(|(_, _, entry)| entry.access.can_read()) {
        // the table's default is that of a policy not applied yet
        if entry.ty.is_integer()
            && let Some(default) = entry.default
            && !(matches!(index, 0x8021..=0x8024) && entry.subindex == 20)
        {
            let value = fixture.upload(index, entry.subindex);
            assert_eq!(value, default, "{}", describe(index, entry.subindex));
        }
    }
    for policy in 0x8021..=0x8024 {
        assert_eq!(fixture.upload(policy, 20), 0x5405_9201);
    }
}

#[test]
fn every_read_only_entry_rejects_writes() {
    let mut fixture = Fixture::preop();
    for (index, _, entry) in entries().filter(|(_, _, entry)| entry.access == Access::Ro) {
        let data = bytes(entry, 0);
        let result = fixture.download(index, entry.subindex, &data);
        assert_eq!(result, Err(AbortCode::READ_ONLY), "{}", describe(index, entry.subindex));
    }
}

#[test]
fn write_only_entry_rejects_reads_and_accepts_no_op() {
    let mut fixture = Fixture::preop();
    for (index, _, entry) in entries().filter(|(_, _, entry)| entry.access == Access::Wo) {
        let name = describe(index, entry.subindex).to_string();
        let read = fixture.try_upload(index, entry.subindex);
        assert_eq!(read, Err(AbortCode::WRITE_ONLY), "{name}");
        assert_eq!(fixture.download(index, entry.subindex, &bytes(entry, 0)), Ok(()), "{name}");
    }
}

#[test]
fn every_writable_entry_takes_its_own_value_and_keeps_it() {
    let mut fixture = Fixture::preop();
    for (index, _, entry) in entries().filter(|(_, _, entry)| entry.access == Access::Rw) {
        // chunks can be assigned only while their count is 0
        if matches!(index, 0x1C12 | 0x1C13) && entry.subindex == 1 {
            fixture.write_u8(index, 0, 0);
        }
        let name = describe(index, entry.subindex).to_string();
        let value = fixture.try_upload(index, entry.subindex).unwrap();
        assert_eq!(fixture.download(index, entry.subindex, &value), Ok(()), "{name}");
        assert_eq!(fixture.try_upload(index, entry.subindex).unwrap(), value, "{name}");
    }
}

#[test]
fn every_writable_entry_rejects_a_wrong_length() {
    let mut fixture = Fixture::preop();
    for (index, _, entry) in entries().filter(|(_, _, entry)| entry.access.can_write()) {
        let name = describe(index, entry.subindex).to_string();
        let mut data = bytes(entry, entry.default.unwrap_or(0));
        data.push(0);
        assert_eq!(
            fixture.download(index, entry.subindex, &data),
            Err(AbortCode::TOO_LONG),
            "{name}"
        );
        data.truncate(data.len() - 2);
        let short = if data.is_empty() { AbortCode::LENGTH } else { AbortCode::TOO_SHORT };
        assert_eq!(fixture.download(index, entry.subindex, &data), Err(short), "{name}");
    }
}

#[test]
fn values_out_of_range_are_rejected_without_an_apply() {
    let mut fixture = Fixture::preop();
    for (index, subindex, data, code) in [
        (0x8000, 12, &[4][..], AbortCode::TOO_GREAT),
        (0x8000, 1, &[2], AbortCode::RANGE),
        (0x8010, 1, &[2], AbortCode::RANGE),
        (0x8010, 8, &[4], AbortCode::TOO_GREAT),
        (0x8001, 1, &[2], AbortCode::TOO_GREAT),
        (0x8001, 3, &[8], AbortCode::TOO_GREAT),
        (0x8020, 2, &[2], AbortCode::TOO_GREAT),
        (0x8021, 2, &[2], AbortCode::TOO_GREAT),
        (0x8030, 1, &[1, 0, 0, 0], AbortCode::RANGE),
        (0x9011, 14, &[2], AbortCode::RANGE),
        (0xB000, 1, &[3], AbortCode::TOO_GREAT),
        (0xB000, 4, &[0x80], AbortCode::TOO_GREAT),
        (0x1C12, 0, &[25], AbortCode::TOO_GREAT),
    ] {
        let before = fixture.try_upload(index, subindex);
        let name = describe(index, subindex).to_string();
        assert_eq!(fixture.download(index, subindex, data), Err(code), "{name}");
        assert_eq!(fixture.try_upload(index, subindex), before, "{name}");
    }
    for (index, subindex, data) in
        [(0x8010, 3, &[200][..]), (0x8001, 8, &[9]), (0x8020, 7, &[0xFF, 0xFF]), (0x8021, 5, &[9])]
    {
        assert_eq!(fixture.download(index, subindex, data), Ok(()));
        assert_eq!(fixture.try_upload(index, subindex).unwrap(), data);
    }
}

#[test]
fn missing_objects_are_named() {
    let mut fixture = Fixture::preop();
    for index in [0x0000, 0x1001, 0x1618, 0x6001, 0x8005, 0x8009, 0x9004, 0xA004, 0xFFFF] {
        assert_eq!(fixture.try_upload(index, 0), Err(AbortCode::NO_OBJECT));
        assert_eq!(fixture.download(index, 0, &[0]), Err(AbortCode::NO_OBJECT));
    }
    for (index, subindex) in [(0x8000, 2), (0x8001, 35), (0x8001, 88), (0xF000, 33), (0x1C12, 25)] {
        assert_eq!(fixture.try_upload(index, subindex), Err(AbortCode::NO_SUBINDEX));
        assert_eq!(fixture.download(index, subindex, &[0]), Err(AbortCode::NO_SUBINDEX));
    }
}

#[test]
fn mapping_is_fixed_and_names_every_unit() {
    let mut fixture = Fixture::preop();
    assert_eq!(fixture.upload(0x1600, 0), 8);
    assert_eq!(fixture.upload(0x1600, 1), 0x7000_0180);
    assert_eq!(fixture.upload(0x1601, 1), 0x7080_0180);
    assert_eq!(fixture.upload(0x1617, 8), 0x7BF0_0180);
    assert_eq!(fixture.upload(0x1A00, 8), 0x6070_0180);
    assert_eq!(fixture.upload(0x1A01, 8), 0x60F0_0180);
    assert_eq!(fixture.download(0x1600, 0, &[0]), Err(AbortCode::READ_ONLY));
    assert_eq!(fixture.download(0x1A00, 1, &[0; 4]), Err(AbortCode::READ_ONLY));
}

#[test]
fn assignment_is_written_in_preop_and_safeop_while_its_count_is_0() {
    let mut fixture = Fixture::configured(chunks(3), chunks(3));
    let map = 0x1600u16.to_le_bytes();
    assert_eq!(fixture.download(0x1C12, 1, &map), Err(AbortCode::SUBINDEX_LOCKED));
    fixture.write_u8(0x1C12, 0, 0);
    assert_eq!(fixture.download(0x1C12, 1, &map), Ok(()));
    for wrong in [0u16, 0x1A00, 0x1618, 0x7000] {
        let result = fixture.download(0x1C12, 1, &wrong.to_le_bytes());
        assert_eq!(result, Err(AbortCode::NOT_MAPPABLE));
    }
    fixture.write_u8(0x1C12, 0, 3);
    fixture.request(AlState::SafeOp);
    assert_eq!(fixture.download(0x1C12, 0, &[3]), Ok(()));
    fixture.request(AlState::Op);
    assert_eq!(fixture.download(0x1C12, 0, &[3]), Err(AbortCode::DEVICE_STATE));
}

#[test]
fn data_units_read_the_sync_manager_memory() {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    fixture.deliver(0, super::fixture::standard(0x123, &[1, 2, 3]));
    fixture.cycle();
    assert_eq!(fixture.try_upload(0x6000, 1).unwrap(), fixture.input[..16]);
    assert_eq!(fixture.try_upload(0x6010, 1).unwrap(), fixture.input[16..32]);
    assert_eq!(fixture.try_upload(0x7000, 1).unwrap(), fixture.image[..16]);
    assert_eq!(fixture.download(0x7000, 1, &[0; 16]), Err(AbortCode::DEVICE_STATE));
    fixture.request(AlState::PreOp);
    assert_eq!(fixture.download(0x7010, 1, &[7; 16]), Ok(()));
    assert_eq!(fixture.try_upload(0x7010, 1).unwrap(), [7; 16]);
}

#[test]
fn identity_comes_from_the_settings() {
    let config = ecan_sim::GatewayModelConfig {
        serial: 0x1122_3344_5566_7788,
        vendor_id: 0xABCD,
        firmware: (0x0207, 0x2605),
        ..Default::default()
    };
    let mut fixture = Fixture::preop_with(config);
    assert_eq!(fixture.upload(0x1018, 1), 0xABCD);
    assert_eq!(fixture.upload(0xF000, 5), 0x0207);
    assert_eq!(fixture.upload(0xF000, 6), 0x2605);
    assert_eq!(fixture.upload(0xF000, 7), 0x5566_7788);
    assert_eq!(fixture.upload(0xF000, 8), 0x1122_3344);
    assert_eq!(fixture.try_upload(0x100A, 0).unwrap(), b"2.7.9733");
}

#[test]
fn injected_aborts_affect_one_entry_and_count() {
    let mut fixture = Fixture::preop();
    let fault = GatewayFault::SdoAbort { index: 0x8010, subindex: 3, code: 0x0800_0000, times: 2 };
    fixture.gateway.inject(fixture.now, fault);
    assert_eq!(fixture.upload(0x8010, 4), 0x0F);
    assert_eq!(fixture.download(0x8010, 3, &[8]), Err(AbortCode::GENERAL));
    assert_eq!(fixture.try_upload(0x8010, 3), Err(AbortCode::GENERAL));
    assert_eq!(fixture.download(0x8010, 3, &[8]), Ok(()));
}

#[test]
fn silent_mailbox_times_out_and_recovers() {
    let mut fixture = Fixture::preop();
    fixture.gateway.inject(fixture.now, GatewayFault::MailboxSilent { ms: 10 });
    assert!(!fixture.gateway.mailbox_answers(fixture.now));
    assert_eq!(fixture.try_upload(0xF000, 2), Err(AbortCode::TIMEOUT));
    fixture.pass(10 * MS);
    assert!(fixture.gateway.mailbox_answers(fixture.now));
    assert_eq!(fixture.upload(0xF000, 2), 4);
}

#[test]
fn init_has_no_mailbox() {
    let mut fixture = Fixture::preop();
    fixture.request(AlState::Init);
    assert_eq!(fixture.try_upload(0xF000, 2), Err(AbortCode::TIMEOUT));
}
