//! Process data: PDOs with the sync managers that carry them, and domains with FMMU layout, packing into datagrams,
//! expected working counter, and the memory that the simulated library shares with its caller.
//!
//! The caller gets a plain `uint8_t *`, as from the real library, and reads and writes it at any
//! time. The library keeps it in atomic words, so concurrent accesses are not undefined behaviour;
//! they can give mixed contents, as with the mapping of a real master.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::scenario::EcrtVersion;
use crate::sii::SlaveDescription;
use crate::world::{Fmmu, LogicalCommand, ProcessDirection};

/// Largest process data of one datagram, in bytes.
pub(crate) const MAX_DATAGRAM_BYTES: usize = 1486;

/// One FMMU of a domain: the whole of one sync manager of one slave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct DomainFmmu {
    pub(crate) config: usize,
    pub(crate) sync_manager: u8,
    pub(crate) direction: ProcessDirection,
    /// First byte in the domain.
    pub(crate) offset: usize,
    pub(crate) size: usize,
}

#[derive(Clone, Debug)]
pub(crate) struct DomainDatagram {
    pub(crate) command: LogicalCommand,
    pub(crate) offset: usize,
    pub(crate) expected: u32,
    pub(crate) state: DatagramState,
    pub(crate) working_counter: u16,
    pub(crate) wire: Vec<u8>,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Domain {
    pub(crate) fmmus: Vec<DomainFmmu>,
    pub(crate) size: usize,
    pub(crate) logical_base: u32,
    pub(crate) datagrams: Vec<DomainDatagram>,
    pub(crate) expected: u32,
    pub(crate) working_counter: u32,
    pub(crate) memory: Option<ProcessMemory>,
}

impl Domain {
    /// Appends an FMMU, or finds the existing one; returns its first byte.
    pub(crate) fn add_fmmu(
        &mut self,
        config: usize,
        sync_manager: u8,
        direction: ProcessDirection,
        size: usize,
    ) -> usize {
        let known = self
            .fmmus
            .iter()
            .find(|fmmu| fmmu.config == config && fmmu.sync_manager == sync_manager);
        if let Some(fmmu) = known {
            return fmmu.offset;
        }
        let offset = self.size;
        self.fmmus.push(DomainFmmu { config, sync_manager, direction, offset, size });
        self.size += size;
        offset
    }

    /// Fixes addresses, datagrams and memory, as activation does.
    pub(crate) fn finish(&mut self, logical_base: u32, version: EcrtVersion) {
        self.logical_base = logical_base;
        self.datagrams = pack(&self.fmmus, version);
        self.expected = self.datagrams.iter().map(|datagram| datagram.expected).sum();
        self.memory = Some(ProcessMemory::new(self.size));
    }

    pub(crate) fn slave_fmmu(&self, fmmu: &DomainFmmu) -> Fmmu {
        Fmmu {
            logical_start: self.logical_base.wrapping_add(fmmu.offset as u32),
            length: u16::try_from(fmmu.size).unwrap_or(u16::MAX),
            sync_manager: fmmu.sync_manager,
            direction: fmmu.direction,
        }
    }

    pub(crate) fn process(&mut self) {
        self.working_counter = self
            .datagrams
            .iter()
            .filter(|datagram| datagram.state == DatagramState::Received)
            .map(|datagram| u32::from(datagram.working_counter))
            .sum();
    }
}

/// Slave configurations that a datagram serves, per direction.
#[derive(Default)]
struct Used {
    outputs: u32,
    inputs: u32,
}

impl Used {
    /// Counts an FMMU unless its slave was counted in this direction since `first`.
    fn count(&mut self, fmmus: &[DomainFmmu], first: usize, index: usize) {
        let Some(fmmu) = fmmus.get(index) else { return };
        let counted = fmmus
            .iter()
            .take(index)
            .skip(first)
            .any(|other| other.config == fmmu.config && other.direction == fmmu.direction);
        if !counted {
            match fmmu.direction {
                ProcessDirection::Output => self.outputs += 1,
                ProcessDirection::Input => self.inputs += 1,
            }
        }
    }

