//! What the Port is told about scheduled transmission: plain data.

/// What happens to a frame whose phase the margin does not surely reach.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MarginCheck {
    /// It is sent all the same and counted in
    /// [`ScheduleAccount::without_margin`](crate::ScheduleAccount::without_margin).
    #[default]
    Count,
    /// It is rejected with [`NotSchedulable::NoMargin`](crate::NotSchedulable::NoMargin).
    Reject,
}

/// Scheduled transmission of one gateway: the times that the margin is reckoned with, and how its
/// diagnostics are read (manual 8.4, 13.8, 13.9).
///
/// The manual gives no times; docs/ASSUMPTIONS.md says where these come from. A sweep on the
/// machine itself ([`PhaseSweep`](crate::PhaseSweep)) tells better ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScheduleConfig {
    /// Latest time behind the point of the cycle grid at which the application ends its cycle, in
    /// nanoseconds: delay of waking up and run time.
    pub latest_send_ns: u32,
    /// Way of a process image through host and network card, in nanoseconds, beside its time on
    /// the wire.
    pub transport_ns: u32,
    /// What the firmware needs from the arrival of an image until its frames wait for their phase,
    /// in nanoseconds.
    pub processing_ns: u32,
    /// What happens to a frame without margin.
    pub margin_check: MarginCheck,
    /// Interval in milliseconds at which the gateway's diagnostics are read, once a frame has been
    /// scheduled; 0 never reads them. Each look takes up to 17 SDO transfers, which run beside the
    /// cycle; the next one begins two Sync0 periods and a cycle after it at the earliest.
    pub watch_ms: u32,
    /// Whether an image that holds nothing but scheduled frames is given up when it may not have
    /// arrived and the Sync0 pulse of its cycle has passed: published again it could only send them
    /// a period late.
    ///
    /// An image that also holds frames to be sent at once is published again in any case, as those
    /// must not be lost. Its scheduled frames may then leave a period late, and count as unknown
    /// unless a result tells that they were dropped.
    pub give_up_missed: bool,
}

impl Default for ScheduleConfig {
    /// 100 us until the send, 30 us through the host, 50 us in the firmware; frames without margin
    /// are counted; the diagnostics are read every 100 ms; missed images are given up.
    fn default() -> Self {
        Self {
            latest_send_ns: 100_000,
            transport_ns: 30_000,
            processing_ns: 50_000,
            margin_check: MarginCheck::Count,
            watch_ms: 100,
            give_up_missed: true,
        }
    }
}
