//! Experiments on a connected gateway that decide the assumptions of docs/ASSUMPTIONS.md.
//!
//! [`Probe`] runs the experiments of [`experiments`] in a safe order, stage by stage: reading in the present
//! state, PREOP, OP with images without frames, loopback inside the controller, and frames between two wired
//! channels. Each decides one assumption, or states why it cannot. They use the master only, so that they run on
//! a real gateway and on a simulated one alike. Nothing is written to the Flash. The caller restores the
//! configuration afterwards.

mod experiment;
mod experiments;
mod finding;
mod inputs;
mod interruption;
mod measured;
mod outcome;
mod registers;
mod run;
mod runner;
mod sdo;
mod session;
mod setup;
mod stage;
mod undecidable;

pub use ecan_lite::config::DeviceProfile;
pub use experiment::Experiment;
pub use experiments::experiments;
pub use finding::Finding;
pub use interruption::Interruption;
pub use outcome::{Outcome, Verdict};
pub use run::{Probe, ProbeOptions};
pub use stage::Stage;
pub use undecidable::{UNDECIDABLE, Undecidable};