    fn datagram(&self, offset: usize, size: usize) -> DomainDatagram {
        let (command, expected) = match (self.outputs, self.inputs) {
            (0, inputs) => (LogicalCommand::Read, inputs),
            (outputs, 0) => (LogicalCommand::Write, outputs),
            (outputs, inputs) => (LogicalCommand::ReadWrite, 2 * outputs + inputs),
        };
        DomainDatagram {
            command,
            offset,
            expected,
            state: DatagramState::Idle,
            working_counter: 0,
            wire: vec![0; size],
        }
    }
}

/// Packs FMMUs into datagrams in their order; one FMMU is never split.
///
/// Version 1.5 counts the first FMMU that no longer fits for the previous datagram instead of its
/// own: a slave with outputs and inputs in two datagrams gets LRW and LRD with together 3 instead
/// of LWR and LRD with 2.
fn pack(fmmus: &[DomainFmmu], version: EcrtVersion) -> Vec<DomainDatagram> {
    let mut datagrams = Vec::new();
    let mut used = Used::default();
    let (mut first, mut offset, mut size) = (0, 0, 0);
    for (index, fmmu) in fmmus.iter().enumerate() {
        if version == EcrtVersion::V1_5 {
            used.count(fmmus, first, index);
        }
        if size + fmmu.size > MAX_DATAGRAM_BYTES {
            if size > 0 {
                datagrams.push(used.datagram(offset, size));
            }
            offset += size;
            size = 0;
            used = Used::default();
            first = index;
        }
        if version != EcrtVersion::V1_5 {
            used.count(fmmus, first, index);
        }
        size += fmmu.size;
    }
    if size > 0 {
        datagrams.push(used.datagram(offset, size));
    }
    datagrams
}

const WORD_BYTES: usize = size_of::<u64>();

/// Zeroed memory of a fixed size, alive as long as one clone is.
#[derive(Clone, Debug)]
pub(crate) struct ProcessMemory {
    words: Arc<[AtomicU64]>,
    len: usize,
}

impl ProcessMemory {
    pub(crate) fn new(len: usize) -> Self {
        let words = (0..len.div_ceil(WORD_BYTES).max(1)).map(|_| AtomicU64::new(0)).collect();
        Self { words, len }
    }

    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Address for the caller. Valid while a clone of this memory lives.
    pub(crate) fn as_ptr(&self) -> *mut u8 {
        self.words.as_ptr().cast::<u8>().cast_mut()
    }

    /// Copies from `offset` into `target`; bytes outside keep their value.
    pub(crate) fn read(&self, offset: usize, target: &mut [u8]) {
        let inside = self.len.saturating_sub(offset).min(target.len());
        let Some(target) = target.get_mut(..inside) else { return };
        let Some((head, words, skip)) = self.split(offset, inside) else { return };
        let (first, rest) = target.split_at_mut(head);
        if let (true, Some((word, _))) = (head > 0, words.split_first()) {
            copy(first, word.load(Ordering::Relaxed).to_ne_bytes().get(skip..skip + head));
        }
        let words = words.get(usize::from(head > 0)..).unwrap_or_default();
        for (bytes, word) in rest.chunks_mut(WORD_BYTES).zip(words) {
            let length = bytes.len();
            copy(bytes, word.load(Ordering::Relaxed).to_ne_bytes().get(..length));
        }
    }

    /// Copies `source` to `offset`; bytes outside are dropped.
    pub(crate) fn write(&self, offset: usize, source: &[u8]) {
        let inside = self.len.saturating_sub(offset).min(source.len());
        let Some(source) = source.get(..inside) else { return };
        let Some((head, words, skip)) = self.split(offset, inside) else { return };
        let (first, rest) = source.split_at(head);
        if let (true, Some((word, _))) = (head > 0, words.split_first()) {
            change(word, skip, first);
        }
        let words = words.get(usize::from(head > 0)..).unwrap_or_default();
        for (bytes, word) in rest.chunks(WORD_BYTES).zip(words) {
            match <[u8; WORD_BYTES]>::try_from(bytes) {
                Ok(whole) => word.store(u64::from_ne_bytes(whole), Ordering::Relaxed),
                Err(_) => change(word, 0, bytes),
            }
        }
    }

