//! Frames to two gateways in PREOP: datagrams with any command, address and data, and any bytes with
//! the EtherType of EtherCAT.
#![no_main]

use ecan_sim::{Wire, echo};
use libfuzzer_sys::fuzz_target;

const MS: u64 = 1_000_000;

/// A frame with one datagram.
fn frame(command: u8, slave: u16, offset: u16, data: &[u8]) -> Vec<u8> {
    let mut frame = vec![0x10; 12];
    frame.extend([0x88, 0xA4]);
    frame.extend((0x1000 | (12 + data.len() as u16)).to_le_bytes());
    frame.extend([command, 0]);
    for word in [slave, offset, data.len() as u16, 0] {
        frame.extend(word.to_le_bytes());
    }
    frame.extend(data);
    frame.extend([0, 0]);
    frame
}

fuzz_target!(|data: &[u8]| {
    let mut now = 1_000 * MS;
    let Ok(mut wire) = Wire::new(&echo(2), now) else { return };
    now += 1_000 * MS;
    wire.advance(now);
    let mailboxes = [0x00, 0x10, 0x80, 0, 0x26, 0, 1, 0, 0x80, 0x10, 0x80, 0, 0x22, 0, 1, 0];
    wire.pass(now, &mut frame(2, 0, 0x0010, &[0x01, 0x10]));
    wire.pass(now, &mut frame(8, 0, 0x0800, &mailboxes));
    wire.pass(now, &mut frame(8, 0, 0x0120, &[2, 0]));
    let mut rest = data;
    while let [kind, low, high, slave, offset @ ..] = rest {
        let [offset_low, offset_high, tail @ ..] = offset else { return };
        let length = usize::from(u16::from_le_bytes([*low, *high]) % 1480).min(tail.len());
        let (own, behind) = tail.split_at(length);
        let mut bytes = if *kind < 0xF0 {
            let slave = if *slave < 0x80 { 0x1001 } else { u16::from(*slave) - 0x80 };
            frame(kind % 16, slave, u16::from_le_bytes([*offset_low, *offset_high]), own)
        } else {
            // EtherCAT by its EtherType alone.
            let mut bytes = vec![0x10; 12];
            bytes.extend([0x88, 0xA4]);
            bytes.extend(own);
            bytes
        };
        now += 100_000;
        let before = bytes.len();
        wire.pass(now, &mut bytes);
        assert_eq!(bytes.len(), before);
        rest = behind;
    }
});
