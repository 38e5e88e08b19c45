//! Losses between the CAN controllers and the process data (manual 13.2.1, 13.2.2, 13.2.5).

use ecan_protocol::config::ApplyStatus;

use crate::finding::{Finding, Location};
use crate::snapshot::{ObjectKey, Snapshot};

pub(super) fn findings(snapshot: &Snapshot, channel: u8) -> Vec<Finding> {
    let number = u16::from(channel);
    let place = Location::Channel(channel);
    let object = 0x8021 + number;
    let control = |subindex| snapshot.get(object, subindex);
    let entry = |subindex| ObjectKey { index: object, subindex };
    let diagnosis = |subindex| snapshot.get(0x9020 + number, subindex).unwrap_or(0);
    let mut found = Vec::new();

    if let Some(raw) = control(3).filter(|raw| *raw != 0) {
        let status = ApplyStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
        let what = format!("the data path policy was not applied: {status}");
        found.push(
            Finding::fault("data-path-apply", place, what)
                .or_because(format!(
                    "a value of 0x{object:04X} is out of its range, or min is above max"
                ))
                .so(
                    format!("correct it, write {} = 1 and read {} again", entry(2), entry(3)),
                    "13.2.2",
                ),
        );
    }
    if control(1) == Some(0) {
        found.push(
            Finding::warning("data-path-off", place, "the data path policy is disabled")
                .or_because(format!(
                    "{} is 0, so that budgets and policies are the firmware's own",
                    entry(1)
                ))
                .so(format!("write {} = 1 and apply ({} = 1)", entry(1), entry(2)), "13.2.2"),
        );
    }
    let told = |subindex| snapshot.number(0x9020 + number, subindex);
    let dropped = diagnosis(5);
    if dropped != 0 {
        let (old, new, critical, depth) = (told(6), told(7), told(8), told(2));
        let what = format!(
            "the RX cache dropped {dropped} frames ({old} old, {new} new, {critical} critical), \
             {depth} waited at most"
        );
        found.push(
            Finding::warning("rx-cache-drop", place, what)
                .because(&[
                    "the TxPDO takes fewer frames per cycle than the bus brings: N or cycle",
                ])
                .or_because(format!("the drain budget {} is too small", entry(5)))
                .or_because(format!("the RX cache {} is too shallow for bursts", entry(7)))
                .so(
                    format!("plan the traffic with `ecan plan`; raise {}, :07 and N", entry(5)),
                    "13.2.5",
                ),
        );
    }
    let (full, stale) = (diagnosis(11), diagnosis(12));
    if full != 0 || stale != 0 {
        let (full, stale) = (told(11), told(12));
        let what =
            format!("the transmit FIFO was full {full} times, {stale} stale frames were dropped");
        found.push(
            Finding::warning("tx-fifo-full", place, what)
                .because(&[
                    "the host sends more frames than the bus carries",
                    "the channel was bus-off or nobody acknowledged",
                ])
                .or_because(format!(
                    "the transmit FIFO is small ({})",
                    ObjectKey { index: 0x8001 + number, subindex: 70 }
                ))
                .so("look for bus errors first, then plan the load with `ecan plan`", "13.2.5"),
        );
    }
    let degraded = diagnosis(15);
    if degraded != 0 {
        let what = format!("the data path is degraded or protected (0x{degraded:X})");
        found.push(
            Finding::fault("data-path-degraded", place, what)
                .or_because(format!("the receive path overflowed for long ({})", entry(16)))
                .because(&["the transmit path was congested for long"])
                .or_because(format!(
                    "the channel was bus-off and its policy keeps it so ({})",
                    entry(14)
                ))
                .so(
                    format!(
                        "mend the cause, then apply the channel again (0x{:04X}:01 = 1)",
                        0x8001 + number
                    ),
                    "13.2.5",
                ),
        );
    }
    found
}
