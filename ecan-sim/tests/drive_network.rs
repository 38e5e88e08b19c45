//! The drive as a CANopen slave: NMT, boot-up, heartbeats, emergencies, saved parameters.

mod drive_support;

use drive_support::{Fixture, MS, NODE, settings};
use ecan_canopen::{DriveState, Emcy, ErrorRegister, NmtCommand, NmtState, OperatingMode};
use ecan_sim::{Drive, DriveConfig, DriveQuirks, Node, NodeOutput};

const BOOT_UP: u16 = 0x700 + NODE;
const EMCY: u16 = 0x080 + NODE;

#[test]
fn it_boots_and_says_so() {
    let mut bench = Fixture::cold(Drive::new(&settings()));
    let start = bench.now;
    assert_eq!(bench.drive.state(), DriveState::NotReadyToSwitchOn);
    assert!(!bench.drive.is_on_bus());
    // deaf while it boots
    assert_eq!(bench.frame(0x605, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]), []);
    bench.pass_ms(100);
    assert_eq!(bench.sent, [(start + 40 * MS, (BOOT_UP, vec![0]))]);
    assert!(bench.drive.is_on_bus());
    assert_eq!(bench.drive.nmt_state(), NmtState::PreOperational);
    assert_eq!(bench.drive.state(), DriveState::SwitchOnDisabled);
}

#[test]
fn nmt_commands_lead_through_the_states() {
    let mut bench = Fixture::booted();
    // TPDO 1 carries the statusword on events, so it goes out when OPERATIONAL begins
    assert_eq!(bench.nmt(NmtCommand::Start), [(0x185, vec![0x40, 0x02])]);
    assert_eq!(bench.drive.nmt_state(), NmtState::Operational);
    assert_eq!(bench.nmt(NmtCommand::Stop), []);
    assert_eq!(bench.drive.nmt_state(), NmtState::Stopped);
    // no SDO in STOPPED
    assert_eq!(bench.frame(0x605, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]), []);
    bench.nmt(NmtCommand::EnterPreOperational);
    assert_eq!(bench.read(0x1000, 0), Ok(0x0002_0192));
    // others' commands are none of ours; 0 is for all
    bench.frame(0, &[0x01, 6]);
    assert_eq!(bench.drive.nmt_state(), NmtState::PreOperational);
    bench.frame(0, &[0x01, 0]);
    assert_eq!(bench.drive.nmt_state(), NmtState::Operational);
    for (command, after) in [(NmtCommand::ResetNode, 40), (NmtCommand::ResetCommunication, 2)] {
        bench.lines();
        let start = bench.now;
        bench.nmt(command);
        assert_eq!(bench.drive.nmt_state(), NmtState::Initialising);
        // it goes on acknowledging
        assert!(bench.drive.is_on_bus());
        bench.pass_ms(50);
        assert_eq!(bench.sent, [(start + after * MS, (BOOT_UP, vec![0]))]);
        assert_eq!(bench.drive.nmt_state(), NmtState::PreOperational);
    }
}

#[test]
fn heartbeats_come_at_their_period_with_the_state() {
    let mut bench = Fixture::booted();
    bench.write(0x1017, 0, 100, 2).unwrap();
    let start = bench.now;
    bench.pass_ms(250);
    bench.nmt(NmtCommand::Stop);
    bench.pass_ms(100);
    let beats: Vec<_> = bench.sent.iter().filter(|(_, (id, _))| *id == BOOT_UP).cloned().collect();
    let beat = |ms: u64, state: u8| (start + ms * MS, (BOOT_UP, vec![state]));
    assert_eq!(beats, [beat(100, 0x7F), beat(200, 0x7F), beat(300, 0x04)]);
}

/// 0x1016 watches node 127, as a host; 0x6007 says what happens without it.
fn watching(reaction: i64) -> Fixture {
    let mut bench = Fixture::booted();
    bench.write(0x1016, 1, 0x007F_0032, 4).unwrap();
    bench.write(0x6007, 0, reaction, 2).unwrap();
    bench.enable(OperatingMode::CyclicPosition);
    bench.nmt(NmtCommand::Start);
    bench
}

