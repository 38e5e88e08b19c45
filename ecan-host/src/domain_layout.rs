//! How the master packs a slave's process data into datagrams, and what follows from it.

use ecan_protocol::CHUNK_BYTES;

/// Largest process data of one EtherCAT datagram, in bytes.
pub const MAX_DATAGRAM_BYTES: usize = 1486;

/// Largest N of one direction that fits one datagram: 11 * 128 = 1408 bytes.
pub const MAX_PLAIN_MULTIPLIER: u8 = (MAX_DATAGRAM_BYTES / CHUNK_BYTES) as u8;

/// Bytes on the wire for each datagram beside its data: datagram header, working counter, and the
/// share of Ethernet frame, preamble and gap when it fills a frame of its own.
const DATAGRAM_OVERHEAD: usize = 12 + 2 + 18 + 20;

/// Room that a mailbox transfer needs in a cycle beside the process data.
const MAILBOX_BYTES: usize = 512 + DATAGRAM_OVERHEAD;

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

    /// Whether both directions travel in one LRW datagram.
    ///
    /// Only then does an incomplete working counter tell the directions apart: a read counts 1, a
    /// write 2. Otherwise they travel as LWR and LRD, and a sum of 1 may be either.
    pub fn is_single_datagram(&self) -> bool {
        self.rx_bytes + self.tx_bytes <= MAX_DATAGRAM_BYTES
    }

    /// Working counter of a complete exchange, for the release of libethercat: IgH 1.5 counts 3
    /// also where the directions travel apart. For messages; the master's own judgement counts.
    pub fn expected_working_counter(&self, version: (u8, u8)) -> u32 {
        if self.is_single_datagram() || version < (1, 6) { 3 } else { 2 }
    }

    /// Number of datagrams per cycle.
    pub fn datagrams(&self) -> usize {
        if self.is_single_datagram() { 1 } else { 2 }
    }

    /// Bytes on the wire per cycle, frame overhead included.
    pub fn wire_bytes(&self) -> usize {
        self.rx_bytes + self.tx_bytes + self.datagrams() * DATAGRAM_OVERHEAD
    }
}

/// Bytes per cycle that the process data of all slaves and one mailbox transfer need.
pub(crate) fn bytes_with_mailbox(slaves: impl Iterator<Item = DomainLayout>) -> usize {
    slaves.map(|c| c.wire_bytes()).sum::<usize>() + MAILBOX_BYTES
}

/// Bytes that the master lets through in a cycle of `cycle_ns` before it holds mailbox traffic
/// back: about 11.25 bytes per microsecond, 90 % of 100 Mbit/s.
pub(crate) fn bytes_per_cycle(cycle_ns: u32) -> usize {
    (u64::from(cycle_ns) * 1125 / 100_000) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eleven_chunks_are_the_limit() {
        assert_eq!(MAX_PLAIN_MULTIPLIER, 11);
    }

    #[test]
    fn five_chunks_each_way_share_a_datagram_and_six_do_not() {
        assert!(DomainLayout::new(5, 5).is_single_datagram());
        assert!(!DomainLayout::new(6, 6).is_single_datagram());
        assert!(DomainLayout::new(10, 1).is_single_datagram());
        assert_eq!(DomainLayout::new(11, 1).datagrams(), 2);
    }

    #[test]
    fn a_millisecond_carries_11250_bytes() {
        assert_eq!(bytes_per_cycle(1_000_000), 11_250);
    }
}
