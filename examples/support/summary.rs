//! Table at the end of a run.

use std::fmt::Write;

use ecan_mcan_port::Port;
use ecan_protocol::can::{CanFrame, FrameBits};

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

/// Sum of the times of the frames on one bus that the host sent and received.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BusLoad {
    nominal_bits: u64,
    data_bits: u64,
}

impl BusLoad {
    /// Adds a frame that was on the bus.
    pub fn add(&mut self, frame: &CanFrame) {
        let bits = FrameBits::least(frame.as_ref());
        self.nominal_bits += u64::from(bits.nominal);
        self.data_bits += u64::from(bits.data);
    }

    /// Lower limit of the bus load during `elapsed_ns`, in percent: stuff bits and frames between other
    /// nodes are not included.
    pub fn percent(&self, nominal_bitrate: u32, data_bitrate: u32, elapsed_ns: u64) -> f64 {
        if elapsed_ns == 0 {
            return 0.0;
        }
        let seconds = self.nominal_bits as f64 / f64::from(nominal_bitrate.max(1))
            + self.data_bits as f64 / f64::from(data_bitrate.max(1));
        100.0 * seconds / (elapsed_ns as f64 / 1e9)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_protocol::can::CanId;

    #[test]
    fn full_bus_has_a_load_of_100_percent() {
        let mut load = BusLoad::default();
        let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[0; 8]).unwrap();
        for _ in 0..1000 {
            load.add(&frame);
        }
        let percent = load.percent(1_000_000, 1, 111_000_000);
        assert!((percent - 100.0).abs() < 1e-9, "{percent}");
    }
}
