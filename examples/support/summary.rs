//! Table at the end of a run.

use std::fmt::Write;

use ecan_mcan_port::Port;

use crate::bus_load::BusLoad;

/// Summary of a Port after `elapsed_ns`, with the loads of its channels ordered by slave and channel.
pub fn table(port: &Port, elapsed_ns: u64, loads: &[BusLoad]) -> String {
    let mut text = String::new();
    let seconds = elapsed_ns as f64 / 1e9;
    // Writing to a String cannot fail.
    let cycle_us = f64::from(port.adapter().config().cycle_ns()) / 1e3;
    let _ = writeln!(text, "\nran {seconds:.3} s, cycle {cycle_us} us");
    let _ = writeln!(
        text,
        "\n{:<14}{:>10}{:>10}{:>8}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}",
        "channel",
        "accepted",
        "delivered",
        "lost",
        "discarded",
        "unknown",
        "pending",
        "received",
        "not taken",
        "rejected",
        "bus load"
    );
    for gateway in port.gateways() {
        let slave = gateway.slave();
        let statistics = port.statistics(gateway);
        let channels = &port.config().gateways[slave].channels;
        for (channel, (count, settings)) in statistics.channels.iter().zip(channels).enumerate() {
            let Some(settings) = settings else { continue };
            let load = loads.get(slave * channels.len() + channel);
            let percent = load.copied().unwrap_or_default().percent(
                settings.can.nominal_bitrate,
                settings.can.data_bitrate,
                elapsed_ns,
            );
            let rejected =
                count.rejected_image_full + count.rejected_queue_full + count.rejected_bus_off;
            let _ = writeln!(
                text,
                "{:<14}{:>10}{:>10}{:>8}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}{:>8.1} %",
                format!("slave {slave} can{channel}"),
                count.frames_accepted,
                count.frames_delivered,
                count.frames_lost,
                count.frames_discarded,
                count.frames_unknown,
                count.frames_pending,
                count.frames_received,
                count.frames_not_taken,
                rejected,
                percent
            );
        }
    }
    let _ = writeln!(
        text,
        "\n{:<14}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}",
        "gateway",
        "cycles",
        "wc miss",
        "images",
        "repeated",
        "rx images",
        "rx lost",
        "rx disc.",
        "rx unkn.",
        "errors"
    );
    for gateway in port.gateways() {
        let s = port.statistics(gateway);
        let _ = writeln!(
            text,
            "{:<14}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}",
            gateway.to_string(),
            s.cycles,
            s.incomplete_cycles,
            s.rxpdo_published,
            s.rxpdo_repeated,
            s.txpdo_received,
            s.txpdo_lost,
            s.txpdo_discarded,
            s.txpdo_unknown,
            s.parse_errors + s.txpdo_torn
        );
        if s.sessions_lost > 0 || s.txpdo_incomplete > 0 {
            let _ = writeln!(
                text,
                "{:<14}session lost {} time(s), incomplete images {}",
                "", s.sessions_lost, s.txpdo_incomplete
            );
        }
    }
    text
}
