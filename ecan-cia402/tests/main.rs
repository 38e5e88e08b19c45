//! All tests of the crate in one program; those that need a process of their own are separate.
#![allow(missing_docs)]

mod axes;
mod support;

mod axis_faults;
mod axis_modes;
mod axis_properties;
mod axis_start_up;
mod drive_units;
mod effective_limits;
mod enabling_after_stops;
mod feed_forward;
mod first_contact;
mod guarded_axes;
mod host_loss;
mod new_modes;
mod node_axes;
mod node_services;
mod observer;
mod process_data;
mod skipped_cycles;
mod start_up_trace;
mod stop_together;
mod stops;
mod target_period;
