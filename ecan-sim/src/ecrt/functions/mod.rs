//! C interface of the simulated libethercat: the functions and their table.

#[macro_use]
mod boundary;
mod bus;
mod configuration;
mod opening;
mod process_data;
#[cfg(test)]
mod tests;

pub use bus::*;
pub use configuration::*;
pub use opening::*;
pub use process_data::*;
