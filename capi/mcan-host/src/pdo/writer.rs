//! Writing images
//!
//! ```c
//! igh_mcan_pdo_writer_init(&writer, &profile);
//! for each cycle:
//!     igh_mcan_pdo_writer_begin(&writer, rxpdo, rxpdo_size);
//!     igh_mcan_pdo_writer_add_can(&writer, 0, 0x123, 0, data, 8);
//!     igh_mcan_pdo_writer_finish(&writer, NULL);
//! ```

use ecan_c_boundary::frames::{classic_frame_at, fd_frame, igh_mcan_tx_frame_t};
use ecan_c_boundary::profile::igh_mcan_pdo_profile_t;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, Opaque, pointers};
use ecan_c_export::export;
use ecan_protocol::can::FrameRef;
use ecan_protocol::image::{CommitFields, ImageWriter, Schedule};

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
