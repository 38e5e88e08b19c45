//! A wire with gateways, and datagrams written by hand.
#![allow(dead_code, missing_docs)]

use ecan_sim::{Scenario, Wire, echo};

pub const MS: u64 = 1_000_000;

/// Commands of datagrams.
pub mod command {
    pub const APRD: u8 = 1;
    pub const APWR: u8 = 2;
    pub const APRW: u8 = 3;
    pub const FPRD: u8 = 4;
    pub const FPWR: u8 = 5;
    pub const FPRW: u8 = 6;
    pub const BRD: u8 = 7;
    pub const BWR: u8 = 8;
    pub const BRW: u8 = 9;
    pub const LRD: u8 = 10;
    pub const LWR: u8 = 11;
    pub const LRW: u8 = 12;
    pub const ARMW: u8 = 13;
    pub const FRMW: u8 = 14;
}
use command::*;

/// A datagram, sent or received.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Datagram {
    pub command: u8,
    pub slave: u16,
    pub offset: u16,
    pub data: Vec<u8>,
    pub events: u16,
    pub counter: u16,
}

impl Datagram {
    pub fn new(command: u8, slave: u16, offset: u16, data: &[u8]) -> Self {
        Self { command, slave, offset, data: data.to_vec(), events: 0, counter: 0 }
    }

    pub fn logical(command: u8, address: u32, data: &[u8]) -> Self {
        Self::new(command, address as u16, (address >> 16) as u16, data)
    }
}

pub fn encode(datagrams: &[Datagram]) -> Vec<u8> {
    let mut frame = vec![0xFF; 6];
    frame.extend([0x10, 0x10, 0x10, 0x10, 0x10, 0x10, 0x88, 0xA4, 0, 0]);
    for (nth, datagram) in datagrams.iter().enumerate() {
        let more = if nth + 1 < datagrams.len() { 0x8000 } else { 0 };
        frame.extend([datagram.command, nth as u8]);
        for word in [datagram.slave, datagram.offset, datagram.data.len() as u16 | more, 0] {
            frame.extend(word.to_le_bytes());
        }
        frame.extend(&datagram.data);
        frame.extend([0, 0]);
    }
    let length = (frame.len() - 16) as u16 | 1 << 12;
    frame[14..16].copy_from_slice(&length.to_le_bytes());
    frame
}

pub fn decode(frame: &[u8]) -> Vec<Datagram> {
    let word = |at: usize| u16::from_le_bytes([frame[at], frame[at + 1]]);
    let (mut at, mut datagrams) = (16, Vec::new());
    loop {
        let length = usize::from(word(at + 6) & 0x7FF);
        datagrams.push(Datagram {
            command: frame[at],
            slave: word(at + 2),
            offset: word(at + 4),
            data: frame[at + 10..at + 10 + length].to_vec(),
            events: word(at + 8),
            counter: word(at + 10 + length),
        });
        if word(at + 6) & 0x8000 == 0 {
            return datagrams;
        }
        at += 12 + length;
    }
}

/// A master that sends one datagram at a time.
pub struct Line {
    pub wire: Wire,
    pub now: u64,
}

impl Line {
    /// Gateways with echo nodes, booted.
    pub fn of(gateways: usize) -> Self {
        Self::with(&echo(gateways))
    }

    pub fn with(scenario: &Scenario) -> Self {
        let now = 1_000 * MS;
        let mut line = Self { wire: Wire::new(scenario, now).unwrap(), now };
        line.pass(1_000 * MS);
        line
    }

    /// A copy in the present state.
    pub fn try_clone(&self) -> Option<Self> {
        Some(Self { wire: self.wire.try_clone()?, now: self.now })
    }

    /// Gateways with the station addresses 0x1001 and up, in INIT.
    pub fn addressed(gateways: usize) -> Self {
        let mut line = Self::of(gateways);
        (0..gateways as u16).for_each(|position| line.address(position));
        line
    }

    /// Station addresses 0x1001 and up, mailboxes, PREOP.
    pub fn preop(gateways: usize) -> Self {
        let mut line = Self::addressed(gateways);
        for position in 0..gateways as u16 {
            line.set_up_mailboxes(0x1001 + position);
            line.request(0x1001 + position, 2);
            assert_eq!(line.state(0x1001 + position), (2, 0));
        }
        line
    }

    pub fn address(&mut self, position: u16) {
        let station = (0x1001 + position).to_le_bytes();
        assert_eq!(self.write(APWR, 0u16.wrapping_sub(position), 0x0010, &station), 1);
    }

