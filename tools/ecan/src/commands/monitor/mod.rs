//! `ecan monitor`: live view of gateways, channels and cycle.

mod collector;
mod command;
mod cycle_times;
mod id_table;
mod keys;
mod observation;
mod port_source;
mod screen;
mod service_source;
mod snapshot;
mod terminal;
#[cfg(test)]
mod test_snapshots;
mod text;
mod views;

pub use command::{EXAMPLES, MonitorArguments, run};
