//! Alternatives for objects, profile and states, as the gateway shows them.

use ecan_protocol::config::{DataPathConfig, DataPathGlobal, ProfileStatus, assignment_writes};
use ecan_protocol::device::AlState;
use ecan_protocol::image::{CommitFields, PdoProfile};
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::AbortCode;
use ecan_sim::variant::{
    ApplyAtSafeOp, AssignedAtStart, AssignmentRewritten, CompatBits, EmptyMask, FilterIndex,
    GatewayVariant, InvertedBudget, LayoutCrc, MaintenanceMode, MaintenanceNumbers, MappedSubindex,
    MissingAbort, MissingEntries, PdoErrorNumbers, ProfileErrors, RejectedBudget, SafeOpInputs,
    SafeOpOutputs, SequenceReadback, TxPdoNumbering,
};

use super::fixture::{Fixture, MS, chunks, configured, preop};

#[test]
fn missing_entries_abort_every_access() {
    for (missing_abort, code) in [
        (MissingAbort::NoSubindex, AbortCode::NO_SUBINDEX),
        (MissingAbort::NoObject, AbortCode::NO_OBJECT),
    ] {
        let missing_entries = MissingEntries::parse(["0xF000:19..30", "0x8030:2", "0x8021"]);
        let missing_entries = missing_entries.unwrap();
        let mut fixture =
            preop(GatewayVariant { missing_entries, missing_abort, ..Default::default() });
        for (index, subindex) in [(0xF000, 19), (0xF000, 30), (0x8030, 2), (0x8021, 0), (0x8024, 4)]
        {
            assert_eq!(fixture.try_upload(index, subindex), Err(code), "{index:04X}:{subindex}");
        }
        assert_eq!(fixture.download(0x8030, 2, &[0; 4]), Err(code));
        assert_eq!(fixture.download(0x8022, 4, &[1]), Err(code));
        for (index, subindex) in [(0xF000, 18), (0xF000, 31), (0x8030, 3), (0x8020, 1)] {
            assert!(fixture.try_upload(index, subindex).is_ok(), "{index:04X}:{subindex}");
        }
    }
}

#[test]
fn mapped_subindex_is_that_of_the_variant() {
    for (mapped_subindex, number) in [(MappedSubindex::One, 1), (MappedSubindex::Zero, 0)] {
        let mut fixture = preop(GatewayVariant { mapped_subindex, ..Default::default() });
        assert_eq!(fixture.upload(0x1600, 1), 0x7000_0080 | u32::from(number) << 8);
        assert_eq!(fixture.upload(0x1A01, 8), 0x60F0_0080 | u32::from(number) << 8);
        assert_eq!(fixture.try_upload(0x7000, number).unwrap().len(), 16);
        assert_eq!(fixture.try_upload(0x7000, number + 1), Err(AbortCode::NO_SUBINDEX));
        assert_eq!(fixture.download(0x7000, number, &[7; 16]), Ok(()));
    }
}

#[test]
fn layout_crc_depends_on_the_algorithm() {
    let of = |layout_crc| {
        let mut fixture = configured(GatewayVariant { layout_crc, ..Default::default() });
        [0x8010, 0x8011].map(|index| fixture.upload(index, 11))
    };
    let object = of(LayoutCrc::Object);
    assert_ne!(object[0], object[1], "the object is covered");
    let word = of(LayoutCrc::ProfileWord);
    assert_eq!(word[0], word[1]);
    assert_ne!(word[0], object[0]);
    assert_eq!(of(LayoutCrc::Zero), [0, 0]);
}

#[test]
fn profile_errors_show_in_the_status_or_in_counters_only() {
    for (profile_errors, status) in [
        (ProfileErrors::InStatus, ProfileStatus::EncapsulationError),
        (ProfileErrors::CountersOnly, ProfileStatus::Ok),
    ] {
        let mut fixture = configured(GatewayVariant { profile_errors, ..Default::default() });
        fixture.start();
        assert!(fixture.write_again(), "an image of zeros");
        assert_eq!(fixture.upload(0x8011, 2), u32::from(status.raw()), "{profile_errors:?}");
        assert_eq!(fixture.upload(0x8011, 15), 1, "{profile_errors:?}");
    }
}

/// As IgH does after the startup SDOs.
fn rewrite_assignment(fixture: &mut Fixture) {
    for direction in Direction::ALL {
        fixture.send(assignment_writes(direction, 1));
    }
}

fn rewritten(assignment_rewritten: AssignmentRewritten) -> Fixture {
    let mut fixture = configured(GatewayVariant { assignment_rewritten, ..Default::default() });
    rewrite_assignment(&mut fixture);
    fixture
}

fn statuses(fixture: &mut Fixture) -> [u32; 2] {
    [0x8010, 0x8011].map(|index| fixture.upload(index, 2))
}

#[test]
fn profile_stays_valid_after_a_rewritten_assignment() {
    let mut fixture = rewritten(AssignmentRewritten::StaysValid);
    assert_eq!(statuses(&mut fixture), [0, 0]);
    fixture.start();
    assert_eq!(statuses(&mut fixture), [0, 0]);
}

