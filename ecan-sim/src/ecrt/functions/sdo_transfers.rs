use super::{bytes, on_master, store};
use crate::ecrt::calls::CallResult;
use crate::ecrt::sdo_object::SdoObject;
use ecrt_sys::ec_master_t;
use libc::size_t;

/// Transfers. The abort code is set only with `EIO`.
///
/// # Safety
/// `abort_code` is null or valid for writing.
unsafe fn transfer(
    master: *mut ec_master_t,
    position: u16,
    object: SdoObject,
    download: Option<Vec<u8>>,
    abort_code: *mut u32,
) -> CallResult<Vec<u8>> {
    on_master(master)?.shared.transfer(position, object, download).map_err(|failure| {
        if failure.errno == libc::EIO {
            // SAFETY: the caller's promise. Without a pointer the code is dropped.
            let _ = unsafe { store(abort_code, failure.abort_code) };
        }
        failure.errno
    })
}

functions! {
    one_form master_sdo_download(
        master: *mut ec_master_t, position: u16, index: u16, subindex: u8, data: *const u8,
        size: size_t, abort_code: *mut u32
    ) {
        let object = SdoObject::entry(index, subindex);
        // SAFETY: the caller passes `size` bytes and a pointer for the code, each or null.
        unsafe {
            let data = bytes(data, size)?;
            transfer(master, position, object, Some(data), abort_code).map(drop)
        }
    }

    /// Writes an object by Complete Access, which the gateway rejects.
    one_form master_sdo_download_complete(
        master: *mut ec_master_t, position: u16, index: u16, data: *const u8, size: size_t,
        abort_code: *mut u32
    ) {
        // SAFETY: the caller passes `size` bytes and a pointer for the code, each or null.
        unsafe {
            let data = bytes(data, size)?;
            transfer(master, position, SdoObject::whole(index), Some(data), abort_code).map(drop)
        }
    }

    one_form master_sdo_upload(
        master: *mut ec_master_t, position: u16, index: u16, subindex: u8, target: *mut u8,
        target_size: size_t, result_size: *mut size_t, abort_code: *mut u32
    ) {
        let object = SdoObject::entry(index, subindex);
        // SAFETY: the caller passes a pointer for the code, or null.
        let data = unsafe { transfer(master, position, object, None, abort_code)? };
        if data.len() > target_size {
            return Err(libc::EOVERFLOW);
        }
        if target.is_null() {
            return Err(libc::EFAULT);
        }
        // SAFETY: the caller passes a pointer to `target_size` bytes, and there are no more.
        unsafe { target.copy_from_nonoverlapping(data.as_ptr(), data.len()) };
        // SAFETY: the caller passes a pointer for the size, or null.
        unsafe { store(result_size, data.len()) }
    }
}
