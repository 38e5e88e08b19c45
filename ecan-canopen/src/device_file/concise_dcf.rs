//! Concise DCF: the downloads of a configuration as one DOMAIN (CiA 302-3, object 0x1F22).

use alloc::vec::Vec;

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
    use super::*;
    use alloc::vec;

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
