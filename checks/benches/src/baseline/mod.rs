//! The plain C codec of `baseline.c`, safe to call.
//!
//! It is what the codec of `ecan-protocol` is measured against and compared with: a CRC table of
//! 256 entries, byte by byte, and an image that is cleared whole. It is part of no product.

use std::ffi::c_int;
use std::marker::PhantomData;
use std::mem::MaybeUninit;

/// 29 bit identifier.
pub const EXTENDED: u16 = 0x0080;
/// CAN FD frame.
pub const FD: u16 = 0x0100;
/// Data phase at the data bit rate.
pub const BRS: u16 = 0x0200;
/// Remote frame in classic CAN, error state indicator in CAN FD.
pub const X: u16 = 0x0400;
/// Data in a window of 64 bytes.
pub const WINDOW: u16 = 0x8000;

/// Largest image.
const MAX_BYTES: u16 = 3072;
const FD_LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// What both sides know about a direction.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Profile {
    /// Bytes of the image, 128 to 3072.
    pub bytes: u16,
    /// `layout_id` of the header.
    pub layout_id: u16,
    /// Channels that take part.
    pub channel_mask: u8,
    /// One bit for each timestamp format that may occur.
    pub formats: u8,
    /// True if windows may occur.
    pub windows: bool,
    /// True if packets are padded to 4 bytes.
    pub align4: bool,
    /// RxPDO.
    pub to_gateway: bool,
    /// True if the image has a CRC.
    pub crc: bool,
}

impl Profile {
    fn assert_valid(&self) {
        assert!((128..=MAX_BYTES).contains(&self.bytes));
    }
}

/// A frame with its place and time.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    data: *const u8,
    /// Timestamp or schedule record.
    pub timestamp: u64,
    /// Identifier.
    pub id: u32,
    flags: u16,
    /// Channel.
    pub channel: u8,
    /// ID_AUX.
    pub id_aux: u8,
    dlc: u8,
    timestamp_format: u8,
    borrowed: PhantomData<&'a [u8]>,
}

impl<'a> Frame<'a> {
    /// A frame without timestamp on channel 0.
    ///
    /// # Panics
    /// Where `data` is shorter than `dlc` means, or `dlc` is above 15.
    #[must_use]
    pub fn new(id: u32, flags: u16, dlc: u8, data: &'a [u8]) -> Self {
        let length = if flags & (FD | X) == X { 0 } else { FD_LENGTHS[usize::from(dlc)] };
        assert!(data.len() >= length);
        Self {
            data: data.as_ptr(),
            timestamp: 0,
            id,
            flags,
            channel: 0,
            id_aux: 0,
            dlc,
            timestamp_format: 0,
            borrowed: PhantomData,
        }
    }

    /// The same with a timestamp of this format, 0 to 3.
    ///
    /// # Panics
    /// For other formats.
    #[must_use]
    pub fn with_timestamp(mut self, format: u8, value: u64) -> Self {
        assert!(format <= 3);
        self.timestamp_format = format;
        self.timestamp = value;
        self
    }

    /// The flags.
    #[must_use]
    pub fn flags(&self) -> u16 {
        self.flags
    }

    /// The data length code.
    #[must_use]
    pub fn dlc(&self) -> u8 {
        self.dlc
    }

    /// Format of the timestamp.
    #[must_use]
    pub fn timestamp_format(&self) -> u8 {
        self.timestamp_format
    }

    /// The data that the DLC means; none in a remote frame.
    #[must_use]
    pub fn data(&self) -> &'a [u8] {
        let remote = self.flags & (FD | X) == X;
        let length = if remote { 0 } else { FD_LENGTHS[usize::from(self.dlc)] };
        // SAFETY: `data` has this many bytes, by `new` or by the C parser, which has looked.
        unsafe { std::slice::from_raw_parts(self.data, length) }
    }
}

/// A TX_RESULT packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TxResult {
    /// Channel.
    pub channel: u8,
    /// Sequence of the image that held the frame.
    pub sequence: u16,
    /// Place of the frame in that image.
    pub index: u8,
    /// What became of it.
    pub code: u8,
}

/// A packet received.
#[derive(Clone, Copy, Debug)]
pub enum Packet<'a> {
    /// A frame and its place among the frames of the image.
    Frame(Frame<'a>, u8),
    /// A TX_RESULT.
    TxResult(TxResult),
}

#[repr(C)]
struct RawPacket<'a> {
    frame: Frame<'a>,
    sequence: u16,
    kind: u8,
    length: u8,
    index: u8,
    code: u8,
}

#[repr(C)]
#[derive(Clone, Debug)]
struct RawWriter {
    profile: Profile,
    position: usize,
    sequence: u16,
    count: u8,
    frames: u8,
    results: u8,
    wrapped: u8,
}

#[repr(C)]
struct RawReader {
    profile: Profile,
    position: *const u8,
    end: *const u8,
    left: u8,
    frames: u8,
}

