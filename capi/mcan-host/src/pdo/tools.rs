//! Checksum and data lengths

use std::ffi::c_int;

use ecan_protocol::can::Dlc;
use ecan_protocol::image::crc16;

use crate::boundary::getter;

/// CRC-16/CCITT-FALSE, as of the image's payload (manual 6).
///
/// @usage   rt, any thread, any time
/// @return  The CRC; 0xFFFF, that of no bytes, for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_mcan_pdo_crc16(data: *const u8, len: usize) -> u16 {
    getter(
        "igh_mcan_pdo_crc16",
        |_| 0xFFFF,
        |call| {
            // SAFETY: the pointer is C's, valid or NULL as the header demands.
            Ok(crc16(unsafe { call.items("data", data, len)? }))
        },
    )
}

/// The DLC of a number of data bytes (manual 8.2).
///
/// @param is_fd  0 for classic CAN, else CAN FD.
///
/// @usage   rt, any thread, any time
/// @return  0 to 15; ECAN_ERR_FRAME where no DLC says this length.
#[unsafe(no_mangle)]
pub extern "C" fn igh_mcan_dlc_from_len(len: usize, is_fd: c_int) -> c_int {
    getter(
        "igh_mcan_dlc_from_len",
        |error| error.code(),
        |call| {
            let fd = is_fd != 0;
            let dlc = if fd { Dlc::from_fd_len(len) } else { Dlc::from_classic_len(len) };
            let fault = ecan_protocol::can::FrameError::Length { length: len, fd };
            dlc.map(|dlc| dlc.value().into()).ok_or_else(|| call.error(&fault))
        },
    )
}

/// The number of data bytes that a DLC says (manual 8.2).
///
/// @param is_fd  0 for classic CAN, where 8 to 15 all say 8 bytes; else CAN FD.
///
/// @usage   rt, any thread, any time
/// @return  0 to 64; ECAN_ERR_ARGUMENT above 15.
#[unsafe(no_mangle)]
pub extern "C" fn igh_mcan_len_from_dlc(dlc: u8, is_fd: c_int) -> c_int {
    getter(
        "igh_mcan_len_from_dlc",
        |error| error.code(),
        |call| {
            let dlc = Dlc::new(dlc)
                .ok_or_else(|| call.argument("dlc", format_args!("{dlc} is above 15")))?;
            Ok(if is_fd != 0 { dlc.fd_len() } else { dlc.classic_len() } as c_int)
        },
    )
}
