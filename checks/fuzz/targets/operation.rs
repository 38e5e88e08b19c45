//! A master and a gateway in OP: process data, mailboxes, requested states, registers and
//! pauses in any order. Each input begins with a copy of one line.
#![no_main]

#[path = "../support/line_check.rs"]
mod line_check;
#[path = "../../../ecan-sim/tests/wire_support/mod.rs"]
mod wire_support;

use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::{
    CRC_ALG_CCITT_FALSE, ChannelStatus, CommitFields, Header, HeaderFlags, ImageReader,
    ImageWriter, PdoProfile, Timestamp, VER_IHL, crc16,
};
use ecan_protocol::mapping::{CHANNELS, Direction, HEADER_BYTES};
use libfuzzer_sys::fuzz_target;
use line_check::{Bytes, check_counters, exchange, pass_raw};
use wire_support::{Datagram, Line, command};

const MS: u64 = 1_000_000;
const STATION: u16 = 0x1001;
const BYTES: usize = 384;

/// Objects of the data path, the channels, the commands and the mapping.
const OBJECTS: [u16; 16] = [
    0x8010, 0x8011, 0x8001, 0x8002, 0x8021, 0x8030, 0x1C12, 0x1C13, 0x1600, 0x1A00, 0x1C32, 0xF000,
    0x1010, 0x1011, 0x10F3, 0x10F1,
];

struct Machine {
    line: Line,
    writer: ImageWriter,
    reader: ImageReader,
}

thread_local! {
    static OP: Machine = {
        let mut line = Line::op();
        let mut profile = |object| {
            PdoProfile::from_word(line.upload(STATION, (object, 12))).expect("an active profile")
        };
        let writer = ImageWriter::new(Direction::RxPdo, profile(0x8011));
        let reader = ImageReader::new(Direction::TxPdo, profile(0x8010));
        Machine { line, writer, reader }
    };
}

impl Machine {
    fn try_clone(&self) -> Option<Self> {
        let (writer, reader) = (self.writer.clone(), self.reader.clone());
        Some(Self { line: self.line.try_clone()?, writer, reader })
    }

    fn send(&mut self, image: &[u8]) {
        let _ = exchange(&mut self.line, &[Datagram::logical(command::LWR, 0, image)]);
    }

    /// An image of valid frames.
    fn send_frames(&mut self, input: &mut Bytes<'_>) {
        let mut image = vec![0; BYTES];
        for _ in 0..input.byte() % 24 {
            let (kind, id) = (input.byte(), input.word());
            let id = if kind & 1 == 0 {
                CanId::standard(id & 0x7FF)
            } else {
                CanId::extended(u32::from(id) << 13 | u32::from(kind))
            };
            let Ok(id) = id else { continue };
            let data = input.take(usize::from(input.0.first().copied().unwrap_or(0) & 63));
            let frame = match CanFrame::classic(id, data) {
                Ok(frame) if kind & 2 == 0 => frame,
                _ => match CanFrame::fd(id, data, kind & 4 != 0, kind & 8 != 0) {
                    Ok(frame) => frame,
                    Err(_) => continue,
                },
            };
            let _ = self.writer.push(&mut image, kind >> 6, 0, frame.as_ref(), Timestamp::None);
        }
        self.writer.assume_dirty();
        self.writer.commit(&mut image, CommitFields::default());
        self.send(&image);
    }

