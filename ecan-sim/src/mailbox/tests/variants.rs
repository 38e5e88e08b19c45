//! Alternatives for the mailbox services.

use ecan_protocol::device::AlState;
use ecan_protocol::object::AbortCode;

use crate::gateway::variant::{Emergencies, GatewayVariant, MissingEntries, SdoInformation};

use super::fixture::{Fixture, coe, info};

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
