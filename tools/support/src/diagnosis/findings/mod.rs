//! Findings by chapter of the manual.

mod bus_error;
mod channel;
mod channel_command;
mod channel_setting;
mod data_path;
mod device;
mod operation;
mod process_data;

use ecan_protocol::mapping::CHANNELS;

use crate::diagnosis::finding::Finding;
use crate::diagnosis::snapshot::Snapshot;

/// Returns all findings of a snapshot: faults before warnings, then by possible causality:
/// EtherCAT, process data, CAN, device.
///
/// A gateway in PREOP without error has no findings.
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
