//! `ecan replay`: a recording, sent again at its times.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;
use ecan_command_line::interrupt::Interrupt;
use ecan_command_line::log_file::{self, LoggedFrame};
use ecan_mcan_port::Received;
use ecan_protocol::CHANNELS;

use crate::failure::Failure;
use crate::frames::channels::Channels;
use crate::frames::departures::Departures;
use crate::frames::format::{Heard, Screen};
use crate::frames::options::FrameOptions;
use crate::frames::printer::Printer;
use crate::frames::service::{Cycle, Service};
use crate::frames::settings::{Settings, Wishes};
use crate::frames::summary::Summary;
use crate::global::GlobalOptions;
use crate::output::Output;

/// Examples for the end of the help.
pub const EXAMPLES: &str = "\
Examples:
  ecan replay drive.log                        on channel 0, at the times of the log
  ecan replay drive.log --channel all          frames of can2 on channel 2, and so on
  ecan replay drive.log --speed 10 --loop 5    ten times as fast, five times
  ecan replay drive.log --log back.log         and log what comes back
  ecan replay drive.log --capture both.pcapng  both ways, for Wireshark";

/// How often the recording is sent.
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
            _ => Err("expected a number above 0, or i for ever".to_owned()),
        }
    }
}

/// Arguments of `replay`.
#[derive(Debug, Args)]
pub struct ReplayArguments {
    /// A candump log
    file: PathBuf,
    /// Channel for all frames, or several with commas between, or all: then canN of the log goes to
    /// channel N, and frames of other interfaces stay out
    #[arg(long, value_name = "CHANNELS", default_value = "0")]
    channel: Channels,
    /// So many times as fast as recorded
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = parse_speed)]
    speed: f64,
    /// So many times over, or i for ever
    #[arg(short = 'l', long = "loop", value_name = "TIMES", default_value = "1")]
    loops: Loops,
    /// Log what comes from the bus meanwhile
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// End where no frame leaves for so many milliseconds
    #[arg(long, value_name = "MS", default_value_t = 2000)]
    timeout: u64,
    #[command(flatten)]
    options: FrameOptions,
}

fn parse_speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok().filter(|speed| (0.001..=1e6).contains(speed));
    speed.ok_or_else(|| "expected a factor of 0.001 to 1000000".to_owned())
}

/// The recording, round after round.
#[derive(Debug)]
struct Recording {
    frames: Vec<(u8, LoggedFrame)>,
    loops: Loops,
    speed: f64,
    sent: u64,
}

impl Recording {
    fn read(arguments: &ReplayArguments, settings: &Settings<'_>) -> Result<Self, Failure> {
        let frames: Vec<_> = log_file::read(&arguments.file)?
            .into_iter()
            .filter_map(|it| Some((channel_of(&it, arguments.channel)?, it)))
            .collect();
        let name = arguments.file.display();
        if frames.is_empty() {
            let words = format!("{name} holds no frame of a chosen channel");
            return Err(Failure::Usage(words));
        }
        let is_impossible = |(channel, it): &&(u8, LoggedFrame)| {
            it.frame.as_ref().is_fd() && !settings.has_fd(*channel)
        };
        if let Some((channel, fd)) = frames.iter().find(is_impossible) {
            let what = format!("{name}, line {} is a CAN FD frame", fd.line);
            return Err(settings.without_fd(what, *channel));
        }
        let same = |out: &Path| {
            let file = arguments.file.canonicalize().ok();
            file.is_some() && file == out.canonicalize().ok()
        };
        let (log, capture) = (arguments.log.as_deref(), arguments.options.capture.path());
        for (option, out) in [("--log", log), ("--capture", capture)] {
            if out.is_some_and(same) {
                let words = format!("{option} would overwrite the recording {name}");
                return Err(Failure::Usage(words));
            }
        }
        arguments.options.capture.check_apart_from(log)?;
        Ok(Self { frames, loops: arguments.loops, speed: arguments.speed, sent: 0 })
    }

    /// The channels that it goes to.
    fn channels(&self) -> Channels {
        let mask = self.frames.iter().fold(0, |mask, (channel, _)| mask | 1 << channel);
        Channels::of_mask(mask)
    }

    /// Frames in all, if there is an end.
    fn total(&self) -> Option<u64> {
        match self.loops {
            Loops::Times(times) => Some(times.saturating_mul(self.frames.len() as u64)),
            Loops::Endless => None,
        }
    }

