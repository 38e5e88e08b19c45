//! Reading images: frames, faults, channel status, checksum.

use std::ffi::{c_char, c_int};

use ecan_c_boundary::frames::igh_mcan_rx_frame_t;
use ecan_c_boundary::image::{
    igh_mcan_channel_status_t, igh_mcan_pdo_error_t, igh_mcan_pdo_parse_diag_t,
    igh_mcan_pdo_profile_t,
};
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, Opaque, OutArray, OutPointer, mirror, pointers};
use ecan_c_export::export;
use ecan_protocol::can::Dlc;
use ecan_protocol::image::{
    Arrival, ChannelStatus, Header, ImageReader, Packet, ParseDiagnosis, PdoError, SequenceTracker,
    crc16,
};
use ecan_protocol::mapping::HEADER_BYTES;

// Section: Reading images

mirror! {
    /// The header of an image, as transmitted (manual 6), without any check.
    #[derive(Default)]
    pub struct igh_mcan_pdo_header_t from header: &Header {
        /// Header version and length, 0x16.
        ver_ihl: u8,
        /// Flags (manual 6.1).
        flags: u8 = header.flags.bits(),
        /// Sequence number of the image.
        seq_begin: u16,
        /// The same, written last: an image is complete if both agree.
        seq_end: u16,
        /// Valid bytes of the frame area.
        payload_len: u16,
        /// CRC over them; 0 without CRC.
        payload_crc16: u16,
        /// Short ID of the layout.
        layout_id: u16,
        /// Enabled channels.
        channel_mask: u8,
        /// Packets in the frame area.
        frame_count: u8,
        /// Overflows and truncations of this image, at most 255.
        overflow_sat: u8,
        /// 1 = CRC-16/CCITT-FALSE, 0 = none.
        crc_alg: u8,
        /// Status words of the channels; see igh_mcan_channel_status_decode().
        channel_status: [u16; 4] = header.channel_status.map(|status| status.raw()),
    }
}

mirror! {
    /// Relation of an image's sequence number to the one before (manual 6.1).
    pub enum igh_mcan_pdo_arrival_t from Arrival {
        /// The first image, or one with a lower number, as after a restart of the sender.
        IGH_MCAN_PDO_FIRST = 0 => Arrival::First,
        /// The expected number.
        IGH_MCAN_PDO_NEXT = 1 => Arrival::Next,
        /// The same image again; its packets were read already.
        IGH_MCAN_PDO_REPEATED = 2 => Arrival::Repeated,
        /// A new image after lost ones.
        IGH_MCAN_PDO_GAP = 3 => Arrival::Gap { .. },
    }
}

/// Tracks the sequence numbers of one direction. Plain data without resources.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_mcan_pdo_sequence_t {
    /// Not for the application.
    pub opaque: [u64; 2],
}

impl Opaque for igh_mcan_pdo_sequence_t {
    type Value = SequenceTracker;
    const SEAL: u64 = 0x6d63_616e_5f73_6571;
    const INIT: &'static str = "igh_mcan_pdo_sequence_init";
}

/// Reads the header of an image.
///
/// @param image   The image.
/// @param size    Its bytes, at least 24.
/// @param header  Is overwritten.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_BUFFER.
#[export(call)]
pub fn igh_mcan_pdo_parse_header(
    image: *const u8,
    size: usize,
    header: *mut igh_mcan_pdo_header_t,
) {
    pointers!(call, items(image, size), out(header));
    let Some(head) = image.first_chunk::<HEADER_BYTES>() else {
        let text = format_args!("the image has {size} bytes, its header {HEADER_BYTES}");
        return Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text));
    };
    header.set((&Header::parse(head)).into());
}

/// An image that was read as a whole.
struct Parsed {
    found: usize,
    layout: Option<Layout>,
}

/// A layout other than that of the profile.
struct Layout {
    found: Header,
    expected: u16,
}

impl Layout {
    fn diagnosis(&self) -> igh_mcan_pdo_parse_diag_t {
        igh_mcan_pdo_parse_diag_t {
            error: igh_mcan_pdo_error_t::IGH_MCAN_PDO_LAYOUT as u16,
            seq: self.found.seq_begin,
            payload_len: self.found.payload_len,
            payload_crc16: self.found.payload_crc16,
            layout_id: self.found.layout_id,
            ..Default::default()
        }
    }
}

