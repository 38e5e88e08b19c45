//! Library calls, with checked handles and without pointers.

use std::sync::Arc;

use libc::c_int;

use crate::ecrt::datagram::{ClockDatagram, Queued};
use crate::ecrt::master::Phase;
use crate::ecrt::pdo::{Pdo, SYNC_MANAGERS};
use crate::ecrt::process_memory::ProcessMemory;
use crate::ecrt::registry::{self, Handle, Target};
use crate::ecrt::sdo_transfer::SdoObject;
use crate::ecrt::shared::{Shared, State};
use crate::ecrt::slave_config::{EntrySelector, RegRequest, SdoRequest, SlaveConfig, SyncConfig};
use crate::ecrt::slave_view::SlaveView;
use crate::ecrt::timing::ACTIVATE_NS;
use crate::fault::LibraryCall;

/// Result of a call; the error is a positive error number.
pub(super) type CallResult<T = ()> = Result<T, c_int>;

/// A handle, used as a master.
pub(super) struct MasterCall(Handle);

impl MasterCall {
    pub(super) fn find(address: usize) -> CallResult<Self> {
        match registry::find(address) {
            Some(handle) if handle.target == Target::Master => Ok(Self(handle)),
            _ => Err(libc::EINVAL),
        }
    }

    fn shared(&self) -> &Arc<Shared> {
        &self.0.shared
    }

    pub(super) fn with<R>(&self, action: impl FnOnce(&mut State) -> R) -> R {
        self.shared().with(action)
    }

    /// For the handle that has reserved the master.
    pub(super) fn driving<R>(&self, action: impl FnOnce(&mut State) -> R) -> CallResult<R> {
        self.with(|state| {
            state.master.may_exchange(self.0.client)?;
            Ok(action(state))
        })
    }

    fn configuring<R>(&self, action: impl FnOnce(&mut State) -> CallResult<R>) -> CallResult<R> {
        self.with(|state| {
            state.master.may_configure(self.0.client)?;
            action(state)
        })
    }

    fn handle_of(&self, target: Target) -> usize {
        let (shared, client) = (self.shared(), self.0.client);
        registry::address_of(shared, client, target)
            .unwrap_or_else(|| registry::insert(Handle { shared: shared.clone(), client, target }))
    }

    /// Reserves the master for this handle.
    pub(super) fn reserve(&self) -> CallResult {
        self.shared().reserve(self.0.client)
    }

    /// Restarts failed slaves.
    pub(super) fn reset(&self) -> CallResult {
        self.driving(|state| state.master.reset())
    }

    pub(super) fn release(&self) {
        let client = self.0.client;
        self.shared().release_client(client);
        registry::forget(self.shared(), client, true);
    }

    pub(super) fn create_domain(&self) -> CallResult<usize> {
        let index = self.configuring(|state| {
            state.master.domains.push(Default::default());
            Ok(state.master.domains.len() - 1)
        })?;
        Ok(self.handle_of(Target::Domain(index)))
    }

    pub(super) fn slave_config(
        &self,
        alias: u16,
        position: u16,
        vendor_id: u32,
        product_code: u32,
    ) -> CallResult<usize> {
        let index = self.configuring(|state| {
            state.master.slave_config(alias, position, vendor_id, product_code)
        })?;
        Ok(self.handle_of(Target::Config(index)))
    }

    /// Activates; this takes time, because the master's threads are exchanged.
    pub(super) fn activate(&self) -> CallResult {
        let done = self.driving(|state| {
            let now = state.world.now_ns();
            let fresh = state.master.phase != Phase::Active;
            if fresh {
                state.master.activate(now);
            }
            fresh.then_some(now + ACTIVATE_NS)
        })?;
        if let Some(done) = done {
            self.shared().sleep_until(done);
        }
        Ok(())
    }

    pub(super) fn deactivate(&self) -> CallResult {
        self.driving(|state| {
            let now = state.world.now_ns();
            state.master.deactivate(now);
        })?;
        registry::forget(self.shared(), self.0.client, false);
        Ok(())
    }

    pub(super) fn send(&self) -> CallResult {
        self.driving(|State { world, master, .. }| {
            world.library_call(LibraryCall::Send)?;
            master.send(world);
            if master.phase == Phase::Active && !master.blocked {
                master.step(world);
            }
            Ok(())
        })?
    }

    pub(super) fn receive(&self) -> CallResult {
        self.driving(|state| {
            state.world.library_call(LibraryCall::Receive)?;
            let now = state.world.now_ns();
            state.master.receive(now);
            Ok(())
        })?
    }

    /// Queues a datagram of the clocks. Only the monitor's needs no reference clock.
    pub(super) fn queue_clock(&self, item: Queued, target: Option<u64>) -> CallResult {
        self.driving(|state| {
            if item != Queued::ClockMonitor && state.master.reference_clock().is_none() {
                return Err(libc::ENXIO);
            }
            let clocks = &mut state.master.clocks;
            if clocks.are_set {
                if item == Queued::ReferenceClock {
                    clocks.reference_target = target.unwrap_or(clocks.app_time);
                }
                state.master.enqueue(item);
            }
            Ok(())
        })?
    }

