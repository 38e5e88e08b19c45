//! Abort codes of invalid SDO requests.

use ecan_protocol::object::AbortCode;

use super::fixture::{Fixture, MAILBOX, abort_in, coe, info};
use crate::fault::GatewayFault;

#[test]
fn initiating_requests_are_checked() {
    let cases: [(&str, &[u8], AbortCode); 22] = [
        ("specifier 5", &[0xA0, 0, 0xF0, 2, 0, 0, 0, 0], AbortCode::COMMAND),
        ("specifier 6", &[0xC0, 0, 0xF0, 2, 0, 0, 0, 0], AbortCode::COMMAND),
        ("specifier 7", &[0xE0, 0, 0xF0, 2, 0, 0, 0, 0], AbortCode::COMMAND),
        ("segment of nothing, up", &[0x60, 0, 0, 0, 0, 0, 0, 0], AbortCode::COMMAND),
        ("segment of nothing, down", &[0x00, 0, 0, 0, 0, 0, 0, 0], AbortCode::COMMAND),
        ("normal download without size", &[0x20, 0, 0x80, 3, 2, 0, 0, 0, 1, 0], AbortCode::COMMAND),
        ("no object, up", &[0x40, 0x34, 0x12, 0, 0, 0, 0, 0], AbortCode::NO_OBJECT),
        ("no object, down", &[0x2F, 0x34, 0x12, 0, 0, 0, 0, 0], AbortCode::NO_OBJECT),
        ("no subindex", &[0x40, 0, 0xF0, 33, 0, 0, 0, 0], AbortCode::NO_SUBINDEX),
        ("write-only", &[0x40, 0, 0x80, 1, 0, 0, 0, 0], AbortCode::WRITE_ONLY),
        ("read-only", &[0x2F, 0, 0xF0, 2, 4, 0, 0, 0], AbortCode::READ_ONLY),
        ("three bytes of two", &[0x27, 0, 0x80, 3, 1, 2, 3, 0], AbortCode::TOO_LONG),
        ("one byte of two", &[0x2F, 0, 0x80, 3, 1, 0, 0, 0], AbortCode::TOO_SHORT),
        ("no byte", &[0x21, 0, 0x80, 3, 0, 0, 0, 0], AbortCode::LENGTH),
        ("out of range", &[0x2F, 0, 0x80, 12, 4, 0, 0, 0], AbortCode::TOO_GREAT),
        ("more than announced", &[0x21, 0, 0x80, 3, 1, 0, 0, 0, 1, 2], AbortCode::TOO_LONG),
        ("more than memory", &[0x21, 0, 0x80, 3, 1, 4, 0, 0], AbortCode::OUT_OF_MEMORY),
        ("4 GB", &[0x21, 0, 0x80, 3, 255, 255, 255, 255], AbortCode::OUT_OF_MEMORY),
        ("segments for two bytes", &[0x21, 0, 0x80, 3, 3, 0, 0, 0, 1], AbortCode::TOO_LONG),
        ("segments for what is read-only", &[0x21, 0, 0xF0, 2, 9, 0, 0, 0], AbortCode::READ_ONLY),
        ("segments for no object", &[0x21, 0x34, 0x12, 0, 9, 0, 0, 0], AbortCode::NO_OBJECT),
        ("segments for no subindex", &[0x21, 0, 0xF0, 33, 9, 0, 0, 0], AbortCode::NO_SUBINDEX),
    ];
    for (what, sdo, code) in cases {
        let mut fixture = Fixture::preop();
        let mut body = vec![0x00, 0x20];
        body.extend_from_slice(sdo);
        let answer = fixture.coe(&body);
        assert_eq!(abort_in(&answer), Some(code), "{what}: {answer:02X?}");
        if !matches!(sdo[0] >> 5, 0 | 3) {
            assert_eq!(answer[3..6], sdo[1..4], "{what}: the abort names the entry");
        }
        assert_eq!(fixture.upload(0xF000, 2, false), Ok(vec![4]), "{what}: the next is served");
    }
}

/// A download of 16 bytes to 0x7000:1 with four of them present.
const BEGIN_DOWNLOAD: [u8; 14] =
    [0x00, 0x20, 0x21, 0x00, 0x70, 0x01, 16, 0, 0, 0, b'0', b'1', b'2', b'3'];

