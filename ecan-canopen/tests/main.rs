//! Tests of CANopen.

mod allocation;
mod boot_up;
mod device_files;
mod link;
mod lss_master;
mod over_gateway;
mod python_peer;
mod python_peers;
mod reference;
mod sdo_false_servers;
mod sdo_faults;
mod sdo_frames;
mod sdo_transfers;
mod services;

use ecan_test_support::CountingAllocator;

// Counts by thread, so that tests beside each other do not disturb.
#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;