unsafe extern "C" {
    fn plain_crc16(data: *const u8, length: usize) -> u16;
    fn plain_writer_init(writer: *mut RawWriter, profile: *const Profile);
    fn plain_begin(writer: *mut RawWriter, image: *mut u8);
    fn plain_push(writer: *mut RawWriter, image: *mut u8, frame: *const Frame<'_>) -> c_int;
    fn plain_push_tx_result(
        writer: *mut RawWriter,
        image: *mut u8,
        result: *const RawPacket<'_>,
    ) -> c_int;
    fn plain_commit(writer: *mut RawWriter, image: *mut u8) -> u16;
    fn plain_reader_init(reader: *mut RawReader, profile: *const Profile);
    fn plain_open(reader: *mut RawReader, image: *const u8) -> c_int;
    fn plain_next(reader: *mut RawReader, packet: *mut RawPacket<'_>) -> c_int;
    fn plain_encode(
        writer: *mut RawWriter,
        image: *mut u8,
        frames: *const Frame<'_>,
        count: usize,
    ) -> usize;
    fn plain_decode(reader: *mut RawReader, image: *const u8) -> u64;
}

/// CRC-16/CCITT-FALSE.
#[inline]
#[must_use]
pub fn crc16(data: &[u8]) -> u16 {
    // SAFETY: the slice has this many bytes.
    unsafe { plain_crc16(data.as_ptr(), data.len()) }
}

/// Writes images.
#[derive(Clone, Debug)]
pub struct Writer(RawWriter);

impl Writer {
    /// A writer whose first image has sequence number `sequence`.
    ///
    /// # Panics
    /// For a profile without a legal image size.
    #[must_use]
    pub fn new(profile: &Profile, sequence: u16) -> Self {
        profile.assert_valid();
        let mut raw = MaybeUninit::uninit();
        // SAFETY: both pointers are valid; every field is set.
        let mut raw = unsafe {
            plain_writer_init(raw.as_mut_ptr(), profile);
            raw.assume_init()
        };
        raw.sequence = sequence;
        Self(raw)
    }

    fn image(&self, image: &mut [u8]) -> *mut u8 {
        assert!(image.len() >= usize::from(self.0.profile.bytes));
        image.as_mut_ptr()
    }

    /// Starts an image.
    pub fn begin(&mut self, image: &mut [u8]) {
        let image = self.image(image);
        // SAFETY: the image has the bytes of the profile.
        unsafe { plain_begin(&mut self.0, image) }
    }

    /// Appends a frame; its place among the frames, or a negative error.
    pub fn push(&mut self, image: &mut [u8], frame: &Frame<'_>) -> i32 {
        let image = self.image(image);
        // SAFETY: the image has the bytes of the profile, the frame its data.
        unsafe { plain_push(&mut self.0, image, frame) }
    }

    /// Appends a TX_RESULT; 0 or a negative error.
    pub fn push_tx_result(&mut self, image: &mut [u8], result: &TxResult) -> i32 {
        let image = self.image(image);
        let mut frame = Frame::new(0, 0, 0, &[]);
        frame.channel = result.channel;
        let TxResult { sequence, index, code, .. } = *result;
        let raw = RawPacket { frame, sequence, kind: 1, length: 0, index, code };
        // SAFETY: the image has the bytes of the profile.
        unsafe { plain_push_tx_result(&mut self.0, image, &raw) }
    }

    /// Publishes the image.
    pub fn commit(&mut self, image: &mut [u8]) -> u16 {
        let image = self.image(image);
        // SAFETY: the image has the bytes of the profile.
        unsafe { plain_commit(&mut self.0, image) }
    }

    /// A whole image with as many of the frames as fit; returns how many.
    pub fn encode(&mut self, image: &mut [u8], frames: &[Frame<'_>]) -> usize {
        let image = self.image(image);
        // SAFETY: the image has the bytes of the profile, each frame its data.
        unsafe { plain_encode(&mut self.0, image, frames.as_ptr(), frames.len()) }
    }
}

/// Reads images.
pub struct Reader(RawReader);

impl Reader {
    /// A reader.
    ///
    /// # Panics
    /// For a profile without a legal image size.
    #[must_use]
    pub fn new(profile: &Profile) -> Self {
        profile.assert_valid();
        let mut raw = MaybeUninit::uninit();
        // SAFETY: both pointers are valid; every field is set.
        Self(unsafe {
            plain_reader_init(raw.as_mut_ptr(), profile);
            raw.assume_init()
        })
    }

    fn image(&self, image: &[u8]) -> *const u8 {
        assert!(image.len() >= usize::from(self.0.profile.bytes));
        image.as_ptr()
    }

    /// The packets of an image and whether they ended well; `None` where the image is rejected.
    pub fn read<'a>(&mut self, image: &'a [u8]) -> Option<(Vec<Packet<'a>>, bool)> {
        let image = self.image(image);
        // SAFETY: the image has the bytes of the profile.
        if unsafe { plain_open(&mut self.0, image) } != 0 {
            return None;
        }
        let mut packets = Vec::new();
        loop {
            let frame = Frame::new(0, 0, 0, &[]);
            let mut raw = RawPacket { frame, sequence: 0, kind: 0, length: 0, index: 0, code: 0 };
            // SAFETY: the image that was opened is still borrowed.
            let outcome = unsafe { plain_next(&mut self.0, &mut raw) };
            if outcome <= 0 {
                return Some((packets, outcome == 0));
            }
            packets.push(match raw.kind {
                0 => {
                    assert_eq!(raw.frame.data().len(), usize::from(raw.length));
                    Packet::Frame(raw.frame, raw.index)
                }
                _ => Packet::TxResult(TxResult {
                    channel: raw.frame.channel,
                    sequence: raw.sequence,
                    index: raw.index,
                    code: raw.code,
                }),
            });
        }
    }

    /// Reads a whole image: the sum over its frames of channel, identifier, length and first data
    /// byte. 0 where the image is rejected.
    pub fn decode(&mut self, image: &[u8]) -> u64 {
        let image = self.image(image);
        // SAFETY: the image has the bytes of the profile.
        unsafe { plain_decode(&mut self.0, image) }
    }
}
