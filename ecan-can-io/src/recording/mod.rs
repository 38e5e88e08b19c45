//! Reads recordings of CAN buses: logs and screens of candump, Vector ASC and BLF, PEAK TRC, pcapng and pcap of
//! SocketCAN. Writes BLF.
//!
//! [`Recording::read`] recognizes the format by the first bytes or lines. Times count from any reference: only
//! their differences have a meaning. Interfaces are named `can0`, `can1` ...; channel 1 of an ASC or BLF file
//! and bus 1 of a TRC file are `can0`. Error frames and other events are counted, not returned. A line that cannot be
//! read is left out and reported.
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
mod blf;
mod pcap;
mod records;
mod trc;

pub use blf::BlfWriter;
pub use records::{
    Format, LoggedFrame, ReadOptions, Recording, RecordingError, RecordingErrorKind, ScreenTimes,
    SkippedLine,
};

impl Recording {
    /// Reads a recording of any format. Bytes of a text that are not UTF-8 are replaced: comments of Windows programs
    /// may have another encoding.
    ///
    /// # Errors
    /// A format that is not recognized.
    pub fn read(bytes: &[u8], options: &ReadOptions) -> Result<Self, RecordingError> {
        match bytes {
            _ if options.format.is_some() => {}
            _ if blf::is_blf(bytes) => return Ok(blf::parse(bytes)),
            _ if pcap::is_pcap(bytes) => return Ok(pcap::parse(bytes)),
            _ => {}
        }
        Self::parse(&String::from_utf8_lossy(bytes), options)
    }

    /// Parses a recording that is a text.
    ///
    /// # Errors
    /// A format that is not recognized.
    pub fn parse(text: &str, options: &ReadOptions) -> Result<Self, RecordingError> {
        // Exports of Windows programs may begin with a byte order mark.
        let text = text.strip_prefix('\u{FEFF}').unwrap_or(text);
        let unknown = |line| RecordingError { line, kind: RecordingErrorKind::UnknownFormat };
        let format = match options.format {
            Some(format) => format,
            None => Format::recognize(text).map_err(unknown)?,
        };
        Ok(match format {
            Format::CandumpLog => records::parse_log(text),
            Format::CandumpScreen => records::parse_screen(text, options.screen_times),
            Format::Asc => asc::parse(text),
            Format::Trc => trc::parse(text),
            Format::Blf => blf::parse(text.as_bytes()),
            Format::Pcap => pcap::parse(text.as_bytes()),
        })
    }
}
