//! Numbered frames as recorded on the bus: periods, losses, order.

use std::error::Error;
use std::path::Path;

use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::text::Printable;
use ecan_sim::BusFrame;

use ecan_tool_support::print_error_line;

use crate::log_file;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NumberedFrame {
    pub number: u64,
    /// Start on the bus, ns.
    pub time_ns: u64,
}

/// Number in the first 8 bytes of a frame with this CAN ID, little-endian.
pub fn number_of(frame: &CanFrame, id: CanId) -> Option<u64> {
    let bytes = frame.data().first_chunk::<8>()?;
    (frame.id() == id).then(|| u64::from_le_bytes(*bytes))
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BusRecord {
    frames: Vec<NumberedFrame>,
    /// Resolution of the timestamps, ns.
    pub resolution_ns: u64,
}

impl BusRecord {
    /// Takes the recording of the simulated bus, without frames of other stations.
    pub fn from_simulation(frames: &[BusFrame], id: CanId) -> Self {
        let numbered = |sent: &BusFrame| {
            let number = number_of(&sent.frame, id).filter(|_| sent.is_from_channel)?;
            Some(NumberedFrame { number, time_ns: sent.start_ns })
        };
        Self { frames: frames.iter().filter_map(numbered).collect(), resolution_ns: 1 }
    }

    /// Reads an analyser's recording, without frames of other CAN IDs. The first frame of a number
    /// counts as sent, the others as its echo.
    pub fn from_log(path: &Path, id: CanId) -> Result<Self, Box<dyn Error>> {
        let log = log_file::read(path)?;
        log_file::losses(path, &log).iter().for_each(|loss| print_error_line!("{loss}"));
        let log = log.frames;
        let is_coarse = log.iter().all(|frame| frame.time_ns.is_multiple_of(1_000));
        let mut seen = std::collections::HashSet::new();
        let frames: Vec<_> = log
            .iter()
            .filter_map(|frame| {
                let number = number_of(&frame.frame, id)?;
                seen.insert(number).then_some(NumberedFrame { number, time_ns: frame.time_ns })
            })
            .collect();
        if frames.is_empty() {
            let (name, id) = (Printable(path.display()), id.raw());
            return Err(format!("{name} contains no numbered frame with CAN ID {id:03X}").into());
        }
        Ok(Self { frames, resolution_ns: if is_coarse { 1_000 } else { 1 } })
    }

    pub fn periods(&self, numbers: std::ops::Range<u64>) -> BusPeriods {
        let frames: Vec<_> =
            self.frames.iter().filter(|frame| numbers.contains(&frame.number)).copied().collect();
        let order_errors = frames.windows(2).filter(|pair| pair[1].number < pair[0].number);
        let periods = frames.windows(2).map(|pair| pair[1].time_ns.saturating_sub(pair[0].time_ns));
        BusPeriods {
            sent: numbers.end - numbers.start,
            order_errors: order_errors.count() as u64,
            periods_ns: periods.collect(),
            frames,
        }
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct BusPeriods {
    pub sent: u64,
    /// Frames that precede a frame with a smaller number.
    pub order_errors: u64,
    /// Periods from frame to frame, ns.
    pub periods_ns: Vec<u64>,
    pub frames: Vec<NumberedFrame>,
}

impl BusPeriods {
    pub fn received(&self) -> u64 {
        self.frames.len() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_show_losses_and_order_errors() {
        let frames = [(3, 10), (4, 20), (6, 30), (5, 41), (9, 50)]
            .map(|(number, time_ns)| NumberedFrame { number, time_ns })
            .to_vec();
        let record = BusRecord { frames, resolution_ns: 1 };
        let periods = record.periods(3..9);
        assert_eq!((periods.sent, periods.received(), periods.order_errors), (6, 4, 1));
        assert_eq!(periods.periods_ns, [10, 10, 11]);
        assert_eq!(record.periods(0..3).received(), 0);
    }
}
