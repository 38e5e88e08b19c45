//! The EtherCAT state machine and its AL status codes (manual 5.4.6, 14).

mod gateway_support;

use AlState::{Boot, Init, Op, PreOp, SafeOp};
use ecan_protocol::config::assignment_writes;
use ecan_protocol::device::AlState;
use ecan_protocol::mapping::Direction;
use ecan_sim::{Gateway, GatewayFault, GatewayModelConfig, Sync0, SyncManagerConfig};
use gateway_support::{Fixture, MS, chunks, standard};

#[test]
fn nothing_answers_before_the_boot_is_over() {
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
        let mut bench = Fixture::configured(chunks(3), chunks(3));
        bench.gateway.request_al_state(bench.now, Init);
        if from != Init {
            bench.gateway.request_al_state(bench.now, PreOp);
        }
        if from == SafeOp {
            bench.gateway.request_al_state(bench.now, SafeOp);
        }
        bench.gateway.request_al_state(bench.now, to);
        assert_eq!(bench.state(), (from, 0x11), "{from} to {to}");
        assert!(bench.gateway.al_error());
        bench.gateway.request_al_state(bench.now, from);
        assert_eq!(bench.state(), (from, 0), "asking for the present state acknowledges");
        assert!(!bench.gateway.al_error());
    }
}

#[test]
fn boot_is_reached_from_init_only_and_has_no_coe() {
    let mut bench = Fixture::preop();
    bench.gateway.request_al_state(bench.now, Init);
    bench.gateway.request_al_state(bench.now, Boot);
    assert_eq!(bench.state(), (Boot, 0));
    assert_eq!(bench.try_upload(0xF000, 2).unwrap_err().0, 0x0800_0022);
    bench.gateway.request_al_state(bench.now, PreOp);
    assert_eq!(bench.state(), (Boot, 0x11));
    bench.gateway.request_al_state(bench.now, Init);
    assert_eq!(bench.state(), (Init, 0));
}

#[test]
fn preop_needs_both_mailboxes() {
    let mut bench = Fixture::preop();
    bench.gateway.request_al_state(bench.now, Init);
    bench.gateway.configure_sync_manager(1, None);
    bench.gateway.request_al_state(bench.now, PreOp);
    assert_eq!(bench.state(), (Init, 0x16));
    bench.set_up_mailboxes();
    bench.gateway.request_al_state(bench.now, PreOp);
    assert_eq!(bench.state(), (PreOp, 0));
}

#[test]
fn safeop_needs_sync_managers_of_the_active_length() {
    for (direction, code) in [(Direction::RxPdo, 0x1D), (Direction::TxPdo, 0x1E)] {
        for length in [0, 128, 383, 385, 1024] {
            let mut bench = Fixture::configured(chunks(3), chunks(3));
            bench.set_up_sync_manager(direction, length);
            bench.gateway.request_al_state(bench.now, SafeOp);
            assert_eq!(bench.state(), (PreOp, code), "{direction} {length}");
            bench.set_up_sync_manager(direction, 384);
            bench.gateway.request_al_state(bench.now, SafeOp);
            assert_eq!(bench.state(), (SafeOp, 0));
        }
    }
}

#[test]
fn sync_managers_must_be_single_buffers_of_the_right_direction_in_place() {
    let good = SyncManagerConfig { start: 0x1100, length: 384, control: 0x66 };
    for bad in [
        SyncManagerConfig { control: 0x64, ..good },
        SyncManagerConfig { control: 0x62, ..good },
        SyncManagerConfig { start: 0x1000, ..good },
        SyncManagerConfig { start: 0x2800, ..good },
    ] {
        let mut bench = Fixture::configured(chunks(3), chunks(3));
        bench.gateway.configure_sync_manager(2, Some(bad));
        bench.gateway.request_al_state(bench.now, SafeOp);
        assert_eq!(bench.state(), (PreOp, 0x1D), "{bad:?}");
    }
    let mut bench = Fixture::configured(chunks(3), chunks(3));
    let overlapping = SyncManagerConfig { start: 0x1200, length: 384, control: 0x22 };
    bench.gateway.configure_sync_manager(3, Some(overlapping));
    bench.gateway.request_al_state(bench.now, SafeOp);
    assert_eq!(bench.state(), (PreOp, 0x1E));
}

