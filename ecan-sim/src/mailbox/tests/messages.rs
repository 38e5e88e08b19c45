//! The mailbox itself: errors, counters, delay, silence, queue limit, repeats, sizes, and alternatives of its services.

use ecan_protocol::device::AlState;
use ecan_protocol::object::AbortCode;

use super::fixture::{Fixture, MAILBOX, MS, coe, info, message};
use crate::fault::GatewayFault;
use crate::gateway::GatewayModelConfig;
use crate::gateway::variant::{Emergencies, GatewayVariant, MissingEntries, SdoInformation};
use crate::mailbox::MailboxServer;

/// An upload of 0xF000:2, CoE body.
const UPLOAD: [u8; 10] = [0x00, 0x20, 0x40, 0x00, 0xF0, 0x02, 0, 0, 0, 0];
const DELAY: u64 = 200_000;

/// Detail of a response that is a mailbox error.
fn error_detail(answer: &[u8]) -> Option<u16> {
    match answer {
        &[4, 0, _, _, 0, kind, 1, 0, low, high] if kind & 0x0F == 0 => {
            Some(u16::from_le_bytes([low, high]))
        }
        _ => None,
    }
}

#[test]
fn every_detail_of_a_mailbox_error() {
    let cases: [(&str, Vec<u8>, u16); 14] = [
        ("reserved protocol", message(9, 0, &UPLOAD), 1),
        ("AoE", message(1, 0, &UPLOAD), 2),
        ("SoE", message(5, 0, &UPLOAD), 2),
        ("VoE", message(15, 0, &UPLOAD), 2),
        ("channel 5", vec![2, 0, 0, 0, 5, 3, 0, 0x20], 3),
        ("emergency of a master", coe(&[0x00, 0x10, 0, 0, 0, 0, 0, 0, 0, 0]), 4),
        ("SDO response of a master", coe(&[0x00, 0x30, 0, 0, 0, 0, 0, 0, 0, 0]), 4),
        ("TxPDO request", coe(&[0x00, 0x60]), 4),
        ("RxPDO", coe(&[0x00, 0x50, 1, 2]), 4),
        ("CoE service 9", coe(&[0x00, 0x90]), 5),
        ("no CoE header", coe(&[0x00]), 6),
        ("half an SDO", coe(&UPLOAD[..9]), 6),
        ("half an object description request", coe(&[0x00, 0x80, 3, 0, 0, 0, 0x18]), 6),
        ("longer than the mailbox", vec![0xFF, 0xFF, 0, 0, 0, 3], 8),
    ];
    for (what, request, detail) in cases {
        let mut fixture = Fixture::preop();
        let answer = fixture.exchange(&request);
        assert_eq!(error_detail(&answer), Some(detail), "{what}: {answer:02X?}");
        let next = fixture.exchange(&coe(&UPLOAD));
        assert_eq!(next[8], 0x4F, "{what}: the next request is served");
    }
}

#[test]
fn mailbox_shorter_than_a_header() {
    let mut fixture = Fixture::preop();
    fixture.server.receive(fixture.now, &[1, 2, 3], MAILBOX, &mut fixture.gateway);
    assert_eq!(fixture.read().as_deref().and_then(error_detail), Some(6));
}

#[test]
fn response_larger_than_the_read_mailbox_is_an_error() {
    let mut fixture = Fixture::preop();
    fixture.mailbox = 10;
    fixture.server.receive(fixture.now, &coe(&UPLOAD), 10, &mut fixture.gateway);
    assert_eq!(fixture.read().as_deref().and_then(error_detail), Some(8));
    // no space even for the error
    fixture.mailbox = 9;
    fixture.server.receive(fixture.now, &coe(&UPLOAD), 9, &mut fixture.gateway);
    assert_eq!(fixture.read(), None);
    assert_eq!(fixture.server.next_ready(), None);
}

#[test]
fn mailbox_error_gets_no_response() {
    let mut fixture = Fixture::preop();
    fixture.write(&message(0, 0, &[1, 0, 2, 0]));
    assert_eq!(fixture.server.next_ready(), None);
}

#[test]
fn response_counter_counts_from_one_to_seven() {
    let mut fixture = Fixture::preop();
    let counters: Vec<u8> = (0..9).map(|_| fixture.exchange(&coe(&UPLOAD))[5] >> 4).collect();
    assert_eq!(counters, [1, 2, 3, 4, 5, 6, 7, 1, 2]);
}

#[test]
fn repeated_write_is_ignored() {
    let mut fixture = Fixture::preop();
    assert_eq!(fixture.exchange(&message(3, 4, &UPLOAD))[8], 0x4F);
    fixture.write(&message(3, 4, &UPLOAD));
    assert_eq!(fixture.server.next_ready(), None);
    assert_eq!(fixture.exchange(&message(3, 5, &UPLOAD))[8], 0x4F);
    // without a counter no message is a repeat
    for _ in 0..2 {
        assert_eq!(fixture.exchange(&message(3, 0, &UPLOAD))[8], 0x4F);
    }
    // INIT resets the counter
    assert_eq!(fixture.exchange(&message(3, 5, &UPLOAD))[8], 0x4F);
    fixture.server = MailboxServer::default();
    assert_eq!(fixture.exchange(&message(3, 5, &UPLOAD))[8], 0x4F);
}

#[test]
fn response_takes_its_configured_time() {
    let mut fixture = Fixture::preop();
    assert_eq!(GatewayModelConfig::default().mailbox_delay_ns, DELAY);
    let asked = fixture.now;
    fixture.write(&coe(&UPLOAD));
    assert_eq!(fixture.server.next_ready(), Some(asked + DELAY));
    fixture.now = asked + DELAY - 1;
    assert!(!fixture.server.is_due(fixture.now, &fixture.gateway));
    assert_eq!(fixture.read_now(), None);
    fixture.now += 1;
    assert!(fixture.server.is_due(fixture.now, &fixture.gateway));
    assert!(fixture.read_now().is_some());
    assert_eq!(fixture.server.next_ready(), None);
}

