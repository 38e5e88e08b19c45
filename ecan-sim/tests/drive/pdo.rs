//! PDOs: mapping rules, SYNC, events, inhibit and event timers.

use super::fixture::{Fixture, MS, NODE};
use ecan_canopen::{Command, NmtCommand};
use ecan_sim::DriveQuirks;

const UNSUPPORTED: u32 = 0x0601_0000;
const LOCKED: u32 = 0x0601_0003;
const NO_OBJECT: u32 = 0x0602_0000;
const NOT_MAPPABLE: u32 = 0x0604_0041;
const PDO_LENGTH: u32 = 0x0604_0042;
const RANGE: u32 = 0x0609_0030;
const STATE: u32 = 0x0800_0022;

#[test]
fn mapping_changes_only_while_pdo_is_invalid_and_empty() {
    let mut fixture = Fixture::booted();
    // RPDO 1 is valid with one entry
    assert_eq!(fixture.write(0x1600, 0, 0, 1), Err(UNSUPPORTED));
    assert_eq!(fixture.write(0x1600, 1, 0x607A_0020, 4), Err(UNSUPPORTED));
    fixture.write(0x1400, 1, 0xC000_0205, 4).unwrap();
    assert_eq!(fixture.write(0x1600, 1, 0x607A_0020, 4), Err(LOCKED));
    fixture.write(0x1600, 0, 0, 1).unwrap();
    fixture.write(0x1600, 1, 0x607A_0020, 4).unwrap();
    fixture.write(0x1600, 0, 1, 1).unwrap();
    fixture.write(0x1400, 1, 0x4000_0205, 4).unwrap();
    assert_eq!(fixture.read(0x1600, 1), Ok(0x607A_0020));
}

#[test]
fn unmappable_object_is_aborted() {
    let mut fixture = Fixture::booted();
    fixture.write(0x1400, 1, 0xC000_0205, 4).unwrap();
    fixture.write(0x1800, 1, 0xC000_0185, 4).unwrap();
    fixture.write(0x1600, 0, 0, 1).unwrap();
    fixture.write(0x1A00, 0, 0, 1).unwrap();
    let rejected = [
        // no such object, object not mappable
        (0x1600, 0x1234_0010, NO_OBJECT),
        (0x1600, 0x6081_0020, NOT_MAPPABLE),
        (0x1600, 0x1018_0120, NOT_MAPPABLE),
        // the statusword cannot be received, the controlword cannot be sent
        (0x1600, 0x6041_0010, NOT_MAPPABLE),
        (0x1A00, 0x6040_0010, NOT_MAPPABLE),
        // the target position has 32 bits
        (0x1600, 0x607A_0010, NOT_MAPPABLE),
    ];
    for (index, entry, code) in rejected {
        assert_eq!(fixture.write(index, 1, entry, 4), Err(code), "{entry:08X}");
    }
    // 4 + 4 + 2 bytes are more than 8
    for (sub, entry) in [(1, 0x607A_0020), (2, 0x60FF_0020), (3, 0x6040_0010)] {
        fixture.write(0x1600, sub, entry, 4).unwrap();
    }
    assert_eq!(fixture.write(0x1600, 0, 3, 1), Err(PDO_LENGTH));
    fixture.write(0x1600, 0, 2, 1).unwrap();
    // an empty entry is not a valid one
    fixture.write(0x1A00, 1, 0x6041_0010, 4).unwrap();
    assert_eq!(fixture.write(0x1A00, 0, 2, 1), Err(NO_OBJECT));
    assert_eq!(fixture.write(0x1A00, 0, 9, 1), Err(0x0609_0031));
}

#[test]
fn communication_parameter_rules_apply() {
    let mut fixture = Fixture::booted();
    // another COB-ID while valid, a COB-ID of another service, one with too many bits
    assert_eq!(fixture.write(0x1800, 1, 0x4000_0186, 4), Err(UNSUPPORTED));
    fixture.write(0x1800, 1, 0xC000_0185, 4).unwrap();
    assert_eq!(fixture.write(0x1800, 1, 0x4000_0581, 4), Err(RANGE));
    assert_eq!(fixture.write(0x1800, 1, 0x4000_1185, 4), Err(RANGE));
    // reserved types and those triggered by remote frames
    for kind in [241, 251, 252, 253] {
        assert_eq!(fixture.write(0x1800, 2, kind, 1), Err(RANGE));
    }
    fixture.writes(&[(0x1800, 3, 50, 2), (0x1800, 1, 0x4000_0285, 4)]);
    assert_eq!(fixture.write(0x1800, 3, 60, 2), Err(UNSUPPORTED));
    fixture.nmt(NmtCommand::Start);
    assert_eq!(fixture.write(0x1800, 1, 0xC000_0285, 4), Err(STATE));
    assert_eq!(fixture.write(0x1601, 0, 0, 1), Err(STATE));
}

