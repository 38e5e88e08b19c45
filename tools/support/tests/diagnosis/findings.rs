//! Each finding of manual 5.4.6, 13 and 16, fed by the values that a gateway would show.

use crate::diagnosis::common::{healthy, only, set_all, with, with_all};
use ecan_tool_support::diagnosis::{Finding, Location, Severity, Snapshot, findings};

/// Name and first cause: what an engineer looks at first.
fn first(finding: &Finding) -> (&'static str, &str) {
    (finding.id, &finding.causes[0])
}

#[test]
fn healthy_gateway_has_no_finding() {
    assert_eq!(findings(&healthy()), []);
}

#[test]
fn gateway_in_preop_has_no_finding() {
    let mut snapshot = Snapshot { al_state: 2, ..Snapshot::default() };
    snapshot.set(0x1C12, 0, 24);
    for profile in [0x8010, 0x8011] {
        set_all(&mut snapshot, &[(profile, 3, 8), (profile, 9, 0)]);
    }
    snapshot.set(0x9000, 9, 0);
    assert_eq!(findings(&snapshot), []);
    assert_eq!(findings(&Snapshot::default()), []);
}

#[test]
fn missing_value_is_shown_as_unknown() {
    let mut snapshot = Snapshot { al_state: 2, ..Snapshot::default() };
    snapshot.set(0x8010, 2, 5);
    snapshot.set(0x8011, 2, 3);
    snapshot.set(0x8011, 14, 2);
    snapshot.set(0x9000, 9, 0x3B);
    snapshot.set(0x9020, 5, 7);
    let found = findings(&snapshot);
    let has = |words: &str| {
        let mut told =
            found.iter().flat_map(|finding| finding.causes.iter().chain([&finding.what]));
        assert!(told.any(|text| text.contains(words)), "{words}: {found:#?}");
    };
    has("than N = unknown");
    has("dropped 7 frames (unknown old, unknown new, unknown critical), unknown waited at most");
    has("the mask is unknown; ");
    has("PDO errors, number unknown, ");
    has("this channel: unknown, sample point unknown to unknown %");
}

// 5.4.6 and 16.1: OP

#[test]
fn al_status_codes_have_their_causes() {
    for (code, id, cause) in [
        (0x001B, "al-watchdog", "the application stopped"),
        (0x002A, "al-watchdog", "the application stopped"),
        (0x001D, "al-sync-manager", "0x1C12/0x1C13 has another number of chunks"),
        (0x001E, "al-sync-manager", "0x1C12/0x1C13 has another number of chunks"),
        (0x002C, "al-sync", "DC shift is too small"),
        (0x0030, "al-sync", "DC shift is too small"),
        (0x0016, "al-mailbox", "mailbox sync managers"),
        (0x0051, "al-eeprom", "another firmware"),
        (0x0011, "al-error", "does not support"),
    ] {
        let found = only(|snapshot| {
            snapshot.al_state = 0x14;
            snapshot.al_status_code = Some(code);
        });
        assert_eq!((found.id, found.severity), (id, Severity::Fault));
        assert!(found.causes[0].contains(cause), "{found:#?}");
        assert!(found.what.contains(&format!("0x{code:04X}")), "{found:#?}");
        assert!(found.what.contains("SAFEOP"), "{found:#?}");
    }
}

#[test]
fn error_flag_without_code_uses_the_state() {
    let found = only(|snapshot| {
        snapshot.al_state = 2;
        snapshot.has_error_flag = true;
        snapshot.al_status_code = None;
    });
    assert_eq!(found.id, "state-error");
    assert!(found.causes[0].contains("startup SDO was aborted"), "{found:#?}");
    assert!(found.causes[2].contains("0x1100 and 0x1D00"), "{found:#?}");
    assert!(found.next.contains("ecan_sii_sm_layout.sh check"), "{found:#?}");
    let found = only(|snapshot| {
        snapshot.al_state = 4;
        snapshot.has_error_flag = true;
    });
    assert!(found.causes[1].contains("DC shift is too small"), "{found:#?}");
}

#[test]
fn init_safeop_boot_and_invalid_state_are_findings() {
    for (state, id) in
        [(1, "state-init"), (4, "state-safeop"), (3, "state-boot"), (7, "state-unknown")]
    {
        assert_eq!(only(|snapshot| snapshot.al_state = state).id, id);
    }
}

