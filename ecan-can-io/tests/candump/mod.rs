//! Logs, screens and frames of candump.

mod grammar;
mod screen;