/// Checks an image and reads its frames (manual 6.1).
fn parse(
    call: Call,
    profile: &igh_mcan_pdo_profile_t,
    image: &[u8],
    frames: &mut OutArray<igh_mcan_rx_frame_t>,
) -> Result<Result<Parsed, ParseDiagnosis>, ecan_result_t> {
    let (direction, profile) = profile.checked(call)?;
    let reader = ImageReader::new(direction, profile);
    let image = match reader.read(image) {
        Ok(image) => image,
        Err(diagnosis) => return Ok(Err(diagnosis)),
    };
    let layout = image
        .layout_changed()
        .then(|| Layout { found: *image.header(), expected: profile.layout_id() });
    let mut found = 0;
    for packet in image.packets() {
        match packet {
            Ok(Packet::Frame(packet)) => {
                frames.push(igh_mcan_rx_frame_t::from_packet(0, &packet));
            }
            Ok(Packet::TxResult(result)) => {
                frames.push(igh_mcan_rx_frame_t::from_result(0, &result, false));
            }
            Err(diagnosis) => return Ok(Err(diagnosis)),
        }
        found += 1;
    }
    Ok(Ok(Parsed { found, layout }))
}

fn parse_into(
    call: Call,
    profile: &igh_mcan_pdo_profile_t,
    image: &[u8],
    mut frames: OutArray<igh_mcan_rx_frame_t>,
    count: OutPointer<usize>,
    diag: Option<OutPointer<igh_mcan_pdo_parse_diag_t>>,
) -> Result<(), ecan_result_t> {
    count.set(0);
    let parsed = parse(call, profile, image, &mut frames)?;
    count.set(frames.count());
    if let Some(diag) = diag {
        diag.set(match &parsed {
            Ok(Parsed { layout: Some(layout), .. }) => layout.diagnosis(),
            Ok(_) => igh_mcan_pdo_parse_diag_t::default(),
            Err(diagnosis) => diagnosis.into(),
        });
    }
    let Parsed { found, layout } = parsed.map_err(|diagnosis| match diagnosis.pdo_error() {
        Some(PdoError::ActiveArea) => {
            let bytes = image.len();
            let text = format_args!("{bytes} bytes are not an image of this profile");
            call.fail(ecan_result_t::ECAN_ERR_BUFFER, text)
        }
        _ => call.error(&diagnosis),
    })?;
    if let Some(Layout { found, expected }) = layout {
        let text = format_args!(
            "the image has layout_id 0x{:04X}, the profile 0x{expected:04X}; use the profile that is \
             active on the device (0x8010, 0x8011)",
            found.layout_id
        );
        return Err(call.fail(ecan_result_t::ECAN_ERR_LAYOUT, text));
    }
    if found > frames.count() {
        let text = format_args!("the image holds {found} frames, {} fit", frames.count());
        return Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text));
    }
    Ok(())
}

/// Checks an image as manual 6.1 demands and reads its frames and transmit results, with a
/// diagnosis of a fault (manual 16.2).
///
/// Stateless: igh_mcan_pdo_sequence_observe() detects an image that was read before.
///
/// @param profile   The profile that is active on the device.
/// @param txpdo     The image.
/// @param size      Its bytes, at least those of the profile.
/// @param frames    Gets the frames; their slave index is 0.
/// @param capacity  Frames that fit; an image holds at most ECAN_PDO_MAX_PACKETS.
/// @param count     Gets the number of frames stored. Frames before a fault are stored and valid.
/// @param diag      Gets the fault, error 0 for none; may be NULL.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK; ECAN_ERR_PARSE for a fault of the image; ECAN_ERR_IMAGE_BUSY for one that was
///          being written; ECAN_ERR_LAYOUT for an image of another layout than the profile's, whose
///          frames are stored; ECAN_ERR_BUFFER if size is too small or not all frames fit;
///          ECAN_ERR_ARGUMENT, ECAN_ERR_CONFIG.
#[export(call)]
pub fn igh_mcan_pdo_parse_frames_ex(
    profile: *const igh_mcan_pdo_profile_t,
    txpdo: *const u8,
    size: usize,
    frames: *mut igh_mcan_rx_frame_t,
    capacity: usize,
    count: *mut usize,
    diag: *mut igh_mcan_pdo_parse_diag_t,
) {
    pointers!(call, out(count), optional_out(diag), read(profile), items(txpdo, size));
    pointers!(call, room(frames, capacity));
    parse_into(call, profile, txpdo, frames, count, diag)
}

