//! Losses between the CAN controllers and the process data (manual 13.2.1, 13.2.2, 13.2.5).

use ecan_protocol::ApplyStatus;

use crate::finding::{Finding, Place};
use crate::snapshot::Snapshot;

pub(super) fn findings(snapshot: &Snapshot, channel: u8) -> Vec<Finding> {
    let number = u16::from(channel);
    let place = Place::Channel(channel);
    let control = |subindex| snapshot.get(0x8021 + number, subindex);
    let diagnosis = |subindex| snapshot.get(0x9020 + number, subindex).unwrap_or(0);
    let mut found = Vec::new();

    if let Some(raw) = control(3).filter(|raw| *raw != 0) {
        let status = ApplyStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
        let what = format!("the data path policy was not applied: {status}");
        found.push(
            Finding::fault("data-path-apply", place, what)
                .because(&["a value of 0x8021 to 0x8024 is out of its range, or min is above max"])
                .so("correct it, write :02 = 1 and read :03 again", "13.2.2"),
        );
    }
    if control(1) == Some(0) {
        found.push(
            Finding::warning("data-path-off", place, "the data path policy is disabled")
                .because(&["0x8021:01 is 0, so that budgets and policies are the firmware's own"])
                .so("write :01 = 1 and apply", "13.2.2"),
        );
    }
    let (dropped, critical) = (diagnosis(5), diagnosis(8));
    if dropped != 0 {
        let (old, new) = (diagnosis(6), diagnosis(7));
        let depth = diagnosis(2);
        let what = format!(
            "the RX cache dropped {dropped} frames ({old} old, {new} new, {critical} critical), \
             {depth} waited at most"
        );
        found.push(
            Finding::warning("rx-cache-drop", place, what)
                .because(&[
                    "the TxPDO takes fewer frames per cycle than the bus brings: N or cycle",
                    "the drain budget 0x8021:05 is too small",
                    "the RX cache 0x8021:07 is too shallow for bursts",
                ])
                .so("plan the traffic with `ecan plan`; raise 0x8021:05, :07 and N", "13.2.5"),
        );
    }
    let (full, stale) = (diagnosis(11), diagnosis(12));
    if full != 0 || stale != 0 {
        let what =
            format!("the transmit FIFO was full {full} times, {stale} stale frames were dropped");
        found.push(
            Finding::warning("tx-fifo-full", place, what)
                .because(&[
                    "the host sends more frames than the bus carries",
                    "the channel was bus-off or nobody acknowledged",
                    "the transmit FIFO is small (0x8001:70)",
                ])
                .so("look for bus errors first, then plan the load with `ecan plan`", "13.2.5"),
        );
    }
    let degraded = diagnosis(15);
    if degraded != 0 {
        let what = format!("the data path is degraded or protected (0x{degraded:X})");
        found.push(
            Finding::fault("data-path-degraded", place, what)
                .because(&[
                    "the receive path overflowed for long (0x8021:16)",
                    "the transmit path was congested for long",
                    "the channel was bus-off and its policy keeps it so (0x8021:14)",
                ])
                .so("mend the cause, then apply the channel again", "13.2.5"),
        );
    }
    found
}
