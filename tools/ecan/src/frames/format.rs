use std::fmt::Write;
use std::sync::Arc;

use ecan_can_io::candump::{FrameText, ScreenFrame};
use ecan_protocol::can::{CanFrame, FrameKind};
use ecan_protocol::image::Timestamp;
use serde::Serialize;

use crate::frames::link::BusFrame;
use crate::frames::signals::{self, DecodedMessage, Signals};
use crate::frames::timestamp::{Style, Timestamps};

#[derive(Clone, Copy, Debug)]
pub struct TimedFrame {
    /// Time since 1970, or since the start of a stepped simulation.
    pub time_ns: u64,
    pub frame: BusFrame,
}

#[derive(Clone, Debug, Default)]
pub struct Screen {
    pub style: Option<Style>,
    pub has_nanoseconds: bool,
    pub has_ascii: bool,
    pub has_extra: bool,
    pub is_log: bool,
    pub is_json: bool,
    /// Shown below each frame.
    pub signals: Arc<Signals>,
}

/// JSON form of a frame, one per line.
#[derive(Debug, Serialize)]
struct Line {
    time_ns: u64,
    channel: u8,
    id: u32,
    is_extended: bool,
    kind: &'static str,
    has_bit_rate_switch: bool,
    has_error_state: bool,
    length: usize,
    data: String,
    device_time: Option<u64>,
    #[serde(flatten)]
    decoded: Option<DecodedMessage>,
}

#[derive(Debug)]
pub struct ScreenLines {
    screen: Screen,
    timestamps: Option<Timestamps>,
    log: LogLines,
    /// True if an extended CAN ID was seen.
    is_indented: bool,
}

impl ScreenLines {
    pub fn new(screen: Screen) -> Self {
        let Screen { style, has_nanoseconds, .. } = screen;
        Self {
            timestamps: style.map(|style| Timestamps::new(style, has_nanoseconds)),
            log: LogLines::new(&screen),
            screen,
            is_indented: false,
        }
    }

    /// Formats the next frame with its signals, without line break at the end.
    pub fn lines(&mut self, timed: &TimedFrame) -> String {
        let decoded = self.screen.signals.decode(timed.frame.channel, &timed.frame.frame);
        if self.screen.is_json {
            return json(timed, decoded.map(DecodedMessage::from));
        }
        let below = decoded.iter().flat_map(signals::lines).collect::<Vec<_>>();
        std::iter::once(self.line(timed)).chain(below).collect::<Vec<_>>().join("\n")
    }

    fn line(&mut self, timed: &TimedFrame) -> String {
        if self.screen.is_log {
            return self.log.line(timed);
        }
        let BusFrame { frame, channel, timestamp, is_sent, .. } = &timed.frame;
        self.is_indented |= frame.id().is_extended();
        let mut line = String::from(" ");
        // Writing to a String cannot fail.
        if let Some(timestamps) = &mut self.timestamps {
            let _ = write!(line, "{} ", timestamps.text(timed.time_ns));
        }
        let _ = write!(line, " can{channel}");
        if self.screen.has_extra {
            let (brs, esi) = fd_flags(frame);
            let direction = if *is_sent { "TX" } else { "RX" };
            let mark = |is_set, letter| if is_set { letter } else { '-' };
            let _ = write!(line, "  {direction} {} {}", mark(brs, 'B'), mark(esi, 'E'));
        }
        let Self { is_indented, screen: Screen { has_ascii, .. }, .. } = *self;
        let _ = write!(line, "  {}", ScreenFrame { frame, is_indented, has_ascii });
        if let Some(time) = device_time(*timestamp) {
            let _ = write!(line, "  +{time}");
        }
        line
    }
}

#[derive(Debug)]
pub struct LogLines {
    timestamps: Timestamps,
    has_extra: bool,
}

impl LogLines {
    pub fn new(screen: &Screen) -> Self {
        let timestamps = Timestamps::new(Style::Absolute, screen.has_nanoseconds);
        Self { timestamps, has_extra: screen.has_extra }
    }

    pub fn line(&mut self, timed: &TimedFrame) -> String {
        let BusFrame { frame, channel, is_sent, .. } = &timed.frame;
        let time = self.timestamps.text(timed.time_ns);
        let mark = match (self.has_extra, is_sent) {
            (false, _) => "",
            (true, false) => " R",
            (true, true) => " T",
        };
        format!("{time} can{channel} {}{mark}", FrameText(frame))
    }
}

fn fd_flags(frame: &CanFrame) -> (bool, bool) {
    match frame.kind() {
        FrameKind::Fd { brs, esi } => (brs, esi),
        FrameKind::Data | FrameKind::Remote => (false, false),
    }
}

fn device_time(timestamp: Timestamp) -> Option<u64> {
    match timestamp {
        Timestamp::None => None,
        Timestamp::Delta16(time) => Some(time.into()),
        Timestamp::Delta32(time) => Some(time.into()),
        Timestamp::Full64(time) => Some(time),
    }
}

fn json(timed: &TimedFrame, decoded: Option<DecodedMessage>) -> String {
    let BusFrame { frame, channel, timestamp, .. } = &timed.frame;
    let (has_bit_rate_switch, has_error_state) = fd_flags(frame);
    let line = Line {
        time_ns: timed.time_ns,
        channel: *channel,
        id: frame.id().raw(),
        is_extended: frame.id().is_extended(),
        kind: match frame.kind() {
            FrameKind::Data => "data",
            FrameKind::Remote => "remote",
            FrameKind::Fd { .. } => "fd",
        },
        has_bit_rate_switch,
        has_error_state,
        length: match frame.kind() {
            FrameKind::Remote => frame.dlc().value().into(),
            _ => frame.data().len(),
        },
        data: frame.data().iter().fold(String::new(), |mut text, byte| {
            let _ = write!(text, "{byte:02X}");
            text
        }),
        device_time: device_time(*timestamp),
        decoded,
    };
    serde_json::to_string(&line).unwrap_or_default()
}
