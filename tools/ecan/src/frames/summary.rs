use serde::Serialize;

use crate::context::{Failure, Output, Result};
use crate::frames::service::Service;
use crate::frames::transmit_tracker::TransmitTracker;

#[derive(Debug, Serialize)]
pub struct Summary {
    /// Frames accepted by the gateway or waiting.
    frames: u64,
    sent: u64,
    /// Frames not confirmed as sent.
    lost: u64,
    /// Frames in transit when the user stopped.
    under_way: u64,
    /// Frames of the command that were not passed to the gateway.
    not_tried: u64,
    received: u64,
    /// Images of the gateway that were lost. The number of frames in them cannot be known.
    images_lost: u64,
    /// Most images that can have been lost in outages.
    images_unknown: u64,
    /// Time from the start to the last sent frame.
    seconds: f64,
    frames_per_second: f64,
}

impl Summary {
    pub fn of(tracker: &TransmitTracker, service: &Service, expected: u64) -> Self {
        let outcome = tracker.outcome();
        let counters = service.statistics(0);
        let of = |channel: u8| counters.channels.get(usize::from(channel));
        let channels = tracker.channels().iter().filter_map(of);
        let received = channels.map(|it| it.frames_received).sum();
        let seconds = tracker.elapsed_ns() as f64 / 1e9;
        Self {
            frames: tracker.count(),
            sent: outcome.sent,
            lost: outcome.lost(),
            under_way: outcome.under_way,
            not_tried: expected.saturating_sub(tracker.count()),
            received,
            images_lost: counters.txpdo_lost,
            images_unknown: counters.txpdo_unknown,
            seconds,
            frames_per_second: if seconds > 0.0 { outcome.sent as f64 / seconds } else { 0.0 },
        }
    }

    pub fn print(&self, output: &Output) -> Result {
        output.data(self, |out| {
            let Self { sent, lost, under_way, received, seconds, frames_per_second, .. } = self;
            write!(out, "{sent} frames sent, {lost} lost, ")?;
            if *under_way > 0 {
                write!(out, "{under_way} in transit, ")?;
            }
            write!(out, "{received} received")?;
            writeln!(out, " in {seconds:.3} s: {frames_per_second:.1} frames/s")?;
            match (self.images_lost, self.images_unknown) {
                (0, 0) => Ok(()),
                (lost, 0) => writeln!(out, "{lost} images lost, received frames may be missing"),
                (lost, unknown) => writeln!(
                    out,
                    "{lost} images lost and up to {unknown} unknown, received frames may be missing"
                ),
            }
        })
    }

    pub fn check(&self, failure: impl FnOnce(String) -> Failure) -> Result {
        let behind = self.lost + self.not_tried;
        if behind == 0 {
            return Ok(());
        }
        let all = self.frames + self.not_tried;
        Err(failure(format!("{behind} of {all} frames not confirmed as sent")))
    }
}
