//! What is amiss, chapter by chapter.

mod channel;
mod channel_command;
mod data_path;
mod device;
mod operation;
mod process_data;

use ecan_protocol::mapping::CHANNELS;

use crate::finding::Finding;
use crate::snapshot::Snapshot;

/// Everything that is amiss in a snapshot: faults before warnings, and among them what the others
/// may follow from first: EtherCAT, process data, CAN, device.
///
/// A gateway that waits in PREOP for its master, without an error, is well.
pub fn findings(snapshot: &Snapshot) -> Vec<Finding> {
    let mut found = operation::findings(snapshot);
    found.extend(process_data::findings(snapshot));
    for channel in 0..CHANNELS as u8 {
        found.extend(channel::findings(snapshot, channel));
        found.extend(data_path::findings(snapshot, channel));
    }
    found.extend(device::findings(snapshot));
    found.sort_by_key(|finding| finding.severity);
    found
}
