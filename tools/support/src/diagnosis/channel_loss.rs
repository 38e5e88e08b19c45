//! Findings of frames that a channel lost, in the CAN controller and on the way to the process data (manual
//! 13.2.1, 13.2.2, 13.2.5, 13.5).

use ecan_protocol::config::ApplyStatus;

use crate::diagnosis::channel::Channel;
use crate::diagnosis::finding::Finding;
use crate::diagnosis::registers::{
    EventFifoStatus, Interrupts, ReceiveFifoStatus, TransmitQueueStatus,
};

pub(super) fn findings(channel: &Channel<'_>) -> Vec<Finding> {
    let checks = [receive_losses, transmit_pressure, event_losses, message_ram];
    let mut found: Vec<_> = checks.into_iter().filter_map(|check| check(channel)).collect();
    found.extend(data_path(channel));
    found
}

fn receive_losses(channel: &Channel<'_>) -> Option<Finding> {
    let interrupts = Interrupts(channel.information(3).unwrap_or(0));
    let (fifo0, fifo1) = interrupts.lost();
    let lost = |subindex| ReceiveFifoStatus::from_raw(channel.information(subindex).unwrap_or(0));
    let fifos = [fifo0 || lost(4).has_lost, fifo1 || lost(5).has_lost];
    let dropped = channel.information(13).unwrap_or(0);
    if dropped == 0 && fifos == [false, false] {
        return None;
    }
    let mut what = Vec::new();
    if dropped != 0 {
        what.push(format!("{dropped} received frames were dropped before the TxPDO"));
    }
    for (number, _) in fifos.iter().enumerate().filter(|(_, has_lost)| **has_lost) {
        what.push(format!("RX FIFO{number} lost a frame"));
    }
    let budget = channel.data_path_entry(5);
    let next = format!("plan the traffic with `ecan plan`; raise {budget} and N, or set filters");
    channel
        .warning("receive-loss", what.join(", "))
        .cause(format!("more frames per cycle on the bus than the drain budget ({budget})"))
        .causes(&[
            "the TxPDO is too small (0x8010:16)",
            "the gateway is not in OP: no process data exchange",
            "the filters pass unneeded frames",
        ])
        .next_step(next, "16.3")
}

fn transmit_pressure(channel: &Channel<'_>) -> Option<Finding> {
    let count = channel.information(14).unwrap_or(0);
    let queue = TransmitQueueStatus::from_raw(channel.information(6).unwrap_or(0));
    if count == 0 && !(queue.is_full && channel.is_running()) {
        return None;
    }
    let what = match count {
        0 => "the transmit FIFO is full".to_owned(),
        _ => format!("the transmit queue was full {count} times"),
    };
    channel
        .warning("transmit-pressure", what)
        .causes(&[
            "the host sends more frames than the bit rate allows",
            "no acknowledgement: the first frame is repeated forever",
            "frames with higher priority occupy the bus",
        ])
        .next_step("check for bus errors first, then plan the load with `ecan plan`", "16.3")
}

fn event_losses(channel: &Channel<'_>) -> Option<Finding> {
    let events = EventFifoStatus::from_raw(channel.information(7).unwrap_or(0));
    let flags = channel.information(3).unwrap_or(0);
    if !events.has_lost && flags >> 15 & 1 == 0 {
        return None;
    }
    let [events, queue, apply] = [73, 70, 1].map(|subindex| channel.config_entry(subindex));
    channel
        .warning("event-loss", "transmit events were lost: transmit results are missing")
        .cause("the transmit event FIFO has fewer elements than the transmit FIFO")
        .next_step(format!("set {events} to at least {queue} and apply ({apply} = 1)"), "13.4")
}

fn message_ram(channel: &Channel<'_>) -> Option<Finding> {
    let interrupts = Interrupts(channel.information(3)?);
    if !interrupts.has_ram_failure() {
        return None;
    }
    channel
        .fault("message-ram", format!("the Message RAM failed: {interrupts}"))
        .causes(&["a hardware fault", "registers were written manually"])
        .next_step("power-cycle; if it recurs, send a bundle to support", "16.3")
}

/// Losses between the CAN controller and the process data.
fn data_path(channel: &Channel<'_>) -> Vec<Finding> {
    let (snapshot, number) = (channel.snapshot, u16::from(channel.number));
    let (object, config, diagnosis) = (0x8021 + number, channel.config_object(), 0x9020 + number);
    let control = |subindex| snapshot.get(object, subindex);
    let [enable, apply, status, budget, cache, policy, overflow] =
        [1, 2, 3, 5, 7, 14, 16].map(|subindex| channel.data_path_entry(subindex));
    let count = |subindex| snapshot.get(diagnosis, subindex).unwrap_or(0);
    let text_of = |subindex| snapshot.number(diagnosis, subindex);
    let mut found = Vec::new();

    if let Some(raw) = control(3).filter(|raw| *raw != 0) {
        let result = ApplyStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
        let next = format!("correct it, write {apply} = 1 and read {status} again");
        let finding = channel
            .fault("data-path-apply", format!("data path policy not applied: {result}"))
            .cause(format!("a value of 0x{object:04X} is out of range, or min is above max"));
        found.extend(finding.next_step(next, "13.2.2"));
    }
    if control(1) == Some(0) {
        let next = format!("write {enable} = 1 and apply ({apply} = 1)");
        let finding = channel
            .warning("data-path-off", "the data path policy is disabled")
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
        let finding = channel
            .warning("rx-cache-drop", what)
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
        let finding = channel
            .warning("tx-fifo-full", what)
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
        let finding = channel
            .fault("data-path-degraded", what)
            .cause(format!("the receive path overflowed for a long time ({overflow})"))
            .cause("the transmit path was congested for a long time")
            .cause(format!("the channel was bus-off and its policy keeps it off ({policy})"));
        found.extend(finding.next_step(next, "13.2.5"));
    }
    found
}