#[test]
fn assignment_and_profile_must_agree() {
    let mut bench = Fixture::configured(chunks(8), chunks(8));
    for write in assignment_writes(Direction::RxPdo, 3) {
        bench.send(write);
    }
    bench.set_up_sync_manager(Direction::RxPdo, 384);
    bench.gateway.request_al_state(bench.now, SafeOp);
    assert_eq!(bench.state(), (PreOp, 0x1D));
}

#[test]
fn requested_defaults_are_applied_on_the_way_to_safeop() {
    let mut bench = Fixture::preop();
    for direction in Direction::ALL {
        bench.set_up_sync_manager(direction, 1024);
        for write in assignment_writes(direction, 8) {
            bench.send(write);
        }
    }
    bench.gateway.request_al_state(bench.now, SafeOp);
    assert_eq!(bench.state(), (SafeOp, 0));
    assert_eq!(bench.upload(0x8010, 12), 0x1E7);
    assert_eq!(bench.upload(0x8011, 9), 1024);
}

#[test]
fn defaults_do_not_meet_the_assignment_after_power_on() {
    let mut bench = Fixture::preop();
    for direction in Direction::ALL {
        bench.set_up_sync_manager(direction, 1024);
    }
    bench.gateway.request_al_state(bench.now, SafeOp);
    assert_eq!(bench.state(), (PreOp, 0x1D));
    assert_eq!(bench.upload(0x8011, 2), 5);
}

#[test]
fn watchdog_throws_back_to_safeop() {
    let mut bench = Fixture::op(chunks(3), chunks(3));
    bench.gateway.set_watchdog_ns(5 * MS);
    for _ in 0..10 {
        bench.cycle();
    }
    assert_eq!(bench.state(), (Op, 0));
    let last = bench.now - MS;
    assert_eq!(bench.gateway.next_event(), Some(last + 5 * MS));
    bench.pass(4 * MS);
    assert_eq!(bench.state(), (SafeOp, 0x1B));
    assert!(bench.gateway.al_error());
    bench.gateway.request_al_state(bench.now, Op);
    assert_eq!(bench.state(), (Op, 0));
}

#[test]
fn refused_writes_do_not_feed_the_watchdog() {
    let mut bench = Fixture::op(chunks(3), chunks(3));
    bench.gateway.set_watchdog_ns(5 * MS);
    for _ in 0..20 {
        bench.gateway.write_outputs(bench.now, &[0; 100]);
        bench.pass(MS);
    }
    assert_eq!(bench.state(), (SafeOp, 0x1B));
}

#[test]
fn watchdog_sleeps_without_its_control_bit_or_time() {
    for (control, watchdog) in [(0x26, 5 * MS), (0x66, 0)] {
        let mut bench = Fixture::configured(chunks(3), chunks(3));
        let settings = SyncManagerConfig { start: 0x1100, length: 384, control };
        bench.gateway.configure_sync_manager(2, Some(settings));
        bench.gateway.set_watchdog_ns(watchdog);
        bench.start();
        bench.pass(1_000 * MS);
        assert_eq!(bench.state(), (Op, 0));
    }
}

#[test]
fn op_waits_for_the_first_pulse() {
    let mut bench = Fixture::configured(chunks(3), chunks(3));
    let first = bench.now + 100 * MS;
    let sync0 = Sync0 { start_ns: first, cycle_ns: MS as u32, shift_ns: 0 };
    bench.gateway.set_dc_sync0(Some(sync0));
    bench.gateway.request_al_state(bench.now, SafeOp);
    bench.gateway.request_al_state(bench.now, Op);
    assert_eq!(bench.state(), (SafeOp, 0));
    bench.gateway.advance(first - 1);
    assert_eq!(bench.state(), (SafeOp, 0));
    bench.gateway.advance(first);
    assert_eq!(bench.state(), (Op, 0));
}

