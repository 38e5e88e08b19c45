//! Experiments on a connected gateway that decide the assumptions of docs/ASSUMPTIONS.md.
//!
//! [`Probe`] runs the experiments of [`experiments`] in a safe order, stage by stage: reading in the present
//! state, PREOP, OP with images without frames, loopback inside the controller, and frames between two wired
//! channels. Each decides one assumption, or states why it cannot. They use the master only, so that they run on
//! a real gateway and on a simulated one alike. Nothing is written to the Flash. The caller restores the
//! configuration afterwards.

mod catalogue;
mod experiments;
mod outcome;
mod run;
mod sdo;
mod session;

pub use catalogue::{Experiment, Finding, UNDECIDABLE, Undecidable, experiments};
pub use ecan_lite::config::DeviceProfile;
pub use outcome::{Interruption, Outcome, Stage, Verdict};
pub use run::{Probe, ProbeOptions};
