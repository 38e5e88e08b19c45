//! `ecan gen`: cangen through a gateway.

mod generator;

use clap::Args;
use ecan_protocol::mapping::Direction;

use crate::context::{Context, Failure, Result};
use crate::frames::{
    Channels, Destination, Due, FrameOptions, GatewayRequirements, Prepared, Printer, Record,
    Screen, Sender, parse_channel,
};
use generator::{DataMode, Generator, IdMode, LengthMode, Pattern};

pub const EXAMPLES: &str = "\
Examples:
  ecan gen                                     random frames, 5 per second, until Ctrl-C
  ecan gen -g 4 -I 42A -L 1 -D i -n 100        fixed CAN ID and length, incremented data
  ecan gen -g 0 -n 100000                      at full bus load
  ecan gen --data-bitrate 2000000 -b -L 64     CAN FD with bit rate switch

Modes: r random, i incremented; for CAN IDs also e random even and o random odd; any other value is
fixed. In data, x is a random digit, for example 11xx3344.";

#[derive(Debug, Args)]
pub struct GenArguments {
    /// CAN channel, 0 to 3
    #[arg(long, value_name = "N", default_value = "0", value_parser = parse_channel)]
    channel: u8,
    /// Gap between frames in ms, decimals allowed; 0 sends at full bus load
    #[arg(short = 'g', long, value_name = "MS", default_value = "200", value_parser = parse_gap)]
    gap: u64,
    /// Exit after this number of frames
    #[arg(short = 'n', long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..))]
    count: Option<u64>,
    /// CAN ID: r random, e random even, o random odd, i incremented, or hexadecimal
    #[arg(short = 'I', long, value_name = "MODE", default_value = "r")]
    id: IdMode,
    /// Length: r random, i incremented, or 0 to 8 (CAN FD: up to 64)
    #[arg(short = 'L', long, value_name = "MODE", default_value = "r")]
    length: LengthMode,
    /// Data: r random, i incremented, or hexadecimal with x for a random digit
    #[arg(short = 'D', long, value_name = "MODE", default_value = "r")]
    data: DataMode,
    /// Send extended CAN IDs
    #[arg(short = 'e', long)]
    extended: bool,
    /// Send CAN FD frames; needs a data bit rate (--data-bitrate or --config)
    #[arg(short = 'f', long)]
    fd: bool,
    /// Send CAN FD frames with bit rate switch
    #[arg(short = 'b', long)]
    brs: bool,
    /// Send remote frames
    #[arg(short = 'R', long, conflicts_with_all = ["fd", "brs"])]
    remote: bool,
    /// Mix standard, extended, remote and, with a data bit rate, CAN FD frames
    #[arg(short = 'm', long, conflicts_with_all = ["extended", "fd", "brs", "remote"])]
    mix: bool,
    /// Print the frames
    #[arg(short = 'v', long)]
    verbose: bool,
    /// Seed of the random generator [default: different in each run]
    #[arg(long, value_name = "SEED")]
    seed: Option<u64>,
    /// Exit if no frame is sent for this time, in ms
    #[arg(long, value_name = "MS", default_value_t = 2000)]
    timeout: u64,
    #[command(flatten)]
    options: FrameOptions,
}

/// Parses milliseconds with decimals, in nanoseconds.
fn parse_gap(text: &str) -> Result<u64, String> {
    let gap: f64 = text.parse().map_err(|_| "expected milliseconds".to_owned())?;
    if (0.0..=3.6e6).contains(&gap) {
        Ok((gap * 1e6).round() as u64)
    } else {
        Err("expected 0 to 3600000 milliseconds".to_owned())
    }
}

impl GenArguments {
    fn generator(&self) -> Result<Generator> {
        let pattern = Pattern {
            id: self.id,
            length: self.length,
            data: self.data.clone(),
            is_extended: self.extended,
            is_remote: self.remote,
            is_fd: self.fd || self.brs || self.mix,
            has_bit_rate_switch: self.brs || self.mix,
            is_mixed: self.mix,
        };
        let seed = self.seed.unwrap_or_else(|| fastrand::u64(..));
        Generator::new(pattern, seed).map_err(|error| Failure::Usage(error.to_string()))
    }
}

pub fn run(arguments: &GenArguments, context: &Context) -> Result {
    let GenArguments { channel, count, gap, options, .. } = arguments;
    let is_output_taken = options.capture.is_on_output();
    if arguments.verbose && is_output_taken {
        let message = "--verbose and a capture on standard output exclude each other";
        return Err(Failure::Usage(message.to_owned()));
    }
    let context = &context.on_stderr(is_output_taken);
    let mut generator = arguments.generator()?;
    let channels = Channels::only(*channel);
    let requirements = GatewayRequirements {
        directions: &[Direction::RxPdo],
        has_results: true,
        has_end: count.is_some(),
        ..GatewayRequirements::on(channels)
    };
    let prepared = Prepared::new(options, requirements, context)?;
    if arguments.fd || arguments.brs {
        prepared.needs_fd("CAN FD frames are requested", *channel)?;
    }
    if !prepared.has_fd(*channel) {
        generator = generator.without_fd();
    }
    let is_shown = arguments.verbose && !context.global.json;
    let destination = Destination { is_shown, log: None, existing: options.capture.existing() };
    let printer = Printer::start(Screen::default(), destination, &prepared.interrupt)?;
    let Some(service) = prepared.enter()? else {
        return printer.finish();
    };
    let frames = (0..count.unwrap_or(u64::MAX)).map(|number| {
        let frame = generator.next_frame().map_err(|it| Failure::Usage(it.to_string()))?;
        Ok(Due { after_ns: gap.saturating_mul(number), channel: *channel, frame })
    });
    let timeout_ns = arguments.timeout.saturating_mul(1_000_000);
    let record = Record::Sent(printer);
    let sender = Sender { channels, timeout_ns, record };
    sender.run(service, frames, *count, &context.output)
}
