//! Captures for Wireshark: CAN frames and PDO images of gateways in one pcapng file.
//!
//! CAN frames use the link type `LINKTYPE_CAN_SOCKETCAN` (227). PDO images (manual 6) use the first
//! private link type (`LINKTYPE_USER0`, 147) with a header of 16 bytes, see [`ImageOrigin`];
//! `packaging/wireshark/ecan_pdo.lua` dissects them. Each channel and each gateway is an interface of the
//! capture, named `can0`, `can1` ... and `ecan0` ....
//!
//! [`Capture`] writes synchronously. [`Recorder`] writes on a thread of its own, for applications
//! that must not wait.
//!
//! # In an application
//!
//! Call the recorder from the cycle: record received frames and the TxPDO image after the cycle
//! begins, and likewise the RxPDO image after it ends. Record a sent frame when it is sent, as here,
//! or when the gateway reports its transmit result (manual 10). Start the recorder before the
//! real-time settings of the cycle thread are applied, so that its thread does not inherit them.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # use ecan_sim::{ClockKind, EcrtSetting, SimOptions};
//! # let setting = EcrtSetting::resolve(Some("sim"))?;
//! # let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
//! # let ecrt = ecan_sim::open(&setting, &options)?.ecrt;
//! # let directory = tempfile::tempdir()?;
//! # let path = directory.path().join("drive.pcapng");
//! use ecan_can_io::capture::{Capture, ImageOrigin, Recorder, Traffic};
//! use ecan_host::AdapterConfig;
//! use ecan_protocol::can::{CanFrame, CanId};
//! use ecan_protocol::mapping::{CHUNK_BYTES, Direction};
//! use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig, Received};
//!
//! // `ecrt` is the loaded library, `path` the file.
//! let mut gateway = GatewayConfig::default();
//! gateway.channels[0] = Some(ChannelConfig::classic(500_000));
//! let adapter = AdapterConfig::new(1).with_multiplier(2);
//! let mut port = Port::open(&ecrt, (adapter, PortConfig::uniform(1, gateway)))?;
//!
//! let file = std::io::BufWriter::new(std::fs::File::create(&path)?);
//! let mut recorder = Recorder::start(Capture::new(file, "my machine 1.0")?, 2 * CHUNK_BYTES)?;
//! # recorder.set_patient(true); // simulated time waits for the file
//! let profile = gateway.profile(Direction::TxPdo, 2);
//! let origin = ImageOrigin { slave: 0, direction: Direction::TxPdo, profile };
//!
//! port.wait_ready()?;
//! let can0 = port.channel(0, 0)?;
//! let frame = CanFrame::classic(CanId::standard(0x123)?, &[1, 2, 3])?;
//! for number in 0..100 {
//!     let mut cycle = port.next_cycle();
//!     // Time stamps are nanoseconds since 1970, whatever the clock of the cycle counts.
//!     let now_ns = std::time::UNIX_EPOCH.elapsed()?.as_nanos() as u64;
//!     recorder.image(now_ns, origin, cycle.adapter().tx_pdo(0));
//!     for item in cycle.received() {
//!         if let Received::Frame(it) = item.to_owned() {
//!             recorder.frame(now_ns, it.channel.into(), Traffic::Received, &it.frame);
//!         }
//!     }
//!     if number == 0 {
//!         cycle.send(can0, &frame)?;
//!         recorder.frame(now_ns, 0, Traffic::Sent, &frame);
//!     }
//!     cycle.end()?;
//! }
//! let recording = recorder.finish()?;
//! assert_eq!(recording.dropped, 0);
//! # assert_eq!(recording.written, 102, "the simulated node echoes the frame");
//! # Ok(()) }
//! ```
//!
//! A recorder drops and counts packets if the file is too slow, see [`Recording`]. `ecan dump`,
//! `send`, `gen`, `replay` and `bridge` use it for `--capture FILE`.

use std::io;
use std::io::Write;

use ecan_protocol::can::{CanFrame, FrameKind};
use ecan_protocol::image::{ChannelStatus, PdoProfile};
use ecan_protocol::mapping::Direction;
pub use recorder::{Recorder, Recording, lost_images};

mod recorder;

/// Direction of a CAN frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Traffic {
    /// Received from the bus.
    Received,
    /// Sent to the bus.
    Sent,
}

impl Traffic {
    /// Bits of the packet flags.
    const fn flags(self) -> u32 {
        match self {
            Self::Received => 1,
            Self::Sent => 2,
        }
    }
}

/// Interface of the capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Interface {
    Can(usize),
    Images(u16),
}

