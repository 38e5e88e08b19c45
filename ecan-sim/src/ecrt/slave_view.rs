//! Slaves as known to the master since the last scan.

use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::mapping::{Direction, UNITS_PER_CHUNK, assignment_index, sync_manager};

use super::pdo::{AssignmentWrite, Pdo, PdoEntry, SYNC_MANAGERS};
use super::sdo_transfer::{MailboxTransfer, Transfer};
use crate::scenario::IoSpec;
use crate::sii::SlaveDescription;
use crate::world::{Slot, World};

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
