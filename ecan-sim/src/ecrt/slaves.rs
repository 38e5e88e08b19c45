//! Slaves: as the master knows them since the last scan, and as the application configures them, with their requests
//! and domains.

use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::mapping::{Direction, UNITS_PER_CHUNK, assignment_index, sync_manager};

use super::domain::{
    AssignmentWrite, Domain, Pdo, PdoEntry, ProcessMemory, SYNC_MANAGERS, SyncConfig, direction_of,
    pdo_bytes,
};
use super::sdo_transfer::{MailboxTransfer, RequestId, SdoObject, Transfer};
use crate::scenario::IoSpec;
use crate::sii::SlaveDescription;
use crate::world::{ProcessDirection, Slot, World};

/// PDOs by sync manager.
type Assignment = [Vec<Pdo>; SYNC_MANAGERS as usize];

/// Steps of the state machine that brings a slave to its requested state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Startup {
    Request(AlState),
    Wait { to: AlState, from: u8, since: u64 },
    ClearRegisters,
    Mailboxes,
    Sdo { at: usize, mailbox: MailboxTransfer },
    Assignment { list: Vec<AssignmentWrite>, at: usize, mailbox: MailboxTransfer },
    Watchdog,
    SyncManagers,
    Fmmus,
    ClockCycle,
    ClockSettle { since: u64 },
    ClockStart,
}

impl Startup {
    pub(crate) const BEGIN: Self = Self::Request(AlState::Init);
}

#[derive(Debug)]
pub(crate) struct SlaveView {
    pub(crate) slot: Slot,
    /// Losses of supply of the slave when it was scanned.
    pub(crate) generation: u32,
    pub(crate) description: SlaveDescription,
    /// AL status as last read.
    pub(crate) current: u8,
    pub(crate) requested: AlState,
    pub(crate) error_flag: bool,
    pub(crate) force_config: bool,
    /// When the master brought the slave to PREOP; `None` if the slave was there or above at the scan.
    pub(crate) preop_at: Option<u64>,
    /// The master has fetched this slave's object dictionary since the last scan, or is fetching it.
    pub(crate) has_dictionary: bool,
    pub(crate) config: Option<usize>,
    /// Assigned PDOs as the scan found them, by sync manager.
    pub(crate) assigned: Assignment,
    pub(crate) startup: Option<Startup>,
    pub(crate) transfer: Option<Transfer>,
    /// When the startup or the transfer continues.
    pub(crate) due: u64,
}

impl SlaveView {
    pub(crate) fn scanned(world: &mut World, slot: Slot) -> Option<Self> {
        let description = world.line().describe(slot)?;
        let assigned = match world.line().io_in(slot) {
            Some(io) => fixed_assignment(io.spec()),
            None => uploaded_assignment(world, slot),
        };
        Some(Self {
            slot,
            generation: world.line().generation(slot),
            description,
            current: al_status(world, slot),
            requested: AlState::PreOp,
            error_flag: false,
            force_config: false,
            preop_at: None,
            has_dictionary: false,
            config: None,
            assigned,
            startup: None,
            transfer: None,
            due: world.now_ns(),
        })
    }

    /// Returns whether the scanned slave is still present.
    pub(crate) fn is_present(&self, world: &World) -> bool {
        world.reaches(self.slot) && world.line().generation(self.slot) == self.generation
    }

    /// Returns whether the last AL status permits mailbox traffic.
    pub(crate) fn has_mailbox(&self) -> bool {
        self.description.has_coe
            && self.current & AL_ERROR == 0
            && self.current & 0x0F != AlState::Init.raw()
    }

    pub(crate) fn is_idle(&self) -> bool {
        self.startup.is_none() && self.transfer.is_none()
    }
}

/// Returns whether a slave is being configured. The master polls no other slave until that has ended.
pub(super) fn is_any_configured(slaves: &[SlaveView]) -> bool {
    slaves.iter().any(|slave| slave.startup.is_some())
}

