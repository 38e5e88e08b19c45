//! Configuration of one slave by the application.

use super::domain::ProcessMemory;
use super::sdo_transfer::SdoObject;
use crate::ecrt::pdo::{Pdo, direction_of, pdo_bytes};
use crate::sii::SlaveDescription;
use crate::world::ProcessDirection;

pub(super) const MAX_SYNC_MANAGERS: usize = 16;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum SyncWatchdog {
    #[default]
    Default,
    Enable,
    Disable,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct SyncConfig {
    pub(crate) direction: Option<ProcessDirection>,
    pub(crate) watchdog: SyncWatchdog,
    pub(crate) pdos: Vec<Pdo>,
}

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
pub(crate) struct RequestId {
    pub(crate) config: usize,
    pub(crate) request: usize,
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
