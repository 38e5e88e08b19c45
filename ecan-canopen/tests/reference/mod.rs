//! An SDO server written from the tables of CiA 301, 7.2.4.3, byte by byte, without the crates'
//! own encoders. It answers each request with the frames that go back.
#![allow(dead_code)]

use std::collections::BTreeMap;

pub type Frame = [u8; 8];

/// How block transfer is supported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Block {
    /// With CRC.
    Checked,
    /// Without CRC.
    Unchecked,
    /// Rejected with this abort code.
    Rejected(u32),
    /// Uploads answered by a segmented transfer, downloads rejected as unknown.
    Segmented,
    /// Not answered at all.
    Ignored,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum State {
    Idle,
    Upload { data: Vec<u8>, position: usize, toggle: u8 },
    Download { key: (u16, u8), data: Vec<u8>, size: Option<usize>, toggle: u8 },
    BlockUpload { data: Vec<u8>, position: usize, in_block: usize, size: u8, is_closing: bool },
    BlockDownload { key: (u16, u8), data: Vec<u8>, size: usize, last: u8, is_whole: bool },
}

#[derive(Debug)]
pub struct Server {
    pub objects: BTreeMap<(u16, u8), Vec<u8>>,
    /// Rejections by object: the abort code.
    pub rejected: BTreeMap<(u16, u8), u32>,
    pub block: Block,
    /// Segments per block of a download.
    pub block_size: u8,
    /// True if the server reports the sizes of uploads.
    pub tells_size: bool,
    /// Abort codes that the client sent.
    pub aborts: Vec<u32>,
    /// Requests received, the first byte of each.
    pub commands: Vec<u8>,
    state: State,
}

impl Server {
    pub fn new(block: Block) -> Self {
        Self {
            objects: BTreeMap::new(),
            rejected: BTreeMap::new(),
            block,
            block_size: 127,
            tells_size: true,
            aborts: Vec::new(),
            commands: Vec::new(),
            state: State::Idle,
        }
    }

    pub fn with(mut self, index: u16, subindex: u8, value: &[u8]) -> Self {
        self.objects.insert((index, subindex), value.to_vec());
        self
    }

    pub fn value(&self, index: u16, subindex: u8) -> &[u8] {
        self.objects.get(&(index, subindex)).map_or(&[], Vec::as_slice)
    }

    /// It has been silent for long: in the middle of a block the server acknowledges what it has.
    pub fn nudge(&mut self) -> Vec<Frame> {
        match &mut self.state {
            State::BlockDownload { last: last @ 1.., is_whole: false, .. } => {
                let answer = [0xA2, *last, self.block_size, 0, 0, 0, 0, 0];
                *last = 0;
                vec![answer]
            }
            _ => Vec::new(),
        }
    }

    pub fn request(&mut self, frame: Frame) -> Vec<Frame> {
        // In a block download a first byte of 1 to 0x7F, or with bit 7 for the last, is a segment.
        if let State::BlockDownload { is_whole: false, .. } = self.state
            && frame[0] & 0x7F != 0
        {
            return self.segment_of_block(frame);
        }
        self.commands.push(frame[0]);
        let key = (u16::from_le_bytes([frame[1], frame[2]]), frame[3]);
        match frame[0] {
            0x80 => {
                self.aborts.push(u32::from_le_bytes(frame[4..].try_into().unwrap()));
                self.state = State::Idle;
                Vec::new()
            }
            0x40 => self.upload(key),
            0x60 | 0x70 => self.upload_segment(frame[0] & 0x10),
            0x20..=0x2F => self.download(key, frame),
            0x00..=0x1F => self.download_segment(frame),
            0xA0 | 0xA4 => self.block_upload(key, frame),
            0xA3 => self.send_block(),
            0xA2 => self.block_acknowledged(frame),
            0xA1 => {
                self.state = State::Idle;
                Vec::new()
            }
            0xC0 | 0xC2 | 0xC4 | 0xC6 => self.block_download(key, frame),
            0xC1..=0xDD if frame[0] & 3 == 1 => self.end_of_block_download(frame),
            _ => vec![abort((0, 0), 0x0504_0001)],
        }
    }

    fn upload(&mut self, key: (u16, u8)) -> Vec<Frame> {
        if let Some(code) = self.rejected.get(&key) {
            return vec![abort(key, *code)];
        }
        let Some(data) = self.objects.get(&key).cloned() else {
            return vec![abort(key, 0x0602_0000)];
        };
        let [low, high] = key.0.to_le_bytes();
        let mut answer = [0, low, high, key.1, 0, 0, 0, 0];
        if (1..=4).contains(&data.len()) {
            answer[0] = if self.tells_size { 0x43 | (4 - data.len() as u8) << 2 } else { 0x42 };
            answer[4..4 + data.len()].copy_from_slice(&data);
            self.state = State::Idle;
        } else {
            if self.tells_size {
                answer[0] = 0x41;
                answer[4..].copy_from_slice(&(data.len() as u32).to_le_bytes());
            } else {
                answer[0] = 0x40;
            }
            self.state = State::Upload { data, position: 0, toggle: 0 };
        }
        vec![answer]
    }