/// Position of a slave by alias and distance; alias 0 counts from the master.
pub(super) fn find_slave(slaves: &[SlaveView], alias: u16, distance: u16) -> Option<usize> {
    let from = if alias == 0 {
        0
    } else {
        slaves.iter().position(|slave| slave.description.alias == alias)?
    };
    let position = from + usize::from(distance);
    (position < slaves.len()).then_some(position)
}

/// PDOs of an I/O: its SII lists them.
fn fixed_assignment(io: &IoSpec) -> Assignment {
    let pdo = |index, object, bytes| Pdo {
        index,
        entries: (1..=bytes)
            .map(|subindex| PdoEntry { index: object, subindex, bits: 8 })
            .collect(),
    };
    let list = |pdo: Pdo| if pdo.entries.is_empty() { Vec::new() } else { vec![pdo] };
    let outputs = list(pdo(0x1600, 0x7000, io.outputs));
    let inputs = list(pdo(0x1A00, 0x6000, io.inputs));
    [outputs, inputs, Vec::new(), Vec::new()]
}

/// PDOs of a gateway: the master reads them by SDO.
fn uploaded_assignment(world: &mut World, slot: Slot) -> Assignment {
    let mut assigned = Assignment::default();
    for direction in [Direction::RxPdo, Direction::TxPdo] {
        let pdos = read_assignment(world, slot, direction);
        if let Some(list) = assigned.get_mut(usize::from(sync_manager(direction))) {
            *list = pdos;
        }
    }
    assigned
}

/// Number of assigned PDOs; 0 if it cannot be read.
pub(crate) fn assigned_count(world: &mut World, slot: Slot, direction: Direction) -> u8 {
    read(world, slot, assignment_index(direction), 0).unwrap_or(0).min(0xFE) as u8
}

/// Reads the assigned PDOs and their mapping, up to the first failure.
fn read_assignment(world: &mut World, slot: Slot, direction: Direction) -> Vec<Pdo> {
    let mut pdos = Vec::new();
    let assignment = assignment_index(direction);
    for position in 1..=assigned_count(world, slot, direction) {
        let Some(index) = read(world, slot, assignment, position) else { break };
        let index = index as u16;
        let mut pdo = Pdo { index, entries: Vec::with_capacity(UNITS_PER_CHUNK) };
        let entries = read(world, slot, index, 0).unwrap_or(0);
        for entry in 1..=entries.min(0xFE) as u8 {
            let Some(word) = read(world, slot, index, entry) else { break };
            pdo.entries.push(PdoEntry {
                index: (word >> 16) as u16,
                subindex: (word >> 8) as u8,
                bits: word as u8,
            });
        }
        pdos.push(pdo);
    }
    pdos
}

fn read(world: &mut World, slot: Slot, index: u16, subindex: u8) -> Option<u32> {
    let mut data = Vec::new();
    let result = world
        .with_gateway_in(slot, |gateway, now| gateway.sdo_upload(now, index, subindex, &mut data));
    result?.ok()?;
    let mut word = [0; 4];
    for (to, from) in word.iter_mut().zip(&data) {
        *to = *from;
    }
    Some(u32::from_le_bytes(word))
}

pub(super) const AL_ERROR: u8 = 0x10;

/// AL status of a slave: its state, and the error bit.
pub(crate) fn al_status(world: &World, slot: Slot) -> u8 {
    let (state, has_error) = match slot {
        Slot::Gateway(index) => {
            let Some(gateway) = world.gateway(index) else { return 0 };
            (gateway.al_state(), gateway.al_error())
        }
        Slot::Io(index) => {
            let Some(io) = world.io(index) else { return 0 };
            (io.al_state(), io.al_status_code() != AlStatusCode::OK.0)
        }
    };
    state.raw() | if has_error { AL_ERROR } else { 0 }
}

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
