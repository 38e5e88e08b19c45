//! Gateways that differ from the assumptions of docs/ASSUMPTIONS.md.

use std::path::Path;

use ecan_sim::variant::{Choice, toml, variants};
use ecan_sim::{GatewayModelConfig, Scenario};

use crate::plan::{AxisPlan, rpdos_on};
use crate::random::Random;

/// Share of the trials with such gateways, percent.
const SHARE: u32 = 30;

/// Value at which the gateway's count of waiting frames saturates.
const SATURATED: usize = 7;

/// Phases of Sync0 and periods, in cycles, of targets and SYNC.
pub struct Timing {
    pub clock: Option<(Option<u32>, Option<u32>)>,
    pub target_cycles: u64,
    pub sync_cycles: u64,
}

impl Timing {
    /// Most frames of a channel that wait at once, where scheduled ones wait for the second pulse: those of two
    /// images. Frames of every cycle that are not scheduled wait for the bus in addition.
    fn waiting_for_second_pulse(&self, axes: &[AxisPlan]) -> usize {
        let (targets, sync) = match self.clock {
            None | Some((None, None)) => return 0,
            Some(phases) => phases,
        };
        let images = |phase: Option<u32>, cycles: u64| match (phase, cycles) {
            (None, 1) | (Some(_), 2..) => 1,
            (None, _) => 0,
            (Some(_), _) => 2,
        };
        let addresses = axes.iter().map(|axis| axis.config.address);
        let rpdos = addresses.map(|at| rpdos_on(axes, at.slave, at.channel)).max().unwrap_or(0);
        rpdos * images(targets, self.target_cycles) + images(sync, self.sync_cycles)
    }
}

/// The alternative of `TRIALS_VARIANT` (`KEY=VALUE`), else up to three in a share of the trials.
pub fn draw(random: &mut Random, axes: &[AxisPlan], timing: &Timing) -> Vec<Choice> {
    let mut choices = Vec::new();
    if let Ok(name) = std::env::var("TRIALS_VARIANT") {
        choices.push(find(&name).unwrap_or_else(|| panic!("TRIALS_VARIANT={name} is no variant")));
    } else if random.chance(SHARE) {
        let variants: Vec<_> = variants().collect();
        for _ in 0..=random.below(3) {
            let variant = random.pick(&variants);
            let others = &variant.alternatives[1..];
            let choice = (variant, &others[random.below(others.len())]);
            choices.retain(|(known, _): &Choice| known.key != variant.key);
            choices.push(choice);
        }
    }
    choices.retain(|choice| supports(axes, timing, choice));
    choices
}

fn find(name: &str) -> Option<Choice> {
    let (key, value) = name.split_once('=')?;
    let variant = variants().find(|variant| variant.key == key)?;
    Some((variant, variant.alternatives.iter().find(|alternative| alternative.value == value)?))
}

/// Returns whether the SDK supports this machine with such gateways (docs/ASSUMPTIONS.md).
fn supports(axes: &[AxisPlan], timing: &Timing, (variant, alternative): &Choice) -> bool {
    let is_scheduled = timing.clock.is_some();
    match (variant.key, alternative.value) {
        // The answers of four drives saturate the count of waiting frames.
        ("publishes_after_read", "true") => {
            axes.iter().all(|axis| axis.config.address.node.get() < 4)
        }
        // The frames of a cycle are served up to 1 ms after their phase.
        ("service_period_us", "1000") => !is_scheduled,
        // So are those that count from the pulse before.
        ("scheduled_pulse", "\"previous\"") => !is_scheduled,
        // A saturated count never shows room in the queue, for the heartbeat of the host, too.
        ("scheduled_pulse", "\"second\"") => timing.waiting_for_second_pulse(axes) + 1 < SATURATED,
        // The budgets stay at those of the device: two received frames in each service.
        ("missing_entries", "[\"0x8021\"]") => {
            axes.iter().all(|axis| axis.config.address.node.get() == 1)
        }
        _ => true,
    }
}

/// Period of gateways that serve their frames on a clock of their own; 0 for others.
pub fn service_period_ns(choices: &[Choice]) -> u64 {
    let period = choices.iter().find(|(variant, _)| variant.key == "service_period_us");
    period.map_or(0, |(_, alternative)| alternative.value.parse::<u64>().unwrap() * 1_000)
}

/// The configurations of such gateways.
pub fn gateway_configs(choices: &[Choice], count: usize) -> Vec<GatewayModelConfig> {
    let text = format!("[[gateway]]\n{}", toml(choices)).repeat(count);
    let scenario = Scenario::from_toml(&text, "variants", Path::new("."));
    let scenario = scenario.unwrap_or_else(|error| panic!("{text}{error}"));
    scenario.gateways.into_iter().map(|gateway| gateway.config).collect()
}

/// Returns whether an error names an assumption that such a gateway does not meet.
pub fn explains(choices: &[Choice], error: &str) -> bool {
    let mut words = error.split(|c: char| !c.is_ascii_alphanumeric());
    let rows = |row: &str| choices.iter().any(|(variant, _)| variant.assumptions.contains(&row));
    words.any(rows)
}
