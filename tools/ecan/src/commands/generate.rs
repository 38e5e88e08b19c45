//! `ecan gen`: cangen through a gateway.

use std::str::FromStr;

use clap::Args;
use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameError};
use ecan_protocol::mapping::Direction;
use ecan_tool_support::command_line::options::{ANY_TIME, milliseconds, parse_time};
use fastrand::Rng;

use crate::context::{Context, Failure, Result};
use crate::frames::{
    Channels, Destination, Due, FrameOptions, GatewayRequirements, Prepared, Printer, Record,
    Screen, Sender, parse_channel,
};

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
    /// Gap between frames; 0 sends at full bus load
    #[arg(short = 'g', long, value_name = "TIME", default_value = "200ms", value_parser = parse_gap)]
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
    /// Exit if no frame is sent for this time
    #[arg(long, value_name = "TIME", default_value = "2s", value_parser = milliseconds::<u64>(ANY_TIME))]
    timeout: u64,
    #[command(flatten)]
    options: FrameOptions,
}

/// Parses a time up to an hour, in nanoseconds.
fn parse_gap(text: &str) -> Result<u64, String> {
    let gap = parse_time(text)?;
    if gap <= 3_600_000_000_000 { Ok(gap) } else { Err("expected at most 3600s".to_owned()) }
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
    let Some(service) = prepared.enter_ready()? else {
        return printer.finish();
    };
    let frames = (0..count.unwrap_or(u64::MAX)).map(|number| {
        let frame = generator.next_frame().map_err(|error| Failure::Usage(error.to_string()))?;
        Ok(Due { after_ns: gap.saturating_mul(number), channel: *channel, frame })
    });
    let timeout_ns = arguments.timeout.saturating_mul(1_000_000);
    let record = Record::Sent(printer);
    let sender = Sender { channels, timeout_ns, record };
    sender.run(service, frames, *count, &context.output)
}

/// Number of data bytes of an incremented counter.
const COUNTER_BYTES: usize = 8;
const RANDOM_DIGIT: char = 'x';

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum IdMode {
    Random,
    Even,
    Odd,
    Increment,
    Fixed(u32),
}

impl FromStr for IdMode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "r" => Self::Random,
            "e" => Self::Even,
            "o" => Self::Odd,
            "i" => Self::Increment,
            digits => Self::Fixed(
                u32::from_str_radix(digits, 16)
                    .ok()
                    .filter(|_| digits.bytes().all(|digit| digit.is_ascii_hexdigit()))
                    .ok_or("expected r, e, o, i or a hexadecimal CAN ID")?,
            ),
        })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LengthMode {
    Random,
    Increment,
    Fixed(usize),
}

impl FromStr for LengthMode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "r" => Self::Random,
            "i" => Self::Increment,
            digits => Self::Fixed(
                digits
                    .parse()
                    .ok()
                    .filter(|length| Dlc::from_fd_len(*length).is_some())
                    .ok_or("expected r, i or a length: 0 to 8, or up to 64 for CAN FD")?,
            ),
        })
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum DataMode {
    Random,
    Increment,
    /// Digits from the first byte on; `None` is a random digit.
    Fixed(Vec<Option<u8>>),
}

impl FromStr for DataMode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = || "expected r, i or hexadecimal bytes, with x for a random digit".to_owned();
        let digit = |letter: char| match letter {
            RANDOM_DIGIT => Ok(None),
            letter => letter.to_digit(16).map(|digit| Some(digit as u8)).ok_or_else(wrong),
        };
        match text {
            "r" => Ok(Self::Random),
            "i" => Ok(Self::Increment),
            text => {
                let digits: Vec<_> = text.chars().map(digit).collect::<Result<_, _>>()?;
                let is_whole = digits.len().is_multiple_of(2) && !digits.is_empty();
                if is_whole && digits.len() <= 128 { Ok(Self::Fixed(digits)) } else { Err(wrong()) }
            }
        }
    }
}

#[derive(Clone, Debug)]
struct Pattern {
    pub id: IdMode,
    pub length: LengthMode,
    pub data: DataMode,
    pub is_extended: bool,
    pub is_remote: bool,
    pub is_fd: bool,
    pub has_bit_rate_switch: bool,
    /// Mixes formats at random, with CAN FD if `is_fd`.
    pub is_mixed: bool,
}

#[derive(Debug)]
struct Generator {
    pattern: Pattern,
    random: Rng,
    made: u64,
}

impl Generator {
    pub fn new(pattern: Pattern, seed: u64) -> Result<Self, FrameError> {
        if let IdMode::Fixed(id) = pattern.id {
            CanId::new(id, pattern.is_extended)?;
        }
        if let LengthMode::Fixed(length) = pattern.length {
            let is_classic = !pattern.is_fd || pattern.is_mixed;
            if is_classic && Dlc::from_classic_len(length).is_none() {
                return Err(FrameError::Length { length, fd: false });
            }
        }
        Ok(Self { pattern, random: Rng::with_seed(seed), made: 0 })
    }

    pub fn without_fd(mut self) -> Self {
        self.pattern.is_fd = false;
        self
    }

    pub fn next_frame(&mut self) -> Result<CanFrame, FrameError> {
        let Pattern { is_mixed, is_fd, has_bit_rate_switch, is_remote, .. } = self.pattern;
        let is_fd = is_fd && (!is_mixed || self.random.bool());
        let has_bit_rate_switch = has_bit_rate_switch && (!is_mixed || self.random.bool());
        let is_remote = !is_fd && (is_remote || is_mixed && self.random.u8(..8) == 0);
        let id = self.id()?;
        let length = self.length(is_fd);
        let mut data = [0; 64];
        self.fill(&mut data);
        self.made += 1;
        let bytes = data.get(..length).unwrap_or_default();
        if is_fd {
            CanFrame::fd(id, bytes, has_bit_rate_switch, false)
        } else if is_remote {
            let dlc = Dlc::from_classic_len(length);
            CanFrame::remote(id, dlc.ok_or(FrameError::Length { length, fd: false })?)
        } else {
            CanFrame::classic(id, bytes)
        }
    }