/// Starts tracking sequence numbers.
///
/// @param sequence  Is overwritten.
///
/// @usage   rt, any thread, any time
#[export(call)]
pub fn igh_mcan_pdo_sequence_init(sequence: *mut igh_mcan_pdo_sequence_t) {
    pointers!(call, out(sequence));
    sequence.seal(SequenceTracker::new());
}

/// Compares the number of an image that was received intact with the last one, and stores it.
///
/// @param number  seq_begin of the image.
/// @param lost    Gets the number of images lost before this one; may be NULL.
///
/// @usage   rt, one thread at a time, after init
/// @return  An igh_mcan_pdo_arrival_t, or a negative ecan_result_t.
#[export(call)]
pub fn igh_mcan_pdo_sequence_observe(
    sequence: *mut igh_mcan_pdo_sequence_t,
    number: u16,
    lost: *mut u16,
) -> c_int {
    pointers!(call, sealed_mut(sequence), optional_out(lost));
    let arrival = sequence.observe(number);
    if let Some(out) = lost {
        out.set(if let Arrival::Gap { lost } = arrival { lost } else { 0 });
    }
    Ok(igh_mcan_pdo_arrival_t::from(arrival) as c_int)
}

// Section: Faults of an image

/// Gets a diagnosis as text.
///
/// @param text  See the rules for texts in igh_ecan_common.h; 256 bytes are enough.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_BUFFER; ECAN_ERR_ARGUMENT for an unknown error.
#[export(call)]
pub fn igh_mcan_pdo_diag_text(
    diag: *const igh_mcan_pdo_parse_diag_t,
    text: *mut c_char,
    size: usize,
    needed: *mut usize,
) {
    pointers!(call, read(diag), out_text(text, size, needed));
    if diag.error == igh_mcan_pdo_error_t::IGH_MCAN_PDO_LAYOUT as u16 {
        let layout = diag.layout_id;
        let found = format!("layout_id 0x{layout:04X} of the image is not that of the profile");
        return text.put(call, &found);
    }
    call.reserved("diag", &diag.reserved)?;
    let diagnosis = diag.to_diagnosis().ok_or_else(|| {
        call.argument("diag", format_args!("has the unknown error {}", diag.error))
    })?;
    text.put(call, &diagnosis.to_string())
}

// Section: Channel status

/// Decodes a channel status word.
///
/// @param raw     The word of the image header.
/// @param status  Is overwritten.
///
/// @usage   rt, any thread, any time
#[export(call)]
pub fn igh_mcan_channel_status_decode(raw: u16, status: *mut igh_mcan_channel_status_t) {
    pointers!(call, out(status));
    status.set(ChannelStatus::from_raw(raw).into());
}

// Section: Checksum and data lengths

/// Computes CRC-16/CCITT-FALSE, the checksum of an image's payload (manual 6).
///
/// @usage   rt, any thread, any time
/// @return  The CRC; 0xFFFF, that of no bytes, for NULL.
#[export(call, or 0xFFFF)]
pub fn igh_mcan_pdo_crc16(data: *const u8, len: usize) -> u16 {
    pointers!(call, items(data, len));
    Ok(crc16(data))
}

/// Returns the DLC of a number of data bytes (manual 8.2).
///
/// @param is_fd  0 for classic CAN, else CAN FD.
///
/// @usage   rt, any thread, any time
/// @return  0 to 15; ECAN_ERR_FRAME if no DLC stands for this length.
#[export(call)]
pub fn igh_mcan_dlc_from_len(len: usize, is_fd: c_int) -> c_int {
    let fd = is_fd != 0;
    let dlc = if fd { Dlc::from_fd_len(len) } else { Dlc::from_classic_len(len) };
    let fault = ecan_protocol::can::FrameError::Length { length: len, fd };
    dlc.map(|dlc| dlc.value().into()).ok_or_else(|| call.error(&fault))
}

/// Returns the number of data bytes of a DLC (manual 8.2).
///
/// @param is_fd  0 for classic CAN, where 8 to 15 all stand for 8 bytes; else CAN FD.
///
/// @usage   rt, any thread, any time
/// @return  0 to 64; ECAN_ERR_ARGUMENT above 15.
#[export(call)]
pub fn igh_mcan_len_from_dlc(dlc: u8, is_fd: c_int) -> c_int {
    let dlc = Dlc::from_raw(dlc).ok_or_else(|| {
        call.argument("dlc", format_args!("{dlc} is out of range; allowed: 0 to 15"))
    })?;
    Ok(if is_fd != 0 { dlc.fd_len() } else { dlc.classic_len() } as c_int)
}
