//! Writing images: profiles, frames to send.

use std::ffi::c_int;

use ecan_c_boundary::frames::{
    check_hint, classic_frame_at, fd_frame, igh_mcan_rx_frame_t, igh_mcan_rx_kind_t,
    igh_mcan_tx_frame_t,
};
use ecan_c_boundary::image::igh_mcan_pdo_profile_t;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, Opaque, pointers};
use ecan_c_export::export;
use ecan_protocol::can::FrameRef;
use ecan_protocol::image::{CommitFields, ImageWriter, Schedule};
use ecan_protocol::mapping::CHANNELS;

// Section: Writing images
//
// igh_mcan_pdo_writer_init(&writer, &profile);
// for each cycle:
//     igh_mcan_pdo_writer_begin(&writer, rxpdo, rxpdo_size);
//     igh_mcan_pdo_writer_add_can(&writer, 0, 0x123, 0, data, 8);
//     igh_mcan_pdo_writer_finish(&writer, NULL);

/// Writes the images of one direction into a buffer of the application. Plain data without
/// resources: it may be copied and needs no deinit. One writer serves one buffer; it stores the
/// sequence number and the length of earlier images.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct igh_mcan_pdo_writer_t {
    /// Not for the application.
    pub opaque: [u64; 16],
}

/// Content of an [`igh_mcan_pdo_writer_t`].
#[derive(Debug)]
pub struct Writer {
    writer: ImageWriter,
    /// The started image, NULL for none, and its bytes.
    image: *mut u8,
    size: usize,
}

impl Opaque for igh_mcan_pdo_writer_t {
    type Value = Writer;
    const SEAL: u64 = 0x6d63_616e_5f77_7274;
    const INIT: &'static str = "igh_mcan_pdo_writer_init";
}

impl Writer {
    /// Writer and started image.
    ///
    /// # Safety
    /// The buffer given to `begin` is still valid and not used otherwise during the call.
    unsafe fn parts(&mut self, call: Call) -> Result<(&mut ImageWriter, &mut [u8]), ecan_result_t> {
        if self.image.is_null() {
            let text = format_args!("no image is started: call igh_mcan_pdo_writer_begin first");
            return Err(call.fail(ecan_result_t::ECAN_ERR_ORDER, text));
        }
        // SAFETY: the caller's promise; `begin` has checked the size.
        let image = unsafe { std::slice::from_raw_parts_mut(self.image, self.size) };
        Ok((&mut self.writer, image))
    }

    /// # Safety
    /// As for [`parts`](Self::parts).
    unsafe fn push(
        &mut self,
        call: Call,
        channel: u8,
        hint: u8,
        frame: FrameRef<'_>,
        schedule: Option<Schedule>,
    ) -> Result<(), ecan_result_t> {
        // SAFETY: the caller's promise.
        let (writer, image) = unsafe { self.parts(call)? };
        let pushed = match schedule {
            None => writer.push(image, channel, hint, frame, Default::default()),
            Some(schedule) => writer.push_scheduled(image, channel, hint, frame, schedule),
        };
        pushed.map(|_| ()).map_err(|error| call.error(&error))
    }
}

/// Prepares a writer. Its first image gets sequence number 1.
///
/// @param writer   Is overwritten.
/// @param profile  The profile that is active on the device.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT or ECAN_ERR_CONFIG.
#[export(call)]
pub fn igh_mcan_pdo_writer_init(
    writer: *mut igh_mcan_pdo_writer_t,
    profile: *const igh_mcan_pdo_profile_t,
) {
    pointers!(call, out(writer), read(profile));
    let (direction, profile) = profile.checked(call)?;
    let image_writer = ImageWriter::new(direction, profile);
    writer.seal(Writer { writer: image_writer, image: std::ptr::null_mut(), size: 0 });
}

