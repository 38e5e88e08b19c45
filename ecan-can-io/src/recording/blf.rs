//! Binary logs of Vector (BLF): reader and writer.
//!
//! A file header of 144 bytes precedes containers, which hold compressed objects. An object begins with `LOBJ`, the
//! size of its header, the version of the header, its own size and its type; its time counts from the start of the
//! file, in units of 10 us or of 1 ns. It may go on in the next container. The form of the objects is that of
//! python-can, which the tests compare with.

use std::io::{self, Read, Seek, SeekFrom, Write};

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameKind};
use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use jiff::tz::TimeZone;
use jiff::{Timestamp, civil::DateTime};

use super::records::{
    FieldResult, Format, Item, Recording, RecordingErrorKind, invalid, remote, signed,
};

const FILE_SIGNATURE: &[u8; 4] = b"LOGG";
const SIGNATURE: &[u8; 4] = b"LOBJ";
const FILE_HEADER_BYTES: usize = 144;
/// Signature, header size, header version, size and type.
const BASE_BYTES: usize = 16;
/// Base, flags, client, version and time.
const HEADER_BYTES: usize = 32;
/// Padding before an object, at most.
const MOST_PADDING: usize = 8;
/// Uncompressed bytes of a container that is written, and most of one that is read.
const CONTAINER_BYTES: usize = 128 * 1024;
const MOST_CONTAINER_BYTES: u64 = 256 * 1024 * 1024;

const CAN_MESSAGE: u32 = 1;
const CAN_ERROR: u32 = 2;
const CONTAINER: u32 = 10;
const CAN_ERROR_EXTENDED: u32 = 73;
const CAN_MESSAGE_2: u32 = 86;
const CAN_FD_MESSAGE: u32 = 100;
const CAN_FD_MESSAGE_64: u32 = 101;
const CAN_FD_ERROR_64: u32 = 104;
const EVENT_COMMENT: u32 = 92;

const TIME_IN_NANOSECONDS: u32 = 2;
const UNCOMPRESSED: u16 = 0;
const ZLIB: u16 = 2;
const EXTENDED: u32 = 1 << 31;
const SENT: u8 = 1;
const REMOTE: u8 = 0x80;
/// Flags of CAN FD in message 100, and in message 101.
const FD: [u32; 3] = [1, 2, 4];
const FD_64: [u32; 3] = [0x1000, 0x2000, 0x4000];
const REMOTE_64: u32 = 0x10;

pub fn is_blf(bytes: &[u8]) -> bool {
    bytes.starts_with(FILE_SIGNATURE)
}

pub fn parse(bytes: &[u8]) -> Recording {
    let mut items = Vec::new();
    let size = number(bytes, 4).map_or(FILE_HEADER_BYTES, |size| size as usize);
    let mut content = Vec::new();
    let mut rest = bytes.get(size..).unwrap_or_default();
    loop {
        match next_object(rest) {
            Ok(Some((object, after))) => {
                rest = after;
                if object.kind != CONTAINER {
                    items.push(object.item());
                    continue;
                }
                match unpack(&object) {
                    Ok(bytes) => content.extend(bytes),
                    Err(error) => items.push(Err(error)),
                }
                let left = read_objects(&content, &mut items);
                content.drain(..content.len() - left);
            }
            Ok(None) => break,
            Err(error) => {
                items.push(Err(error));
                break;
            }
        }
    }
    if content.len() >= BASE_BYTES {
        items.push(Err(broken("the last object is not complete")));
    }
    let numbered = (1..).zip(items).map(|(number, item)| (number, item, ""));
    Recording::of_items(Format::Blf, numbered)
}

fn broken(text: &str) -> RecordingErrorKind {
    RecordingErrorKind::Broken(text.to_owned())
}

/// Reads the whole objects of a content; returns the number of bytes that are left.
fn read_objects(content: &[u8], items: &mut Vec<FieldResult<Item>>) -> usize {
    let mut rest = content;
    loop {
        match next_object(rest) {
            Ok(Some((object, after))) => {
                items.push(object.item());
                rest = after;
            }
            // The next container may have the rest.
            Ok(None) => return rest.len(),
            Err(_) if rest.len() < MOST_PADDING + BASE_BYTES => return rest.len(),
            Err(error) => {
                items.push(Err(error));
                return 0;
            }
        }
    }
}

