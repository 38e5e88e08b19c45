//! State of an slcan adapter.

use ecan_protocol::can::{CanFrame, FrameKind};

use super::bit_rate::NamedRate;
use super::command::{MAX_LINE, SlcanCommand, UnknownCommand, parse};
use super::encode::{encode, hex};
use super::{BELL, OK};
use crate::bridge::rates::BusRates;
use crate::bridge::uplink::Uplink;

/// Hardware and software version, two digits each.
const VERSION: &[u8] = b"V1010";
/// Four characters, as Lawicel's have.
const SERIAL_NUMBER: &[u8] = b"NECAN";
/// Status flag "transmit queue full".
const FLAG_TRANSMIT_FULL: u32 = 1 << 1;
/// Status flag "bus error": a confirmed frame was lost.
const FLAG_BUS_ERROR: u32 = 1 << 7;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Mode {
    #[default]
    Closed,
    Listening,
    Open,
}

/// The adapter of one client.
///
/// A client cannot change the bit rates of the bus. With other bit rates than the bus it receives
/// nothing and cannot send, as on a real bus.
#[derive(Debug)]
pub(crate) struct SlcanSession {
    line: Vec<u8>,
    /// The line is too long; the rest of it is ignored.
    overlong: bool,
    receive_settings: SlcanReceiveSettings,
    /// Set since the flags were last read.
    flags: u32,
}

impl SlcanSession {
    pub(crate) fn new() -> Self {
        Self {
            line: Vec::with_capacity(MAX_LINE),
            overlong: false,
            receive_settings: SlcanReceiveSettings::default(),
            flags: 0,
        }
    }

    /// Processes input. Line feeds between lines are ignored.
    pub(crate) fn feed(&mut self, bytes: &[u8], bus: &mut impl Uplink, answer: &mut Vec<u8>) {
        for &byte in bytes {
            match byte {
                b'\r' => self.line_ends(bus, answer),
                b'\n' if self.line.is_empty() && !self.overlong => {}
                _ if self.line.len() < MAX_LINE => self.line.push(byte),
                _ => self.overlong = true,
            }
        }
    }

    fn line_ends(&mut self, bus: &mut impl Uplink, answer: &mut Vec<u8>) {
        let overlong = std::mem::take(&mut self.overlong);
        let command = if overlong { Err(UnknownCommand) } else { parse(&self.line) };
        self.line.clear();
        let done = command.is_ok_and(|command| self.run(command, bus, answer));
        if done {
            answer.push(OK);
        } else {
            bus.count_rejected();
            answer.push(BELL);
        }
    }

    /// Executes a command and appends the answer up to its end; returns false to reject it, without
    /// an answer.
    fn run(&mut self, command: SlcanCommand, bus: &mut impl Uplink, answer: &mut Vec<u8>) -> bool {
        use SlcanCommand as Command;
        let is_closed = self.receive_settings.mode == Mode::Closed;
        match command {
            Command::Nothing | Command::AutoPoll => return true,
            Command::Close => self.receive_settings.mode = Mode::Closed,
            Command::Version => answer.extend(VERSION),
            Command::SerialNumber => answer.extend(SERIAL_NUMBER),
            Command::Flags if !is_closed => {
                if bus.take_lost() {
                    self.flags |= FLAG_BUS_ERROR;
                }
                answer.push(b'F');
                hex(std::mem::take(&mut self.flags), 2, answer);
            }
            Command::Transmit(frame) if self.receive_settings.mode == Mode::Open => {
                return self.transmit(frame, bus, answer);
            }
            // Harmless, as closing a closed channel: python-can does both.
            Command::Open if self.receive_settings.mode == Mode::Open => {}
            Command::OpenListening if self.receive_settings.mode == Mode::Listening => {}
            // Everything else requires a closed channel.
            _ if !is_closed => return false,
            Command::Open => self.receive_settings.mode = Mode::Open,
            Command::OpenListening => self.receive_settings.mode = Mode::Listening,
            Command::Bitrate(bitrate) => self.receive_settings.bitrate = Some(bitrate),
            Command::DataBitrate(bitrate) => self.receive_settings.data_bitrate = Some(bitrate),
            Command::Timestamps(wanted) => self.receive_settings.timestamps = wanted,
            Command::AcceptAll => {}
            Command::Flags | Command::Transmit(_) => return false,
        }
        true
    }

    fn transmit(&mut self, frame: CanFrame, bus: &mut impl Uplink, answer: &mut Vec<u8>) -> bool {
        if bus.bus().is_some_and(|config| !self.receive_settings.fits(&frame, &config)) {
            bus.count_mismatched();
            return false;
        }
        if !bus.send(frame) {
            self.flags |= FLAG_TRANSMIT_FULL;
            return false;
        }
        answer.push(if frame.id().is_extended() { b'Z' } else { b'z' });
        true
    }

    /// Returns whether the channel is open, also for listening only.
    pub(crate) fn is_open(&self) -> bool {
        self.receive_settings.mode != Mode::Closed
    }

    pub(crate) fn receive_settings(&self) -> SlcanReceiveSettings {
        self.receive_settings
    }
}

/// Channel settings: they select the frames that pass between the client and the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct SlcanReceiveSettings {
    mode: Mode,
    bitrate: Option<NamedRate>,
    data_bitrate: Option<NamedRate>,
    timestamps: bool,
}

impl SlcanReceiveSettings {
    fn fits(&self, frame: &CanFrame, bus: &BusRates) -> bool {
        let shares = |named: Option<NamedRate>, real| named.is_none_or(|named| named.fits(real));
        let is_fast = matches!(frame.kind(), FrameKind::Fd { brs: true, .. });
        shares(self.bitrate, bus.nominal_bitrate)
            && (bus.fd || !frame.is_fd())
            && (!is_fast || shares(self.data_bitrate, bus.data_bitrate))
    }

    /// Appends a frame of the bus if the channel is open and the bit rates match.
    pub(crate) fn encode(
        &self,
        frame: &CanFrame,
        time_ns: u64,
        bus: Option<BusRates>,
        text: &mut Vec<u8>,
    ) {
        let receives = bus.is_none_or(|config| self.fits(frame, &config));
        if self.mode != Mode::Closed && receives {
            encode(frame, self.timestamps.then_some(time_ns), text);
        }
    }
}
