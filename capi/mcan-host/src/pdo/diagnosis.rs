//! Faults of an image

use std::ffi::c_char;

use ecan_c_boundary::diagnosis::igh_mcan_pdo_parse_diag_t;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{pointers, put_text};
use ecan_c_export::export;

/// Gets a diagnosis as text.
///
/// @param text  Buffer; the text ends with NUL and is cut if it does not fit.
/// @param size  Bytes of the buffer, 256 are enough.
///
/// @usage   not rt, any thread, any time
/// @return  ECAN_OK, ECAN_ERR_ARGUMENT, or ECAN_ERR_BUFFER with the text cut.
#[export(call)]
pub fn igh_mcan_pdo_diag_text(
    diag: *const igh_mcan_pdo_parse_diag_t,
    text: *mut c_char,
    size: usize,
) {
    pointers!(call, read(diag), room(text, size));
    let diagnosis = diag.to_diagnosis().ok_or_else(|| {
        call.argument("diag", format_args!("has the unknown error {}", diag.error))
    })?;
    if put_text(&mut text, &diagnosis.to_string()) {
        return Ok(());
    }
    Err(call.fail(
        ecan_result_t::ECAN_ERR_BUFFER,
        format_args!("the buffer of {size} bytes is too small"),
    ))
}
