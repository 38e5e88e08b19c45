//! Logs of Vector (ASC).
//!
//! ```text
//! header   base hex|dec  timestamps absolute|relative
//! classic  time channel id[x] Rx|Tx|TxRq d dlc data ... [ID = number[x]]
//! remote   time channel id[x] Rx|Tx|TxRq r [dlc] ... [ID = number[x]]
//! FD       time CANFD channel Rx|Tx id[x] [name] brs esi dlc length data duration bits flags ...
//! error    time channel ErrorFrame ... | time CANFD channel Rx|Tx ErrorFrame ...
//! ```
//!
//! Times are seconds. Other lines are events. A CAN ID ends in `x` if it is extended; the field
//! `ID = `, in decimal, replaces a symbolic name. Bit 12 of the flags is FDF, bit 4 RTR: the FD form
//! also describes classic frames.

use ecan_protocol::can::{CanFrame, CanId, Dlc};

use super::records::{
    FieldResult, Fields, Format, Item, Recording, RecordingErrorKind, classic, interface, invalid,
    number, remote, signed, time_ns,
};

/// Digits of a second in nanoseconds.
const SECOND_DIGITS: u32 = 9;
const FLAG_RTR: u32 = 1 << 4;
const FLAG_FDF: u32 = 1 << 12;
const CLASSIC_BYTES: usize = 8;
const CAN_ID: &str = "000 to 7FF, or 0x to 1FFFFFFFx";
const DIRECTION: &str = "Rx, Tx or TxRq";

pub fn parse(text: &str) -> Recording {
    let (mut radix, mut is_relative, mut now_ns) = (16, false, 0_i64);
    Recording::of_lines(Format::Asc, text, |text| {
        let mut fields = Fields::new(text);
        let Some(first) = fields.next() else { return Ok(Item::Nothing) };
        if first.eq_ignore_ascii_case("base") {
            radix = fields.parse("base", "hex or dec", radix_of)?;
            is_relative =
                fields.clone().next().is_some_and(|text| text.eq_ignore_ascii_case("timestamps"))
                    && text.trim_end().to_ascii_lowercase().ends_with("relative");
        }
        let digits = first.strip_prefix('-');
        let time_ns = time_ns(digits.unwrap_or(first), SECOND_DIGITS);
        let Some(time_ns) = time_ns.filter(|_| first.contains('.')) else {
            return Ok(Item::Nothing);
        };
        let time_ns = signed(time_ns)?;
        // Events before the trigger have times below 0.
        let time_ns = if digits.is_some() { -time_ns } else { time_ns };
        // Relative times count from the event before, also from one without a frame.
        now_ns = match is_relative {
            true => now_ns.checked_add(time_ns).ok_or(RecordingErrorKind::TimeRange)?,
            false => time_ns,
        };
        item(&mut fields, radix, now_ns)
    })
}

fn radix_of(text: &str) -> Option<u32> {
    match text.to_ascii_lowercase().as_str() {
        "hex" => Some(16),
        "dec" => Some(10),
        _ => None,
    }
}

/// Parses what follows the time.
fn item(fields: &mut Fields<'_>, radix: u32, time_ns: i64) -> FieldResult<Item> {
    match fields.peek() {
        Some("CANFD") => {
            fields.next();
            fd_item(fields, time_ns)
        }
        Some("CANXL") => Err(RecordingErrorKind::CanXl),
        Some(channel) if number(channel, 10).is_some() => classic_item(fields, radix, time_ns),
        _ => Ok(Item::Event),
    }
}