#[test]
fn mapping_quirks_apply() {
    let quirks = DriveQuirks { fixed_mapping: true, ..DriveQuirks::default() };
    let mut fixture = Fixture::with_quirks(quirks);
    fixture.write(0x1400, 1, 0xC000_0205, 4).unwrap();
    assert_eq!(fixture.write(0x1600, 0, 0, 1), Err(0x0601_0002));
    let quirks = DriveQuirks { rejects_mapping_while_valid: false, ..DriveQuirks::default() };
    Fixture::with_quirks(quirks).write(0x1600, 0, 0, 1).unwrap();
}

#[test]
fn synchronous_pdos_act_at_sync() {
    let mut fixture = Fixture::booted();
    fixture.map_csp();
    fixture.nmt(NmtCommand::Start);
    fixture.lines();
    // no effect before SYNC
    assert_eq!(fixture.frame(0x200 + NODE, &[6, 0, 0xE8, 3, 0, 0]), []);
    assert_eq!(fixture.drive.object(0x6040, 0), Some(0));
    // the response to SYNC has the state before the command: switch on disabled, at 1000
    assert_eq!(fixture.frame(0x80, &[]), [(0x185, vec![0x40, 0x02, 0xE8, 3, 0, 0])]);
    assert_eq!(fixture.drive.object(0x6040, 0), Some(6));
    // ready to switch on
    assert_eq!(fixture.frame(0x80, &[]), [(0x185, vec![0x21, 0x02, 0xE8, 3, 0, 0])]);
    assert_eq!((fixture.drive.syncs(), fixture.drive.received_pdos()), (2, 1));
}

#[test]
fn every_nth_sync_and_start_value_apply() {
    let mut fixture = Fixture::booted();
    fixture.map_csp();
    fixture.write(0x1800, 1, 0xC000_0185, 4).unwrap();
    fixture.write(0x1800, 2, 3, 1).unwrap();
    fixture.write(0x1800, 6, 2, 1).unwrap();
    fixture.write(0x1800, 1, 0x4000_0185, 4).unwrap();
    fixture.write(0x1019, 0, 240, 1).unwrap();
    fixture.nmt(NmtCommand::Start);
    let counts: Vec<_> = (1..=10).map(|counter| fixture.frame(0x80, &[counter]).len()).collect();
    // the second SYNC is the first that counts, then every third
    assert_eq!(counts, [0, 1, 0, 0, 1, 0, 0, 1, 0, 0]);
}

#[test]
fn start_value_without_counter_is_ignored() {
    let mut fixture = Fixture::booted();
    fixture.map_csp();
    fixture.writes(&[(0x1800, 1, 0xC000_0185, 4), (0x1800, 6, 2, 1), (0x1800, 1, 0x4000_0185, 4)]);
    fixture.nmt(NmtCommand::Start);
    assert_eq!(fixture.frame(0x80, &[]).len(), 1);
}

#[test]
fn sync_counter_is_expected_by_0x1019() {
    let mut fixture = Fixture::booted();
    let length_error = [(0x085, vec![0x40, 0x82, 0x11, 0, 0, 0, 0, 0])];
    for data in [&[1][..], &[1, 2]] {
        assert_eq!(fixture.frame(0x80, data), length_error, "0x1019 is 0: {data:?}");
    }
    assert_eq!(fixture.write(0x1019, 0, 1, 1), Err(RANGE));
    assert_eq!(fixture.write(0x1019, 0, 241, 1), Err(0x0609_0031));
    fixture.write(0x1019, 0, 240, 1).unwrap();
    assert_eq!(fixture.frame(0x80, &[]), length_error, "no counter");
    assert_eq!(fixture.frame(0x80, &[240]), []);
    assert_eq!(fixture.drive.syncs(), 1);
    fixture.write(0x1006, 0, 2_000, 4).unwrap();
    assert_eq!(fixture.write(0x1019, 0, 0, 1), Err(STATE));
}

