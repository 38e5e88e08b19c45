//! Domains: FMMU layout, packing into datagrams, expected working counter.

use crate::ecrt::datagram::DatagramState;
use crate::ecrt::process_memory::ProcessMemory;
use crate::scenario::EcrtVersion;
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

#[cfg(test)]
mod tests {
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
}
