//! Reads recordings of CAN buses: logs and screens of candump, Vector ASC, PEAK TRC.
//!
//! [`Recording::parse`] recognizes the format by the first lines. Times count from any reference: only
//! their differences have a meaning. Interfaces are named `can0`, `can1` ...; channel 1 of an ASC file
//! and bus 1 of a TRC file are `can0`. Error frames and other events are counted, not returned.
//!
//! ```
//! use ecan_can_io::recording::{Format, ReadOptions, Recording};
//!
//! let text = "\
//! ;$FILEVERSION=2.0
//! ;$COLUMNS=N,O,T,I,d,l,D
//!       1      1059.900 DT     0300 Rx 2  01 02
//! ";
//! let recording = Recording::parse(text, &ReadOptions::default())?;
//! assert_eq!(recording.format, Format::Trc);
//! assert_eq!(recording.frames[0].time_ns, 1_059_900_000);
//! assert_eq!(recording.frames[0].frame.data(), [1, 2]);
//! # Ok::<(), ecan_can_io::recording::RecordingError>(())
//! ```

mod asc;
mod candump;
mod error;
mod fields;
mod format;
mod recording;
mod screen_times;
mod trc;

pub use error::{RecordingError, RecordingErrorKind};
pub use format::Format;
pub use recording::{LoggedFrame, ReadOptions, Recording};
pub use screen_times::ScreenTimes;
