//! Steps that map a PDO, in the order that drives accept (CiA 301, 7.5.2.35 to 7.5.2.38).

use ecan_protocol::can::CanId;
use ecan_protocol::sequence::{Expectation, SdoValue};
use thiserror::Error;

use super::config::Step;
use crate::{
    DispatcherEntry, MappingEntry, Mpdo, PdoCobId, ScannerEntry, TransmissionType, object,
};

/// The PDO does not exist: bit 31 of its COB-ID entry.
pub(super) const COB_ID_INVALID: u32 = 1 << 31;
/// No remote request for the PDO: bit 30, which stays as the node has it.
pub(super) const NO_RTR: u32 = 1 << 30;

const MAX_BITS: u32 = 64;
/// PDOs of a node in each direction.
pub(super) const MAX_NUMBER: u16 = 512;

/// Direction of a PDO, seen from the node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PdoDirection {
    /// RPDO: the node receives it.
    Receive,
    /// TPDO: the node sends it.
    Transmit,
}

/// Invalid PDO mapping.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum PdoMappingError {
    /// PDO numbers run from 1 to 512.
    #[error("PDO number {number} is out of range; allowed: 1 to 512")]
    Number {
        /// The invalid number.
        number: u16,
    },
    /// The SYNC start value is out of range.
    #[error("SYNC start value {value} is out of range; allowed: 0 to 240")]
    SyncStart {
        /// The invalid value.
        value: u8,
    },
    /// The mapping is empty or too long.
    #[error("{bits} bits in {entries} entries are mapped; allowed: 1 to 64 bits")]
    Size {
        /// Bits mapped.
        bits: u32,
        /// Entries.
        entries: usize,
    },
}

/// Mapping of one PDO of a node: plain data, from which [`Step`]s are created.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PdoMapping {
    /// Direction.
    pub direction: PdoDirection,
    /// PDO number, 1..512.
    pub number: u16,
    /// CAN ID.
    pub cob_id: CanId,
    /// Transmission type: when it is sent or becomes effective.
    pub transmission: TransmissionType,
    /// Shortest time between two of a TPDO, in units of 100 microseconds (subindex 3); `None`
    /// leaves it as it is.
    pub inhibit_time: Option<u16>,
    /// Longest time between two of a TPDO, or deadline of an RPDO, in milliseconds (subindex 5);
    /// `None` leaves it as it is.
    pub event_timer_ms: Option<u16>,
    /// SYNC counter at which a synchronous TPDO starts, 1..240 (subindex 6); 0 starts with any SYNC, and `None`
    /// leaves it as it is. It needs a counter, see [`SyncConfig::counter_step`](crate::SyncConfig::counter_step).
    pub sync_start: Option<u8>,
    /// Mapped objects, in order.
    pub entries: Vec<MappingEntry>,
}

impl PdoMapping {
    /// Index of the communication parameters: 0x1400 or 0x1800 upwards.
    pub fn communication_index(&self) -> u16 {
        communication_index(self.direction, self.number)
    }

    /// Index of the mapping parameters: 0x1600 or 0x1A00 upwards.
    pub fn mapping_index(&self) -> u16 {
        mapping_index(self.direction, self.number)
    }

    /// Length of the PDO in bytes.
    pub fn length(&self) -> usize {
        self.bits().div_ceil(8) as usize
    }

    fn bits(&self) -> u32 {
        self.entries.iter().map(|entry| u32::from(entry.bits)).sum()
    }

    /// Returns the steps: COB-ID invalid, transmission type and times, count 0, entries, count n, all of
    /// it read back, then COB-ID valid and read back. The COB-ID entry is read first and its bit 30
    /// kept, since drives differ in whether they let it change. Of a device that cannot write COB-ID, type or
    /// mapping, the readbacks accept the same values.
    ///
    /// The node must be pre-operational.
    ///
    /// # Errors
    /// A [`PdoMappingError`].
    pub fn steps(&self) -> Result<Vec<Step>, PdoMappingError> {
        if !(1..=MAX_NUMBER).contains(&self.number) {
            return Err(PdoMappingError::Number { number: self.number });
        }
        if let Some(value) = self.sync_start.filter(|value| *value > 240) {
            return Err(PdoMappingError::SyncStart { value });
        }
        let (bits, entries) = (self.bits(), self.entries.len());
        if !(1..=MAX_BITS).contains(&bits) || entries > MAX_BITS as usize {
            return Err(PdoMappingError::Size { bits, entries });
        }
        // infallible: at most 64 entries
        let count = u8::try_from(entries).unwrap_or(u8::MAX);
        let (communication, mapping) = (self.communication_index(), self.mapping_index());
        let cob_id = PdoCobId::new(self.cob_id).raw() & !NO_RTR;
        let mut steps = vec![
            Step::modify(communication, 1, 0, COB_ID_INVALID).named("PDO off").if_writable(),
            Step::write(communication, 2, self.transmission.raw())
                .named("transmission type")
                .if_writable(),
        ];
        if let Some(inhibit_time) = self.inhibit_time {
            steps.push(Step::write(communication, 3, inhibit_time).named("inhibit time"));
        }
        if let Some(event_timer) = self.event_timer_ms {
            steps.push(Step::write(communication, 5, event_timer).named("event timer"));
        }
        if let Some(sync_start) =
            self.sync_start.filter(|_| self.direction == PdoDirection::Transmit)
        {
            steps.push(Step::write(communication, 6, sync_start).named("SYNC start value"));
        }
        let write = |subindex, value: SdoValue, name| {
            Step::write(mapping, subindex, value).named(name).if_writable()
        };
        let numbered = || (1u8..).zip(&self.entries);
        steps.push(write(0, 0u8.into(), "mapping off"));
        steps.extend(numbered().map(|(nth, entry)| write(nth, entry.raw().into(), "mapping")));
        steps.push(write(0, count.into(), "mapping on"));
        steps.push(Step::expect(communication, 2, self.transmission.raw()).named("readback"));
        steps.push(Step::expect(mapping, 0, count).named("readback"));
        steps.extend(
            numbered()
                .map(|(nth, entry)| Step::expect(mapping, nth, entry.raw()).named("readback")),
        );
        steps.push(Step::modify(communication, 1, !NO_RTR, cob_id).named("PDO on").if_writable());
        let expected = Expectation::Masked { value: cob_id.into(), mask: (!NO_RTR).into() };
        steps.push(Step::expect_that(communication, 1, expected).named("readback"));
        Ok(steps)
    }

