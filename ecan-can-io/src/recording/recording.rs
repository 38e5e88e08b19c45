//! Contents of a recording.

use ecan_protocol::can::CanFrame;

use crate::recording::error::{RecordingError, RecordingErrorKind};
use crate::recording::format::Format;
use crate::recording::screen_times::ScreenTimes;
use crate::recording::{asc, candump, trc};

/// Frame of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoggedFrame {
    /// Line in the file, from 1.
    pub line: usize,
    /// Time in nanoseconds, from any reference.
    pub time_ns: u64,
    /// Interface name; `can0` for channel 1 of ASC and bus 1 of TRC.
    pub interface: String,
    /// CAN frame.
    pub frame: CanFrame,
}

/// Settings for text that does not state them; `None` is recognized.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Format.
    pub format: Option<Format>,
    /// Reference of the time stamps on candump's screen.
    pub screen_times: Option<ScreenTimes>,
}

/// Contents of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recording {
    /// Given or recognized format.
    pub format: Format,
    /// Frames in the order of the file.
    pub frames: Vec<LoggedFrame>,
    /// Number of error frames and SocketCAN error messages, which are not CAN frames.
    pub error_frames: usize,
    /// Number of other lines without a frame: events of ASC and TRC.
    pub events: usize,
    /// Given or recognized reference of the time stamps on candump's screen; `None` in other formats
    /// and without time stamps.
    pub screen_times: Option<ScreenTimes>,
}

impl Recording {
    /// Parses a recording.
    ///
    /// # Errors
    /// The first invalid line, or a format that is not recognized.
    pub fn parse(text: &str, options: &ReadOptions) -> Result<Self, RecordingError> {
        // Exports of Windows programs may begin with a byte order mark.
        let text = text.strip_prefix('\u{FEFF}').unwrap_or(text);
        let unknown = |line| RecordingError { line, kind: RecordingErrorKind::UnknownFormat };
        let format = match options.format {
            Some(format) => format,
            None => Format::recognize(text).map_err(unknown)?,
        };
        match format {
            Format::CandumpLog => candump::parse_log(text),
            Format::CandumpScreen => candump::parse_screen(text, options.screen_times),
            Format::Asc => asc::parse(text),
            Format::Trc => trc::parse(text),
        }
    }

    pub(crate) const fn new(format: Format) -> Self {
        Self { format, frames: Vec::new(), error_frames: 0, events: 0, screen_times: None }
    }
}
