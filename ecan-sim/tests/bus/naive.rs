//! Independent bit-by-bit encoder, from the frame formats of ISO 11898-1.

use ecan_protocol::can::{CanFrame, FrameKind};

/// A frame on the wire: every bit from SOF to the end of EOF, `true` recessive.
pub struct Wire {
    pub bits: Vec<bool>,
    /// Positions sent at the data bit rate.
    pub data_phase: std::ops::Range<usize>,
    pub dynamic_stuff: usize,
}

fn digits(value: u32, count: usize) -> String {
    if count == 0 { String::new() } else { format!("{value:0count$b}") }
}

/// The bits of arbitration.
pub fn arbitration_bits(frame: &CanFrame) -> String {
    let id = frame.id().raw();
    let rtr = if frame.kind() == FrameKind::Remote { "1" } else { "0" };
    if frame.id().is_extended() {
        let all = digits(id, 29);
        format!("{}11{}{rtr}", &all[..11], &all[11..])
    } else {
        format!("{}{rtr}0", digits(id, 11))
    }
}

fn remainder(bits: &str, polynomial: u32, width: usize, start: u32) -> u32 {
    let mut register = start;
    for bit in bits.chars() {
        let feedback = (register >> (width - 1) & 1 == 1) != (bit == '1');
        register = (register << 1) & ((1 << width) - 1);
        if feedback {
            register ^= polynomial;
        }
    }
    register
}

/// Inserts stuff bits; at the very end only if `closing`. Returns the position of every input bit.
fn stuffed(bits: &str, closing: bool) -> (String, Vec<usize>) {
    let mut out = String::new();
    let mut positions = Vec::new();
    let mut run = 0;
    let mut last = '-';
    for (i, bit) in bits.chars().enumerate() {
        run = if bit == last { run + 1 } else { 1 };
        last = bit;
        positions.push(out.len());
        out.push(bit);
        if run == 5 && (closing || i + 1 < bits.len()) {
            last = if bit == '0' { '1' } else { '0' };
            out.push(last);
            run = 1;
        }
    }
    (out, positions)
}

pub fn encode(frame: &CanFrame) -> Wire {
    let mut plain = format!("0{}", arbitration_bits(frame));
    let mut brs_at = None;
    match frame.kind() {
        FrameKind::Fd { brs, esi } => {
            plain += "10";
            if brs {
                brs_at = Some(plain.len());
            }
            plain += &digits(u32::from(brs), 1);
            plain += &digits(u32::from(esi), 1);
        }
        _ if frame.id().is_extended() => plain += "00",
        _ => plain += "0",
    }
    plain += &digits(u32::from(frame.dlc().value()), 4);
    for &byte in frame.data() {
        plain += &digits(u32::from(byte), 8);
    }

    let (mut text, dynamic, data_start);
    if frame.is_fd() {
        let (body, positions) = stuffed(&plain, false);
        dynamic = body.len() - plain.len();
        data_start = brs_at.map(|at| positions[at] + 1);
        let (width, polynomial) =
            if frame.data().len() > 16 { (21, 0x10_2899) } else { (17, 0x1_685B) };
        let count = ["000", "001", "011", "010", "110", "111", "101", "100"][dynamic % 8];
        let parity = count.matches('1').count() % 2;
        let count = format!("{count}{parity}");
        let crc = remainder(&format!("{body}{count}"), polynomial, width, 1 << (width - 1));
        let field = format!("{count}{}", digits(crc, width));
        text = body;
        for (i, bit) in field.chars().enumerate() {
            if i % 4 == 0 {
                let inverse = if text.ends_with('1') { '0' } else { '1' };
                text.push(inverse);
            }
            text.push(bit);
        }
    } else {
        let crc = remainder(&plain, 0x4599, 15, 0);
        plain += &digits(crc, 15);
        text = stuffed(&plain, true).0;
        dynamic = text.len() - plain.len();
        data_start = None;
    }
    text.push('1'); // CRC delimiter
    let data_phase = data_start.map_or(0..0, |start| start..text.len());
    text += "0"; // ACK
    text += "1"; // ACK delimiter
    text += "1111111"; // EOF
    Wire { bits: text.chars().map(|c| c == '1').collect(), data_phase, dynamic_stuff: dynamic }
}