#[test]
fn silent_mailbox_is_a_finding() {
    let found = only(|snapshot| snapshot.silence = Some("Connection timed out".into()));
    assert_eq!(found.id, "mailbox-silent");
    assert!(found.what.ends_with("Connection timed out"));
}

#[test]
fn mismatched_assignment_names_both_values() {
    let found = with(0x1C12, 0, 3);
    assert_eq!((found.id, found.location), ("assignment-differs", Location::RxPdo));
    assert!(found.what.contains("assigns 3 chunks") && found.what.contains("N = 8"), "{found:#?}");
    assert_eq!(with(0x1C13, 0, 9).location, Location::TxPdo);
}

#[test]
fn sync_managers_are_compared_with_the_manual_and_the_profile() {
    let sm2 = [0x00, 0x11, 0x00, 0x04, 0x66, 0, 1, 0];
    let sm3 = [0x00, 0x1D, 0x00, 0x04, 0x22, 0, 1, 0];
    let mut snapshot = healthy();
    snapshot.sync_managers = Some([sm2, sm3]);
    assert_eq!(findings(&snapshot), []);
    snapshot.sync_managers = Some([[0; 8]; 2]);
    assert_eq!(findings(&snapshot), [], "not configured");
    let found = only(|snapshot| {
        snapshot.sync_managers = Some([[0x80, 0x11, 0x00, 0x04, 0x66, 0, 1, 0], sm3]);
    });
    assert_eq!((found.id, found.location), ("sync-manager-layout", Location::RxPdo));
    assert!(
        found.what.contains("start 0x1180 and control byte 0x66 instead of 0x1100"),
        "{found:#?}"
    );
    assert!(found.next.contains("ecan_sii_sm_layout.sh check"), "{found:#?}");
    let found = only(|snapshot| {
        snapshot.sync_managers = Some([sm2, [0x00, 0x1D, 0x80, 0x01, 0x22, 0, 1, 0]]);
    });
    assert_eq!((found.id, found.location), ("sync-manager-length", Location::TxPdo));
    assert!(
        found.what.contains("SM3 has 384 bytes, the active profile (0x8010) 1024"),
        "{found:#?}"
    );
}

#[test]
fn large_images_without_op_blame_the_master() {
    let found = only(|snapshot| {
        snapshot.al_state = 2;
        set_all(snapshot, &[(0x1C13, 0, 12), (0x8010, 9, 1536), (0x8010, 10, 1512)]);
    });
    assert_eq!(found.id, "images-large");
    assert!(found.causes[0].contains("at most 11"));
}

#[test]
fn outputs_shortly_after_sync0_mean_a_small_shift() {
    // 2000 CPU cycles at 400 MHz are 5 us.
    let found = with(0x9011, 4, 2000);
    assert_eq!(found.id, "sync-shift-small");
    assert!(found.what.contains("5.0 to 120.0 us after"), "{found:#?}");
    assert!(found.causes[0].contains("DC shift is too small"));
}

#[test]
fn outputs_shortly_before_sync0_mean_a_small_shift() {
    // At 400 MHz: 900 to 960 us after a pulse.
    let mut snapshot = healthy();
    set_all(&mut snapshot, &[(0x9011, 4, 360_000), (0x9011, 5, 384_000)]);
    assert_eq!(findings(&snapshot), [], "the Sync0 period is not known");
    snapshot.sync0_period_ns = Some(2_000_000);
    assert_eq!(findings(&snapshot), []);
    snapshot.sync0_period_ns = Some(1_000_000);
    let found = findings(&snapshot);
    assert_eq!((found.len(), found[0].id), (1, "sync-shift-small"));
    assert!(found[0].what.contains("40.0 us before a Sync0 pulse"), "{found:#?}");
    assert!(found[0].causes[0].contains("DC shift is too small"));
    assert_eq!(found[0].chapter, "16.1, 15.6.1");
}

