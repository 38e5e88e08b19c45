//! `ecan diag`: problems of a gateway, with causes and remedies (manual 16).

mod bundle;
mod command;
mod report;

pub use command::{DiagArguments, record, run};
