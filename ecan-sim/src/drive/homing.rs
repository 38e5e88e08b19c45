//! Homing methods (CiA 402-2, chapter 7), and touch probes: positions at edges of an input or of the index pulse
//! (CiA 402-2, 0x60B8 to 0x60BD).

use super::config::MotorConfig;
use super::motor::Motor;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StopCondition {
    NegativeLimit(bool),
    PositiveLimit(bool),
    HomeSwitch(bool),
    IndexPulse,
}

/// Part of a homing run: one direction until a condition is met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct HomingMove {
    positive: bool,
    fast: bool,
    until: StopCondition,
}

const MAX_MOVES: usize = 3;

#[derive(Clone, Copy, Debug)]
pub(super) struct Homing {
    moves: [Option<HomingMove>; MAX_MOVES],
    current: usize,
    /// Position at the last call.
    last: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Finding {
    /// Move in this direction with the fast or slow homing speed.
    Go {
        positive: bool,
        fast: bool,
    },
    /// The reference is at this position.
    Home(f64),
    Failed,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Switches {
    pub(super) negative: bool,
    pub(super) positive: bool,
    pub(super) home: bool,
}

impl Switches {
    pub(super) fn at(position: f64, config: &MotorConfig) -> Self {
        let (negative, positive) = config.limit_switches;
        Self {
            negative: position <= f64::from(negative),
            positive: position >= f64::from(positive),
            home: position >= f64::from(config.home_switch),
        }
    }

    /// As in 0x60FD.
    pub(super) fn bits(self) -> u32 {
        u32::from(self.negative) | u32::from(self.positive) << 1 | u32::from(self.home) << 2
    }
}

pub(super) const fn is_supported(method: i8) -> bool {
    matches!(method, 1 | 2 | 17..=20 | 33..=35 | 37)
}

impl Homing {
    /// Starts a run; `None` if the method is not supported.
    pub(super) fn begin(method: i8, position: f64, config: &MotorConfig) -> Option<Self> {
        let step = |positive, fast, until| Some(HomingMove { positive, fast, until });
        let switches = Switches::at(position, config);
        let moves = match method {
            // To a limit switch and off it again, then optionally to the next index pulse.
            1 | 17 => [
                step(false, true, StopCondition::NegativeLimit(true)),
                step(true, false, StopCondition::NegativeLimit(false)),
                if method == 1 { step(true, false, StopCondition::IndexPulse) } else { None },
            ],
            2 | 18 => [
                step(true, true, StopCondition::PositiveLimit(true)),
                step(false, false, StopCondition::PositiveLimit(false)),
                if method == 2 { step(false, false, StopCondition::IndexPulse) } else { None },
            ],
            // To the edge of the home switch: left in negative or entered in positive direction.
            19 => [
                step(true, true, StopCondition::HomeSwitch(true)),
                step(false, false, StopCondition::HomeSwitch(false)),
                None,
            ],
            20 if switches.home => [
                step(false, true, StopCondition::HomeSwitch(false)),
                step(true, false, StopCondition::HomeSwitch(true)),
                None,
            ],
            20 => [step(true, false, StopCondition::HomeSwitch(true)), None, None],
            33 => [step(false, false, StopCondition::IndexPulse), None, None],
            34 => [step(true, false, StopCondition::IndexPulse), None, None],
            35 | 37 => [None; MAX_MOVES],
            _ => return None,
        };
        Some(Self { moves, current: 0, last: position })
    }

    pub(super) fn evaluate(&mut self, position: f64, config: &MotorConfig) -> Finding {
        let switches = Switches::at(position, config);
        let mut last = std::mem::replace(&mut self.last, position);
        loop {
            let Some(current) = self.moves.get(self.current).copied().flatten() else {
                return Finding::Home(position);
            };
            let pulse = match current.until {
                StopCondition::NegativeLimit(active) => {
                    (switches.negative == active).then_some(position)
                }
                StopCondition::PositiveLimit(active) => {
                    (switches.positive == active).then_some(position)
                }
                StopCondition::HomeSwitch(active) => (switches.home == active).then_some(position),
                StopCondition::IndexPulse => index_between(last, position, config),
            };
            let Some(reference) = pulse else {
                let end = if current.positive { switches.positive } else { switches.negative };
                return if end {
                    Finding::Failed
                } else {
                    Finding::Go { positive: current.positive, fast: current.fast }
                };
            };
            self.current += 1;
            last = position;
            if self.moves.get(self.current).copied().flatten().is_none() {
                return Finding::Home(reference);
            }
        }
    }
}

/// The index pulse between two positions, if any.
fn index_between(last: f64, position: f64, config: &MotorConfig) -> Option<f64> {
    let revolution = f64::from(config.increments_per_revolution.max(1));
    let (before, after) = ((last / revolution).floor(), (position / revolution).floor());
    // In negative direction the pulse of the revolution left, in positive direction of the one
    // entered.
    (before != after).then(|| before.max(after) * revolution)
}

/// Bits of the function of a probe, in the byte of the probe.
const ENABLE: u8 = 1 << 0;
const CONTINUOUS: u8 = 1 << 1;
const INDEX_PULSE: u8 = 1 << 2;
const POSITIVE: u8 = 1 << 4;
const NEGATIVE: u8 = 1 << 5;

#[derive(Clone, Copy, Debug, Default)]
struct Probe {
    function: u8,
    /// Positions at the positive and the negative edge.
    positions: [i32; 2],
    is_stored: [bool; 2],
}

impl Probe {
    /// The rising edge of the enable bit forgets what was stored.
    fn set_function(&mut self, function: u8) {
        let is_enabled = function & ENABLE != 0 && self.function & ENABLE == 0;
        if is_enabled || function & ENABLE == 0 {
            self.is_stored = [false; 2];
        }
        self.function = function;
    }

    fn status(&self) -> u8 {
        let bit = |is_set: bool, bit: u8| u8::from(is_set) << bit;
        let [positive, negative] = self.is_stored;
        bit(self.function & ENABLE != 0, 0) | bit(positive, 1) | bit(negative, 2)
    }

    fn edge(&mut self, is_positive: bool, position: i32) {
        let (nth, wanted) = if is_positive { (0, POSITIVE) } else { (1, NEGATIVE) };
        if self.function & (ENABLE | wanted) != ENABLE | wanted {
            return;
        }
        let is_continuous = self.function & CONTINUOUS != 0;
        if let (Some(stored), Some(to)) = (self.is_stored.get_mut(nth), self.positions.get_mut(nth))
            && (is_continuous || !*stored)
        {
            *stored = true;
            *to = position;
        }
    }

    /// The motor moved. The edge of the input is at `input`, the index pulse at every revolution.
    fn step(&mut self, before: f64, now: f64, origin: i64, input: i32, revolution: f64) {
        if self.function & ENABLE == 0 || before == now {
            return;
        }
        let at = if self.function & INDEX_PULSE != 0 {
            // The last pulse at or below the upper position.
            (before.max(now) / revolution).floor() * revolution
        } else {
            f64::from(input)
        };
        let position = (at as i64 - origin) as i32;
        if before < at && now >= at {
            self.edge(true, position);
        } else if before >= at && now < at {
            self.edge(false, position);
        }
    }
}

/// The two touch probes of a drive.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TouchProbes {
    probes: [Probe; 2],
}

impl TouchProbes {
    pub(super) fn set_function(&mut self, function: u16) {
        for (probe, function) in self.probes.iter_mut().zip(function.to_le_bytes()) {
            probe.set_function(function);
        }
    }

