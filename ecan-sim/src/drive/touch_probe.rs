//! Touch probes: positions at edges of an input or of the index pulse (CiA 402-2, 0x60B8 to 0x60BD).

use super::config::MotorConfig;
use super::motor::Motor;

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