    /// Like the real function, it writes each failure to stderr.
    pub(super) fn reference_clock_time(&self) -> CallResult<u32> {
        self.driving(|state| {
            let clocks = &state.master.clocks;
            let time = match (clocks.slaves, clocks.are_set) {
                _ if state.master.reference_clock().is_none() => Err(libc::ENXIO),
                (ClockDatagram::Received, true) => Ok(clocks.reference_value),
                (ClockDatagram::Received, false) => Err(libc::EAGAIN),
                _ => Err(libc::EIO),
            };
            state.master.stderr_lines += u64::from(time.is_err());
            time
        })?
    }

    /// Selects the reference clock; `None` is the first slave.
    pub(super) fn select_reference_clock(&self, config: Option<&ConfigCall>) -> CallResult {
        self.configuring(|state| {
            state.master.clocks.selected = config.map(|config| config.index);
            Ok(())
        })
    }

    /// Upper estimate of the slaves' differences to the reference clock.
    pub(super) fn sync_monitor(&self) -> CallResult<u32> {
        self.driving(|state| match state.master.clocks.monitor {
            ClockDatagram::Received => state.master.clocks.monitor_value,
            _ => {
                state.master.stderr_lines += 1;
                u32::MAX
            }
        })
    }

    pub(super) fn slave<R>(
        &self,
        position: u16,
        action: impl FnOnce(&SlaveView) -> CallResult<R>,
    ) -> CallResult<R> {
        self.with(|state| {
            let slave = state.master.slaves.get(usize::from(position)).ok_or(libc::EINVAL)?;
            action(slave)
        })
    }

    /// The PDOs that a sync manager assigns by default.
    pub(super) fn sync_pdos<R>(
        &self,
        position: u16,
        sync: u8,
        action: impl FnOnce(&[Pdo]) -> CallResult<R>,
    ) -> CallResult<R> {
        self.slave(position, |slave| {
            if sync >= SYNC_MANAGERS {
                return Err(libc::EINVAL);
            }
            action(slave.assigned.get(usize::from(sync)).ok_or(libc::EINVAL)?)
        })
    }

    /// A blocking transfer; the error is error number and abort code.
    pub(super) fn transfer(
        &self,
        position: u16,
        object: SdoObject,
        download: Option<Vec<u8>>,
    ) -> Result<Vec<u8>, (c_int, u32)> {
        self.shared()
            .transfer(position, object, download)
            .map_err(|failure| (failure.errno, failure.abort_code))
    }
}

/// A handle, used as a slave configuration.
pub(super) struct ConfigCall {
    handle: Handle,
    index: usize,
}

impl ConfigCall {
    pub(super) fn find(address: usize) -> CallResult<Self> {
        let handle = registry::find(address).ok_or(libc::EINVAL)?;
        match handle.target {
            Target::Config(index) => Ok(Self { handle, index }),
            _ => Err(libc::EINVAL),
        }
    }

    /// Whether it belongs to the same master handle as a domain.
    fn shares_master_with(&self, domain: &DomainCall) -> bool {
        Arc::ptr_eq(&self.handle.shared, &domain.handle.shared)
            && self.handle.client == domain.handle.client
    }

    /// Changes the configuration, before activation.
    pub(super) fn change<R>(
        &self,
        action: impl FnOnce(&mut SlaveConfig) -> CallResult<R>,
    ) -> CallResult<R> {
        self.handle.shared.with(|state| {
            state.master.may_configure(self.handle.client)?;
            action(state.master.configs.get_mut(self.index).ok_or(libc::ENOENT)?)
        })
    }

    pub(super) fn change_sync<R>(
        &self,
        sync: u8,
        action: impl FnOnce(&mut SyncConfig) -> CallResult<R>,
    ) -> CallResult<R> {
        self.change(|config| action(config.syncs.get_mut(usize::from(sync)).ok_or(libc::ENOENT)?))
    }

    pub(super) fn assign_pdo(&self, sync: u8, index: u16) -> CallResult {
        self.handle.shared.with(|state| {
            state.master.may_configure(self.handle.client)?;
            let config = state.master.configs.get_mut(self.index).ok_or(libc::ENOENT)?;
            let slave = config.slave.and_then(|slave| state.master.slaves.get(slave));
            let known = slave
                .and_then(|slave| slave.assigned.iter().flatten().find(|pdo| pdo.index == index));
            let pdo = known.cloned().unwrap_or(Pdo { index, entries: Vec::new() });
            let sync = config.syncs.get_mut(usize::from(sync)).ok_or(libc::EINVAL)?;
            sync.pdos.push(pdo);
            Ok(())
        })
    }

