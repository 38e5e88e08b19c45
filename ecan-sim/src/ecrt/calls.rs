//! Library calls by checked handles.
//!
//! A handle looks like a pointer of the real library, but is a number that is never dereferenced
//! and never reused. A stale or unknown pointer is recognised instead of followed.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, PoisonError, RwLock};

use libc::c_int;

use super::sdo_transfer::RequestId;
use super::shared::{Shared, State};

/// Result of a call; the error is a positive error number.
pub(super) type CallResult<T = ()> = Result<T, c_int>;

pub(super) struct Call<T> {
    pub(super) shared: Arc<Shared>,
    /// The master handle that the handle was made from.
    pub(super) client: u64,
    pub(super) object: T,
}

impl<T> Call<T> {
    pub(super) fn find(
        address: usize,
        object: impl FnOnce(Target) -> Option<T>,
    ) -> CallResult<Self> {
        let Handle { shared, client, target } = find(address).ok_or(libc::EINVAL)?;
        Ok(Self { shared, client, object: object(target).ok_or(libc::EINVAL)? })
    }

    pub(super) fn with<R>(
        &self,
        action: impl FnOnce(&mut State) -> CallResult<R>,
    ) -> CallResult<R> {
        self.shared.with(action)
    }

    /// For the handle that has reserved the master.
    pub(super) fn driving<R>(
        &self,
        action: impl FnOnce(&mut State) -> CallResult<R>,
    ) -> CallResult<R> {
        self.with(|state| {
            state.master.reservation.may_exchange(self.client)?;
            action(state)
        })
    }

    /// For the handle that has reserved the master, before activation.
    pub(super) fn configuring<R>(
        &self,
        action: impl FnOnce(&mut State) -> CallResult<R>,
    ) -> CallResult<R> {
        self.with(|state| {
            state.master.reservation.may_configure(self.client)?;
            action(state)
        })
    }

    /// The address of an object of the same master handle, if it has one.
    pub(super) fn address_of(&self, target: Target) -> Option<usize> {
        address_of(&self.shared, self.client, target)
    }

    pub(super) fn insert(&self, target: Target) -> usize {
        let (shared, client) = (self.shared.clone(), self.client);
        insert(Handle { shared, client, target })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Target {
    Master,
    Domain(usize),
    Config(usize),
    Request(RequestId),
    RegRequest(RequestId),
}

#[derive(Clone)]
pub(super) struct Handle {
    pub(super) shared: Arc<Shared>,
    /// The master handle that it was made from.
    pub(super) client: u64,
    pub(super) target: Target,
}

/// The first address: far from mapped memory, and aligned like a pointer.
const FIRST: usize = 0x5ECA_0000;
const STRIDE: usize = 16;

static NEXT: AtomicUsize = AtomicUsize::new(FIRST);
// a BTreeMap, because leak checkers report the contents of a static HashMap
static HANDLES: LazyLock<RwLock<BTreeMap<usize, Handle>>> = LazyLock::new(RwLock::default);

pub(super) fn insert(handle: Handle) -> usize {
    let address = NEXT.fetch_add(STRIDE, Ordering::Relaxed);
    HANDLES.write().unwrap_or_else(PoisonError::into_inner).insert(address, handle);
    address
}

/// Finds the handle of an address. Takes a shared lock, allocates nothing.
pub(super) fn find(address: usize) -> Option<Handle> {
    HANDLES.read().unwrap_or_else(PoisonError::into_inner).get(&address).cloned()
}

pub(super) fn address_of(shared: &Arc<Shared>, client: u64, target: Target) -> Option<usize> {
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
pub(super) fn forget(shared: &Arc<Shared>, client: u64, with_master: bool) {
    let mut handles = HANDLES.write().unwrap_or_else(PoisonError::into_inner);
    handles.retain(|_, handle| {
        let own = Arc::ptr_eq(&handle.shared, shared) && handle.client == client;
        !own || (handle.target == Target::Master && !with_master)
    });
}
