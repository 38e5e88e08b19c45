//! slcan: the ASCII protocol of Lawicel's serial CAN adapters, with the CAN FD commands of the
//! CANable 2 firmware.

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameKind};

use super::config::{BusRates, Uplink};

#[cfg(test)]
mod command_tests;
#[cfg(test)]
mod session_tests;

/// Ends a command; alone it is the answer "done".
const OK: u8 = b'\r';
/// The answer "rejected".
const BELL: u8 = 0x07;

/// Hardware and software version, two digits each.
const VERSION: &[u8] = b"V1010";
/// Four characters, as Lawicel's have.
const SERIAL_NUMBER: &[u8] = b"NECAN";
/// Status flags: receive queue full, error warning, data overrun, arbitration lost, bus error. "Transmit queue full",
/// bit 1, is never set, since a client waits; nor is "error passive", bit 5: the status word of the gateway has one
/// bit for warning and passive.
const FLAG_RECEIVE_FULL: u32 = 1 << 0;
const FLAG_WARNING: u32 = 1 << 2;
const FLAG_OVERRUN: u32 = 1 << 3;
const FLAG_ARBITRATION: u32 = 1 << 6;
const FLAG_BUS_ERROR: u32 = 1 << 7;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Mode {
    #[default]
    Closed,
    Listening,
    Open,
}

/// The adapter of one client.
///
/// A client cannot change the bit rates of the bus: other ones are rejected, and the channel does not open with them.
/// The queue to the bus stops a client that sends faster than the bus.
#[derive(Debug)]
pub(super) struct SlcanSession {
    line: Vec<u8>,
    /// The line is too long; the rest of it is ignored.
    overlong: bool,
    receive_settings: SlcanReceiveSettings,
    /// Set since the flags were last read.
    flags: u32,
}

impl SlcanSession {
    pub(crate) fn new() -> Self {
        Self {
            line: Vec::with_capacity(MAX_LINE),
            overlong: false,
            receive_settings: SlcanReceiveSettings::default(),
            flags: 0,
        }
    }

    /// Processes input. Line feeds between lines are ignored.
    pub(crate) fn feed(&mut self, bytes: &[u8], bus: &mut impl Uplink, answer: &mut Vec<u8>) {
        for &byte in bytes {
            match byte {
                b'\r' => self.line_ends(bus, answer),
                b'\n' if self.line.is_empty() && !self.overlong => {}
                _ if self.line.len() < MAX_LINE => self.line.push(byte),
                _ => self.overlong = true,
            }
        }
    }

    fn line_ends(&mut self, bus: &mut impl Uplink, answer: &mut Vec<u8>) {
        let overlong = std::mem::take(&mut self.overlong);
        let command = if overlong { Err(UnknownCommand) } else { parse(&self.line) };
        self.line.clear();
        let done = command.is_ok_and(|command| self.run(command, bus, answer));
        if done {
            answer.push(OK);
        } else {
            bus.count_rejected();
            answer.push(BELL);
        }
    }

