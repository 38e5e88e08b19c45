//! `ecan selftest`: production test of gateways.

mod command;
mod exchange;
mod gateways;
mod group;
mod in_service;
mod plan;
mod report;
mod test_bus;

pub use command::{EXAMPLES, run, test_one};
pub use plan::{SelftestArguments, Wiring};
pub use report::GatewayReport;