    fn id(&mut self) -> Result<CanId, FrameError> {
        let is_extended =
            if self.pattern.is_mixed { self.random.bool() } else { self.pattern.is_extended };
        let highest = if is_extended { CanId::MAX_EXTENDED } else { CanId::MAX_STANDARD };
        let raw = match self.pattern.id {
            IdMode::Random => self.random.u32(..),
            IdMode::Even => self.random.u32(..) & !1,
            IdMode::Odd => self.random.u32(..) | 1,
            IdMode::Increment => self.made as u32,
            IdMode::Fixed(id) => id,
        };
        CanId::new(raw & highest, is_extended)
    }

    fn length(&mut self, is_fd: bool) -> usize {
        let codes: u8 = if is_fd { 16 } else { 9 };
        let code = match self.pattern.length {
            LengthMode::Fixed(length) => return length,
            LengthMode::Random => self.random.u8(..codes),
            LengthMode::Increment => (self.made % u64::from(codes)) as u8,
        };
        let length = Dlc::new(code).map_or(0, Dlc::fd_len);
        // An incremented counter needs at least one byte.
        length.max(usize::from(self.pattern.data == DataMode::Increment))
    }

    fn fill(&mut self, data: &mut [u8; 64]) {
        match &self.pattern.data {
            DataMode::Random => self.random.fill(data),
            DataMode::Increment => {
                let (counter, _) = data.split_at_mut(COUNTER_BYTES);
                counter.copy_from_slice(&self.made.to_le_bytes());
            }
            DataMode::Fixed(digits) => {
                let random = &mut self.random;
                let mut value = |digit: Option<u8>| digit.unwrap_or_else(|| random.u8(..16));
                for (byte, pair) in data.iter_mut().zip(digits.chunks_exact(2)) {
                    if let [high, low] = pair {
                        *byte = value(*high) << 4 | value(*low);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use ecan_can_io::candump::FrameText;

    use super::*;

    fn pattern(id: &str, length: &str, data: &str) -> Pattern {
        Pattern {
            id: id.parse().unwrap(),
            length: length.parse().unwrap(),
            data: data.parse().unwrap(),
            is_extended: false,
            is_remote: false,
            is_fd: false,
            has_bit_rate_switch: false,
            is_mixed: false,
        }
    }

    fn made(pattern: Pattern, count: usize) -> Vec<String> {
        let mut generator = Generator::new(pattern, 1).unwrap();
        (0..count).map(|_| FrameText(&generator.next_frame().unwrap()).to_string()).collect()
    }

    #[test]
    fn fixed_and_incremented_frames_match_cangen() {
        assert_eq!(made(pattern("42A", "1", "i"), 3), ["42A#00", "42A#01", "42A#02"]);
        assert_eq!(
            made(pattern("i", "i", "11223344"), 4),
            ["000#", "001#11", "002#1122", "003#112233"]
        );
        assert_eq!(made(pattern("1", "i", "i"), 2), ["001#00", "001#01"]);
        let extended =
            Pattern { is_extended: true, ..pattern("12345678", "8", "1122334455667788") };
        assert_eq!(made(extended, 1), ["12345678#1122334455667788"]);
        let remote = Pattern { is_remote: true, ..pattern("1", "2", "r") };
        assert_eq!(made(remote, 1), ["001#R2"]);
        let fd = Pattern { is_fd: true, has_bit_rate_switch: true, ..pattern("1", "12", "AA") };
        assert_eq!(made(fd, 1), ["001##1AA0000000000000000000000"]);
    }

    #[test]
    fn random_frames_respect_bounds_and_seed() {
        let frames = made(pattern("o", "r", "r"), 200);
        assert_eq!(frames, made(pattern("o", "r", "r"), 200));
        let read = |text: &String| ecan_can_io::candump::parse_frame(text).unwrap();
        assert!(frames.iter().all(|text| read(text).id().raw() % 2 == 1));
        let lengths: std::collections::BTreeSet<_> =
            frames.iter().map(|text| read(text).data().len()).collect();
        assert_eq!(lengths.into_iter().collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 6, 7, 8]);
        for text in made(pattern("1", "2", "1xx2"), 50) {
            let data = read(&text).data().to_vec();
            assert_eq!((data[0] >> 4, data[1] & 15), (1, 2), "{text}");
        }
        let mixed = Pattern { is_mixed: true, is_fd: true, ..pattern("r", "r", "r") };
        let frames: Vec<_> = made(mixed, 200).iter().map(read).collect();
        assert!(frames.iter().any(|frame| frame.as_ref().is_fd()));
        assert!(frames.iter().any(|frame| frame.kind() == ecan_protocol::can::FrameKind::Remote));
        assert!(frames.iter().any(|frame| frame.id().is_extended()));
        assert!(frames.iter().any(|frame| !frame.id().is_extended()));
    }

    #[test]
    fn invalid_pattern_is_rejected() {
        assert!(Generator::new(pattern("800", "1", "r"), 1).is_err());
        assert!(Generator::new(pattern("1", "12", "r"), 1).is_err());
        assert!("9".parse::<LengthMode>().is_err());
        assert!("xyz".parse::<DataMode>().is_err());
        assert!("123".parse::<DataMode>().is_err());
        assert!("g".parse::<IdMode>().is_err());
    }
}
