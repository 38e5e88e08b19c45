//! Handles of the simulated library.
//!
//! A handle looks like a pointer of the real library, but is a number that is never dereferenced
//! and never reused. A stale or unknown pointer is recognised instead of followed.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, PoisonError, RwLock};

use crate::ecrt::shared::Shared;
use crate::ecrt::slave_config::RequestId;

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
