//! Trace files of PEAK (TRC), versions 1.0 to 2.1.
//!
//! ```text
//! 1.0   N) offset id dlc data                  "RTR" for a remote frame, "ERROR" for an error frame
//! 1.1   N) offset type id dlc data             type Rx, Tx, Warng, Error
//! 1.2   N) offset bus type id dlc data
//! 1.3   N) offset bus type id - dlc data
//! 2.x   in the order of ;$COLUMNS: N number, O offset, T type, B bus, I CAN ID, d direction,
//!       R reserved, l data length, L DLC, D data; type DT, FD, FB, FE, BI, RR, ER, ST, EC, EV
//! ```
//!
//! Offsets are milliseconds since the start. CAN IDs of more than 4 digits are extended.

use ecan_protocol::can::{CanFrame, CanId, Dlc};

use super::records::{
    FieldResult, Fields, Format, Item, Recording, RecordingErrorKind, classic, interface, invalid,
    number, remote, signed, time_ns,
};

/// Digits of a millisecond in nanoseconds.
const MILLISECOND_DIGITS: u32 = 6;
const STANDARD_DIGITS: usize = 4;
const VERSIONS: &str = "1.0, 1.1, 1.2, 1.3, 2.0 or 2.1";
const COLUMNS: &str = "N, O, T, I, d, l or L and D, with B and R as needed";

/// Columns of a line, in the letters of `;$COLUMNS`.
const VERSION_1_0: &str = "N,O,I,L,D";
const VERSION_1_1: &str = "N,O,T,I,L,D";
const VERSION_1_2: &str = "N,O,B,T,I,L,D";
const VERSION_1_3: &str = "N,O,B,T,I,R,L,D";

pub fn parse(text: &str) -> Recording {
    let mut columns = Some(VERSION_1_0.to_owned());
    Recording::of_lines(Format::Trc, text, |text| {
        let text = text.trim();
        match (text.strip_prefix(';'), &columns) {
            (Some(comment), _) => header(comment, &mut columns).map(|()| Item::Nothing),
            (None, _) if text.is_empty() => Ok(Item::Nothing),
            (None, Some(columns)) => item(text, columns),
            (None, None) => Err(RecordingErrorKind::NoColumns),
        }
    })
}

fn header(comment: &str, columns: &mut Option<String>) -> FieldResult<()> {
    if let Some(version) = comment.strip_prefix("$FILEVERSION=") {
        let fixed = |columns: &str| Some(columns.to_owned());
        *columns = match version.trim() {
            "1.0" => fixed(VERSION_1_0),
            "1.1" => fixed(VERSION_1_1),
            "1.2" => fixed(VERSION_1_2),
            "1.3" => fixed(VERSION_1_3),
            "2.0" | "2.1" => None,
            other => return Err(invalid("file version", other, VERSIONS)),
        };
    } else if let Some(given) = comment.strip_prefix("$COLUMNS=") {
        let given = given.trim();
        let has = |letter: char| given.split(',').any(|flag| flag.chars().eq([letter]));
        let is_known =
            given.split(',').all(|flag| matches!(flag.len(), 1) && "NOTBIdRlLD".contains(flag));
        let is_whole = has('O') && has('T') && has('I') && (has('l') || has('L'));
        if !is_known || !is_whole || !given.ends_with(",D") {
            return Err(invalid("list of columns", given, COLUMNS));
        }
        *columns = Some(given.to_owned());
    }
    Ok(())
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Data,
    Remote,
    Fd { brs: bool, esi: bool },
}

