//! Results of scheduled frames, as reported by the gateway (manual 10, 13.7).
//!
//! A TX_RESULT reports for each frame whether the gateway accepted it. It has no code for a frame that was
//! late, and does not report whether an accepted frame left at its phase: that holds only while no flag of
//! 0xB000:06 is set, and the flags name neither frame nor channel. Accepted frames therefore wait for a
//! reading of the flags that begins after their phase; if it shows a problem, they count as unknown.

use std::fmt;

use ecan_protocol::image::ResultCode;
use ecan_protocol::mapping::CHANNELS;

use super::diagnostics::{Object, ScheduleDiagnostics};

/// Results of a channel's scheduled frames. Counters only grow, except `open`.
///
/// `scheduled` is the sum of `sent`, `queue_full`, `not_sent`, `withdrawn`, `unknown` and `open`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ScheduleAccount {
    /// Frames that were sent with a schedule.
    pub scheduled: u64,
    /// Frames that the gateway accepted and, by its flags, passed to the CAN controller at their phase
    /// in the Sync0 period after the cycle; for images that come too late see [`SendOptions::schedule`](crate::SendOptions::schedule).
    pub sent: u64,
    /// Frames that found the gateway's schedule full. Needs TX_RESULT.
    pub queue_full: u64,
    /// Frames that the gateway rejected for another reason: bus busy, bus-off, channel not enabled.
    /// Needs TX_RESULT.
    pub not_sent: u64,
    /// Frames that never left the host: discarded, or withdrawn because the cycle ended too late for
    /// their phase.
    pub withdrawn: u64,
    /// Frames without a certain result: the image is unconfirmed or was sent again a period late, no
    /// result arrived, the session was lost, or there is a [`ScheduleFault`].
    pub unknown: u64,
    /// Frames without a result so far, and those that wait for a reading of the flags.
    pub open: u64,
    /// Frames rejected because their cycle had begun too late for the phase; not part of
    /// `scheduled`.
    pub rejected_late: u64,
    /// Frames among `scheduled` whose margin does not suffice, see
    /// [`ScheduleMargin`](crate::ScheduleMargin).
    pub without_margin: u64,
    /// Frames that the application passed with a schedule, sent or rejected.
    pub asked: u64,
    /// Frames that the gateway accepted according to the code of their result.
    pub accepted: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ScheduledFrameState {
    /// Accepted by the gateway; the flags decide.
    Taken,
    Result(ResultCode),
    Withdrawn,
    Unknown,
}

#[derive(Debug, Clone, Copy, Default)]
struct ChannelAccount {
    account: ScheduleAccount,
    /// Accepted frames that the next reading of the flags decides, and those after them. The reading
    /// begins when the former have met their phase.
    ripe: u64,
    young: u64,
}

impl ChannelAccount {
    fn close(&mut self, frames: u64, counter: impl FnOnce(&mut ScheduleAccount) -> &mut u64) {
        self.account.open = self.account.open.saturating_sub(frames);
        *counter(&mut self.account) += frames;
    }

    fn close_accepted_as_unknown(&mut self) {
        let frames = std::mem::take(&mut self.young) + std::mem::take(&mut self.ripe);
        self.close(frames, |account| &mut account.unknown);
    }
}

/// The accounts of one gateway.
#[derive(Debug, Default)]
pub(crate) struct ScheduleAccounts {
    channels: [ChannelAccount; CHANNELS],
    /// A frame was scheduled in this session.
    is_used: bool,
}

impl ScheduleAccounts {
    fn channel(&mut self, channel: u8) -> &mut ChannelAccount {
        &mut self.channels[usize::from(channel) % CHANNELS]
    }

    pub(crate) fn account(&self, channel: u8) -> ScheduleAccount {
        self.channels.get(usize::from(channel)).map(|c| c.account).unwrap_or_default()
    }

    /// A frame is to be scheduled.
    pub(crate) fn count_request(&mut self, channel: u8) {
        self.channel(channel).account.asked += 1;
    }

    pub(crate) fn is_used(&self) -> bool {
        self.is_used
    }

    pub(crate) fn count_scheduled(&mut self, channel: u8, has_margin: bool) {
        self.is_used = true;
        let account = &mut self.channel(channel).account;
        account.scheduled += 1;
        account.open += 1;
        account.without_margin += u64::from(!has_margin);
    }

    pub(crate) fn count_late_rejection(&mut self, channel: u8) {
        self.channel(channel).account.rejected_late += 1;
    }

