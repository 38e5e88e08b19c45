//! Configurations of slaves by the application, with their requests and domains.

use super::domain::{Domain, ProcessMemory};
use super::pdo::{Pdo, SyncConfig, direction_of, pdo_bytes};
use super::sdo_transfer::{RequestId, SdoObject};
use crate::sii::SlaveDescription;
use crate::world::ProcessDirection;

const MAX_SYNC_MANAGERS: usize = 16;

#[derive(Clone, Debug)]
pub(crate) struct StartupSdo {
    pub(crate) object: SdoObject,
    pub(crate) data: Vec<u8>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct DcConfig {
    pub(crate) assign_activate: u16,
    pub(crate) sync0_cycle: u32,
    pub(crate) sync0_shift: i32,
    pub(crate) sync1_cycle: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RequestProgress {
    Unused,
    Queued,
    Busy,
    Success,
    Failure,
}

#[derive(Debug)]
pub(crate) struct SdoRequest {
    pub(crate) index: u16,
    pub(crate) subindex: u8,
    pub(crate) writes: bool,
    pub(crate) progress: RequestProgress,
    pub(crate) timeout_ns: u64,
    pub(crate) queued_at: u64,
    /// The master's copy of the data.
    pub(crate) data: Vec<u8>,
    /// The caller's memory, and the length of the data in it.
    pub(crate) memory: ProcessMemory,
    pub(crate) data_size: usize,
    /// A finished read that the caller has not fetched.
    pub(crate) unfetched: bool,
}

impl SdoRequest {
    pub(crate) fn new(index: u16, subindex: u8, size: usize) -> Self {
        Self {
            index,
            subindex,
            writes: false,
            progress: RequestProgress::Unused,
            timeout_ns: 0,
            queued_at: 0,
            data: Vec::with_capacity(size.max(64)),
            memory: ProcessMemory::new(size),
            data_size: size,
            unfetched: false,
        }
    }

    /// Queues a transfer. A write copies the caller's data.
    pub(crate) fn start(&mut self, writes: bool, now: u64) {
        self.writes = writes;
        self.progress = RequestProgress::Queued;
        self.queued_at = now;
        self.unfetched = false;
        if writes {
            self.data.resize(self.data_size, 0);
            self.memory.read(0, &mut self.data);
        }
    }

    /// Progress; copies the data of a finished read to the caller. The timeout is checked when it
    /// is the request's turn; until then it stays busy.
    pub(crate) fn fetch(&mut self) -> RequestProgress {
        if self.unfetched {
            if self.data.len() > self.memory.len() {
                return RequestProgress::Failure;
            }
            self.memory.write(0, &self.data);
            self.data_size = self.data.len();
            self.unfetched = false;
        }
        self.progress
    }

    pub(crate) fn is_overdue(&self, now: u64) -> bool {
        self.timeout_ns > 0 && now.saturating_sub(self.queued_at) >= self.timeout_ns
    }
}

#[derive(Debug, Default)]
pub(crate) struct SlaveConfig {
    pub(crate) alias: u16,
    pub(crate) position: u16,
    pub(crate) vendor_id: u32,
    pub(crate) product_code: u32,
    pub(crate) slave: Option<usize>,
    pub(crate) syncs: [SyncConfig; MAX_SYNC_MANAGERS],
    pub(crate) sdos: Vec<StartupSdo>,
    /// Divider and intervals; 0 leaves the slave's default.
    pub(crate) watchdog: (u16, u16),
    pub(crate) dc: Option<DcConfig>,
    pub(crate) requests: Vec<SdoRequest>,
    pub(crate) reg_requests: Vec<RegRequest>,
    /// Longest time for a state change, by the states' bits.
    pub(crate) state_timeouts: Vec<(u8, u8, u64)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum EntrySelector {
    Object {
        index: u16,
        subindex: u8,
    },
    /// By position: sync manager, PDO in it, entry in that, each from 0.
    Position {
        sync: u8,
        pdo: usize,
        entry: usize,
    },
}

impl SlaveConfig {
    pub(crate) fn fits(&self, slave: &SlaveDescription) -> bool {
        slave.vendor_id == self.vendor_id && slave.product_code == self.product_code
    }

    /// Sets the slave's default assignment, given by sync manager.
    pub(crate) fn load_defaults(&mut self, assigned: &[Vec<Pdo>]) {
        for (number, pdos) in (0u8..).zip(assigned) {
            if let Some(sync) = self.syncs.get_mut(usize::from(number)) {
                sync.direction = direction_of(number);
                sync.pdos.clone_from(pdos);
            }
        }
    }

    pub(crate) fn find_pdo(&mut self, index: u16) -> Option<&mut Pdo> {
        self.syncs.iter_mut().flat_map(|sync| &mut sync.pdos).find(|pdo| pdo.index == index)
    }

    /// Location of an entry: sync manager, its direction, its size, bit offset.
    pub(crate) fn locate(
        &self,
        selector: EntrySelector,
    ) -> Option<(u8, Option<ProcessDirection>, usize, usize)> {
        for (number, sync) in (0u8..).zip(&self.syncs) {
            let mut bit = 0;
            for (pdo_position, pdo) in sync.pdos.iter().enumerate() {
                for (position, entry) in pdo.entries.iter().enumerate() {
                    let found = match selector {
                        EntrySelector::Object { index, subindex } => {
                            (entry.index, entry.subindex) == (index, subindex)
                        }
                        EntrySelector::Position { sync, pdo, entry } => {
                            (number, pdo_position, position) == (sync, pdo, entry)
                        }
                    };
                    if found {
                        return Some((number, sync.direction, pdo_bytes(&sync.pdos), bit));
                    }
                    bit += usize::from(entry.bits);
                }
            }
        }
        None
    }
}

#[derive(Debug)]
pub(crate) struct RegRequest {
    pub(crate) writes: bool,
    pub(crate) address: u16,
    pub(crate) size: usize,
    pub(crate) progress: RequestProgress,
    pub(crate) data: Vec<u8>,
    pub(crate) memory: ProcessMemory,
}

impl RegRequest {
    pub(crate) fn new(size: usize) -> Self {
        Self {
            writes: false,
            address: 0,
            size,
            progress: RequestProgress::Unused,
            data: Vec::with_capacity(size),
            memory: ProcessMemory::new(size),
        }
    }

    /// Progress; copies the data of a finished read to the caller.
    pub(crate) fn fetch(&mut self) -> RequestProgress {
        if self.progress == RequestProgress::Success && !self.writes {
            self.memory.write(0, &self.data);
        }
        self.progress
    }
}

/// The configurations of the application: slaves and domains.
#[derive(Debug, Default)]
pub(crate) struct Configs {
    slaves: Vec<SlaveConfig>,
    domains: Vec<Domain>,
}

impl Configs {
    pub(crate) fn clear(&mut self) {
        self.slaves.clear();
        self.domains.clear();
    }

    /// Index of the configuration with this address, if there is one.
    pub(crate) fn find(&self, alias: u16, position: u16) -> Option<usize> {
        self.slaves.iter().position(|config| config.alias == alias && config.position == position)
    }

    /// Adds a configuration and returns its index.
    pub(crate) fn add(&mut self, config: SlaveConfig) -> usize {
        self.slaves.push(config);
        self.slaves.len() - 1
    }

    pub(crate) fn get(&self, index: usize) -> Option<&SlaveConfig> {
        self.slaves.get(index)
    }

    pub(crate) fn get_mut(&mut self, index: usize) -> Option<&mut SlaveConfig> {
        self.slaves.get_mut(index)
    }

    pub(crate) fn len(&self) -> usize {
        self.slaves.len()
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &SlaveConfig> {
        self.slaves.iter()
    }

    pub(crate) fn iter_mut(&mut self) -> impl Iterator<Item = &mut SlaveConfig> {
        self.slaves.iter_mut()
    }

    pub(crate) fn request(&mut self, id: RequestId) -> Option<&mut SdoRequest> {
        self.slaves.get_mut(id.config)?.requests.get_mut(id.request)
    }

    pub(crate) fn reg_request(&mut self, id: RequestId) -> Option<&mut RegRequest> {
        self.slaves.get_mut(id.config)?.reg_requests.get_mut(id.request)
    }

    /// Adds a domain and returns its index.
    pub(crate) fn add_domain(&mut self) -> usize {
        self.domains.push(Domain::default());
        self.domains.len() - 1
    }

    pub(crate) fn domain(&mut self, index: usize) -> Result<&mut Domain, i32> {
        self.domains.get_mut(index).ok_or(libc::ENOENT)
    }

    pub(crate) fn domains(&self) -> &[Domain] {
        &self.domains
    }

    pub(crate) fn domains_mut(&mut self) -> &mut [Domain] {
        &mut self.domains
    }
}
