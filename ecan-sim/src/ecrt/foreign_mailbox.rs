//! Mailbox protocols that the gateway does not speak: SoE, VoE and EoE.
//!
//! A master takes what an application wants of them and learns that the slave cannot do it when it
//! turns to the slave: requests and handlers end in an error, an IDN keeps the slave from its next
//! state, IP parameters only leave a line in the kernel log.

use ecan_protocol::device::AlState;

use crate::ecrt::calls::{Answer, ConfigCall};
use crate::ecrt::master::MasterModel;
use crate::ecrt::process_memory::ProcessMemory;
use crate::ecrt::registry::{self, Handle, Target};

/// Highest number of a drive within a slave.
const LAST_DRIVE: u8 = 7;

/// What a configuration holds of these protocols.
#[derive(Debug, Default)]
pub(crate) struct UnsupportedMailbox {
    /// States from which an IDN is to be written (SoE).
    idn_states: Vec<AlState>,
    /// Whether there are IP parameters to be set (EoE).
    has_ip_parameters: bool,
    soe_requests: Vec<ForeignRequest>,
    voe_handlers: Vec<ForeignRequest>,
}

/// A request that the slave cannot serve.
#[derive(Debug)]
pub(crate) struct ForeignRequest {
    /// Whether it was started, and so has failed.
    pub(crate) failed: bool,
    /// The caller's memory.
    pub(crate) memory: ProcessMemory,
}

impl ForeignRequest {
    fn new(size: usize) -> Self {
        Self { failed: false, memory: ProcessMemory::new(size) }
    }

    /// Starts a transfer of so many bytes.
    pub(crate) fn start(&mut self, size: usize) -> Answer {
        if size > self.memory.len() {
            return Err(libc::EOVERFLOW);
        }
        self.failed = true;
        Ok(())
    }
}

impl MasterModel {
    /// Writes what is to be written with these protocols from a state; whether that lets the
    /// slave go on.
    pub(crate) fn foreign_settings(&mut self, slave: usize, from: AlState) -> bool {
        let Some(config) = self.attached(slave) else { return true };
        if config.foreign.idn_states.contains(&from) {
            self.log(slave, "SoE configuration failed: the slave does not support SoE");
            return false;
        }
        if from == AlState::PreOp && config.foreign.has_ip_parameters {
            self.log(slave, "IP parameters not set: the slave does not support EoE");
        }
        true
    }
}

impl ConfigCall {
    pub(super) fn add_idn(&self, drive: u8, state: AlState) -> Answer {
        if drive > LAST_DRIVE || !matches!(state, AlState::PreOp | AlState::SafeOp) {
            return Err(libc::EINVAL);
        }
        self.change(|config| {
            config.foreign.idn_states.push(state);
            Ok(())
        })
    }

    pub(super) fn set_ip_parameter(&self) -> Answer {
        self.change(|config| {
            config.foreign.has_ip_parameters = true;
            Ok(())
        })
    }

    pub(super) fn create_soe_request(&self, size: usize) -> Answer<usize> {
        let request = self.change(|config| {
            config.foreign.soe_requests.push(ForeignRequest::new(size));
            Ok(config.foreign.soe_requests.len() - 1)
        })?;
        Ok(self.insert(|config| Target::SoeRequest { config, request }))
    }

    pub(super) fn create_voe_handler(&self, size: usize) -> Answer<usize> {
        let handler = self.change(|config| {
            config.foreign.voe_handlers.push(ForeignRequest::new(size));
            Ok(config.foreign.voe_handlers.len() - 1)
        })?;
        Ok(self.insert(|config| Target::VoeHandler { config, handler }))
    }
}

/// A handle, used as an SoE request or a VoE handler.
pub(super) struct ForeignCall {
    handle: Handle,
    config: usize,
    place: usize,
    list: fn(&mut UnsupportedMailbox) -> &mut Vec<ForeignRequest>,
}

impl ForeignCall {
    pub(super) fn find_soe_request(address: usize) -> Answer<Self> {
        let handle = registry::find(address).ok_or(libc::EINVAL)?;
        let Target::SoeRequest { config, request } = handle.target else {
            return Err(libc::EINVAL);
        };
        Ok(Self { handle, config, place: request, list: |foreign| &mut foreign.soe_requests })
    }

    pub(super) fn find_voe_handler(address: usize) -> Answer<Self> {
        let handle = registry::find(address).ok_or(libc::EINVAL)?;
        let Target::VoeHandler { config, handler } = handle.target else {
            return Err(libc::EINVAL);
        };
        Ok(Self { handle, config, place: handler, list: |foreign| &mut foreign.voe_handlers })
    }

    pub(super) fn change<R>(&self, action: impl FnOnce(&mut ForeignRequest) -> R) -> Answer<R> {
        self.handle.shared.with(|state| {
            let config = state.master.configs.get_mut(self.config).ok_or(libc::ENOENT)?;
            let request = (self.list)(&mut config.foreign).get_mut(self.place);
            request.map(action).ok_or(libc::ENOENT)
        })
    }

    pub(super) fn data(&self) -> Answer<*mut u8> {
        self.change(|request| request.memory.as_ptr())
    }

    pub(super) fn size(&self) -> Answer<usize> {
        self.change(|request| request.memory.len())
    }

    /// Starts a transfer of so many bytes; of all there are, if none are named.
    pub(super) fn start(&self, size: Option<usize>) -> Answer {
        self.change(|request| request.start(size.unwrap_or(request.memory.len())))?
    }
}