    /// Number of bytes from `offset` in a word that begins before it, the words from that one on,
    /// and the start of the bytes in it.
    fn split(&self, offset: usize, length: usize) -> Option<(usize, &[AtomicU64], usize)> {
        let skip = offset % WORD_BYTES;
        let head = if skip == 0 { 0 } else { (WORD_BYTES - skip).min(length) };
        Some((head, self.words.get(offset / WORD_BYTES..)?, skip))
    }
}

/// Copies `source` if it has the length of `target`.
fn copy(target: &mut [u8], source: Option<&[u8]>) {
    if let Some(source) = source.filter(|source| source.len() == target.len()) {
        target.copy_from_slice(source);
    }
}

fn change(word: &AtomicU64, skip: usize, source: &[u8]) {
    let mut bytes = word.load(Ordering::Relaxed).to_ne_bytes();
    if let Some(part) = bytes.get_mut(skip..skip + source.len()) {
        part.copy_from_slice(source);
        word.store(u64::from_ne_bytes(bytes), Ordering::Relaxed);
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Queued {
    Domain { domain: usize, datagram: usize },
    ReferenceClock,
    SlaveClocks,
    ClockMonitor,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum DatagramState {
    /// Never queued since activation.
    #[default]
    Idle,
    Queued,
    /// On the wire; `arrives_ns` is `None` when the frame was lost.
    Sent {
        at_ns: u64,
        arrives_ns: Option<u64>,
    },
    Received,
    /// Not returned in time, or not sent because there is no link.
    Lost,
}

/// Sync managers of the gateway: two mailboxes, outputs, inputs.
pub(super) const SYNC_MANAGERS: u8 = 4;
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PdoEntry {
    pub(crate) index: u16,
    pub(crate) subindex: u8,
    pub(crate) bits: u8,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Pdo {
    pub(crate) index: u16,
    pub(crate) entries: Vec<PdoEntry>,
}

impl Pdo {
    pub(crate) fn bits(&self) -> usize {
        self.entries.iter().map(|entry| usize::from(entry.bits)).sum()
    }
}

/// Size of a list of PDOs in bytes.
pub(crate) fn pdo_bytes(pdos: &[Pdo]) -> usize {
    pdos.iter().map(Pdo::bits).sum::<usize>().div_ceil(8)
}

pub(crate) fn direction_of(sync_manager: u8) -> Option<ProcessDirection> {
    match sync_manager {
        0 | 2 => Some(ProcessDirection::Output),
        1 | 3 => Some(ProcessDirection::Input),
        _ => None,
    }
}

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

/// One write, and where to continue if the slave aborts it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct AssignmentWrite {
    pub(crate) index: u16,
    pub(crate) subindex: u8,
    pub(crate) value: u32,
    pub(crate) size: usize,
    pub(crate) after_failure: usize,
}

const FIRST_PROCESS_SYNC: u8 = 2;

/// The writes of the sync managers of a configuration that the SII of the slave allows.
///
/// A count that cannot be cleared skips its object, a PDO that cannot be assigned ends the list.
pub(crate) fn assignment_writes(
    syncs: &[SyncConfig],
    slave: &SlaveDescription,
) -> Vec<AssignmentWrite> {
    let mut list = Vec::new();
    for number in FIRST_PROCESS_SYNC..SYNC_MANAGERS {
        let Some(sync) = syncs.get(usize::from(number)) else { continue };
        for pdo in sync.pdos.iter().filter(|_| slave.pdo_configuration) {
            let entries = pdo.entries.iter().map(|entry| {
                let object = u32::from(entry.index) << 16 | u32::from(entry.subindex) << 8;
                (object | u32::from(entry.bits), 4)
            });
            push_list(&mut list, pdo.index, entries, false);
        }
        if slave.pdo_assign {
            let pdos = sync.pdos.iter().map(|pdo| (u32::from(pdo.index), 2));
            push_list(&mut list, 0x1C10 + u16::from(number), pdos, true);
        }
    }
    list
}

/// Count to 0, the entries, the count.
fn push_list(
    list: &mut Vec<AssignmentWrite>,
    index: u16,
    entries: impl Iterator<Item = (u32, usize)>,
    fatal: bool,
) {
    let first = list.len();
    let mut push = |subindex, value, size| {
        list.push(AssignmentWrite { index, subindex, value, size, after_failure: 0 });
    };
    push(0, 0, 1);
    let mut count = 0u8;
    for (value, size) in entries {
        count = count.saturating_add(1);
        push(count, value, size);
    }
    if count > 0 {
        push(0, u32::from(count), 1);
    }
    let end = list.len();
    for (index, write) in list.iter_mut().enumerate().skip(first) {
        write.after_failure = if fatal && index > first { usize::MAX } else { end };
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn domain(slaves: &[(usize, usize)], version: EcrtVersion) -> Domain {
        let mut domain = Domain::default();
        for (config, (outputs, inputs)) in slaves.iter().enumerate() {
            domain.add_fmmu(config, 2, ProcessDirection::Output, *outputs);
            domain.add_fmmu(config, 3, ProcessDirection::Input, *inputs);
        }
        domain.finish(0, version);
        domain
    }

    fn shape(domain: &Domain) -> Vec<(LogicalCommand, usize, usize, u32)> {
        let line = |d: &DomainDatagram| (d.command, d.offset, d.wire.len(), d.expected);
        domain.datagrams.iter().map(line).collect()
    }

    #[test]
    fn five_chunks_each_way_are_one_datagram() {
        let domain = domain(&[(640, 640)], EcrtVersion::V1_6);
        assert_eq!(shape(&domain), [(LogicalCommand::ReadWrite, 0, 1280, 3)]);
    }

    #[test]
    fn six_chunks_each_way_are_two_datagrams_and_count_by_version() {
        let new = domain(&[(768, 768)], EcrtVersion::V1_6);
        assert_eq!(
            shape(&new),
            [(LogicalCommand::Write, 0, 768, 1), (LogicalCommand::Read, 768, 768, 1)]
        );
        assert_eq!(new.expected, 2);
        let old = domain(&[(768, 768)], EcrtVersion::V1_5);
        assert_eq!(
            shape(&old),
            [(LogicalCommand::ReadWrite, 0, 768, 3), (LogicalCommand::Read, 768, 768, 0)]
        );
        assert_eq!(old.expected, 3);
    }

    #[test]
    fn two_slaves_share_a_datagram_while_they_fit() {
        let domain = domain(&[(384, 384), (128, 128)], EcrtVersion::V1_6);
        assert_eq!(shape(&domain), [(LogicalCommand::ReadWrite, 0, 1024, 6)]);
        assert_eq!(domain.fmmus[3].offset, 896);
    }

    #[test]
    fn oversized_fmmu_stays_whole() {
        let domain = domain(&[(1536, 1536)], EcrtVersion::V1_6);
        assert!(domain.datagrams.iter().all(|d| d.wire.len() == 1536));
        assert_eq!(domain.expected, 2);
    }

    #[test]
    fn fmmu_is_made_once_per_sync_manager() {
        let mut domain = Domain::default();
        assert_eq!(domain.add_fmmu(0, 2, ProcessDirection::Output, 384), 0);
        assert_eq!(domain.add_fmmu(0, 3, ProcessDirection::Input, 384), 384);
        assert_eq!(domain.add_fmmu(0, 2, ProcessDirection::Output, 384), 0);
        assert_eq!(domain.size, 768);
    }

    proptest! {
        #[test]
        fn any_write_is_read_back_and_nothing_else_changes(
            len in 1usize..80,
            offset in 0usize..90,
            data in proptest::collection::vec(1u8.., 0..60),
        ) {
            let memory = ProcessMemory::new(len);
            memory.write(offset, &data);
            let mut all = vec![0; len];
            memory.read(0, &mut all);
            for (at, byte) in all.iter().enumerate() {
                let expected = at.checked_sub(offset).and_then(|i| data.get(i)).copied();
                prop_assert_eq!(*byte, expected.unwrap_or(0));
            }
            let mut part = vec![0xEE; data.len()];
            memory.read(offset, &mut part);
            let inside = len.saturating_sub(offset).min(data.len());
            prop_assert_eq!(&part[..inside], &data[..inside]);
            prop_assert!(part[inside..].iter().all(|byte| *byte == 0xEE));
        }
    }

    #[test]
    fn assignment_is_cleared_written_and_counted() {
        let mut syncs: [SyncConfig; 4] = Default::default();
        syncs[2].pdos = [0x1600, 0x1601].map(|index| Pdo { index, entries: Vec::new() }).to_vec();
        let slave = SlaveDescription::of_gateway(&crate::scenario::GatewaySpec::at(0));
        let list = assignment_writes(&syncs, &slave);
        let lines: Vec<_> = list.iter().map(|w| (w.index, w.subindex, w.value, w.size)).collect();
        assert_eq!(
            lines,
            [
                (0x1C12, 0, 0, 1),
                (0x1C12, 1, 0x1600, 2),
                (0x1C12, 2, 0x1601, 2),
                (0x1C12, 0, 2, 1),
                (0x1C13, 0, 0, 1),
            ]
        );
        assert_eq!(list[0].after_failure, 4);
        assert_eq!(list[1].after_failure, usize::MAX);
        let fixed = SlaveDescription { pdo_assign: false, ..slave };
        assert!(assignment_writes(&syncs, &fixed).is_empty());
    }
}
