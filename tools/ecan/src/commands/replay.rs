//! `ecan replay`: sends a recording at its recorded times.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;
use ecan_can_io::recording::{Format, ReadOptions, ScreenTimes};
use ecan_protocol::mapping::Direction;
use ecan_protocol::text::Printable;
use ecan_tool_support::command_line::new_file::is_standard_stream;
use ecan_tool_support::command_line::options::{ANY_TIME, milliseconds};

use crate::context::{Context, Failure, Result, note};
use crate::frames::{
    Channels, Destination, Due, FrameOptions, GatewayRequirements, Prepared, Printer, Record,
    Recorded, RecordedLog, Screen, Sender, read_recording,
};

pub const EXAMPLES: &str = "\
Examples:
  ecan replay drive.log                        on channel 0, at the recorded times
  ecan replay drive.log --channel all          frames of can2 on channel 2, etc.
  ecan replay drive.log --speed 10 --loop 5    ten times as fast, five times
  ecan replay vehicle.asc --channel all        Vector ASC; channel 1 goes to channel 0
  ecan replay screen.txt --time-stamps d       copied from candump -t d
  ecan replay drive.log --record back.log      and record received frames
  ecan replay drive.log --capture both.pcapng  sent and received, for Wireshark";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Loops {
    Times(u64),
    Endless,
}

impl FromStr for Loops {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.parse() {
            _ if text == "i" => Ok(Self::Endless),
            Ok(times) if times > 0 => Ok(Self::Times(times)),
            _ => Err("expected a number above 0, or i for infinite".to_owned()),
        }
    }
}

#[derive(Debug, Args)]
pub struct ReplayArguments {
    /// Recording: candump log or screen, Vector ASC or BLF, PEAK TRC, pcapng, pcap; - is stdin
    file: PathBuf,
    /// Format of a text: log, screen (both of candump), asc, trc [default: recognized]
    #[arg(long, value_name = "FORMAT")]
    format: Option<Format>,
    /// Time stamps of candump's screen: a absolute, d delta, z since the first frame
    /// [default: recognized]
    #[arg(long, value_name = "STYLE")]
    time_stamps: Option<ScreenTimes>,
    /// Channels: one for all frames; with several or all, canN of the log goes to channel N
    #[arg(long, value_name = "CHANNELS", default_value = "0")]
    channel: Channels,
    /// Speed factor, 0.001 to 1000000; 2 is twice the recorded speed
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = parse_speed)]
    speed: f64,
    /// Number of repetitions, or i for infinite
    #[arg(short = 'l', long = "loop", value_name = "TIMES", default_value = "1")]
    loops: Loops,
    /// Record received frames in a candump log, or BLF with the name *.blf; - is stdout
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Exit if no frame is sent for this time
    #[arg(long, value_name = "TIME", default_value = "2s", value_parser = milliseconds::<u64>(ANY_TIME))]
    timeout: u64,
    #[command(flatten)]
    options: FrameOptions,
}

fn parse_speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok().filter(|speed| (0.001..=1e6).contains(speed));
    speed.ok_or_else(|| "expected a factor of 0.001 to 1000000".to_owned())
}

#[derive(Debug)]
struct Recording {
    frames: Vec<Recorded>,
    error_frames: usize,
    /// Recognized, not given.
    screen_times: Option<ScreenTimes>,
    loops: Loops,
    speed: f64,
    given: u64,
}

impl Recording {
    fn read(arguments: &ReplayArguments) -> Result<Self> {
        let ReplayArguments { file, format, time_stamps, channel, .. } = arguments;
        let options = ReadOptions { format: *format, screen_times: *time_stamps };
        let RecordedLog { frames, error_frames, screen_times } =
            read_recording(file, &options, *channel, 1)?;
        let screen_times = screen_times.filter(|_| time_stamps.is_none());
        let name = Printable(arguments.file.display());
        let same = |out: &Path| {
            let file = arguments.file.canonicalize().ok();
            file.is_some() && file == out.canonicalize().ok()
        };
        let (log, capture) = (arguments.record.as_deref(), arguments.options.capture.path());
        for (option, out) in [("--record", log), ("--capture", capture)] {
            if out.is_some_and(same) {
                let message = format!("{option} would overwrite the recording {name}");
                return Err(Failure::Usage(message));
            }
        }
        arguments.options.capture.check_apart_from(log)?;
        let (loops, speed) = (arguments.loops, arguments.speed);
        Ok(Self { frames, error_frames, screen_times, loops, speed, given: 0 })
    }