    /// The next frame, when it is due in nanoseconds after the start, and its channel.
    fn next(&self) -> Option<(u64, u8, &LoggedFrame)> {
        if self.total().is_some_and(|total| self.sent >= total) {
            return None;
        }
        let length = self.frames.len() as u64;
        let (round, place) = (self.sent / length, self.sent % length);
        let (channel, frame) = self.frames.get(usize::try_from(place).ok()?)?;
        let time_ns = |frame: Option<&(u8, LoggedFrame)>| frame.map_or(0, |(_, it)| it.time_ns);
        let (first_ns, last_ns) = (time_ns(self.frames.first()), time_ns(self.frames.last()));
        // A round follows the one before as its last frame followed the first, and none may stand
        // before it.
        let round_ns = last_ns.saturating_sub(first_ns).saturating_mul(round);
        let recorded_ns = frame.time_ns.saturating_sub(first_ns).saturating_add(round_ns);
        Some(((recorded_ns as f64 / self.speed) as u64, *channel, frame))
    }
}

/// The channel of a recorded frame.
fn channel_of(logged: &LoggedFrame, channels: Channels) -> Option<u8> {
    let mut chosen = channels.iter();
    if let (Some(only), None) = (chosen.next(), chosen.next()) {
        return Some(only);
    }
    let digits = logged.interface.trim_start_matches(|c: char| !c.is_ascii_digit());
    let channel = digits.parse().ok().filter(|channel| usize::from(*channel) < CHANNELS)?;
    channels.contains(channel).then_some(channel)
}

pub fn run(
    arguments: &ReplayArguments,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    let settings = Settings::of(&arguments.options.gateway)?;
    let mut recording = Recording::read(arguments, &settings)?;
    let interrupt = Interrupt::install().map_err(|error| Failure::Master(error.to_string()))?;
    let mut printer = Printer::start(Screen::default(), false, arguments.log.as_deref())?;
    let has_end = recording.total().is_some();
    let wishes = Wishes {
        required: recording.channels(),
        has_results: true,
        has_end,
        ..Wishes::on(arguments.channel)
    };
    let capture = &arguments.options.capture;
    let opened = Service::open(&settings, capture, wishes, &interrupt, global, output)?;
    let Some(mut service) = opened else { return printer.finish(output) };
    let start_ns = service.now_ns();
    let mut departures = Departures::new(arguments.channel, start_ns);
    let timeout_ns = arguments.timeout.saturating_mul(1_000_000);
    let mut is_stuck = false;
    while !is_stuck && !interrupt.is_set() && !printer.is_over() && recording.next().is_some() {
        let cycle = service.begin();
        departures.look(&cycle, service.port());
        record(&mut printer, &service, &cycle);
        let mut has_room = true;
        while let Some((due_ns, channel, logged)) = recording.next()
            && has_room
            && due_ns <= cycle.now_ns - start_ns
        {
            match service.send(channel, &logged.frame)? {
                Some(ticket) => {
                    departures.taken(ticket, cycle.now_ns);
                    recording.sent += 1;
                }
                // It waits for the next cycle, and with it all behind it: their order holds.
                None => has_room = false,
            }
        }
        is_stuck = !has_room && departures.standstill_ns(cycle.now_ns) >= timeout_ns;
        service.end(cycle)?;
    }
    let elapsed_ns = service.now_ns() - start_ns;
    departures.wait(&mut service, timeout_ns, &interrupt, |service, cycle| {
        record(&mut printer, service, cycle);
    })?;
    printer.finish(output)?;
    service.finish_capture()?;
    let wanted = recording.total().filter(|_| !interrupt.is_set()).unwrap_or(departures.count());
    let summary = Summary::of(&departures, service.port(), wanted, elapsed_ns);
    summary.print(output)?;
    summary.judge(departures.outcome(service.port()).cause(service.port()))
}

/// Logs what a cycle brought.
fn record(printer: &mut Printer, service: &Service, cycle: &Cycle) {
    for arrival in &cycle.arrivals {
        if let Received::Frame(received) = arrival.received {
            let time_ns = service.absolute_ns(arrival.time_ns);
            printer.put(Heard { time_ns, received }, service.is_real_time());
        }
    }
}
