//! One command of socketcand, read.

use ecan_protocol::{CanFrame, CanId};

/// What a client asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SocketcandCommand {
    /// `open NAME`.
    Open,
    /// `rawmode`.
    RawMode,
    /// `echo`.
    Echo,
    /// `send ID LENGTH BYTES`.
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
    #[error("transmit queue is full")]
    Full,
}

/// Reads what stands between `<` and `>`.
pub(super) fn parse(text: &str) -> Result<SocketcandCommand, Refusal> {
    let mut words = text.split_ascii_whitespace();
    let command = match words.next().ok_or(Refusal::Syntax)? {
        "open" => words.next().map(|_| SocketcandCommand::Open).ok_or(Refusal::NoBus)?,
        "rawmode" => SocketcandCommand::RawMode,
        "echo" => SocketcandCommand::Echo,
        "send" => send(&mut words).ok_or(Refusal::Syntax)?,
        _ => return Err(Refusal::Unknown),
    };
    if words.next().is_some() { Err(Refusal::Syntax) } else { Ok(command) }
}

/// An identifier of three digits is a standard one, of eight an extended one.
fn send<'a>(words: &mut impl Iterator<Item = &'a str>) -> Option<SocketcandCommand> {
    let id = words.next()?;
    let is_extended = match id.len() {
        3 => false,
        8 => true,
        _ => return None,
    };
    let id = CanId::new(hex(id)?, is_extended).ok()?;
    let length = usize::try_from(hex(words.next()?)?).ok()?;
    let mut data = [0; 8];
    for byte in data.get_mut(..length)? {
        *byte = u8::try_from(hex(words.next()?)?).ok()?;
    }
    CanFrame::classic(id, data.get(..length)?).ok().map(SocketcandCommand::Send)
}

fn hex(word: &str) -> Option<u32> {
    let is_number = word.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_number.then(|| u32::from_str_radix(word, 16).ok())?
}
