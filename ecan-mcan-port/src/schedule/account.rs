//! Results of scheduled frames, as reported by the gateway (manual 10, 13.7).
//!
//! A TX_RESULT reports for each frame whether the gateway accepted it. It does not report whether an
//! accepted frame left at its phase: that holds only while no flag of 0xB000:06 is set, and the flags
//! name neither frame nor channel. Accepted frames therefore wait for a reading of the flags that
//! begins after their phase; if it shows a problem, they count as unknown.

use ecan_protocol::image::ResultCode;
use ecan_protocol::mapping::CHANNELS;

use crate::schedule::diagnostics::ScheduleDiagnostics;

/// Results of a channel's scheduled frames. Counters only grow, except `open`.
///
/// `scheduled` is the sum of `sent`, `late_dropped`, `queue_full`, `not_sent`, `withdrawn`,
/// `unknown` and `open`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ScheduleAccount {
    /// Frames that were sent with a schedule.
    pub scheduled: u64,
    /// Frames that the gateway accepted and, by its flags, passed to the CAN controller at their phase
    /// in the Sync0 period after the cycle; for images that come too late see [`SendOptions::schedule`](crate::SendOptions::schedule).
    pub sent: u64,
    /// Frames that the gateway dropped because their phase had passed. Needs TX_RESULT.
    pub late_dropped: u64,
    /// Frames that found the gateway's schedule full. Needs TX_RESULT.
    pub queue_full: u64,
    /// Frames that the gateway rejected for another reason: bus-off, channel not enabled.
    /// Needs TX_RESULT.
    pub not_sent: u64,
    /// Frames that never left the host: discarded, or withdrawn because the cycle ended too late for
    /// their phase.
    pub withdrawn: u64,
    /// Frames without a certain result: the image is unconfirmed or was sent again a period late, no
    /// result arrived, the session was lost, or flags were set.
    pub unknown: u64,
    /// Frames without a result so far.
    pub open: u64,
    /// Frames rejected because their cycle had begun too late for the phase; not part of
    /// `scheduled`.
    pub rejected_late: u64,
    /// Frames among `scheduled` whose margin does not suffice, see
    /// [`ScheduleMargin`](crate::ScheduleMargin).
    pub without_margin: u64,
    /// Frames that the application passed with a schedule, sent or rejected.
    pub asked: u64,
    /// Frames that the gateway accepted, with any result.
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
    pub(crate) fn asked(&mut self, channel: u8) {
        self.channel(channel).account.asked += 1;
    }

    pub(crate) fn is_used(&self) -> bool {
        self.is_used
    }

    pub(crate) fn scheduled(&mut self, channel: u8, has_margin: bool) {
        self.is_used = true;
        let account = &mut self.channel(channel).account;
        account.scheduled += 1;
        account.open += 1;
        account.without_margin += u64::from(!has_margin);
    }

    pub(crate) fn rejected_late(&mut self, channel: u8) {
        self.channel(channel).account.rejected_late += 1;
    }

    pub(crate) fn ended(&mut self, channel: u8, state: ScheduledFrameState) {
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
            ScheduledFrameState::Result(ResultCode::BusBusy) => {
                channel.close(1, |account| &mut account.late_dropped);
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

    /// The gateway's diagnostics were read. `relevant` are the flags that may concern frames without a
    /// result.
    pub(crate) fn looked(
        &mut self,
        now: &ScheduleDiagnostics,
        before: Option<&ScheduleDiagnostics>,
        relevant: u16,
    ) {
        let has_problem = now.flags & relevant != 0;
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
            if has_problem {
                channel.close(ripe, |account| &mut account.unknown);
            } else {
                channel.close(ripe, |account| &mut account.sent);
            }
        }
    }

    /// The flags were cleared, or the gateway lost them.
    pub(crate) fn flags_lost(&mut self) {
        for channel in &mut self.channels {
            channel.close_accepted_as_unknown();
        }
    }

    pub(crate) fn reset(&mut self) {
        self.flags_lost();
        self.is_used = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(frames: u64) -> ScheduleAccounts {
        let mut accounts = ScheduleAccounts::default();
        for _ in 0..frames {
            accounts.scheduled(1, true);
            accounts.ended(1, ScheduledFrameState::Result(ResultCode::Queued));
        }
        accounts
    }

    #[test]
    fn reading_after_their_phase_counts_frames_as_sent() {
        let (mut accounts, clean) = (taken(3), ScheduleDiagnostics::default());
        accounts.looked(&clean, None, 0x3C0);
        assert_eq!(accounts.account(1).open, 3, "its phase may still have been to come");
        accounts.ripen();
        accounts.looked(&clean, Some(&clean), 0x3C0);
        let account = accounts.account(1);
        assert_eq!((account.scheduled, account.sent, account.open), (3, 3, 0));
    }

    #[test]
    fn flag_or_counter_makes_frames_unknown() {
        let clean = ScheduleDiagnostics::default();
        let flagged = ScheduleDiagnostics { flags: 1 << 8, ..clean };
        let mut accounts = taken(2);
        accounts.ripen();
        accounts.looked(&flagged, Some(&clean), 0x3C0);
        assert_eq!((accounts.account(1).unknown, accounts.account(1).open), (2, 0));

        let mut bus_off = clean;
        bus_off.channels[1].bus_offs = 1;
        let mut accounts = taken(2);
        accounts.looked(&bus_off, Some(&clean), 0x3C0);
        let unknown = accounts.account(1).unknown;
        assert_eq!(unknown, 2, "the next reading does not show it any more");

        let mut accounts = taken(2);
        accounts.ripen();
        let late = ScheduleDiagnostics { flags: 1 << 6, ..clean };
        accounts.looked(&late, Some(&clean), 0x300);
        assert_eq!(accounts.account(1).sent, 2, "results tell of late frames, one by one");
    }

    #[test]
    fn lost_session_closes_accepted_frames() {
        let mut accounts = taken(2);
        accounts.ripen();
        accounts.scheduled(1, false);
        accounts.ended(1, ScheduledFrameState::Taken);
        accounts.reset();
        let account = accounts.account(1);
        assert_eq!((account.unknown, account.open, account.without_margin), (3, 0, 1));
        assert!(!accounts.is_used());
    }
}