#[test]
fn phase_beyond_the_period_means_another_unit() {
    let mut snapshot = healthy();
    // 300 and 960 us in nanoseconds, which are 750 and 2400 us in CPU cycles.
    set_all(&mut snapshot, &[(0x9011, 4, 300_000), (0x9011, 5, 960_000)]);
    snapshot.sync0_period_ns = Some(1_000_000);
    let found = findings(&snapshot);
    assert_eq!((found.len(), found[0].id), (1, "sync-phase-unit"));
    assert!(found[0].causes[1].contains("assumption H25"));
}

// 13.2, 16.2: process data

#[test]
fn each_profile_status_has_its_cause() {
    for (status, id, cause) in [
        (1, "profile-state", "in OP"),
        (2, "profile-multiplier", "N is 8"),
        (3, "profile-mask", "0x0F"),
        (4, "profile-encapsulation", "0, 1, 4 and 5"),
        (5, "profile-mapping-reload", "another number of chunks than N = 8"),
        (9, "profile-pending", "apply command"),
        (10, "profile-option", "0xF000:15"),
        (77, "profile-unknown", "newer"),
    ] {
        let found = with(0x8011, 2, status);
        assert_eq!((found.id, found.location), (id, Location::RxPdo));
        assert!(found.causes[0].contains(cause), "{found:#?}");
    }
}

#[test]
fn each_pdo_error_has_its_cause() {
    for (error, id, cause) in [
        (2, "pdo-frame-overrun", "longer than the profile"),
        (3, "pdo-packet-overrun", "more packets"),
        (4, "pdo-unknown-kind", "wrong byte"),
        (5, "pdo-invalid-dlc", "DLC above 8"),
        (6, "pdo-invalid-channel", "mask 0x8011:04"),
        (7, "pdo-invalid-timestamp", "timestamp format"),
        (8, "pdo-truncated", "payload_len"),
        (9, "pdo-unsupported-profile", "0xF000:12"),
        (10, "pdo-duplicate", "does not increment seq_begin"),
        (11, "pdo-unsupported-option", "0xF000:15"),
        (12, "pdo-active-area", "layout_id in the header"),
        (13, "pdo-reserved-bit", "must be 0"),
        (14, "pdo-bad-header", "all zero"),
        (15, "pdo-bad-crc", "[24, 24 + payload_len)"),
        (16, "pdo-bad-schedule", "Sync0"),
        (99, "pdo-error-unknown", "newer"),
    ] {
        let found = with_all(&[(0x8011, 2, 7), (0x8011, 14, error), (0x8011, 15, 42)]);
        assert_eq!((found.id, found.location), (id, Location::RxPdo));
        assert!(found.causes[0].contains(cause), "{found:#?}");
        assert!(found.what.starts_with("42 PDO errors"), "{found:#?}");
    }
    for (error, id, cause) in [
        (2, "pdo-frame-overrun", "a received CAN FD frame is longer"),
        (3, "pdo-packet-overrun", "a received frame does not fit"),
        (12, "pdo-active-area", "SM3 has another length"),
        (15, "pdo-build-error", "the firmware built a faulty TxPDO"),
    ] {
        let found = with(0x8010, 14, error);
        assert_eq!((found.id, found.location), (id, Location::TxPdo));
        assert!(found.causes[0].contains(cause), "{found:#?}");
        assert!(!found.causes.concat().contains("0x8011"), "{found:#?}");
    }
    let past = with(0x8010, 15, 3);
    assert_eq!((past.id, past.severity), ("pdo-errors-past", Severity::Warning));
}

#[test]
fn overflow_causes_depend_on_direction() {
    let (tx, rx) = (with(0x8010, 16, 5), with(0x8011, 16, 5));
    assert_eq!(
        (tx.id, tx.location, rx.id, rx.location),
        ("pdo-overflow", Location::TxPdo, "pdo-overflow", Location::RxPdo)
    );
    assert!(tx.causes[0].contains("N is too small"));
    assert!(rx.causes[0].contains("host sends more"));
    for (budget, cause) in [(0, "0x8011:06 is 0 (Balanced)"), (2, "0x8011:06 is 2 (Deterministic)")]
    {
        let of_budget = only(|snapshot| {
            let word = snapshot.get(0x8011, 12).unwrap() & !(3 << 19);
            snapshot.set(0x8011, 12, word | budget << 19);
            snapshot.set(0x8011, 14, 3);
            snapshot.set(0x8011, 15, 0);
            snapshot.set(0x8011, 16, 100);
        });
        assert_eq!((of_budget.id, of_budget.location), ("pdo-overflow", Location::RxPdo));
        assert!(of_budget.causes[0].contains(cause), "{of_budget:#?}");
    }
}