    pub(super) fn status(&self) -> u16 {
        u16::from_le_bytes(self.probes.map(|probe| probe.status()))
    }

    pub(super) fn position(&self, probe: usize, is_positive: bool) -> i32 {
        let found = self.probes.get(probe).map(|probe| probe.positions);
        found.map_or(0, |[positive, negative]| if is_positive { positive } else { negative })
    }

    /// Call after each step of the motor. `origin` is the mechanical position of the user's zero.
    pub(super) fn step(&mut self, before: f64, motor: &Motor, origin: i64, config: &MotorConfig) {
        let revolution = motor.increments_per_revolution();
        for (probe, input) in self.probes.iter_mut().zip(config.probes) {
            probe.step(before, motor.position, origin, input, revolution);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moves an ideal axis by 1 increment per step when slow, by 10 when fast.
    fn run(method: i8, start: f64) -> (Option<f64>, usize) {
        let config = MotorConfig {
            increments_per_revolution: 100,
            limit_switches: (-500, 500),
            home_switch: 200,
            ..MotorConfig::default()
        };
        let mut position = start;
        let mut homing = Homing::begin(method, position, &config).unwrap();
        for steps in 0..10_000 {
            match homing.evaluate(position, &config) {
                Finding::Home(home) => return (Some(home), steps),
                Finding::Failed => return (None, steps),
                Finding::Go { positive, fast } => {
                    let step = if fast { 10.0 } else { 1.0 };
                    position += if positive { step } else { -step };
                }
            }
        }
        panic!("homing never ends");
    }

    #[test]
    fn present_position_is_home_at_once() {
        assert_eq!(run(35, 123.0), (Some(123.0), 0));
        assert_eq!(run(37, -7.0), (Some(-7.0), 0));
    }

    #[test]
    fn limit_switches_are_left_slowly() {
        let (home, steps) = run(17, 0.0);
        assert_eq!(home, Some(-499.0));
        assert!(steps > 50);
        assert_eq!(run(18, 0.0).0, Some(499.0));
        assert_eq!(run(17, -600.0).0, Some(-499.0));
    }

    #[test]
    fn index_pulse_after_limit_switch_is_home() {
        assert_eq!(run(1, 0.0).0, Some(-400.0));
        assert_eq!(run(2, 0.0).0, Some(400.0));
    }

    #[test]
    fn both_edges_of_home_switch_are_found() {
        assert_eq!(run(19, 0.0).0, Some(199.0));
        assert_eq!(run(19, 300.0).0, Some(199.0));
        assert_eq!(run(20, 0.0).0, Some(200.0));
        assert_eq!(run(20, 300.0).0, Some(200.0));
    }

    #[test]
    fn index_pulses_are_found_in_both_directions() {
        assert_eq!(run(34, 130.0).0, Some(200.0));
        assert_eq!(run(33, 130.0).0, Some(100.0));
    }

    #[test]
    fn missing_switch_fails() {
        let config =
            MotorConfig { home_switch: i32::MAX, limit_switches: (-50, 50), ..Default::default() };
        let mut homing = Homing::begin(19, 0.0, &config).unwrap();
        assert_eq!(homing.evaluate(0.0, &config), Finding::Go { positive: true, fast: true });
        assert_eq!(homing.evaluate(50.0, &config), Finding::Failed);
        assert!(Homing::begin(3, 0.0, &config).is_none());
        assert!(!is_supported(0) && is_supported(37));
    }

    fn moved(probes: &mut TouchProbes, from: f64, to: f64) {
        let config = MotorConfig { probes: [1_000, 2_000], ..MotorConfig::default() };
        let mut motor = Motor::new(config);
        motor.position = to;
        probes.step(from, &motor, 100, &config);
    }

    #[test]
    fn first_positive_edge_of_the_input_is_stored() {
        let mut probes = TouchProbes::default();
        moved(&mut probes, 0.0, 1_500.0);
        assert_eq!(probes.status(), 0, "not enabled");
        probes.set_function(0x0011);
        moved(&mut probes, 1_500.0, 500.0);
        assert_eq!(probes.status(), 0x0001, "a negative edge is not sampled");
        moved(&mut probes, 500.0, 1_200.4);
        assert_eq!((probes.status(), probes.position(0, true)), (0x0003, 900));
        probes.set_function(0);
        assert_eq!(probes.status(), 0);
    }

    #[test]
    fn second_probe_stores_the_last_index_pulse() {
        let revolution = f64::from(MotorConfig::default().increments_per_revolution);
        let mut probes = TouchProbes::default();
        probes.set_function(0x3700);
        moved(&mut probes, -10.0, 10.0);
        assert_eq!((probes.status(), probes.position(1, true)), (0x0300, -100));
        moved(&mut probes, revolution + 5.0, revolution - 5.0);
        assert_eq!((probes.status(), probes.position(1, false)), (0x0700, 65_436));
        moved(&mut probes, revolution - 5.0, revolution + 5.0);
        assert_eq!(probes.position(1, true), 65_436, "continuous");
    }
}
