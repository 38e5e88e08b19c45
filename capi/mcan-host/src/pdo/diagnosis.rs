//! Faults of an image

use std::ffi::c_char;

use ecan_c_boundary::diagnosis::{igh_mcan_pdo_error_t, igh_mcan_pdo_parse_diag_t};
use ecan_c_boundary::pointers;
use ecan_c_export::export;

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