#[test]
fn bypasses_and_tests_are_faults() {
    let found = with(0x8010, 12, 0x0000_01E7 | 0x08 << 21);
    assert_eq!((found.id, found.severity), ("app-bypass", Severity::Fault));
    let found = with(0x8030, 3, 0x20);
    assert_eq!(found.id, "diagnostic-test");
    assert!(found.what.contains(":03 = 0x20"));
}

// 5.4.6, 16.3: CAN

#[test]
fn bus_off_names_rates_and_recovery() {
    let found =
        with_all(&[(0x9001, 1, 0xF8), (0x9001, 2, 0x07EF), (0x9001, 9, 0x003B), (0x9001, 15, 1)]);
    assert_eq!((found.id, found.location), ("bus-off", Location::Channel(1)));
    assert!(found.causes[2].contains("500 kbit/s, sample point 80.0 to 80.0 %"), "{found:#?}");
    assert!(found.next.contains("recovery is automatic"), "{found:#?}");
    let manual = with_all(&[(0x9001, 9, 0x003B), (0x8022, 14, 0)]);
    let recovery = "recovery is manual (0x8022:14 = 0): apply the channel again (0x8002:01 = 1)";
    assert!(manual.next.ends_with(recovery), "{manual:#?}");
}

#[test]
fn missing_partner_differs_from_bad_bus() {
    let alone = with_all(&[(0x9000, 1, 128), (0x9000, 2, 0x077B), (0x9000, 9, 0x001A)]);
    assert_eq!((alone.id, &*alone.location.to_string()), ("no-acknowledge", "CAN0"));
    assert!(alone.causes[0].contains("no other active node"));
    // A node that is alone never becomes bus-off.
    let mut snapshot = healthy();
    for (subindex, value) in [(1, 128), (2, 0x077B), (15, 2)] {
        snapshot.set(0x9000, subindex, value);
    }
    let disturbed = &findings(&snapshot)[0];
    assert_eq!(disturbed.id, "no-acknowledge");
    assert!(disturbed.causes[0].contains("bit rate or sample point differs"), "{disturbed:#?}");
    let rotated = with_all(&[(0x8000, 13, 3), (0x9002, 1, 128), (0x9002, 2, 0x077B)]);
    assert_eq!(rotated.id, "no-acknowledge");
    assert_eq!(rotated.causes[1], "the pins are rotated by 3: this channel uses pin group 1");
    let bad = with_all(&[(0x9000, 1, 0x8000 | 17), (0x9000, 2, 0x0769)]);
    assert_eq!(bad.id, "error-passive");
    assert!(bad.what.contains("17 transmit errors, 128 or more receive errors"), "{bad:#?}");
}

#[test]
fn error_warning_shows_the_counters() {
    let found = with_all(&[(0x9002, 1, 97 << 8 | 3), (0x9002, 2, 0x074F)]);
    assert_eq!((found.id, found.severity), ("error-warning", Severity::Warning));
    assert!(found.what.contains("3 transmit errors, 97 receive errors"));
}

#[test]
fn last_error_code_has_its_causes() {
    for (code, word, cause) in [
        (1, "stuff error", "termination"),
        (2, "form error", "configured for classic CAN"),
        (3, "acknowledge error", "no other active node"),
        (4, "bit 1 error", "same CAN ID"),
        (5, "bit 0 error", "same CAN ID"),
        (6, "CRC error", "termination"),
    ] {
        let found = with(0x9003, 2, 0x0708 | code);
        assert_eq!(found.id, "bus-error");
        assert!(found.what.contains(word) && found.causes[0].contains(cause), "{found:#?}");
    }
    for (non_iso, cause) in
        [(0, "in Non-ISO format"), (1, "this channel is in Non-ISO mode (0x8004:09 = 1)")]
    {
        for code in if non_iso == 1 { vec![2, 6] } else { vec![2] } {
            let mut snapshot = healthy();
            for (index, subindex, value) in
                [(0x8004, 15, 1), (0x8004, 9, non_iso), (0x9003, 2, 0x0708 | code)]
            {
                snapshot.set(index, subindex, value);
            }
            let found = findings(&snapshot);
            let found = found.iter().find(|finding| finding.id == "bus-error").unwrap();
            assert!(found.causes[0].contains(cause), "{found:#?}");
        }
    }
}

