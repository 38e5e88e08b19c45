//! Calls for SDO and register requests.

use crate::ecrt::calls::CallResult;
use crate::ecrt::registry::{self, Handle, Target};
use crate::ecrt::slave_config::{RegRequest, RequestProgress, SdoRequest};

/// A handle, used as an SDO request.
pub(super) struct RequestCall {
    handle: Handle,
    config: usize,
    request: usize,
}

impl RequestCall {
    pub(super) fn find(address: usize) -> CallResult<Self> {
        let handle = registry::find(address).ok_or(libc::EINVAL)?;
        match handle.target {
            Target::Request { config, request } => Ok(Self { handle, config, request }),
            _ => Err(libc::EINVAL),
        }
    }

    pub(super) fn change<R>(&self, action: impl FnOnce(&mut SdoRequest) -> R) -> CallResult<R> {
        self.handle.shared.with(|state| {
            state.master.request(self.config, self.request).map(action).ok_or(libc::ENOENT)
        })
    }

    pub(super) fn start(&self, writes: bool) -> CallResult {
        self.handle.shared.with(|state| {
            state.master.may_exchange(self.handle.client)?;
            let now = state.world.now_ns();
            if state.master.start_request(self.config, self.request, writes, now) {
                Ok(())
            } else {
                Err(libc::EINVAL)
            }
        })
    }

    pub(super) fn progress(&self) -> CallResult<RequestProgress> {
        self.handle.shared.with(|state| {
            state.master.request_progress(self.config, self.request).ok_or(libc::ENOENT)
        })
    }
}

/// A handle, used as a register request.
pub(super) struct RegRequestCall {
    handle: Handle,
    config: usize,
    request: usize,
}

impl RegRequestCall {
    pub(super) fn find(address: usize) -> CallResult<Self> {
        let handle = registry::find(address).ok_or(libc::EINVAL)?;
        match handle.target {
            Target::RegRequest { config, request } => Ok(Self { handle, config, request }),
            _ => Err(libc::EINVAL),
        }
    }

    pub(super) fn change<R>(&self, action: impl FnOnce(&mut RegRequest) -> R) -> CallResult<R> {
        self.handle.shared.with(|state| {
            state.master.reg_request(self.config, self.request).map(action).ok_or(libc::ENOENT)
        })
    }

    pub(super) fn start(&self, writes: bool, address: u16, size: usize) -> CallResult {
        self.handle.shared.with(|state| {
            state.master.may_exchange(self.handle.client)?;
            let now = state.world.now_ns();
            state.master.start_reg_request(self.config, self.request, writes, address, size, now)
        })
    }
}