#[test]
fn silent_mailbox_keeps_its_responses() {
    let mut fixture = Fixture::preop();
    let asked = fixture.now;
    fixture.write(&coe(&UPLOAD));
    fixture.gateway.inject(asked, GatewayFault::MailboxSilent { ms: 5 });
    fixture.now = asked + DELAY;
    assert!(!fixture.server.is_due(fixture.now, &fixture.gateway));
    assert_eq!(fixture.read_now(), None);
    fixture.now = asked + 5 * MS;
    assert_eq!(fixture.read_now().unwrap()[11], 0x02);
}

#[test]
fn gateway_in_init_ignores_mailbox_requests() {
    let mut fixture = Fixture::preop();
    fixture.write(&coe(&UPLOAD));
    fixture.gateway.request_al_state(fixture.now, AlState::Init);
    assert_eq!(fixture.read(), None);
    fixture.server = MailboxServer::default();
    fixture.write(&coe(&UPLOAD));
    assert_eq!(fixture.server.next_ready(), None);
}

#[test]
fn full_mailbox_queue_has_no_space() {
    let mut fixture = Fixture::preop();
    for _ in 0..8 {
        assert!(fixture.server.has_space());
        fixture.write(&coe(&UPLOAD));
    }
    assert!(!fixture.server.has_space());
    assert_eq!(error_detail(&fixture.read().unwrap()), None);
    assert!(fixture.server.has_space());
}

#[test]
fn every_mailbox_size_moves_the_same_data() {
    let data: Vec<u8> = (0..16).map(|byte| byte * 7 + 1).collect();
    let whole = Fixture::with_complete_access(MAILBOX).upload(0x8001, 0, true).unwrap();
    assert!(whole.len() > 120, "several segments even in a full mailbox");
    for mailbox in 16..=200 {
        let mut fixture = Fixture::with_complete_access(mailbox);
        fixture.download(0x7020, 1, false, &data).unwrap();
        assert_eq!(fixture.value(0x7020, 1), data, "down, {mailbox} bytes");
        assert_eq!(
            fixture.upload(0x7020, 1, false).as_deref(),
            Ok(&data[..]),
            "up, {mailbox} bytes"
        );
        assert_eq!(fixture.upload(0x8001, 0, true).as_deref(), Ok(&whole[..]), "{mailbox} bytes");
    }
}

#[test]
fn segmented_download_of_a_whole_object() {
    let mut fixture = Fixture::with_complete_access(20);
    let mut block = vec![24, 0];
    for chunk in 0..24_u16 {
        block.extend_from_slice(&(0x1A00 + chunk).to_le_bytes());
    }
    fixture.download(0x1C13, 0, true, &block).unwrap();
    assert_eq!(fixture.upload(0x1C13, 0, true), Ok(block));
}

/// Object list, object and entry.
const REQUESTS: [(u8, &[u8]); 3] = [(1, &[1, 0]), (3, &[0x00, 0xF0]), (5, &[0x00, 0xF0, 1, 0])];

#[test]
fn absent_sdo_information_is_a_mailbox_error() {
    let variant =
        GatewayVariant { sdo_information: SdoInformation::Absent, ..GatewayVariant::default() };
    let mut fixture = Fixture::with_variant(variant);
    for (opcode, parameters) in REQUESTS {
        let answer = fixture.exchange(&coe(&info(opcode, parameters)));
        assert_eq!(answer[5] & 0x0F, 0, "a mailbox error: {answer:02X?}");
        assert_eq!(answer[6..10], [1, 0, 4, 0]);
    }
    assert_eq!(Fixture::preop().exchange(&coe(&info(3, &[0x00, 0xF0])))[5] & 0x0F, 3);
}

#[test]
fn missing_entries_are_not_described() {
    let missing_entries = MissingEntries::parse(["0xF000:26", "0x9011"]).unwrap();
    let variant = GatewayVariant { missing_entries, ..GatewayVariant::default() };
    let mut fixture = Fixture::with_variant(variant);
    let code = |answer: &[u8]| answer.get(6..10).map(|code| code.to_vec());
    let object = fixture.coe(&info(3, &[0x11, 0x90]));
    assert_eq!(object[2] & 0x7F, 7, "an SDO information error");
    assert_eq!(code(&object), Some(AbortCode::NO_OBJECT.0.to_le_bytes().to_vec()));
    let entry = fixture.coe(&info(5, &[0x00, 0xF0, 26, 0]));
    assert_eq!(entry[2] & 0x7F, 6);
    assert!(entry.get(10..).is_none_or(|rest| rest.iter().all(|byte| *byte == 0)), "{entry:02X?}");
    let entry = fixture.coe(&info(5, &[0x00, 0xF0, 25, 0]));
    assert_eq!(entry[10..12], [7, 0], "an entry that exists");
}

#[test]
fn emergencies_are_sent_or_absent() {
    for (emergencies, expected) in [(Emergencies::Sent, true), (Emergencies::Absent, false)] {
        let variant = GatewayVariant { emergencies, ..GatewayVariant::default() };
        let mut fixture = Fixture::with_variant(variant);
        let fault = crate::fault::GatewayFault::AlError { code: 0x1B };
        fixture.gateway.inject(fixture.now, fault);
        assert_eq!(fixture.gateway.al_state(), AlState::PreOp);
        assert_eq!(fixture.read_now().is_some(), expected, "{emergencies:?}");
    }
}
