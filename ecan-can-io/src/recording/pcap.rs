//! Captures of SocketCAN: pcapng and pcap, in either byte order.
//!
//! A packet of link type 227 has the CAN ID with its flags, most significant byte first, the length, the flags of
//! CAN FD, two reserved bytes and the data. Packets of other link types count as events.

use ecan_protocol::can::{CanFrame, CanId, Dlc};

use super::records::{
    FieldResult, Format, Item, Recording, RecordingErrorKind, invalid, remote, signed,
};
use crate::capture::{
    BIT_RATE_SWITCH, BYTE_ORDER_MAGIC, CAN_LINK_TYPE, ENHANCED_PACKET, ERROR, ERROR_STATE,
    EXTENDED, FD, INTERFACE_DESCRIPTION, INTERFACE_NAME, INTERFACE_TIME_RESOLUTION, REMOTE,
    SECTION_HEADER,
};

const PCAP_MICROSECONDS: u32 = 0xA1B2_C3D4;
const PCAP_NANOSECONDS: u32 = 0xA1B2_3C4D;
const PCAP_HEADER_BYTES: usize = 24;
const PACKET_HEADER_BYTES: usize = 16;

const CLASSIC_BYTES: usize = 8;

/// Returns whether a file is pcapng or pcap.
pub fn is_pcap(bytes: &[u8]) -> bool {
    let magics = [SECTION_HEADER, PCAP_MICROSECONDS, PCAP_NANOSECONDS];
    let first = [false, true].map(|is_big| Bytes::of(bytes, is_big).u32(0));
    first.iter().flatten().any(|first| magics.contains(first))
}

pub fn parse(bytes: &[u8]) -> Recording {
    let items = match Bytes::of(bytes, false).u32(0) {
        Some(SECTION_HEADER) => blocks(bytes),
        _ => packets(bytes),
    };
    let numbered = (1..).zip(items).map(|(number, item)| (number, item, ""));
    Recording::of_items(Format::Pcap, numbered)
}

/// Numbers in the byte order of a file.
#[derive(Clone, Copy)]
struct Bytes<'b> {
    bytes: &'b [u8],
    is_big: bool,
}

impl<'b> Bytes<'b> {
    fn of(bytes: &'b [u8], is_big: bool) -> Self {
        Self { bytes, is_big }
    }

