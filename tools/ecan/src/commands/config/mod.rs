//! `ecan config`: configuration file of the gateways.

mod apply;
mod check;
mod command;
mod export;
mod flash;

pub use command::{ConfigArguments, run};