/// Writer of a capture.
///
/// Writes the description of an interface before its first packet and allocates only then. Times are
/// nanoseconds since 1970. Each function returns the I/O errors of the writer. Do not use it in the
/// cycle, because it waits for the file; see [`Recorder`].
#[derive(Debug)]
pub struct Capture<W> {
    blocks: Blocks<W>,
    interfaces: Vec<(Interface, u32)>,
}

impl<W: Write> Capture<W> {
    /// Starts a capture. The writer should be buffered; `application` is stored in the file.
    pub fn new(writer: W, application: &str) -> io::Result<Self> {
        let blocks = Blocks::begin(writer, application)?;
        Ok(Self { blocks, interfaces: Vec::with_capacity(16) })
    }

    /// Writes a CAN frame; `port` counts the channels of all gateways from `can0`.
    pub fn frame(
        &mut self,
        time_ns: u64,
        port: usize,
        traffic: Traffic,
        frame: &CanFrame,
    ) -> io::Result<()> {
        let interface = self.interface(Interface::Can(port))?;
        let header = frame_header(frame);
        self.blocks.packet(interface, time_ns, traffic.flags(), &header, frame.data())
    }

    /// Marks a gap before the next packet by a comment, which Wireshark shows and finds: `what` is missing.
    pub fn gap(&mut self, what: &str) {
        self.blocks.comment(&format!("gap: {what}"));
    }

    /// Writes an error frame of a channel.
    pub fn error(&mut self, time_ns: u64, port: usize, error: &ErrorFrame) -> io::Result<()> {
        let interface = self.interface(Interface::Can(port))?;
        let header = error_header(error);
        let flags = Traffic::Received.flags();
        self.blocks.packet(interface, time_ns, flags, &header, error.data())
    }

    /// Writes a PDO image, 128 * N bytes.
    pub fn image(&mut self, time_ns: u64, origin: &ImageOrigin, image: &[u8]) -> io::Result<()> {
        let interface = self.interface(Interface::Images(origin.slave))?;
        let traffic = match origin.direction {
            Direction::RxPdo => Traffic::Sent,
            Direction::TxPdo => Traffic::Received,
        };
        self.blocks.packet(interface, time_ns, traffic.flags(), &origin.header(), image)
    }

    /// Flushes the writer.
    pub fn flush(&mut self) -> io::Result<()> {
        self.blocks.flush()
    }

    /// Ends the capture and returns the writer.
    pub fn finish(self) -> io::Result<W> {
        self.blocks.finish()
    }

    fn interface(&mut self, wanted: Interface) -> io::Result<u32> {
        if let Some((_, number)) = self.interfaces.iter().find(|(it, _)| *it == wanted) {
            return Ok(*number);
        }
        let number = match wanted {
            Interface::Can(port) => self.blocks.describe(CAN_LINK_TYPE, &format!("can{port}")),
            Interface::Images(slave) => {
                self.blocks.describe(IMAGE_LINK_TYPE, &format!("ecan{slave}"))
            }
        }?;
        self.interfaces.push((wanted, number));
        Ok(number)
    }
}

/// Link type of images.
const IMAGE_LINK_TYPE: u16 = 147;
/// Size of the header before an image, in bytes.
pub const IMAGE_HEADER_BYTES: usize = 16;

const MAGIC: [u8; 4] = *b"ECAN";
const VERSION: u8 = 1;

/// Origin and profile of an image.
///
/// Its header of 16 bytes precedes the image, little-endian:
///
/// | Offset | Size | Content |
/// |---|---|---|
/// | 0 | 4 | `ECAN` |
/// | 4 | 1 | version of this header, 1 |
/// | 5 | 1 | size of this header in bytes, 16; the image follows |
/// | 6 | 1 | direction: 0 RxPDO (from the master), 1 TxPDO (from the gateway) |
/// | 7 | 1 | 0 |
/// | 8 | 2 | slave |
/// | 10 | 2 | 0 |
/// | 12 | 4 | profile word: N - 1, channels, profile, budget, options (manual 5.4.4.1) |
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageOrigin {
    /// Index of the gateway in the application.
    pub slave: u16,
    /// Direction of the image.
    pub direction: Direction,
    /// Active profile of this direction.
    pub profile: PdoProfile,
}

impl ImageOrigin {
    /// Encodes the header.
    pub fn header(&self) -> [u8; IMAGE_HEADER_BYTES] {
        let [e, c, a, n] = MAGIC;
        let direction = match self.direction {
            Direction::RxPdo => 0,
            Direction::TxPdo => 1,
        };
        let [s0, s1] = self.slave.to_le_bytes();
        let [w0, w1, w2, w3] = self.profile.word().to_le_bytes();
        let length = IMAGE_HEADER_BYTES as u8;
        [e, c, a, n, VERSION, length, direction, 0, s0, s1, 0, 0, w0, w1, w2, w3]
    }
}

