//! Parser of socketcand commands.

use ecan_protocol::can::{CanFrame, CanId, Dlc};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SocketcandCommand {
    /// `open NAME`.
    Open,
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
    #[error("not possible in this mode")]
    Mode,
    /// An invalid frame; it gets no answer.
    #[error("the frame is not sent")]
    Frame,
}

pub(super) fn parse(text: &str) -> Result<SocketcandCommand, CommandError> {
    let mut words = text.split_ascii_whitespace();
    let command = match words.next().ok_or(CommandError::Syntax)? {
        "open" => words.next().map(|_| SocketcandCommand::Open).ok_or(CommandError::NoBus)?,
        "rawmode" => SocketcandCommand::RawMode,
        "echo" => SocketcandCommand::Echo,
        "send" => return frame(words, data_frame),
        "sendrtr" => return frame(words, remote_frame),
        _ => return Err(CommandError::Unknown),
    };
    if words.next().is_some() { Err(CommandError::Syntax) } else { Ok(command) }
}

/// Returns whether a command, or its beginning, sends a frame.
pub(super) fn is_send(text: &[u8]) -> bool {
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
    CanFrame::remote(id, Dlc::new(words.next()?.parse().ok()?)?).ok()
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
