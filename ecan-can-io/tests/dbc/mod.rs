//! Signals of DBC files.

mod faults;
mod python_peers;
mod signals;
