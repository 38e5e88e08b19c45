//! Recordings of several programs.

mod formats;
