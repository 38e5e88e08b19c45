//! The table at the end of a run.

use std::fmt::Write;

use ecan_mcan_port::Port;

use crate::bus_load::BusLoad;

/// Bit rates and time of the run, for the bus load.
#[derive(Debug, Clone, Copy)]
pub struct Run {
    /// Nominal bit rate in bit/s.
    pub nominal_bitrate: u32,
    /// Data bit rate in bit/s; the nominal one without bit rate switch.
    pub data_bitrate: u32,
    /// Length of the run in nanoseconds.
    pub elapsed_ns: u64,
    /// Length of a cycle in nanoseconds.
    pub cycle_ns: u32,
}

/// The summary of a Port, with the loads of its channels in the order of slave and channel.
pub fn table(port: &Port, run: Run, loads: &[BusLoad]) -> String {
    let mut text = String::new();
    let seconds = run.elapsed_ns as f64 / 1e9;
    // Writing to a String cannot fail.
    let _ = writeln!(text, "\nran {seconds:.3} s, cycle {} us", run.cycle_ns / 1000);
    let _ = writeln!(
        text,
        "\n{:<14}{:>10}{:>10}{:>10}{:>10}{:>12}{:>10}",
        "channel", "sent", "delivered", "received", "discarded", "refused", "bus load"
    );
    for slave in 0..port.slave_count() {
        let statistics = port.statistics(slave);
        let mask = port.config().gateways[slave].channel_mask();
        for (channel, count) in statistics.channels.iter().enumerate() {
            if mask >> channel & 1 == 0 {
                continue;
            }
            let load = loads.get(slave * statistics.channels.len() + channel);
            let percent = load.copied().unwrap_or_default().percent(
                run.nominal_bitrate,
                run.data_bitrate,
                run.elapsed_ns,
            );
            let refused =
                count.refused_image_full + count.refused_queue_full + count.refused_bus_off;
            let _ = writeln!(
                text,
                "{:<14}{:>10}{:>10}{:>10}{:>10}{:>12}{:>8.1} %",
                format!("slave {slave} can{channel}"),
                count.frames_sent,
                count.frames_delivered,
                count.frames_received,
                count.frames_discarded,
                refused,
                percent
            );
        }
    }
    let _ = writeln!(
        text,
        "\n{:<14}{:>10}{:>10}{:>10}{:>10}{:>12}{:>10}{:>10}",
        "gateway", "cycles", "wc miss", "images", "repeated", "rx images", "rx lost", "errors"
    );
    for slave in 0..port.slave_count() {
        let s = port.statistics(slave);
        let _ = writeln!(
            text,
            "{:<14}{:>10}{:>10}{:>10}{:>10}{:>12}{:>10}{:>10}",
            format!("slave {slave}"),
            s.cycles,
            s.incomplete_cycles,
            s.rxpdo_published,
            s.rxpdo_repeated,
            s.txpdo_received,
            s.txpdo_lost,
            s.parse_errors + s.txpdo_torn
        );
        if s.sessions_lost > 0 || s.txpdo_incomplete > 0 {
            let _ = writeln!(
                text,
                "{:<14}out of service {} time(s), incomplete images {}",
                "", s.sessions_lost, s.txpdo_incomplete
            );
        }
    }
    text
}