#[test]
fn rewritten_assignment_shows_status_5_until_the_next_apply() {
    let mut fixture = rewritten(AssignmentRewritten::ReloadRequired);
    assert_eq!(statuses(&mut fixture), [5, 5]);
    fixture.start();
    assert_eq!(statuses(&mut fixture), [5, 5]);
    fixture.send(Direction::ALL.map(PdoProfile::apply_write));
    assert_eq!(statuses(&mut fixture), [0, 0]);
    fixture.cycle();
}

#[test]
fn rewritten_assignment_drops_the_profile_at_safeop() {
    let mut fixture = rewritten(AssignmentRewritten::DroppedAtSafeOp);
    assert_eq!(statuses(&mut fixture), [0, 0], "valid in PREOP");
    assert_eq!(fixture.request(AlState::SafeOp), (AlState::SafeOp, 0));
    assert_eq!(statuses(&mut fixture), [5, 5]);
    assert_eq!(fixture.upload(0x8010, 9), 0, "no active size");
    fixture.pass(2 * MS);
    assert!(!fixture.read(), "no image");
    assert_eq!(fixture.request(AlState::Op), (AlState::SafeOp, 0x1D));
    fixture.send(Direction::ALL.map(PdoProfile::apply_write));
    assert_eq!(statuses(&mut fixture), [0, 0]);
    assert_eq!(fixture.request(AlState::Op), (AlState::Op, 0));
}

#[test]
fn requested_profile_is_applied_at_safeop_or_rejected() {
    for (apply_at_safeop, expected) in [
        (ApplyAtSafeOp::Applied, (AlState::SafeOp, 0)),
        (ApplyAtSafeOp::Required, (AlState::PreOp, 0x1D)),
    ] {
        let mut fixture = preop(GatewayVariant { apply_at_safeop, ..Default::default() });
        rewrite_assignment(&mut fixture);
        for direction in Direction::ALL {
            fixture.send(chunks(1).writes(direction));
            fixture.set_up_sync_manager(direction, 128);
        }
        assert_eq!(fixture.request(AlState::SafeOp), expected, "{apply_at_safeop:?}");
    }
}

#[test]
fn sequence_of_the_last_image_is_reported_or_zero() {
    for (sequence_readback, expected) in [(SequenceReadback::Last, 2), (SequenceReadback::Zero, 0)]
    {
        let mut fixture = configured(GatewayVariant { sequence_readback, ..Default::default() });
        fixture.start();
        fixture.cycle();
        fixture.cycle();
        assert_eq!(fixture.upload(0x8011, 13), expected, "{sequence_readback:?}");
        assert_ne!(fixture.upload(0x8010, 13), 0, "{sequence_readback:?}");
    }
}

#[test]
fn numbering_after_a_session_reset_begins_again_or_continues() {
    for (txpdo_numbering, expected) in
        [(TxPdoNumbering::FromOne, 1), (TxPdoNumbering::Continued, 5)]
    {
        let mut fixture = configured(GatewayVariant { txpdo_numbering, ..Default::default() });
        fixture.start();
        for _ in 0..3 {
            fixture.cycle();
        }
        assert_eq!(fixture.input().sequence(), 4, "{txpdo_numbering:?}");
        fixture.write_u8(0x8010, 8, 1);
        fixture.cycle();
        assert_eq!(fixture.input().sequence(), expected, "{txpdo_numbering:?}");
    }
}

#[test]
fn safeop_inputs_are_published_or_absent() {
    for (safeop_inputs, expected) in
        [(SafeOpInputs::Published, true), (SafeOpInputs::Absent, false)]
    {
        let mut fixture = configured(GatewayVariant { safeop_inputs, ..Default::default() });
        fixture.request(AlState::SafeOp);
        fixture.pass(2 * MS);
        assert_eq!(fixture.read(), expected, "{safeop_inputs:?}");
        fixture.request(AlState::Op);
        assert!(fixture.write());
        assert!(fixture.read(), "{safeop_inputs:?} in OP");
    }
}

#[test]
fn safeop_outputs_are_discarded_or_kept() {
    for (safeop_outputs, expected) in
        [(SafeOpOutputs::Discarded, true), (SafeOpOutputs::Kept, false)]
    {
        let mut fixture = configured(GatewayVariant { safeop_outputs, ..Default::default() });
        fixture.request(AlState::SafeOp);
        assert!(fixture.write());
        assert_eq!(fixture.write(), expected, "{safeop_outputs:?}");
        fixture.request(AlState::Op);
        assert!(fixture.write(), "{safeop_outputs:?} in OP");
        assert_eq!(fixture.gateway.counters().images_parsed, 1, "none of SAFEOP");
    }
}