/// Starts an image in a buffer. Frames added since the last finish are dropped.
///
/// @param rxpdo       Buffer of the image, in the process data for example. Must stay valid until
///                    igh_mcan_pdo_writer_finish().
/// @param rxpdo_size  Its bytes, at least those of the profile.
///
/// @usage   rt, one thread at a time, after init
/// @return  ECAN_OK, ECAN_ERR_BUFFER.
#[export(call)]
pub fn igh_mcan_pdo_writer_begin(
    writer: *mut igh_mcan_pdo_writer_t,
    rxpdo: *mut u8,
    rxpdo_size: usize,
) {
    pointers!(call, sealed_mut(writer), out(rxpdo));
    let needed = writer.writer.profile().pdo_bytes();
    if rxpdo_size < needed {
        let text = format_args!("the buffer has {rxpdo_size} bytes, the image {needed}");
        return Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text));
    }
    writer.writer.begin();
    (writer.image, writer.size) = (rxpdo.as_ptr(), needed);
}

/// Adds a frame to the image; its slave index is ignored.
///
/// @usage   rt, one thread at a time, after begin
/// @return  ECAN_OK; ECAN_ERR_NO_ROOM if the image is full; ECAN_ERR_CHANNEL if the profile does
///          not have the channel; ECAN_ERR_FRAME, ECAN_ERR_ARGUMENT, ECAN_ERR_ORDER. The image
///          changes only with ECAN_OK.
#[export(call)]
pub fn igh_mcan_pdo_writer_add(
    writer: *mut igh_mcan_pdo_writer_t,
    frame: *const igh_mcan_tx_frame_t,
) {
    pointers!(call, sealed_mut(writer), read(frame));
    // SAFETY: C keeps the image valid until it is finished.
    unsafe {
        let hint = frame.checked_hint(call)?;
        writer.push(call, frame.channel, hint, frame.frame(call)?, frame.schedule())
    }
}

/// Adds a classic CAN frame to the image. Arguments as of igh_mcan_tx_frame_set_can().
///
/// @usage   rt, one thread at a time, after begin
/// @return  As igh_mcan_pdo_writer_add().
#[export(call)]
pub fn igh_mcan_pdo_writer_add_can(
    writer: *mut igh_mcan_pdo_writer_t,
    channel: u8,
    can_id: u32,
    flags: u8,
    data: *const u8,
    len: usize,
) {
    pointers!(call, sealed_mut(writer));
    // SAFETY: the data are C's; C keeps the image valid until it is finished.
    unsafe {
        let frame = classic_frame_at(call, can_id, flags, data, len)?;
        writer.push(call, channel, 0, frame, None)
    }
}

/// Adds a CAN FD frame to the image. Arguments as of igh_mcan_tx_frame_set_canfd().
///
/// @usage   rt, one thread at a time, after begin
/// @return  As igh_mcan_pdo_writer_add().
#[export(call)]
pub fn igh_mcan_pdo_writer_add_canfd(
    writer: *mut igh_mcan_pdo_writer_t,
    channel: u8,
    can_id: u32,
    flags: u8,
    data: *const u8,
    len: usize,
) {
    pointers!(call, sealed_mut(writer), items(data, len));
    // SAFETY: C keeps the image valid until it is finished.
    unsafe { writer.push(call, channel, 0, fd_frame(call, can_id, flags, data)?, None) }
}

/// Finishes the image: clears the rest of earlier images, computes the CRC, writes the header, and
/// the second sequence number last. Call it in every cycle with frames to send: the device ignores
/// an image whose sequence number it has received before.
///
/// @param sequence  Gets the image's sequence number, to which a TX_RESULT refers; may be NULL.
///
/// @usage   rt, one thread at a time, after begin
/// @return  ECAN_OK, ECAN_ERR_ORDER.
#[export(call)]
pub fn igh_mcan_pdo_writer_finish(writer: *mut igh_mcan_pdo_writer_t, sequence: *mut u16) {
    pointers!(call, sealed_mut(writer), optional_out(sequence));
    // SAFETY: C keeps the image valid until it is finished.
    let (image_writer, image) = unsafe { writer.parts(call)? };
    let number = image_writer.commit(image, CommitFields::default());
    writer.image = std::ptr::null_mut();
    if let Some(sequence) = sequence {
        sequence.set(number);
    }
}

/// Sets the sequence number of the next image, as after a reset of the device's session
/// (0x8011:08, manual 13.2).
///
/// @usage   rt, one thread at a time, after init
#[export(call)]
pub fn igh_mcan_pdo_writer_set_next_sequence(writer: *mut igh_mcan_pdo_writer_t, sequence: u16) {
    pointers!(call, sealed_mut(writer));
    writer.writer.set_next_sequence(sequence);
}