    fn u16(self, at: usize) -> Option<u16> {
        let bytes = *self.bytes.get(at..)?.first_chunk()?;
        Some(if self.is_big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    }

    fn u32(self, at: usize) -> Option<u32> {
        let bytes = *self.bytes.get(at..)?.first_chunk()?;
        Some(if self.is_big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    fn length(self, at: usize) -> Option<usize> {
        usize::try_from(self.u32(at)?).ok()
    }

    fn part(self, at: usize, length: usize) -> Option<Self> {
        let bytes = self.bytes.get(at..at.checked_add(length)?)?;
        Some(Self { bytes, ..self })
    }
}

fn broken(at: usize) -> RecordingErrorKind {
    RecordingErrorKind::Broken(format!("the block at byte {at} is damaged or not complete"))
}

/// The items of a pcap file.
fn packets(bytes: &[u8]) -> Vec<FieldResult<Item>> {
    let is_big = Bytes::of(bytes, true)
        .u32(0)
        .is_some_and(|magic| matches!(magic, PCAP_MICROSECONDS | PCAP_NANOSECONDS));
    let file = Bytes::of(bytes, is_big);
    let unit_ns = if file.u32(0) == Some(PCAP_NANOSECONDS) { 1 } else { 1_000 };
    // The upper half of the field has other flags.
    let link_type = file.u32(20).unwrap_or_default() as u16;
    let (mut items, mut at) = (Vec::new(), PCAP_HEADER_BYTES);
    while at < bytes.len() {
        let packet = || {
            let (seconds, fraction) = (file.u32(at)?, file.u32(at + 4)?);
            let content = file.part(at + PACKET_HEADER_BYTES, file.length(at + 8)?)?;
            let time_ns = u64::from(seconds) * 1_000_000_000 + u64::from(fraction) * unit_ns;
            Some((time_ns, content.bytes))
        };
        let Some((time_ns, content)) = packet() else {
            items.push(Err(broken(at)));
            break;
        };
        at += PACKET_HEADER_BYTES + content.len();
        items.push(item(link_type, "can0", time_ns, content));
    }
    items
}

struct Interface {
    link_type: u16,
    name: String,
    /// Units of a second.
    per_second: u64,
}

/// The items of a pcapng file.
fn blocks(bytes: &[u8]) -> Vec<FieldResult<Item>> {
    let (mut items, mut interfaces, mut is_big, mut at) = (Vec::new(), Vec::new(), false, 0);
    while at < bytes.len() {
        let file = Bytes::of(bytes, is_big);
        if file.u32(at) == Some(SECTION_HEADER) {
            interfaces.clear();
            is_big = Bytes::of(bytes, true).u32(at + 8) == Some(BYTE_ORDER_MAGIC);
        }
        let file = Bytes::of(bytes, is_big);
        let block = || {
            let length = file.length(at + 4).filter(|length| *length >= 12)?;
            Some((file.u32(at)?, length, file.part(at + 8, length - 12)?))
        };
        let Some((kind, length, content)) = block() else {
            items.push(Err(broken(at)));
            break;
        };
        match kind {
            INTERFACE_DESCRIPTION => match interface(content, interfaces.len()) {
                Some(interface) => interfaces.push(interface),
                None => items.push(Err(broken(at))),
            },
            ENHANCED_PACKET => {
                items.push(packet(content, &interfaces).unwrap_or_else(|| Err(broken(at))));
            }
            _ => {}
        }
        at += length.next_multiple_of(4);
    }
    items
}

fn interface(content: Bytes<'_>, number: usize) -> Option<Interface> {
    let mut interface = Interface {
        link_type: content.u16(0)?,
        name: format!("can{number}"),
        per_second: 1_000_000,
    };
    let mut at = 8;
    while let (Some(code @ 1..), Some(length)) = (content.u16(at), content.u16(at + 2)) {
        let value = content.part(at + 4, length.into())?.bytes;
        match (code, value) {
            (INTERFACE_NAME, name) if !name.is_empty() => {
                interface.name = String::from_utf8_lossy(name).into_owned();
            }
            (INTERFACE_TIME_RESOLUTION, [resolution]) => {
                let exponent = u32::from(resolution & 0x7F);
                let base: u64 = if resolution & 0x80 == 0 { 10 } else { 2 };
                interface.per_second = base.checked_pow(exponent)?;
            }
            _ => {}
        }
        at += 4 + usize::from(length).next_multiple_of(4);
    }
    Some(interface)
}

fn packet(content: Bytes<'_>, interfaces: &[Interface]) -> Option<FieldResult<Item>> {
    let interface = interfaces.get(content.length(0)?)?;
    let time = u64::from(content.u32(4)?) << 32 | u64::from(content.u32(8)?);
    let packet = content.part(20, content.length(12)?)?.bytes;
    let per_second = u128::from(interface.per_second);
    let time_ns = u64::try_from(u128::from(time) * 1_000_000_000 / per_second).ok()?;
    Some(item(interface.link_type, &interface.name, time_ns, packet))
}

fn item(link_type: u16, interface: &str, time_ns: u64, packet: &[u8]) -> FieldResult<Item> {
    if link_type != CAN_LINK_TYPE {
        return Ok(Item::Event);
    }
    let size = packet.len().to_string();
    let cut = || invalid("packet length", &size, "8 bytes and the data");
    let (header, rest) = packet.split_first_chunk::<8>().ok_or_else(cut)?;
    let [id @ .., length, flags, _, _] = *header;
    let id = u32::from_be_bytes(id);
    if id & ERROR != 0 {
        return Ok(Item::ErrorFrame);
    }
    let is_extended = id & EXTENDED != 0;
    let raw = id & !(EXTENDED | REMOTE);
    let can_id = CanId::new(raw, is_extended)
        .map_err(|_| invalid("CAN ID", &format!("{raw:X}"), "0 to 7FF, or an extended one"))?;
    let mismatch = RecordingErrorKind::LengthMismatch { length: length.into(), dlc: length };
    let frame = if id & REMOTE != 0 {
        remote(can_id, Dlc::from_classic_len(length.into()).map_or(8, Dlc::value))?
    } else {
        let data = rest.get(..length.into()).ok_or_else(cut)?;
        match flags & FD != 0 || data.len() > CLASSIC_BYTES {
            true => {
                CanFrame::fd(can_id, data, flags & BIT_RATE_SWITCH != 0, flags & ERROR_STATE != 0)
            }
            false => CanFrame::classic(can_id, data),
        }
        .map_err(|_| mismatch)?
    };
    let (time_ns, interface) = (signed(time_ns)?, interface.to_owned());
    Ok(Item::Frame { time_ns, interface, frame })
}
