//! What is said at the end of sending many frames.

use ecan_mcan_port::Port;
use serde::Serialize;

use crate::failure::Failure;
use crate::frames::single_gateway::statistics;
use crate::frames::transmit_tracker::TransmitTracker;
use crate::output::Output;

/// The figures.
#[derive(Debug, Serialize)]
pub struct Summary {
    /// Frames given to the gateway.
    frames: u64,
    /// Those that have left.
    sent: u64,
    /// Those that are not known to have left.
    lost: u64,
    /// Those that were on their way when the user stopped.
    under_way: u64,
    /// Frames of the command that were not given to the gateway.
    not_tried: u64,
    /// Frames that came from the bus meanwhile.
    received: u64,
    /// From the start to the last frame that has left.
    seconds: f64,
    frames_per_second: f64,
}

impl Summary {
    /// The figures of a run in which `wanted` frames were to be sent.
    pub fn of(departures: &TransmitTracker, port: &Port, wanted: u64) -> Self {
        let outcome = departures.outcome();
        let counters = statistics(port);
        let of = |channel: u8| counters.channels.get(usize::from(channel));
        let channels = departures.channels().iter().filter_map(of);
        let received = channels.map(|it| it.frames_received).sum();
        let seconds = departures.elapsed_ns() as f64 / 1e9;
        Self {
            frames: departures.count(),
            sent: outcome.sent,
            lost: outcome.lost(),
            under_way: outcome.under_way,
            not_tried: wanted.saturating_sub(departures.count()),
            received,
            seconds,
            frames_per_second: if seconds > 0.0 { outcome.sent as f64 / seconds } else { 0.0 },
        }
    }

    /// Prints them.
    pub fn print(&self, output: &Output) -> Result<(), Failure> {
        output.data(self, |out| {
            let Self { sent, lost, under_way, received, seconds, frames_per_second, .. } = self;
            write!(out, "{sent} frames sent, {lost} lost, ")?;
            if *under_way > 0 {
                write!(out, "{under_way} under way, ")?;
            }
            write!(out, "{received} received")?;
            writeln!(out, " in {seconds:.3} s: {frames_per_second:.1} frames/s")
        })
    }

    /// The failure of a run in which frames stayed behind, made from the words for it.
    pub fn judge(&self, failure: impl FnOnce(String) -> Failure) -> Result<(), Failure> {
        let behind = self.lost + self.not_tried;
        if behind == 0 {
            return Ok(());
        }
        let all = self.frames + self.not_tried;
        Err(failure(format!("{behind} of {all} frames are not known to have left")))
    }
}