fn classic_item(fields: &mut Fields<'_>, radix: u32, time_ns: i64) -> FieldResult<Item> {
    let interface = fields.parse("channel", "a number, from 1", interface)?;
    let name = fields.take("CAN ID", CAN_ID)?;
    if is_error_frame(name) {
        return Ok(Item::ErrorFrame);
    }
    match fields.peek() {
        Some("Rx" | "Tx") => fields.next(),
        // The request of a frame; its transmission is another line.
        Some("TxRq") => return Ok(Item::Event),
        _ if can_id(name, radix).is_none() => return Ok(Item::Event),
        _ => return fields.parse("direction", DIRECTION, |_| None),
    };
    let given = id_field(fields.clone());
    let id =
        given.or_else(|| can_id(name, radix)).ok_or_else(|| invalid("CAN ID", name, CAN_ID))?;
    let frame = match fields.take("kind of frame", "d or r")? {
        "d" | "D" => {
            let dlc = fields.parse("DLC", "a hex digit", dlc)?;
            classic(fields, id, dlc, radix)?
        }
        "r" | "R" => remote(id, fields.peek().and_then(dlc).map_or(0, Dlc::value))?,
        other => return Err(invalid("kind of frame", other, "d or r")),
    };
    Ok(Item::Frame { time_ns, interface, frame })
}

fn fd_item(fields: &mut Fields<'_>, time_ns: i64) -> FieldResult<Item> {
    let interface = fields.parse("channel", "a number, from 1", interface)?;
    match fields.take("direction", DIRECTION)? {
        "Rx" | "Tx" => {}
        "TxRq" => return Ok(Item::Event),
        other => return Err(invalid("direction", other, DIRECTION)),
    }
    let name = fields.take("CAN ID", CAN_ID)?;
    if is_error_frame(name) {
        return Ok(Item::ErrorFrame);
    }
    let id = can_id(name, 16).ok_or_else(|| invalid("CAN ID", name, CAN_ID))?;
    if fields.peek().is_some_and(|field| bit(field).is_none()) {
        // The symbolic name of the message.
        fields.next();
    }
    let brs = fields.parse("bit rate switch", "0 or 1", bit)?;
    let esi = fields.parse("error state indicator", "0 or 1", bit)?;
    let dlc = fields.parse("DLC", "a hex digit", dlc)?;
    let is_length = |text: &str| number(text, 10).filter(|length| *length <= 64);
    let length = fields.parse("data length", "0 to 64", is_length)? as usize;
    let mut buffer = [0; 64];
    let data = fields.data(buffer.get_mut(..length).unwrap_or_default(), 16)?;
    // After duration and number of bits.
    let flags = {
        fields.next();
        fields.next();
        fields.next().map_or(Some(FLAG_FDF), |text| number(text, 16)).unwrap_or(FLAG_FDF)
    };
    let mismatch = RecordingErrorKind::LengthMismatch { length, dlc: dlc.value() };
    // Some programs write no flags.
    let is_fd = flags & FLAG_FDF != 0 || brs || esi || length > CLASSIC_BYTES;
    let frame = if is_fd && dlc.fd_len() == length {
        CanFrame::fd(id, data, brs, esi).map_err(|_| mismatch)?
    } else if !is_fd && flags & FLAG_RTR != 0 {
        remote(id, dlc.value())?
    } else if !is_fd && dlc.classic_len() == length {
        CanFrame::classic(id, data).map_err(|_| mismatch)?
    } else {
        return Err(mismatch);
    };
    Ok(Item::Frame { time_ns, interface, frame })
}

fn is_error_frame(text: &str) -> bool {
    text.get(..10).is_some_and(|text| text.eq_ignore_ascii_case("ErrorFrame"))
}

fn bit(text: &str) -> Option<bool> {
    match text {
        "0" => Some(false),
        "1" => Some(true),
        _ => None,
    }
}

fn dlc(text: &str) -> Option<Dlc> {
    number(text, 16).and_then(|value| Dlc::from_raw(value.try_into().ok()?))
}

fn can_id(text: &str, radix: u32) -> Option<CanId> {
    let digits = text.strip_suffix(['x', 'X']);
    let is_extended = digits.is_some();
    let digits = digits.unwrap_or(text);
    number(digits, radix).and_then(|id| CanId::new(id, is_extended).ok())
}

/// CAN ID of the field `ID = 291`.
fn id_field(mut fields: Fields<'_>) -> Option<CanId> {
    while let Some(field) = fields.next() {
        if field == "ID" && fields.next() == Some("=") {
            return can_id(fields.next()?, 10);
        }
    }
    None
}
