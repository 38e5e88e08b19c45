//! `ecan gen`: cangen through a gateway.

mod generator;

use clap::Args;
use ecan_command_line::interrupt::Interrupt;
use ecan_mcan_port::{ReceiveSource, ReceivedFrame};
use ecan_protocol::{CanFrame, Timestamp};

use crate::failure::Failure;
use crate::frames::channels::{Channels, parse_channel};
use crate::frames::departures::Departures;
use crate::frames::format::{Heard, Screen};
use crate::frames::options::FrameOptions;
use crate::frames::printer::Printer;
use crate::frames::service::Service;
use crate::frames::settings::{Settings, Wishes};
use crate::frames::summary::Summary;
use crate::global::GlobalOptions;
use crate::output::Output;
use generator::{DataMode, Generator, IdMode, LengthMode, Pattern};

/// Examples for the end of the help.
pub const EXAMPLES: &str = "\
Examples:
  ecan gen                                     random frames, five a second, until Ctrl-C
  ecan gen -g 4 -I 42A -L 1 -D i -n 100        fixed identifier and length, counted data
  ecan gen -g 0 -n 100000                      as many as the bus takes
  ecan gen --data-bitrate 2000000 -b -L 64     CAN FD with bit rate switch

Modes: r random, i counted up; of identifiers also e random even and o random odd; anything else is
fixed. In data x is a random digit, as in 11xx3344.";

/// Arguments of `gen`.
#[derive(Debug, Args)]
pub struct GenArguments {
    /// Channel, 0 to 3
    #[arg(long, value_name = "N", default_value = "0", value_parser = parse_channel)]
    channel: u8,
    /// Gap between frames in milliseconds, also with decimals; 0 sends what the bus takes
    #[arg(short = 'g', long, value_name = "MS", default_value = "200", value_parser = parse_gap)]
    gap: u64,
    /// End after so many frames
    #[arg(short = 'n', long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..))]
    count: Option<u64>,
    /// Identifier
    #[arg(short = 'I', long, value_name = "MODE", default_value = "r")]
    id: IdMode,
    /// Length
    #[arg(short = 'L', long, value_name = "MODE", default_value = "r")]
    length: LengthMode,
    /// Data
    #[arg(short = 'D', long, value_name = "MODE", default_value = "r")]
    data: DataMode,
    /// Extended identifiers
    #[arg(short = 'e', long)]
    extended: bool,
    /// CAN FD frames; needs --data-bitrate, or a data bit rate in the file of --config
    #[arg(short = 'f', long)]
    fd: bool,
    /// CAN FD frames with bit rate switch; as with --fd
    #[arg(short = 'b', long)]
    brs: bool,
    /// Remote frames
    #[arg(short = 'R', long, conflicts_with_all = ["fd", "brs"])]
    remote: bool,
    /// Mix formats: standard and extended, remote, and CAN FD where there is a data bit rate
    #[arg(short = 'm', long, conflicts_with_all = ["extended", "fd", "brs", "remote"])]
    mix: bool,
    /// Print the frames
    #[arg(short = 'v', long)]
    verbose: bool,
    /// Seed of what is random [default: another in each run]
    #[arg(long, value_name = "SEED")]
    seed: Option<u64>,
    /// End where no frame leaves for so many milliseconds
    #[arg(long, value_name = "MS", default_value_t = 2000)]
    timeout: u64,
    #[command(flatten)]
    options: FrameOptions,
}

/// Milliseconds with decimals, as nanoseconds.
fn parse_gap(text: &str) -> Result<u64, String> {
    let gap: f64 = text.parse().map_err(|_| "expected milliseconds".to_owned())?;
    if (0.0..=3.6e6).contains(&gap) {
        Ok((gap * 1e6).round() as u64)
    } else {
        Err("expected 0 to 3600000 milliseconds".to_owned())
    }
}

impl GenArguments {
    fn generator(&self, settings: &Settings<'_>) -> Result<Generator, Failure> {
        let has_fd = settings.has_fd(self.channel);
        if (self.fd || self.brs) && !has_fd {
            return Err(settings.without_fd("CAN FD needs the data bit rate", self.channel));
        }
        let pattern = Pattern {
            id: self.id,
            length: self.length,
            data: self.data.clone(),
            is_extended: self.extended,
            is_remote: self.remote,
            is_fd: self.fd || self.brs || self.mix && has_fd,
            has_bit_rate_switch: self.brs || self.mix && has_fd,
            is_mixed: self.mix,
        };
        let seed = self.seed.unwrap_or_else(|| fastrand::u64(..));
        Generator::new(pattern, seed).map_err(|error| Failure::Usage(error.to_string()))
    }
}

pub fn run(
    arguments: &GenArguments,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    let settings = Settings::of(&arguments.options.gateway)?;
    let mut generator = arguments.generator(&settings)?;
    let interrupt = Interrupt::install().map_err(|error| Failure::Master(error.to_string()))?;
    let is_shown = arguments.verbose && !global.json;
    let mut printer = Printer::start(Screen::default(), is_shown, None)?;
    let channels = Channels::only(arguments.channel);
    let has_end = arguments.count.is_some();
    let wishes = Wishes { has_results: true, has_end, ..Wishes::on(channels) };
    let capture = &arguments.options.capture;
    let opened = Service::open(&settings, capture, wishes, &interrupt, global, output)?;
    let Some(mut service) = opened else { return printer.finish(output) };
    let start_ns = service.now_ns();
    let mut departures = Departures::new(channels, start_ns);
    let timeout_ns = arguments.timeout.saturating_mul(1_000_000);
    let mut next = None;
    let mut is_stuck = false;
    while !is_stuck
        && !interrupt.is_set()
        && !printer.is_over()
        && arguments.count != Some(departures.count())
    {
        let cycle = service.begin();
        departures.look(&cycle, service.port());
        let mut has_room = true;
        while has_room
            && arguments.count != Some(departures.count())
            && due_ns(arguments, start_ns, departures.count()) <= cycle.now_ns
        {
            let frame = match next.take() {
                Some(frame) => frame,
                None => generator.next_frame().map_err(|it| Failure::Usage(it.to_string()))?,
            };
            match service.send(arguments.channel, &frame)? {
                Some(ticket) => {
                    departures.taken(ticket, cycle.now_ns);
                    printer.put(shown(arguments.channel, frame), service.is_real_time());
                }
                None => (next, has_room) = (Some(frame), false),
            }
        }
        // A long gap is no standstill.
        is_stuck = !has_room && departures.standstill_ns(cycle.now_ns) >= timeout_ns;
        service.end(cycle)?;
    }
    departures.wait(&mut service, timeout_ns, &interrupt, |_, _| {})?;
    printer.finish(output)?;
    service.finish_capture()?;
    let wanted = arguments.count.filter(|_| !interrupt.is_set()).unwrap_or(departures.count());
    let elapsed_ns = service.now_ns() - start_ns;
    let summary = Summary::of(&departures, service.port(), wanted, elapsed_ns);
    summary.print(output)?;
    summary.judge(departures.outcome(service.port()).cause(service.port()))
}

/// When the frame of a number is due.
fn due_ns(arguments: &GenArguments, start_ns: u64, number: u64) -> u64 {
    start_ns.saturating_add(arguments.gap.saturating_mul(number))
}

/// A frame for the screen, which shows no times.
fn shown(channel: u8, frame: CanFrame) -> Heard {
    let (timestamp, source) = (Timestamp::None, ReceiveSource::default());
    Heard { time_ns: 0, received: ReceivedFrame { slave: 0, channel, frame, timestamp, source } }
}
