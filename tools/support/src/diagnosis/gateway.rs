//! Findings of a gateway: those of all subjects in their order, and those of the device itself (manual 13.2.1,
//! 13.3, 13.7).

use ecan_protocol::device::{AccessMode, MaintenanceStatus};
use ecan_protocol::mapping::CHANNELS;
use ecan_protocol::object::lookup;

use super::{Finding, Location, channel};
use crate::diagnosis::channel::Channel;
use crate::diagnosis::registers::set_names;
use crate::diagnosis::snapshot::Snapshot;
use crate::diagnosis::{channel_setting, operation, process_data};

/// Returns all findings of a snapshot: faults before warnings, then by possible causality:
/// EtherCAT, process data, CAN, device.
///
/// A gateway in PREOP without error has no findings.
pub fn findings(snapshot: &Snapshot) -> Vec<Finding> {
    let mut found = operation::findings(snapshot);
    found.extend(process_data::findings(snapshot));
    for channel in 0..CHANNELS as u8 {
        let channel = Channel::of(snapshot, channel);
        found.extend(channel::bus_findings(&channel));
        found.extend(channel_setting::findings(&channel));
        found.extend(channel::loss_findings(&channel));
    }
    found.extend(device(snapshot));
    found.sort_by_key(|finding| finding.severity);
    found
}

/// Flags of 0xB000:06: bit, name in the manual, description.
pub const DIAGNOSTIC_FLAGS: [(u8, &str, &str); 10] = [
    (0, "SHADOW_FALLBACK", "the TxPDO was published by the fallback path"),
    (1, "SHADOW_COPY_RETRY", "the copy of a TxPDO image was repeated"),
    (2, "SHADOW_SIZE_CHANGE", "the TxPDO size changed during publishing"),
    (3, "RXPDO_STAGE_DROP", "RxPDO data were dropped before parsing"),
    (4, "TX_RING_DROP", "the queue to the CAN controllers was full and dropped frames"),
    (5, "TX_FIFO_FULL", "the transmit FIFO of a CAN controller was full"),
    (6, "SCHED_LATE_DROP", "scheduled frames missed their phase and were dropped"),
    (7, "SCHED_QUEUE_FULL", "the queue of scheduled frames was full"),
    (8, "SCHED_TX_FAIL", "a CAN controller rejected a scheduled frame"),
    (9, "SCHED_TIMER_MISS", "the schedule timer was serviced too late"),
];

/// Names of the set flags in a value of 0xB000:06.
pub fn flag_names(flags: u32) -> Vec<&'static str> {
    lookup(0xB000, 6).map_or_else(Vec::new, |(_, entry)| set_names(flags, entry.bits))
}

fn device(snapshot: &Snapshot) -> Vec<Finding> {
    let mut found = Vec::new();
    found.extend(flags(snapshot));
    let value = |index, subindex| snapshot.get(index, subindex).filter(|value| *value != 0);
    if let Some(status) = value(0x8020, 3) {
        let what = format!("global data path control not applied: status {status}");
        found.extend(
            Finding::fault("data-path-global", Location::Device, what)
                .cause("a value of 0x8020 is out of range")
                .next_step("correct it, write 0x8020:02 = 1 and read :03 again", "13.2.1"),
        );
    }
    if let Some(status) = value(0x8000, 15) {
        let what = format!("rotation of the CAN pins not applied: status {status}");
        found.extend(
            Finding::fault("pin-rotation", Location::Device, what)
                .causes(&["it was written in OP", "the rotation is not in 0x8000:14"])
                .next_step("stop the application and use `ecan pins ROTATION`", "13.3"),
        );
    }
    if let Some(result) = value(0x8000, 11) {
        let what = format!("system configuration not applied: result {result}");
        found.extend(
            Finding::fault("system-apply", Location::Device, what)
                .cause("the firmware rejected a value of 0x8000")
                .next_step("read 0x8000 and write it again, or restore the factory values", "13.3"),
        );
    }
    found.extend(maintenance(snapshot));
    found
}