    pub fn set_up_mailboxes(&mut self, station: u16) {
        let sync_managers =
            [0x00, 0x10, 0x80, 0, 0x26, 0, 1, 0, 0x80, 0x10, 0x80, 0, 0x22, 0, 1, 0];
        assert_eq!(self.write(FPWR, station, 0x0800, &sync_managers), 1);
    }

    pub fn request(&mut self, station: u16, state: u8) {
        assert_eq!(self.write(FPWR, station, 0x0120, &[state, 0]), 1);
    }

    /// AL status and its code.
    pub fn state(&mut self, station: u16) -> (u8, u16) {
        let (data, counter) = self.read(FPRD, station, 0x0130, 6);
        assert_eq!(counter, 1);
        (data[0], u16::from_le_bytes([data[4], data[5]]))
    }

    pub fn pass(&mut self, ns: u64) {
        self.now += ns;
        self.wire.advance(self.now);
    }

    /// Sends one frame; `None` if it does not come back.
    pub fn exchange(&mut self, datagrams: &[Datagram]) -> Option<Vec<Datagram>> {
        self.now += 10_000;
        let mut frame = encode(datagrams);
        self.wire.pass(self.now, &mut frame).then(|| decode(&frame))
    }

    pub fn one(&mut self, datagram: Datagram) -> Datagram {
        self.exchange(&[datagram]).expect("it comes back").remove(0)
    }

    pub fn read(&mut self, command: u8, slave: u16, offset: u16, bytes: usize) -> (Vec<u8>, u16) {
        let back = self.one(Datagram::new(command, slave, offset, &vec![0; bytes]));
        (back.data, back.counter)
    }

    pub fn write(&mut self, command: u8, slave: u16, offset: u16, data: &[u8]) -> u16 {
        self.one(Datagram::new(command, slave, offset, data)).counter
    }

    pub fn read_u64(&mut self, station: u16, offset: u16) -> u64 {
        u64::from_le_bytes(self.read(FPRD, station, offset, 8).0.try_into().unwrap())
    }

    /// Starts Sync0 of the first slave at this system time.
    pub fn start_sync0(&mut self, start: u64, cycle_ns: u32) {
        self.write(FPWR, 0x1001, 0x0980, &[0, 0]);
        assert_eq!(self.write(FPWR, 0x1001, 0x0990, &start.to_le_bytes()), 1);
        assert_eq!(self.write(FPWR, 0x1001, 0x09A0, &cycle_ns.to_le_bytes()), 1);
        assert_eq!(self.write(FPWR, 0x1001, 0x0980, &[0, 3]), 1);
    }

    pub fn read_u16(&mut self, station: u16, offset: u16) -> u16 {
        let (data, counter) = self.read(FPRD, station, offset, 2);
        assert_eq!(counter, 1);
        u16::from_le_bytes([data[0], data[1]])
    }

    /// Two words of the EEPROM.
    pub fn eeprom(&mut self, station: u16, word: u16) -> [u16; 2] {
        let [low, high] = word.to_le_bytes();
        assert_eq!(self.write(FPWR, station, 0x0502, &[0, 1, low, high]), 1);
        for _ in 0..100 {
            let (data, _) = self.read(FPRD, station, 0x0502, 10);
            if data[1] & 0x80 == 0 {
                assert_eq!(data[1] & 0x78, 0, "no error");
                return [6, 8].map(|at| u16::from_le_bytes([data[at], data[at + 1]]));
            }
        }
        panic!("busy for ever");
    }
}

// Mailbox and process data

const COE: u8 = 3;

impl Line {
    /// Sends a message through the mailbox; returns the response without its mailbox header.
    pub fn mailbox(&mut self, station: u16, protocol: u8, counter: u8, message: &[u8]) -> Vec<u8> {
        let mut mailbox = vec![0; 128];
        mailbox[..2].copy_from_slice(&(message.len() as u16).to_le_bytes());
        mailbox[5] = protocol | counter << 4;
        mailbox[6..6 + message.len()].copy_from_slice(message);
        assert_eq!(self.write(FPWR, station, 0x1000, &mailbox), 1);
        for _ in 0..1_000 {
            let (status, _) = self.read(FPRD, station, 0x080D, 1);
            if status[0] & 0x08 != 0 {
                let (answer, counter) = self.read(FPRD, station, 0x1080, 128);
                assert_eq!(counter, 1);
                let length = usize::from(u16::from_le_bytes([answer[0], answer[1]]));
                return answer[6..6 + length].to_vec();
            }
        }
        panic!("no answer");
    }