#[test]
fn pulses_that_never_come_are_a_sync_error() {
    let mut bench = Fixture::configured(chunks(3), chunks(3));
    let sync0 = Sync0 { start_ns: u64::MAX / 2, cycle_ns: MS as u32, shift_ns: 0 };
    bench.gateway.set_dc_sync0(Some(sync0));
    bench.gateway.request_al_state(bench.now, SafeOp);
    bench.gateway.request_al_state(bench.now, Op);
    bench.pass(3_000 * MS);
    assert_eq!(bench.state(), (SafeOp, 0x2D));
    assert!(bench.gateway.al_error());
}

#[test]
fn pulses_that_stop_in_op_are_a_fatal_sync_error() {
    let mut bench = Fixture::configured(chunks(3), chunks(3));
    bench.start_sync0();
    bench.pass(MS);
    bench.start();
    bench.gateway.set_dc_sync0(None);
    assert_eq!(bench.state(), (SafeOp, 0x2C));
}

#[test]
fn missed_outputs_are_a_fatal_sync_error_where_they_are_watched() {
    let settings = GatewayModelConfig { missed_sync_limit: 4, ..GatewayModelConfig::default() };
    let mut bench = Fixture::preop_with(settings);
    bench.apply_profiles(chunks(3), chunks(3));
    bench.start_sync0();
    bench.pass(MS);
    bench.start();
    bench.cycle();
    bench.pass(10 * MS);
    assert_eq!(bench.state(), (SafeOp, 0x2C));
}

#[test]
fn sync_manager_taken_away_in_op_throws_back_to_preop() {
    let mut bench = Fixture::op(chunks(3), chunks(3));
    bench.gateway.configure_sync_manager(2, None);
    assert_eq!(bench.state(), (PreOp, 0x1D));
}

#[test]
fn injected_error_shows_its_code() {
    let mut bench = Fixture::op(chunks(3), chunks(3));
    bench.gateway.inject(bench.now, GatewayFault::AlError { code: 0x0020 });
    assert_eq!(bench.state(), (SafeOp, 0x20));
    assert!(bench.gateway.al_error());
}

#[test]
fn leaving_op_drops_what_waits_to_be_sent() {
    let mut bench = Fixture::op(chunks(8), chunks(8));
    for id in 0..10 {
        bench.push(0, standard(id, &[]));
    }
    bench.cycle();
    bench.gateway.request_al_state(bench.now, SafeOp);
    assert_eq!(bench.sent(0).len(), 4, "those that the controller had already");
    bench.gateway.request_al_state(bench.now, Op);
    bench.cycle();
    assert_eq!(bench.sent(0), []);
    assert_eq!(bench.gateway.counters().transmit_losses.stale, 6);
}

#[test]
fn reboot_command_loses_all_volatile_configuration() {
    let mut bench = Fixture::op(chunks(8), chunks(8));
    let generation = bench.gateway.station_generation(0);
    bench.write_u8(0x8000, 1, 1);
    bench.pass(5 * MS);
    assert!(bench.gateway.is_responding(), "its answer is fetched first");
    bench.pass(10 * MS);
    assert!(!bench.gateway.is_responding());
    bench.pass(1_000 * MS);
    assert_eq!(bench.state(), (Init, 0));
    assert_eq!(bench.gateway.station_config(0), None);
    assert_ne!(bench.gateway.station_generation(0), generation);
    bench.set_up_mailboxes();
    bench.gateway.request_al_state(bench.now, PreOp);
    assert_eq!(bench.upload(0x8010, 12), 0);
}
