//! Startup SDOs.

use super::{bytes, on_config, status};
use crate::ecrt::calls::CallResult;
use crate::ecrt::sdo_transfer::SdoObject;
use crate::ecrt::slave_config::StartupSdo;
use ecrt_sys::ec_slave_config_t;
use libc::{c_int, size_t};

fn add(config: *mut ec_slave_config_t, object: SdoObject, data: Vec<u8>) -> CallResult {
    on_config(config)?.change(|config| {
        config.sdos.push(StartupSdo { object, data });
        Ok(())
    })
}

/// `ecrt_slave_config_sdo`: a value of any size.
pub unsafe extern "C" fn slave_config_sdo(
    config: *mut ec_slave_config_t,
    index: u16,
    subindex: u8,
    data: *const u8,
    size: size_t,
) -> c_int {
    status(|| {
        // SAFETY: the caller passes `size` bytes, or null.
        add(config, SdoObject::entry(index, subindex), unsafe { bytes(data, size)? })
    })
}

/// `ecrt_slave_config_sdo8`: one byte.
pub unsafe extern "C" fn slave_config_sdo8(
    config: *mut ec_slave_config_t,
    index: u16,
    subindex: u8,
    value: u8,
) -> c_int {
    status(|| add(config, SdoObject::entry(index, subindex), vec![value]))
}

/// `ecrt_slave_config_sdo16`: two bytes.
pub unsafe extern "C" fn slave_config_sdo16(
    config: *mut ec_slave_config_t,
    index: u16,
    subindex: u8,
    value: u16,
) -> c_int {
    status(|| add(config, SdoObject::entry(index, subindex), value.to_le_bytes().to_vec()))
}

/// `ecrt_slave_config_sdo32`: four bytes.
pub unsafe extern "C" fn slave_config_sdo32(
    config: *mut ec_slave_config_t,
    index: u16,
    subindex: u8,
    value: u32,
) -> c_int {
    status(|| add(config, SdoObject::entry(index, subindex), value.to_le_bytes().to_vec()))
}

/// `ecrt_slave_config_complete_sdo`: a whole object by Complete Access, which the gateway rejects
/// at startup.
pub unsafe extern "C" fn slave_config_complete_sdo(
    config: *mut ec_slave_config_t,
    index: u16,
    data: *const u8,
    size: size_t,
) -> c_int {
    // SAFETY: the caller passes `size` bytes, or null.
    status(|| add(config, SdoObject::whole(index), unsafe { bytes(data, size)? }))
}
