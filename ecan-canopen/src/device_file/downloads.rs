//! Downloads of a configuration in an order that a device accepts, and as a concise DCF (CiA 302-3).

use alloc::vec::Vec;

use super::contents::{DeviceFile, is_command};
use super::data_type::DataType;
use super::data_value::{DataValue, ValueError};
use super::device_object::ObjectEntry;
use crate::{CobId, NodeId, object};

/// Values that a configuration downloads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DownloadScope {
    /// Each `ParameterValue` that differs from its `DefaultValue`.
    #[default]
    Changed,
    /// Each `ParameterValue`.
    All,
}

/// Value of a file that cannot be encoded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("object {index:#06X}:{subindex:02X}: {error}")]
pub struct DownloadError {
    /// Index.
    pub index: u16,
    /// Subindex.
    pub subindex: u8,
    /// Reason.
    pub error: ValueError,
}

/// Bit of a COB-ID: the service does not exist.
const INVALID: u32 = 0x8000_0000;
/// Bit of 0x1005: the device produces SYNC.
const PRODUCER: u32 = 0x4000_0000;
/// SDO parameters of servers and clients (CiA 301, 7.5.2.33 and 7.5.2.34).
const SDO_PARAMETERS: core::ops::RangeInclusive<u16> = 0x1200..=0x12FF;
/// Date and time of the configuration (CiA 301, 7.5.2.23): valid after everything else.
const VERIFY_CONFIGURATION: u16 = 0x1020;
const PDOS: u16 = 0x200;

impl DeviceFile {
    /// The downloads that configure a node as the file states, in an order that a device accepts.
    ///
    /// Communication parameters come first, then the objects of the application, then the PDOs, each
    /// of which is disabled while it changes (CiA 301, 7.5.2.36): COB-ID invalid, communication,
    /// number of entries 0, mapping, number of entries, COB-ID. If the file states no COB-ID for one of
    /// the first four PDOs, that of the predefined connection set counts. SDO, EMCY and SYNC are disabled
    /// likewise while their COB-ID changes. 0x1020 comes last.
    ///
    /// Left out are objects that are not writable or refuse downloads (`ObjFlags`), and 0x1003,
    /// 0x1010 and 0x1011. The contents of a DOMAIN are in the file that `DownloadFile` names.
    ///
    /// # Errors
    /// [`DownloadError`] for a value that does not fit its type. A file that
    /// [`parse`](Self::parse) returned has none.
    pub fn downloads(
        &self,
        node: NodeId,
        scope: DownloadScope,
    ) -> Result<Vec<Download>, DownloadError> {
        let mut list = DownloadList { file: self, node, scope, downloads: Vec::new() };
        let (communication, application): (Vec<_>, Vec<_>) = self
            .entries()
            .filter(|entry| !is_pdo(entry.index) && entry.index != VERIFY_CONFIGURATION)
            .partition(|entry| entry.index < 0x2000);
        // The counter can change only before SYNC has a period.
        list.object(object::SYNC_COUNTER_OVERFLOW)?;
        for entry in communication {
            match entry.index {
                object::SYNC_COUNTER_OVERFLOW | object::COMMUNICATION_CYCLE => {}
                object::SYNC_COB_ID => list.sync()?,
                object::EMCY_COB_ID => list.emcy()?,
                index if SDO_PARAMETERS.contains(&index) => list.sdo(entry)?,
                _ => list.wanted(entry)?,
            }
        }
        for entry in application {
            list.wanted(entry)?;
        }
        for communication in [object::RPDO_COMMUNICATION, object::TPDO_COMMUNICATION] {
            for number in 0..PDOS {
                list.pdo(communication + number)?;
            }
        }
        list.object(VERIFY_CONFIGURATION)?;
        Ok(list.downloads)
    }
}

fn is_pdo(index: u16) -> bool {
    (object::RPDO_COMMUNICATION..object::TPDO_MAPPING + PDOS).contains(&index)
}

struct DownloadList<'a> {
    file: &'a DeviceFile,
    node: NodeId,
    scope: DownloadScope,
    downloads: Vec<Download>,
}

