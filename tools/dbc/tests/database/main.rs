//! DBC files: signals of frames, and faults.
#![allow(missing_docs)]

mod faults;
mod signals;
