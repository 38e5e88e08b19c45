//! Server of `ecan-sim wire`: answers EtherCAT frames, and writes the log of the CAN buses.

use std::borrow::Cow;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use ecan_can_io::candump::Record;
use ecan_host::{Clock, MAX_SPIN_NS, MonotonicClock};
use ecan_sim::{Wire, World};
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::log_file::{LogFileError, Writer};
use ecan_tool_support::command_line::new_file::Existing;
use ecan_tool_support::command_line::options::{ThreadArguments, parse_time};

use crate::failure::{Failure, Screen};
use crate::frame_prediction::FramePrediction;
use crate::packet_socket::{PacketSocket, Received, SocketError};
use crate::report;
use crate::report::{Turnaround, Watch, real_time_ns};

/// Maximum wait for a frame, ns: interval of serving bridges and signals.
const LONGEST_WAIT_NS: u64 = 1_000_000;
/// Interval of writing the dump and of checking an interface that is down, ns.
const LOOK_NS: u64 = 100_000_000;
/// More than any EtherCAT frame.
const FRAME_BYTES: usize = 4096;

pub struct Server {
    wire: Wire,
    socket: PacketSocket,
    watch: Watch,
    dump: Option<Dump>,
    turnaround: Turnaround,
    prediction: FramePrediction,
    screen: Screen,
    is_quiet: bool,
    spins: bool,
    start_ns: u64,
    end_ns: u64,
    looked_ns: u64,
    is_down: bool,
    unsent: u64,
    frame: Box<[u8; FRAME_BYTES]>,
}

impl Server {
    /// Gateways switched on at `start_ns` of the monotonic clock. Call it before the thread is
    /// restricted to certain CPUs.
    pub fn new(
        mut wire: Wire,
        socket: PacketSocket,
        dump: Option<Dump>,
        arguments: &WireArguments,
        screen: Screen,
        start_ns: u64,
    ) -> Self {
        if !arguments.quiet {
            wire.world_mut().observe_faults(move |record| {
                screen.line(stamped(record.time_ns, 0, format_args!("fault: {}", record.fault)));
            });
        }
        let run_ns = arguments.duration.map(|duration| duration.as_nanos());
        let run_ns = run_ns.map_or(u64::MAX, |ns| u64::try_from(ns).unwrap_or(u64::MAX));
        Self {
            watch: Watch::new(wire.world()),
            wire,
            socket,
            dump,
            turnaround: Turnaround::new(),
            prediction: FramePrediction::new(polling_limit_ns(arguments)),
            screen,
            is_quiet: arguments.quiet,
            spins: arguments.spin,
            start_ns,
            end_ns: start_ns.saturating_add(run_ns),
            looked_ns: start_ns,
            is_down: false,
            unsent: 0,
            frame: Box::new([0; FRAME_BYTES]),
        }
    }

    /// Answers frames until the time is over or the user ends it.
    pub fn serve(&mut self, interrupt: &Interrupt) -> Result<(), Failure> {
        let mut is_polling = false;
        while !interrupt.is_set() {
            let received = self.socket.receive(&mut self.frame[..])?;
            let now = MonotonicClock.now_ns();
            match received {
                Received::Frame { bytes, arrived_ns } => {
                    self.answer(now, bytes, arrived_ns, is_polling)?;
                }
                Received::Nothing => self.wire.advance(now),
                Received::Down => {
                    self.is_down = true;
                    let name = &self.socket.interface.name;
                    self.screen.line(format_args!("{name} is down: no frames until it is up"));
                }
            }
            self.log_events()?;
            if now >= self.end_ns {
                break;
            }
            if matches!(received, Received::Frame { .. }) {
                continue;
            }
            if now.saturating_sub(self.looked_ns) >= LOOK_NS {
                self.looked_ns = now;
                self.dump.as_mut().map_or(Ok(()), Dump::flush)?;
                if self.is_down {
                    self.socket.check_interface()?;
                }
            }
            let polling = self.prediction.polling_ns(now);
            is_polling = self.spins || polling.is_some_and(|(start_ns, _)| now >= start_ns);
            if !is_polling {
                let next = self.wire.next_event().unwrap_or(u64::MAX).min(self.end_ns);
                let next = polling.map_or(next, |(start_ns, _)| next.min(start_ns));
                self.socket.wait(next.saturating_sub(now).min(LONGEST_WAIT_NS));
            }
        }
        Ok(())
    }

    fn answer(
        &mut self,
        now: u64,
        bytes: usize,
        arrived_ns: Option<u64>,
        is_polled: bool,
    ) -> Result<(), SocketError> {
        let taken_ns = real_time_ns();
        let is_first = self.wire.statistics().frames == 0;
        let Some(frame) = self.frame.get_mut(..bytes) else { return Ok(()) };
        let mut is_sent = false;
        if self.wire.pass(now, frame) {
            is_sent = self.socket.send(frame)?;
            if is_sent {
                self.turnaround.count(arrived_ns, taken_ns, real_time_ns());
            } else {
                self.unsent += 1;
            }
        }
        let waited_ns = arrived_ns.map_or(0, |arrived_ns| taken_ns.saturating_sub(arrived_ns));
        self.prediction.count(now.saturating_sub(waited_ns), is_polled);
        if is_first && self.wire.statistics().frames > 0 {
            self.log(now, "first EtherCAT frame");
        }
        if is_sent && std::mem::take(&mut self.is_down) {
            self.log(now, format_args!("{} is up again", self.socket.interface.name));
        }
        Ok(())
    }