    fn channels(&self) -> Channels {
        let mask = self.frames.iter().fold(0, |mask, it| mask | 1 << it.channel);
        Channels::of_mask(mask)
    }

    fn total(&self) -> Option<u64> {
        match self.loops {
            Loops::Times(times) => Some(times.saturating_mul(self.frames.len() as u64)),
            Loops::Endless => None,
        }
    }

    fn check_fd(&self, file: &Path, prepared: &Prepared<'_>) -> Result {
        let is_fd = |recorded: &&Recorded| recorded.logged.frame.as_ref().is_fd();
        self.frames.iter().filter(is_fd).try_for_each(|frame| {
            let (name, line) = (Printable(file.display()), frame.logged.line);
            prepared.needs_fd(format_args!("{name}, line {line} is a CAN FD frame"), frame.channel)
        })
    }
}

impl Iterator for Recording {
    type Item = Result<Due>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.total().is_some_and(|total| self.given >= total) {
            return None;
        }
        let length = self.frames.len() as u64;
        let (round, index) = (self.given / length, self.given % length);
        let Recorded { channel, logged, .. } = self.frames.get(usize::try_from(index).ok()?)?;
        self.given += 1;
        let time_ns =
            |recorded: Option<&Recorded>| recorded.map_or(0, |recorded| recorded.logged.time_ns);
        let (first_ns, last_ns) = (time_ns(self.frames.first()), time_ns(self.frames.last()));
        // A repetition starts at the time of the previous last frame, and never before it.
        let round_ns = last_ns.saturating_sub(first_ns).saturating_mul(round);
        let recorded_ns = logged.time_ns.saturating_sub(first_ns).saturating_add(round_ns);
        let after_ns = (recorded_ns as f64 / self.speed) as u64;
        Some(Ok(Due { after_ns, channel: *channel, frame: logged.frame }))
    }
}

pub fn run(arguments: &ReplayArguments, context: &Context) -> Result {
    let ReplayArguments { channel, options, .. } = arguments;
    let log = arguments.record.as_deref();
    let is_output_taken = options.capture.is_on_output() || log.is_some_and(is_standard_stream);
    let context = &context.on_stderr(is_output_taken);
    let recording = Recording::read(arguments)?;
    let total = recording.total();
    let requirements = GatewayRequirements {
        required: recording.channels(),
        directions: &[Direction::RxPdo],
        has_results: true,
        has_end: total.is_some(),
        ..GatewayRequirements::on(*channel)
    };
    let prepared = Prepared::new(options, requirements, context)?;
    recording.check_fd(&arguments.file, &prepared)?;
    let destination = Destination { is_shown: false, log, existing: options.capture.existing() };
    let printer = Printer::start(Screen::default(), destination, &prepared.interrupt)?;
    let Some(service) = prepared.enter_ready()? else {
        return printer.finish();
    };
    if recording.error_frames > 0 {
        note(format_args!("# error frames in the recording skipped: {}", recording.error_frames));
    }
    let other = match recording.screen_times {
        Some(ScreenTimes::SinceFirst) => Some(("since the first frame", "d if they are deltas")),
        Some(ScreenTimes::SincePrevious) => {
            Some(("deltas", "z if they count from the first frame"))
        }
        Some(ScreenTimes::Absolute) | None => None,
    };
    if let Some((times, other)) = other {
        note(format_args!("# time stamps of the recording: {times}; --time-stamps {other}"));
    }
    let timeout_ns = arguments.timeout.saturating_mul(1_000_000);
    let record = Record::Received(printer);
    let sender = Sender { channels: *channel, timeout_ns, record };
    sender.run(service, recording, total, &context.output)
}
