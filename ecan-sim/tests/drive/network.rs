//! The drive as a CANopen node: NMT, boot-up, heartbeats, emergencies, saved parameters.

use super::fixture::{Fixture, MS, NODE, config};
use ecan_canopen::{DriveState, Emcy, ErrorRegister, NmtCommand, NmtState, OperatingMode};
use ecan_sim::{Drive, DriveConfig, DriveQuirks, Node, NodeOutput};

const BOOT_UP: u16 = 0x700 + NODE;
const EMCY: u16 = 0x080 + NODE;

#[test]
fn drive_sends_boot_up_message() {
    let mut fixture = Fixture::cold(Drive::new(&config()));
    let start = fixture.now;
    assert_eq!(fixture.drive.state(), DriveState::NotReadyToSwitchOn);
    assert!(!fixture.drive.is_on_bus());
    // no reception while it boots
    assert_eq!(fixture.frame(0x605, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]), []);
    fixture.pass_ms(100);
    assert_eq!(fixture.sent, [(start + 40 * MS, (BOOT_UP, vec![0]))]);
    assert!(fixture.drive.is_on_bus());
    assert_eq!(fixture.drive.nmt_state(), NmtState::PreOperational);
    assert_eq!(fixture.drive.state(), DriveState::SwitchOnDisabled);
}

#[test]
fn nmt_commands_change_state() {
    let mut fixture = Fixture::booted();
    // TPDO 1 sends the statusword on events, so also on entering Operational
    assert_eq!(fixture.nmt(NmtCommand::Start), [(0x185, vec![0x40, 0x02])]);
    assert_eq!(fixture.drive.nmt_state(), NmtState::Operational);
    assert_eq!(fixture.nmt(NmtCommand::Stop), []);
    assert_eq!(fixture.drive.nmt_state(), NmtState::Stopped);
    // no SDO in Stopped
    assert_eq!(fixture.frame(0x605, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]), []);
    fixture.nmt(NmtCommand::EnterPreOperational);
    assert_eq!(fixture.read(0x1000, 0), Ok(0x0002_0192));
    // commands to other nodes are ignored; 0 addresses all
    fixture.frame(0, &[0x01, 6]);
    assert_eq!(fixture.drive.nmt_state(), NmtState::PreOperational);
    fixture.frame(0, &[0x01, 0]);
    assert_eq!(fixture.drive.nmt_state(), NmtState::Operational);
    for (command, after) in [(NmtCommand::ResetNode, 40), (NmtCommand::ResetCommunication, 2)] {
        fixture.lines();
        let start = fixture.now;
        fixture.nmt(command);
        assert_eq!(fixture.drive.nmt_state(), NmtState::Initialising);
        // it still acknowledges
        assert!(fixture.drive.is_on_bus());
        fixture.pass_ms(50);
        assert_eq!(fixture.sent, [(start + after * MS, (BOOT_UP, vec![0]))]);
        assert_eq!(fixture.drive.nmt_state(), NmtState::PreOperational);
    }
}

#[test]
fn heartbeats_have_period_and_state() {
    let mut fixture = Fixture::booted();
    fixture.write(0x1017, 0, 100, 2).unwrap();
    let start = fixture.now;
    fixture.pass_ms(250);
    fixture.nmt(NmtCommand::Stop);
    fixture.pass_ms(100);
    let beats: Vec<_> =
        fixture.sent.iter().filter(|(_, (id, _))| *id == BOOT_UP).cloned().collect();
    let beat = |ms: u64, state: u8| (start + ms * MS, (BOOT_UP, vec![state]));
    assert_eq!(beats, [beat(100, 0x7F), beat(200, 0x7F), beat(300, 0x04)]);
}

/// 0x1016 monitors node 127, the host; 0x6007 selects the reaction to its loss.
fn watching(reaction: i64) -> Fixture {
    let mut fixture = Fixture::booted();
    fixture.writes(&[(0x1016, 1, 0x007F_0032, 4), (0x6007, 0, reaction, 2)]);
    fixture.enable(OperatingMode::CyclicPosition);
    fixture.nmt(NmtCommand::Start);
    fixture
}

