//! Check of the TX_RESULT codes 1 and 2 against the flag of late drops (manual 10, 13.7).
//!
//! The manual does not state which code an accepted and which a late scheduled frame gets (docs/ASSUMPTIONS.md,
//! H23). The flag SCHED_LATE_DROP shows it: a frame of code 1 was not late if the flag is not set afterwards, and
//! then code 2 together with the flag means late. If the flag is set from the beginning, the number of frames
//! that wait in the gateway distinguishes the codes: frames of code 1 wait in the image that reports them, those of
//! code 2 do not.

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

    pub(crate) fn accepted(&mut self) {
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
    pub(crate) fn reading_begins(&mut self) {
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
                return self.contradicted(CodeDecision::Uncertain);
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
            return self.contradicted(CodeDecision::Wait);
        }
        CodeDecision::Uncertain
    }

    fn contradicted(&mut self, decision: CodeDecision) -> CodeDecision {
        self.contradictions += 1;
        if self.contradictions < CONTRADICTIONS {
            return decision;
        }
        self.state = ResultCodes::Contradicted;
        CodeDecision::Uncertain
    }

    /// The flags were cleared: contradicted codes get another chance.
    pub(crate) fn flags_cleared(&mut self) {
        if self.state != ResultCodes::Verified {
            *self = Self::default();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Copy)]
    enum Code {
        One,
        Two,
    }
    use Code::{One, Two};

    /// Readings: the codes before it, and the flag.
    fn decisions(readings: &[(&[Code], bool)]) -> (Vec<CodeDecision>, ResultCodes) {
        let mut check = ResultCodeCheck::default();
        let decisions = readings
            .iter()
            .map(|(codes, is_late_flagged)| {
                for code in *codes {
                    match code {
                        One => check.accepted(),
                        Two => check.late(),
                    }
                }
                check.reading_begins();
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
        check.accepted();
        check.reading_begins();
        assert_eq!(check.read(false), CodeDecision::NoneLate);
        check.missing();
        for _ in 0..3 {
            check.accepted();
            check.reading_begins();
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
            check.accepted();
            check.late();
            check.reading_begins();
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
}