    fn upload_segment(&mut self, toggled: u8) -> Vec<Frame> {
        let State::Upload { data, position, toggle } = &mut self.state else {
            return vec![abort((0, 0), 0x0504_0001)];
        };
        if toggled != *toggle {
            self.state = State::Idle;
            return vec![abort((0, 0), 0x0503_0000)];
        }
        let length = (data.len() - *position).min(7);
        let is_last = *position + length == data.len();
        let mut answer = [0; 8];
        answer[0] = *toggle | (7 - length as u8) << 1 | u8::from(is_last);
        answer[1..=length].copy_from_slice(&data[*position..*position + length]);
        *position += length;
        *toggle ^= 0x10;
        if is_last {
            self.state = State::Idle;
        }
        vec![answer]
    }

    fn download(&mut self, key: (u16, u8), frame: Frame) -> Vec<Frame> {
        if let Some(code) = self.rejected.get(&key) {
            return vec![abort(key, *code)];
        }
        if frame[0] & 2 != 0 {
            let length = if frame[0] & 1 != 0 { 4 - usize::from(frame[0] >> 2 & 3) } else { 4 };
            self.objects.insert(key, frame[4..4 + length].to_vec());
            self.state = State::Idle;
        } else {
            let size = u32::from_le_bytes(frame[4..].try_into().unwrap()) as usize;
            let size = (frame[0] & 1 != 0).then_some(size);
            self.state = State::Download { key, data: Vec::new(), size, toggle: 0 };
        }
        vec![[0x60, frame[1], frame[2], frame[3], 0, 0, 0, 0]]
    }

    fn download_segment(&mut self, frame: Frame) -> Vec<Frame> {
        let State::Download { key, data, size, toggle } = &mut self.state else {
            return vec![abort((0, 0), 0x0504_0001)];
        };
        if frame[0] & 0x10 != *toggle {
            self.state = State::Idle;
            return vec![abort((0, 0), 0x0503_0000)];
        }
        let length = 7 - usize::from(frame[0] >> 1 & 7);
        data.extend_from_slice(&frame[1..=length]);
        let answer = [0x20 | *toggle, 0, 0, 0, 0, 0, 0, 0];
        *toggle ^= 0x10;
        if frame[0] & 1 != 0 {
            if size.is_some_and(|size| size != data.len()) {
                let key = *key;
                self.state = State::Idle;
                return vec![abort(key, 0x0607_0010)];
            }
            self.objects.insert(*key, std::mem::take(data));
            self.state = State::Idle;
        }
        vec![answer]
    }

    fn rejects_block(&mut self, key: (u16, u8)) -> Option<Vec<Frame>> {
        match self.block {
            Block::Rejected(code) => Some(vec![abort(key, code)]),
            Block::Ignored => Some(Vec::new()),
            _ => self.rejected.get(&key).map(|code| vec![abort(key, *code)]),
        }
    }

    fn crc_bit(&self) -> u8 {
        if self.block == Block::Checked { 4 } else { 0 }
    }

    fn block_upload(&mut self, key: (u16, u8), frame: Frame) -> Vec<Frame> {
        if let Some(answer) = self.rejects_block(key) {
            return answer;
        }
        let (size, threshold) = (frame[4], usize::from(frame[5]));
        if !(1..=127).contains(&size) {
            return vec![abort(key, 0x0504_0002)];
        }
        let Some(data) = self.objects.get(&key).cloned() else {
            return vec![abort(key, 0x0602_0000)];
        };
        if self.block == Block::Segmented || data.len() <= threshold {
            return self.upload(key);
        }
        let length = data.len() as u32;
        self.state = State::BlockUpload { data, position: 0, in_block: 0, size, is_closing: false };
        let mut answer = [0xC0 | self.crc_bit(), frame[1], frame[2], frame[3], 0, 0, 0, 0];
        if self.tells_size {
            answer[0] |= 2;
            answer[4..].copy_from_slice(&length.to_le_bytes());
        }
        vec![answer]
    }