/// Returns the free bytes of the image; a packet needs 4 to 78 of them (manual 8.3).
///
/// @usage   rt, one thread at a time, after init
/// @return  The bytes; 0 if there is no writer.
#[export(call, or 0)]
pub fn igh_mcan_pdo_writer_room(writer: *mut igh_mcan_pdo_writer_t) -> usize {
    pointers!(call, sealed_mut(writer));
    Ok(writer.writer.room())
}

/// Returns the number of frames in the image, at most 255.
///
/// @usage   rt, one thread at a time, after init
/// @return  The number; 0 if there is no writer.
#[export(call, or 0)]
pub fn igh_mcan_pdo_writer_frames(writer: *mut igh_mcan_pdo_writer_t) -> usize {
    pointers!(call, sealed_mut(writer));
    Ok(writer.writer.frames().into())
}

// Section: Frames to send

/// Checks a slave index and a channel for a frame.
fn slave_of(call: Call, slave: usize, channel: u8) -> Result<u16, ecan_result_t> {
    if usize::from(channel) >= CHANNELS {
        let text =
            format_args!("channel {channel} is out of range; allowed: 0 to {}", CHANNELS - 1);
        return Err(call.fail(ecan_result_t::ECAN_ERR_CHANNEL, text));
    }
    u16::try_from(slave).map_err(|_| {
        let text = format_args!("slave index {slave} is out of range");
        call.fail(ecan_result_t::ECAN_ERR_SLAVE, text)
    })
}

/// Fills a classic CAN frame that is sent at once.
///
/// @param frame    Is overwritten.
/// @param slave    Slave index.
/// @param channel  Channel of the gateway, 0 to 3.
/// @param can_id   11 bits; 29 bits with IGH_MCAN_FLAG_EXT.
/// @param flags    0, IGH_MCAN_FLAG_EXT, IGH_MCAN_FLAG_RTR.
/// @param data     Data; may be NULL if len is 0 and for a remote frame.
/// @param len      Bytes, 0 to 8; of a remote frame the requested DLC.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_SLAVE, ECAN_ERR_CHANNEL or ECAN_ERR_FRAME; the frame is written only
///          with ECAN_OK.
#[export(call)]
pub fn igh_mcan_tx_frame_set_can(
    frame: *mut igh_mcan_tx_frame_t,
    slave: usize,
    channel: u8,
    can_id: u32,
    flags: u8,
    data: *const u8,
    len: usize,
) {
    pointers!(call, out(frame));
    // SAFETY: the data are C's, valid or NULL as the header demands.
    let can = unsafe { classic_frame_at(call, can_id, flags, data, len)? };
    frame.set(igh_mcan_tx_frame_t::from_frame(slave_of(call, slave, channel)?, channel, can));
}

/// Fills a CAN FD frame that is sent at once.
///
/// @param flags  0, IGH_MCAN_FLAG_EXT, IGH_MCAN_FLAG_BRS, IGH_MCAN_FLAG_ESI; IGH_MCAN_FLAG_FD is
///               accepted.
/// @param len    Bytes: 0 to 8, 12, 16, 20, 24, 32, 48 or 64 (manual 8.2).
///
/// @usage   rt, any thread, any time
/// @return  As igh_mcan_tx_frame_set_can().
#[export(call)]
pub fn igh_mcan_tx_frame_set_canfd(
    frame: *mut igh_mcan_tx_frame_t,
    slave: usize,
    channel: u8,
    can_id: u32,
    flags: u8,
    data: *const u8,
    len: usize,
) {
    pointers!(call, out(frame), items(data, len));
    let fd = fd_frame(call, can_id, flags, data)?;
    frame.set(igh_mcan_tx_frame_t::from_frame(slave_of(call, slave, channel)?, channel, fd));
}

