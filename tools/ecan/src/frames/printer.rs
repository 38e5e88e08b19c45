//! Frames as text, and their output on a thread of its own: a slow or stalled output does not delay the cycle.

use std::fmt::Write as _;
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use clap::ValueEnum;
use ecan_can_io::candump::{FrameText, ScreenFrame};
use ecan_can_io::capture::lost_images;
use ecan_protocol::can::{CanFrame, FrameKind};
use ecan_protocol::image::Timestamp;
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::log_file::{LogFileError, Writer};
use ecan_tool_support::command_line::new_file::{Existing, is_standard_stream};
use ecan_tool_support::command_line::screen::{CleanWriter, Content, Stream};
use serde::Serialize;

use super::link::BusFrame;
use super::signals;
use super::signals::{DecodedMessage, Signals};
use crate::context::{Failure, Result, note};
use crate::output::with_simulated;

/// Maximum number of queued frames: some seconds of four full channels.
const QUEUE: usize = 1 << 17;
/// Limit of a stalled output when the user stops, in polls: about a second. A pause of the machine is
/// one poll.
const MAX_LOOKS: u32 = 100;
const LOOK: Duration = Duration::from_millis(10);

#[derive(Clone, Copy, Debug)]
pub struct Destination<'a> {
    pub is_shown: bool,
    /// Path of a log; `-` is standard output.
    pub log: Option<&'a Path>,
    pub existing: Existing,
}

#[derive(Debug)]
pub struct Printer {
    queue: Option<SyncSender<TimedFrame>>,
    thread: JoinHandle<Result>,
    /// Disconnected when the thread ends; carries no data.
    end: Receiver<()>,
    interrupt: Interrupt,
    log: Option<PathBuf>,
    dropped: u64,
}

impl Printer {
    pub fn start(
        screen: Screen,
        destination: Destination<'_>,
        interrupt: &Interrupt,
    ) -> Result<Self> {
        let Destination { is_shown, log, existing } = destination;
        let writer = log.map(|path| Writer::create_with(path, existing)).transpose()?;
        let log_lines = writer.map(|writer| (writer, LogLines::new(&screen)));
        let content = if screen.is_json { Content::Json } else { Content::Text };
        let lines = is_shown.then(|| ScreenLines::new(screen));
        let print = move |timed: &Receiver<TimedFrame>| print_all(timed, lines, content, log_lines);
        let printer = Self::start_with(QUEUE, interrupt, print)?;
        Ok(Self { log: log.map(Path::to_owned), ..printer })
    }

    fn start_with(
        capacity: usize,
        interrupt: &Interrupt,
        write: impl FnOnce(&Receiver<TimedFrame>) -> Result + Send + 'static,
    ) -> Result<Self> {
        let (queue, timed) = sync_channel(capacity);
        let (until_end, end) = sync_channel::<()>(0);
        let spawned = std::thread::Builder::new().name("printer".to_owned()).spawn(move || {
            let _until_end = until_end;
            write(&timed)
        });
        let thread = spawned.map_err(Failure::of_thread)?;
        let interrupt = interrupt.clone();
        Ok(Self { queue: Some(queue), thread, end, interrupt, log: None, dropped: 0 })
    }

    /// Queues a frame. If the queue is full, real time drops the frame; simulated time waits until
    /// the user stops.
    pub fn put(&mut self, mut timed: TimedFrame, is_real_time: bool) {
        let Some(queue) = &self.queue else { return };
        while let Err(error) = queue.try_send(timed) {
            match error {
                // The error of the thread is returned by `finish`.
                TrySendError::Disconnected(_) => return,
                TrySendError::Full(_) if is_real_time || self.interrupt.is_set() => {
                    self.dropped += 1;
                    return;
                }
                TrySendError::Full(back) => timed = back,
            }
            std::thread::sleep(LOOK);
        }
    }

    pub fn is_over(&self) -> bool {
        self.thread.is_finished()
    }

    /// Waits until everything is written and reports dropped frames; at most a second after the
    /// user stops.
    pub fn finish(mut self) -> Result {
        self.queue = None;
        let mut looks = 0;
        while self.end.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
            if self.interrupt.is_set() {
                looks += 1;
                if looks > MAX_LOOKS {
                    return Err(stall_failure(self.log));
                }
            }
        }
        match self.thread.join() {
            Ok(outcome) => outcome?,
            Err(panic) => std::panic::resume_unwind(panic),
        }
        if self.dropped > 0 {
            let message = "frames dropped: the output is too slow";
            note(format_args!("# {} {message}", self.dropped));
        }
        Ok(())
    }
}

fn stall_failure(log: Option<PathBuf>) -> Failure {
    let error = std::io::Error::new(ErrorKind::TimedOut, "output is stalled; frames were dropped");
    match log.filter(|path| !is_standard_stream(path)) {
        Some(path) => LogFileError::Write(path, error).into(),
        None => Failure::Output(error),
    }
}

/// Writes frames and flushes whenever the queue is empty.
fn print_all(
    timed: &Receiver<TimedFrame>,
    mut screen: Option<ScreenLines>,
    content: Content,
    mut log: Option<(Writer, LogLines)>,
) -> Result {
    let mut stream = BufWriter::new(CleanWriter::with_content(Stream::Output, content));
    while let Ok(first) = timed.recv() {
        for timed in std::iter::once(first).chain(timed.try_iter()) {
            if let Some(screen) = &mut screen {
                writeln!(stream, "{}", screen.lines(&timed))?;
            }
            if let Some((log, lines)) = &mut log {
                let BusFrame { frame, channel, is_sent, .. } = &timed.frame;
                let place = (timed.time_ns, usize::from(*channel));
                if let Some(images) = timed.gap {
                    log.comment(timed.time_ns, &gap_text(images)).map_err(of_log)?;
                }
                log.write_frame(place, frame, *is_sent, lines.line(&timed)).map_err(of_log)?;
            }
        }
        stream.flush()?;
        if let Some((log, _)) = &mut log {
            log.flush().map_err(of_log)?;
        }
    }
    log.map_or(Ok(()), |(log, _)| log.finish().map_err(of_log))
}

