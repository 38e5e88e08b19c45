//! Boundary of the C functions: pointers outside, handles, and checked calls inside.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::slice;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, PoisonError, RwLock};

use ecrt_sys::{
    Errno, ec_domain_t, ec_master_t, ec_reg_request_t, ec_sdo_request_t, ec_slave_config_t,
};
use libc::{c_int, size_t};

use crate::ecrt::domain::SyncConfig;
use crate::ecrt::sdo_transfer::RequestId;
use crate::ecrt::shared::{Shared, State};
use crate::ecrt::slaves::{RegRequest, SdoRequest, SlaveConfig};

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
            $crate::ecrt::functions::boundary::status(|| -> $crate::ecrt::functions::boundary::CallResult { $body })
        }
        functions!(@$forms $name($($argument: $type),*));
    )* };
}

/// Result of a call; the error is a positive error number.
pub(in crate::ecrt) type CallResult<T = ()> = Result<T, c_int>;

pub(in crate::ecrt) struct Call<T> {
    pub(in crate::ecrt) shared: Arc<Shared>,
    /// The master handle that the handle was made from.
    pub(in crate::ecrt) client: u64,
    pub(in crate::ecrt) object: T,
}

impl<T> Call<T> {
    pub(in crate::ecrt) fn find(
        address: usize,
        object: impl FnOnce(Target) -> Option<T>,
    ) -> CallResult<Self> {
        let Handle { shared, client, target } = find(address).ok_or(libc::EINVAL)?;
        Ok(Self { shared, client, object: object(target).ok_or(libc::EINVAL)? })
    }

    pub(in crate::ecrt) fn with<R>(
        &self,
        action: impl FnOnce(&mut State) -> CallResult<R>,
    ) -> CallResult<R> {
        self.shared.with(action)
    }

    /// For the handle that has reserved the master.
    pub(in crate::ecrt) fn driving<R>(
        &self,
        action: impl FnOnce(&mut State) -> CallResult<R>,
    ) -> CallResult<R> {
        self.with(|state| {
            state.master.reservation.may_exchange(self.client)?;
            action(state)
        })
    }

    /// For the handle that has reserved the master, before activation.
    pub(in crate::ecrt) fn configuring<R>(
        &self,
        action: impl FnOnce(&mut State) -> CallResult<R>,
    ) -> CallResult<R> {
        self.with(|state| {
            state.master.reservation.may_configure(self.client)?;
            action(state)
        })
    }

    /// The address of an object of the same master handle, if it has one.
    pub(in crate::ecrt) fn address_of(&self, target: Target) -> Option<usize> {
        address_of(&self.shared, self.client, target)
    }

    pub(in crate::ecrt) fn insert(&self, target: Target) -> usize {
        let (shared, client) = (self.shared.clone(), self.client);
        insert(Handle { shared, client, target })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::ecrt) enum Target {
    Master,
    Domain(usize),
    Config(usize),
    Request(RequestId),
    RegRequest(RequestId),
}

#[derive(Clone)]
pub(in crate::ecrt) struct Handle {
    pub(in crate::ecrt) shared: Arc<Shared>,
    /// The master handle that it was made from.
    pub(in crate::ecrt) client: u64,
    pub(in crate::ecrt) target: Target,
}

/// The first address: far from mapped memory, and aligned like a pointer.
const FIRST: usize = 0x5ECA_0000;
const STRIDE: usize = 16;

static NEXT: AtomicUsize = AtomicUsize::new(FIRST);
// a BTreeMap, because leak checkers report the contents of a static HashMap
static HANDLES: LazyLock<RwLock<BTreeMap<usize, Handle>>> = LazyLock::new(RwLock::default);

pub(in crate::ecrt) fn insert(handle: Handle) -> usize {
    let address = NEXT.fetch_add(STRIDE, Ordering::Relaxed);
    HANDLES.write().unwrap_or_else(PoisonError::into_inner).insert(address, handle);
    address
}

/// Finds the handle of an address. Takes a shared lock, allocates nothing.
pub(in crate::ecrt) fn find(address: usize) -> Option<Handle> {
    HANDLES.read().unwrap_or_else(PoisonError::into_inner).get(&address).cloned()
}

pub(in crate::ecrt) fn address_of(
    shared: &Arc<Shared>,
    client: u64,
    target: Target,
) -> Option<usize> {
    let handles = HANDLES.read().unwrap_or_else(PoisonError::into_inner);
    handles
        .iter()
        .find(|(_, handle)| {
            Arc::ptr_eq(&handle.shared, shared)
                && handle.client == client
                && handle.target == target
        })
        .map(|(address, _)| *address)
}

/// Removes the handles made from a master handle, and optionally the master handle.
pub(in crate::ecrt) fn forget(shared: &Arc<Shared>, client: u64, with_master: bool) {
    let mut handles = HANDLES.write().unwrap_or_else(PoisonError::into_inner);
    handles.retain(|_, handle| {
        let own = Arc::ptr_eq(&handle.shared, shared) && handle.client == client;
        !own || (handle.target == Target::Master && !with_master)
    });
}