    /// Executes a command and appends the answer up to its end; returns false to reject it, without
    /// an answer.
    fn run(&mut self, command: SlcanCommand, bus: &mut impl Uplink, answer: &mut Vec<u8>) -> bool {
        use SlcanCommand as Command;
        let is_closed = self.receive_settings.mode == Mode::Closed;
        match command {
            Command::Nothing | Command::AutoPoll => return true,
            Command::Close => self.receive_settings.mode = Mode::Closed,
            Command::Version => answer.extend(VERSION),
            Command::SerialNumber => answer.extend(SERIAL_NUMBER),
            Command::Flags if !is_closed => {
                let conditions = bus.take_conditions();
                for (is_set, flags) in [
                    (conditions.bus_error, FLAG_BUS_ERROR),
                    (conditions.overrun, FLAG_RECEIVE_FULL | FLAG_OVERRUN),
                    (conditions.warning, FLAG_WARNING),
                    (conditions.lost_arbitration, FLAG_ARBITRATION),
                ] {
                    self.flags |= if is_set { flags } else { 0 };
                }
                answer.push(b'F');
                hex(std::mem::take(&mut self.flags), 2, answer);
            }
            Command::Transmit(frame) if self.receive_settings.mode == Mode::Open => {
                return self.transmit(frame, bus, answer);
            }
            // Harmless, as closing a closed channel: python-can does both.
            Command::Open if self.receive_settings.mode == Mode::Open => {}
            Command::OpenListening if self.receive_settings.mode == Mode::Listening => {}
            // Everything else requires a closed channel.
            _ if !is_closed => return false,
            Command::Open => return self.open(Mode::Open, bus),
            Command::OpenListening => return self.open(Mode::Listening, bus),
            Command::Bitrate(bitrate) => {
                self.receive_settings.bitrate = Some(bitrate);
                return self.shares_rates(bus);
            }
            Command::DataBitrate(bitrate) => {
                self.receive_settings.data_bitrate = Some(bitrate);
                return self.shares_rates(bus);
            }
            Command::Timestamps(wanted) => self.receive_settings.timestamps = wanted,
            Command::AcceptAll => {}
            Command::Flags | Command::Transmit(_) => return false,
        }
        true
    }

    fn open(&mut self, mode: Mode, bus: &mut impl Uplink) -> bool {
        let opens = self.shares_rates(bus);
        if opens {
            self.receive_settings.mode = mode;
        }
        opens
    }

    /// Returns whether the bit rates of the client are those of the bus, as far as both are known.
    fn shares_rates(&self, bus: &mut impl Uplink) -> bool {
        let shares = bus.bus().is_none_or(|rates| self.receive_settings.shares(&rates));
        if !shares {
            bus.count_mismatched();
        }
        shares
    }

    fn transmit(&mut self, frame: CanFrame, bus: &mut impl Uplink, answer: &mut Vec<u8>) -> bool {
        if bus.bus().is_some_and(|config| !self.receive_settings.fits(&frame, &config)) {
            bus.count_mismatched();
            return false;
        }
        if !bus.send(frame) {
            self.flags |= FLAG_BUS_ERROR;
            return false;
        }
        answer.push(if frame.id().is_extended() { b'Z' } else { b'z' });
        true
    }

    /// Returns whether the channel is open, also for listening only.
    pub(crate) fn is_open(&self) -> bool {
        self.receive_settings.mode != Mode::Closed
    }

    pub(crate) fn receive_settings(&self) -> SlcanReceiveSettings {
        self.receive_settings
    }
}

/// Channel settings: they select the frames that pass between the client and the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct SlcanReceiveSettings {
    mode: Mode,
    bitrate: Option<NamedRate>,
    data_bitrate: Option<NamedRate>,
    timestamps: bool,
}

impl SlcanReceiveSettings {
    fn shares(&self, bus: &BusRates) -> bool {
        let shares = |named: Option<NamedRate>, real| named.is_none_or(|named| named.fits(real));
        shares(self.bitrate, bus.nominal_bitrate)
            && (!bus.fd || shares(self.data_bitrate, bus.data_bitrate))
    }

    fn fits(&self, frame: &CanFrame, bus: &BusRates) -> bool {
        let shares = |named: Option<NamedRate>, real| named.is_none_or(|named| named.fits(real));
        let is_fast = matches!(frame.kind(), FrameKind::Fd { brs: true, .. });
        shares(self.bitrate, bus.nominal_bitrate)
            && (bus.fd || !frame.is_fd())
            && (!is_fast || shares(self.data_bitrate, bus.data_bitrate))
    }

