//! Tests of the MCAN Port.
#![allow(missing_docs)]

mod common;
mod plan_support;
mod schedule_support;
#[path = "../../ecan-sim/tests/wire_support/mod.rs"]
mod wire_support;

mod accounts;
mod allocation;
mod attached;
mod both_fronts;
mod bus_watch;
mod channel_masks;
mod exchange;
mod faults;
mod gateway_variants;
mod gateways_return;
mod link_losses;
mod listen_only;
mod log_events;
mod observer;
mod plan;
mod plan_schedule;
mod reconfiguration;
mod schedule_account;
mod schedule_faults;
mod schedule_lateness;
mod schedule_pace;
mod scheduling;
mod scheduling_periods;
mod sequence_wrap;
mod session_histories;
mod sharing;
mod startup;
mod sync0_window;
mod transmit_results;
mod verification_faults;

use ecan_test_support::CountingAllocator;

// Counts by thread, so that tests beside each other do not disturb.
#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;