    /// Expedited download of 1, 2 or 4 bytes; returns the abort code if it is aborted.
    pub fn download(&mut self, station: u16, object: (u16, u8), data: &[u8]) -> Result<(), u32> {
        let command = 0x23 | ((4 - data.len()) as u8) << 2;
        let [low, high] = object.0.to_le_bytes();
        let mut message = vec![0x00, 0x20, command, low, high, object.1, 0, 0, 0, 0];
        message[6..6 + data.len()].copy_from_slice(data);
        let answer = self.mailbox(station, COE, 0, &message);
        match answer[2] {
            0x60 => Ok(()),
            0x80 => Err(u32::from_le_bytes(answer[6..10].try_into().unwrap())),
            other => panic!("command {other:#04x}"),
        }
    }

    /// Expedited upload.
    pub fn upload(&mut self, station: u16, object: (u16, u8)) -> u32 {
        let [low, high] = object.0.to_le_bytes();
        let message = [0x00, 0x20, 0x40, low, high, object.1, 0, 0, 0, 0];
        let answer = self.mailbox(station, COE, 0, &message);
        assert_eq!(answer[2] & 0xF2, 0x42, "expedited");
        let unused = usize::from(answer[2] >> 2 & 3);
        let mut value = [0; 4];
        value[..4 - unused].copy_from_slice(&answer[6..10 - unused]);
        u32::from_le_bytes(value)
    }

    pub fn assign(&mut self, station: u16, chunks: u8) {
        for (assignment, first) in [(0x1C12, 0x1600_u16), (0x1C13, 0x1A00)] {
            self.download(station, (assignment, 0), &[0]).unwrap();
            for chunk in 0..chunks {
                let map = (first + u16::from(chunk)).to_le_bytes();
                self.download(station, (assignment, chunk + 1), &map).unwrap();
            }
            self.download(station, (assignment, 0), &[chunks]).unwrap();
        }
    }

    /// A startup list with the assignment that the profiles need.
    pub fn configure(&mut self, station: u16, chunks: u8) {
        self.assign(station, chunks);
        for profile in [0x8010, 0x8011] {
            self.download(station, (profile, 3), &[chunks]).unwrap();
            self.download(station, (profile, 4), &[0x0F]).unwrap();
            self.download(station, (profile, 1), &[1]).unwrap();
            assert_eq!(self.upload(station, (profile, 2)), 0);
        }
        self.download(station, (0x8001, 15), &[0]).unwrap();
        self.download(station, (0x8001, 19), &500_000_u32.to_le_bytes()).unwrap();
        self.download(station, (0x8001, 1), &[1]).unwrap();
        assert_eq!(self.upload(station, (0x8001, 2)), 0);
    }

    /// SM2 and SM3, and FMMUs 0 and 1 that map them consecutively from `logical` on.
    pub fn map(&mut self, station: u16, chunks: u8, logical: u32) {
        let bytes = 128 * u16::from(chunks);
        let [low, high] = bytes.to_le_bytes();
        let sync_managers =
            [0x00, 0x11, low, high, 0x66, 0, 1, 0, 0x00, 0x1D, low, high, 0x22, 0, 1, 0];
        assert_eq!(self.write(FPWR, station, 0x0810, &sync_managers), 1);
        let mut fmmus = Vec::new();
        let parts = [(logical, 0x1100_u16, 2), (logical + u32::from(bytes), 0x1D00, 1)];
        for (logical, physical, direction) in parts {
            fmmus.extend(logical.to_le_bytes());
            fmmus.extend([low, high, 0, 7]);
            fmmus.extend(physical.to_le_bytes());
            fmmus.extend([0, direction, 1, 0, 0, 0]);
        }
        assert_eq!(self.write(FPWR, station, 0x0600, &fmmus), 1);
    }

    /// One gateway, N = 3, logical address 0, in OP.
    pub fn op() -> Self {
        let mut line = Self::preop(1);
        line.configure(0x1001, 3);
        line.map(0x1001, 3, 0);
        for state in [4, 8] {
            line.request(0x1001, state);
            assert_eq!(line.state(0x1001), (state, 0));
        }
        line
    }

    pub fn logical(&mut self, command: u8, address: u32, data: &[u8]) -> Datagram {
        self.one(Datagram::logical(command, address, data))
    }
}
