//! Whether clients may send.

use crate::commands::bridge::endpoint::Endpoint;
use crate::output::Output;

/// Keeps frames of clients away from a gateway that is out of service and from a channel that is
/// bus-off or stands still: sent afterwards, all at once, they would be old, and move what has long been meant to stand still.
#[derive(Debug)]
pub struct TransmitGate {
    is_open: bool,
    /// Frames of clients that had been kept away when it was shut.
    kept_before: u64,
}

impl TransmitGate {
    /// Shut.
    pub fn shut(fronts: &[Endpoint]) -> Self {
        for front in fronts {
            front.clients().set_accepting(false);
        }
        Self { is_open: false, kept_before: kept(fronts) }
    }

    /// Opens or shuts it, and tells what was lost. `held` frames were taken and are dropped with those
    /// that wait.
    pub fn set_open(&mut self, is_open: bool, held: usize, fronts: &[Endpoint], output: &Output) {
        if is_open == self.is_open {
            return;
        }
        self.is_open = is_open;
        // Before the first front is shut: from then on clients are refused.
        let kept_before = kept(fronts);
        let waiting: usize = fronts.iter().map(|it| it.clients().set_accepting(is_open)).sum();
        let dropped = held + waiting;
        if !is_open {
            self.kept_before = kept_before + waiting as u64;
            if dropped > 0 {
                output.note(format_args!(
                    "# {dropped} frames of clients dropped: nothing can be sent"
                ));
            }
            return;
        }
        let refused = kept(fronts) - self.kept_before;
        if refused > 0 {
            output.note(format_args!(
                "# {refused} frames of clients refused while nothing could be sent"
            ));
        }
    }
}

fn kept(fronts: &[Endpoint]) -> u64 {
    fronts.iter().map(|front| front.clients().statistics().discarded).sum()
}