struct Object<'b> {
    kind: u32,
    /// From the signature on.
    bytes: &'b [u8],
    header_bytes: usize,
}

type Next<'b> = FieldResult<Option<(Object<'b>, &'b [u8])>>;

/// The next object, and what follows; `None` if it is not complete.
fn next_object(bytes: &[u8]) -> Next<'_> {
    let window = bytes.get(..bytes.len().min(MOST_PADDING + SIGNATURE.len())).unwrap_or_default();
    let at = window.windows(SIGNATURE.len()).position(|part| part == SIGNATURE);
    let Some(at) = at else {
        let is_padding = bytes.len() < MOST_PADDING + SIGNATURE.len();
        return if is_padding { Ok(None) } else { Err(broken("no object follows the last one")) };
    };
    let bytes = bytes.get(at..).unwrap_or_default();
    let header = (half(bytes, 4), number(bytes, 8), number(bytes, 12));
    let (Some(header_bytes), Some(size), Some(kind)) = header else { return Ok(None) };
    let size = size as usize;
    if size < BASE_BYTES {
        return Err(broken("an object has a size below that of its header"));
    }
    let Some(object) = bytes.get(..size) else { return Ok(None) };
    let header_bytes = usize::from(header_bytes);
    let object = Object { kind, bytes: object, header_bytes };
    Ok(Some((object, bytes.get(size..).unwrap_or_default())))
}

fn unpack(container: &Object<'_>) -> FieldResult<Vec<u8>> {
    let method = half(container.bytes, BASE_BYTES);
    let size = number(container.bytes, BASE_BYTES + 8).map_or(0, u64::from);
    let packed = container.bytes.get(BASE_BYTES + 16..).unwrap_or_default();
    match method {
        Some(UNCOMPRESSED) => Ok(packed.to_vec()),
        Some(ZLIB) => {
            let mut content = Vec::new();
            let limit = size.min(MOST_CONTAINER_BYTES);
            let read = ZlibDecoder::new(packed).take(limit).read_to_end(&mut content);
            match read {
                Ok(read) if read as u64 == size => Ok(content),
                _ => Err(broken("a container is damaged")),
            }
        }
        _ => Err(broken("a container has an unknown compression")),
    }
}

impl Object<'_> {
    fn item(&self) -> FieldResult<Item> {
        let cut = || broken("an object is shorter than its content");
        match self.kind {
            CAN_ERROR | CAN_ERROR_EXTENDED | CAN_FD_ERROR_64 => return Ok(Item::ErrorFrame),
            CAN_MESSAGE | CAN_MESSAGE_2 | CAN_FD_MESSAGE | CAN_FD_MESSAGE_64 => {}
            _ => return Ok(Item::Event),
        }
        let body = self.bytes.get(self.header_bytes..).ok_or_else(cut)?;
        let message = match self.kind {
            CAN_FD_MESSAGE => Message::fd(body),
            CAN_FD_MESSAGE_64 => Message::fd_64(body),
            _ => Message::classic(body),
        };
        let message = message.ok_or_else(cut)?;
        let time_ns = self.time_ns().ok_or_else(cut)?;
        let interface = format!("can{}", message.channel.saturating_sub(1));
        Ok(Item::Frame { time_ns: signed(time_ns)?, interface, frame: message.frame()? })
    }

    fn time_ns(&self) -> Option<u64> {
        let flags = number(self.bytes, BASE_BYTES)?;
        let at = BASE_BYTES + 8;
        let time = u64::from_le_bytes(*self.bytes.get(at..)?.first_chunk()?);
        let unit = if flags & TIME_IN_NANOSECONDS != 0 { 1 } else { 10_000 };
        time.checked_mul(unit)
    }
}

/// Content of a message object.
struct Message<'b> {
    channel: u16,
    id: u32,
    dlc: u8,
    data: &'b [u8],
    is_remote: bool,
    /// Bit rate switch and error state of a frame of CAN FD.
    fd: Option<(bool, bool)>,
}

impl<'b> Message<'b> {
    fn classic(body: &'b [u8]) -> Option<Self> {
        let dlc = *body.get(3)?;
        let length = Dlc::from_raw(dlc & 0xF)?.classic_len();
        let is_remote = body.get(2)? & REMOTE != 0;
        Some(Self {
            channel: half(body, 0)?,
            id: number(body, 4)?,
            dlc,
            data: body.get(8..8 + length)?,
            is_remote,
            fd: None,
        })
    }