#[test]
fn event_driven_pdos_respect_inhibit_time() {
    let mut fixture = Fixture::booted();
    fixture.writes(&[(0x1800, 1, 0xC000_0185, 4), (0x1800, 3, 50, 2), (0x1800, 1, 0x4000_0185, 4)]);
    assert_eq!(fixture.nmt(NmtCommand::Start), [(0x185, vec![0x40, 0x02])]);
    let start = fixture.now;
    // both changes are within the inhibit time of 5 ms: the last state is sent after it
    fixture.pass_ms(1);
    fixture.command(Command::Shutdown);
    fixture.command(Command::SwitchOn);
    fixture.lines();
    fixture.pass_ms(20);
    assert_eq!(fixture.sent, [(start + 5 * MS, (0x185, vec![0x33, 0x02]))]);
    // no change, no PDO
    fixture.lines();
    fixture.pass_ms(1000);
    assert!(fixture.sent.is_empty());
}

#[test]
fn event_timer_sends_without_event() {
    let mut fixture = Fixture::booted();
    fixture.write(0x1800, 5, 20, 2).unwrap();
    fixture.nmt(NmtCommand::Start);
    fixture.lines();
    let start = fixture.now;
    fixture.pass_ms(65);
    let times: Vec<_> = fixture.sent.iter().map(|(at, _)| (at - start) / MS).collect();
    assert_eq!(times, [20, 40, 60]);
}

#[test]
fn pdo_of_wrong_length_is_error() {
    let mut fixture = Fixture::booted();
    fixture.nmt(NmtCommand::Start);
    fixture.lines();
    // one byte is too few for the controlword
    let lines = fixture.frame(0x205, &[6]);
    assert_eq!(lines, [(0x085, vec![0x10, 0x82, 0x11, 0, 0, 0, 0, 0])]);
    assert_eq!(fixture.drive.object(0x6040, 0), Some(0));
    // eight are too many, but the mapped part is used
    let lines = fixture.frame(0x205, &[6, 0, 1, 2, 3, 4, 5, 6]);
    assert!(lines.contains(&(0x085, vec![0x20, 0x82, 0x11, 0, 0, 0, 0, 0])));
    assert_eq!(fixture.drive.object(0x6040, 0), Some(6));
}

#[test]
fn pdos_are_ignored_outside_operational() {
    let mut fixture = Fixture::booted();
    fixture.frame(0x205, &[6, 0]);
    assert_eq!((fixture.drive.object(0x6040, 0), fixture.drive.received_pdos()), (Some(0), 0));
    // data that wait for SYNC are discarded when Operational is left
    fixture.map_csp();
    fixture.nmt(NmtCommand::Start);
    fixture.frame(0x205, &[6, 0, 0, 0, 0, 0]);
    fixture.nmt(NmtCommand::EnterPreOperational);
    fixture.nmt(NmtCommand::Start);
    fixture.frame(0x80, &[]);
    assert_eq!(fixture.drive.object(0x6040, 0), Some(0));
}

#[test]
fn dummy_entries_in_received_pdo_are_skipped() {
    let mut fixture = Fixture::booted();
    fixture.writes(&[(0x1400, 1, 0xC000_0205, 4), (0x1600, 0, 0, 1)]);
    for (sub, entry) in [(1, 0x0005_0008), (2, 0x6040_0010)] {
        fixture.write(0x1600, sub, entry, 4).unwrap();
    }
    fixture.writes(&[(0x1600, 0, 2, 1), (0x1400, 1, 0x4000_0205, 4)]);
    fixture.nmt(NmtCommand::Start);
    fixture.frame(0x205, &[0xFF, 6, 0]);
    assert_eq!(fixture.drive.object(0x6040, 0), Some(6));
}

#[test]
fn missing_pdo_is_detected() {
    let mut fixture = Fixture::booted();
    fixture.writes(&[(0x1400, 5, 30, 2), (0x6007, 0, 0, 2)]);
    fixture.nmt(NmtCommand::Start);
    fixture.pass_ms(100);
    fixture.frame(0x205, &[0, 0]);
    fixture.lines();
    let start = fixture.now;
    fixture.pass_ms(100);
    let emcy = (start + 30 * MS, (0x085, vec![0x50, 0x82, 0x11, 0, 0, 0, 0, 0]));
    assert!(fixture.sent.contains(&emcy), "{:?}", fixture.sent);
}