#[test]
fn host_is_monitored_from_its_first_heartbeat() {
    let mut fixture = watching(1);
    fixture.pass_ms(500);
    assert_eq!(fixture.drive.state(), DriveState::OperationEnabled);
    for _ in 0..5 {
        fixture.frame(0x77F, &[0x05]);
        fixture.pass_ms(40);
    }
    assert_eq!(fixture.drive.state(), DriveState::OperationEnabled);
    fixture.lines();
    let last = fixture.now - 40 * MS;
    fixture.pass_ms(100);
    assert_eq!(fixture.drive.state(), DriveState::Fault);
    assert_eq!(fixture.drive.error_code(), 0x8130);
    // 0x1029 is 0: back to Pre-operational
    assert_eq!(fixture.drive.nmt_state(), NmtState::PreOperational);
    let emcy = (last + 50 * MS, (EMCY, vec![0x30, 0x81, 0x11, 0, 0, 0, 0, 0]));
    assert!(fixture.sent.contains(&emcy), "{:?}", fixture.sent);
    // the host returns and resets the fault
    fixture.frame(0x77F, &[0x05]);
    assert_eq!(fixture.drive.state(), DriveState::Fault);
    fixture.lines();
    fixture.controlword(0x80);
    assert_eq!(fixture.drive.state(), DriveState::SwitchOnDisabled);
    assert_eq!(fixture.drive.error_register(), ErrorRegister(0));
}

#[test]
fn lost_host_causes_reaction_of_0x6007() {
    let reactions = [
        (0, DriveState::OperationEnabled),
        (2, DriveState::SwitchOnDisabled),
        // quick stop option code 2: stops, then switch on disabled
        (3, DriveState::SwitchOnDisabled),
    ];
    for (reaction, state) in reactions {
        let mut fixture = watching(reaction);
        fixture.frame(0x77F, &[0x05]);
        fixture.pass_ms(200);
        assert_eq!(fixture.drive.state(), state, "0x6007 = {reaction}");
        assert_eq!(fixture.drive.error_register(), ErrorRegister(0x11));
        fixture.lines();
        // the error clears with the next heartbeat
        let lines = fixture.frame(0x77F, &[0x05]);
        assert!(lines.contains(&(EMCY, vec![0; 8])), "{lines:?}");
        assert_eq!(fixture.drive.error_register(), ErrorRegister(0));
    }
}

#[test]
fn node_cannot_be_monitored_twice() {
    let mut fixture = Fixture::booted();
    fixture.write(0x1016, 1, 0x0001_0064, 4).unwrap();
    assert_eq!(fixture.write(0x1016, 2, 0x0001_00C8, 4), Err(0x0604_0043));
    fixture.writes(&[(0x1016, 1, 0, 4), (0x1016, 2, 0x0001_00C8, 4)]);
}

#[test]
fn nmt_stop_of_energised_drive_counts_as_lost_host() {
    let mut fixture = watching(3);
    fixture.nmt(NmtCommand::Stop);
    assert_eq!(fixture.drive.state(), DriveState::QuickStopActive);
    let mut fixture = Fixture::booted();
    fixture.nmt(NmtCommand::Start);
    fixture.nmt(NmtCommand::Stop);
    assert_eq!(fixture.drive.state(), DriveState::SwitchOnDisabled);
}

/// Injects a fault and returns the frames that the drive sends.
fn fail(fixture: &mut Fixture, code: u16) -> Vec<Vec<u8>> {
    let mut out = NodeOutput::new();
    fixture.drive.fail(fixture.now, code, &mut out);
    std::iter::from_fn(|| out.pop())
        .filter(|frame| frame.id().raw() == u32::from(EMCY))
        .map(|frame| frame.data().to_vec())
        .collect()
}

#[test]
fn errors_are_reported_and_stored() {
    let mut fixture = Fixture::booted();
    assert_eq!(fail(&mut fixture, 0x2310), [[0x10, 0x23, 0x03, 0, 0, 0, 0, 0]]);
    assert_eq!(fixture.drive.state(), DriveState::Fault);
    assert_eq!(fixture.read(0x1001, 0), Ok(0x03));
    assert_eq!(fixture.read(0x603F, 0), Ok(0x2310));
    assert_eq!((fixture.read(0x1003, 0), fixture.read(0x1003, 1)), (Ok(1), Ok(0x2310)));
    // a second one has no effect
    assert!(fail(&mut fixture, 0x4310).is_empty());
    fixture.lines();
    fixture.controlword(0x80);
    assert_eq!(fixture.read(0x1001, 0), Ok(0));
    assert_eq!(fail(&mut fixture, 0x3220), [[0x20, 0x32, 0x05, 0, 0, 0, 0, 0]]);
    assert_eq!((fixture.read(0x1003, 1), fixture.read(0x1003, 2)), (Ok(0x3220), Ok(0x2310)));
    // only 0 may be written to the number of entries: it clears the list
    assert_eq!(fixture.write(0x1003, 0, 1, 1), Err(0x0609_0031));
    fixture.write(0x1003, 0, 0, 1).unwrap();
    assert_eq!((fixture.read(0x1003, 0), fixture.read(0x1003, 1)), (Ok(0), Ok(0)));
}