    pub(crate) fn close_frame(&mut self, channel: u8, state: ScheduledFrameState) {
        let channel = self.channel(channel);
        let is_taken = matches!(
            state,
            ScheduledFrameState::Taken
                | ScheduledFrameState::Result(ResultCode::Ok | ResultCode::Queued)
        );
        channel.account.accepted += u64::from(is_taken);
        match state {
            ScheduledFrameState::Taken | ScheduledFrameState::Result(ResultCode::Queued) => {
                channel.young += 1
            }
            ScheduledFrameState::Result(ResultCode::Ok) => {
                channel.close(1, |account| &mut account.sent)
            }
            ScheduledFrameState::Result(ResultCode::TxFifoFull) => {
                channel.close(1, |account| &mut account.queue_full);
            }
            ScheduledFrameState::Result(_) => channel.close(1, |account| &mut account.not_sent),
            ScheduledFrameState::Withdrawn => channel.close(1, |account| &mut account.withdrawn),
            ScheduledFrameState::Unknown => channel.close(1, |account| &mut account.unknown),
        }
    }

    /// A reading is due: it decides on the frames accepted so far.
    pub(crate) fn ripen(&mut self) {
        for channel in &mut self.channels {
            channel.ripe += std::mem::take(&mut channel.young);
        }
    }

    /// The gateway's diagnostics were read. With `has_results`, results report the frames that found the schedule
    /// full. Returns the flags for which accepted frames are unknown.
    pub(crate) fn record_reading(
        &mut self,
        now: &ScheduleDiagnostics,
        before: Option<&ScheduleDiagnostics>,
        has_results: bool,
    ) -> Option<ScheduleFault> {
        use ScheduleDiagnostics as Flags;
        let of_results = if has_results { 0 } else { Flags::QUEUE_FULL };
        let flags =
            now.flags & (Flags::TX_FAIL | Flags::TIMER_MISS | Flags::LATE_DROP | of_results);
        for (number, channel) in self.channels.iter_mut().enumerate() {
            let drops = |seen: &ScheduleDiagnostics| {
                seen.channels.get(number).map(|c| (c.bus_offs, c.stale_drops))
            };
            let has_moved = before.is_some_and(|before| drops(before) != drops(now));
            if has_moved {
                // The phase of later frames may have been to come when it moved.
                channel.close_accepted_as_unknown();
            }
            let ripe = std::mem::take(&mut channel.ripe);
            if flags != 0 {
                channel.close(ripe, |account| &mut account.unknown);
            } else {
                channel.close(ripe, |account| &mut account.sent);
            }
        }
        (flags != 0).then_some(ScheduleFault::Flagged { flags })
    }

    /// The flags were cleared, cannot be read, or the gateway lost them: frames that waited for a reading stay
    /// unknown.
    pub(crate) fn forget_flags(&mut self) {
        for channel in &mut self.channels {
            channel.close_accepted_as_unknown();
        }
    }

    pub(crate) fn reset(&mut self) {
        self.forget_flags();
        self.is_used = false;
    }
}

/// Reason for which the [`ScheduleAccount`] of a gateway cannot name the results of
/// accepted frames: they count as unknown.
///
/// The text names the flags or the object, and what to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ScheduleFault {
    /// The gateway reports problems without the frame that had them.
    Flagged {
        /// Flags of 0xB000:06, see [`ScheduleDiagnostics`]; they stay until they are cleared.
        flags: u16,
    },
    /// An object that decides on accepted frames cannot be read.
    Unreadable {
        /// Index of the object.
        index: u16,
        /// Subindex of the entry.
        subindex: u8,
    },
}

impl ScheduleFault {
    pub(crate) fn unreadable((index, subindex): Object) -> Self {
        Self::Unreadable { index, subindex }
    }
}

/// Names of the flags in the manual (13.7).
const FLAGS: [(u16, &str); 4] = [
    (ScheduleDiagnostics::LATE_DROP, "SCHED_LATE_DROP"),
    (ScheduleDiagnostics::QUEUE_FULL, "SCHED_QUEUE_FULL"),
    (ScheduleDiagnostics::TX_FAIL, "SCHED_TX_FAIL"),
    (ScheduleDiagnostics::TIMER_MISS, "SCHED_TIMER_MISS"),
];