    /// Appends a frame of the bus if the channel is open and the bit rates match.
    pub(crate) fn encode(
        &self,
        frame: &CanFrame,
        time_ns: u64,
        bus: Option<BusRates>,
        text: &mut Vec<u8>,
    ) {
        let receives = bus.is_none_or(|config| self.fits(frame, &config));
        if self.mode != Mode::Closed && receives {
            encode(frame, self.timestamps.then_some(time_ns), text);
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SlcanCommand {
    /// An empty line, which clients send to discard an incomplete command.
    Nothing,
    /// `Sn`, `sxxyy`: bit rate of the arbitration phase.
    Bitrate(NamedRate),
    /// `Yn`: bit rate of the data phase.
    DataBitrate(NamedRate),
    Open,
    OpenListening,
    Close,
    /// A frame to send.
    Transmit(CanFrame),
    /// `F`: status flags.
    Flags,
    /// `V`, and `v` on some adapters.
    Version,
    SerialNumber,
    /// `Zn`: whether received frames have a timestamp.
    Timestamps(bool),
    /// `X1`: send received frames at once, which is always the case.
    AutoPoll,
    /// `Mxxxxxxxx`, `mFFFFFFFF`: an acceptance filter that passes all frames.
    AcceptAll,
}

/// The line is not a supported command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct UnknownCommand;

/// The longest command: an extended CAN FD frame of 64 bytes, its length code in decimal digits.
const MAX_LINE: usize = 1 + 8 + 2 + 2 * 64;

const EXTENDED_FLAG: u32 = 1 << 31;

fn parse(line: &[u8]) -> Result<SlcanCommand, UnknownCommand> {
    use SlcanCommand as Command;
    let Some((&letter, arguments)) = line.split_first() else { return Ok(Command::Nothing) };
    let fd = |brs| Format::Fd { brs };
    match letter {
        b't' => transmit(arguments, false, Format::Classic),
        b'T' => transmit(arguments, true, Format::Classic),
        b'r' => transmit(arguments, false, Format::Remote),
        b'R' => transmit(arguments, true, Format::Remote),
        b'd' => transmit(arguments, false, fd(false)),
        b'D' => transmit(arguments, true, fd(false)),
        b'b' => transmit(arguments, false, fd(true)),
        b'B' => transmit(arguments, true, fd(true)),
        b'S' => digit(arguments).and_then(standard).map(Command::Bitrate),
        b's' => number(arguments, 4).map(|registers| {
            let [_, _, btr0, btr1] = registers.to_be_bytes();
            Command::Bitrate(NamedRate::exactly(of_registers(btr0, btr1)))
        }),
        b'Y' => digit(arguments).and_then(data).map(NamedRate::exactly).map(Command::DataBitrate),
        b'Z' => match arguments {
            b"0" => Some(Command::Timestamps(false)),
            b"1" => Some(Command::Timestamps(true)),
            _ => None,
        },
        b'X' => (arguments == b"1").then_some(Command::AutoPoll),
        b'M' => number(arguments, 8).map(|_| Command::AcceptAll),
        b'm' => (number(arguments, 8) == Some(u32::MAX)).then_some(Command::AcceptAll),
        _ if !arguments.is_empty() => None,
        b'O' => Some(Command::Open),
        b'L' => Some(Command::OpenListening),
        b'C' => Some(Command::Close),
        b'F' => Some(Command::Flags),
        b'V' | b'v' => Some(Command::Version),
        b'N' => Some(Command::SerialNumber),
        _ => None,
    }
    .ok_or(UnknownCommand)
}

#[derive(Clone, Copy)]
enum Format {
    Classic,
    Remote,
    Fd { brs: bool },
}

fn transmit(arguments: &[u8], extended: bool, format: Format) -> Option<SlcanCommand> {
    let digits = if extended { 8 } else { 3 };
    let (id, rest) = arguments.split_at_checked(digits)?;
    let id = number(id, digits)?;
    // Some clients leave SocketCAN's flag of the format in extended identifiers.
    let id = if extended { id & !EXTENDED_FLAG } else { id };
    let id = CanId::new(id, extended).ok()?;
    let (dlc, hex) = length_code(rest)?;
    if !matches!(format, Format::Fd { .. }) && dlc.value() > 8 {
        return None;
    }
    let mut data = [0; 64];
    let data = bytes(hex, &mut data)?;
    let frame = match format {
        Format::Remote if data.is_empty() => CanFrame::remote(id, dlc),
        Format::Classic if data.len() == dlc.classic_len() => CanFrame::classic(id, data),
        Format::Fd { brs } if data.len() == dlc.fd_len() => CanFrame::fd(id, data, brs, false),
        _ => return None,
    };
    frame.ok().map(SlcanCommand::Transmit)
}

/// The length code, one digit, and the data. SavvyCAN writes the codes from 10 on in decimal digits.
fn length_code(text: &[u8]) -> Option<(Dlc, &[u8])> {
    let (code, hex) = match text {
        [b'1', units @ b'0'..=b'5', hex @ ..] if hex.len().is_multiple_of(2) => {
            (10 + units - b'0', hex)
        }
        [code, hex @ ..] => (hex_digit(*code)?, hex),
        [] => return None,
    };
    Some((Dlc::from_raw(code)?, hex))
}

fn digit(text: &[u8]) -> Option<u8> {
    match text {
        [digit @ b'0'..=b'9'] => Some(digit - b'0'),
        _ => None,
    }
}

/// A number with exactly this many hexadecimal digits, at most eight.
fn number(text: &[u8], digits: usize) -> Option<u32> {
    if text.len() != digits {
        return None;
    }
    text.iter().try_fold(0, |value, &digit| Some(value << 4 | u32::from(hex_digit(digit)?)))
}

fn bytes<'a>(hex: &[u8], store: &'a mut [u8; 64]) -> Option<&'a [u8]> {
    let length = hex.len() / 2;
    if !hex.len().is_multiple_of(2) || length > store.len() {
        return None;
    }
    for (byte, pair) in store.iter_mut().zip(hex.chunks_exact(2)) {
        *byte = u8::try_from(number(pair, 2)?).ok()?;
    }
    store.get(..length)
}

fn hex_digit(digit: u8) -> Option<u8> {
    char::from(digit).to_digit(16).map(|value| value as u8)
}

/// Period of timestamps, ms.
const TIMESTAMP_WRAP: u64 = 60_000;

/// Appends a received frame, with a timestamp in milliseconds if `time_ns` is given. slcan cannot
/// represent the error state indicator of CAN FD.
fn encode(frame: &CanFrame, time_ns: Option<u64>, text: &mut Vec<u8>) {
    let is_extended = frame.id().is_extended();
    let letter = match frame.kind() {
        FrameKind::Data => b't',
        FrameKind::Remote => b'r',
        FrameKind::Fd { brs: false, .. } => b'd',
        FrameKind::Fd { brs: true, .. } => b'b',
    };
    text.push(if is_extended { letter.to_ascii_uppercase() } else { letter });
    hex(frame.id().raw(), if is_extended { 8 } else { 3 }, text);
    hex(u32::from(frame.dlc().value()), 1, text);
    for &byte in frame.data() {
        hex(u32::from(byte), 2, text);
    }
    if let Some(time_ns) = time_ns {
        // infallible: less than 60000
        hex((time_ns / 1_000_000 % TIMESTAMP_WRAP) as u32, 4, text);
    }
    text.push(OK);
}

/// Appends one BELL for each frame that was confirmed and then lost, in addition to the answers to
/// commands. slcan has no other message that an adapter sends without a command.
pub(super) fn encode_losses(count: u64, text: &mut Vec<u8>) {
    text.extend((0..count).map(|_| BELL));
}

/// Appends the lowest hexadecimal digits.
fn hex(value: u32, digits: u32, text: &mut Vec<u8>) {
    for place in (0..digits).rev() {
        let digit = (value >> (4 * place) & 0xF) as u8;
        text.push(if digit < 10 { b'0' + digit } else { b'A' + digit - 10 });
    }
}

/// Clock of the SJA1000's time quanta in Lawicel's adapters, Hz: 16 MHz divided by two.
const QUANTA_CLOCK: u32 = 8_000_000;

/// Tolerance of a bit rate in thousandths: commands have rounded rates.
const TOLERANCE_PERMILLE: u32 = 5;

/// Bit rate in a client's command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct NamedRate {
    rate: u32,
    /// Meaning of the same command for other clients.
    or: Option<u32>,
}

