//! Homing methods (CiA 402-2, chapter 7): how the drive finds its reference.

use super::settings::MotorConfig;

/// What ends a leg.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StopCondition {
    NegativeLimit(bool),
    PositiveLimit(bool),
    HomeSwitch(bool),
    IndexPulse,
}

/// Part of a homing run: one direction until something is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct HomingMove {
    positive: bool,
    fast: bool,
    until: StopCondition,
}

const MOST_LEGS: usize = 3;

/// A homing run under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Homing {
    legs: [Option<HomingMove>; MOST_LEGS],
    current: usize,
    /// Where the motor was at the last look.
    last: f64,
}

/// What a look at the switches found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Finding {
    /// Go on with this share of the two homing speeds.
    Go { positive: bool, fast: bool },
    /// The reference is here.
    Home(f64),
    /// The machine ended first.
    Failed,
}

/// State of the three switches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Switches {
    pub(super) negative: bool,
    pub(super) positive: bool,
    pub(super) home: bool,
}

impl Switches {
    pub(super) fn at(position: f64, settings: &MotorConfig) -> Self {
        let (negative, positive) = settings.limit_switches;
        Self {
            negative: position <= f64::from(negative),
            positive: position >= f64::from(positive),
            home: position >= f64::from(settings.home_switch),
        }
    }

    /// Digital inputs, 0x60FD.
    pub(super) fn bits(self) -> u32 {
        u32::from(self.negative) | u32::from(self.positive) << 1 | u32::from(self.home) << 2
    }
}

/// Whether a method is known.
pub(super) const fn is_supported(method: i8) -> bool {
    matches!(method, 1 | 2 | 17..=20 | 33..=35 | 37)
}

impl Homing {
    /// Begins a run; `None` for a method that is not known.
    pub(super) fn begin(method: i8, position: f64, settings: &MotorConfig) -> Option<Self> {
        let leg = |positive, fast, until| Some(HomingMove { positive, fast, until });
        let switches = Switches::at(position, settings);
        let legs = match method {
            // To a limit switch and off it again, with or without an index pulse behind.
            1 | 17 => [
                leg(false, true, StopCondition::NegativeLimit(true)),
                leg(true, false, StopCondition::NegativeLimit(false)),
                if method == 1 { leg(true, false, StopCondition::IndexPulse) } else { None },
            ],
            2 | 18 => [
                leg(true, true, StopCondition::PositiveLimit(true)),
                leg(false, false, StopCondition::PositiveLimit(false)),
                if method == 2 { leg(false, false, StopCondition::IndexPulse) } else { None },
            ],
            // To the edge of the home switch, left downwards or entered upwards.
            19 => [
                leg(true, true, StopCondition::HomeSwitch(true)),
                leg(false, false, StopCondition::HomeSwitch(false)),
                None,
            ],
            20 if switches.home => [
                leg(false, true, StopCondition::HomeSwitch(false)),
                leg(true, false, StopCondition::HomeSwitch(true)),
                None,
            ],
            20 => [leg(true, false, StopCondition::HomeSwitch(true)), None, None],
            33 => [leg(false, false, StopCondition::IndexPulse), None, None],
            34 => [leg(true, false, StopCondition::IndexPulse), None, None],
            35 | 37 => [None; MOST_LEGS],
            _ => return None,
        };
        Some(Self { legs, current: 0, last: position })
    }

    /// Looks at the switches where the motor is now.
    pub(super) fn look(&mut self, position: f64, settings: &MotorConfig) -> Finding {
        let switches = Switches::at(position, settings);
        let mut last = std::mem::replace(&mut self.last, position);
        loop {
            let Some(leg) = self.legs.get(self.current).copied().flatten() else {
                return Finding::Home(position);
            };
            let pulse = match leg.until {
                StopCondition::NegativeLimit(active) => {
                    (switches.negative == active).then_some(position)
                }
                StopCondition::PositiveLimit(active) => {
                    (switches.positive == active).then_some(position)
                }
                StopCondition::HomeSwitch(active) => (switches.home == active).then_some(position),
                StopCondition::IndexPulse => index_between(last, position, settings),
            };
            let Some(seen) = pulse else {
                let end = if leg.positive { switches.positive } else { switches.negative };
                return if end {
                    Finding::Failed
                } else {
                    Finding::Go { positive: leg.positive, fast: leg.fast }
                };
            };
            self.current += 1;
            last = position;
            if self.legs.get(self.current).copied().flatten().is_none() {
                return Finding::Home(seen);
            }
        }
    }
}

/// The index pulse that the motor has passed, if any.
fn index_between(last: f64, position: f64, settings: &MotorConfig) -> Option<f64> {
    let revolution = f64::from(settings.increments_per_revolution.max(1));
    let (before, after) = ((last / revolution).floor(), (position / revolution).floor());
    // Downwards the pulse is that of the revolution left, upwards that of the one entered.
    (before != after).then(|| before.max(after) * revolution)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Drives an ideal axis, 1 increment a look when slow, 10 when fast.
    fn run(method: i8, start: f64) -> (Option<f64>, usize) {
        let settings = MotorConfig {
            increments_per_revolution: 100,
            limit_switches: (-500, 500),
            home_switch: 200,
            ..MotorConfig::default()
        };
        let mut position = start;
        let mut homing = Homing::begin(method, position, &settings).unwrap();
        for looks in 0..10_000 {
            match homing.look(position, &settings) {
                Finding::Home(home) => return (Some(home), looks),
                Finding::Failed => return (None, looks),
                Finding::Go { positive, fast } => {
                    let step = if fast { 10.0 } else { 1.0 };
                    position += if positive { step } else { -step };
                }
            }
        }
        panic!("homing never ends");
    }

    #[test]
    fn the_present_position_is_home_at_once() {
        assert_eq!(run(35, 123.0), (Some(123.0), 0));
        assert_eq!(run(37, -7.0), (Some(-7.0), 0));
    }

    #[test]
    fn limit_switches_are_left_slowly() {
        let (home, looks) = run(17, 0.0);
        assert_eq!(home, Some(-499.0));
        assert!(looks > 50);
        assert_eq!(run(18, 0.0).0, Some(499.0));
        assert_eq!(run(17, -600.0).0, Some(-499.0));
    }

    #[test]
    fn the_index_pulse_behind_a_limit_switch() {
        assert_eq!(run(1, 0.0).0, Some(-400.0));
        assert_eq!(run(2, 0.0).0, Some(400.0));
    }

    #[test]
    fn both_edges_of_the_home_switch() {
        assert_eq!(run(19, 0.0).0, Some(199.0));
        assert_eq!(run(19, 300.0).0, Some(199.0));
        assert_eq!(run(20, 0.0).0, Some(200.0));
        assert_eq!(run(20, 300.0).0, Some(200.0));
    }

    #[test]
    fn index_pulses_both_ways() {
        assert_eq!(run(34, 130.0).0, Some(200.0));
        assert_eq!(run(33, 130.0).0, Some(100.0));
    }

    #[test]
    fn a_switch_that_never_comes_is_a_failure() {
        let settings =
            MotorConfig { home_switch: i32::MAX, limit_switches: (-50, 50), ..Default::default() };
        let mut homing = Homing::begin(19, 0.0, &settings).unwrap();
        assert_eq!(homing.look(0.0, &settings), Finding::Go { positive: true, fast: true });
        assert_eq!(homing.look(50.0, &settings), Finding::Failed);
        assert!(Homing::begin(3, 0.0, &settings).is_none());
        assert!(!is_supported(0) && is_supported(37));
    }
}