#[test]
fn assignment_after_power_on_is_complete_or_empty() {
    for (assigned_at_start, count) in [(AssignedAtStart::All, 24), (AssignedAtStart::Nothing, 0)] {
        let mut fixture = preop(GatewayVariant { assigned_at_start, ..Default::default() });
        assert_eq!(fixture.upload(0x1C12, 0), count, "{assigned_at_start:?}");
        assert_eq!(fixture.upload(0x1C13, 0), count, "{assigned_at_start:?}");
    }
}

#[test]
fn undefined_budget_policy_has_the_status_of_the_variant() {
    for (rejected_budget, expected) in
        [(RejectedBudget::UnsupportedOption, 10), (RejectedBudget::InvalidProfile, 4)]
    {
        let mut fixture = preop(GatewayVariant { rejected_budget, ..Default::default() });
        fixture.write_u8(0x8010, 6, 3);
        fixture.send([PdoProfile::apply_write(Direction::TxPdo)]);
        assert_eq!(fixture.upload(0x8010, 2), expected, "{rejected_budget:?}");
    }
}

#[test]
fn settings_that_the_manual_leaves_open_are_accepted_or_rejected() {
    let strict = GatewayVariant { compat_bits: CompatBits::Rejected, ..GatewayVariant::default() };
    let lenient = GatewayVariant {
        empty_mask: EmptyMask::Accepted,
        inverted_budget: InvertedBudget::Accepted,
        ..GatewayVariant::default()
    };
    for (variant, expected) in
        [(GatewayVariant::default(), [3, 1, 0]), (lenient, [0, 0, 0]), (strict, [3, 1, 1])]
    {
        let mut fixture = preop(variant);
        fixture.send(assignment_writes(Direction::TxPdo, 8));
        fixture.write_u8(0x8010, 4, 0);
        fixture.send([PdoProfile::apply_write(Direction::TxPdo)]);
        fixture.write_u8(0x8021, 4, 8);
        fixture.send([DataPathConfig::apply_write(0)]);
        assert_eq!(fixture.download(0x8020, 4, &7_u16.to_le_bytes()), Ok(()));
        fixture.send([DataPathGlobal::apply_write()]);
        let statuses = [(0x8010, 2), (0x8021, 3), (0x8020, 3)];
        let statuses = statuses.map(|(index, subindex)| fixture.upload(index, subindex));
        assert_eq!(statuses, expected);
    }
}

#[test]
fn image_of_another_layout_has_the_error_of_the_variant() {
    for (pdo_errors, expected) in
        [(PdoErrorNumbers::Assumed, 12), (PdoErrorNumbers::HeaderAndTruncated, 14)]
    {
        let mut fixture = configured(GatewayVariant { pdo_errors, ..Default::default() });
        fixture.start();
        fixture.writer.commit(&mut fixture.image, CommitFields::default());
        fixture.image[10] ^= 0xFF;
        assert!(fixture.write_again());
        assert_eq!(fixture.upload(0x8011, 14), expected, "{pdo_errors:?}");
    }
}

const RUN: u8 = 0;
const ENGINEERING: u8 = 1;
const FACTORY: u8 = 2;
const DENIED: u32 = 2;

/// Status of the command to validate the firmware image, of which there is none.
fn validate(variant: GatewayVariant, mode: u8) -> u32 {
    const VALIDATE: u8 = 0x08;
    let mut fixture = preop(variant);
    fixture.write_u8(0xB000, 1, mode);
    fixture.write_u8(0xB000, 4, VALIDATE);
    fixture.pass(100 * MS);
    fixture.upload(0xB000, 5)
}

#[test]
fn maintenance_needs_the_mode_of_the_variant() {
    use MaintenanceMode::{ByCommand, Factory, Run};
    for (maintenance_mode, is_denied) in [
        (ByCommand, [true, false, false]),
        (Factory, [true, true, false]),
        (Run, [false, false, false]),
    ] {
        let denied = [RUN, ENGINEERING, FACTORY].map(|mode| {
            let variant = GatewayVariant { maintenance_mode, ..GatewayVariant::default() };
            validate(variant, mode) == DENIED
        });
        assert_eq!(denied, is_denied, "{maintenance_mode:?}");
    }
}

#[test]
fn maintenance_status_has_the_numbers_of_the_variant() {
    for (maintenance_status, expected) in
        [(MaintenanceNumbers::ManualOrder, 4), (MaintenanceNumbers::Swapped, 3)]
    {
        let variant = GatewayVariant { maintenance_status, ..GatewayVariant::default() };
        assert_eq!(validate(variant, ENGINEERING), expected, "{maintenance_status:?}");
    }
}

#[test]
fn filter_index_is_lost_or_kept_by_a_restart() {
    for (filter_index, expected) in [(FilterIndex::Lost, 0), (FilterIndex::Kept, 5)] {
        let mut fixture = preop(GatewayVariant { filter_index, ..Default::default() });
        fixture.write_u8(0x8001, 43, 5);
        fixture.write_u8(0x8000, 1, 1);
        fixture.pass(1_000 * MS);
        fixture.enter_preop();
        assert_eq!(fixture.upload(0x8001, 43), expected, "{filter_index:?}");
    }
}