    /// Registers a mapped entry in a domain of the same master handle; returns byte offset and bit.
    pub(super) fn register_entry(
        &self,
        entry: EntrySelector,
        domain: &DomainCall,
    ) -> CallResult<(usize, u32)> {
        if !self.shares_master_with(domain) {
            return Err(libc::ENOENT);
        }
        self.handle.shared.with(|state| {
            state.master.may_configure(self.handle.client)?;
            let config = state.master.configs.get(self.index).ok_or(libc::ENOENT)?;
            let (sync, direction, size, bit) = config.locate(entry).ok_or(libc::ENOENT)?;
            let direction = direction.ok_or(libc::EINVAL)?;
            let domain = state.master.domains.get_mut(domain.index).ok_or(libc::ENOENT)?;
            let base = domain.add_fmmu(self.index, sync, direction, size);
            Ok((base + bit / 8, (bit % 8) as u32))
        })
    }

    pub(super) fn create_sdo_request(&self, index: u16, sub: u8, size: usize) -> CallResult<usize> {
        let request = self.change(|config| {
            config.requests.push(SdoRequest::new(index, sub, size));
            Ok(config.requests.len() - 1)
        })?;
        Ok(self.insert(|config| Target::Request { config, request }))
    }

    pub(super) fn create_reg_request(&self, size: usize) -> CallResult<usize> {
        let request = self.change(|config| {
            config.reg_requests.push(RegRequest::new(size));
            Ok(config.reg_requests.len() - 1)
        })?;
        Ok(self.insert(|config| Target::RegRequest { config, request }))
    }

    /// Creates a handle of an object that belongs to this configuration.
    pub(super) fn insert(&self, target: impl FnOnce(usize) -> Target) -> usize {
        let (shared, client) = (self.handle.shared.clone(), self.handle.client);
        registry::insert(Handle { shared, client, target: target(self.index) })
    }

    pub(super) fn state(&self) -> CallResult<(SlaveState, bool)> {
        self.handle.shared.with(|state| {
            let config = state.master.configs.get(self.index).ok_or(libc::ENOENT)?;
            let slave = config.slave.and_then(|slave| state.master.slaves.get(slave));
            Ok(match slave {
                Some(slave) => {
                    let operational = slave.current == SlaveState::OPERATIONAL
                        && !slave.force_config
                        && slave.startup.is_none();
                    (SlaveState { online: true, al_state: slave.current & 0x0F }, operational)
                }
                None => (SlaveState { online: false, al_state: 0 }, false),
            })
        })
    }
}

/// A slave as its configuration sees it.
pub(super) struct SlaveState {
    pub(super) online: bool,
    pub(super) al_state: u8,
}

impl SlaveState {
    const OPERATIONAL: u8 = 8;
}

/// A handle, used as a domain.
pub(super) struct DomainCall {
    handle: Handle,
    index: usize,
}

impl DomainCall {
    pub(super) fn find(address: usize) -> CallResult<Self> {
        let handle = registry::find(address).ok_or(libc::EINVAL)?;
        match handle.target {
            Target::Domain(index) => Ok(Self { handle, index }),
            _ => Err(libc::EINVAL),
        }
    }

    /// The master handle that it was made from.
    pub(super) fn master_address(&self) -> CallResult<usize> {
        let Handle { shared, client, .. } = &self.handle;
        registry::address_of(shared, *client, Target::Master).ok_or(libc::EINVAL)
    }

    pub(super) fn size(&self) -> CallResult<usize> {
        self.handle
            .shared
            .with(|state| Ok(state.master.domains.get(self.index).ok_or(libc::ENOENT)?.size))
    }

    pub(super) fn memory(&self) -> CallResult<ProcessMemory> {
        self.handle.shared.with(|state| {
            let domain = state.master.domains.get(self.index).ok_or(libc::ENOENT)?;
            domain.memory.clone().ok_or(libc::EAGAIN)
        })
    }

    pub(super) fn process(&self) -> CallResult {
        self.handle.shared.with(|state| {
            state.master.may_exchange(self.handle.client)?;
            state.world.library_call(LibraryCall::DomainProcess)?;
            state.master.domains.get_mut(self.index).ok_or(libc::ENOENT)?.process();
            Ok(())
        })
    }

    pub(super) fn queue(&self) -> CallResult {
        self.handle.shared.with(|state| {
            state.master.may_exchange(self.handle.client)?;
            state.world.library_call(LibraryCall::DomainQueue)?;
            let domain = state.master.domains.get(self.index).ok_or(libc::ENOENT)?;
            for datagram in 0..domain.datagrams.len() {
                state.master.enqueue(Queued::Domain { domain: self.index, datagram });
            }
            Ok(())
        })
    }

    /// Working counter, and the expected one.
    pub(super) fn counters(&self) -> CallResult<(u32, u32)> {
        self.handle.shared.with(|state| {
            state.world.library_call(LibraryCall::DomainState)?;
            let domain = state.master.domains.get(self.index).ok_or(libc::ENOENT)?;
            Ok((domain.working_counter, domain.expected))
        })
    }
}
