//! Emergencies in the read mailbox.

use ecan_protocol::device::AlState;
use ecan_protocol::mapping::{Direction, sync_manager, sync_manager_address, sync_manager_control};

use super::fixture::{Fixture, MAILBOX, MS, coe};
use crate::bus::ErrorState;
use crate::fault::GatewayFault;
use crate::gateway::SyncManagerConfig;

fn emergency(message: &[u8]) -> (u16, [u8; 5]) {
    assert_eq!(message[..5], [10, 0, 0, 0, 0]);
    assert_eq!(message[5] & 0x0F, 3);
    assert_eq!(message[6..8], [0x00, 0x10]);
    (u16::from_le_bytes([message[8], message[9]]), message[11..].try_into().unwrap())
}

#[test]
fn bus_off_and_recovery_raise_emergencies() {
    let mut fixture = Fixture::preop();
    for (state, counter) in [(ErrorState::Passive, 130), (ErrorState::BusOff, 256)] {
        fixture.gateway.bus_state(fixture.now, 1, state, counter, 0);
        fixture.gateway.bus_state(fixture.now, 1, state, counter, 0);
    }
    assert_eq!(emergency(&fixture.read_now().unwrap()), (0x8100, [1, 0, 0, 0, 0]));
    assert_eq!(fixture.read_now(), None, "one bus-off is one emergency");
    fixture.gateway.bus_state(fixture.now, 1, ErrorState::Active, 0, 0);
    assert_eq!(emergency(&fixture.read_now().unwrap()), (0x8140, [1, 0, 0, 0, 0]));
    assert_eq!(fixture.read_now(), None);
}

#[test]
fn fallen_back_slave_sends_the_reason() {
    let mut fixture = Fixture::preop();
    fixture.gateway.inject(fixture.now, GatewayFault::AlError { code: 0x001B });
    fixture.gateway.inject(fixture.now, GatewayFault::AlError { code: 0x002C });
    assert_eq!(emergency(&fixture.read_now().unwrap()), (0x8130, [0x1B, 0, 0, 0, 0]));
    assert_eq!(emergency(&fixture.read_now().unwrap()), (0x8200, [0x2C, 0, 0, 0, 0]));
}

#[test]
fn watchdog_expires_after_a_normal_startup() {
    let mut fixture = Fixture::with_complete_access(MAILBOX);
    for (direction, object, first_map) in
        [(Direction::RxPdo, 0x1C12, 0x1600_u16), (Direction::TxPdo, 0x1C13, 0x1A00)]
    {
        let mut block = vec![8, 0];
        block.extend((0..8).flat_map(|chunk| (first_map + chunk).to_le_bytes()));
        fixture.download(object, 0, true, &block).unwrap();
        let config = SyncManagerConfig {
            start: sync_manager_address(direction),
            length: 1024,
            control: sync_manager_control(direction),
        };
        fixture.gateway.configure_sync_manager(sync_manager(direction), Some(config));
    }
    fixture.gateway.set_watchdog_ns(3 * MS);
    for state in [AlState::SafeOp, AlState::Op] {
        fixture.gateway.request_al_state(fixture.now, state);
        assert_eq!(fixture.gateway.al_state(), state);
    }
    assert_eq!(fixture.read_now(), None);
    fixture.now += 3 * MS;
    assert_eq!(emergency(&fixture.read_now().unwrap()), (0x8130, [0x1B, 0, 0, 0, 0]));
    assert_eq!(fixture.gateway.al_state(), AlState::SafeOp);
    assert_eq!(fixture.read_now(), None);
}

#[test]
fn emergencies_precede_responses() {
    let mut fixture = Fixture::preop();
    fixture.write(&coe(&[0x00, 0x20, 0x40, 0x00, 0xF0, 0x02, 0, 0, 0, 0]));
    fixture.now += MS;
    fixture.gateway.bus_state(fixture.now, 0, ErrorState::BusOff, 256, 0);
    let first = fixture.read_now().unwrap();
    assert_eq!(emergency(&first).0, 0x8100);
    let second = fixture.read_now().unwrap();
    assert_eq!(second[6..9], [0x00, 0x30, 0x4F]);
    assert_eq!((first[5] >> 4, second[5] >> 4), (1, 2), "one count for both");
}

#[test]
fn no_emergency_without_a_mailbox() {
    let mut fixture = Fixture::preop();
    fixture.gateway.bus_state(fixture.now, 0, ErrorState::BusOff, 256, 0);
    fixture.gateway.request_al_state(fixture.now, AlState::Init);
    assert!(!fixture.server.is_due(fixture.now, &fixture.gateway));
    fixture.gateway.bus_state(fixture.now, 1, ErrorState::BusOff, 256, 0);
    fixture.gateway.request_al_state(fixture.now, AlState::PreOp);
    assert!(!fixture.server.is_due(fixture.now, &fixture.gateway));
    assert_eq!(fixture.read_now(), None, "what happened in INIT or before it is past");
}

#[test]
fn silent_mailbox_keeps_emergencies() {
    let mut fixture = Fixture::preop();
    fixture.gateway.inject(fixture.now, GatewayFault::MailboxSilent { ms: 1 });
    fixture.gateway.bus_state(fixture.now, 3, ErrorState::BusOff, 256, 0);
    assert!(!fixture.server.is_due(fixture.now, &fixture.gateway));
    assert_eq!(fixture.read_now(), None);
    fixture.now += MS;
    assert!(fixture.server.is_due(fixture.now, &fixture.gateway));
    assert_eq!(emergency(&fixture.read_now().unwrap()), (0x8100, [3, 0, 0, 0, 0]));
}