    /// Returns the steps that disable a PDO.
    ///
    /// # Errors
    /// [`PdoMappingError::Number`].
    pub fn disabling_steps(
        direction: PdoDirection,
        number: u16,
    ) -> Result<Vec<Step>, PdoMappingError> {
        if !(1..=MAX_NUMBER).contains(&number) {
            return Err(PdoMappingError::Number { number });
        }
        let communication = communication_index(direction, number);
        let invalid = Expectation::HasBits(COB_ID_INVALID.into());
        Ok(vec![
            Step::modify(communication, 1, 0, COB_ID_INVALID).named("PDO off"),
            Step::expect_that(communication, 1, invalid).named("readback"),
        ])
    }
}

/// From the communication parameters of a PDO to its mapping.
const MAPPING: u16 = 0x200;

pub(super) fn mapping_index(direction: PdoDirection, number: u16) -> u16 {
    communication_index(direction, number).wrapping_add(MAPPING)
}

pub(super) fn communication_index(direction: PdoDirection, number: u16) -> u16 {
    let base = match direction {
        PdoDirection::Receive => 0x1400,
        PdoDirection::Transmit => 0x1800,
    };
    base + (number.wrapping_sub(1) & 0x1FF)
}

/// Address mode of an MPDO, and the list of the node that belongs to it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MpdoMode {
    /// Destination address mode: each frame names an object of the consumer.
    Destination,
    /// Source address mode, producer: the objects of the scanner list 0x1FA0.
    Scanner(Vec<ScannerEntry>),
    /// Source address mode, consumer: the dispatcher list 0x1FD0 translates the objects of producers.
    Dispatcher(Vec<DispatcherEntry>),
}

/// Invalid configuration of an MPDO.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum MpdoConfigError {
    /// PDO numbers run from 1 to 512.
    #[error("PDO number {number} is out of range; allowed: 1 to 512")]
    Number {
        /// The invalid number.
        number: u16,
    },
    /// A producer has a scanner list, a consumer a dispatcher list.
    #[error(
        "the list does not fit the direction; allowed: scanner list of a TPDO, dispatcher list of an RPDO"
    )]
    Direction,
    /// A list has at most 254 entries.
    #[error("the list has {entries} entries; allowed: 0 to 254")]
    Entries {
        /// Number of entries.
        entries: usize,
    },
}

/// Configuration of one MPDO of a node: plain data, from which [`Step`]s are created.
///
/// The host sends MPDOs to nodes, and reads those of nodes, as any other PDO: with the bytes of [`Mpdo`] in
/// [`Cycle::send`](ecan_mcan_port::Cycle::send), and from the frames that [`Network::receive`](crate::Network::receive)
/// passes on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MpdoConfig {
    /// Direction, seen from the node.
    pub direction: PdoDirection,
    /// PDO number, 1..512.
    pub number: u16,
    /// CAN ID.
    pub cob_id: CanId,
    /// Shortest time between two of a TPDO, in units of 100 microseconds (subindex 3); `None` leaves it as it is.
    pub inhibit_time: Option<u16>,
    /// Address mode.
    pub mode: MpdoMode,
}

