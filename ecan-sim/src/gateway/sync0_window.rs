//! Outputs that arrive around a Sync0 pulse are missed by the firmware (manual 15.6.1, 16.1).
//!
//! The manual states the effect of outputs that are not there before Sync0, missing working counters
//! or the loss of OP, but no times; all values here are assumptions. The model: an image that is
//! complete within the window stays unread in SM2. The next write is therefore rejected, and the
//! service after it reads the image. So every second write is missing in the working counter while
//! all images arrive within the window.

use ecan_protocol::device::AlStatusCode;

use super::config::Sync0Window;
use super::pulse_train::PulseTrain;

/// Writes to SM2 against the pulses.
#[derive(Clone, Debug)]
pub(super) struct OutputTiming {
    window: Sync0Window,
    /// SM2 holds an image that the firmware has missed.
    pub(super) is_image_missed: bool,
    missed_in_a_row: u32,
}

impl OutputTiming {
    pub(super) fn new(window: Sync0Window) -> Self {
        Self { window, is_image_missed: false, missed_in_a_row: 0 }
    }

    pub(super) fn restart(&mut self) {
        *self = Self::new(self.window);
    }

    /// Returns true if outputs that are complete at this time are missed.
    fn is_missed(&self, pulses: Option<PulseTrain>, arrival: u64) -> bool {
        let Some(pulses) = pulses.filter(|_| !self.window.is_off()) else { return false };
        let has_begun = pulses.pulses_until(arrival) > 0;
        let ahead = pulses.next_after(arrival).saturating_sub(arrival);
        (has_begun && pulses.phase(arrival) < u64::from(self.window.after_ns))
            || ahead <= u64::from(self.window.before_ns)
    }

    /// A write to SM2 in OP that is complete at `arrival`. Returns true if it is missed.
    pub(super) fn outputs_written(&mut self, pulses: Option<PulseTrain>, arrival: u64) -> bool {
        self.is_image_missed = self.is_missed(pulses, arrival);
        self.count(self.is_image_missed);
        self.is_image_missed
    }

    /// A write to SM2 in OP that was rejected because the buffer is full. Returns true if the buffer
    /// holds a missed image: the firmware reads it in the next service.
    pub(super) fn write_rejected(&mut self, pulses: Option<PulseTrain>, arrival: u64) -> bool {
        if self.is_missed(pulses, arrival) {
            self.count(true);
        }
        std::mem::take(&mut self.is_image_missed)
    }

    fn count(&mut self, is_missed: bool) {
        self.missed_in_a_row = if is_missed { self.missed_in_a_row.saturating_add(1) } else { 0 };
    }

    /// AL status code if too many writes in a row were missed.
    pub(super) fn error(&self) -> Option<AlStatusCode> {
        let Sync0Window { missed_limit, al_status, .. } = self.window;
        (missed_limit > 0 && self.missed_in_a_row >= missed_limit).then_some(al_status)
    }
}

#[cfg(test)]
mod tests {
    use super::super::config::Sync0;
    use super::super::dc_clock::LinearClock;
    use super::*;

    /// Pulses at 1, 2, 3 ms and so on.
    fn pulses() -> Option<PulseTrain> {
        let sync0 = Sync0 { start_ns: 1_000_000, cycle_ns: 1_000_000, shift_ns: 0 };
        Some(PulseTrain::new(sync0, LinearClock::default(), 0))
    }

    #[test]
    fn window_lies_around_each_pulse() {
        let mut timing = OutputTiming::new(Sync0Window::default());
        let mut missed = |at| timing.outputs_written(pulses(), at);
        for pulse in [1_000_000, 7_000_000] {
            let at = |distance: i64| u64::saturating_add_signed(pulse, distance);
            assert!(!missed(at(-50_001)));
            assert!(missed(at(-50_000)) && missed(at(0)) && missed(at(19_999)));
            assert!(!missed(at(20_000)) && !missed(at(500_000)));
        }
        assert!(!missed(0) && !missed(900_000), "before the first pulse");
    }

    #[test]
    fn window_that_is_off_misses_nothing() {
        let mut timing = OutputTiming::new(Sync0Window::OFF);
        assert!(!timing.outputs_written(pulses(), 1_000_000));
        let mut timing = OutputTiming::new(Sync0Window::default());
        assert!(!timing.outputs_written(None, 1_000_000), "no pulses");
    }

    #[test]
    fn row_of_missed_writes_ends_with_a_write_in_time() {
        let window = Sync0Window { missed_limit: 3, ..Sync0Window::default() };
        let mut timing = OutputTiming::new(window);
        assert!(timing.outputs_written(pulses(), 1_000_000));
        assert!(timing.write_rejected(pulses(), 2_000_000), "holds the missed image");
        assert!(!timing.outputs_written(pulses(), 2_500_000));
        assert_eq!(timing.error(), None);
        for cycle in 3..5 {
            timing.outputs_written(pulses(), cycle * 1_000_000);
        }
        assert_eq!(timing.error(), None);
        timing.write_rejected(pulses(), 5_000_000);
        assert_eq!(timing.error(), Some(AlStatusCode::SYNC_ERROR));
        timing.restart();
        assert_eq!(timing.error(), None);
    }
}