#[test]
fn fault_reset_is_reported() {
    let mut fixture = Fixture::booted();
    fail(&mut fixture, 0x2310);
    fixture.pass_ms(1);
    let lines = fixture.frame(0x605, &[0x2B, 0x40, 0x60, 0, 0x80, 0, 0, 0]);
    assert!(lines.contains(&(EMCY, vec![0; 8])), "{lines:?}");
}

#[test]
fn temporary_error_does_not_change_state() {
    let mut fixture = Fixture::booted();
    let mut out = NodeOutput::new();
    let emcy = Emcy { code: 0x4210, register: ErrorRegister(0x09), manufacturer: [0; 5] };
    fixture.drive.warn(fixture.now, emcy, &mut out);
    assert_eq!(out.pop().unwrap().data(), [0x10, 0x42, 0x09, 0, 0, 0, 0, 0]);
    assert_eq!(fixture.drive.state(), DriveState::SwitchOnDisabled);
    assert_eq!(fixture.read(0x1003, 1), Ok(0x4210));
    assert_eq!(fixture.read(0x1001, 0), Ok(0));
}

#[test]
fn emergencies_respect_inhibit_time_and_cob_id() {
    let mut fixture = Fixture::booted();
    fixture.writes(&[(0x1015, 0, 100, 2), (0x1014, 0, 0x0123, 4)]);
    let start = fixture.now;
    let mut out = NodeOutput::new();
    for code in [0x1000, 0x1001, 0x1002] {
        let emcy = Emcy { code, register: ErrorRegister(1), manufacturer: [0; 5] };
        fixture.drive.warn(fixture.now, emcy, &mut out);
    }
    assert_eq!(out.len(), 1);
    assert_eq!(out.pop().unwrap().id().raw(), 0x123);
    fixture.pass_ms(30);
    let sent: Vec<_> =
        fixture.sent.iter().map(|(at, (id, data))| (at - start, *id, data[0])).collect();
    assert_eq!(sent, [(10 * MS, 0x123, 0x01), (20 * MS, 0x123, 0x02)]);
    // disabled by bit 31
    fixture.write(0x1014, 0, 0x8000_0123, 4).unwrap();
    let emcy = Emcy { code: 0x1000, register: ErrorRegister(1), manufacturer: [0; 5] };
    fixture.pass_ms(100);
    fixture.drive.warn(fixture.now, emcy, &mut out);
    assert!(out.is_empty());
}

#[test]
fn only_saved_values_survive_reset() {
    let mut fixture = Fixture::booted();
    fixture.write(0x6083, 0, 1111, 4).unwrap();
    fixture.write(0x1010, 1, 0x6576_6173, 4).unwrap();
    fixture.write(0x6083, 0, 2222, 4).unwrap();
    fixture.write(0x6084, 0, 3333, 4).unwrap();
    // reset of communication keeps the profile objects
    fixture.nmt(NmtCommand::ResetCommunication);
    fixture.pass_ms(50);
    assert_eq!(fixture.read(0x6083, 0), Ok(2222));
    fixture.nmt(NmtCommand::ResetNode);
    fixture.pass_ms(50);
    assert_eq!(fixture.read(0x6083, 0), Ok(1111));
    assert_ne!(fixture.read(0x6084, 0), Ok(3333));
    // "load" restores the defaults at the next reset
    fixture.write(0x1011, 1, 0x6461_6F6C, 4).unwrap();
    assert_eq!(fixture.read(0x6083, 0), Ok(1111));
    fixture.nmt(NmtCommand::ResetNode);
    fixture.pass_ms(50);
    assert_eq!(fixture.read(0x6083, 0), Ok(10_000_000));
}

#[test]
fn boot_and_silence_quirks_apply() {
    let quirks = DriveQuirks { never_boots: true, ..DriveQuirks::default() };
    let mut fixture = Fixture::cold(Drive::new(&DriveConfig { quirks, ..config() }));
    fixture.pass_ms(60_000);
    assert!(fixture.sent.is_empty() && !fixture.drive.is_on_bus());
    let mut fixture = Fixture::cold(Drive::new(&DriveConfig { boot_ms: 3_000, ..config() }));
    fixture.pass_ms(2_999);
    assert!(fixture.sent.is_empty());
    fixture.pass_ms(1);
    assert_eq!(fixture.lines(), [(BOOT_UP, vec![0])]);
    let quirks = DriveQuirks { silent: true, ..DriveQuirks::default() };
    let mut fixture = Fixture::cold(Drive::new(&DriveConfig { quirks, ..config() }));
    fixture.pass_ms(100);
    assert_eq!(fixture.frame(0x605, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]), []);
    assert!(fixture.sent.is_empty() && fixture.drive.is_on_bus());
}