const CONTROLLER: u32 = 1 << 2;
const BUS_OFF: u32 = 1 << 6;
const RESTARTED: u32 = 1 << 8;
/// Index of the controller state in the data, and its values.
const CONTROLLER_STATE: usize = 1;
const WARNING_BOTH_WAYS: u8 = 0x04 | 0x08;
const ACTIVE_AGAIN: u8 = 0x40;

/// Error frame with the classes and data bytes of Linux (`linux/can/error.h`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ErrorFrame {
    classes: u32,
    data: [u8; 8],
}

impl ErrorFrame {
    /// Creates an error frame of these classes; bits 29 to 31 are ignored.
    pub const fn new(classes: u32, data: [u8; 8]) -> Self {
        Self { classes: classes & 0x1FFF_FFFF, data }
    }

    /// Converts a change of the channel status word (manual 7): bus-off, recovery, error warning
    /// set or cleared; `None` for other changes.
    ///
    /// The word has one bit for error warning and error passive; the frame reports error warning
    /// for both.
    pub fn of_change(before: ChannelStatus, after: ChannelStatus) -> Option<Self> {
        let mut data = [0; 8];
        let classes = if before.bus_off() != after.bus_off() {
            if after.bus_off() { BUS_OFF } else { RESTARTED }
        } else if before.warn() != after.warn() && !after.bus_off() {
            data[CONTROLLER_STATE] = if after.warn() { WARNING_BOTH_WAYS } else { ACTIVE_AGAIN };
            CONTROLLER
        } else {
            return None;
        };
        Some(Self { classes, data })
    }

    /// Error classes, bits 0 to 28.
    pub const fn classes(&self) -> u32 {
        self.classes
    }

    /// Data bytes.
    pub const fn data(&self) -> &[u8; 8] {
        &self.data
    }
}

pub(crate) const SECTION_HEADER: u32 = 0x0A0D_0D0A;
pub(crate) const BYTE_ORDER_MAGIC: u32 = 0x1A2B_3C4D;
pub(crate) const INTERFACE_DESCRIPTION: u32 = 1;
pub(crate) const ENHANCED_PACKET: u32 = 6;

const OPTION_END: u16 = 0;
const COMMENT: u16 = 1;
const SECTION_APPLICATION: u16 = 4;
pub(crate) const INTERFACE_NAME: u16 = 2;
pub(crate) const INTERFACE_TIME_RESOLUTION: u16 = 9;
const PACKET_FLAGS: u16 = 2;
/// Decimal digits of the seconds' fraction.
const NANOSECONDS: u8 = 9;
/// Block type and length before the content, and the length after it.
const FRAMING_BYTES: usize = 12;

/// Writer of little-endian blocks; each is built in one reused buffer.
#[derive(Debug)]
struct Blocks<W> {
    writer: W,
    block: Vec<u8>,
    interfaces: u32,
    /// Comment of the next packet.
    comment: String,
}

impl<W: Write> Blocks<W> {
    /// Starts a section with the name of the application.
    pub fn begin(writer: W, application: &str) -> io::Result<Self> {
        let (block, comment) = (Vec::with_capacity(4096), String::new());
        let mut blocks = Self { writer, block, interfaces: 0, comment };
        blocks.u32(BYTE_ORDER_MAGIC);
        blocks.u16(1);
        blocks.u16(0);
        // Unknown section length.
        blocks.bytes(&u64::MAX.to_le_bytes());
        blocks.option(SECTION_APPLICATION, application.as_bytes());
        blocks.option(OPTION_END, &[]);
        blocks.put(SECTION_HEADER)?;
        Ok(blocks)
    }

    /// Describes an interface with time stamps in nanoseconds; returns its number.
    pub fn describe(&mut self, link_type: u16, name: &str) -> io::Result<u32> {
        self.u16(link_type);
        self.u16(0);
        // No limit of the packet length.
        self.u32(0);
        self.option(INTERFACE_NAME, name.as_bytes());
        self.option(INTERFACE_TIME_RESOLUTION, &[NANOSECONDS]);
        self.option(OPTION_END, &[]);
        self.put(INTERFACE_DESCRIPTION)?;
        let number = self.interfaces;
        self.interfaces += 1;
        Ok(number)
    }

    /// The next packet has a comment.
    pub fn comment(&mut self, text: &str) {
        if !self.comment.is_empty() {
            self.comment.push_str("; ");
        }
        self.comment.push_str(text);
    }