    fn fd(body: &'b [u8]) -> Option<Self> {
        let flags = u32::from(*body.get(13)?);
        let length = usize::from(*body.get(14)?);
        Some(Self {
            channel: half(body, 0)?,
            id: number(body, 4)?,
            dlc: *body.get(3)?,
            data: body.get(20..20 + length)?,
            is_remote: body.get(2)? & REMOTE != 0,
            fd: fd_flags(flags, FD),
        })
    }

    fn fd_64(body: &'b [u8]) -> Option<Self> {
        let flags = number(body, 12)?;
        let length = usize::from(*body.get(2)?);
        Some(Self {
            channel: u16::from(*body.first()?),
            id: number(body, 4)?,
            dlc: *body.get(1)?,
            data: body.get(40..40 + length)?,
            is_remote: flags & REMOTE_64 != 0,
            fd: fd_flags(flags, FD_64),
        })
    }

    fn frame(&self) -> FieldResult<CanFrame> {
        let raw = self.id & !EXTENDED;
        let id = CanId::new(raw, self.id & EXTENDED != 0)
            .map_err(|_| invalid("CAN ID", &format!("{raw:X}"), "0 to 7FF, or an extended one"))?;
        let mismatch =
            RecordingErrorKind::LengthMismatch { length: self.data.len(), dlc: self.dlc };
        match self.fd {
            _ if self.is_remote => remote(id, self.dlc),
            Some((brs, esi)) => CanFrame::fd(id, self.data, brs, esi).map_err(|_| mismatch),
            None => CanFrame::classic(id, self.data).map_err(|_| mismatch),
        }
    }
}

fn fd_flags(flags: u32, [fd, brs, esi]: [u32; 3]) -> Option<(bool, bool)> {
    (flags & fd != 0).then_some((flags & brs != 0, flags & esi != 0))
}

