//! The experiments, one file per subject.

mod bit_timing;
mod identity;
mod images;
mod loopback;
mod mailbox;
mod maintenance;
mod node_modes;
mod objects;
mod operation;
mod receive;
mod restart;
mod schedule;
mod service_loop;
mod states;
mod statuses;
mod sync0_window;
mod transceiver;
mod transmit;
mod wired;
mod wired_sample_point;

use crate::probe::experiment::Experiment;
use crate::probe::stage::Stage;

const GROUPS: &[&[Experiment]] = &[
    identity::EXPERIMENTS,
    objects::EXPERIMENTS,
    restart::EXPERIMENTS,
    node_modes::EXPERIMENTS,
    bit_timing::EXPERIMENTS,
    statuses::EXPERIMENTS,
    states::EXPERIMENTS,
    mailbox::EXPERIMENTS,
    maintenance::EXPERIMENTS,
    images::EXPERIMENTS,
    service_loop::EXPERIMENTS,
    operation::EXPERIMENTS,
    sync0_window::EXPERIMENTS,
    transmit::EXPERIMENTS,
    receive::EXPERIMENTS,
    schedule::EXPERIMENTS,
    wired::EXPERIMENTS,
    wired_sample_point::EXPERIMENTS,
    transceiver::EXPERIMENTS,
];

/// Every experiment, in the order in which they run.
pub fn experiments() -> impl Iterator<Item = &'static Experiment> {
    let all = || GROUPS.iter().copied().flatten();
    Stage::ALL.into_iter().flat_map(move |stage| all().filter(move |it| it.stage == stage))
}