    pub fn packet(
        &mut self,
        interface: u32,
        time_ns: u64,
        flags: u32,
        header: &[u8],
        content: &[u8],
    ) -> io::Result<()> {
        let length = length(header.len() + content.len())?;
        self.u32(interface);
        self.u32((time_ns >> 32) as u32);
        self.u32(time_ns as u32);
        self.u32(length);
        self.u32(length);
        self.bytes(header);
        self.bytes(content);
        self.pad();
        let comment = std::mem::take(&mut self.comment);
        if !comment.is_empty() {
            self.option(COMMENT, comment.as_bytes());
        }
        self.option(PACKET_FLAGS, &flags.to_le_bytes());
        self.option(OPTION_END, &[]);
        self.put(ENHANCED_PACKET)
    }

    pub fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }

    pub fn finish(mut self) -> io::Result<W> {
        self.writer.flush()?;
        Ok(self.writer)
    }

    fn u16(&mut self, value: u16) {
        self.bytes(&value.to_le_bytes());
    }

    fn u32(&mut self, value: u32) {
        self.bytes(&value.to_le_bytes());
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.block.extend_from_slice(bytes);
    }

    fn pad(&mut self) {
        self.block.resize(self.block.len().next_multiple_of(4), 0);
    }

    /// Appends an option; a value that is too long is truncated.
    fn option(&mut self, code: u16, value: &[u8]) {
        let length = u16::try_from(value.len()).unwrap_or(u16::MAX);
        self.u16(code);
        self.u16(length);
        self.bytes(value.get(..length.into()).unwrap_or(value));
        self.pad();
    }

    fn put(&mut self, block_type: u32) -> io::Result<()> {
        let length = length(self.block.len() + FRAMING_BYTES)?.to_le_bytes();
        let outcome = self
            .writer
            .write_all(&block_type.to_le_bytes())
            .and_then(|()| self.writer.write_all(&length))
            .and_then(|()| self.writer.write_all(&self.block))
            .and_then(|()| self.writer.write_all(&length));
        self.block.clear();
        outcome
    }
}

fn length(bytes: usize) -> io::Result<u32> {
    u32::try_from(bytes).map_err(|_| io::Error::from(io::ErrorKind::FileTooLarge))
}

/// Link type of CAN frames.
pub(crate) const CAN_LINK_TYPE: u16 = 227;
/// Size of the header before the data, in bytes.
const HEADER_BYTES: usize = 8;

pub(crate) const EXTENDED: u32 = 1 << 31;
pub(crate) const REMOTE: u32 = 1 << 30;
pub(crate) const ERROR: u32 = 1 << 29;
pub(crate) const BIT_RATE_SWITCH: u8 = 1;
pub(crate) const ERROR_STATE: u8 = 2;
pub(crate) const FD: u8 = 4;
/// Maximum length of a classic frame in bytes.
const CLASSIC_BYTES: u8 = 8;

/// Header of a data, remote or FD frame, without its data.
fn frame_header(frame: &CanFrame) -> [u8; HEADER_BYTES] {
    let id = frame.id().raw() | if frame.id().is_extended() { EXTENDED } else { 0 };
    let dlc = frame.dlc().value();
    // A classic frame with a DLC above 8 has 8 bytes; its DLC has a field of its own.
    let raw_dlc = if dlc > CLASSIC_BYTES { dlc } else { 0 };
    let length = frame.data().len() as u8;
    match frame.kind() {
        FrameKind::Data => header(id, length, 0, raw_dlc),
        FrameKind::Remote => header(id | REMOTE, dlc.min(CLASSIC_BYTES), 0, raw_dlc),
        FrameKind::Fd { brs, esi } => {
            let switch = if brs { BIT_RATE_SWITCH } else { 0 };
            let state = if esi { ERROR_STATE } else { 0 };
            header(id, length, FD | switch | state, 0)
        }
    }
}

/// Header of an error frame, without its 8 data bytes.
fn error_header(error: &ErrorFrame) -> [u8; HEADER_BYTES] {
    header(error.classes() | ERROR, CLASSIC_BYTES, 0, 0)
}

/// The CAN ID is big-endian in this link type.
fn header(id: u32, length: u8, flags: u8, raw_dlc: u8) -> [u8; HEADER_BYTES] {
    let [a, b, c, d] = id.to_be_bytes();
    [a, b, c, d, length, flags, 0, raw_dlc]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_changes_become_error_frames() {
        let fine = ChannelStatus::from_raw(2);
        let warned = fine.with_warn(true);
        let off = warned.with_bus_off(true);
        let of = |before, after| {
            ErrorFrame::of_change(before, after).map(|frame| (frame.classes(), frame.data()[1]))
        };
        assert_eq!(of(fine, fine.with_rx_pending(3)), None);
        assert_eq!(of(fine, warned), Some((0x004, 0x0C)));
        assert_eq!(of(warned, fine), Some((0x004, 0x40)));
        assert_eq!(of(warned, off), Some((0x040, 0)));
        assert_eq!(of(off, off.with_warn(false)), None);
        assert_eq!(of(off, fine), Some((0x100, 0)));
    }
}
