//! The drive as an LSS slave, byte by byte (CiA 305).

use super::fixture::{Fixture, MS, config};
use ecan_canopen::{NmtCommand, NmtState, NodeId};
use ecan_sim::{Drive, DriveConfig, DriveQuirks, Node};

/// CAN IDs of the master and of the slaves.
const MASTER: u16 = 0x7E5;
const SLAVE: u16 = 0x7E4;

/// Identity of the simulated drive: vendor-ID, product code, revision, serial number.
const IDENTITY: [u32; 4] = [0x5349_4D00, 402, 0x0001_0000, 1];

fn unconfigured(quirks: DriveQuirks) -> Fixture {
    let quirks = DriveQuirks { without_node_id: true, ..quirks };
    let mut fixture = Fixture::cold(Drive::new(&DriveConfig { quirks, ..config() }));
    fixture.pass_ms(100);
    fixture
}

/// Sends a request of a command and up to four bytes; returns the data of the response.
fn lss(fixture: &mut Fixture, request: &[u8]) -> Option<[u8; 8]> {
    let mut data = [0; 8];
    data[..request.len()].copy_from_slice(request);
    let lines = fixture.frame(MASTER, &data);
    assert!(lines.iter().all(|(id, _)| *id == SLAVE), "{lines:X?}");
    lines.first().map(|(_, data)| data.clone().try_into().unwrap())
}

fn with_value(command: u8, value: u32) -> [u8; 5] {
    let [a, b, c, d] = value.to_le_bytes();
    [command, a, b, c, d]
}

fn select(fixture: &mut Fixture, identity: [u32; 4]) -> Option<[u8; 8]> {
    let frames = (0x40..).zip(identity);
    frames.map(|(command, value)| lss(fixture, &with_value(command, value))).last().flatten()
}

const SELECTED: Option<[u8; 8]> = Some([0x44, 0, 0, 0, 0, 0, 0, 0]);

#[test]
fn drive_without_node_id_takes_part_in_lss_only() {
    let mut fixture = unconfigured(DriveQuirks::default());
    assert!(fixture.sent.is_empty() && fixture.drive.is_on_bus());
    assert_eq!(fixture.drive.active_node_id(), None);
    assert_eq!(fixture.nmt(NmtCommand::Start), []);
    assert_eq!(fixture.frame(0x605, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]), []);
    assert_eq!(fixture.drive.nmt_state(), NmtState::Initialising);
    // Identify non-configured slaves
    assert_eq!(lss(&mut fixture, &[0x4C]), Some([0x50, 0, 0, 0, 0, 0, 0, 0]));
    // Inquiries need the configuration state
    assert_eq!(lss(&mut fixture, &[0x5E]), None);
    assert_eq!(select(&mut fixture, IDENTITY), SELECTED);
    assert_eq!(lss(&mut fixture, &[0x5E]), Some([0x5E, 0xFF, 0, 0, 0, 0, 0, 0]));
}

