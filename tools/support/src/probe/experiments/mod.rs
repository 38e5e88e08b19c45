//! The experiments, one file per subject.

pub(super) mod channel_config;
pub(super) mod images;
pub(super) mod loopback;
pub(super) mod objects;
pub(super) mod schedule;
pub(super) mod service_time;
pub(super) mod startup;
pub(super) mod wired;
