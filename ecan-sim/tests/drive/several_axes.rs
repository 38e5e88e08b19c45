//! Drives with several axes: each has objects, a state machine and a motor of its own.

use super::fixture::{Fixture, NODE, config};
use ecan_canopen::{DriveState, NmtCommand, OperatingMode};
use ecan_sim::DriveConfig;

const SECOND: u16 = 0x800;

fn two_axes() -> Fixture {
    Fixture::with(&DriveConfig { axes: 2, ..config() })
}

fn states(fixture: &Fixture) -> Vec<DriveState> {
    let drive = &fixture.drive;
    (0..drive.axis_count()).filter_map(|axis| drive.axis(axis)).map(|axis| axis.state()).collect()
}

/// Enables the second axis in CSP by SDO.
fn enable_second(fixture: &mut Fixture) {
    fixture.write(0x6060 + SECOND, 0, 8, 1).unwrap();
    for word in [0x06, 0x07, 0x0F] {
        fixture.write(0x6040 + SECOND, 0, word, 2).unwrap();
    }
}

#[test]
fn each_axis_has_its_own_state_machine_and_motor() {
    let mut fixture = two_axes();
    assert_eq!(fixture.drive.axis_count(), 2);
    assert_eq!(fixture.read(0x1000, 0), Ok(0xFFFF_0192));
    assert_eq!(fixture.read(0x67FF, 0), Ok(0x0002_0192));
    assert_eq!(fixture.read(0x6FFF, 0), Ok(0x0002_0192));
    enable_second(&mut fixture);
    assert_eq!(states(&fixture), [DriveState::SwitchOnDisabled, DriveState::OperationEnabled]);
    fixture.write(0x607A + SECOND, 0, 1_400, 4).unwrap();
    fixture.pass_ms(100);
    let positions: Vec<_> =
        (0..2).map(|axis| fixture.drive.axis(axis).unwrap().position()).collect();
    assert_eq!(positions, [1_000, 1_400]);
    assert_eq!(fixture.read(0x6064 + SECOND, 0), Ok(1_400));
    assert_eq!(fixture.read(0x6061, 0), Ok(0));
    let second = fixture.drive.axis(1).unwrap();
    assert_eq!(second.mode(), Some(OperatingMode::CyclicPosition));
    assert!(fixture.drive.axis(2).is_none());
}

/// One PDO may carry objects of both axes; PDO 65 is the first one of the second axis.
#[test]
fn pdos_carry_objects_of_each_axis() {
    let mut fixture = two_axes();
    enable_second(&mut fixture);
    fixture.write(0x1640, 0, 0, 1).unwrap();
    for (sub, entry) in [(1, 0x6840_0010), (2, 0x687A_0020)] {
        fixture.write(0x1640, sub, entry, 4).unwrap();
    }
    fixture.writes(&[(0x1640, 0, 2, 1), (0x1440, 1, 0x305, 4), (0x1A40, 0, 0, 1)]);
    for (sub, entry) in [(1, 0x6041_0010), (2, 0x6841_0010), (3, 0x6864_0020)] {
        fixture.write(0x1A40, sub, entry, 4).unwrap();
    }
    fixture.writes(&[(0x1A40, 0, 3, 1), (0x1840, 1, 0x285, 4)]);
    fixture.nmt(NmtCommand::Start);
    fixture.frame(0x300 + NODE, &[0x0F, 0, 0x08, 0x07, 0, 0]);
    fixture.pass_ms(100);
    let sent = fixture.frame(0x080, &[]);
    let (_, data) = sent.iter().find(|(id, _)| *id == 0x280 + NODE).unwrap();
    assert_eq!(data[4..], [0x08, 0x07, 0, 0], "0x0708 is 1800");
    let status = |bytes: &[u8]| u16::from_le_bytes([bytes[0], bytes[1]]) & 0x6F;
    assert_eq!((status(&data[..2]), status(&data[2..])), (0x40, 0x27));
}

#[test]
fn fault_of_an_axis_leaves_the_other_enabled() {
    let mut fixture = two_axes();
    enable_second(&mut fixture);
    fixture.enable(OperatingMode::CyclicPosition);
    let mut out = ecan_sim::NodeOutput::new();
    fixture.drive.fail_axis(fixture.now, 1, 0x2310, &mut out);
    fixture.pass_ms(50);
    assert_eq!(states(&fixture), [DriveState::OperationEnabled, DriveState::Fault]);
    assert_eq!(fixture.drive.error_code(), 0x2310);
    fixture.write(0x6040 + SECOND, 0, 0x80, 2).unwrap();
    assert_eq!(states(&fixture), [DriveState::OperationEnabled, DriveState::SwitchOnDisabled]);
    assert_eq!(fixture.drive.error_code(), 0);
}

#[test]
fn lost_host_stops_all_axes() {
    let mut fixture = two_axes();
    enable_second(&mut fixture);
    fixture.writes(&[(0x6007 + SECOND, 0, 3, 2), (0x1016, 1, 0x007F_0032, 4)]);
    fixture.frame(0x77F, &[5]);
    fixture.pass_ms(200);
    // 0x6007 of the first axis is 1: a fault.
    assert_eq!(states(&fixture), [DriveState::Fault, DriveState::SwitchOnDisabled]);
}

#[test]
fn device_file_with_two_controlwords_gives_two_axes() {
    let mut text = String::from("[1000] DataType=7, AccessType=ro, DefaultValue=0xFFFF0192\n");
    for (index, data_type, access, value) in [
        (0x6040, 6, "rw", 0),
        (0x6041, 6, "ro", 0),
        (0x6060, 2, "rw", 0),
        (0x6061, 2, "ro", 0),
        (0x6064, 4, "ro", 0),
        (0x607A, 4, "rw", 0),
        (0x6502, 7, "ro", 0x80),
    ] {
        let keys = format!("DataType={data_type}, AccessType={access}, DefaultValue={value}");
        for index in [index, index + SECOND] {
            text += &format!("[{index:04X}] {keys}, PDOMapping=1\n");
        }
    }
    let mut fixture = Fixture::from_file(&text);
    fixture.sent.clear();
    assert_eq!(fixture.drive.axis_count(), 2);
    enable_second(&mut fixture);
    assert_eq!(states(&fixture), [DriveState::SwitchOnDisabled, DriveState::OperationEnabled]);
}