/// One finding per kind of cause; the flags stay set until they are cleared.
fn flags(snapshot: &Snapshot) -> Vec<Finding> {
    let Some(flags) = snapshot.get(0xB000, 6) else { return Vec::new() };
    let group = |id, mask: u32, causes: &[&str], next: &str| {
        let set = flags & mask;
        let texts: Vec<_> = DIAGNOSTIC_FLAGS
            .iter()
            .filter(|(bit, ..)| set >> bit & 1 == 1)
            .map(|(_, name, text)| format!("{text} ({name})"))
            .collect();
        if set == 0 {
            return None;
        }
        let finding = Finding::warning(id, Location::Device, texts.join(", ")).causes(causes);
        finding.next_step(next, "13.7")
    };
    let known = DIAGNOSTIC_FLAGS.iter().fold(0, |mask, (bit, ..)| mask | 1 << bit);
    let groups = [
        group(
            "flag-tx-pdo",
            0b111,
            &[
                "the master reads SM3 more often than the firmware fills it",
                "N was changed during operation",
            ],
            "compare the EtherCAT cycle with 0x9011:09; change N in PREOP only",
        ),
        group(
            "flag-rx-pdo",
            1 << 3,
            &["the master writes SM2 more often than the firmware processes it"],
            "increase the EtherCAT cycle, or check 0x9011:08",
        ),
        group(
            "flag-transmit",
            0b11 << 4,
            &[
                "the host sends more frames than the bit rates allow",
                "a bus has errors that delay frames",
            ],
            "check the channels first, then plan the load with `ecan plan`",
        ),
        group(
            "flag-schedule-late",
            1 << 6 | 1 << 9,
            &[
                "the offset after Sync0 is too small (manual: at least 100 us)",
                "the DC shift is too small, or the cycle of the host has jitter",
            ],
            "increase the offset or the shift; a phase sweep shows suitable values",
        ),
        group(
            "flag-schedule-full",
            1 << 7 | 1 << 8,
            &["more scheduled frames than the queue holds", "the bus of the frames has errors"],
            "schedule fewer frames per period; check the channel",
        ),
    ];
    let mut found: Vec<_> = groups.into_iter().flatten().collect();
    if flags & !known != 0 {
        let what = format!("0xB000:06 has unknown bits: 0x{flags:04X}");
        found.extend(
            Finding::warning("flag-unknown", Location::Device, what)
                .cause("the firmware is newer than this program")
                .next_step("compare with the manual of the firmware", "13.7"),
        );
    }
    found
}

fn maintenance(snapshot: &Snapshot) -> Vec<Finding> {
    let mut found = Vec::new();
    if let Some(raw) = snapshot.get(0xB000, 5).filter(|raw| *raw != 0) {
        let status = MaintenanceStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
        let what = format!("the last maintenance command ended with status {status}");
        let (causes, next): (&[&str], _) = match status {
            MaintenanceStatus::Denied => (
                &[
                    "the command needs engineering or factory mode (0xB000:01)",
                    "the gateway was in OP",
                ],
                "request the access mode in PREOP and repeat the command",
            ),
            MaintenanceStatus::CrcError | MaintenanceStatus::ImageInvalid => (
                &[
                    "no configuration saved since the factory reset",
                    "power failure while saving, or saved by another firmware",
                ],
                "save the configuration with `ecan config save`, or restore the factory configuration",
            ),
            MaintenanceStatus::Busy => (
                &["two programs access the maintenance object at the same time"],
                "wait until 0xB000:12 increases, then repeat the command",
            ),
            _ => (
                &["the Flash is worn out or damaged"],
                "repeat the command; if it fails, send a bundle to support",
            ),
        };
        found.extend(
            Finding::warning("maintenance-status", Location::Device, what)
                .causes(causes)
                .next_step(next, "13.7"),
        );
    }
    if let Some(mode) = snapshot.get(0xB000, 2).filter(|mode| *mode != 0) {
        let known = u8::try_from(mode).ok().and_then(AccessMode::from_raw);
        let what = match known {
            Some(mode) => format!("{mode} mode is active"),
            None => format!("unknown access mode {mode} is active"),
        };
        found.extend(
            Finding::warning("access-mode", Location::Device, what)
                .cause("maintenance is in progress, or a program did not restore the mode")
                .next_step("write 0xB000:01 = 0 if no maintenance is in progress", "13.7"),
        );
    }
    found
}
