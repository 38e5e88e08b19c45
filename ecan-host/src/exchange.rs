//! The exchange of process data in a cycle: phase, result for each slave, errors, and the datagrams and Ethernet
//! frames that carry it.

use std::fmt;

use ecan_protocol::mapping::CHUNK_BYTES;
use ecrt_sys::Errno;
use thiserror::Error;

use crate::master::{DomainState, WcState};

/// Errors inside the cycle: small, `Copy`, without allocation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CycleError {
    /// A call of the master library failed.
    #[error("{call}{} failed in the cycle: {errno}", Of(*slave))]
    Library {
        /// Name of the library function.
        call: &'static str,
        /// Slave index, if the call concerns one slave.
        slave: Option<usize>,
        /// Error number of the system.
        errno: Errno,
    },
    /// The Adapter is not active, so that there is no cycle.
    #[error(
        "the bus is {is}, not active; {}",
        if *is == Phase::Down {
            "the last reconfiguration failed: call reconfigure again"
        } else {
            "call activate first"
        }
    )]
    NotActive {
        /// Current phase.
        is: Phase,
    },
}

impl CycleError {
    /// Returns whether a later cycle can succeed without a change by the application: a call of the master
    /// library failed, on a bus that may recover.
    pub fn is_temporary(&self) -> bool {
        matches!(self, Self::Library { .. })
    }

    pub(crate) fn library(call: &'static str) -> impl Fn(Errno) -> Self {
        move |errno| Self::Library { call, slave: None, errno }
    }

    pub(crate) fn of_slave(call: &'static str, slave: usize) -> impl Fn(Errno) -> Self {
        move |errno| Self::Library { call, slave: Some(slave), errno }
    }
}

struct Of(Option<usize>);

impl std::fmt::Display for Of {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.map_or(Ok(()), |slave| write!(f, " of slave {slave}"))
    }
}

ecan_protocol::text_enum! {
    /// Phase of an [`Adapter`](crate::Adapter).
    pub enum Phase;
    /// Nothing is configured, because a reconfiguration failed. Call
    /// [`Adapter::reconfigure`](crate::Adapter::reconfigure) again, or drop the Adapter.
    Down = "down";
    /// Slaves, domains and startup SDOs are configured; requests can be created.
    Configured = "configured";
    /// The master runs cyclically; the process data exist.
    Active = "active";
}

/// Delivery of one direction in the last exchange, by the working counter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Delivery {
    /// No exchange yet.
    #[default]
    None,
    /// The image was delivered.
    Confirmed,
    /// The image was not delivered.
    Missed,
    /// Unknown: with LWR and LRD a sum of 1 may be either direction; unknown also after an error
    /// of the library.
    Unknown,
}

/// Result of the last exchange with one slave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DomainReport {
    /// Working counter of the slave's domain.
    pub working_counter: u32,
    /// Working counter of a complete exchange.
    pub expected_working_counter: u32,
    /// The master's evaluation, which decides.
    pub wc_state: WcState,
    /// Delivery of the RxPDO image.
    pub outputs: Delivery,
    /// Delivery of the TxPDO image.
    pub inputs: Delivery,
}

impl Default for DomainReport {
    fn default() -> Self {
        Self {
            working_counter: 0,
            expected_working_counter: 0,
            wc_state: WcState::Zero,
            outputs: Delivery::None,
            inputs: Delivery::None,
        }
    }
}

impl DomainReport {
    /// Returns whether both directions were exchanged. Motion waits for this in every cycle (manual
    /// 15.5.2, step 8).
    pub fn is_complete(&self) -> bool {
        self.wc_state == WcState::Complete
    }

    /// Returns whether more than one slave took part in the exchange: another one has the same process
    /// data.
    pub fn is_shared(&self) -> bool {
        self.wc_state == WcState::Incomplete && self.working_counter > self.expected_working_counter
    }

    /// Records that nothing is known of an exchange.
    #[inline]
    pub(crate) fn clear(&mut self) {
        let expected_working_counter = self.expected_working_counter;
        let (outputs, inputs) = (Delivery::Unknown, Delivery::Unknown);
        *self = Self { expected_working_counter, outputs, inputs, ..Self::default() };
    }

    /// Records the working counter of an exchange.
    #[inline]
    pub(crate) fn record(&mut self, layout: DomainLayout, state: DomainState) {
        self.working_counter = state.working_counter;
        self.wc_state = state.wc_state;
        let seen = |counted: bool| if counted { Delivery::Confirmed } else { Delivery::Missed };
        (self.outputs, self.inputs) = match state.wc_state {
            WcState::Complete => (Delivery::Confirmed, Delivery::Confirmed),
            WcState::Zero => (Delivery::Missed, Delivery::Missed),
            // Another slave has the same process data: the images are a mixture.
            WcState::Incomplete if self.is_shared() => (Delivery::Unknown, Delivery::Unknown),
            // In a single LRW a read counts 1 and a write 2, each on its own.
            WcState::Incomplete if layout.is_single_datagram() => {
                (seen(state.working_counter & 2 != 0), seen(state.working_counter & 1 != 0))
            }
            WcState::Incomplete => (Delivery::Unknown, Delivery::Unknown),
        };
    }
}

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
    fn working_counter_shows_what_was_delivered() {
        use Delivery::{Confirmed, Missed, Unknown};
        let cases = [
            (WcState::Complete, 3, (Confirmed, Confirmed), (Confirmed, Confirmed), false),
            (WcState::Zero, 0, (Missed, Missed), (Missed, Missed), false),
            (WcState::Incomplete, 1, (Missed, Confirmed), (Unknown, Unknown), false),
            (WcState::Incomplete, 2, (Confirmed, Missed), (Unknown, Unknown), false),
            (WcState::Incomplete, 6, (Unknown, Unknown), (Unknown, Unknown), true),
        ];
        for (wc_state, working_counter, one_datagram, two_datagrams, is_shared) in cases {
            for (chunks, expected) in [(5, one_datagram), (6, two_datagrams)] {
                let mut report =
                    DomainReport { expected_working_counter: 3, ..DomainReport::default() };
                let state = DomainState { working_counter, wc_state, redundancy_active: false };
                report.record(DomainLayout::new(chunks, chunks), state);
                assert_eq!((report.outputs, report.inputs), expected, "{wc_state:?} {chunks}");
                assert_eq!(report.is_shared(), is_shared, "{wc_state:?} {chunks}");
                report.clear();
                assert_eq!((report.outputs, report.inputs), (Unknown, Unknown));
                assert_eq!((report.working_counter, report.expected_working_counter), (0, 3));
            }
        }
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
