//! Simulated gateways in stepped time.

use ecan_host::{Diagnostics, Ecrt};
use ecan_mcan_port::Config;
use ecan_sim::{ClockKind, Scenario, SimOptions, Simulation, echo, open_scenario};

pub const MS: u64 = 1_000_000;

/// Two gateways: the second with CAN FD, filters, and policies of its own.
pub const TWO: &str = r#"
cycle_us = 2000
[[gateway]]
n = 3
can0 = { bitrate = 250_000 }
[[gateway]]
rx_pdo = { n = 2, budget = "deterministic" }
tx_pdo = { n = 4, profile = 1, options = ["tx_result"] }
data_path = { max_service_budget_us = 700 }
[gateway.can1]
bitrate = 1_000_000
data_bitrate = 4_000_000
sample_point = 80
traffic = { received = 4, sent = 2 }
ram = { rx_fifo1_mode = "overwrite" }
data_path = { rx_overflow = "drop_oldest", degraded_threshold = 20 }
[[gateway.can1.standard_filter]]
match = "range"
action = "fifo0"
id1 = 0x100
id2 = 0x200
[[gateway.can1.standard_filter]]
match = "two"
action = "fifo1"
id1 = 0x300
id2 = 0x301
[[gateway.can1.extended_filter]]
match = "masked"
action = "reject"
id1 = 0x1000
id2 = 0x1F00
[gateway.can3]
bitrate = 500_000
"#;

pub fn two() -> Config {
    ecan_lite::config::parse(TWO.as_bytes()).unwrap()
}

pub struct Fixture {
    pub ecrt: Ecrt,
    pub simulation: Simulation,
    pub bus: Diagnostics,
}

pub fn fixture(gateways: usize) -> Fixture {
    with(echo(gateways))
}

pub fn with(scenario: Scenario) -> Fixture {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = open_scenario(scenario, &options).unwrap();
    let bus = Diagnostics::of_bus(&backend.ecrt, 0).unwrap();
    Fixture { ecrt: backend.ecrt, simulation: backend.simulation.unwrap(), bus }
}
