//! Check of the TX_RESULT codes 1 and 2 against the flag of late drops (manual 10, 13.7).
//!
//! The manual does not state which code an accepted and which a late scheduled frame gets (docs/ASSUMPTIONS.md,
//! H23). The flag SCHED_LATE_DROP shows it: a frame of code 1 was not late if the flag is not set afterwards, and
//! then code 2 together with the flag means late. If the flag is set from the beginning, the number of frames
//! that wait in the gateway distinguishes the codes: frames of code 1 wait in the image that reports them, those of
//! code 2 do not.
//!
//! Diagnostics of scheduled transmission, and the objects that contain them (manual 13.2.4, 13.2.5,
//! 13.7).

use ecan_protocol::mapping::CHANNELS;

/// Readings that must contradict the codes before they are rejected: a single one may result from flags that
/// another program cleared, or from results that have not arrived yet.
const CONTRADICTIONS: u8 = 2;
/// Images of each code alone that must agree with the number of waiting frames, without an exception.
const IMAGES_MIN: u8 = 3;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum ResultCodes {
    #[default]
    Unverified,
    Verified,
    Contradicted,
}

/// Decision of a reading of the flags on the frames with these codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CodeDecision {
    /// The codes mean what they are assumed to mean.
    Verified,
    /// Nothing was late.
    NoneLate,
    /// Neither code is certain.
    Uncertain,
    /// The result of the late frame may still arrive: the next reading decides.
    Wait,
}

#[derive(Debug, Clone, Copy, Default)]
struct SeenResults {
    accepted: bool,
    late: bool,
}

#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ResultCodeCheck {
    state: ResultCodes,
    /// Results since the last reading began, and those of the readings before it.
    fresh: SeenResults,
    before: SeenResults,
    /// A reading without the flag followed frames with code 1.
    is_accepted_proven: bool,
    /// A frame got no result since the last reading without the flag: it may be the late one.
    has_missing: bool,
    contradictions: u8,
    /// Images with code 1 alone in which frames wait, and with code 2 alone in which none does.
    waiting_images: u8,
    empty_images: u8,
    /// An image with one code alone showed the opposite.
    has_opposite_image: bool,
}

impl ResultCodeCheck {
    pub(crate) fn state(&self) -> ResultCodes {
        self.state
    }

    pub(crate) fn record_accepted(&mut self) {
        self.fresh.accepted = true;
    }

    pub(crate) fn late(&mut self) {
        self.fresh.late = true;
    }

    /// A scheduled frame got no result.
    pub(crate) fn missing(&mut self) {
        self.has_missing = true;
    }

    /// Results of scheduled frames of a channel in one image, and the channel's waiting frames in its status.
    pub(crate) fn image(&mut self, accepted: u8, late: u8, waiting: u8) {
        match (accepted > 0, late > 0) {
            (true, false) if waiting > 0 => {
                self.waiting_images = self.waiting_images.saturating_add(1)
            }
            (false, true) if waiting == 0 => {
                self.empty_images = self.empty_images.saturating_add(1)
            }
            (true, false) | (false, true) => self.has_opposite_image = true,
            _ => {}
        }
    }

    fn agrees_with_waiting(&self) -> bool {
        !self.has_opposite_image && self.waiting_images.min(self.empty_images) >= IMAGES_MIN
    }

    /// A reading of the flags begins: it shows the late drops of all results so far.
    pub(crate) fn begin_reading(&mut self) {
        let fresh = std::mem::take(&mut self.fresh);
        self.before.accepted |= fresh.accepted;
        self.before.late |= fresh.late;
    }

    /// The flags were read.
    pub(crate) fn read(&mut self, is_late_flagged: bool) -> CodeDecision {
        let before = std::mem::take(&mut self.before);
        match self.state {
            ResultCodes::Verified => return CodeDecision::Verified,
            ResultCodes::Contradicted => return CodeDecision::Uncertain,
            ResultCodes::Unverified => {}
        }
        if !is_late_flagged {
            self.has_missing = false;
            if before.late {
                return self.contradict(CodeDecision::Uncertain);
            }
            self.is_accepted_proven |= before.accepted;
            return CodeDecision::NoneLate;
        }
        let is_late_proven = self.is_accepted_proven && (before.late || self.fresh.late);
        if is_late_proven || self.agrees_with_waiting() {
            self.state = ResultCodes::Verified;
            return CodeDecision::Verified;
        }
        if self.is_accepted_proven && !self.has_missing {
            return self.contradict(CodeDecision::Wait);
        }
        CodeDecision::Uncertain
    }

    fn contradict(&mut self, decision: CodeDecision) -> CodeDecision {
        self.contradictions += 1;
        if self.contradictions < CONTRADICTIONS {
            return decision;
        }
        self.state = ResultCodes::Contradicted;
        CodeDecision::Uncertain
    }

