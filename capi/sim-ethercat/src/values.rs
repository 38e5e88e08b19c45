//! Reading and writing IEEE values in process data, which is little endian and unaligned.

use std::ffi::{c_double, c_float, c_void};

/// Reads four bytes as a value.
///
/// # Safety
/// `data` is valid for reading four bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecrt_read_real(data: *const c_void) -> c_float {
    // SAFETY: the caller's promise; an array of bytes needs no alignment.
    c_float::from_le_bytes(unsafe { data.cast::<[u8; 4]>().read() })
}

/// Reads eight bytes as a value.
///
/// # Safety
/// `data` is valid for reading eight bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecrt_read_lreal(data: *const c_void) -> c_double {
    // SAFETY: the caller's promise; an array of bytes needs no alignment.
    c_double::from_le_bytes(unsafe { data.cast::<[u8; 8]>().read() })
}

/// Writes a value as four bytes.
///
/// # Safety
/// `data` is valid for writing four bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecrt_write_real(data: *mut c_void, value: c_float) {
    // SAFETY: the caller's promise; an array of bytes needs no alignment.
    unsafe { data.cast::<[u8; 4]>().write(value.to_le_bytes()) }
}

/// Writes a value as eight bytes.
///
/// # Safety
/// `data` is valid for writing eight bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ecrt_write_lreal(data: *mut c_void, value: c_double) {
    // SAFETY: the caller's promise; an array of bytes needs no alignment.
    unsafe { data.cast::<[u8; 8]>().write(value.to_le_bytes()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_little_endian_at_any_offset() {
        let mut bytes = [0u8; 16];
        // SAFETY: there is room for both.
        unsafe {
            ecrt_write_real(bytes.as_mut_ptr().add(1).cast(), -2.5);
            ecrt_write_lreal(bytes.as_mut_ptr().add(7).cast(), 1.0);
        }
        assert_eq!(bytes[..7], [0, 0, 0, 0x20, 0xC0, 0, 0]);
        assert_eq!(bytes[7..], [0, 0, 0, 0, 0, 0, 0xF0, 0x3F, 0]);
        // SAFETY: as above.
        unsafe {
            assert_eq!(ecrt_read_real(bytes.as_ptr().add(1).cast()), -2.5);
            assert_eq!(ecrt_read_lreal(bytes.as_ptr().add(7).cast()), 1.0);
        }
    }
}
