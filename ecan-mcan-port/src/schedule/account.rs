//! Results of scheduled frames, as reported by the gateway (manual 10, 13.7).
//!
//! A TX_RESULT reports for each frame whether the gateway accepted it. It does not report whether an
//! accepted frame left at its phase: that holds only while no flag of 0xB000:06 is set, and the flags
//! name neither frame nor channel. Accepted frames therefore wait for a reading of the flags that
//! begins after their phase; if it shows a problem, they count as unknown. The readings also verify the
//! codes of the results: until then, late frames wait for a reading as well.

use std::fmt;

use ecan_protocol::image::{ChannelStatus, ResultCode};
use ecan_protocol::mapping::CHANNELS;

use super::result_codes::{
    CodeDecision, Object, ResultCodeCheck, ResultCodes, ScheduleDiagnostics,
};

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
    /// Frames that the gateway dropped because their phase had passed. Needs TX_RESULT, whose codes a
    /// reading has verified.
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
    /// result arrived, the session was lost, flags were set, or there is a
    /// [`ScheduleFault`].
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
    /// Frames that the gateway dropped as late according to the code of their result, verified or not.
    pub reported_late: u64,
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
    /// Frames reported as late that wait for the reading that has begun, and those for the next.
    late_ripe: u64,
    late_young: u64,
    /// Frames that the last image reported as accepted and as late.
    in_image: (u8, u8),
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

    /// The decision on frames that were reported as late.
    fn decide_late(&mut self, decision: CodeDecision) {
        match decision {
            CodeDecision::Verified => {
                let late =
                    std::mem::take(&mut self.late_ripe) + std::mem::take(&mut self.late_young);
                self.close(late, |account| &mut account.late_dropped);
            }
            CodeDecision::Uncertain | CodeDecision::NoneLate => {
                let late = std::mem::take(&mut self.late_ripe);
                self.close(late, |account| &mut account.unknown);
            }
            CodeDecision::Wait => {}
        }
    }

    fn close_waiting_as_unknown(&mut self) {
        self.close_accepted_as_unknown();
        let late = std::mem::take(&mut self.late_young) + std::mem::take(&mut self.late_ripe);
        self.close(late, |account| &mut account.unknown);
    }
}

/// The accounts of one gateway.
#[derive(Debug, Default)]
pub(crate) struct ScheduleAccounts {
    channels: [ChannelAccount; CHANNELS],
    codes: ResultCodeCheck,
    /// The last reading left results unknown whose codes were not verified.
    is_uncertain: bool,
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

    pub(crate) fn codes(&self) -> ResultCodes {
        self.codes.state()
    }

    /// The last reading found late drops before the codes were verified.
    pub(crate) fn is_uncertain(&self) -> bool {
        self.is_uncertain
    }

