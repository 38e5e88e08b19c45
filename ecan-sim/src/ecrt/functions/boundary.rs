//! Boundary of the C functions: pointers outside, checked calls inside.
//!
//! # Safety
//! Handles are never dereferenced (see the registry). Dereferenced are only out-parameters and
//! buffers of the caller, which are valid or null by the contract of libethercat.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::slice;

use ecrt_sys::{
    Errno, ec_domain_t, ec_master_t, ec_reg_request_t, ec_sdo_request_t, ec_slave_config_t,
};
use libc::{c_int, size_t};

use crate::ecrt::calls::{Call, CallResult, Target};
use crate::ecrt::pdo::SyncConfig;
use crate::ecrt::sdo_transfer::RequestId;
use crate::ecrt::slave_config::{RegRequest, SdoRequest, SlaveConfig};

pub(super) fn pointer<T>(address: usize) -> *mut T {
    std::ptr::without_provenance_mut(address)
}

pub(super) fn null_with<T>(errno: c_int) -> *mut T {
    Errno::new(errno).set_last();
    std::ptr::null_mut()
}

/// Runs a call. A panic becomes EIO, because it must not reach C.
pub(super) fn guarded<T>(call: impl FnOnce() -> CallResult<T>) -> CallResult<T> {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or(Err(libc::EIO))
}

/// Return value of a call that returns a status.
pub(super) fn status(call: impl FnOnce() -> CallResult) -> c_int {
    guarded(call).map_or_else(|errno| -errno, |()| 0)
}

pub(super) fn handle_or_null<T>(call: impl FnOnce() -> CallResult<usize>) -> *mut T {
    guarded(call).map_or_else(null_with, pointer)
}

pub(super) fn data_or_null(call: impl FnOnce() -> CallResult<*mut u8>) -> *mut u8 {
    guarded(call).unwrap_or_else(null_with)
}

/// Stores a result in an out-parameter.
///
/// # Safety
/// `target` is null or valid for writing.
pub(super) unsafe fn store<T>(target: *mut T, value: T) -> CallResult {
    if target.is_null() {
        return Err(libc::EFAULT);
    }
    // SAFETY: not null, so valid for writing by the caller's promise.
    unsafe { target.write(value) };
    Ok(())
}

/// Copies the caller's data.
///
/// # Safety
/// `data` is null or valid for reading `size` bytes.
pub(super) unsafe fn bytes(data: *const u8, size: size_t) -> CallResult<Vec<u8>> {
    if data.is_null() || size == 0 || size > isize::MAX as usize {
        return Err(libc::EINVAL);
    }
    // SAFETY: not null, so valid for reading by the caller's promise.
    Ok(unsafe { slice::from_raw_parts(data, size) }.to_vec())
}

pub(super) fn on_master(master: *const ec_master_t) -> CallResult<Call<()>> {
    Call::find(master.addr(), |target| (target == Target::Master).then_some(()))
}

macro_rules! calls {
    ($($name:ident($handle:ty) -> $target:ident($object:ty);)*) => { $(
        pub(super) fn $name(handle: *const $handle) -> CallResult<Call<$object>> {
            Call::find(handle.addr(), |target| match target {
                Target::$target(object) => Some(object),
                _ => None,
            })
        }
    )* };
}

calls! {
    on_config(ec_slave_config_t) -> Config(usize);
    on_domain(ec_domain_t) -> Domain(usize);
    on_request(ec_sdo_request_t) -> Request(RequestId);
    on_reg_request(ec_reg_request_t) -> RegRequest(RequestId);
}

/// Changes a configuration, before activation.
pub(super) fn change_config<R>(
    config: *const ec_slave_config_t,
    action: impl FnOnce(&mut SlaveConfig) -> CallResult<R>,
) -> CallResult<R> {
    let call = on_config(config)?;
    call.configuring(|state| action(state.master.config(call.object)?))
}

pub(super) fn change_sync(
    config: *const ec_slave_config_t,
    sync: u8,
    action: impl FnOnce(&mut SyncConfig),
) -> CallResult {
    change_config(config, |config| {
        config.syncs.get_mut(usize::from(sync)).map(action).ok_or(libc::ENOENT)
    })
}

pub(super) fn with_request<R>(
    request: *const ec_sdo_request_t,
    action: impl FnOnce(&mut SdoRequest) -> R,
) -> CallResult<R> {
    let call = on_request(request)?;
    call.with(|state| Ok(action(state.master.configs.request(call.object).ok_or(libc::ENOENT)?)))
}

pub(super) fn with_reg_request<R>(
    request: *const ec_reg_request_t,
    action: impl FnOnce(&mut RegRequest) -> R,
) -> CallResult<R> {
    let call = on_reg_request(request)?;
    call.with(|state| {
        Ok(action(state.master.configs.reg_request(call.object).ok_or(libc::ENOENT)?))
    })
}

/// Functions that return a status. One of two forms also has the form of 1.5, in a module of its
/// name, which returns nothing and leaves an error in `errno`, as `ioctl` does; a form without error
/// leaves none, since the module of 1.5 reports none.
macro_rules! functions {
    (@one_form $($signature:tt)*) => {};
    (@two_forms $name:ident($($argument:ident: $type:ty),*)) => {
        pub(in crate::ecrt) mod $name {
            #[allow(clippy::wildcard_imports)]
            use super::*;

            pub(in crate::ecrt) unsafe extern "C" fn silent($($argument: $type),*) {
                let before = ::ecrt_sys::Errno::last();
                // SAFETY: the same arguments under the same promises.
                let status = unsafe { super::$name($($argument),*) };
                ::ecrt_sys::Errno::check(status).err().unwrap_or(before).set_last();
            }
        }
    };
    (@without_error $name:ident($($argument:ident: $type:ty),*)) => {
        pub(in crate::ecrt) mod $name {
            #[allow(clippy::wildcard_imports)]
            use super::*;

            pub(in crate::ecrt) unsafe extern "C" fn silent($($argument: $type),*) {
                let before = ::ecrt_sys::Errno::last();
                // SAFETY: the same arguments under the same promises.
                let _ = unsafe { super::$name($($argument),*) };
                before.set_last();
            }
        }
    };
    ($(
        $(#[$doc:meta])*
        $forms:ident $name:ident($($argument:ident: $type:ty),*) $body:block
    )*) => { $(
        $(#[$doc])*
        pub unsafe extern "C" fn $name($($argument: $type),*) -> ::libc::c_int {
            $crate::ecrt::functions::boundary::status(|| -> $crate::ecrt::calls::CallResult { $body })
        }
        functions!(@$forms $name($($argument: $type),*));
    )* };
}
