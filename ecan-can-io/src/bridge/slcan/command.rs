//! Parser of slcan lines.

use ecan_protocol::can::{CanFrame, CanId, Dlc};

use super::bit_rate::{self, NamedRate};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SlcanCommand {
    /// An empty line, which clients send to discard an incomplete command.
    Nothing,
    /// `Sn`, `sxxyy`: bit rate of the arbitration phase.
    Bitrate(NamedRate),
    /// `Yn`: bit rate of the data phase.
    DataBitrate(NamedRate),
    Open,
    OpenListening,
    Close,
    /// A frame to send.
    Transmit(CanFrame),
    /// `F`: status flags.
    Flags,
    /// `V`, and `v` on some adapters.
    Version,
    SerialNumber,
    /// `Zn`: whether received frames have a timestamp.
    Timestamps(bool),
    /// `X1`: send received frames at once, which is always the case.
    AutoPoll,
    /// `Mxxxxxxxx`, `mFFFFFFFF`: an acceptance filter that passes all frames.
    AcceptAll,
}

/// The line is not a supported command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct UnknownCommand;

/// The longest command: an extended CAN FD frame of 64 bytes.
pub(super) const MAX_LINE: usize = 1 + 8 + 1 + 2 * 64;

const EXTENDED_BITS: u32 = 0x1FFF_FFFF;

pub(super) fn parse(line: &[u8]) -> Result<SlcanCommand, UnknownCommand> {
    use SlcanCommand as Command;
    let Some((&letter, arguments)) = line.split_first() else { return Ok(Command::Nothing) };
    let fd = |brs| Format::Fd { brs };
    match letter {
        b't' => transmit(arguments, false, Format::Classic),
        b'T' => transmit(arguments, true, Format::Classic),
        b'r' => transmit(arguments, false, Format::Remote),
        b'R' => transmit(arguments, true, Format::Remote),
        b'd' => transmit(arguments, false, fd(false)),
        b'D' => transmit(arguments, true, fd(false)),
        b'b' => transmit(arguments, false, fd(true)),
        b'B' => transmit(arguments, true, fd(true)),
        b'S' => digit(arguments).and_then(bit_rate::standard).map(Command::Bitrate),
        b's' => number(arguments, 4).map(|registers| {
            let [_, _, btr0, btr1] = registers.to_be_bytes();
            Command::Bitrate(NamedRate::exactly(bit_rate::of_registers(btr0, btr1)))
        }),
        b'Y' => digit(arguments)
            .and_then(bit_rate::data)
            .map(NamedRate::exactly)
            .map(Command::DataBitrate),
        b'Z' => match arguments {
            b"0" => Some(Command::Timestamps(false)),
            b"1" => Some(Command::Timestamps(true)),
            _ => None,
        },
        b'X' => (arguments == b"1").then_some(Command::AutoPoll),
        b'M' => number(arguments, 8).map(|_| Command::AcceptAll),
        b'm' => (number(arguments, 8) == Some(u32::MAX)).then_some(Command::AcceptAll),
        _ if !arguments.is_empty() => None,
        b'O' => Some(Command::Open),
        b'L' => Some(Command::OpenListening),
        b'C' => Some(Command::Close),
        b'F' => Some(Command::Flags),
        b'V' | b'v' => Some(Command::Version),
        b'N' => Some(Command::SerialNumber),
        _ => None,
    }
    .ok_or(UnknownCommand)
}

#[derive(Clone, Copy)]
enum Format {
    Classic,
    Remote,
    Fd { brs: bool },
}

fn transmit(arguments: &[u8], extended: bool, format: Format) -> Option<SlcanCommand> {
    let digits = if extended { 8 } else { 3 };
    let (id, rest) = arguments.split_at_checked(digits)?;
    let id = number(id, digits)?;
    // Some clients leave SocketCAN's flags in extended identifiers.
    let id = if extended { id & EXTENDED_BITS } else { id };
    let id = CanId::new(id, extended).ok()?;
    let (&code, hex) = rest.split_first()?;
    let dlc = Dlc::new(hex_digit(code)?)?;
    if !matches!(format, Format::Fd { .. }) && dlc.value() > 8 {
        return None;
    }
    let mut data = [0; 64];
    let data = bytes(hex, &mut data)?;
    let frame = match format {
        Format::Remote if data.is_empty() => CanFrame::remote(id, dlc),
        Format::Classic if data.len() == dlc.classic_len() => CanFrame::classic(id, data),
        Format::Fd { brs } if data.len() == dlc.fd_len() => CanFrame::fd(id, data, brs, false),
        _ => return None,
    };
    frame.ok().map(SlcanCommand::Transmit)
}

fn digit(text: &[u8]) -> Option<u8> {
    match text {
        [digit @ b'0'..=b'9'] => Some(digit - b'0'),
        _ => None,
    }
}

/// A number with exactly this many hexadecimal digits, at most eight.
fn number(text: &[u8], digits: usize) -> Option<u32> {
    if text.len() != digits {
        return None;
    }
    text.iter().try_fold(0, |value, &digit| Some(value << 4 | u32::from(hex_digit(digit)?)))
}

fn bytes<'a>(hex: &[u8], store: &'a mut [u8; 64]) -> Option<&'a [u8]> {
    let length = hex.len() / 2;
    if !hex.len().is_multiple_of(2) || length > store.len() {
        return None;
    }
    for (byte, pair) in store.iter_mut().zip(hex.chunks_exact(2)) {
        *byte = u8::try_from(number(pair, 2)?).ok()?;
    }
    store.get(..length)
}

fn hex_digit(digit: u8) -> Option<u8> {
    char::from(digit).to_digit(16).map(|value| value as u8)
}