    /// The flags were cleared: contradicted codes get another chance.
    pub(crate) fn on_flags_cleared(&mut self) {
        if self.state != ResultCodes::Verified {
            *self = Self::default();
        }
    }
}

const MAINTENANCE: u16 = 0xB000;
const FLAGS: u8 = 6;
const PERFORMANCE: u16 = 0x9011;
const DATA_PATH: u16 = 0x9020;

/// Index and subindex.
pub(crate) type Object = (u16, u8);

/// Counters of one channel, 0x9020..0x9023 (manual 13.2.5).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ChannelDrops {
    /// Times that the controller's FIFO was full, :11.
    pub fifo_full: u32,
    /// Frames dropped as stale, :12.
    pub stale_drops: u32,
    /// Times that the channel went bus-off, :13.
    pub bus_offs: u32,
}

/// Diagnostics of scheduled transmission of a gateway.
///
/// Each reading contains the flags, `stale_drops` and `bus_offs`, and one of the other objects in turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ScheduleDiagnostics {
    /// Legacy maintenance flags, 0xB000:06; they stay until they are cleared.
    pub flags: u16,
    /// Per channel; all 0 for one that is not enabled.
    pub channels: [ChannelDrops; CHANNELS],
    /// Sync0 pulses counted, 0x9011:02.
    pub sync0_count: u32,
    /// Smallest distance from a Sync0 pulse to the arrival of an image, in CPU cycles of the
    /// gateway (0x8000:04), 0x9011:04.
    pub phase_min_cycles: i32,
    /// Largest such distance, 0x9011:05.
    pub phase_max_cycles: i32,
    /// Longest service of scheduled frames, in CPU cycles, 0x9011:13.
    pub service_max_cycles: u32,
    /// Time at which the flags and counters that decide on frames were read, in nanoseconds of the
    /// library's clock.
    pub read_at_ns: u64,
}

impl ScheduleDiagnostics {
    /// Flag: a scheduled frame was dropped because its phase had passed (SCHED_LATE_DROP).
    pub const LATE_DROP: u16 = 1 << 6;
    /// Flag: a scheduled frame found the queue full (SCHED_QUEUE_FULL).
    pub const QUEUE_FULL: u16 = 1 << 7;
    /// Flag: the CAN controller rejected a scheduled frame at its phase (SCHED_TX_FAIL).
    pub const TX_FAIL: u16 = 1 << 8;
    /// Flag: the timer of scheduled transmission missed a phase (SCHED_TIMER_MISS).
    pub const TIMER_MISS: u16 = 1 << 9;
}

/// Objects that decide on frames: the flags, and of each channel `stale_drops` and `bus_offs`.
pub(crate) fn decisive_objects(channel_mask: u8) -> impl Iterator<Item = Object> {
    std::iter::once((MAINTENANCE, FLAGS)).chain(of_channels(channel_mask, &[12, 13]))
}

/// The other objects: `fifo_full` of each channel, and those of 0x9011.
pub(crate) fn other_objects(channel_mask: u8) -> impl Iterator<Item = Object> {
    of_channels(channel_mask, &[11]).chain([2, 4, 5, 13].map(|subindex| (PERFORMANCE, subindex)))
}

fn of_channels(channel_mask: u8, subindices: &'static [u8]) -> impl Iterator<Item = Object> {
    let enabled = (0..CHANNELS as u16).filter(move |channel| channel_mask >> channel & 1 == 1);
    enabled
        .flat_map(|channel| subindices.iter().map(move |subindex| (DATA_PATH + channel, *subindex)))
}

