//! A candump log, and where its frames go.

use std::path::Path;

use ecan_command_line::log_file::{self, Log, LoggedFrame};

use crate::failure::Failure;
use crate::frames::channels::Channels;

/// A frame of a recording with its place.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// The gateway, from 0.
    pub gateway: usize,
    pub channel: u8,
    pub logged: LoggedFrame,
}

/// A log, as far as it goes to chosen channels.
#[derive(Clone, Debug)]
pub struct RecordedLog {
    /// At least one.
    pub frames: Vec<Recorded>,
    /// Lines of the log that are no frames of a bus.
    pub error_messages: usize,
}

/// The frames of a log that go to these channels of so many gateways; see
/// [`Channels::place_of`].
pub fn read(path: &Path, channels: Channels, gateways: usize) -> Result<RecordedLog, Failure> {
    let place = |logged: LoggedFrame| {
        let (gateway, channel) = channels.place_of(&logged.interface, gateways)?;
        Some(Recorded { gateway, channel, logged })
    };
    let Log { frames, error_messages } = log_file::read_log(path)?;
    let frames: Vec<_> = frames.into_iter().filter_map(place).collect();
    match frames.is_empty() {
        false => Ok(RecordedLog { frames, error_messages }),
        true => {
            let words = format!("{} holds no frame of a chosen channel", path.display());
            Err(Failure::Usage(words))
        }
    }
}
