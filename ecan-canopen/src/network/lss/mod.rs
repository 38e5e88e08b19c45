//! The LSS master of one channel (CiA 305).

mod command;
mod fault;
mod master;

pub use command::{LssCommand, LssResult};
pub use fault::{LssFailure, LssFault, LssStartError};
pub use master::{Lss, LssConfig, LssMaster};