impl<'a> DownloadList<'a> {
    /// Returns whether a download may write an entry at all.
    fn is_allowed(&self, entry: &ObjectEntry) -> bool {
        let object = self.file.object(entry.index);
        entry.access.is_writable()
            && !is_command(entry.index)
            && !entry.flags.refuses_write_on_download()
            && object.is_none_or(|object| !object.flags.refuses_write_on_download())
    }

    fn is_wanted(&self, entry: &ObjectEntry) -> bool {
        let Some(value) = entry.parameter_value(self.node) else { return false };
        let is_changed =
            self.scope == DownloadScope::All || entry.default_value(self.node) != Some(value);
        is_changed && self.is_allowed(entry)
    }

    fn push(&mut self, entry: &ObjectEntry, value: &DataValue) -> Result<(), DownloadError> {
        let (index, subindex) = (entry.index, entry.subindex);
        let encoded = entry.data_type.encode(value);
        let data = encoded.map_err(|error| DownloadError { index, subindex, error })?;
        self.downloads.push(Download { index, subindex, data });
        Ok(())
    }

    fn push_number(&mut self, entry: &ObjectEntry, number: u32) -> Result<(), DownloadError> {
        self.push(entry, &DataValue::Unsigned(number.into()))
    }

    fn wanted(&mut self, entry: &ObjectEntry) -> Result<(), DownloadError> {
        match entry.parameter_value(self.node) {
            Some(value) if self.is_wanted(entry) => self.push(entry, &value),
            _ => Ok(()),
        }
    }

    /// The wanted entries of an object.
    fn object(&mut self, index: u16) -> Result<(), DownloadError> {
        let entries = self.file.object(index).into_iter().flat_map(|object| object.entries());
        for entry in entries {
            self.wanted(entry)?;
        }
        Ok(())
    }

    /// The configured value of an entry as a number.
    fn number(&self, entry: &ObjectEntry) -> Option<u32> {
        entry.configured_value(self.node)?.to_integer()?.try_into().ok()
    }

    /// The configured COB-ID of an entry; `None` if its type cannot hold the bits of one.
    fn cob_id(&self, entry: &ObjectEntry) -> Option<u32> {
        self.number(entry).filter(|_| entry.data_type == DataType::Unsigned32)
    }

    /// SYNC: the device stops to produce it while its COB-ID and its period change.
    fn sync(&mut self) -> Result<(), DownloadError> {
        let Some(entry) = self.file.entry(object::SYNC_COB_ID, 0) else { return Ok(()) };
        let number = self.cob_id(entry).filter(|_| self.is_wanted(entry));
        match number {
            Some(number) => self.push_number(entry, number & !PRODUCER)?,
            None => self.wanted(entry)?,
        }
        self.object(object::COMMUNICATION_CYCLE)?;
        match number {
            Some(number) if number & PRODUCER != 0 => self.push_number(entry, number),
            _ => Ok(()),
        }
    }

    /// EMCY: invalid while its COB-ID changes.
    fn emcy(&mut self) -> Result<(), DownloadError> {
        let Some(entry) = self.file.entry(object::EMCY_COB_ID, 0) else { return Ok(()) };
        match self.cob_id(entry).filter(|_| self.is_wanted(entry)) {
            Some(number) => self.replace(entry, number),
            None => self.wanted(entry),
        }
    }

    fn replace(&mut self, entry: &ObjectEntry, number: u32) -> Result<(), DownloadError> {
        self.push_number(entry, number | INVALID)?;
        match number & INVALID {
            0 => self.push_number(entry, number),
            _ => Ok(()),
        }
    }