impl ScheduleDiagnostics {
    pub(crate) fn store(&mut self, object: Object, value: u32) {
        match object {
            (MAINTENANCE, _) => self.flags = value as u16,
            (PERFORMANCE, 2) => self.sync0_count = value,
            (PERFORMANCE, 4) => self.phase_min_cycles = value as i32,
            (PERFORMANCE, 5) => self.phase_max_cycles = value as i32,
            (PERFORMANCE, _) => self.service_max_cycles = value,
            (index, field) => {
                let channel = usize::from(index.wrapping_sub(DATA_PATH));
                let Some(channel) = self.channels.get_mut(channel) else { return };
                match field {
                    11 => channel.fifo_full = value,
                    12 => channel.stale_drops = value,
                    _ => channel.bus_offs = value,
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use Code::{One, Two};

    use super::*;

    #[derive(Clone, Copy)]
    enum Code {
        One,
        Two,
    }

    /// Readings: the codes before it, and the flag.
    fn decisions(readings: &[(&[Code], bool)]) -> (Vec<CodeDecision>, ResultCodes) {
        let mut check = ResultCodeCheck::default();
        let decisions = readings
            .iter()
            .map(|(codes, is_late_flagged)| {
                for code in *codes {
                    match code {
                        One => check.record_accepted(),
                        Two => check.late(),
                    }
                }
                check.begin_reading();
                check.read(*is_late_flagged)
            })
            .collect();
        (decisions, check.state())
    }

    #[test]
    fn assumed_codes_are_verified_by_the_first_late_frame() {
        let readings: &[(&[Code], bool)] = &[(&[One], false), (&[One, Two], true), (&[One], true)];
        let (decisions, state) = decisions(readings);
        let expected = [CodeDecision::NoneLate, CodeDecision::Verified, CodeDecision::Verified];
        assert_eq!((decisions.as_slice(), state), (expected.as_slice(), ResultCodes::Verified));
    }

    #[test]
    fn other_codes_are_contradicted_and_never_verified() {
        let swapped: &[(&[Code], bool)] = &[(&[Two], false), (&[Two], false), (&[One, Two], true)];
        let both_queued: &[(&[Code], bool)] = &[(&[One], false), (&[One], true), (&[One], true)];
        let both_late: &[(&[Code], bool)] = &[(&[Two], false), (&[Two], false), (&[Two], true)];
        for readings in [swapped, both_queued, both_late] {
            assert_eq!(decisions(readings).1, ResultCodes::Contradicted);
        }
    }

    #[test]
    fn flag_of_an_earlier_run_leaves_the_codes_unverified() {
        let readings: &[(&[Code], bool)] = &[(&[One, Two], true), (&[Two], true)];
        let (decisions, state) = decisions(readings);
        assert_eq!(decisions, [CodeDecision::Uncertain; 2]);
        assert_eq!(state, ResultCodes::Unverified);
    }

    #[test]
    fn late_frame_whose_result_is_missing_contradicts_nothing() {
        let mut check = ResultCodeCheck::default();
        check.record_accepted();
        check.begin_reading();
        assert_eq!(check.read(false), CodeDecision::NoneLate);
        check.missing();
        for _ in 0..3 {
            check.record_accepted();
            check.begin_reading();
            assert_eq!(check.read(true), CodeDecision::Uncertain);
        }
        assert_eq!(check.state(), ResultCodes::Unverified);
    }

    #[test]
    fn waiting_frames_verify_codes_if_the_flag_is_always_set() {
        for (images, expected) in [
            ([(1, 0, 1), (0, 2, 0)], ResultCodes::Verified),
            ([(0, 1, 1), (2, 0, 0)], ResultCodes::Unverified),
            ([(1, 0, 0), (0, 1, 0)], ResultCodes::Unverified),
            ([(1, 1, 1), (0, 1, 0)], ResultCodes::Unverified),
        ] {
            let mut check = ResultCodeCheck::default();
            for (accepted, late, waiting) in images.repeat(3) {
                check.image(accepted, late, waiting);
            }
            check.record_accepted();
            check.late();
            check.begin_reading();
            check.read(true);
            assert_eq!(check.state(), expected, "{images:?}");
        }
    }

    #[test]
    fn flags_cleared_by_another_program_contradict_once() {
        let readings: &[(&[Code], bool)] = &[
            (&[One], false),
            // cleared between the late drop and the reading
            (&[One, Two], false),
            (&[One, Two], true),
        ];
        let (decisions, state) = decisions(readings);
        let expected = [CodeDecision::NoneLate, CodeDecision::Uncertain, CodeDecision::Verified];
        assert_eq!((decisions.as_slice(), state), (expected.as_slice(), ResultCodes::Verified));
    }

    #[test]
    fn each_object_has_its_own_field() {
        let decisive: Vec<_> = decisive_objects(0b1000).collect();
        assert_eq!(decisive, [(0xB000, 6), (0x9023, 12), (0x9023, 13)]);
        let other: Vec<_> = other_objects(0b1000).collect();
        assert_eq!(other, [(0x9023, 11), (0x9011, 2), (0x9011, 4), (0x9011, 5), (0x9011, 13)]);
        assert_eq!(decisive_objects(0x0F).chain(other_objects(0x0F)).count(), 17);
        let mut seen = ScheduleDiagnostics::default();
        for (value, object) in (100..).zip(decisive.into_iter().chain(other)) {
            seen.store(object, value);
        }
        let drops = ChannelDrops { stale_drops: 101, bus_offs: 102, fifo_full: 103 };
        let expected = ScheduleDiagnostics {
            flags: 100,
            channels: [
                ChannelDrops::default(),
                ChannelDrops::default(),
                ChannelDrops::default(),
                drops,
            ],
            sync0_count: 104,
            phase_min_cycles: 105,
            phase_max_cycles: 106,
            service_max_cycles: 107,
            read_at_ns: 0,
        };
        assert_eq!(seen, expected);
    }
}
