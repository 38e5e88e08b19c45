//! Layout of a slave's process data in datagrams.

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
}