#[test]
fn configured_node_id_boots_at_the_waiting_state() {
    let mut fixture = unconfigured(DriveQuirks::default());
    lss(&mut fixture, &[0x04, 1]);
    for invalid in [0, 128, 254] {
        let rejected = Some([0x11, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(lss(&mut fixture, &[0x11, invalid]), rejected);
    }
    assert_eq!(lss(&mut fixture, &[0x11, 9]), Some([0x11, 0, 0, 0, 0, 0, 0, 0]));
    assert_eq!(fixture.drive.active_node_id(), None, "pending");
    assert_eq!(lss(&mut fixture, &[0x04, 0]), None);
    fixture.pass_ms(10);
    assert_eq!(fixture.lines(), [(0x709, vec![0])]);
    assert_eq!(fixture.drive.active_node_id(), NodeId::from_raw(9));
    // The COB-IDs of the communication profile follow the node-ID.
    let upload = |index: u16, sub| [0x40, index as u8, (index >> 8) as u8, sub, 0, 0, 0, 0];
    for (index, sub, value) in
        [(0x1400, 1, 0x4000_0209_u32), (0x1800, 1, 0x4000_0189), (0x1014, 0, 0x89)]
    {
        let lines = fixture.frame(0x609, &upload(index, sub));
        assert_eq!((lines[0].0, &lines[0].1[4..]), (0x589, &value.to_le_bytes()[..]));
    }
    assert_eq!(lss(&mut fixture, &[0x4C]), None, "it has a node-ID");
}

#[test]
fn stored_node_id_survives_reset_and_power_cycle() {
    for stores in [true, false] {
        let quirks = DriveQuirks { no_lss_store: !stores, ..DriveQuirks::default() };
        let mut fixture = unconfigured(quirks);
        lss(&mut fixture, &[0x04, 1]);
        lss(&mut fixture, &[0x11, 9]);
        let error = u8::from(!stores);
        assert_eq!(lss(&mut fixture, &[0x17]), Some([0x17, error, 0, 0, 0, 0, 0, 0]));
        lss(&mut fixture, &[0x04, 0]);
        fixture.pass_ms(10);
        fixture.lines();
        fixture.drive.power_cycle(fixture.now, fixture.now + 20 * MS);
        fixture.pass_ms(100);
        let expected = if stores { vec![(0x709, vec![0])] } else { Vec::new() };
        assert_eq!(fixture.lines(), expected);
        assert_eq!(fixture.drive.active_node_id().is_some(), stores);
    }
}

#[test]
fn new_node_id_of_a_configured_drive_applies_at_reset() {
    let mut fixture = Fixture::booted();
    assert_eq!(select(&mut fixture, IDENTITY), SELECTED);
    assert_eq!(lss(&mut fixture, &[0x5E]), Some([0x5E, 5, 0, 0, 0, 0, 0, 0]));
    lss(&mut fixture, &[0x11, 9]);
    lss(&mut fixture, &[0x04, 0]);
    fixture.pass_ms(100);
    assert_eq!(fixture.read(0x1000, 0), Ok(0x0002_0192), "still node 5");
    fixture.write(0x6083, 0, 1111, 4).unwrap();
    fixture.lines();
    fixture.nmt(NmtCommand::ResetCommunication);
    fixture.pass_ms(100);
    assert_eq!(fixture.lines(), [(0x709, vec![0])]);
    assert_eq!(fixture.drive.object(0x6083, 0), Some(1111), "not of the communication profile");
    // Not stored: the reset of the node restores the old one.
    fixture.frame(0, &[0x81, 9]);
    fixture.pass_ms(100);
    assert_eq!(fixture.lines(), [(0x705, vec![0])]);
}

#[test]
fn selective_switch_needs_all_parts_in_order() {
    let mut fixture = Fixture::booted();
    for nth in 0..4 {
        let mut other = IDENTITY;
        other[nth] ^= 1;
        assert_eq!(select(&mut fixture, other), None);
    }
    let [_, product, revision, serial] = IDENTITY;
    for (command, value) in [(0x41, product), (0x42, revision), (0x43, serial)] {
        assert_eq!(lss(&mut fixture, &with_value(command, value)), None, "no vendor-ID");
    }
    assert_eq!(select(&mut fixture, IDENTITY), SELECTED);
    let parts = [0x5A, 0x5B, 0x5C, 0x5D].map(|command| {
        let response = lss(&mut fixture, &[command]).unwrap();
        assert_eq!(response[0], command);
        u32::from_le_bytes(response[1..5].try_into().unwrap())
    });
    assert_eq!(parts, IDENTITY);
}

#[test]
fn identification_responds_to_a_range() {
    let mut fixture = Fixture::booted();
    let [vendor, product, revision, serial] = IDENTITY;
    let mut identify = |revisions: [u32; 2], serials: [u32; 2]| {
        let values = [vendor, product, revisions[0], revisions[1], serials[0], serials[1]];
        let frames = (0x46..).zip(values);
        let responses: Vec<_> =
            frames.map(|(command, value)| lss(&mut fixture, &with_value(command, value))).collect();
        assert!(responses[..5].iter().all(Option::is_none));
        responses[5]
    };
    let found = Some([0x4F, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(identify([0, u32::MAX], [0, u32::MAX]), found);
    assert_eq!(identify([revision, revision], [serial, serial]), found);
    assert_eq!(identify([revision + 1, u32::MAX], [0, u32::MAX]), None);
    assert_eq!(identify([0, u32::MAX], [serial + 1, u32::MAX]), None);
}

#[test]
fn fastscan_selects_a_drive_without_node_id() {
    let mut fixture = unconfigured(DriveQuirks::default());
    let mut scan = |value: u32, check: u8, sub: u8, next: u8| {
        let [a, b, c, d] = value.to_le_bytes();
        lss(&mut fixture, &[0x51, a, b, c, d, check, sub, next]).is_some()
    };
    assert!(scan(0, 0x80, 0, 0));
    for (sub, own) in (0..).zip(IDENTITY) {
        let mut value = 0;
        for bit in (0..32).rev() {
            if !scan(value, bit, sub, sub) {
                value |= 1 << bit;
            }
        }
        assert_eq!(value, own);
        assert!(scan(value, 0, sub, (sub + 1) & 3));
    }
    assert!(!scan(0, 0x80, 0, 0), "in the configuration state it does not respond");
    assert_eq!(lss(&mut fixture, &[0x5A]).unwrap()[0], 0x5A);
    // A drive with a node-ID does not respond.
    let mut booted = Fixture::booted();
    assert_eq!(lss(&mut booted, &[0x51, 0, 0, 0, 0, 0x80, 0, 0]), None);
}

#[test]
fn bit_rate_switches_after_both_delays() {
    let mut fixture = Fixture::booted();
    fixture.write(0x1017, 0, 10, 2).unwrap();
    lss(&mut fixture, &[0x04, 1]);
    let unsupported = Some([0x13, 1, 0, 0, 0, 0, 0, 0]);
    assert_eq!(lss(&mut fixture, &[0x13, 0, 5]), unsupported, "reserved");
    assert_eq!(lss(&mut fixture, &[0x13, 0, 9]), unsupported, "automatic");
    assert_eq!(lss(&mut fixture, &[0x13, 1, 3]), unsupported, "another table");
    assert_eq!(lss(&mut fixture, &[0x13, 0, 3]), Some([0x13, 0, 0, 0, 0, 0, 0, 0]));
    assert_eq!(fixture.drive.bit_rate(), None, "pending");
    assert_eq!(lss(&mut fixture, &[0x15, 20, 0]), None);
    assert!(!fixture.drive.is_on_bus());
    fixture.pass_ms(39);
    assert!(!fixture.drive.is_on_bus());
    fixture.pass_ms(1);
    assert!(fixture.drive.is_on_bus());
    assert_eq!(fixture.drive.bit_rate(), Some(250_000));
    // Only stored bit rates survive a reset of the node.
    lss(&mut fixture, &[0x04, 0]);
    fixture.nmt(NmtCommand::ResetNode);
    assert_eq!(fixture.drive.bit_rate(), None);
    fixture.pass_ms(100);
    lss(&mut fixture, &[0x04, 1]);
    lss(&mut fixture, &[0x13, 0, 4]);
    lss(&mut fixture, &[0x17]);
    fixture.nmt(NmtCommand::ResetNode);
    assert_eq!(fixture.drive.bit_rate(), Some(125_000));
}

#[test]
fn drive_without_lss_is_silent() {
    let quirks = DriveQuirks { no_lss: true, ..DriveQuirks::default() };
    let mut fixture = Fixture::with_quirks(quirks);
    assert_eq!(select(&mut fixture, IDENTITY), None);
    assert_eq!(lss(&mut fixture, &[0x04, 1]), None);
    assert_eq!(lss(&mut fixture, &[0x5E]), None);
}

#[test]
fn saved_values_survive_a_new_node_id_except_its_cob_ids() {
    let mut fixture = Fixture::booted();
    fixture.writes(&[(0x1015, 0, 77, 2), (0x1014, 0, 0x123, 4), (0x1010, 1, 0x6576_6173, 4)]);
    lss(&mut fixture, &[0x04, 1]);
    lss(&mut fixture, &[0x11, 9]);
    lss(&mut fixture, &[0x04, 0]);
    fixture.nmt(NmtCommand::ResetCommunication);
    fixture.pass_ms(100);
    assert_eq!(fixture.drive.active_node_id(), NodeId::from_raw(9));
    assert_eq!(fixture.drive.object(0x1015, 0), Some(77));
    assert_eq!(fixture.drive.object(0x1014, 0), Some(0x89));
}