/// Fills a frame to send from a received one, as an echo or a bridge does, for the slave and
/// channel that received it.
///
/// @param frame     Is overwritten.
/// @param received  A frame, not a TX_RESULT.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_CHANNEL, or ECAN_ERR_FRAME if it is not a frame.
#[export(call)]
pub fn igh_mcan_tx_frame_set_received(
    frame: *mut igh_mcan_tx_frame_t,
    received: *const igh_mcan_rx_frame_t,
) {
    pointers!(call, out(frame), read(received));
    if received.kind != igh_mcan_rx_kind_t::IGH_MCAN_RX_FRAME as u8 {
        let text = format_args!("`received` is a TX_RESULT, not a frame");
        return Err(call.fail(ecan_result_t::ECAN_ERR_FRAME, text));
    }
    let igh_mcan_rx_frame_t { slave, channel, flags, can_id, len, data, .. } = *received;
    slave_of(call, slave.into(), channel)?;
    let empty = igh_mcan_tx_frame_t::EMPTY;
    let value = igh_mcan_tx_frame_t { slave, channel, flags, can_id, len, data, ..empty };
    value.frame(call)?;
    frame.set(value);
}

/// Schedules a frame for a phase of the next Sync0 period instead of at once (manual 8.4).
///
/// @param offset_ns  Phase, in nanoseconds, below the Sync0 period.
/// @param tag        Tag of the application.
///
/// @usage   rt, any thread, any time
#[export(call)]
pub fn igh_mcan_tx_frame_set_schedule(frame: *mut igh_mcan_tx_frame_t, offset_ns: u32, tag: u16) {
    pointers!(call, change(frame));
    (frame.scheduled, frame.offset_ns, frame.tag) = (1, offset_ns, tag);
}

/// Sets the hint for the gateway's transmit path (manual 8.1).
///
/// @param hint  An igh_mcan_hint_t.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT.
#[export(call)]
pub fn igh_mcan_tx_frame_set_hint(frame: *mut igh_mcan_tx_frame_t, hint: c_int) {
    pointers!(call, change(frame));
    frame.hint = check_hint(call, hint)?;
}

// Section: PDO profiles

/// Fills a profile: N chunks of 128 bytes for these channels, all other fields at their defaults.
///
/// @param profile       Is overwritten.
/// @param direction     An igh_mcan_direction_t.
/// @param multiplier    N, 1 to 24.
/// @param channel_mask  Channels, bit 0 for channel 0.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT or ECAN_ERR_CONFIG.
#[export(call)]
pub fn igh_mcan_pdo_profile_default(
    profile: *mut igh_mcan_pdo_profile_t,
    direction: c_int,
    multiplier: u8,
    channel_mask: u8,
) {
    pointers!(call, out(profile));
    let value = igh_mcan_pdo_profile_t {
        direction: u8::try_from(direction).unwrap_or(u8::MAX),
        multiplier,
        channel_mask,
        encapsulation: 0,
        budget: 0,
        options: 0,
        reserved: [0; 10],
    };
    value.checked(call)?;
    profile.set(value);
}

/// Checks a profile.
///
/// @usage   rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT or ECAN_ERR_CONFIG.
#[must_use]
#[export(call)]
pub fn igh_mcan_pdo_profile_check(profile: *const igh_mcan_pdo_profile_t) {
    pointers!(call, read(profile));
    profile.checked(call).map(|_| ())
}

/// Returns the profile word, as in 0x8010:12 and 0x8011:12 when the profile is active (manual
/// 13.2).
///
/// @usage   rt, any thread, any time
/// @return  The word; 0, which no valid profile has, for a faulty profile or NULL.
#[export(call, or 0)]
pub fn igh_mcan_pdo_profile_word(profile: *const igh_mcan_pdo_profile_t) -> u32 {
    pointers!(call, read(profile));
    Ok(profile.checked(call)?.1.word())
}

/// Returns the layout_id of the image header: the profile word folded to 16 bits (manual 5.4.4.1).
///
/// @usage   rt, any thread, any time
/// @return  The ID; 0 for a faulty profile or NULL.
#[export(call, or 0)]
pub fn igh_mcan_pdo_layout_id(profile: *const igh_mcan_pdo_profile_t) -> u16 {
    pointers!(call, read(profile));
    Ok(profile.checked(call)?.1.layout_id())
}

/// Returns the bytes of an image with a profile: 128 * N.
///
/// @usage   rt, any thread, any time
/// @return  The bytes; 0 for a faulty profile or NULL.
#[export(call, or 0)]
pub fn igh_mcan_pdo_bytes(profile: *const igh_mcan_pdo_profile_t) -> usize {
    pointers!(call, read(profile));
    Ok(profile.checked(call)?.1.pdo_bytes())
}
