//! Library calls by checked handles.

use std::sync::Arc;

use libc::c_int;

use crate::ecrt::registry::{self, Handle, Target};
use crate::ecrt::shared::{Shared, State};

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
        let Handle { shared, client, target } = registry::find(address).ok_or(libc::EINVAL)?;
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
            state.master.may_exchange(self.client)?;
            action(state)
        })
    }

    /// For the handle that has reserved the master, before activation.
    pub(super) fn configuring<R>(
        &self,
        action: impl FnOnce(&mut State) -> CallResult<R>,
    ) -> CallResult<R> {
        self.with(|state| {
            state.master.may_configure(self.client)?;
            action(state)
        })
    }

    /// The address of an object of the same master handle, if it has one.
    pub(super) fn address_of(&self, target: Target) -> Option<usize> {
        registry::address_of(&self.shared, self.client, target)
    }

    pub(super) fn insert(&self, target: Target) -> usize {
        let (shared, client) = (self.shared.clone(), self.client);
        registry::insert(Handle { shared, client, target })
    }
}