/// Errors of a log on standard output are treated as output errors.
fn of_log(error: LogFileError) -> Failure {
    match error {
        LogFileError::Write(path, error) if is_standard_stream(&path) => error.into(),
        error => error.into(),
    }
}

#[derive(Clone, Copy, Debug)]
pub struct TimedFrame {
    /// Time since 1970, or since the start of a stepped simulation.
    pub time_ns: u64,
    pub frame: BusFrame,
    /// Images before it that were lost or incomplete: frames may be missing there.
    pub gap: Option<u64>,
}

/// Mark of a gap, as a comment of a recording and on the screen.
fn gap_text(images: u64) -> String {
    format!("gap: {}", lost_images(images))
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
    #[serde(skip_serializing_if = "Option::is_none")]
    gap_images: Option<u64>,
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
        let above = timed.gap.map(|images| format!("# {}", gap_text(images)));
        let line = self.line(timed);
        above.into_iter().chain([line]).chain(below).collect::<Vec<_>>().join("\n")
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
        gap_images: timed.gap,
        decoded,
    };
    with_simulated(serde_json::to_string(&line).unwrap_or_default())
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Style {
    /// Seconds since 1970, or since the start of a stepped simulation
    #[value(name = "a")]
    Absolute,
    /// Time since the previous frame
    #[value(name = "d")]
    Delta,
    /// Time since the first frame
    #[value(name = "z")]
    Zero,
    /// Date and time of day
    #[value(name = "A")]
    Date,
}

#[derive(Debug)]
pub struct Timestamps {
    style: Style,
    has_nanoseconds: bool,
    /// Time of the first or the previous frame.
    reference_ns: Option<u64>,
}

impl Timestamps {
    pub fn new(style: Style, has_nanoseconds: bool) -> Self {
        Self { style, has_nanoseconds, reference_ns: None }
    }

    /// Formats the time of the next frame, in parentheses.
    pub fn text(&mut self, time_ns: u64) -> String {
        match self.style {
            Style::Absolute => self.bracket(&format!("{:010}", seconds(time_ns)), time_ns),
            Style::Date => self.bracket(&date(time_ns), time_ns),
            Style::Delta | Style::Zero => {
                let reference_ns = *self.reference_ns.get_or_insert(time_ns);
                if self.style == Style::Delta {
                    self.reference_ns = Some(time_ns);
                }
                let since_ns = time_ns.saturating_sub(reference_ns);
                self.bracket(&format!("{:03}", seconds(since_ns)), since_ns)
            }
        }
    }

    fn bracket(&self, whole: &str, time_ns: u64) -> String {
        let fraction = time_ns % 1_000_000_000;
        if self.has_nanoseconds {
            format!("({whole}.{fraction:09})")
        } else {
            format!("({whole}.{:06})", fraction / 1000)
        }
    }
}

fn seconds(time_ns: u64) -> u64 {
    time_ns / 1_000_000_000
}

fn date(time_ns: u64) -> String {
    let since_1970 = i64::try_from(seconds(time_ns)).ok();
    let time = since_1970.and_then(|seconds| jiff::Timestamp::from_second(seconds).ok());
    time.unwrap_or_default()
        .to_zoned(jiff::tz::TimeZone::system())
        .strftime("%Y-%m-%d %H:%M:%S")
        .to_string()
}

#[cfg(test)]
mod tests {
    use ecan_protocol::can::{CanFrame, CanId};
    use ecan_protocol::image::Timestamp;

    use super::*;
    use crate::frames::link::BusFrame;

    fn timed_frame() -> TimedFrame {
        let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[]).unwrap();
        let frame =
            BusFrame { gateway: 0, channel: 0, frame, timestamp: Timestamp::None, is_sent: false };
        TimedFrame { time_ns: 0, frame, gap: None }
    }

    #[test]
    fn stalled_output_does_not_block_stopping() {
        let interrupt = Interrupt::default();
        let (release, held) = sync_channel::<()>(0);
        let mut printer = Printer::start_with(1, &interrupt, move |_| {
            let _ = held.recv();
            Ok(())
        })
        .unwrap();
        printer.put(timed_frame(), false);
        interrupt.request();
        // The queue is full; simulated time would wait.
        printer.put(timed_frame(), false);
        assert_eq!(printer.dropped, 1);
        let failure = printer.finish().unwrap_err();
        let message = "cannot write the output: output is stalled; frames were dropped";
        assert_eq!((failure.to_string().as_str(), failure.status()), (message, 6));
        drop(release);
    }

    #[test]
    fn time_stamps_match_candump() {
        let first = 1_398_128_223_803_317_555;
        let frames = [first, first + 20_000_500, first + 1_020_000_000];
        let texts = |style, has_nanoseconds| {
            let mut timestamps = Timestamps::new(style, has_nanoseconds);
            frames.map(|time| timestamps.text(time))
        };
        assert_eq!(
            texts(Style::Absolute, false),
            ["(1398128223.803317)", "(1398128223.823318)", "(1398128224.823317)"]
        );
        assert_eq!(texts(Style::Delta, false), ["(000.000000)", "(000.020000)", "(000.999999)"]);
        assert_eq!(
            texts(Style::Zero, true),
            ["(000.000000000)", "(000.020000500)", "(001.020000000)"]
        );
        assert_eq!(Timestamps::new(Style::Absolute, false).text(1_500), "(0000000000.000001)");
    }
}
