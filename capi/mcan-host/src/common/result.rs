//! Return values

use std::ffi::{c_char, c_int};

use ecan_c_boundary::result::ecan_result_t;

/// Returns the name of a code, as it is written in this header.
///
/// @usage   rt, any thread, any time
/// @return  "ECAN_ERR_SDO" for example; "unknown result" for a value that is not a code. Static.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_result_name(code: c_int) -> *const c_char {
    let pair = ecan_result_t::PAIRS.iter().find(|(result, ..)| result.code() == code);
    pair.map_or(c"unknown result".as_ptr(), |(_, name, _)| name.as_ptr().cast())
}

/// Returns a short description of a code.
///
/// @usage   rt, any thread, any time
/// @return  "an SDO transfer failed" for example. Static.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_result_text(code: c_int) -> *const c_char {
    ecan_result_t::to_rust(code).unwrap_or(c"unknown result").as_ptr()
}

/// Returns 1 for a code after which a frame may be sent again in a later cycle: the image or the
/// queue is full, the channel is bus-off, or the gateway is not ready.
///
/// @usage   rt, any thread, any time
/// @return  1 or 0.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_result_is_temporary(code: c_int) -> c_int {
    use ecan_result_t::*;
    let temporary = [ECAN_ERR_NO_ROOM, ECAN_ERR_QUEUE_FULL, ECAN_ERR_BUS_OFF, ECAN_ERR_NOT_READY];
    temporary.iter().any(|result| result.code() == code).into()
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;

    use super::*;

    #[test]
    fn every_code_has_its_name_and_text() {
        for (result, ..) in ecan_result_t::PAIRS {
            // SAFETY: both functions return static C strings.
            let name = unsafe { CStr::from_ptr(ecan_result_name(result.code())) };
            // SAFETY: as above.
            let text = unsafe { CStr::from_ptr(ecan_result_text(result.code())) };
            assert_eq!(name.to_str().unwrap(), format!("{result:?}"));
            assert!(!text.is_empty());
            assert!(result.code() <= 0);
        }
        let unknown = c"unknown result";
        // SAFETY: as above.
        assert_eq!(unsafe { CStr::from_ptr(ecan_result_name(7)) }, unknown);
    }
}
