//! Reports on the exchange with one gateway in a cycle.

use ecan_host::DomainReport;
use ecan_protocol::image::ParseDiagnosis;
use ecan_protocol::mapping::CHANNELS;

/// Result of checking the TxPDO image of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ImageReport {
    /// The gateway is not ready.
    #[default]
    None,
    /// A new image.
    New {
        /// Images that were lost before it, by the sequence.
        lost: u16,
        /// The gateway marked it as incomplete (truncated or overflowed, manual 6.1).
        is_incomplete: bool,
        /// Its layout is not the configured one: its frames may be misread.
        layout_changed: bool,
    },
    /// The image of an earlier cycle again: nothing new arrived.
    Repeated,
    /// An image that cannot be used, or only up to the fault.
    Fault(ParseDiagnosis),
}

/// One cycle with one gateway.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CycleReport {
    /// The working counter and its meaning.
    pub domain: DomainReport,
    /// The TxPDO image.
    pub image: ImageReport,
    /// The delivery of the last RxPDO image is not confirmed, and it is sent again unchanged. Frames
    /// sent now wait for the next image.
    pub is_unconfirmed: bool,
    /// Number of the cycle, from 1, over all reconfigurations of the Port. An observer that finds
    /// a gap has not seen every cycle.
    pub cycle: u64,
    /// Cycle in which the gateway became ready the last time; 0 if it never was. A change means
    /// that it was not ready in between.
    pub ready_since: u64,
    /// Frames of each channel that were taken out of the TxPDO image of this cycle, by any part of
    /// the application.
    pub frames: [u8; CHANNELS],
}
