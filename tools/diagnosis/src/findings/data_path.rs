//! Findings of losses between CAN controllers and process data (manual 13.2.1, 13.2.2, 13.2.5).

use ecan_protocol::config::ApplyStatus;

use crate::finding::{Finding, Location};
use crate::snapshot::{ObjectKey, Snapshot};

pub(super) fn findings(snapshot: &Snapshot, channel: u8) -> Vec<Finding> {
    let number = u16::from(channel);
    let place = Location::Channel(channel);
    let (object, config) = (0x8021 + number, 0x8001 + number);
    let control = |subindex| snapshot.get(object, subindex);
    let entry = |subindex| ObjectKey { index: object, subindex };
    let diagnosis = |subindex| snapshot.get(0x9020 + number, subindex).unwrap_or(0);
    let mut found = Vec::new();

    if let Some(raw) = control(3).filter(|raw| *raw != 0) {
        let status = ApplyStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
        let what = format!("data path policy not applied: {status}");
        found.extend(
            Finding::fault("data-path-apply", place, what)
                .cause(format!("a value of 0x{object:04X} is out of range, or min is above max"))
                .next_step(
                    format!("correct it, write {} = 1 and read {} again", entry(2), entry(3)),
                    "13.2.2",
                ),
        );
    }
    if control(1) == Some(0) {
        found.extend(
            Finding::warning("data-path-off", place, "the data path policy is disabled")
                .cause(format!("{} is 0: the firmware uses its own budgets and policies", entry(1)))
                .next_step(
                    format!("write {} = 1 and apply ({} = 1)", entry(1), entry(2)),
                    "13.2.2",
                ),
        );
    }
    let text_of = |subindex| snapshot.number(0x9020 + number, subindex);
    let dropped = diagnosis(5);
    if dropped != 0 {
        let (old, new, critical, depth) = (text_of(6), text_of(7), text_of(8), text_of(2));
        let what = format!(
            "the RX cache dropped {dropped} frames ({old} old, {new} new, {critical} critical), \
             {depth} waited at most"
        );
        found.extend(
            Finding::warning("rx-cache-drop", place, what)
                .cause(
                    "more frames per cycle on the bus than fit into the TxPDO: check N and cycle",
                )
                .cause(format!("the drain budget {} is too small", entry(5)))
                .cause(format!("the RX cache {} is too small for bursts", entry(7)))
                .next_step(
                    format!("plan the traffic with `ecan plan`; raise {}, :07 and N", entry(5)),
                    "13.2.5",
                ),
        );
    }
    let (full, stale) = (diagnosis(11), diagnosis(12));
    if full != 0 || stale != 0 {
        let (full, stale) = (text_of(11), text_of(12));
        let what =
            format!("the transmit FIFO was full {full} times, {stale} stale frames were dropped");
        found.extend(
            Finding::warning("tx-fifo-full", place, what)
                .causes(&[
                    "the host sends more frames than the bit rate allows",
                    "the channel was bus-off or got no acknowledgement",
                ])
                .cause(format!("the transmit FIFO is small (0x{config:04X}:70)"))
                .next_step(
                    "check for bus errors first, then plan the load with `ecan plan`",
                    "13.2.5",
                ),
        );
    }
    let degraded = diagnosis(15);
    if degraded != 0 {
        let what = format!("the data path is degraded or protected (0x{degraded:X})");
        found.extend(
            Finding::fault("data-path-degraded", place, what)
                .cause(format!("the receive path overflowed for a long time ({})", entry(16)))
                .cause("the transmit path was congested for a long time")
                .cause(format!(
                    "the channel was bus-off and its policy keeps it off ({})",
                    entry(14)
                ))
                .next_step(
                    format!(
                        "remove the cause, then apply the channel again (0x{config:04X}:01 = 1)"
                    ),
                    "13.2.5",
                ),
        );
    }
    found
}
