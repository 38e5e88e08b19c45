//! Flags and states of the gateway as a whole (manual 13.2.1, 13.3, 13.7).

use ecan_protocol::device::{AccessMode, MaintenanceStatus};

use crate::diagnostic_flags::DIAGNOSTIC_FLAGS;
use crate::finding::{Finding, Location};
use crate::snapshot::Snapshot;

pub(super) fn findings(snapshot: &Snapshot) -> Vec<Finding> {
    let mut found = Vec::new();
    found.extend(flags(snapshot));
    let value = |index, subindex| snapshot.get(index, subindex).filter(|value| *value != 0);
    if let Some(status) = value(0x8020, 3) {
        let what = format!("the global data path control was not applied: status {status}");
        found.push(
            Finding::fault("data-path-global", Location::Device, what)
                .because(&["a value of 0x8020 is out of its range"])
                .so("correct it, write 0x8020:02 = 1 and read :03 again", "13.2.1"),
        );
    }
    if let Some(status) = value(0x8000, 15) {
        let what = format!("the rotation of the CAN pins was not applied: status {status}");
        found.push(
            Finding::fault("pin-rotation", Location::Device, what)
                .because(&["it was written in OP", "the rotation is not in 0x8000:14"])
                .so("stop the application and use `ecan pins ROTATION`", "13.3"),
        );
    }
    if let Some(result) = value(0x8000, 11) {
        let what = format!("the system configuration was not applied: result {result}");
        found.push(
            Finding::fault("system-apply", Location::Device, what)
                .because(&["the firmware refused a value of 0x8000"])
                .so("read 0x8000 and write it again, or restore the factory's values", "13.3"),
        );
    }
    found.extend(maintenance(snapshot));
    found
}

/// One finding for each kind of cause; the flags stay until they are cleared.
fn flags(snapshot: &Snapshot) -> Vec<Finding> {
    let Some(flags) = snapshot.get(0xB000, 6) else { return Vec::new() };
    let group = |id, mask: u32, causes: &[&str], next: &str| {
        let set = flags & mask;
        let told: Vec<_> = DIAGNOSTIC_FLAGS
            .iter()
            .filter(|(bit, ..)| set >> bit & 1 == 1)
            .map(|(_, name, words)| format!("{words} ({name})"))
            .collect();
        (set != 0).then(|| {
            Finding::warning(id, Location::Device, told.join(", ")).because(causes).so(next, "13.7")
        })
    };
    let known = DIAGNOSTIC_FLAGS.iter().fold(0, |mask, (bit, ..)| mask | 1 << bit);
    let groups = [
        group(
            "flag-tx-pdo",
            0b111,
            &[
                "the master reads SM3 more often than the firmware fills it",
                "N changed in operation",
            ],
            "compare the EtherCAT cycle with 0x9011:09; change N in PREOP only",
        ),
        group(
            "flag-rx-pdo",
            1 << 3,
            &["the master writes SM2 more often than the firmware serves it"],
            "lengthen the EtherCAT cycle, or look at 0x9011:08",
        ),
        group(
            "flag-transmit",
            0b11 << 4,
            &[
                "the host sends more frames than the buses carry",
                "a bus has errors, so that frames wait",
            ],
            "look at the channels first, then plan the load with `ecan plan`",
        ),
        group(
            "flag-schedule-late",
            1 << 6 | 1 << 9,
            &[
                "the offset behind Sync0 is too small (manual: 100 us and more)",
                "the DC shift is too small, or the host's cycle jitters",
            ],
            "enlarge the offset or the shift; a sweep of the phase tells better times",
        ),
        group(
            "flag-schedule-full",
            1 << 7 | 1 << 8,
            &["more scheduled frames than the gateway holds", "the bus of the frames has errors"],
            "schedule fewer frames in a period; look at the channel",
        ),
    ];
    let mut found: Vec<_> = groups.into_iter().flatten().collect();
    if flags & !known != 0 {
        let what = format!("0xB000:06 has bits that the manual does not name: 0x{flags:04X}");
        found.push(
            Finding::warning("flag-unknown", Location::Device, what)
                .because(&["a firmware that is newer than this program"])
                .so("compare with the manual of the firmware", "13.7"),
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
                "ask for the access mode in PREOP and give the command again",
            ),
            MaintenanceStatus::CrcError | MaintenanceStatus::ImageInvalid => (
                &[
                    "nothing was saved since the factory's configuration was restored",
                    "power failed while the gateway saved, or another firmware did",
                ],
                "save the configuration anew with `ecan config save`, or restore the factory's",
            ),
            MaintenanceStatus::Busy => (
                &["two programs maintain the gateway at once"],
                "wait until 0xB000:12 counts, then give the command again",
            ),
            _ => (
                &["the Flash is worn out or damaged"],
                "give the command again; if it fails, send a bundle to the support",
            ),
        };
        found.push(
            Finding::warning("maintenance-status", Location::Device, what)
                .because(causes)
                .so(next, "13.7"),
        );
    }
    if let Some(mode) = snapshot.get(0xB000, 2).filter(|mode| *mode != 0) {
        let known = u8::try_from(mode).ok().and_then(AccessMode::from_raw);
        let what = match known {
            Some(mode) => format!("{mode} mode is active"),
            None => format!("access mode {mode} is active, which the manual does not name"),
        };
        found.push(
            Finding::warning("access-mode", Location::Device, what)
                .because(&["somebody is at work on the gateway, or did not give the mode back"])
                .so("write 0xB000:01 = 0 when nobody is", "13.7"),
        );
    }
    found
}
