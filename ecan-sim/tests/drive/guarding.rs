//! Node guarding, life guarding and TIME of the drive (CiA 301).

use super::fixture::{Fixture, MS, NODE};
use ecan_canopen::{DriveState, NmtCommand, NmtState, OperatingMode, TimeOfDay};
use ecan_sim::DriveQuirks;

const GUARD: u16 = 0x700 + NODE;
const EMCY: u16 = 0x080 + NODE;

/// A drive without heartbeat producer and consumer.
fn guarding_only() -> Fixture {
    let quirks = DriveQuirks { missing: vec![0x1016, 0x1017], ..DriveQuirks::default() };
    Fixture::with_quirks(quirks)
}

#[test]
fn responses_report_the_state_with_alternating_toggle_bit() {
    let mut fixture = guarding_only();
    assert_eq!(fixture.write(0x1017, 0, 10, 2), Err(0x0602_0000));
    assert_eq!(fixture.remote(GUARD), [(GUARD, vec![0x7F])]);
    assert_eq!(fixture.remote(GUARD), [(GUARD, vec![0xFF])]);
    fixture.nmt(NmtCommand::Start);
    assert_eq!(fixture.remote(GUARD), [(GUARD, vec![0x05])]);
    fixture.nmt(NmtCommand::Stop);
    assert_eq!(fixture.remote(GUARD), [(GUARD, vec![0x84])]);
    assert_eq!(fixture.remote(GUARD + 1), [], "another node");
    // The toggle bit restarts with communication.
    fixture.remote(GUARD);
    fixture.nmt(NmtCommand::ResetCommunication);
    assert_eq!(fixture.remote(GUARD), [], "it boots");
    fixture.pass_ms(10);
    assert_eq!(fixture.remote(GUARD), [(GUARD, vec![0x7F])]);
}

#[test]
fn drive_with_heartbeat_does_not_respond() {
    let mut fixture = Fixture::booted();
    assert_eq!(fixture.remote(GUARD), [(GUARD, vec![0x7F])]);
    fixture.write(0x1017, 0, 100, 2).unwrap();
    assert_eq!(fixture.remote(GUARD), []);
}

#[test]
fn missing_requests_count_as_lost_host() {
    let mut fixture = guarding_only();
    fixture.writes(&[(0x100C, 0, 10, 2), (0x100D, 0, 3, 1), (0x6007, 0, 3, 2)]);
    fixture.enable(OperatingMode::CyclicPosition);
    fixture.nmt(NmtCommand::Start);
    fixture.pass_ms(500);
    assert_eq!(fixture.drive.state(), DriveState::OperationEnabled, "no request, no life time");
    for _ in 0..5 {
        fixture.remote(GUARD);
        fixture.pass_ms(25);
    }
    assert_eq!(fixture.drive.state(), DriveState::OperationEnabled);
    fixture.lines();
    let last = fixture.now - 25 * MS;
    fixture.pass_ms(50);
    let emcy = (last + 30 * MS, (EMCY, vec![0x30, 0x81, 0x11, 0, 0, 0, 0, 0]));
    assert!(fixture.sent.contains(&emcy), "{:X?}", fixture.sent);
    assert_ne!(fixture.drive.state(), DriveState::OperationEnabled);
    assert_eq!(fixture.drive.nmt_state(), NmtState::PreOperational, "0x1029 is 0");
    fixture.lines();
    let lines = fixture.remote(GUARD);
    assert!(
        lines.contains(&(EMCY, vec![0; 8])),
        "the error clears with the next request: {lines:X?}"
    );
}

#[test]
fn time_is_consumed_with_bit_31_of_0x1012() {
    let mut fixture = Fixture::booted();
    let time = TimeOfDay::new(15_668, 49_500_250).unwrap();
    fixture.frame(0x100, &time.to_bytes());
    assert_eq!(fixture.drive.time_of_day(), None, "not a consumer");
    for rejected in [0x4000_0100, 0xA000_0100] {
        assert_eq!(fixture.write(0x1012, 0, rejected, 4), Err(0x0609_0030));
    }
    fixture.write(0x1012, 0, 0x8000_0100, 4).unwrap();
    fixture.frame(0x100, &[0x5A, 0x50, 0xF3, 0x02, 0x34, 0x3D]);
    assert_eq!(fixture.drive.time_of_day(), Some(time));
    fixture.frame(0x100, &[0; 5]);
    assert_eq!(fixture.drive.time_of_day(), Some(time), "malformed");
    fixture.nmt(NmtCommand::Stop);
    fixture.frame(0x100, &[0; 6]);
    assert_eq!(fixture.drive.time_of_day(), Some(time), "stopped");
}