fn item(line: &str, columns: &str) -> FieldResult<Item> {
    let mut fields = Fields::new(line);
    let mut time = 0;
    let mut bus = "can0".to_owned();
    let (mut id, mut kind, mut length) = (None, Kind::Data, Length::Dlc(0));
    for column in columns.split(',') {
        match column {
            "N" => {
                let is_number = |text: &str| {
                    let digits = text.strip_suffix(')').unwrap_or(text);
                    number(digits, 10).filter(|_| !digits.is_empty())
                };
                fields.parse("message number", "a number", is_number)?;
            }
            "O" => {
                let parse = |text: &str| time_ns(text, MILLISECOND_DIGITS);
                time = fields.parse("time offset", "milliseconds, as in 1059.900", parse)?;
            }
            "T" => match fields.take("type", "Rx, Tx, DT, FD, FB, FE, BI, RR, ER, ST, EC or EV")? {
                "Rx" | "Tx" | "DT" => {}
                "RR" => kind = Kind::Remote,
                "FD" => kind = Kind::Fd { brs: false, esi: false },
                "FB" => kind = Kind::Fd { brs: true, esi: false },
                "FE" => kind = Kind::Fd { brs: false, esi: true },
                "BI" => kind = Kind::Fd { brs: true, esi: true },
                "ER" | "Error" => return Ok(Item::ErrorFrame),
                "ST" | "EC" | "EV" | "Warng" | "Event" => return Ok(Item::Event),
                other => {
                    let expected = "Rx, Tx, DT, FD, FB, FE, BI, RR, ER, ST, EC or EV";
                    return Err(invalid("type", other, expected));
                }
            },
            // Events of no bus have "-".
            "B" => match fields.peek() {
                Some("-") => {
                    fields.next();
                }
                _ => bus = fields.parse("bus", "a number, from 1", interface)?,
            },
            "I" => {
                if fields.peek() == Some("FFFFFFFF") {
                    return Ok(Item::Event);
                }
                id = Some(fields.parse("CAN ID", "4 or 8 hex digits, 0000 to 07FF", can_id)?);
            }
            "d" => {
                fields.take("direction", "Rx or Tx")?;
            }
            "R" => {
                fields.take("reserved column", "-")?;
            }
            "l" => {
                length =
                    Length::Bytes(fields.parse("data length", "0 to 64", |text| small(text, 64))?)
            }
            "L" => length = Length::Dlc(fields.parse("DLC", "0 to 15", |text| small(text, 15))?),
            _ => {}
        }
    }
    match fields.peek() {
        Some("RTR") => kind = Kind::Remote,
        Some("ERROR") => return Ok(Item::ErrorFrame),
        _ => {}
    }
    let missing = RecordingErrorKind::Missing { field: "CAN ID", expected: "4 or 8 hex digits" };
    let frame = frame(&mut fields, id.ok_or(missing)?, kind, length)?;
    Ok(Item::Frame { time_ns: signed(time)?, interface: bus, frame })
}

#[derive(Clone, Copy)]
enum Length {
    Bytes(u8),
    Dlc(u8),
}

fn frame(fields: &mut Fields<'_>, id: CanId, kind: Kind, length: Length) -> FieldResult<CanFrame> {
    let (Length::Bytes(given) | Length::Dlc(given)) = length;
    let too_long = |expected| invalid("data length", &given.to_string(), expected);
    match kind {
        Kind::Remote => remote(id, given),
        Kind::Data => {
            let dlc = match length {
                Length::Bytes(bytes) => Dlc::from_classic_len(bytes.into()),
                Length::Dlc(dlc) => Dlc::from_raw(dlc),
            };
            // J1939 messages of several frames have more bytes.
            classic(fields, id, dlc.ok_or_else(|| too_long("0 to 8 in a CAN frame"))?, 16)
        }
        Kind::Fd { brs, esi } => {
            let dlc = match length {
                Length::Bytes(bytes) => Dlc::from_fd_len(bytes.into()),
                Length::Dlc(dlc) => Dlc::from_raw(dlc),
            };
            let expected = "0 to 8, 12, 16, 20, 24, 32, 48 or 64";
            let bytes = dlc.ok_or_else(|| too_long(expected))?.fd_len();
            let mut buffer = [0; 64];
            let data = fields.data(buffer.get_mut(..bytes).unwrap_or_default(), 16)?;
            CanFrame::fd(id, data, brs, esi).map_err(|_| too_long(expected))
        }
    }
}

fn small(text: &str, limit: u32) -> Option<u8> {
    number(text, 10).filter(|value| *value <= limit).and_then(|value| value.try_into().ok())
}

fn can_id(text: &str) -> Option<CanId> {
    CanId::new(number(text, 16)?, text.len() > STANDARD_DIGITS).ok()
}
