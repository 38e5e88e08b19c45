//! Process data of the slaves as datagrams and Ethernet frames, and their time on the wire.

use std::fmt;

use ecan_protocol::mapping::CHUNK_BYTES;

/// Largest process data of one EtherCAT datagram, in bytes.
pub const MAX_DATAGRAM_BYTES: usize = 1486;

/// Largest N of one direction that fits one datagram: 11 * 128 = 1408 bytes.
pub const MAX_PLAIN_MULTIPLIER: u8 = (MAX_DATAGRAM_BYTES / CHUNK_BYTES) as u8;

ecan_protocol::text_enum! {
    /// Command of a datagram with the process data of a slave.
    pub enum LogicalCommand;
    /// Writes the RxPDO and reads the TxPDO.
    ReadWrite = "LRW";
    /// Writes the RxPDO.
    Write = "LWR";
    /// Reads the TxPDO.
    Read = "LRD";
}

/// Layout of one gateway's domain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DomainLayout {
    /// Bytes of the RxPDO.
    pub rx_bytes: usize,
    /// Bytes of the TxPDO.
    pub tx_bytes: usize,
}

impl DomainLayout {
    /// The domain of a gateway with these N.
    pub fn new(rx_multiplier: u8, tx_multiplier: u8) -> Self {
        Self {
            rx_bytes: usize::from(rx_multiplier) * CHUNK_BYTES,
            tx_bytes: usize::from(tx_multiplier) * CHUNK_BYTES,
        }
    }

    /// Returns whether both directions travel in one LRW datagram.
    ///
    /// Only then does an incomplete working counter distinguish the directions: a read counts 1, a
    /// write 2. Otherwise they travel as LWR and LRD, and a sum of 1 may be either.
    pub fn is_single_datagram(&self) -> bool {
        self.rx_bytes + self.tx_bytes <= MAX_DATAGRAM_BYTES
    }

    /// Working counter of a complete exchange, for the release of libethercat: IgH 1.5 counts 3
    /// also where the directions travel apart. For messages; the master's own judgement counts.
    pub fn expected_working_counter(&self, version: (u8, u8)) -> u32 {
        if self.is_single_datagram() || version < (1, 6) { 3 } else { 2 }
    }

    /// The datagrams of a cycle in their order, with the bytes of data of each. A direction that
    /// exceeds one datagram (N of 12 and more) is taken as a segmenting master would send it. The
    /// 1.5 release sends LRW instead of LWR; sizes are the same.
    pub fn datagrams(&self) -> impl Iterator<Item = (LogicalCommand, usize)> + use<> {
        let Self { rx_bytes, tx_bytes } = *self;
        let parts = if self.is_single_datagram() {
            [(LogicalCommand::ReadWrite, rx_bytes + tx_bytes), (LogicalCommand::Read, 0)]
        } else {
            [(LogicalCommand::Write, rx_bytes), (LogicalCommand::Read, tx_bytes)]
        };
        parts.into_iter().flat_map(|(command, bytes)| {
            (0..bytes)
                .step_by(MAX_DATAGRAM_BYTES)
                .map(move |start| (command, (bytes - start).min(MAX_DATAGRAM_BYTES)))
        })
    }
}

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
    /// Datagrams of the frame, in their order.
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

    /// Time on the wire up to the last byte of the frame, when a slave accepts the data.
    pub(crate) fn end_ns(&self) -> u64 {
        (self.wire_bytes() - GAP_BYTES) as u64 * BYTE_NS
    }
}

/// Packs datagrams in their order, as the master does: into the frame before it as long as they
/// fit, into the next one otherwise.
pub(crate) fn pack(datagrams: impl Iterator<Item = Datagram>) -> Vec<EthernetFrame> {
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

    fn datagrams(rx: u8, tx: u8) -> Vec<(LogicalCommand, usize)> {
        DomainLayout::new(rx, tx).datagrams().collect()
    }

    #[test]
    fn eleven_chunks_are_the_limit() {
        assert_eq!(MAX_PLAIN_MULTIPLIER, 11);
    }

    #[test]
    fn five_chunks_per_direction_share_a_datagram_and_six_do_not() {
        use LogicalCommand::{Read, ReadWrite, Write};
        assert!(DomainLayout::new(5, 5).is_single_datagram());
        assert_eq!(datagrams(5, 5), [(ReadWrite, 1280)]);
        assert!(!DomainLayout::new(6, 6).is_single_datagram());
        assert_eq!(datagrams(6, 6), [(Write, 768), (Read, 768)]);
        assert!(DomainLayout::new(10, 1).is_single_datagram());
        assert_eq!(datagrams(11, 1), [(Write, 1408), (Read, 128)]);
    }

    #[test]
    fn segmenting_master_splits_large_data() {
        use LogicalCommand::{Read, Write};
        assert_eq!(datagrams(12, 1), [(Write, 1486), (Write, 50), (Read, 128)]);
        assert_eq!(datagrams(0, 0), []);
    }

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
