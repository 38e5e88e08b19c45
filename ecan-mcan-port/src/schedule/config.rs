//! Configuration of scheduled transmission: plain data.

use ecan_host::ImageTimes;

use crate::transmit::window::DEFAULT_DEPTH;

/// Treatment of a frame whose margin does not suffice for its phase.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum MarginCheck {
    /// It is sent all the same and counted in
    /// [`ScheduleAccount::without_margin`](crate::ScheduleAccount::without_margin).
    #[default]
    Count,
    /// It is rejected with [`NotSchedulable::NoMargin`](crate::NotSchedulable::NoMargin).
    Reject,
}

/// Scheduled transmission of one gateway: times from which margins are calculated, and reading of
/// the diagnostics (manual 8.4, 13.8, 13.9).
///
/// The manual gives no times; docs/ASSUMPTIONS.md states where the defaults come from. Measure better
/// ones on the machine with `mcan_gateway_tx_probe --sweep`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ScheduleConfig {
    /// Latest time after the cycle's deadline at which the application ends its cycle, in
    /// nanoseconds: wake-up delay and run time.
    pub latest_send_ns: u32,
    /// Time of an image through host and network card, in nanoseconds, without its time on the wire.
    pub transport_ns: u32,
    /// Time of the firmware from the arrival of an image until its frames wait for their phase, in
    /// nanoseconds.
    pub processing_ns: u32,
    /// Treatment of a frame without margin.
    pub margin_check: MarginCheck,
    /// Interval in milliseconds at which the gateway's diagnostics are read after the first
    /// scheduled frame; 0 never reads them, and accepted and late frames stay open. A reading takes 2 SDO transfers and 2 for each channel,
    /// in parallel with the cycle, and begins two Sync0 periods and a cycle after the frames that it
    /// decides. The next one waits at least as long as a reading takes.
    pub watch_ms: u32,
    /// Discards an unconfirmed image that holds only scheduled frames when the Sync0 pulse of its
    /// cycle has passed: repeating it could only send them a period late.
    ///
    /// An image with frames to be sent at once is repeated in any case, because they must not be
    /// lost. Its scheduled frames may then leave a period late, and count as unknown unless a result
    /// reports that they were dropped.
    pub discard_missed: bool,
    /// Scheduled frames that the gateway holds; the plan warns of more at one Sync0 pulse.
    pub depth: u16,
}

impl Default for ScheduleConfig {
    /// 100 us until the send, 30 us through the host, 50 us in the firmware; frames without margin
    /// are counted; the diagnostics are read every 100 ms; missed images are discarded; 64 frames.
    fn default() -> Self {
        let ImageTimes { latest_send_ns, transport_ns, processing_ns } = ImageTimes::default();
        Self {
            latest_send_ns,
            transport_ns,
            processing_ns,
            margin_check: MarginCheck::Count,
            watch_ms: 100,
            discard_missed: true,
            depth: DEFAULT_DEPTH,
        }
    }
}

impl ScheduleConfig {
    /// Its times, for the plan of the EtherCAT side.
    #[must_use]
    pub fn image_times(&self) -> ImageTimes {
        let Self { latest_send_ns, transport_ns, processing_ns, .. } = *self;
        ImageTimes { latest_send_ns, transport_ns, processing_ns }
    }
}
