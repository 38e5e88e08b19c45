//! Steps that configure a multiplexed PDO of a node (CiA 301, 7.2.2.4).

use ecan_protocol::can::CanId;
use thiserror::Error;

use super::node_action::Step;
use super::pdo_mapping::{
    COB_ID_INVALID, MAX_NUMBER, NO_RTR, PdoDirection, communication_index, mapping_index,
};
use crate::{DispatcherEntry, Mpdo, PdoCobId, ScannerEntry, TransmissionType, object};

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
    value: impl Fn(&T) -> ecan_protocol::sequence::SdoValue,
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
