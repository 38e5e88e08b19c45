//! The EtherCAT state machine and its AL status codes (manual 5.4.6, 14).

use super::fixture::{Fixture, MS, chunks};
use AlState::{Boot, Init, Op, PreOp, SafeOp};
use ecan_protocol::config::assignment_writes;
use ecan_protocol::device::AlState;
use ecan_protocol::mapping::Direction;
use ecan_sim::{Gateway, GatewayFault, GatewayModelConfig, Sync0, SyncManagerConfig};

#[test]
fn nothing_responds_before_the_boot_ends() {
    let mut gateway = Gateway::new(GatewayModelConfig::default(), 0);
    assert!(!gateway.is_responding());
    assert_eq!(gateway.next_event(), None);
    gateway.power(10 * MS, true);
    let booted = 10 * MS + u64::from(GatewayModelConfig::default().boot_ms) * MS;
    assert_eq!(gateway.next_event(), Some(booted));
    gateway.advance(booted - 1);
    gateway.request_al_state(booted - 1, PreOp);
    assert!(!gateway.is_responding());
    gateway.advance(booted);
    assert!(gateway.is_responding());
    assert_eq!(gateway.al_state(), Init);
    assert!(!gateway.mailbox_answers(booted), "INIT has no mailbox");
}

#[test]
fn only_the_steps_of_the_state_machine_are_valid() {
    for (from, to) in [(Init, SafeOp), (Init, Op), (PreOp, Op), (PreOp, Boot), (SafeOp, Boot)] {
        let mut fixture = Fixture::configured(chunks(3), chunks(3));
        fixture.request(Init);
        if from != Init {
            fixture.request(PreOp);
        }
        if from == SafeOp {
            fixture.request(SafeOp);
        }
        assert_eq!(fixture.request(to), (from, 0x11), "{from} to {to}");
        assert!(fixture.gateway.al_error());
        assert_eq!(fixture.request(from), (from, 0), "asking for the present state acknowledges");
        assert!(!fixture.gateway.al_error());
    }
}

#[test]
fn boot_is_reached_from_init_only_and_has_no_coe() {
    let mut fixture = Fixture::preop();
    fixture.request(Init);
    assert_eq!(fixture.request(Boot), (Boot, 0));
    assert_eq!(fixture.try_upload(0xF000, 2).unwrap_err().0, 0x0800_0022);
    assert_eq!(fixture.request(PreOp), (Boot, 0x11));
    assert_eq!(fixture.request(Init), (Init, 0));
}

#[test]
fn preop_needs_both_mailboxes() {
    let mut fixture = Fixture::preop();
    fixture.request(Init);
    fixture.gateway.configure_sync_manager(1, None);
    assert_eq!(fixture.request(PreOp), (Init, 0x16));
    fixture.enter_preop();
    assert_eq!(fixture.state(), (PreOp, 0));
}

#[test]
fn safeop_needs_sync_managers_of_the_active_length() {
    for (direction, code) in [(Direction::RxPdo, 0x1D), (Direction::TxPdo, 0x1E)] {
        for length in [0, 128, 383, 385, 1024] {
            let mut fixture = Fixture::configured(chunks(3), chunks(3));
            fixture.set_up_sync_manager(direction, length);
            assert_eq!(fixture.request(SafeOp), (PreOp, code), "{direction} {length}");
            fixture.set_up_sync_manager(direction, 384);
            assert_eq!(fixture.request(SafeOp), (SafeOp, 0));
        }
    }
}

#[test]
fn sync_managers_must_have_start_and_control_of_the_manual() {
    let outputs = SyncManagerConfig { start: 0x1100, length: 384, control: 0x66 };
    let inputs = SyncManagerConfig { start: 0x1D00, length: 384, control: 0x22 };
    for (number, good, code) in [(2, outputs, 0x1D), (3, inputs, 0x1E)] {
        // Three buffers, the other direction, no interrupt for the firmware, other addresses.
        for bad in [
            SyncManagerConfig { control: good.control & !0x02, ..good },
            SyncManagerConfig { control: good.control ^ 0x04, ..good },
            SyncManagerConfig { control: good.control & !0x20, ..good },
            SyncManagerConfig { start: good.start - 0x100, ..good },
            SyncManagerConfig { start: good.start + 0x80, ..good },
            SyncManagerConfig { start: 0x2800, ..good },
        ] {
            let mut fixture = Fixture::configured(chunks(3), chunks(3));
            fixture.gateway.configure_sync_manager(number, Some(bad));
            assert_eq!(fixture.request(SafeOp), (PreOp, code), "SM{number} {bad:?}");
        }
        let mut fixture = Fixture::configured(chunks(3), chunks(3));
        let other_watchdog = SyncManagerConfig { control: good.control ^ 0x40, ..good };
        fixture.gateway.configure_sync_manager(number, Some(other_watchdog));
        assert_eq!(fixture.request(SafeOp), (SafeOp, 0), "SM{number}");
    }
}

#[test]
fn assignment_and_profile_must_agree() {
    let mut fixture = Fixture::configured(chunks(8), chunks(8));
    fixture.send(assignment_writes(Direction::RxPdo, 3));
    fixture.set_up_sync_manager(Direction::RxPdo, 384);
    assert_eq!(fixture.request(SafeOp), (PreOp, 0x1D));
}

#[test]
fn requested_defaults_are_applied_on_the_way_to_safeop() {
    let mut fixture = Fixture::preop();
    for direction in Direction::ALL {
        fixture.set_up_sync_manager(direction, 1024);
        fixture.send(assignment_writes(direction, 8));
    }
    assert_eq!(fixture.request(SafeOp), (SafeOp, 0));
    fixture.has(&[(0x8010, 12, 0x1E7), (0x8011, 9, 1024)]);
}

