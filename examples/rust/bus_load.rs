//! Bus load as the host can tell it: from the frames that it sent and received.

use ecan_protocol::{CanFrame, FrameKind};

/// Bits of a frame without stuffing, split by phase: at the nominal and at the data bit rate.
fn frame_bits(frame: &CanFrame) -> (u64, u64) {
    let id_bits = if frame.id().is_extended() { 32 } else { 12 };
    let data_bits = 8 * frame.data().len() as u64;
    // Start bit and identifier; end: CRC delimiter, acknowledge, end of frame, intermission.
    let (head, tail) = (1 + id_bits, 1 + 2 + 7 + 3);
    match frame.kind() {
        FrameKind::Data | FrameKind::Remote => (head + 6 + data_bits + 15 + tail, 0),
        FrameKind::Fd { brs, .. } => {
            let crc = if frame.data().len() > 16 { 21 } else { 17 };
            let body = 1 + 4 + data_bits + 4 + crc + (crc + 4) / 4;
            let (nominal, data) = (head + 4 + tail, body);
            if brs { (nominal, data) } else { (nominal + data, 0) }
        }
    }
}

/// Adds up the time that frames take on one bus.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BusLoad {
    nominal_bits: u64,
    data_bits: u64,
}

impl BusLoad {
    /// Counts a frame that was on the bus.
    pub fn add(&mut self, frame: &CanFrame) {
        let (nominal, data) = frame_bits(frame);
        self.nominal_bits += nominal;
        self.data_bits += data;
    }

    /// Share of `elapsed_ns` that the bus was busy, in percent, at least: stuff bits and the
    /// frames that other nodes exchanged unseen come on top.
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
    use ecan_protocol::CanId;

    #[test]
    fn a_classic_frame_has_47_bits_beside_its_data() {
        let id = CanId::standard(0x123).unwrap();
        let frame = CanFrame::classic(id, &[0; 8]).unwrap();
        assert_eq!(frame_bits(&frame), (47 + 64, 0));
        let id = CanId::extended(0x123).unwrap();
        let frame = CanFrame::classic(id, &[]).unwrap();
        assert_eq!(frame_bits(&frame), (67, 0));
    }

    #[test]
    fn a_full_bus_is_at_100_percent() {
        let mut load = BusLoad::default();
        let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[0; 8]).unwrap();
        for _ in 0..1000 {
            load.add(&frame);
        }
        let percent = load.percent(1_000_000, 1, 111_000_000);
        assert!((percent - 100.0).abs() < 1e-9, "{percent}");
    }
}
