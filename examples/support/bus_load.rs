//! Bus load, computed from the frames that the host sent and received.

use ecan_protocol::can::{CanFrame, FrameBits};

/// Sum of the frame times on one bus.
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