#[test]
fn data_phase_errors_suggest_sample_point_and_tdc() {
    let found = with(0x9000, 2, 0x060F);
    let cause =
        "the sample points of the data phase differ, or the nominal ones, at which it begins";
    assert_eq!(first(&found), ("data-phase-error", cause));
    assert!(found.causes[1].contains("TDC") && found.causes[2].contains("BRS"), "{found:#?}");
}

/// IR.PED and PEA stay set; ECR counts the errors since its last read.
#[test]
fn latched_error_flags_alone_are_no_finding() {
    for flags in [1 << 27, 1 << 28] {
        let mut snapshot = healthy();
        set_all(&mut snapshot, &[(0x9000, 3, flags), (0x9000, 1, 9 << 16 | 8)]);
        assert_eq!(findings(&snapshot), []);
    }
}

#[test]
fn repeated_errors_are_found_without_an_error_code() {
    let found = |flags: u32| with_all(&[(0x9000, 1, 10 << 16 | 8), (0x9000, 3, flags)]);
    let in_data = found(1 << 28);
    assert_eq!(in_data.id, "data-phase-error");
    let what = "errors in the data phase of CAN FD frames, none in the arbitration phase; 10 errors are logged \
                (ECR)";
    assert_eq!(in_data.what, what);
    assert_eq!(found(1 << 27 | 1 << 28).what, what.replace(", none in the arbitration phase", ""));
    let others = found(1 << 27);
    assert_eq!(
        (others.id, &*others.what),
        ("bus-error", "10 errors are logged (ECR) since its last read")
    );
}

#[test]
fn own_bit_errors_in_the_data_phase_name_the_own_compensation() {
    let found = |enable: u32, rate: u32, offset: u32, filter: u32| {
        only(|snapshot| {
            snapshot.set(0x9001, 2, 0x050F);
            for (subindex, value) in [(16, enable), (20, rate), (33, offset), (34, filter)] {
                snapshot.set(0x8002, subindex, value);
            }
        })
        .causes
    };
    let second = |causes: Vec<String>| causes[1].clone();
    assert!(found(1, 5_000_000, 0, 0)[0].contains("reads its own data bits back wrongly"));
    let off = "transmitter delay compensation (TDC) is off (0x8002:16 = 0)";
    assert_eq!(second(found(0, 2_000_000, 0, 0)), off);
    assert!(!second(found(0, 5_000_000, 0, 0)).contains("TDC"), "the firmware enables it");
    for (offset, filter) in [(9, 0), (0, 9)] {
        assert!(second(found(1, 2_000_000, offset, filter)).contains("are not a pair"));
    }
    assert!(second(found(1, 2_000_000, 9, 10)).contains("does not fit"));
}

#[test]
fn past_bus_off_is_a_warning() {
    let found = with(0x9000, 15, 2);
    assert_eq!((found.id, found.severity), ("bus-off-past", Severity::Warning));
}

#[test]
fn masks_and_disabled_channels_explain_missing_frames() {
    // Without CAN2: mask 0x0B.
    let without = 0x0000_0007 | 0x0B << 5;
    let found = with(0x8011, 12, without);
    assert_eq!((found.id, found.location), ("cannot-send", Location::Channel(2)));
    assert!(found.causes[0].contains("bit 2 is not set in 0x8011:04"), "{found:#?}");
    assert_eq!(with(0x8010, 12, without).id, "cannot-receive");
    let found = with(0x9003, 9, 0);
    assert_eq!(found.id, "channel-off");
    assert!(found.causes[0].contains("not applied"), "{found:#?}");
}

#[test]
fn test_modes_are_findings() {
    for (mode, word) in [(1, "listen mode"), (2, "internal loopback"), (3, "external loopback")] {
        let found = with(0x8001, 8, mode);
        assert_eq!(found.id, "node-mode");
        assert!(found.what.contains(word), "{found:#?}");
    }
}

