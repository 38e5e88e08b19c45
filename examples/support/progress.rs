//! The progress bar of long runs.

use ecan_tool_support::command_line::screen::Stream;
use indicatif::{ProgressBar, ProgressStyle};

/// Steps below which a bar would only flicker.
const LONG: u64 = 500;

/// A bar on standard error, hidden for short runs and if standard error is not a terminal.
pub fn bar(total: u64) -> ProgressBar {
    if total < LONG || !Stream::Error.is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(total);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos}/{len}  {eta} left") {
        bar.set_style(style);
    }
    bar
}