#[test]
fn segments_of_a_download() {
    let seven = |command| [0x00, 0x20, command, 1, 2, 3, 4, 5, 6, 7];
    let long = {
        let mut body = vec![0x00, 0x20, 0x01];
        body.extend_from_slice(&[7; 13]);
        body
    };
    let cases: [(&str, &[u8], AbortCode); 4] = [
        ("wrong toggle", &seven(0x10), AbortCode::TOGGLE),
        ("last too early", &seven(0x01), AbortCode::TOO_SHORT),
        ("too much", &long, AbortCode::TOO_LONG),
        ("the other direction", &seven(0x60), AbortCode::COMMAND),
    ];
    for (what, segment, code) in cases {
        let mut fixture = Fixture::preop();
        assert_eq!(abort_in(&fixture.coe(&BEGIN_DOWNLOAD)), None);
        let answer = fixture.coe(segment);
        assert_eq!(abort_in(&answer), Some(code), "{what}");
        assert_eq!(answer[3..6], [0x00, 0x70, 0x01], "{what}");
        assert_eq!(
            fixture.abort_of(&seven(0x00)),
            AbortCode::COMMAND,
            "{what}: the transfer is over"
        );
        assert_eq!(fixture.value(0x7000, 1), [0; 16], "{what}: nothing was written");
    }
}

#[test]
fn segments_of_an_upload() {
    let cases = [("wrong toggle", 0x70, AbortCode::TOGGLE), ("down", 0x00, AbortCode::COMMAND)];
    for (what, command, code) in cases {
        let mut fixture = Fixture::with_mailbox(20);
        let first = fixture.coe(&[0x00, 0x20, 0x40, 0x00, 0x60, 0x01, 0, 0, 0, 0]);
        assert_eq!(first[6..10], [16, 0, 0, 0]);
        assert_eq!(fixture.abort_of(&[0x00, 0x20, command, 0, 0, 0, 0, 0, 0, 0]), code, "{what}");
        let again = fixture.abort_of(&[0x00, 0x20, 0x60, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(again, AbortCode::COMMAND, "{what}: the transfer is over");
    }
}

#[test]
fn client_abort_ends_the_transfer() {
    let mut fixture = Fixture::preop();
    fixture.coe(&BEGIN_DOWNLOAD);
    fixture.write(&coe(&[0x00, 0x20, 0x80, 0x00, 0x70, 0x01, 0, 0, 0, 8]));
    assert_eq!(fixture.server.next_ready(), None, "an abort has no answer");
    let segment = [0x00, 0x20, 0x01, 1, 2, 3, 4, 5, 6, 7];
    assert_eq!(fixture.abort_of(&segment), AbortCode::COMMAND);
    assert_eq!(fixture.value(0x7000, 1), [0; 16]);
}

#[test]
fn new_transfer_ends_the_one_before() {
    let mut fixture = Fixture::preop();
    fixture.coe(&BEGIN_DOWNLOAD);
    assert_eq!(fixture.upload(0xF000, 2, false), Ok(vec![4]));
    let segment = [0x00, 0x20, 0x00, 1, 2, 3, 4, 5, 6, 7];
    assert_eq!(fixture.abort_of(&segment), AbortCode::COMMAND);
}

#[test]
fn injected_abort_reaches_the_master() {
    let mut fixture = Fixture::with_complete_access(MAILBOX);
    let fault = GatewayFault::SdoAbort { index: 0xF000, subindex: 2, code: 0x0800_0021, times: 1 };
    fixture.gateway.inject(fixture.now, fault);
    assert_eq!(fixture.upload(0xF000, 2, false), Err(AbortCode::LOCAL_CONTROL));
    fixture.gateway.inject(fixture.now, fault);
    assert_eq!(fixture.upload(0xF000, 1, true), Err(AbortCode::LOCAL_CONTROL));
    assert_eq!(fixture.upload(0xF000, 2, false), Ok(vec![4]));
}

#[test]
fn errors_of_sdo_information() {
    let cases: [(&str, Vec<u8>, AbortCode); 6] = [
        ("no object", info(3, &[0x34, 0x12]), AbortCode::NO_OBJECT),
        ("an entry of no object", info(5, &[0x34, 0x12, 0, 0]), AbortCode::NO_OBJECT),
        ("no entry", info(5, &[0x00, 0xF0, 33, 0]), AbortCode::NO_SUBINDEX),
        ("list 6", info(1, &[6, 0]), AbortCode::UNSUPPORTED_ACCESS),
        ("opcode 0", info(0, &[]), AbortCode::COMMAND),
        ("a response", info(2, &[1, 0]), AbortCode::COMMAND),
    ];
    for (what, request, code) in cases {
        let mut fixture = Fixture::preop();
        let mut expected = vec![0x00, 0x80, 7, 0, 0, 0];
        expected.extend_from_slice(&code.0.to_le_bytes());
        assert_eq!(fixture.coe(&request), expected, "{what}");
    }
}
