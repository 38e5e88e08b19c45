//! The plan of a trial: everything that a seed decides before it runs, in the form of a file.

use fastrand::Rng;
use serde::{Deserialize, Serialize};

use crate::event::{self, Event};
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
    pub fn draw(seed: u64, cycles: u64) -> Self {
        // Neighbouring seeds give unlike numbers.
        let mut r = Rng::with_seed(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xECA0_50A4);
        let machine = Machine::draw(&mut r);
        let event = event::draw(&mut r, &machine, cycles);
        Self { seed, cycles, machine, event }
    }
}
