//! Registers of the distributed clock and Sync0.

use crate::wire_support::{Line, MS, command::*};

#[test]
fn local_time_begins_with_the_supply() {
    let mut line = Line::addressed(1);
    let time = line.read_u64(0x1001, 0x0910);
    assert!((1_000 * MS..1_001 * MS).contains(&time), "{time}");
}

#[test]
fn offset_sets_system_time_and_a_written_time_pulls_it() {
    let mut line = Line::addressed(1);
    let before = line.read_u64(0x1001, 0x0910);
    line.write(FPWR, 0x1001, 0x0920, &5_000_000_000_u64.to_le_bytes());
    let after = line.read_u64(0x1001, 0x0910);
    assert!((5_000_000_000..5_001_000_000).contains(&(after - before)), "{before} {after}");
    // the latch is in local time
    assert_eq!(line.write(BWR, 0, 0x0900, &[0; 4]), 1);
    let latched = line.read_u64(0x1001, 0x0918);
    assert!(latched - before < MS, "{latched} {before}");
    // The lower half is enough.
    let ahead = (line.read_u64(0x1001, 0x0910) + 10_000 + 4_000) as u32;
    line.write(FPWR, 0x1001, 0x0910, &ahead.to_le_bytes());
    let difference = line.read(FPRD, 0x1001, 0x092C, 4).0;
    assert_eq!(u32::from_le_bytes(difference.try_into().unwrap()), 4_000 | 1 << 31, "behind");
}

#[test]
fn past_start_time_gives_no_pulse() {
    let mut line = Line::op();
    line.request(0x1001, 4);
    line.start_sync0(1, 1_000_000);
    line.request(0x1001, 8);
    line.pass(2_100 * MS);
    assert_eq!(line.state(0x1001), (0x14, 0x2D), "no Sync0");
    // skipped by a later offset
    let start = line.read_u64(0x1001, 0x0910) + 100 * MS;
    line.start_sync0(start, 1_000_000);
    line.write(FPWR, 0x1001, 0x0920, &1_000_000_000_000_u64.to_le_bytes());
    line.pass(10 * MS);
    assert_eq!(line.upload(0x1001, (0x9011, 2)), 0);
}

#[test]
fn start_register_reads_the_next_pulse() {
    let mut line = Line::preop(1);
    let start = line.read_u64(0x1001, 0x0910) + 2 * MS;
    line.start_sync0(start, 1_000_000);
    line.pass(15 * MS);
    let next = line.read_u64(0x1001, 0x0990);
    assert!(next > start + 12 * MS && (next - start).is_multiple_of(MS), "{start} {next}");
    assert_eq!(line.write(FPWR, 0x1001, 0x0980, &[0, 3]), 1);
    assert!(line.upload(0x1001, (0x9011, 2)) > 10, "the same times: the pulses go on");
}

/// Beyond the range of a clock.
#[test]
fn impossible_times_cause_no_panic() {
    let mut line = Line::preop(1);
    let own = line.read_u64(0x1001, 0x0910);
    for time in [own.wrapping_add(1 << 63), own.wrapping_add((1 << 63) + 10_000), u64::MAX, 0] {
        line.write(FPWR, 0x1001, 0x0910, &time.to_le_bytes());
    }
    let own = line.read_u64(0x1001, 0x0910);
    line.write(FPWR, 0x1001, 0x0920, &(u64::MAX - own - 10_000).to_le_bytes());
    line.start_sync0(u64::MAX, 1);
    for _ in 0..4 {
        line.read_u64(0x1001, 0x0990);
    }
    line.start_sync0(0, 1);
    line.read_u64(0x1001, 0x0990);
    assert_eq!(line.upload(0x1001, (0xF000, 2)), 4);
}
