//! Homing: what it is told, and what the statusword says about it (CiA 402-2, 12).

use std::time::Duration;

use ecan_canopen::{OperatingMode, Statusword, Step, object};

use super::script::{Script, axis_script, mode_steps};

/// Cycles for which a drive may still show the outcome of an earlier homing after the start.
const OLD_NEWS_CYCLES: u16 = 20;

/// Homing of an axis. Objects that a drive does not have are skipped, apart from
/// the method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HomingConfig {
    /// Homing method, 0x6098: 35 and 37 take the present position as home, -4..-1 are
    /// manufacturers', 1..34 look for switches and index pulses.
    pub method: i8,
    /// Speed on the way to the switch, 0x6099:01, in the drive's units; `None` leaves it alone.
    pub switch_speed: Option<u32>,
    /// Speed on the way to the zero, 0x6099:02; `None` leaves it alone.
    pub zero_speed: Option<u32>,
    /// Acceleration, 0x609A; `None` leaves it alone.
    pub acceleration: Option<u32>,
    /// Position that the home position gets, 0x607C; `None` leaves it alone.
    pub offset: Option<i32>,
    /// Longest time for the movement.
    pub timeout: Duration,
}

impl HomingConfig {
    /// A method with the drive's own speeds, and a minute for it.
    pub fn new(method: i8) -> Self {
        Self {
            method,
            switch_speed: None,
            zero_speed: None,
            acceleration: None,
            offset: None,
            timeout: Duration::from_secs(60),
        }
    }

    /// Writes the parameters, then the mode.
    pub(crate) fn script(&self, axis: u8) -> Script {
        let optional = [
            self.switch_speed.map(|speed| Step::write(object::HOMING_SPEEDS, 1, speed)),
            self.zero_speed.map(|speed| Step::write(object::HOMING_SPEEDS, 2, speed)),
            self.acceleration.map(|value| Step::write(object::HOMING_ACCELERATION, 0, value)),
            self.offset.map(|offset| Step::write(object::HOME_OFFSET, 0, offset)),
        ];
        let method = Step::write(object::HOMING_METHOD, 0, self.method).named("homing method");
        let optional = optional.into_iter().flatten().map(Step::if_present);
        let steps = [method].into_iter().chain(optional).chain(mode_steps(OperatingMode::Homing));
        axis_script(axis, steps)
    }
}

ecan_protocol::text_enum! {
    /// State of a started homing, by the statusword.
    pub enum HomingState;
    Running = "looking for the home position";
    /// Interrupted or not begun: at rest without a home position.
    Waiting = "interrupted or not started";
    /// The home position is found, the axis still moves.
    Found = "found, not at rest yet";
    Attained = "home position attained";
    Failing = "homing error, still moving";
    Failed = "homing error";
}

impl HomingState {
    /// Reads bits 10, 12 and 13 of a drive in homing mode.
    pub fn of(status: Statusword) -> Self {
        let rests = status.has(Statusword::TARGET_REACHED);
        match (status.has(Statusword::MODE_13), status.has(Statusword::MODE_12), rests) {
            (true, _, false) => Self::Failing,
            (true, _, true) => Self::Failed,
            (false, false, false) => Self::Running,
            (false, false, true) => Self::Waiting,
            (false, true, false) => Self::Found,
            (false, true, true) => Self::Attained,
        }
    }
}

/// Judges a homing by the statuswords since its start bit went up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct HomingWatch {
    cycles: u16,
    /// The drive has shown that this homing, not an earlier one, is what it reports about.
    has_begun: bool,
}

impl HomingWatch {
    /// One cycle with the start bit on the bus. `None` while the outcome is open.
    pub(crate) fn step(&mut self, status: Statusword) -> Option<HomingState> {
        let state = HomingState::of(status);
        self.cycles = self.cycles.saturating_add(1);
        match state {
            HomingState::Running | HomingState::Found | HomingState::Failing => {
                self.has_begun = true;
                None
            }
            // Also where a method ends within a cycle, as 35 and 37 do.
            HomingState::Attained | HomingState::Failed
                if self.has_begun || self.cycles > OLD_NEWS_CYCLES =>
            {
                Some(state)
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ATTAINED: Statusword = Statusword(0x1637);
    const RUNNING: Statusword = Statusword(0x0237);
    const FAILED: Statusword = Statusword(0x2637);

    #[test]
    fn homing_state_follows_the_statusword_bits() {
        let states = [
            (0x0237, HomingState::Running),
            (0x0637, HomingState::Waiting),
            (0x1237, HomingState::Found),
            (0x1637, HomingState::Attained),
            (0x2237, HomingState::Failing),
            (0x2637, HomingState::Failed),
        ];
        for (word, state) in states {
            assert_eq!(HomingState::of(Statusword(word)), state);
        }
    }

    #[test]
    fn result_of_an_earlier_homing_is_ignored() {
        let mut watch = HomingWatch::default();
        assert_eq!(watch.step(ATTAINED), None, "from before");
        assert_eq!(watch.step(RUNNING), None);
        assert_eq!(watch.step(ATTAINED), Some(HomingState::Attained));
        let mut watch = HomingWatch::default();
        watch.step(RUNNING);
        assert_eq!(watch.step(FAILED), Some(HomingState::Failed));
    }

    #[test]
    fn immediate_homing_is_detected() {
        let mut watch = HomingWatch::default();
        let done = (0..30).find_map(|_| watch.step(ATTAINED));
        assert_eq!(done, Some(HomingState::Attained));
    }
}