    /// An entry of an SDO parameter: with sub-object 1, all of them.
    fn sdo(&mut self, entry: &ObjectEntry) -> Result<(), DownloadError> {
        let Some(object) = self.file.object(entry.index) else { return Ok(()) };
        let is_first = object.entries().next().is_some_and(|first| first == entry);
        let wanted: Vec<_> = object.entries().filter(|entry| self.is_wanted(entry)).collect();
        if !is_first {
            return Ok(());
        }
        let is_cob_id = |entry: &&ObjectEntry| matches!(entry.subindex, 1 | 2);
        let cob_id = |entry| Some((entry, self.cob_id(entry).filter(|_| is_cob_id(&entry))?));
        let cob_ids: Vec<_> = wanted.iter().filter_map(|entry| cob_id(*entry)).collect();
        for (entry, number) in &cob_ids {
            self.push_number(entry, number | INVALID)?;
        }
        for entry in wanted {
            if !cob_ids.iter().any(|(other, _)| other.subindex == entry.subindex) {
                self.wanted(entry)?;
            }
        }
        for (entry, number) in cob_ids.into_iter().filter(|(_, number)| number & INVALID == 0) {
            self.push_number(entry, number)?;
        }
        Ok(())
    }

    /// A PDO, if its communication or its mapping is wanted.
    fn pdo(&mut self, index: u16) -> Result<(), DownloadError> {
        let mapping_index = index + (object::RPDO_MAPPING - object::RPDO_COMMUNICATION);
        let has_wanted = |list: &Self, index| {
            let object = list.file.object(index);
            object.is_some_and(|object| object.entries().any(|entry| list.is_wanted(entry)))
        };
        let (communication, mapping) = (has_wanted(self, index), has_wanted(self, mapping_index));
        if !communication && !mapping {
            return Ok(());
        }
        let cob_id = self.file.entry(index, 1).filter(|entry| self.is_allowed(entry));
        let cob_id = cob_id.and_then(|entry| {
            let number = self.cob_id(entry).or_else(|| self.predefined(entry))?;
            Some((entry, number))
        });
        if let Some((entry, number)) = cob_id {
            self.push_number(entry, number | INVALID)?;
        }
        let others = self.file.object(index).into_iter().flat_map(|object| object.entries());
        for entry in others.filter(|entry| entry.subindex != 1 || cob_id.is_none()) {
            self.wanted(entry)?;
        }
        if mapping {
            self.mapping(mapping_index)?;
        }
        match cob_id {
            Some((entry, number)) if number & INVALID == 0 => self.push_number(entry, number),
            _ => Ok(()),
        }
    }

    /// COB-ID of the predefined connection set, for a PDO of a file that states none.
    fn predefined(&self, entry: &ObjectEntry) -> Option<u32> {
        let is_open =
            entry.data_type == DataType::Unsigned32 && entry.configured_value(self.node).is_none();
        let is_sent = entry.index >= object::TPDO_COMMUNICATION;
        let number = (entry.index & (PDOS - 1)) as u8 + 1;
        if !is_open || entry.index & (PDOS - 1) > 3 {
            return None;
        }
        let cob_id = if is_sent { CobId::tpdo } else { CobId::rpdo };
        Some(cob_id(self.node, number).raw().into())
    }

    /// All mapped objects of a PDO; none if its mapping is fixed.
    fn mapping(&mut self, index: u16) -> Result<(), DownloadError> {
        let Some(count) = self.file.entry(index, 0).filter(|entry| self.is_allowed(entry)) else {
            return Ok(());
        };
        let Some(number) = self.number(count) else { return Ok(()) };
        self.push_number(count, 0)?;
        for subindex in (1..=u8::MAX).take(number as usize) {
            let Some(entry) = self.file.entry(index, subindex) else { break };
            if let Some(value) =
                entry.configured_value(self.node).filter(|_| self.is_allowed(entry))
            {
                self.push(entry, &value)?;
            }
        }
        self.push_number(count, number)
    }
}

/// SDO download of one value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Download {
    /// Index.
    pub index: u16,
    /// Subindex.
    pub subindex: u8,
    /// Bytes of the value.
    pub data: Vec<u8>,
}

/// Reason why bytes are not a concise DCF.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ConciseDcfError {
    /// The bytes end within a value.
    #[error(
        "concise DCF ends at byte {length}, within entry {entry} of {count}; allowed: all entries \
         that its first four bytes announce"
    )]
    Truncated {
        /// Number of bytes.
        length: usize,
        /// Entry, from 1; 0 is the number of entries.
        entry: u32,
        /// Number of entries.
        count: u32,
    },
    /// Bytes follow the last entry.
    #[error("concise DCF has {excess} bytes after its {count} entries; allowed: none")]
    Excess {
        /// Number of excess bytes.
        excess: usize,
        /// Number of entries.
        count: u32,
    },
}