#[test]
fn a_missing_host_is_noticed_after_its_first_heartbeat_only() {
    let mut bench = watching(1);
    bench.pass_ms(500);
    assert_eq!(bench.drive.state(), DriveState::OperationEnabled);
    for _ in 0..5 {
        bench.frame(0x77F, &[0x05]);
        bench.pass_ms(40);
    }
    assert_eq!(bench.drive.state(), DriveState::OperationEnabled);
    bench.lines();
    let last = bench.now - 40 * MS;
    bench.pass_ms(100);
    assert_eq!(bench.drive.state(), DriveState::Fault);
    assert_eq!(bench.drive.error_code(), 0x8130);
    // 0x1029 is 0: back to PRE-OPERATIONAL
    assert_eq!(bench.drive.nmt_state(), NmtState::PreOperational);
    let emcy = (last + 50 * MS, (EMCY, vec![0x30, 0x81, 0x11, 0, 0, 0, 0, 0]));
    assert!(bench.sent.contains(&emcy), "{:?}", bench.sent);
    // the host comes back and resets the fault
    bench.frame(0x77F, &[0x05]);
    assert_eq!(bench.drive.state(), DriveState::Fault);
    bench.lines();
    bench.controlword(0x80);
    assert_eq!(bench.drive.state(), DriveState::SwitchOnDisabled);
    assert_eq!(bench.drive.error_register(), ErrorRegister(0));
}

#[test]
fn a_missing_host_has_the_reaction_that_0x6007_says() {
    let reactions = [
        (0, DriveState::OperationEnabled),
        (2, DriveState::SwitchOnDisabled),
        // quick stop option code 2: stops, then switch on disabled
        (3, DriveState::SwitchOnDisabled),
    ];
    for (reaction, state) in reactions {
        let mut bench = watching(reaction);
        bench.frame(0x77F, &[0x05]);
        bench.pass_ms(200);
        assert_eq!(bench.drive.state(), state, "0x6007 = {reaction}");
        assert_eq!(bench.drive.error_register(), ErrorRegister(0x11));
        bench.lines();
        // the error goes with the next heartbeat
        let lines = bench.frame(0x77F, &[0x05]);
        assert!(lines.contains(&(EMCY, vec![0; 8])), "{lines:?}");
        assert_eq!(bench.drive.error_register(), ErrorRegister(0));
    }
}

#[test]
fn one_node_is_watched_once() {
    let mut bench = Fixture::booted();
    bench.write(0x1016, 1, 0x0001_0064, 4).unwrap();
    assert_eq!(bench.write(0x1016, 2, 0x0001_00C8, 4), Err(0x0604_0043));
    bench.write(0x1016, 1, 0, 4).unwrap();
    bench.write(0x1016, 2, 0x0001_00C8, 4).unwrap();
}

#[test]
fn being_stopped_counts_as_a_lost_host_under_current() {
    let mut bench = watching(3);
    bench.nmt(NmtCommand::Stop);
    assert_eq!(bench.drive.state(), DriveState::QuickStopActive);
    let mut bench = Fixture::booted();
    bench.nmt(NmtCommand::Start);
    bench.nmt(NmtCommand::Stop);
    assert_eq!(bench.drive.state(), DriveState::SwitchOnDisabled);
}

/// Fails, and collects what the drive sends about it.
fn fail(bench: &mut Fixture, code: u16) -> Vec<Vec<u8>> {
    let mut out = NodeOutput::new();
    bench.drive.fail(bench.now, code, &mut out);
    std::iter::from_fn(|| out.pop())
        .filter(|frame| frame.id().raw() == u32::from(EMCY))
        .map(|frame| frame.data().to_vec())
        .collect()
}

#[test]
fn errors_are_told_and_remembered() {
    let mut bench = Fixture::booted();
    assert_eq!(fail(&mut bench, 0x2310), [[0x10, 0x23, 0x03, 0, 0, 0, 0, 0]]);
    assert_eq!(bench.drive.state(), DriveState::Fault);
    assert_eq!(bench.read(0x1001, 0), Ok(0x03));
    assert_eq!(bench.read(0x603F, 0), Ok(0x2310));
    assert_eq!((bench.read(0x1003, 0), bench.read(0x1003, 1)), (Ok(1), Ok(0x2310)));
    // a second one changes nothing
    assert!(fail(&mut bench, 0x4310).is_empty());
    bench.lines();
    bench.controlword(0x80);
    assert_eq!(bench.read(0x1001, 0), Ok(0));
    assert_eq!(fail(&mut bench, 0x3220), [[0x20, 0x32, 0x05, 0, 0, 0, 0, 0]]);
    assert_eq!((bench.read(0x1003, 1), bench.read(0x1003, 2)), (Ok(0x3220), Ok(0x2310)));
    // only 0 may be written to the number of entries: it empties the list
    assert_eq!(bench.write(0x1003, 0, 1, 1), Err(0x0609_0031));
    bench.write(0x1003, 0, 0, 1).unwrap();
    assert_eq!((bench.read(0x1003, 0), bench.read(0x1003, 1)), (Ok(0), Ok(0)));
}

