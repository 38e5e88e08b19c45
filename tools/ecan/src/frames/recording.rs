use std::path::Path;

use ecan_command_line::log_file::{self, Log, LoggedFrame};

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
    pub error_messages: usize,
}

/// Reads the frames for the selected channels of a number of gateways; see [`Channels::destination_of`].
pub fn read(path: &Path, channels: Channels, gateways: usize) -> Result<RecordedLog> {
    let assign = |logged: LoggedFrame| {
        let (gateway, channel) = channels.destination_of(&logged.interface, gateways)?;
        Some(Recorded { gateway, channel, logged })
    };
    let Log { frames, error_messages } = log_file::read(path)?;
    let frames: Vec<_> = frames.into_iter().filter_map(assign).collect();
    match frames.is_empty() {
        false => Ok(RecordedLog { frames, error_messages }),
        true => {
            let message = format!("{} has no frames for the selected channels", path.display());
            Err(Failure::Usage(message))
        }
    }
}