    fn log_events(&mut self) -> Result<(), LogFileError> {
        let Self { wire, watch, dump, screen, is_quiet, start_ns, .. } = self;
        if !*is_quiet {
            let now = wire.world().now_ns();
            watch.poll(wire.world(), |gateway, text| {
                screen.line(stamped(now, *start_ns, format_args!("gateway {gateway}: {text}")));
            });
        }
        match dump {
            Some(dump) => dump.write(wire.world_mut()),
            None => Ok(()),
        }
    }

    fn log(&self, now: u64, what: impl Display) {
        if !self.is_quiet {
            self.screen.line(stamped(now, self.start_ns, what));
        }
    }

    pub fn finish(&mut self) -> Result<(), LogFileError> {
        self.screen.line("");
        let dropped = self.socket.losses();
        report::print_summary(&self.wire, dropped, self.unsent, self.screen);
        self.screen.line(&self.turnaround);
        self.dump.as_mut().map_or(Ok(()), Dump::flush)
    }
}

/// Longest polling for an expected frame; none on a single CPU, which the master needs to send it.
fn polling_limit_ns(arguments: &WireArguments) -> u64 {
    let cpus = std::thread::available_parallelism().map_or(1, usize::from);
    if cpus > 1 { arguments.spin_us * 1000 } else { 0 }
}

fn stamped(now: u64, start_ns: u64, what: impl Display) -> String {
    format!("{:9.3} s  {what}", now.saturating_sub(start_ns) as f64 / 1e9)
}

pub struct Dump {
    log: Writer,
    /// Offset from simulated time to the time of day, ns.
    offset_ns: u64,
}

impl Dump {
    /// Creates or truncates the file; `-` is standard output.
    pub fn create(path: &Path, offset_ns: u64) -> Result<Self, LogFileError> {
        Ok(Self { log: Writer::candump(path, Existing::Replace)?, offset_ns })
    }

    /// Writes what was recorded since the last call. The bus names are the interface names.
    pub fn write(&mut self, world: &mut World) -> Result<(), LogFileError> {
        let mut result = Ok(());
        world.drain_recorded(|bus, recorded| {
            // spaces separate the fields of a log
            let interface = match bus.contains(char::is_whitespace) {
                true => Cow::Owned(bus.replace(char::is_whitespace, "_")),
                false => Cow::Borrowed(bus),
            };
            let record = Record {
                time_ns: recorded.end_ns.saturating_add(self.offset_ns),
                interface: &interface,
                frame: recorded.frame,
                direction: None,
            };
            if result.is_ok() {
                result = self.log.write_frame((record.time_ns, 0), &record.frame, false, record);
            }
        });
        result
    }

    pub fn flush(&mut self) -> Result<(), LogFileError> {
        self.log.flush()
    }
}

/// Arguments of `ecan-sim wire`.
#[derive(Debug, Args)]
pub struct WireArguments {
    /// Network interface for the gateways, for example one end of a veth pair
    #[arg(long, short, value_name = "NAME")]
    pub interface: String,
    /// Number of gateways of a built-in scenario, 1 to 64 [default: 1]
    #[arg(long, short, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64))]
    pub gateways: Option<u16>,
    /// Scenario: echo, drives, jitter, or a file name that ends in .toml
    #[arg(long, short, value_name = "SCENARIO", default_value = "echo")]
    pub scenario: String,
    /// Seed of all random values; replaces that of the scenario
    #[arg(long, value_name = "SEED")]
    pub seed: Option<u64>,
    /// Write the frames of all CAN buses to a candump log; `-` is standard output
    #[arg(long, value_name = "FILE")]
    pub dump: Option<PathBuf>,
    /// List all PDOs in the SII of each gateway (categories 50 and 51)
    #[arg(long)]
    pub sii_pdos: bool,
    /// Exit after this time; otherwise on Ctrl-C or SIGTERM
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub duration: Option<Duration>,
    /// Do not log gateway events
    #[arg(long, short)]
    pub quiet: bool,
    /// Poll for frames instead of sleeping; uses a whole CPU.
    ///
    /// Not with a real-time priority, because Linux stops such a thread for 50 ms in every second.
    #[arg(long, conflicts_with_all = ["rt_priority", "spin_us"], help_heading = "Real time")]
    pub spin: bool,
    /// Poll for at most this time before each expected frame, in us; 0 only sleeps.
    ///
    /// Applies to masters with a regular cycle, for at most an eighth of it, on a machine with several
    /// CPUs.
    #[arg(long, value_name = "US", default_value_t = 100, help_heading = "Real time",
          value_parser = clap::value_parser!(u64).range(..=MAX_SPIN_NS / 1000))]
    pub spin_us: u64,
    #[command(flatten)]
    pub thread: ThreadArguments,
}

fn parse_duration(text: &str) -> Result<Duration, String> {
    match parse_time(text)? {
        ns if ns > 0 && text.parse::<f64>().is_err() => Ok(Duration::from_nanos(ns)),
        _ => Err("expected a time above 0; give its unit: 500ms or 5s".to_owned()),
    }
}
