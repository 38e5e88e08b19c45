//! Emergencies on their way to the master.

use ecan_protocol::device::AlState;
use ecan_protocol::mapping::{Direction, sync_manager, sync_manager_address, sync_manager_control};

use super::bench::{Fixture, MS, coe};
use crate::bus::ErrorState;
use crate::gateway::{GatewayFault, SyncManagerConfig};

/// Error code and bytes of an emergency message.
fn emergency(message: &[u8]) -> (u16, [u8; 5]) {
    assert_eq!(message[..5], [10, 0, 0, 0, 0]);
    assert_eq!(message[5] & 0x0F, 3);
    assert_eq!(message[6..8], [0x00, 0x10]);
    (u16::from_le_bytes([message[8], message[9]]), message[11..].try_into().unwrap())
}

#[test]
fn bus_off_and_its_end() {
    let mut bench = Fixture::preop();
    for (state, counter) in [(ErrorState::Passive, 130), (ErrorState::BusOff, 256)] {
        bench.gateway.bus_state(bench.now, 1, state, counter, 0);
        bench.gateway.bus_state(bench.now, 1, state, counter, 0);
    }
    assert_eq!(emergency(&bench.read_now().unwrap()), (0x8100, [1, 0, 0, 0, 0]));
    assert_eq!(bench.read_now(), None, "one bus-off is one emergency");
    bench.gateway.bus_state(bench.now, 1, ErrorState::Active, 0, 0);
    assert_eq!(emergency(&bench.read_now().unwrap()), (0x8140, [1, 0, 0, 0, 0]));
    assert_eq!(bench.read_now(), None);
}

#[test]
fn a_slave_that_falls_back_says_why() {
    let mut bench = Fixture::preop();
    bench.gateway.inject(bench.now, GatewayFault::AlError { code: 0x001B });
    bench.gateway.inject(bench.now, GatewayFault::AlError { code: 0x002C });
    assert_eq!(emergency(&bench.read_now().unwrap()), (0x8130, [0x1B, 0, 0, 0, 0]));
    assert_eq!(emergency(&bench.read_now().unwrap()), (0x8200, [0x2C, 0, 0, 0, 0]));
}

#[test]
fn the_watchdog_after_a_start_as_a_master_does_it() {
    let mut bench = Fixture::preop();
    for (direction, object, first_map) in
        [(Direction::RxPdo, 0x1C12, 0x1600_u16), (Direction::TxPdo, 0x1C13, 0x1A00)]
    {
        let mut block = vec![8, 0];
        block.extend((0..8).flat_map(|chunk| (first_map + chunk).to_le_bytes()));
        bench.download(object, 0, true, &block).unwrap();
        let settings = SyncManagerConfig {
            start: sync_manager_address(direction),
            length: 1024,
            control: sync_manager_control(direction),
        };
        bench.gateway.configure_sync_manager(sync_manager(direction), Some(settings));
    }
    bench.gateway.set_watchdog_ns(3 * MS);
    for state in [AlState::SafeOp, AlState::Op] {
        bench.gateway.request_al_state(bench.now, state);
        assert_eq!(bench.gateway.al_state(), state);
    }
    assert_eq!(bench.read_now(), None);
    bench.now += 3 * MS;
    assert_eq!(emergency(&bench.read_now().unwrap()), (0x8130, [0x1B, 0, 0, 0, 0]));
    assert_eq!(bench.gateway.al_state(), AlState::SafeOp);
    assert_eq!(bench.read_now(), None);
}

#[test]
fn emergencies_overtake_answers() {
    let mut bench = Fixture::preop();
    bench.write(&coe(&[0x00, 0x20, 0x40, 0x00, 0xF0, 0x02, 0, 0, 0, 0]));
    bench.now += MS;
    bench.gateway.bus_state(bench.now, 0, ErrorState::BusOff, 256, 0);
    let first = bench.read_now().unwrap();
    assert_eq!(emergency(&first).0, 0x8100);
    let second = bench.read_now().unwrap();
    assert_eq!(second[6..9], [0x00, 0x30, 0x4F]);
    assert_eq!((first[5] >> 4, second[5] >> 4), (1, 2), "one count for both");
}

#[test]
fn none_without_a_mailbox() {
    let mut bench = Fixture::preop();
    bench.gateway.bus_state(bench.now, 0, ErrorState::BusOff, 256, 0);
    bench.gateway.request_al_state(bench.now, AlState::Init);
    assert!(!bench.server.is_due(bench.now, &bench.gateway));
    bench.gateway.bus_state(bench.now, 1, ErrorState::BusOff, 256, 0);
    bench.gateway.request_al_state(bench.now, AlState::PreOp);
    assert!(!bench.server.is_due(bench.now, &bench.gateway));
    assert_eq!(bench.read_now(), None, "what happened in INIT or before it is past");
}

#[test]
fn a_silent_mailbox_keeps_them() {
    let mut bench = Fixture::preop();
    bench.gateway.inject(bench.now, GatewayFault::MailboxSilent { ms: 1 });
    bench.gateway.bus_state(bench.now, 3, ErrorState::BusOff, 256, 0);
    assert!(!bench.server.is_due(bench.now, &bench.gateway));
    assert_eq!(bench.read_now(), None);
    bench.now += MS;
    assert!(bench.server.is_due(bench.now, &bench.gateway));
    assert_eq!(emergency(&bench.read_now().unwrap()), (0x8100, [3, 0, 0, 0, 0]));
}
