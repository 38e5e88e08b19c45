//! socketcand: the ASCII protocol of the daemon of the same name, raw mode only.

use std::io::Write as _;

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameKind};

use super::config::Uplink;

#[cfg(test)]
mod tests;

const MAX_COMMAND: usize = 256;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Mode {
    NoBus,
    Opened,
    Raw,
}

/// The daemon of one client.
#[derive(Debug)]
pub(super) struct SocketcandSession {
    /// Name of the bus; `None` for every one.
    bus: Option<String>,
    /// Text since the last `<`; `None` outside a command.
    command: Option<Vec<u8>>,
    mode: Mode,
}

impl SocketcandSession {
    pub(crate) fn new(bus: Option<String>) -> Self {
        Self { bus, command: None, mode: Mode::NoBus }
    }

    pub(crate) fn greet(&self, answer: &mut Vec<u8>) {
        answer.extend(b"< hi >");
    }

    /// Processes input. Text outside `<` and `>` is ignored.
    pub(crate) fn feed(&mut self, bytes: &[u8], bus: &mut impl Uplink, answer: &mut Vec<u8>) {
        for &byte in bytes {
            match (byte, &mut self.command) {
                (b'<', command) => *command = Some(Vec::new()),
                (b'>', command) => {
                    if let Some(text) = command.take() {
                        self.command_ends(&text, bus, answer);
                    }
                }
                // One byte beyond the limit marks it as too long.
                (_, Some(text)) if text.len() <= MAX_COMMAND => text.push(byte),
                _ => {}
            }
        }
    }

    fn command_ends(&mut self, text: &[u8], bus: &mut impl Uplink, answer: &mut Vec<u8>) {
        let wrong = if is_send(text) { CommandError::Frame } else { CommandError::Syntax };
        let text = if text.len() > MAX_COMMAND { None } else { str::from_utf8(text).ok() };
        let command = text.ok_or(wrong).and_then(parse);
        let Err(error) = command.and_then(|command| self.run(command, bus, answer)) else {
            return;
        };
        bus.count_rejected();
        match error {
            // Clients expect a bus error, with class and time, as error of a frame.
            CommandError::Frame => bus.report_lost(),
            // infallible: writing to a vector
            _ => _ = write!(answer, "< error {error} >"),
        }
    }

    fn run(
        &mut self,
        command: SocketcandCommand,
        bus: &mut impl Uplink,
        answer: &mut Vec<u8>,
    ) -> Result<(), CommandError> {
        match command {
            SocketcandCommand::Open { name } if self.mode == Mode::NoBus => {
                if self.bus.as_ref().is_some_and(|bus| *bus != name) {
                    return Err(CommandError::UnknownBus);
                }
                self.mode = Mode::Opened;
            }
            SocketcandCommand::RawMode if self.mode == Mode::Opened => self.mode = Mode::Raw,
            SocketcandCommand::Echo => {
                answer.extend(b"< echo >");
                return Ok(());
            }
            // Sending has no answer. A full queue blocks the client.
            SocketcandCommand::Send(frame) if self.mode != Mode::NoBus => {
                if !bus.send(frame) {
                    bus.report_lost();
                }
                return Ok(());
            }
            _ => return Err(CommandError::Mode),
        }
        answer.extend(b"< ok >");
        Ok(())
    }

    /// Returns whether the client has opened a bus.
    pub(crate) fn is_open(&self) -> bool {
        self.mode != Mode::NoBus
    }