/// Encodes downloads: their number, then for each one index, subindex, size and data, in
/// little-endian order.
#[must_use]
pub fn encode_concise_dcf(downloads: &[Download]) -> Vec<u8> {
    let mut bytes = (downloads.len() as u32).to_le_bytes().to_vec();
    for Download { index, subindex, data } in downloads {
        bytes.extend(index.to_le_bytes());
        bytes.push(*subindex);
        bytes.extend((data.len() as u32).to_le_bytes());
        bytes.extend_from_slice(data);
    }
    bytes
}

/// Decodes a concise DCF. No bytes at all are an empty one, as a manager without configuration
/// returns them.
///
/// # Errors
/// [`ConciseDcfError`] if the number of bytes does not agree with the entries.
pub fn decode_concise_dcf(bytes: &[u8]) -> Result<Vec<Download>, ConciseDcfError> {
    if bytes.is_empty() {
        return Ok(Vec::new());
    }
    let mut rest = bytes;
    let length = bytes.len();
    let truncated = |entry, count| ConciseDcfError::Truncated { length, entry, count };
    let count = take(&mut rest).map(u32::from_le_bytes).ok_or(truncated(0, 0))?;
    let mut downloads = Vec::new();
    for entry in 1..=count {
        let download = take_download(&mut rest).ok_or(truncated(entry, count))?;
        downloads.push(download);
    }
    match rest.len() {
        0 => Ok(downloads),
        excess => Err(ConciseDcfError::Excess { excess, count }),
    }
}

fn take<const N: usize>(rest: &mut &[u8]) -> Option<[u8; N]> {
    let (first, after) = rest.split_first_chunk()?;
    *rest = after;
    Some(*first)
}

fn take_download(rest: &mut &[u8]) -> Option<Download> {
    let index = u16::from_le_bytes(take(rest)?);
    let [subindex] = take(rest)?;
    let size = u32::from_le_bytes(take(rest)?) as usize;
    let (data, after) = rest.split_at_checked(size)?;
    *rest = after;
    Some(Download { index, subindex, data: data.to_vec() })
}

#[cfg(test)]
mod tests {
    use alloc::vec;

    use super::*;

    /// Two entries: 0x1017:00 = 1000 (U16) and 0x6098:00 = 35 (I8).
    const GOLDEN: [u8; 21] = [
        2, 0, 0, 0, //
        0x17, 0x10, 0, 2, 0, 0, 0, 0xE8, 0x03, //
        0x98, 0x60, 0, 1, 0, 0, 0, 0x23,
    ];

    #[test]
    fn concise_dcf_has_layout_of_cia_302() {
        let downloads = vec![
            Download { index: 0x1017, subindex: 0, data: vec![0xE8, 0x03] },
            Download { index: 0x6098, subindex: 0, data: vec![0x23] },
        ];
        assert_eq!(encode_concise_dcf(&downloads), GOLDEN);
        assert_eq!(decode_concise_dcf(&GOLDEN), Ok(downloads));
        assert_eq!(decode_concise_dcf(&[]), Ok(vec![]));
        assert_eq!(decode_concise_dcf(&[0; 4]), Ok(vec![]));
    }

    #[test]
    fn wrong_length_is_reported() {
        for length in 1..GOLDEN.len() {
            let error = decode_concise_dcf(&GOLDEN[..length]).unwrap_err();
            assert!(matches!(error, ConciseDcfError::Truncated { .. }), "{length}");
        }
        let mut longer = GOLDEN.to_vec();
        longer.push(0);
        let error = decode_concise_dcf(&longer).unwrap_err();
        assert_eq!(error, ConciseDcfError::Excess { excess: 1, count: 2 });
        // A count or size that no memory holds.
        assert!(decode_concise_dcf(&[0xFF; 11]).is_err());
    }
}