#[test]
fn default_profiles_do_not_match_the_default_assignment() {
    let mut fixture = Fixture::preop();
    for direction in Direction::ALL {
        fixture.set_up_sync_manager(direction, 1024);
    }
    assert_eq!(fixture.request(SafeOp), (PreOp, 0x1D));
    assert_eq!(fixture.upload(0x8011, 2), 5);
}

#[test]
fn watchdog_forces_safeop() {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    fixture.gateway.set_watchdog_ns(5 * MS);
    for _ in 0..10 {
        fixture.cycle();
    }
    assert_eq!(fixture.state(), (Op, 0));
    let last = fixture.now - MS;
    assert_eq!(fixture.gateway.next_event(), Some(last + 5 * MS));
    fixture.pass(4 * MS);
    assert_eq!(fixture.state(), (SafeOp, 0x1B));
    assert!(fixture.gateway.al_error());
    assert_eq!(fixture.request(Op), (Op, 0));
}

#[test]
fn rejected_writes_do_not_feed_the_watchdog() {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    fixture.gateway.set_watchdog_ns(5 * MS);
    for _ in 0..20 {
        fixture.gateway.write_outputs(fixture.now, &[0; 100]);
        fixture.pass(MS);
    }
    assert_eq!(fixture.state(), (SafeOp, 0x1B));
}

#[test]
fn watchdog_is_disabled_without_control_bit_or_time() {
    for (control, watchdog) in [(0x26, 5 * MS), (0x66, 0)] {
        let mut fixture = Fixture::configured(chunks(3), chunks(3));
        let config = SyncManagerConfig { start: 0x1100, length: 384, control };
        fixture.gateway.configure_sync_manager(2, Some(config));
        fixture.gateway.set_watchdog_ns(watchdog);
        fixture.start();
        fixture.pass(1_000 * MS);
        assert_eq!(fixture.state(), (Op, 0));
    }
}

#[test]
fn op_waits_for_the_first_pulse() {
    let mut fixture = Fixture::configured(chunks(3), chunks(3));
    let first = fixture.now + 100 * MS;
    let sync0 = Sync0 { start_ns: first, cycle_ns: MS as u32, shift_ns: 0 };
    fixture.gateway.set_dc_sync0(Some(sync0));
    fixture.request(SafeOp);
    assert_eq!(fixture.request(Op), (SafeOp, 0));
    fixture.gateway.advance(first - 1);
    assert_eq!(fixture.state(), (SafeOp, 0));
    fixture.gateway.advance(first);
    assert_eq!(fixture.state(), (Op, 0));
}

#[test]
fn missing_pulses_are_a_sync_error() {
    let mut fixture = Fixture::configured(chunks(3), chunks(3));
    let sync0 = Sync0 { start_ns: u64::MAX / 2, cycle_ns: MS as u32, shift_ns: 0 };
    fixture.gateway.set_dc_sync0(Some(sync0));
    fixture.request(SafeOp);
    fixture.request(Op);
    fixture.pass(3_000 * MS);
    assert_eq!(fixture.state(), (SafeOp, 0x2D));
    assert!(fixture.gateway.al_error());
}

#[test]
fn stopped_pulses_in_op_are_a_fatal_sync_error() {
    let mut fixture = Fixture::configured(chunks(3), chunks(3));
    fixture.start_with_sync0(0);
    fixture.gateway.set_dc_sync0(None);
    assert_eq!(fixture.state(), (SafeOp, 0x2C));
}

#[test]
fn missed_outputs_are_a_fatal_sync_error_if_limited() {
    let config = GatewayModelConfig { missed_sync_limit: 4, ..GatewayModelConfig::default() };
    let mut fixture = Fixture::preop_with(config);
    fixture.apply_profiles(chunks(3), chunks(3));
    fixture.start_with_sync0(0);
    fixture.cycle();
    fixture.pass(10 * MS);
    assert_eq!(fixture.state(), (SafeOp, 0x2C));
}

#[test]
fn sync_manager_disabled_in_op_forces_preop() {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    fixture.gateway.configure_sync_manager(2, None);
    assert_eq!(fixture.state(), (PreOp, 0x1D));
}

#[test]
fn injected_error_shows_its_code() {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    fixture.gateway.inject(fixture.now, GatewayFault::AlError { code: 0x0020 });
    assert_eq!(fixture.state(), (SafeOp, 0x20));
    assert!(fixture.gateway.al_error());
}

#[test]
fn leaving_op_drops_unsent_frames() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    fixture.push_ids(0, 0..10);
    fixture.cycle();
    fixture.request(SafeOp);
    assert_eq!(fixture.sent(0).len(), 4, "those that the controller had already");
    fixture.request(Op);
    fixture.cycle();
    assert_eq!(fixture.sent(0), []);
    assert_eq!(fixture.gateway.counters().transmit_losses.stale, 6);
}

#[test]
fn reboot_command_loses_all_volatile_configuration() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    let generation = fixture.gateway.station_generation(0);
    fixture.write_u8(0x8000, 1, 1);
    fixture.pass(100 * MS - 1);
    assert!(fixture.gateway.is_responding(), "the master fetches the response first");
    fixture.pass(1);
    assert!(!fixture.gateway.is_responding());
    fixture.pass(1_000 * MS);
    assert_eq!(fixture.state(), (Init, 0));
    assert_eq!(fixture.gateway.station_config(0), None);
    assert_ne!(fixture.gateway.station_generation(0), generation);
    fixture.enter_preop();
    assert_eq!(fixture.upload(0x8010, 12), 0);
}