    /// Returns whether the client receives frames of the bus.
    pub(crate) fn is_raw(&self) -> bool {
        self.mode == Mode::Raw
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum SocketcandCommand {
    Open {
        name: String,
    },
    RawMode,
    Echo,
    /// `send ID LENGTH BYTES`, `sendrtr ID DLC`.
    Send(CanFrame),
}

/// Reason why a command is rejected, as text of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum CommandError {
    #[error("unknown command")]
    Unknown,
    #[error("syntax error")]
    Syntax,
    #[error("bus name is missing")]
    NoBus,
    #[error("could not open bus")]
    UnknownBus,
    #[error("not possible in this mode")]
    Mode,
    /// An invalid frame.
    #[error("the frame is not sent")]
    Frame,
}

fn parse(text: &str) -> Result<SocketcandCommand, CommandError> {
    let mut words = text.split_ascii_whitespace();
    let command = match words.next().ok_or(CommandError::Syntax)? {
        "open" => {
            let name = words.next().ok_or(CommandError::NoBus)?.to_owned();
            SocketcandCommand::Open { name }
        }
        "rawmode" => SocketcandCommand::RawMode,
        "echo" => SocketcandCommand::Echo,
        "send" => return frame(words, data_frame),
        "sendrtr" => return frame(words, remote_frame),
        _ => return Err(CommandError::Unknown),
    };
    if words.next().is_some() { Err(CommandError::Syntax) } else { Ok(command) }
}

/// Returns whether a command, or its beginning, sends a frame.
fn is_send(text: &[u8]) -> bool {
    let text = text.trim_ascii_start();
    text.starts_with(b"send ") || text.starts_with(b"sendrtr ")
}

/// Parses a frame to send, up to the end of the text.
fn frame<W: Iterator>(
    mut words: W,
    read: impl FnOnce(&mut W) -> Option<CanFrame>,
) -> Result<SocketcandCommand, CommandError> {
    let frame = read(&mut words).filter(|_| words.next().is_none());
    frame.map(SocketcandCommand::Send).ok_or(CommandError::Frame)
}

fn data_frame<'a>(words: &mut impl Iterator<Item = &'a str>) -> Option<CanFrame> {
    let id = identifier(words.next()?)?;
    let length: usize = words.next()?.parse().ok()?;
    let mut data = [0; 8];
    for byte in data.get_mut(..length)? {
        // If bytes are signed, values from 80 on have sign digits before them.
        *byte = lowest_digits(words.next()?)? as u8;
    }
    CanFrame::classic(id, data.get(..length)?).ok()
}

fn remote_frame<'a>(words: &mut impl Iterator<Item = &'a str>) -> Option<CanFrame> {
    let id = identifier(words.next()?)?;
    CanFrame::remote(id, Dlc::from_raw(words.next()?.parse().ok()?)?).ok()
}

/// An identifier with eight digits or more is extended. SocketCAN identifiers mark it with bit 31,
/// and signed ones have more digits before it.
fn identifier(word: &str) -> Option<CanId> {
    const EXTENDED_FLAG: u32 = 1 << 31;
    let is_extended = word.len() >= 8;
    CanId::new(lowest_digits(word)? & !EXTENDED_FLAG, is_extended).ok()
}

/// The lowest eight digits of a hexadecimal number of any length.
fn lowest_digits(word: &str) -> Option<u32> {
    let is_number = word.bytes().all(|byte| byte.is_ascii_hexdigit());
    let lowest = word.get(word.len().saturating_sub(8)..)?;
    is_number.then(|| u32::from_str_radix(lowest, 16).ok())?
}

/// Class of an error frame "transmission timed out" (`linux/can/error.h`).
const TX_TIMEOUT: u32 = 0x001;

/// Appends one error frame for each frame that was not sent.
pub(super) fn encode_losses(count: u64, time_ns: u64, text: &mut Vec<u8>) {
    (0..count).for_each(|_| encode_error(TX_TIMEOUT, time_ns, text));
}

/// Appends an error frame with its time in seconds.
pub(super) fn encode_error(class: u32, time_ns: u64, text: &mut Vec<u8>) {
    let (seconds, micros) = parts(time_ns);
    // infallible: writing to a vector
    let _ = write!(text, "< error {class:03X} {seconds}.{micros:06} >");
}

/// Seconds, and the microseconds after them.
fn parts(time_ns: u64) -> (u64, u64) {
    (time_ns / 1_000_000_000, time_ns / 1_000 % 1_000_000)
}

/// Appends a received classic frame with its time in seconds. Raw mode has no format for CAN FD.
pub(super) fn encode(frame: &CanFrame, time_ns: u64, text: &mut Vec<u8>) {
    let word = match frame.kind() {
        FrameKind::Data => "frame",
        FrameKind::Remote => "rtr",
        FrameKind::Fd { .. } => return,
    };
    let digits = if frame.id().is_extended() { 8 } else { 3 };
    let (seconds, micros) = parts(time_ns);
    let id = frame.id().raw();
    // infallible: writing to a vector
    let _ = write!(text, "< {word} {id:0digits$X} {seconds}.{micros:06} ");
    if frame.is_remote() {
        let _ = write!(text, "{}", frame.dlc().value());
    }
    for byte in frame.data() {
        let _ = write!(text, "{byte:02X}");
    }
    text.extend(b" >");
}
