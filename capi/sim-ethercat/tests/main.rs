//! Tests of the simulated libethercat as a library of its own.

mod attached_owner;
mod loaded_at_run_time;
mod plain_master;
mod shared_library;
mod toolchain;