    pub(crate) fn close_frame(&mut self, channel: u8, state: ScheduledFrameState) {
        match state {
            ScheduledFrameState::Result(ResultCode::Queued) => self.codes.record_accepted(),
            ScheduledFrameState::Result(ResultCode::BusBusy) => self.codes.late(),
            ScheduledFrameState::Unknown => self.codes.missing(),
            _ => {}
        }
        let codes = self.codes.state();
        let channel = self.channel(channel);
        let is_taken = matches!(
            state,
            ScheduledFrameState::Taken
                | ScheduledFrameState::Result(ResultCode::Ok | ResultCode::Queued)
        );
        channel.account.accepted += u64::from(is_taken);
        let is_late = state == ScheduledFrameState::Result(ResultCode::BusBusy);
        channel.account.reported_late += u64::from(is_late);
        let is_queued = state == ScheduledFrameState::Result(ResultCode::Queued);
        let (accepted, late) = &mut channel.in_image;
        *accepted = accepted.saturating_add(u8::from(is_queued));
        *late = late.saturating_add(u8::from(is_late));
        match state {
            ScheduledFrameState::Result(ResultCode::Queued | ResultCode::BusBusy)
                if codes == ResultCodes::Contradicted =>
            {
                channel.close(1, |account| &mut account.unknown)
            }
            ScheduledFrameState::Taken | ScheduledFrameState::Result(ResultCode::Queued) => {
                channel.young += 1
            }
            ScheduledFrameState::Result(ResultCode::Ok) => {
                channel.close(1, |account| &mut account.sent)
            }
            ScheduledFrameState::Result(ResultCode::BusBusy) if codes == ResultCodes::Verified => {
                channel.close(1, |account| &mut account.late_dropped);
            }
            ScheduledFrameState::Result(ResultCode::BusBusy) => channel.late_young += 1,
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

    /// All results of an image were taken; `status` is that of the same image.
    pub(crate) fn record_status(&mut self, status: &[ChannelStatus; CHANNELS]) {
        for (channel, status) in self.channels.iter_mut().zip(status) {
            let (accepted, late) = std::mem::take(&mut channel.in_image);
            self.codes.image(accepted, late, status.tx_pending());
        }
    }

    /// The flags are about to be read.
    pub(crate) fn begin_reading(&mut self) {
        self.codes.begin_reading();
        for channel in &mut self.channels {
            channel.late_ripe += std::mem::take(&mut channel.late_young);
        }
    }

    /// The gateway's diagnostics were read. With `has_results`, results report late frames and those
    /// that found the schedule full.
    pub(crate) fn record_reading(
        &mut self,
        now: &ScheduleDiagnostics,
        before: Option<&ScheduleDiagnostics>,
        has_results: bool,
    ) {
        use ScheduleDiagnostics as Flags;
        let of_results = Flags::LATE_DROP | Flags::QUEUE_FULL;
        let relevant =
            Flags::TX_FAIL | Flags::TIMER_MISS | if has_results { 0 } else { of_results };
        let has_problem = now.flags & relevant != 0;
        let is_late_flagged = now.flags & Flags::LATE_DROP != 0;
        let decision = match has_results {
            true => self.codes.read(is_late_flagged),
            false => CodeDecision::Verified,
        };
        self.is_uncertain = is_late_flagged && decision == CodeDecision::Uncertain;
        for (number, channel) in self.channels.iter_mut().enumerate() {
            let drops = |seen: &ScheduleDiagnostics| {
                seen.channels.get(number).map(|c| (c.bus_offs, c.stale_drops))
            };
            let has_moved = before.is_some_and(|before| drops(before) != drops(now));
            if has_moved {
                // The phase of later frames may have been to come when it moved.
                channel.close_accepted_as_unknown();
            }
            channel.decide_late(decision);
            if decision == CodeDecision::Wait {
                continue;
            }
            let ripe = std::mem::take(&mut channel.ripe);
            if has_problem || decision == CodeDecision::Uncertain {
                channel.close(ripe, |account| &mut account.unknown);
            } else {
                channel.close(ripe, |account| &mut account.sent);
            }
        }
        if self.codes.state() == ResultCodes::Contradicted {
            self.close_waiting_as_unknown();
        }
    }

    fn close_waiting_as_unknown(&mut self) {
        for channel in &mut self.channels {
            channel.close_waiting_as_unknown();
        }
    }

    /// The flags cannot be read: frames that waited for a reading stay unknown.
    pub(crate) fn mark_unreadable(&mut self) {
        self.close_waiting_as_unknown();
    }

    /// The flags were cleared, or the gateway lost them.
    pub(crate) fn forget_flags(&mut self) {
        self.close_waiting_as_unknown();
        self.codes.on_flags_cleared();
        self.is_uncertain = false;
    }

    pub(crate) fn reset(&mut self) {
        self.forget_flags();
        self.is_used = false;
    }
}

/// Reason for which the [`ScheduleAccount`] of a gateway cannot name the results of
/// accepted frames: they count as unknown.
///
/// The text names the row of docs/ASSUMPTIONS.md that does not hold and what to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ScheduleFault {
    /// The codes 1 and 2 of TX_RESULT contradict the flag SCHED_LATE_DROP of 0xB000:06.
    CodesContradicted,
    /// SCHED_LATE_DROP was set before a reading could verify the codes of TX_RESULT.
    CodesUnverified,
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

impl fmt::Display for ScheduleFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::CodesContradicted => f.write_str(
                "TX_RESULT codes 1 and 2 of scheduled frames contradict the flag SCHED_LATE_DROP (0xB000:06 bit 6), \
                 assumption H23; the frames count as unknown; disable TX_RESULT: then the flags alone decide",
            ),
            Self::CodesUnverified => f.write_str(
                "SCHED_LATE_DROP (0xB000:06 bit 6) was set before the TX_RESULT codes of scheduled frames were \
                 verified (assumption H23, or assumption H24: the frames may count from another pulse); the frames count as \
                 unknown; clear the flags, or disable TX_RESULT: then the flags alone decide",
            ),
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

    /// A reading of the flags with results.
    fn read(accounts: &mut ScheduleAccounts, flags: u16) {
        accounts.ripen();
        accounts.begin_reading();
        let read = ScheduleDiagnostics { flags, ..ScheduleDiagnostics::default() };
        accounts.record_reading(&read, Some(&read), true);
    }

    fn late(accounts: &mut ScheduleAccounts, frames: u64) {
        for _ in 0..frames {
            accounts.count_scheduled(1, true);
            accounts.close_frame(1, ScheduledFrameState::Result(ResultCode::BusBusy));
        }
    }

    #[test]
    fn late_frames_wait_for_the_reading_that_verifies_the_codes() {
        let mut accounts = taken(3);
        read(&mut accounts, 0);
        late(&mut accounts, 2);
        assert_eq!((accounts.account(1).open, accounts.account(1).late_dropped), (2, 0));
        read(&mut accounts, ScheduleDiagnostics::LATE_DROP);
        late(&mut accounts, 1);
        let account = accounts.account(1);
        assert_eq!((account.sent, account.late_dropped, account.open), (3, 3, 0));
        assert_eq!(accounts.codes(), ResultCodes::Verified);
    }

    #[test]
    fn contradicted_codes_leave_frames_unknown() {
        let mut swapped = ScheduleAccounts::default();
        for _ in 0..2 {
            late(&mut swapped, 2);
            read(&mut swapped, 0);
        }
        late(&mut swapped, 1);
        let account = swapped.account(1);
        assert_eq!((account.unknown, account.late_dropped, account.open), (5, 0, 0));
        assert_eq!(swapped.codes(), ResultCodes::Contradicted);

        let mut both_queued = taken(2);
        read(&mut both_queued, 0);
        both_queued.count_scheduled(1, true);
        both_queued.close_frame(1, ScheduledFrameState::Result(ResultCode::Queued));
        read(&mut both_queued, ScheduleDiagnostics::LATE_DROP);
        assert_eq!(both_queued.account(1).open, 1, "the result of the late one may come");
        read(&mut both_queued, ScheduleDiagnostics::LATE_DROP);
        let account = both_queued.account(1);
        assert_eq!((account.sent, account.unknown, account.open), (2, 1, 0));
        both_queued.forget_flags();
        assert_eq!(both_queued.codes(), ResultCodes::Unverified, "another chance");
    }

    /// The flag was set before the first frame.
    #[test]
    fn waiting_frames_verify_the_codes() {
        let codes_after = |of_accepted: u8, of_late: u8| {
            let mut accounts = ScheduleAccounts::default();
            let end_image = |accounts: &mut ScheduleAccounts, waiting| {
                let status = ChannelStatus::default().with_tx_pending(waiting);
                accounts.record_status(&[ChannelStatus::default(), status, status, status]);
            };
            for _ in 0..3 {
                accounts.count_scheduled(1, true);
                accounts.close_frame(1, ScheduledFrameState::Result(ResultCode::Queued));
                end_image(&mut accounts, of_accepted);
                late(&mut accounts, 1);
                end_image(&mut accounts, of_late);
                // A frame that found the schedule full shows nothing.
                accounts.count_scheduled(1, true);
                accounts.close_frame(1, ScheduledFrameState::Result(ResultCode::TxFifoFull));
                end_image(&mut accounts, 0);
            }
            read(&mut accounts, ScheduleDiagnostics::LATE_DROP);
            accounts.codes()
        };
        assert_eq!(codes_after(1, 0), ResultCodes::Verified);
        assert_eq!(codes_after(0, 0), ResultCodes::Unverified, "no accepted frame waits");
        assert_eq!(codes_after(1, 1), ResultCodes::Unverified, "late frames wait, too");
    }

    #[test]
    fn unreadable_flags_leave_frames_unknown() {
        let mut accounts = taken(2);
        late(&mut accounts, 1);
        accounts.ripen();
        accounts.mark_unreadable();
        assert_eq!((accounts.account(1).unknown, accounts.account(1).open), (3, 0));
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