impl NamedRate {
    /// Rate in bit/s.
    const fn exactly(rate: u32) -> Self {
        Self { rate, or: None }
    }

    /// Returns whether the command may mean this bit rate.
    fn fits(self, real: u32) -> bool {
        let is_near = |named: u32| {
            u64::from(named.abs_diff(real)) * 1000
                <= u64::from(named) * u64::from(TOLERANCE_PERMILLE)
        };
        is_near(self.rate) || self.or.is_some_and(is_near)
    }
}

/// `Sn`: arbitration phase. 7 is 800 kbit/s for Lawicel and most clients and 750 kbit/s for
/// python-can; 9 is an extension of python-can and some adapters.
fn standard(code: u8) -> Option<NamedRate> {
    let rates =
        [10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000, 83_300];
    let rate = rates.get(usize::from(code)).copied()?;
    Some(NamedRate { rate, or: (code == 7).then_some(750_000) })
}

/// `Yn`: data phase, of CANable 2 and its successors.
fn data(code: u8) -> Option<u32> {
    matches!(code, 1 | 2 | 4 | 5 | 8).then(|| u32::from(code) * 1_000_000)
}

/// `sxxyy`: bus timing registers of an SJA1000.
fn of_registers(btr0: u8, btr1: u8) -> u32 {
    let prescaler = u32::from(btr0 & 0x3F) + 1;
    let before_sample = u32::from(btr1 & 0x0F) + 1;
    let after_sample = u32::from(btr1 >> 4 & 0x07) + 1;
    QUANTA_CLOCK / (prescaler * (1 + before_sample + after_sample))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lawicel_register_values_give_standard_rates() {
        // The table of the CAN232 manual.
        let table = [
            (0x31, 0x1C, 10_000),
            (0x18, 0x1C, 20_000),
            (0x09, 0x1C, 50_000),
            (0x04, 0x1C, 100_000),
            (0x03, 0x1C, 125_000),
            (0x01, 0x1C, 250_000),
            (0x00, 0x1C, 500_000),
            (0x00, 0x16, 800_000),
            (0x00, 0x14, 1_000_000),
        ];
        for (btr0, btr1, rate) in table {
            assert_eq!(of_registers(btr0, btr1), rate, "{btr0:#04X} {btr1:#04X}");
        }
    }

    #[test]
    fn codes_match_rates_that_clients_mean() {
        let fits = |code, rate| standard(code).unwrap().fits(rate);
        assert!(fits(7, 800_000) && fits(7, 750_000) && !fits(7, 775_000));
        assert!(fits(9, 83_333) && fits(9, 83_300) && !fits(9, 100_000));
        assert!(fits(6, 497_500) && !fits(6, 497_499) && !fits(6, 250_000));
        assert!(!fits(6, 0) && !fits(8, u32::MAX));
    }

    #[test]
    fn codes_without_rate_are_none() {
        let rate = |code| standard(code).map(|named| named.rate);
        assert_eq!((rate(6), rate(8), rate(10)), (Some(500_000), Some(1_000_000), None));
        assert_eq!(
            (data(2), data(5), data(0), data(3)),
            (Some(2_000_000), Some(5_000_000), None, None)
        );
    }
}
