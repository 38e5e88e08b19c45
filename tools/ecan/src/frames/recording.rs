//! A candump log, and where its frames go.

use std::path::Path;

use ecan_command_line::log_file::{self, LoggedFrame};

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

/// The frames of a log that go to these channels of so many gateways, at least one; see
/// [`Channels::place_of`].
pub fn read(path: &Path, channels: Channels, gateways: usize) -> Result<Vec<Recorded>, Failure> {
    let place = |logged: LoggedFrame| {
        let (gateway, channel) = channels.place_of(&logged.interface, gateways)?;
        Some(Recorded { gateway, channel, logged })
    };
    let frames: Vec<_> = log_file::read(path)?.into_iter().filter_map(place).collect();
    match frames.is_empty() {
        false => Ok(frames),
        true => {
            let words = format!("{} holds no frame of a chosen channel", path.display());
            Err(Failure::Usage(words))
        }
    }
}
