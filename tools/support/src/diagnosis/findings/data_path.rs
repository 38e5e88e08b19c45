//! Findings of losses between CAN controllers and process data (manual 13.2.1, 13.2.2, 13.2.5).

use ecan_protocol::config::ApplyStatus;

use crate::diagnosis::finding::{Finding, Location};
use crate::diagnosis::snapshot::{ObjectKey, Snapshot};

pub(super) fn findings(snapshot: &Snapshot, channel: u8) -> Vec<Finding> {
    let number = u16::from(channel);
    let (object, config, diagnosis) = (0x8021 + number, 0x8001 + number, 0x9020 + number);
    let fault = |id, what: String| Finding::fault(id, Location::Channel(channel), what);
    let warning = |id, what: String| Finding::warning(id, Location::Channel(channel), what);
    let control = |subindex| snapshot.get(object, subindex);
    let [enable, apply, status, budget, cache, policy, overflow] =
        [1, 2, 3, 5, 7, 14, 16].map(|subindex| ObjectKey { index: object, subindex });
    let count = |subindex| snapshot.get(diagnosis, subindex).unwrap_or(0);
    let text_of = |subindex| snapshot.number(diagnosis, subindex);
    let mut found = Vec::new();

    if let Some(raw) = control(3).filter(|raw| *raw != 0) {
        let result = ApplyStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
        let next = format!("correct it, write {apply} = 1 and read {status} again");
        let finding = fault("data-path-apply", format!("data path policy not applied: {result}"))
            .cause(format!("a value of 0x{object:04X} is out of range, or min is above max"));
        found.extend(finding.next_step(next, "13.2.2"));
    }
    if control(1) == Some(0) {
        let next = format!("write {enable} = 1 and apply ({apply} = 1)");
        let finding = warning("data-path-off", "the data path policy is disabled".to_owned())
            .cause(format!("{enable} is 0: the firmware uses its own budgets and policies"));
        found.extend(finding.next_step(next, "13.2.2"));
    }
    let dropped = count(5);
    if dropped != 0 {
        let (old, new, critical, depth) = (text_of(6), text_of(7), text_of(8), text_of(2));
        let what = format!(
            "the RX cache dropped {dropped} frames ({old} old, {new} new, {critical} critical), \
             {depth} waited at most"
        );
        let next = format!("plan the traffic with `ecan plan`; raise {budget}, :07 and N");
        let finding = warning("rx-cache-drop", what)
            .cause("more frames per cycle on the bus than fit into the TxPDO: check N and cycle")
            .cause(format!("the drain budget {budget} is too small"))
            .cause(format!("the RX cache {cache} is too small for bursts"));
        found.extend(finding.next_step(next, "13.2.5"));
    }
    if count(11) != 0 || count(12) != 0 {
        let (full, stale) = (text_of(11), text_of(12));
        let what =
            format!("the transmit FIFO was full {full} times, {stale} stale frames were dropped");
        let next = "check for bus errors first, then plan the load with `ecan plan`";
        let finding = warning("tx-fifo-full", what)
            .cause("the host sends more frames than the bit rate allows")
            .cause("the channel was bus-off or got no acknowledgement")
            .cause(format!("the transmit FIFO is small (0x{config:04X}:70)"));
        found.extend(finding.next_step(next, "13.2.5"));
    }
    let degraded = count(15);
    if degraded != 0 {
        let what = format!("the data path is degraded or protected (0x{degraded:X})");
        let next =
            format!("remove the cause, then apply the channel again (0x{config:04X}:01 = 1)");
        let finding = fault("data-path-degraded", what)
            .cause(format!("the receive path overflowed for a long time ({overflow})"))
            .cause("the transmit path was congested for a long time")
            .cause(format!("the channel was bus-off and its policy keeps it off ({policy})"));
        found.extend(finding.next_step(next, "13.2.5"));
    }
    found
}