#[test]
fn each_kind_of_loss_is_a_finding() {
    assert_eq!(with(0x9000, 13, 7).id, "receive-loss");
    let found = with(0x9000, 4, 1 << 25);
    assert_eq!((found.id, found.what.as_str()), ("receive-loss", "RX FIFO0 lost a frame"));
    assert_eq!(with(0x9000, 3, 1 << 7).what, "RX FIFO1 lost a frame");
    assert_eq!(with(0x9000, 14, 9).id, "transmit-pressure");
    assert_eq!(with(0x9000, 6, 1 << 21).what, "the transmit FIFO is full");
    assert_eq!(with(0x9000, 7, 1 << 25).id, "event-loss");
    let found = with(0x9000, 3, 1 << 17);
    assert_eq!(found.id, "message-ram");
    assert!(found.what.contains("Message RAM access failure"));
}

// 13.2.1, 13.2.2, 13.2.5, 13.7

#[test]
fn data_path_losses_are_findings() {
    assert_eq!(with(0x8022, 3, 1).id, "data-path-apply");
    assert_eq!(with(0x8022, 1, 0).id, "data-path-off");
    assert_eq!(with(0x8020, 3, 1).id, "data-path-global");
    assert_eq!(with(0x9021, 15, 4).id, "data-path-degraded");
    let found = only(|snapshot| {
        for (subindex, value) in [(2, 16), (5, 30), (6, 28), (7, 2), (8, 0)] {
            snapshot.set(0x9020, subindex, value);
        }
    });
    assert_eq!(found.id, "rx-cache-drop");
    assert!(found.what.contains("dropped 30 frames (28 old, 2 new, 0 critical), 16 waited"));
    let found = with(0x9023, 12, 4);
    assert_eq!((found.id, found.location), ("tx-fifo-full", Location::Channel(3)));
}

#[test]
fn each_diagnostic_flag_is_explained() {
    for (bit, id, name) in [
        (0, "flag-tx-pdo", "SHADOW_FALLBACK"),
        (1, "flag-tx-pdo", "SHADOW_COPY_RETRY"),
        (2, "flag-tx-pdo", "SHADOW_SIZE_CHANGE"),
        (3, "flag-rx-pdo", "RXPDO_STAGE_DROP"),
        (4, "flag-transmit", "TX_RING_DROP"),
        (5, "flag-transmit", "TX_FIFO_FULL"),
        (6, "flag-schedule-late", "SCHED_LATE_DROP"),
        (7, "flag-schedule-full", "SCHED_QUEUE_FULL"),
        (8, "flag-schedule-full", "SCHED_TX_FAIL"),
        (9, "flag-schedule-late", "SCHED_TIMER_MISS"),
        (12, "flag-unknown", "0x1000"),
    ] {
        let found = with(0xB000, 6, 1 << bit);
        assert_eq!(found.id, id);
        assert!(found.what.contains(name), "{found:#?}");
    }
}

#[test]
fn device_states_are_findings() {
    for (status, words, cause) in [
        (1, "busy", "two programs"),
        (2, "denied", "needs engineering or factory mode"),
        (3, "CRC error", "no configuration saved"),
        (4, "image invalid", "no configuration saved"),
        (5, "Flash error", "worn out"),
        (9, "not in the manual", "worn out"),
    ] {
        let found = with(0xB000, 5, status);
        assert_eq!(found.id, "maintenance-status");
        let words = format!("ended with status {status} ({words}");
        assert!(found.what.contains(&words) && found.causes[0].contains(cause), "{found:#?}");
    }
    assert!(with(0xB000, 2, 2).what.contains("factory mode"));
    assert_eq!(with(0x8000, 15, 1).id, "pin-rotation");
    assert_eq!(with(0x8000, 11, 1).id, "system-apply");
}

#[test]
fn faults_come_before_warnings() {
    let mut snapshot = healthy();
    set_all(&mut snapshot, &[(0x8010, 16, 1), (0x8004, 2, 1)]);
    let ids: Vec<_> = findings(&snapshot).iter().map(|finding| finding.id).collect();
    assert_eq!(ids, ["apply-failed", "pdo-overflow"]);
}