fn half(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn number(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

/// Writer of a BLF file. Each function fails if the file cannot be written.
#[derive(Debug)]
pub struct BlfWriter<W> {
    file: W,
    content: Vec<u8>,
    uncompressed: u64,
    objects: u32,
    /// Times of the first and of the last frame since 1970.
    span_ns: Option<(u64, u64)>,
}

impl<W: Write + Seek> BlfWriter<W> {
    /// Begins a file; [`finish`](Self::finish) completes its header.
    pub fn new(mut file: W) -> io::Result<Self> {
        file.write_all(&[0; FILE_HEADER_BYTES])?;
        Ok(Self { file, content: Vec::new(), uncompressed: 0, objects: 0, span_ns: None })
    }

    /// Appends a frame; `port` counts the channels from 0, `time_ns` from 1970.
    pub fn write(
        &mut self,
        time_ns: u64,
        port: u16,
        frame: &CanFrame,
        is_sent: bool,
    ) -> io::Result<()> {
        let (start_ns, _) = *self.span_ns.get_or_insert((time_ns, time_ns));
        self.span_ns = Some((start_ns, time_ns.max(start_ns)));
        let (data, dlc) = (frame.data(), frame.dlc().value());
        let is_remote = frame.kind() == FrameKind::Remote;
        let flags = if is_sent { SENT } else { 0 } | if is_remote { REMOTE } else { 0 };
        let id = frame.id().raw() | if frame.id().is_extended() { EXTENDED } else { 0 };
        let mut body = port.saturating_add(1).to_le_bytes().to_vec();
        body.extend([flags, dlc]);
        body.extend(id.to_le_bytes());
        let (kind, data_bytes) = match frame.kind() {
            FrameKind::Fd { brs, esi } => {
                let [fd, brs_flag, esi_flag] = FD.map(|flag| flag as u8);
                let flags = fd | if brs { brs_flag } else { 0 } | if esi { esi_flag } else { 0 };
                // Duration, bits of the arbitration phase; flags, length.
                body.extend([0; 5]);
                body.extend([flags, data.len() as u8, 0, 0, 0, 0, 0]);
                (CAN_FD_MESSAGE, 64)
            }
            FrameKind::Data | FrameKind::Remote => (CAN_MESSAGE, 8),
        };
        let end = body.len() + data_bytes;
        body.extend(data);
        body.resize(end, 0);
        self.object(kind, time_ns.saturating_sub(start_ns), &body)
    }

    /// Appends a comment, for example on a gap.
    pub fn comment(&mut self, time_ns: u64, text: &str) -> io::Result<()> {
        let (start_ns, _) = *self.span_ns.get_or_insert((time_ns, time_ns));
        // Commented event, length, reserved.
        let mut body = vec![0; 4];
        body.extend((text.len() as u32).to_le_bytes());
        body.extend([0; 8]);
        body.extend(text.as_bytes());
        self.object(EVENT_COMMENT, time_ns.saturating_sub(start_ns), &body)
    }

    fn object(&mut self, kind: u32, time_ns: u64, body: &[u8]) -> io::Result<()> {
        let size = HEADER_BYTES + body.len();
        base(&mut self.content, HEADER_BYTES, size, kind);
        self.content.extend(TIME_IN_NANOSECONDS.to_le_bytes());
        self.content.extend([0; 4]);
        self.content.extend(time_ns.to_le_bytes());
        self.content.extend(body);
        self.content.resize(self.content.len() + size % 4, 0);
        self.objects = self.objects.saturating_add(1);
        if self.content.len() >= CONTAINER_BYTES { self.flush() } else { Ok(()) }
    }

    /// Writes the objects that are buffered.
    pub fn flush(&mut self) -> io::Result<()> {
        if self.content.is_empty() {
            return self.file.flush();
        }
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(&self.content)?;
        let packed = encoder.finish()?;
        let size = BASE_BYTES + 16 + packed.len();
        let mut header = Vec::new();
        base(&mut header, BASE_BYTES, size, CONTAINER);
        header.extend(ZLIB.to_le_bytes());
        header.extend([0; 6]);
        header.extend((self.content.len() as u32).to_le_bytes());
        header.extend([0; 4]);
        self.file.write_all(&header)?;
        self.file.write_all(&packed)?;
        self.file.write_all(&[0; 4][..size % 4])?;
        self.uncompressed += (BASE_BYTES + 16 + self.content.len()) as u64;
        self.content.clear();
        self.file.flush()
    }

    /// Writes what is buffered, and the header of the file; returns the file.
    pub fn finish(mut self) -> io::Result<W> {
        self.flush()?;
        let size = self.file.stream_position()?;
        let mut header = FILE_SIGNATURE.to_vec();
        header.extend((FILE_HEADER_BYTES as u32).to_le_bytes());
        // Application, and version of the format.
        header.extend([0, 0, 0, 0, 2, 6, 8, 1]);
        header.extend(size.to_le_bytes());
        header.extend((FILE_HEADER_BYTES as u64 + self.uncompressed).to_le_bytes());
        header.extend(self.objects.to_le_bytes());
        header.extend([0; 4]);
        let (start_ns, end_ns) = self.span_ns.unwrap_or_default();
        header.extend(system_time(start_ns));
        header.extend(system_time(end_ns));
        header.resize(FILE_HEADER_BYTES, 0);
        self.file.seek(SeekFrom::Start(0))?;
        self.file.write_all(&header)?;
        self.file.seek(SeekFrom::End(0))?;
        self.file.flush()?;
        Ok(self.file)
    }
}

fn base(out: &mut Vec<u8>, header_bytes: usize, size: usize, kind: u32) {
    out.extend(SIGNATURE);
    out.extend((header_bytes as u16).to_le_bytes());
    out.extend(1_u16.to_le_bytes());
    out.extend((size as u32).to_le_bytes());
    out.extend(kind.to_le_bytes());
}

/// Year, month, day of the week, day, hour, minute, second and millisecond, in UTC.
fn system_time(time_ns: u64) -> Vec<u8> {
    let time = Timestamp::from_nanosecond(time_ns.into()).unwrap_or_default();
    let civil: DateTime = TimeZone::UTC.to_datetime(time);
    let parts = [
        civil.year() as u16,
        civil.month() as u16,
        civil.weekday().to_sunday_zero_offset() as u16,
        civil.day() as u16,
        civil.hour() as u16,
        civil.minute() as u16,
        civil.second() as u16,
        civil.millisecond() as u16,
    ];
    parts.into_iter().flat_map(u16::to_le_bytes).collect()
}
