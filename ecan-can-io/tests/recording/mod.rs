//! Recordings of several programs.

mod binary;
mod formats;
