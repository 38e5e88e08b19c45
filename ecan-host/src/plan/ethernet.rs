//! From datagrams to Ethernet frames, and their time on the wire.

use std::fmt;

use super::domain_layout::LogicalCommand;

/// Nanoseconds of one byte at 100 Mbit/s.
pub const BYTE_NS: u64 = 80;
/// Bytes around the data of a datagram: header and working counter.
pub const DATAGRAM_OVERHEAD_BYTES: usize = 10 + 2;
/// Bytes on the wire around the datagrams of a frame: preamble, Ethernet header, EtherCAT header,
/// frame check sequence, gap to the next frame.
pub const FRAME_OVERHEAD_BYTES: usize = 8 + 14 + FRAME_HEADER_BYTES + 4 + GAP_BYTES;
const FRAME_HEADER_BYTES: usize = 2;
/// Gap between two frames, in bytes.
const GAP_BYTES: usize = 12;
/// Payload of an Ethernet frame: EtherCAT header and datagrams.
const MAX_PAYLOAD_BYTES: usize = 1500;
/// Shorter payloads are filled up to this.
const MIN_PAYLOAD_BYTES: usize = 46;

/// Purpose of a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DatagramUse {
    /// Process data of a slave.
    ProcessData {
        /// Slave index.
        slave: usize,
        /// Command.
        command: LogicalCommand,
    },
    /// Keeps the distributed clocks together.
    Clock,
}

/// `slave 0 LRW` or `clock`
impl fmt::Display for DatagramUse {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ProcessData { slave, command } => write!(f, "slave {slave} {command}"),
            Self::Clock => f.write_str("clock"),
        }
    }
}

/// One datagram of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Datagram {
    /// Purpose.
    pub purpose: DatagramUse,
    /// Bytes of its data.
    pub data_bytes: usize,
}

impl Datagram {
    /// Bytes that it takes in a frame.
    pub fn bytes(&self) -> usize {
        self.data_bytes + DATAGRAM_OVERHEAD_BYTES
    }
}

/// One Ethernet frame of a cycle.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct EthernetFrame {
    /// Its datagrams, in their order.
    pub datagrams: Vec<Datagram>,
}

impl EthernetFrame {
    fn payload_bytes(&self) -> usize {
        FRAME_HEADER_BYTES + self.datagrams.iter().map(Datagram::bytes).sum::<usize>()
    }

    /// Bytes on the wire, from the preamble to the end of the gap after the frame.
    pub fn wire_bytes(&self) -> usize {
        self.payload_bytes().max(MIN_PAYLOAD_BYTES) + FRAME_OVERHEAD_BYTES - FRAME_HEADER_BYTES
    }

    /// Time on the wire in nanoseconds, with the gap.
    pub fn wire_ns(&self) -> u64 {
        self.wire_bytes() as u64 * BYTE_NS
    }

    /// The same up to the frame's last byte, when a slave accepts the data.
    pub(super) fn end_ns(&self) -> u64 {
        (self.wire_bytes() - GAP_BYTES) as u64 * BYTE_NS
    }
}

/// Packs datagrams in their order, as the master does: into the frame before it as long as they
/// fit, into the next one otherwise.
pub(super) fn pack(datagrams: impl Iterator<Item = Datagram>) -> Vec<EthernetFrame> {
    let mut frames: Vec<EthernetFrame> = Vec::new();
    for datagram in datagrams {
        match frames.last_mut() {
            Some(last) if last.payload_bytes() + datagram.bytes() <= MAX_PAYLOAD_BYTES => {
                last.datagrams.push(datagram);
            }
            _ => frames.push(EthernetFrame { datagrams: vec![datagram] }),
        }
    }
    frames
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packed(sizes: &[usize]) -> Vec<usize> {
        let datagram = |&data_bytes| Datagram { purpose: DatagramUse::Clock, data_bytes };
        pack(sizes.iter().map(datagram)).iter().map(EthernetFrame::wire_bytes).collect()
    }

    /// 8 + 14 + 2 + (10 + 1486 + 2) + 4 + 12 = 1538, the longest Ethernet frame with its gap.
    #[test]
    fn largest_datagram_fills_a_frame() {
        assert_eq!(packed(&[1486]), [1538]);
        assert_eq!(packed(&[1486, 4]), [1538, 84]);
        assert_eq!(packed(&[1400, 74]), [1538], "1412 + 86 = 1498");
        assert_eq!(packed(&[1400, 75]), [1412 + 40, 87 + 40]);
    }

    /// 8 + 14 + 46 + 4 + 12 = 84.
    #[test]
    fn short_frame_is_padded() {
        assert_eq!(packed(&[4]), [84]);
        assert_eq!(packed(&[32]), [84], "2 + 44 are 46 already");
        assert_eq!(packed(&[33]), [85]);
        assert!(packed(&[]).is_empty());
    }
}