impl MpdoConfig {
    /// Returns the steps: COB-ID invalid, transmission type, list, number of mapped objects 0xFE or 0xFF, COB-ID
    /// valid; the number is read back. An MPDO is event-driven.
    ///
    /// The node must be pre-operational.
    ///
    /// # Errors
    /// An [`MpdoConfigError`].
    pub fn steps(&self) -> Result<Vec<Step>, MpdoConfigError> {
        let Self { direction, number, cob_id, .. } = *self;
        if !(1..=MAX_NUMBER).contains(&number) {
            return Err(MpdoConfigError::Number { number });
        }
        let mode = match (&self.mode, direction) {
            (MpdoMode::Destination, _) => Mpdo::DESTINATION_MAPPING,
            (MpdoMode::Scanner(_), PdoDirection::Transmit)
            | (MpdoMode::Dispatcher(_), PdoDirection::Receive) => Mpdo::SOURCE_MAPPING,
            _ => return Err(MpdoConfigError::Direction),
        };
        let communication = communication_index(direction, number);
        let mapping = mapping_index(direction, number);
        let kind = TransmissionType::EventProfile.raw();
        let mut steps = vec![
            Step::modify(communication, 1, 0, COB_ID_INVALID).named("PDO off"),
            Step::write(communication, 2, kind).named("transmission type"),
        ];
        if let Some(inhibit_time) = self.inhibit_time {
            steps.push(Step::write(communication, 3, inhibit_time).named("inhibit time"));
        }
        steps.push(Step::write(mapping, 0, 0u8).named("mapping off"));
        match &self.mode {
            MpdoMode::Destination => {}
            MpdoMode::Scanner(entries) => {
                list_steps(&mut steps, object::SCANNER_LIST, entries, |entry| entry.raw().into())?;
            }
            MpdoMode::Dispatcher(entries) => {
                list_steps(&mut steps, object::DISPATCHER_LIST, entries, |entry| {
                    entry.raw().into()
                })?;
            }
        }
        let cob_id = PdoCobId::new(cob_id).raw() & !NO_RTR;
        steps.extend([
            Step::write(mapping, 0, mode).named("MPDO"),
            Step::expect(mapping, 0, mode).named("readback"),
            Step::modify(communication, 1, !NO_RTR, cob_id).named("PDO on"),
        ]);
        Ok(steps)
    }
}

/// Writes the entries of a list; some nodes have a fixed number of entries, others store it.
fn list_steps<T>(
    steps: &mut Vec<Step>,
    index: u16,
    entries: &[T],
    value: impl Fn(&T) -> SdoValue,
) -> Result<(), MpdoConfigError> {
    let count = u8::try_from(entries.len()).ok().filter(|count| *count < u8::MAX);
    let count = count.ok_or(MpdoConfigError::Entries { entries: entries.len() })?;
    steps.push(Step::write(index, 0, 0u8).named("list off").if_accepted());
    for (nth, entry) in (1..).zip(entries) {
        steps.push(Step::write(index, nth, value(entry)).named("list"));
    }
    steps.push(Step::write(index, 0, count).named("list on").if_accepted());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CobId, NodeId};

    fn config(direction: PdoDirection, mode: MpdoMode) -> MpdoConfig {
        let cob_id = CobId::tpdo(NodeId::MIN, 2).can_id();
        MpdoConfig { direction, number: 2, cob_id, inhibit_time: Some(30), mode }
    }

    #[test]
    fn steps_write_the_list_before_the_mode() {
        let entries = vec![
            ScannerEntry { index: 0x6064, subindex: 0, count: 1 },
            ScannerEntry { index: 0x6401, subindex: 1, count: 8 },
        ];
        let steps = config(PdoDirection::Transmit, MpdoMode::Scanner(entries)).steps().unwrap();
        let text: Vec<_> = steps.iter().map(|step| step.action.to_string()).collect();
        assert_eq!(
            text,
            [
                "change 0x1801:01",
                "write 0x1801:02 = 0xFF",
                "write 0x1801:03 = 0x001E",
                "write 0x1A01:00 = 0x00",
                "write 0x1FA0:00 = 0x00",
                "write 0x1FA0:01 = 0x01606400",
                "write 0x1FA0:02 = 0x08640101",
                "write 0x1FA0:00 = 0x02",
                "write 0x1A01:00 = 0xFE",
                "check 0x1A01:00",
                "change 0x1801:01",
            ]
        );
        let destination = config(PdoDirection::Receive, MpdoMode::Destination).steps().unwrap();
        assert_eq!(destination[4].action.to_string(), "write 0x1601:00 = 0xFF");
    }

    #[test]
    fn invalid_configuration_is_rejected() {
        let scanner = MpdoMode::Scanner(Vec::new());
        let wrong = config(PdoDirection::Receive, scanner.clone());
        assert_eq!(wrong.steps(), Err(MpdoConfigError::Direction));
        let wrong = MpdoConfig { number: 0, ..config(PdoDirection::Transmit, scanner) };
        assert_eq!(wrong.steps(), Err(MpdoConfigError::Number { number: 0 }));
        let entry = ScannerEntry { index: 0x6064, subindex: 0, count: 1 };
        let wrong = config(PdoDirection::Transmit, MpdoMode::Scanner(vec![entry; 255]));
        assert_eq!(wrong.steps(), Err(MpdoConfigError::Entries { entries: 255 }));
    }
}
