//! The emulated EEPROM: it survives everything but its rebuild (manual 13.7, bit 6).

mod gateway_support;

use ecan_protocol::device::AlState;
use gateway_support::{Fixture, MS, chunks};

const REBUILD: u8 = 1 << 6;
const DENIED: u32 = 2;

fn with_eeprom(mut bench: Fixture) -> Fixture {
    assert!(bench.gateway.eeprom().is_empty());
    bench.gateway.install_eeprom(vec![1, 2, 3]);
    assert_eq!(bench.gateway.eeprom(), [1, 2, 3]);
    bench.gateway.write_eeprom(1, 0xBEEF);
    bench.gateway.write_eeprom(3, 4);
    assert_eq!(bench.gateway.eeprom(), [1, 0xBEEF, 3], "nothing is outside");
    bench
}

#[test]
fn words_survive_power_loss_and_reboot() {
    let mut bench = with_eeprom(Fixture::preop());
    bench.gateway.power(bench.now, false);
    assert_eq!(bench.gateway.eeprom(), [1, 0xBEEF, 3]);
    bench.gateway.power(bench.now, true);
    bench.pass(1_000 * MS);
    bench.set_up_mailboxes();
    bench.gateway.request_al_state(bench.now, AlState::PreOp);
    bench.write_u8(0x8000, 1, 1);
    bench.pass(1_000 * MS);
    assert_eq!(bench.gateway.eeprom(), [1, 0xBEEF, 3]);
    bench.gateway.install_eeprom(vec![7]);
    assert_eq!(bench.gateway.eeprom(), [1, 0xBEEF, 3], "only an empty one is filled");
}

#[test]
fn the_rebuild_command_erases_and_reboots() {
    let mut bench = with_eeprom(Fixture::preop());
    for mode in [0, 1] {
        bench.write_u8(0xB000, 1, mode);
        bench.write_u8(0xB000, 4, REBUILD);
        assert_eq!(bench.upload(0xB000, 5), DENIED);
    }
    bench.write_u8(0xB000, 1, 2);
    bench.write_u8(0xB000, 4, REBUILD);
    assert_eq!(bench.upload(0xB000, 5), 1);
    bench.pass(20 * MS);
    assert!(!bench.gateway.is_responding());
    assert!(bench.gateway.eeprom().is_empty());
    bench.pass(200 * MS);
    assert!(bench.gateway.is_responding());
    assert_eq!(bench.gateway.al_state(), AlState::Init);
    assert_eq!(bench.gateway.eeprom(), [1, 2, 3]);
}

#[test]
fn a_rebuild_that_lost_its_supply_is_made_up_for() {
    let mut bench = with_eeprom(Fixture::preop());
    bench.gateway.rebuild_eeprom(bench.now);
    bench.pass(MS);
    bench.gateway.power(bench.now, false);
    assert!(bench.gateway.eeprom().is_empty());
    bench.gateway.rebuild_eeprom(bench.now);
    bench.gateway.power(bench.now, true);
    bench.pass(200 * MS);
    assert_eq!(bench.gateway.eeprom(), [1, 2, 3]);
}

#[test]
fn no_rebuild_in_op() {
    let mut bench = with_eeprom(Fixture::op(chunks(1), chunks(1)));
    bench.write_u8(0xB000, 1, 2);
    bench.write_u8(0xB000, 4, REBUILD);
    assert_eq!(bench.upload(0xB000, 5), DENIED);
    bench.pass(50 * MS);
    assert_eq!(bench.gateway.eeprom(), [1, 0xBEEF, 3]);
}
