//! Experiments of the probe.

mod interruptions;
mod score;
mod wired;