/// Changes PDO 1 to an MPDO: disables it, sets the number of mapped objects, enables it.
fn multiplex(fixture: &mut Fixture, communication: u16, mapping: u16, mode: i64) {
    let id = i64::from(fixture.read(communication, 1).unwrap());
    fixture.write(communication, 1, id | 0x8000_0000, 4).unwrap();
    fixture.write(mapping, 0, mode, 1).unwrap();
    fixture.write(communication, 1, id, 4).unwrap();
}

#[test]
fn mpdo_in_destination_mode_writes_the_named_object() {
    let mut fixture = Fixture::booted();
    multiplex(&mut fixture, 0x1400, 0x1600, 0xFF);
    fixture.nmt(NmtCommand::Start);
    fixture.lines();
    let profile_velocity = |node: u8, value: u8| [node, 0x81, 0x60, 0, value, 1, 0, 0];
    assert_eq!(fixture.frame(0x205, &profile_velocity(0x85, 2)), []);
    assert_eq!(fixture.drive.object(0x6081, 0), Some(0x102));
    assert_eq!(fixture.frame(0x205, &profile_velocity(0x80, 3)), [], "to all nodes");
    assert_eq!(fixture.drive.object(0x6081, 0), Some(0x103));
    // Another node, source address mode
    fixture.frame(0x205, &profile_velocity(0x86, 4));
    fixture.frame(0x205, &profile_velocity(0x05, 4));
    assert_eq!(fixture.drive.object(0x6081, 0), Some(0x103));
    // No such object, a constant, wrong length
    for [low, high] in [[0xFF, 0x2F], [0x00, 0x10]] {
        let lines = fixture.frame(0x205, &[0x85, low, high, 0, 1, 0, 0, 0]);
        assert_eq!(lines, [(0x085, vec![0x30, 0x82, 0x11, 0, 0, 0, 0, 0])]);
    }
    let lines = fixture.frame(0x205, &[0x85, 0x81, 0x60]);
    assert_eq!(lines, [(0x085, vec![0x10, 0x82, 0x11, 0, 0, 0, 0, 0])]);
}

#[test]
fn mpdo_in_source_mode_sends_changed_objects_of_the_scanner_list() {
    let mut fixture = Fixture::booted();
    // Actual position, then both entries of 0x608F
    fixture.writes(&[(0x1FA0, 1, 0x0160_6400, 4), (0x1FA0, 2, 0x0260_8F01, 4)]);
    multiplex(&mut fixture, 0x1800, 0x1A00, 0xFE);
    let position = (0x185, vec![0x05, 0x64, 0x60, 0, 0xE8, 3, 0, 0]);
    let entries = [
        (0x185, vec![0x05, 0x8F, 0x60, 1, 0, 0, 1, 0]),
        (0x185, vec![0x05, 0x8F, 0x60, 2, 1, 0, 0, 0]),
    ];
    let [first, second] = entries;
    assert_eq!(fixture.nmt(NmtCommand::Start), [position, first, second]);
    fixture.lines();
    fixture.pass_ms(100);
    assert!(fixture.sent.is_empty(), "no change, no MPDO");
    // Entering Operational sends all of them; the inhibit time of 5 ms lies between them.
    fixture.nmt(NmtCommand::EnterPreOperational);
    fixture.writes(&[(0x1800, 1, 0xC000_0185, 4), (0x1800, 3, 50, 2), (0x1800, 1, 0x4000_0185, 4)]);
    let start = fixture.now;
    assert_eq!(fixture.nmt(NmtCommand::Start).len(), 1);
    fixture.lines();
    fixture.pass_ms(100);
    let times: Vec<_> = fixture.sent.iter().map(|(at, _)| (at - start) / MS).collect();
    assert_eq!(times, [5, 10]);
}

#[test]
fn mpdo_of_the_other_mode_is_aborted() {
    let mut fixture = Fixture::booted();
    fixture.writes(&[(0x1400, 1, 0xC000_0205, 4), (0x1800, 1, 0xC000_0185, 4)]);
    assert_eq!(fixture.write(0x1600, 0, 0xFE, 1), Err(0x0609_0031));
    assert_eq!(fixture.write(0x1A00, 0, 0xFF, 1), Err(0x0609_0031));
    assert_eq!(fixture.write(0x1A00, 0, 9, 1), Err(0x0609_0031));
}