#[test]
fn a_reset_fault_is_told() {
    let mut bench = Fixture::booted();
    fail(&mut bench, 0x2310);
    bench.pass_ms(1);
    let lines = bench.frame(0x605, &[0x2B, 0x40, 0x60, 0, 0x80, 0, 0, 0]);
    assert!(lines.contains(&(EMCY, vec![0; 8])), "{lines:?}");
}

#[test]
fn an_error_that_comes_and_goes_changes_no_state() {
    let mut bench = Fixture::booted();
    let mut out = NodeOutput::new();
    let emcy = Emcy { code: 0x4210, register: ErrorRegister(0x09), manufacturer: [0; 5] };
    bench.drive.warn(bench.now, emcy, &mut out);
    assert_eq!(out.pop().unwrap().data(), [0x10, 0x42, 0x09, 0, 0, 0, 0, 0]);
    assert_eq!(bench.drive.state(), DriveState::SwitchOnDisabled);
    assert_eq!(bench.read(0x1003, 1), Ok(0x4210));
    assert_eq!(bench.read(0x1001, 0), Ok(0));
}

#[test]
fn emergencies_keep_their_inhibit_time_and_their_identifier() {
    let mut bench = Fixture::booted();
    bench.write(0x1015, 0, 100, 2).unwrap();
    bench.write(0x1014, 0, 0x0123, 4).unwrap();
    let start = bench.now;
    let mut out = NodeOutput::new();
    for code in [0x1000, 0x1001, 0x1002] {
        let emcy = Emcy { code, register: ErrorRegister(1), manufacturer: [0; 5] };
        bench.drive.warn(bench.now, emcy, &mut out);
    }
    assert_eq!(out.len(), 1);
    assert_eq!(out.pop().unwrap().id().raw(), 0x123);
    bench.pass_ms(30);
    let sent: Vec<_> =
        bench.sent.iter().map(|(at, (id, data))| (at - start, *id, data[0])).collect();
    assert_eq!(sent, [(10 * MS, 0x123, 0x01), (20 * MS, 0x123, 0x02)]);
    // switched off by bit 31
    bench.write(0x1014, 0, 0x8000_0123, 4).unwrap();
    let emcy = Emcy { code: 0x1000, register: ErrorRegister(1), manufacturer: [0; 5] };
    bench.pass_ms(100);
    bench.drive.warn(bench.now, emcy, &mut out);
    assert!(out.is_empty());
}

#[test]
fn what_is_saved_survives_a_reset_and_what_is_not_does_not() {
    let mut bench = Fixture::booted();
    bench.write(0x6083, 0, 1111, 4).unwrap();
    bench.write(0x1010, 1, 0x6576_6173, 4).unwrap();
    bench.write(0x6083, 0, 2222, 4).unwrap();
    bench.write(0x6084, 0, 3333, 4).unwrap();
    // reset of communication leaves the profile alone
    bench.nmt(NmtCommand::ResetCommunication);
    bench.pass_ms(50);
    assert_eq!(bench.read(0x6083, 0), Ok(2222));
    bench.nmt(NmtCommand::ResetNode);
    bench.pass_ms(50);
    assert_eq!(bench.read(0x6083, 0), Ok(1111));
    assert_ne!(bench.read(0x6084, 0), Ok(3333));
    // defaults come back with the reset after "load"
    bench.write(0x1011, 1, 0x6461_6F6C, 4).unwrap();
    assert_eq!(bench.read(0x6083, 0), Ok(1111));
    bench.nmt(NmtCommand::ResetNode);
    bench.pass_ms(50);
    assert_eq!(bench.read(0x6083, 0), Ok(10_000_000));
}

#[test]
fn quirks_of_booting_and_silence() {
    let quirks = DriveQuirks { never_boots: true, ..DriveQuirks::default() };
    let mut bench = Fixture::cold(Drive::new(&DriveConfig { quirks, ..settings() }));
    bench.pass_ms(60_000);
    assert!(bench.sent.is_empty() && !bench.drive.is_on_bus());
    let mut bench = Fixture::cold(Drive::new(&DriveConfig { boot_ms: 3_000, ..settings() }));
    bench.pass_ms(2_999);
    assert!(bench.sent.is_empty());
    bench.pass_ms(1);
    assert_eq!(bench.lines(), [(BOOT_UP, vec![0])]);
    let quirks = DriveQuirks { silent: true, ..DriveQuirks::default() };
    let mut bench = Fixture::cold(Drive::new(&DriveConfig { quirks, ..settings() }));
    bench.pass_ms(100);
    assert_eq!(bench.frame(0x605, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]), []);
    assert!(bench.sent.is_empty() && bench.drive.is_on_bus());
}
