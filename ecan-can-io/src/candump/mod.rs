//! Parser and formatter for candump logs (`candump -L`, `candump -l`), `cansend` frames, candump's
//! screen and its filters.
//!
//! Nothing allocates: a [`Record`] borrows the interface name from its line.
//!
//! ```text
//! line      = blank | comment | record
//! comment   = [spaces] "#" anything
//! record    = "(" seconds "." fraction ")" SP interface SP frame [SP direction]
//! seconds   = digit, any number of them
//! fraction  = 6 digits (microseconds) or 9 digits (nanoseconds)
//! interface = characters other than blanks
//! frame     = id "#" data [raw]           classic data frame, 0 to 8 bytes
//!           | id "#R" [dlc] [raw]         remote frame, dlc 0 to 8
//!           | id "##" flags data          CAN FD frame, a length that a DLC can express
//! id        = 3 hex digits (standard) | 8 hex digits (extended)
//! flags     = hex digit: bit 0 BRS, bit 1 ESI, bit 2 FDF (redundant)
//! data      = pairs of hex digits
//! raw       = "_" hex digit 9 to F        after 8 bytes or dlc 8: the DLC on the bus; not kept
//! direction = "R" | "T"                   received or sent
//! ```
//!
//! [`parse_screen_line`] parses what candump prints:
//!
//! ```text
//! screen    = blank | comment | detail | [SP] ["(" time ")" SP] interface SP [flags SP] id SP shown
//! detail    = tab or 4 blanks, anything   line about the frame above (`-e`, `ecan dump --dbc`)
//! time      = seconds "." fraction | date SP time of day "." fraction (`-t A`)
//! flags     = ("RX" | "TX") SP ("B" | "-") SP ("E" | "-")     direction, BRS, ESI (`-x`)
//! shown     = "[" digit "]" bytes | "[" digit "] remote request" | "[" 2 digits "]" bytes   (CAN FD)
//! bytes     = as many pairs of hex digits as the length, ["'" ASCII "'"] (`-a`), ["+" gateway time]
//! ```
//!
//! Several blanks or tabs are accepted in place of one blank (SP), as are lower-case hex digits and
//! trailing blanks. The `Display` of [`Record`] writes the form of candump.
//!
//! ```
//! use ecan_can_io::candump::parse_line;
//!
//! let line = "(1398128223.803317) can0 166#D0320009";
//! let record = parse_line(line)?.expect("a record");
//! assert_eq!(record.time_ns, 1_398_128_223_803_317_000);
//! assert_eq!(record.interface, "can0");
//! assert_eq!(record.frame.data(), [0xD0, 0x32, 0x00, 0x09]);
//! assert_eq!(record.to_string(), line);
//! # Ok::<(), ecan_can_io::candump::ParseError>(())
//! ```

mod line;
mod screen;

pub use line::{
    DirectionMark, Filter, FilterError, FrameText, ParseError, ParseErrorKind, Record, parse_frame,
    parse_line,
};
pub use screen::{ScreenFrame, ScreenRecord, ScreenTime, parse_screen_line};