    fn send_block(&mut self) -> Vec<Frame> {
        let State::BlockUpload { data, position, in_block, size, is_closing } = &mut self.state
        else {
            return vec![abort((0, 0), 0x0504_0001)];
        };
        *is_closing = false;
        *in_block = 0;
        let mut frames = Vec::new();
        let mut at = *position;
        for number in 1..=*size {
            let length = (data.len() - at).min(7);
            let mut segment = [0; 8];
            segment[1..=length].copy_from_slice(&data[at..at + length]);
            at += length;
            let is_last = at == data.len();
            segment[0] = number | if is_last { 0x80 } else { 0 };
            frames.push(segment);
            *in_block += 1;
            if is_last {
                break;
            }
        }
        frames
    }

    fn block_acknowledged(&mut self, frame: Frame) -> Vec<Frame> {
        if !(1..=127).contains(&frame[2]) {
            self.state = State::Idle;
            return vec![abort((0, 0), 0x0504_0002)];
        }
        let crc_is_used = self.crc_bit() != 0;
        let State::BlockUpload { data, position, in_block, size, is_closing } = &mut self.state
        else {
            return vec![abort((0, 0), 0x0504_0001)];
        };
        let acknowledged = usize::from(frame[1]);
        if acknowledged > *in_block {
            self.state = State::Idle;
            return vec![abort((0, 0), 0x0504_0003)];
        }
        *position = (*position + acknowledged * 7).min(data.len());
        *size = frame[2];
        *in_block = 0;
        if *position < data.len() {
            return self.send_block();
        }
        *is_closing = true;
        let unused = (7 - data.len() % 7) % 7;
        let [low, high] = if crc_is_used { crc(data).to_le_bytes() } else { [0, 0] };
        vec![[0xC1 | (unused as u8) << 2, low, high, 0, 0, 0, 0, 0]]
    }

    fn block_download(&mut self, key: (u16, u8), frame: Frame) -> Vec<Frame> {
        if self.block == Block::Segmented {
            return vec![abort(key, 0x0504_0001)];
        }
        if let Some(answer) = self.rejects_block(key) {
            return answer;
        }
        if frame[0] & 2 == 0 {
            return vec![abort(key, 0x0607_0010)];
        }
        let size = u32::from_le_bytes(frame[4..].try_into().unwrap()) as usize;
        self.state = State::BlockDownload { key, data: Vec::new(), size, last: 0, is_whole: false };
        let crc = self.crc_bit();
        vec![[0xA0 | crc, frame[1], frame[2], frame[3], self.block_size, 0, 0, 0]]
    }

    fn segment_of_block(&mut self, frame: Frame) -> Vec<Frame> {
        let block_size = self.block_size;
        let State::BlockDownload { data, last, is_whole, .. } = &mut self.state else {
            unreachable!()
        };
        let (number, is_last) = (frame[0] & 0x7F, frame[0] & 0x80 != 0);
        let in_order = number == *last + 1;
        if in_order {
            data.extend_from_slice(&frame[1..]);
            *last = number;
        }
        if number < block_size && !is_last {
            return Vec::new();
        }
        *is_whole = is_last && in_order;
        let answer = [0xA2, *last, block_size, 0, 0, 0, 0, 0];
        *last = 0;
        vec![answer]
    }

    fn end_of_block_download(&mut self, frame: Frame) -> Vec<Frame> {
        let crc_is_used = self.crc_bit() != 0;
        let State::BlockDownload { key, data, size, is_whole: true, .. } = &mut self.state else {
            return vec![abort((0, 0), 0x0504_0001)];
        };
        data.truncate(data.len() - usize::from(frame[0] >> 2 & 7));
        let sum = u16::from_le_bytes([frame[1], frame[2]]);
        let (key, size, data) = (*key, *size, std::mem::take(data));
        self.state = State::Idle;
        if data.len() != size {
            return vec![abort(key, 0x0607_0010)];
        }
        if crc_is_used && sum != crc(&data) {
            return vec![abort(key, 0x0504_0004)];
        }
        self.objects.insert(key, data);
        vec![[0xA1, 0, 0, 0, 0, 0, 0, 0]]
    }
}

pub fn abort(key: (u16, u8), code: u32) -> Frame {
    let [low, high] = key.0.to_le_bytes();
    let [a, b, c, d] = code.to_le_bytes();
    [0x80, low, high, key.1, a, b, c, d]
}

/// CRC-16 of block transfer, bit by bit: x^16 + x^12 + x^5 + 1, from 0.
pub fn crc(data: &[u8]) -> u16 {
    data.iter().fold(0, |sum, byte| {
        (0..8).fold(sum ^ u16::from(*byte) << 8, |sum, _| {
            if sum & 0x8000 != 0 { sum << 1 ^ 0x1021 } else { sum << 1 }
        })
    })
}

#[test]
fn reference_crc_matches_cia_301() {
    // The check value of CRC-16/XMODEM.
    assert_eq!(crc(b"123456789"), 0x31C3);
}