impl fmt::Display for ScheduleFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Flagged { flags } => {
                f.write_str("0xB000:06 has ")?;
                for (nth, (_, name)) in
                    FLAGS.iter().filter(|(flag, _)| flags & flag != 0).enumerate()
                {
                    write!(f, "{}{name}", if nth > 0 { ", " } else { "" })?;
                }
                f.write_str(
                    ", which names no frame; accepted scheduled frames count as unknown until the flags are cleared; if \
                     a frame is late again, use a larger offset or an earlier cycle (assumption H24: the frames may \
                     count from another pulse)",
                )
            }
            Self::Unreadable { index, subindex } => write!(
                f,
                "0x{index:04X}:{subindex:02} cannot be read (assumption H42: the firmware may lack it); accepted \
                 scheduled frames count as unknown; read the object with `ecan sdo`, update the firmware"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(frames: u64) -> ScheduleAccounts {
        let mut accounts = ScheduleAccounts::default();
        for _ in 0..frames {
            accounts.count_scheduled(1, true);
            accounts.close_frame(1, ScheduledFrameState::Result(ResultCode::Queued));
        }
        accounts
    }

    #[test]
    fn reading_after_their_phase_counts_frames_as_sent() {
        let (mut accounts, clean) = (taken(3), ScheduleDiagnostics::default());
        accounts.record_reading(&clean, None, false);
        assert_eq!(accounts.account(1).open, 3, "its phase may still have been to come");
        accounts.ripen();
        accounts.record_reading(&clean, Some(&clean), false);
        let account = accounts.account(1);
        assert_eq!((account.scheduled, account.sent, account.open), (3, 3, 0));
    }

    #[test]
    fn flag_or_counter_makes_frames_unknown() {
        let clean = ScheduleDiagnostics::default();
        let flagged = ScheduleDiagnostics { flags: 1 << 8, ..clean };
        let mut accounts = taken(2);
        accounts.ripen();
        accounts.record_reading(&flagged, Some(&clean), false);
        assert_eq!((accounts.account(1).unknown, accounts.account(1).open), (2, 0));

        let mut bus_off = clean;
        bus_off.channels[1].bus_offs = 1;
        let mut accounts = taken(2);
        accounts.record_reading(&bus_off, Some(&clean), false);
        let unknown = accounts.account(1).unknown;
        assert_eq!(unknown, 2, "the next reading does not show it any more");
    }

    /// The manual has no code for a late frame (10).
    #[test]
    fn late_flag_makes_accepted_frames_unknown_with_results_too() {
        for (flags, has_results, names) in [
            (0x0040, true, Some("SCHED_LATE_DROP")),
            (0x0040, false, Some("SCHED_LATE_DROP")),
            (0x0080, true, None),
            (
                0x03C0,
                false,
                Some("SCHED_LATE_DROP, SCHED_QUEUE_FULL, SCHED_TX_FAIL, SCHED_TIMER_MISS"),
            ),
        ] {
            let mut accounts = taken(2);
            accounts.ripen();
            let read = ScheduleDiagnostics { flags, ..ScheduleDiagnostics::default() };
            let fault = accounts.record_reading(&read, Some(&read), has_results);
            let account = accounts.account(1);
            let expected = if names.is_some() { (0, 2) } else { (2, 0) };
            assert_eq!((account.sent, account.unknown), expected, "{flags:#x} {has_results}");
            let text = fault.map(|fault| fault.to_string());
            let names = names.map(|names| format!("0xB000:06 has {names}, which names no frame"));
            assert_eq!(text.is_some(), names.is_some());
            assert!(text.unwrap_or_default().starts_with(&names.unwrap_or_default()));
        }
    }

    #[test]
    fn codes_of_rejected_frames_count_at_once() {
        for (code, counts) in [
            (ResultCode::Ok, [1, 0, 0]),
            (ResultCode::TxFifoFull, [0, 1, 0]),
            (ResultCode::BusBusy, [0, 0, 1]),
            (ResultCode::InvalidChannel, [0, 0, 1]),
            (ResultCode::BusOff, [0, 0, 1]),
        ] {
            let mut accounts = ScheduleAccounts::default();
            accounts.count_scheduled(1, true);
            accounts.close_frame(1, ScheduledFrameState::Result(code));
            let account = accounts.account(1);
            assert_eq!([account.sent, account.queue_full, account.not_sent], counts, "{code:?}");
            assert_eq!(account.accepted, counts[0]);
        }
    }

    #[test]
    fn lost_session_closes_accepted_frames() {
        let mut accounts = taken(2);
        accounts.ripen();
        accounts.count_scheduled(1, false);
        accounts.close_frame(1, ScheduledFrameState::Taken);
        accounts.reset();
        let account = accounts.account(1);
        assert_eq!((account.unknown, account.open, account.without_margin), (3, 0, 1));
        assert!(!accounts.is_used());
    }
}
