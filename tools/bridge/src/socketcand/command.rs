//! One command of socketcand, read.

use ecan_protocol::can::{CanFrame, CanId, Dlc};

/// What a client asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SocketcandCommand {
    /// `open NAME`.
    Open,
    /// `rawmode`.
    RawMode,
    /// `echo`.
    Echo,
    /// `send ID LENGTH BYTES`, `sendrtr ID DLC`.
    Send(CanFrame),
}

/// Why a command is refused, in the protocol's words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Refusal {
    #[error("unknown command")]
    Unknown,
    #[error("syntax error")]
    Syntax,
    #[error("bus name is missing")]
    NoBus,
    #[error("not possible in this mode")]
    Mode,
    /// Of a frame to send: these are not answered.
    #[error("the frame is not sent")]
    Frame,
}

/// Reads what stands between `<` and `>`.
pub(super) fn parse(text: &str) -> Result<SocketcandCommand, Refusal> {
    let mut words = text.split_ascii_whitespace();
    let command = match words.next().ok_or(Refusal::Syntax)? {
        "open" => words.next().map(|_| SocketcandCommand::Open).ok_or(Refusal::NoBus)?,
        "rawmode" => SocketcandCommand::RawMode,
        "echo" => SocketcandCommand::Echo,
        "send" => return frame(words, data_frame),
        "sendrtr" => return frame(words, remote_frame),
        _ => return Err(Refusal::Unknown),
    };
    if words.next().is_some() { Err(Refusal::Syntax) } else { Ok(command) }
}

/// Whether a command, or the beginning of one, is to send a frame.
pub(super) fn is_send(text: &[u8]) -> bool {
    let text = text.trim_ascii_start();
    text.starts_with(b"send ") || text.starts_with(b"sendrtr ")
}

/// A frame to send and nothing behind it.
fn frame<W: Iterator>(
    mut words: W,
    read: impl FnOnce(&mut W) -> Option<CanFrame>,
) -> Result<SocketcandCommand, Refusal> {
    let frame = read(&mut words).filter(|_| words.next().is_none());
    frame.map(SocketcandCommand::Send).ok_or(Refusal::Frame)
}

fn data_frame<'a>(words: &mut impl Iterator<Item = &'a str>) -> Option<CanFrame> {
    let id = identifier(words.next()?)?;
    let length: usize = words.next()?.parse().ok()?;
    let mut data = [0; 8];
    for byte in data.get_mut(..length)? {
        // Where bytes are signed, one from 80 on is written with the sign before it.
        *byte = lowest_digits(words.next()?)? as u8;
    }
    CanFrame::classic(id, data.get(..length)?).ok()
}

fn remote_frame<'a>(words: &mut impl Iterator<Item = &'a str>) -> Option<CanFrame> {
    let id = identifier(words.next()?)?;
    CanFrame::remote(id, Dlc::new(words.next()?.parse().ok()?)?).ok()
}

/// From eight digits up an identifier is an extended one. Bit 31 says the same in SocketCAN's
/// identifiers, and where they are signed further digits stand before it.
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
