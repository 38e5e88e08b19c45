//! Firmware update by FoE, EEPROM rebuild and reboot by a master on the wire.

use crate::wire_support::{Line, MS, command::*};
use ecan_sim::FirmwarePackage;

const WRITE_REQUEST: u8 = 2;
const DATA: u8 = 3;
const ACKNOWLEDGE: u8 = 4;
const ERROR: u8 = 5;
const BUSY: u8 = 6;
/// Data of a full packet: the mailbox without its header and that of FoE.
const PACKET: usize = 128 - 6 - 6;

fn foe(line: &mut Line, opcode: u8, number: u32, data: &[u8]) -> Vec<u8> {
    let mut message = vec![opcode, 0];
    message.extend(number.to_le_bytes());
    message.extend(data);
    line.mailbox(0x1001, 4, 0, &message)
}

/// Writes a file; returns the text of the error if it is rejected.
fn write_file(line: &mut Line, name: &str, password: u32, file: &[u8]) -> Result<(), String> {
    let text = |answer: &[u8]| String::from_utf8_lossy(&answer[6..]).into_owned();
    let answer = foe(line, WRITE_REQUEST, password, name.as_bytes());
    if answer[0] == ERROR {
        return Err(text(&answer));
    }
    assert_eq!((answer[0], answer[2]), (ACKNOWLEDGE, 0));
    let mut packets: Vec<_> = file.chunks(PACKET).collect();
    if file.len().is_multiple_of(PACKET) {
        packets.push(&[]);
    }
    let mut busy = 0;
    for (packet, number) in packets.into_iter().zip(1..) {
        loop {
            let answer = foe(line, DATA, number, packet);
            match answer[0] {
                ACKNOWLEDGE => break assert_eq!(answer[2..6], number.to_le_bytes()),
                BUSY => {
                    busy += 1;
                    line.pass(10 * MS);
                }
                ERROR => return Err(text(&answer)),
                other => panic!("{other}"),
            }
        }
    }
    assert!(busy > 0, "the flash takes its time");
    Ok(())
}

fn package(version: u32) -> Vec<u8> {
    FirmwarePackage::new(0, version, vec![0x5A; 20_000]).to_bytes()
}

/// In PREOP again after a restart.
fn come_back(line: &mut Line) {
    line.pass(2_000 * MS);
    assert_eq!(line.read(FPRD, 0x1001, 0x0010, 2).1, 0, "it has restarted");
    line.address(0);
    line.set_up_mailboxes(0x1001);
    line.request(0x1001, 2);
    assert_eq!(line.state(0x1001), (2, 0));
}

#[test]
fn update_reboots_into_the_new_version() {
    let mut line = Line::preop(1);
    assert_eq!(line.upload(0x1001, (0xF000, 5)), 0x0202);
    assert_eq!(write_file(&mut line, "ecan_lite_app", 0, &package(0x0E04_5E0F)), Ok(()));
    assert_eq!(line.upload(0x1001, (0xF000, 5)), 0x0202, "until it restarts");
    come_back(&mut line);
    assert_eq!(line.upload(0x1001, (0xF000, 5)), 0x0E04);
    assert_eq!(line.upload(0x1001, (0xF000, 6)), 0x5E0F);
}

#[test]
fn wrong_update_is_rejected_with_a_text() {
    let mut line = Line::preop(1);
    let good = package(0x0300_0000);
    let rejected = |line: &mut Line, name, password, file: &[u8]| {
        write_file(line, name, password, file).unwrap_err()
    };
    assert!(rejected(&mut line, "ecan_lite_app", 7, &good).contains("Password invalid"));
    assert!(!rejected(&mut line, "other_file", 0, &good).is_empty());
    let mut damaged = good.clone();
    damaged[5_000] ^= 1;
    assert!(rejected(&mut line, "ecan_lite_app", 0, &damaged).contains("OTA verify failed"));
    line.pass(2_000 * MS);
    assert_eq!(line.upload(0x1001, (0xF000, 5)), 0x0202);
}

#[test]
fn reboot_command_is_answered_before_the_reboot() {
    let mut line = Line::preop(1);
    line.download(0x1001, (0x8000, 1), &[1]).unwrap();
    come_back(&mut line);
}

#[test]
fn eeprom_is_rebuilt_by_command() {
    let mut line = Line::preop(1);
    line.write(FPWR, 0x1001, 0x0502, &[1, 2, 8, 0, 0, 0, 0xEF, 0xBE]);
    line.pass(MS);
    assert_eq!(line.eeprom(0x1001, 8)[0], 0xBEEF);
    assert!(line.upload(0x1001, (0xB000, 5)) == 0);
    line.download(0x1001, (0xB000, 3), &10_u16.to_le_bytes()).unwrap();
    line.download(0x1001, (0xB000, 1), &[2]).unwrap();
    line.download(0x1001, (0xB000, 4), &[1 << 6]).unwrap();
    come_back(&mut line);
    assert_eq!(line.eeprom(0x1001, 8)[0], 0x4543);
}
