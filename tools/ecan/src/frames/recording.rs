use std::path::Path;

use ecan_can_io::recording::{LoggedFrame, ReadOptions, Recording, ScreenTimes};
use ecan_protocol::text::Printable;
use ecan_tool_support::command_line::log_file;

use crate::context::{Failure, Result};
use crate::frames::channels::Channels;

#[derive(Clone, Debug)]
pub struct Recorded {
    pub gateway: usize,
    pub channel: u8,
    pub logged: LoggedFrame,
}

#[derive(Clone, Debug)]
pub struct RecordedLog {
    /// Frames, at least one.
    pub frames: Vec<Recorded>,
    pub error_frames: usize,
    /// As in [`Recording::screen_times`].
    pub screen_times: Option<ScreenTimes>,
}

/// Reads the frames for the selected channels of a number of gateways; see [`Channels::destination_of`].
pub fn read(
    path: &Path,
    options: &ReadOptions,
    channels: Channels,
    gateways: usize,
) -> Result<RecordedLog> {
    let assign = |logged: LoggedFrame| {
        let (gateway, channel) = channels.destination_of(&logged.interface, gateways)?;
        Some(Recorded { gateway, channel, logged })
    };
    let Recording { frames, error_frames, screen_times, .. } = log_file::read_with(path, options)?;
    let frames: Vec<_> = frames.into_iter().filter_map(assign).collect();
    match frames.is_empty() {
        false => Ok(RecordedLog { frames, error_frames, screen_times }),
        true => {
            let message =
                format!("{} has no frames for the selected channels", Printable(path.display()));
            Err(Failure::Usage(message))
        }
    }
}
