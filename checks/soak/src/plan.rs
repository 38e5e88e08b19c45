//! The plan of a trial: everything that a seed decides before it runs, in the form of a file.

use fastrand::Rng;
use serde::{Deserialize, Serialize};

use crate::event::{self, Action, Event};
use crate::machine::Machine;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    pub seed: u64,
    /// Cycles with traffic and events; those of the recovery follow.
    pub cycles: u64,
    pub machine: Machine,
    #[serde(default)]
    pub event: Vec<Event>,
}

impl Plan {
    /// The machine and the faults as a scenario file, without talkers and what the application does. The faults count
    /// from the time when all gateways are ready, nearly as those of the plan.
    pub fn scenario_text(&self) -> Result<String, toml::ser::Error> {
        let mut text = self.machine.scenario_text(self.seed);
        for event in &self.event {
            if let Action::Fault(fault) = &event.action {
                let ms = event.cycle * u64::from(self.machine.cycle_us) / 1_000;
                text.push_str(&format!("\n[[fault]]\nafter_ready_ms = {ms}\n"));
                text.push_str(&toml::to_string(fault)?);
            }
        }
        Ok(text)
    }

    pub fn draw(seed: u64, cycles: u64) -> Self {
        // Neighbouring seeds give unlike numbers.
        let mut r = Rng::with_seed(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xECA0_50A4);
        let machine = Machine::draw(&mut r);
        let event = event::draw(&mut r, &machine, cycles);
        Self { seed, cycles, machine, event }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenario_has_the_faults_of_the_plan() {
        let plans = (0..200).map(|seed| Plan::draw(seed, 1_000));
        let mut faults = 0;
        for plan in plans {
            let text = plan.scenario_text().unwrap();
            let scenario = ecan_sim::Scenario::from_toml(&text, "plan", std::path::Path::new("."));
            let scenario = scenario.unwrap_or_else(|error| panic!("{text}\n{error}"));
            let planned =
                plan.event.iter().filter(|event| matches!(event.action, Action::Fault(_))).count();
            assert_eq!(scenario.faults.len(), planned, "{text}");
            faults += planned;
        }
        assert!(faults > 200, "{faults}");
    }
}