    /// An image of any payload, with the CRC that belongs to it.
    fn send_payload(&mut self, input: &mut Bytes<'_>) {
        let (choice, frame_count) = (input.byte(), input.byte());
        let length = usize::from(input.byte()) + usize::from(choice & 1) * 105;
        let payload = input.take(length);
        let mut image = vec![0; BYTES];
        let sequence = self.writer.next_sequence().wrapping_add(u16::from(choice >> 4));
        let header = Header {
            ver_ihl: VER_IHL,
            seq_begin: sequence,
            seq_end: sequence,
            payload_len: payload.len() as u16,
            payload_crc16: crc16(payload) ^ u16::from(choice & 0x0E == 0x0E),
            layout_id: self.writer.profile().layout_id(),
            channel_mask: self.writer.profile().channel_mask,
            frame_count,
            crc_alg: CRC_ALG_CCITT_FALSE,
            flags: HeaderFlags::NONE,
            overflow_sat: 0,
            channel_status: [ChannelStatus::default(); CHANNELS],
        };
        self.writer.set_next_sequence(sequence.wrapping_add(1));
        let (head, area) = image.split_first_chunk_mut::<HEADER_BYTES>().expect("384 bytes");
        header.write(head);
        area[..payload.len()].copy_from_slice(payload);
        self.send(&image);
    }

    /// Reads the inputs. `is_configured`: their profile is that of the beginning.
    fn read_inputs(&mut self, is_configured: bool) {
        let inputs = Datagram::logical(command::LRD, BYTES as u32, &[0; BYTES]);
        let Some(back) = exchange(&mut self.line, &[inputs]) else { return };
        if back[0].counter == 1 && is_configured {
            let image = self.reader.read(&back[0].data).expect("an image of the gateway");
            for packet in image.packets() {
                assert!(packet.is_ok(), "{packet:?}");
            }
        }
    }

    fn write_mailbox(&mut self, protocol: u8, message: &[u8]) {
        let mut mailbox = vec![0; 128];
        let message = message.get(..122).unwrap_or(message);
        mailbox[..2].copy_from_slice(&(message.len() as u16).to_le_bytes());
        mailbox[5] = protocol;
        mailbox[6..6 + message.len()].copy_from_slice(message);
        let _ =
            exchange(&mut self.line, &[Datagram::new(command::FPWR, STATION, 0x1000, &mailbox)]);
    }

    fn read_mailbox(&mut self) {
        self.line.pass(MS);
        let _ =
            exchange(&mut self.line, &[Datagram::new(command::FPRD, STATION, 0x1080, &[0; 128])]);
    }

    /// An SDO request to one of the objects that matter.
    fn request_object(&mut self, input: &mut Bytes<'_>) {
        let (command, object, subindex) = (input.byte(), input.byte(), input.byte());
        let [low, high] = OBJECTS[usize::from(object % 16)].to_le_bytes();
        let mut message = vec![0x00, 0x20, command, low, high, subindex];
        message.extend(input.take(4));
        message.resize(10, 0);
        self.write_mailbox(3, &message);
        self.read_mailbox();
    }
}

fuzz_target!(|data: &[u8]| {
    let mut machine = OP.with(Machine::try_clone).expect("echo nodes can be copied");
    let mut input = Bytes(data);
    let mut is_configured = true;
    for _ in 0..48 {
        if input.0.is_empty() {
            break;
        }
        let kind = input.byte() % 12;
        is_configured &= kind < 6;
        match kind {
            0 | 1 => machine.send_frames(&mut input),
            2 => machine.send_payload(&mut input),
            3 => machine.read_inputs(is_configured),
            4 => machine.line.pass(MS),
            5 => machine.line.pass(u64::from(input.byte()).pow(2) * 10_000),
            6 => machine.request_object(&mut input),
            7 => {
                let (protocol, length) = (input.byte(), usize::from(input.byte() & 0x7F));
                machine.write_mailbox(protocol, input.take(length));
            }
            8 => machine.read_mailbox(),
            9 => {
                let state = input.byte();
                let request = Datagram::new(command::FPWR, STATION, 0x0120, &[state & 0x1F, 0]);
                let _ = exchange(&mut machine.line, &[request]);
            }
            10 => {
                let count = input.byte() % 3 + 1;
                let sent: Vec<_> = (0..count).map(|_| input.datagram()).collect();
                let _ = exchange(&mut machine.line, &sent);
            }
            _ => {
                let length = usize::from(input.byte());
                pass_raw(&mut machine.line, input.take(length));
            }
        }
    }
    check_counters(&machine.line);
});
