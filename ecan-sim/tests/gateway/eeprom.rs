//! The emulated EEPROM, which only a rebuild resets (manual 13.7, bit 6).

use super::fixture::{Fixture, MS, chunks};
use ecan_protocol::device::AlState;

const REBUILD: u8 = 1 << 6;
const DENIED: u32 = 2;

fn with_eeprom(mut fixture: Fixture) -> Fixture {
    assert!(fixture.gateway.eeprom().is_empty());
    fixture.gateway.install_eeprom(vec![1, 2, 3]);
    assert_eq!(fixture.gateway.eeprom(), [1, 2, 3]);
    fixture.gateway.write_eeprom(1, 0xBEEF);
    fixture.gateway.write_eeprom(3, 4);
    assert_eq!(fixture.gateway.eeprom(), [1, 0xBEEF, 3], "nothing is outside");
    fixture
}

#[test]
fn words_survive_power_loss_and_reboot() {
    let mut fixture = with_eeprom(Fixture::preop());
    fixture.gateway.power(fixture.now, false);
    assert_eq!(fixture.gateway.eeprom(), [1, 0xBEEF, 3]);
    fixture.gateway.power(fixture.now, true);
    fixture.pass(1_000 * MS);
    fixture.enter_preop();
    fixture.write_u8(0x8000, 1, 1);
    fixture.pass(1_000 * MS);
    assert_eq!(fixture.gateway.eeprom(), [1, 0xBEEF, 3]);
    fixture.gateway.install_eeprom(vec![7]);
    assert_eq!(fixture.gateway.eeprom(), [1, 0xBEEF, 3], "only an empty one is filled");
}

#[test]
fn rebuild_command_erases_and_reboots() {
    let mut fixture = with_eeprom(Fixture::preop());
    for mode in [0, 1] {
        fixture.write_u8(0xB000, 1, mode);
        fixture.write_u8(0xB000, 4, REBUILD);
        assert_eq!(fixture.upload(0xB000, 5), DENIED);
    }
    fixture.write_u8(0xB000, 1, 2);
    fixture.write_u8(0xB000, 4, REBUILD);
    assert_eq!(fixture.upload(0xB000, 5), 1);
    fixture.pass(20 * MS);
    assert!(!fixture.gateway.is_responding());
    assert!(fixture.gateway.eeprom().is_empty());
    fixture.pass(200 * MS);
    assert!(fixture.gateway.is_responding());
    assert_eq!(fixture.gateway.al_state(), AlState::Init);
    assert_eq!(fixture.gateway.eeprom(), [1, 2, 3]);
}

#[test]
fn interrupted_rebuild_is_completed_at_start() {
    let mut fixture = with_eeprom(Fixture::preop());
    fixture.write_u8(0xB000, 1, 2);
    fixture.write_u8(0xB000, 4, REBUILD);
    fixture.pass(20 * MS);
    fixture.gateway.power(fixture.now, false);
    assert!(fixture.gateway.eeprom().is_empty());
    fixture.gateway.power(fixture.now, true);
    fixture.pass(200 * MS);
    assert_eq!(fixture.gateway.eeprom(), [1, 2, 3]);
}

#[test]
fn no_rebuild_in_op() {
    let mut fixture = with_eeprom(Fixture::op(chunks(1), chunks(1)));
    fixture.write_u8(0xB000, 1, 2);
    fixture.write_u8(0xB000, 4, REBUILD);
    assert_eq!(fixture.upload(0xB000, 5), DENIED);
    fixture.pass(50 * MS);
    assert_eq!(fixture.gateway.eeprom(), [1, 0xBEEF, 3]);
}
