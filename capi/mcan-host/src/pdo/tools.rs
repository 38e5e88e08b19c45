//! Checksum and data lengths

use std::ffi::c_int;

use ecan_c_export::export;
use ecan_protocol::can::Dlc;
use ecan_protocol::image::crc16;

/// Computes CRC-16/CCITT-FALSE, the checksum of an image's payload (manual 6).
///
/// @usage   rt, any thread, any time
/// @return  The CRC; 0xFFFF, that of no bytes, for NULL.
#[export(call, or 0xFFFF)]
pub fn igh_mcan_pdo_crc16(data: *const u8, len: usize) -> u16 {
    // SAFETY: the pointer is C's, valid or NULL as the header demands.
    Ok(crc16(unsafe { call.items("data", data, len)? }))
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
    let dlc = Dlc::new(dlc).ok_or_else(|| {
        call.argument("dlc", format_args!("{dlc} is out of range; allowed: 0 to 15"))
    })?;
    Ok(if is_fd != 0 { dlc.fd_len() } else { dlc.classic_len() } as c_int)
}
