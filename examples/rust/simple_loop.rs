//! The manual's minimal CAN loop (15.4): sends frames through ECAN-Lite gateways every cycle and
//! receives what comes back; or replays a recording and checks that it comes back unchanged.
//!
//! ```text
//! simple_loop --ecrt sim
//! simple_loop --ecrt sim --replay drive.log --dump back.log
//! simple_loop --plan --slaves 3 --pdo-n 5 --cycle-us 1000 --channel all
//! simple_loop --ecrt sim --config cell.toml
//! ```

use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use ecan_config_file::ConfigFile;
use ecan_example_support::bus_load::BusLoad;
use ecan_example_support::echo_check::Check;
use ecan_example_support::gateway_arguments::GatewayArguments;
use ecan_example_support::interrupt::Interrupt;
use ecan_example_support::log_file::{self, LoggedFrame};
use ecan_example_support::open::{Configure, open};
use ecan_example_support::plan;
use ecan_example_support::progress;
use ecan_example_support::real_time::{self, RealTimeArguments};
use ecan_example_support::session_watch::SessionWatch;
use ecan_example_support::source::{Channels, PlacedFrame, Source};
use ecan_example_support::summary::{self, Run};
use ecan_example_support::timeouts::{IDLE_TIMEOUT_NS, STALL_TIMEOUT_NS};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{GatewayConfig, Port, PortConfig, Received};
use ecan_protocol::can::CanId;
use ecan_protocol::mapping::CHANNELS;

/// Identifier of the frames that the plain loop sends.
const LOOP_ID: u16 = 0x123;
/// Cycles of the plain loop unless told otherwise.
const DEFAULT_CYCLES: u64 = 1000;
/// The end waits for frames under way for so many cycles at least.
const QUIET_CYCLES: u64 = 20;
/// Options whose values a configuration file has.
const OF_THE_FILE: [&str; 7] =
    ["slaves", "pdo_n", "large_pdos", "bitrate", "fd", "cycle_us", "master"];
/// Gaps of a recording from which the user is told, in nanoseconds.
const LONG_GAP_NS: u64 = 60_000_000_000;

/// Sends CAN frames through ECAN-Lite gateways every cycle and receives what comes back.
#[derive(Debug, Parser)]
#[command(name = "simple_loop", version)]
struct Arguments {
    #[command(flatten)]
    gateways: GatewayArguments,
    /// Take gateways, channels, bit rates, filters, cycle and clocks from this configuration file,
    /// and not from --slaves, --pdo-n, --large-pdos, --bitrate, --fd, --cycle-us and --master
    /// (`ecan config example` prints such a file).
    #[arg(long, value_name = "FILE", conflicts_with_all = OF_THE_FILE)]
    config: Option<PathBuf>,
    /// EtherCAT cycle in microseconds.
    #[arg(long, value_name = "US", default_value_t = 10_000)]
    cycle_us: u32,
    /// Number of cycles to send in [default: 1000]; a recording is sent to its end.
    #[arg(long, value_name = "N", conflicts_with = "replay")]
    cycles: Option<u64>,
    /// CAN channel of every gateway, 0 to 3, or `all`; with --config of those that the file has
    /// [default: 0, with --config all]. With `all` a recorded frame goes to the channel that its
    /// interface names, counted over all gateways.
    #[arg(long, value_name = "CHANNEL", value_parser = parse_channels)]
    channel: Option<Channels>,
    /// Send the frames of a candump log, none before its time, and check that each comes back.
    #[arg(long, value_name = "FILE")]
    replay: Option<PathBuf>,
    /// Write what comes back as a candump log.
    #[arg(long, value_name = "FILE")]
    dump: Option<PathBuf>,
    #[command(flatten)]
    thread: RealTimeArguments,
}

fn parse_channels(text: &str) -> Result<Channels, String> {
    match text.parse() {
        _ if text == "all" => Ok(Channels::All),
        Ok(channel) if usize::from(channel) < CHANNELS => Ok(Channels::One(channel)),
        _ => Err(format!("expected 0 to {} or `all`", CHANNELS - 1)),
    }
}

fn main() -> ExitCode {
    ecan_example_support::exit::report("simple_loop", run(&Arguments::parse()))
}

/// The gateways, and which of their channels carry frames.
struct Setup {
    adapter: AdapterConfig,
    port: PortConfig,
    channels: Channels,
}

impl Setup {
    fn of(arguments: &Arguments) -> Result<Self, Box<dyn Error>> {
        let Some(path) = &arguments.config else { return Ok(Self::of_options(arguments)) };
        let ConfigFile { adapter, port } = ecan_config_file::load(path)?;
        let channels = arguments.channel.unwrap_or(Channels::All);
        match channels {
            Channels::One(channel) if channels.places(&port).is_empty() => {
                Err(format!("{} has no channel {channel}", path.display()).into())
            }
            _ => Ok(Self { adapter, port, channels }),
        }
    }

    fn of_options(arguments: &Arguments) -> Self {
        let adapter = arguments.gateways.adapter(arguments.cycle_us);
        let settings = arguments.gateways.channel();
        let channels = arguments.channel.unwrap_or(Channels::One(0));
        let gateway = match channels {
            Channels::One(channel) => GatewayConfig::on_channel(channel, settings),
            Channels::All => GatewayConfig::on_all_channels(&settings),
        };
        let port = PortConfig::uniform(adapter.slaves.len(), gateway);
        Self { adapter, port, channels }
    }
}

/// What is sent: the recording, or a counter.
fn source(arguments: &Arguments, setup: &Setup) -> Result<Source, Box<dyn Error>> {
    let Some(path) = &arguments.replay else {
        let cycles = arguments.cycles.unwrap_or(DEFAULT_CYCLES);
        let places = setup.channels.places(&setup.port);
        return Ok(Source::Counter { id: CanId::standard(LOOP_ID)?, places, cycles, done: 0 });
    };
    let name = path.display();
    let frames = placed(log_file::read(path)?, arguments, setup)
        .map_err(|reason| format!("{name}, {reason}"))?;
    let same = |dump: &PathBuf| path.canonicalize().ok() == dump.canonicalize().ok();
    if arguments.dump.as_ref().is_some_and(same) {
        return Err(format!("--dump would overwrite the recording {name}").into());
    }
    for pair in frames.windows(2) {
        let (one, next) = (&pair[0].logged, &pair[1].logged);
        let gap = next.time_ns.saturating_sub(one.time_ns);
        if gap > LONG_GAP_NS {
            println!("{name}, line {}: {} s without a frame", next.line, gap / 1_000_000_000);
        }
    }
    Ok(Source::Recording { frames, done: 0 })
}

/// Where each frame of a recording goes to; or the line of one that cannot go there, and why.
fn placed(
    frames: Vec<LoggedFrame>,
    arguments: &Arguments,
    setup: &Setup,
) -> Result<Vec<PlacedFrame>, String> {
    let places = setup.channels.places(&setup.port);
    let gateways = setup.port.gateways.len();
    let place = |logged: LoggedFrame| {
        let (line, interface) = (logged.line, &logged.interface);
        let (slave, channel) = setup.channels.place_of(interface, &places, gateways);
        match places.iter().find(|it| (it.slave, it.channel) == (slave, channel)) {
            Some(place) if place.is_fd || !logged.frame.as_ref().is_fd() => {
                Ok(PlacedFrame { place: *place, logged })
            }
            Some(_) => Err(format!(
                "line {line} is a CAN FD frame: {}",
                match &arguments.config {
                    Some(file) => {
                        let file = file.display();
                        format!("slave {slave} channel {channel} has no data_bitrate in {file}")
                    }
                    None => "give --fd DATA_BITRATE".to_owned(),
                }
            )),
            None => Err(format!(
                "line {line}: {interface} means slave {slave} channel {channel}, which is not \
                 configured"
            )),
        }
    };
    frames.into_iter().map(place).collect()
}

/// Opens the gateways and waits until they are in service; `None` when the user gave up.
fn open_port(
    arguments: &Arguments,
    setup: Setup,
    interrupt: &Interrupt,
) -> Result<Option<Port>, Box<dyn Error>> {
    let Setup { adapter, port, .. } = setup;
    let backend = arguments.gateways.open_backend("echo", &adapter)?;
    arguments.thread.apply(|line| println!("{line}"))?;
    open(&backend.ecrt, adapter, port, Configure::Write, interrupt)
}

/// Runs the loop; false when a recording did not come back as it was sent.
fn run(arguments: &Arguments) -> Result<bool, Box<dyn Error>> {
    let setup = Setup::of(arguments)?;
    let mut source = source(arguments, &setup)?;
    if arguments.gateways.plan {
        plan::print(&setup.adapter, &setup.port, &source.traffic()?)?;
        return Ok(true);
    }
    let interrupt = Interrupt::install()?;
    let cycle_ns = setup.adapter.cycle_ns;
    let Some(mut port) = open_port(arguments, setup, &interrupt)? else {
        println!("stopped by the user");
        return Ok(true);
    };
    println!("{} gateway(s) in service", port.slave_count());
    let mut dump = arguments.dump.as_deref().map(log_file::Writer::create).transpose()?;

    let channels = port.slave_count() * CHANNELS;
    let mut check = Check::new(channels);
    let mut loads = vec![BusLoad::default(); channels];
    let mut watch = SessionWatch::new(&port);
    let progress = progress::bar(source.total());
    let clock = port.adapter().ecrt().clock().clone();
    let quiet_ns = IDLE_TIMEOUT_NS.max(QUIET_CYCLES * u64::from(cycle_ns));
    let start = clock.now_ns();
    let mut last_activity = start;
    let is_measured = arguments.gateways.real_time || arguments.thread.is_given();
    if is_measured {
        port.adapter_mut().measure_cycles();
    }
    arguments.thread.set_timing(port.adapter_mut());
    let mut end: Result<(), Box<dyn Error>> = Ok(());
    loop {
        let mut cycle = port.next_cycle();
        let now = clock.now_ns();
        let mut written = Ok(());
        for item in cycle.received() {
            let Received::Frame(received) = item.to_owned() else { continue };
            let channel = received.slave * CHANNELS + usize::from(received.channel);
            check.received(channel, &received.frame);
            loads[channel].add(&received.frame);
            last_activity = now;
            if let (Some(dump), Ok(())) = (&mut dump, &written) {
                written = dump.write(source.log_time(now - start), channel, received.frame);
            }
        }
        let is_sending = !interrupt.is_set() && !source.is_done();
        let mut sent = Ok(());
        if is_sending {
            sent = source.send(&mut cycle, now - start, |channel, frame| {
                check.sent(channel, frame);
                loads[channel].add(&frame);
                last_activity = now;
            });
        }
        let ended = cycle.end();
        for line in watch.changes(&port) {
            progress.suspend(|| println!("{:>9.3} s  {line}", (now - start) as f64 / 1e9));
        }
        progress.set_position(source.done());
        if let Err(error) = ended {
            end = Err(error.into());
        } else if let Err(error) = written {
            end = Err(error.into());
        } else if let Err(error) = sent {
            end = Err(error.into());
        }
        // A gap of the recording is no standstill.
        let due = source.next_due_ns().map_or(last_activity, |due| last_activity.max(start + due));
        let is_stuck = source.next_due_ns().is_some() && now.saturating_sub(due) > STALL_TIMEOUT_NS;
        let is_quiet = now - last_activity > quiet_ns;
        let is_over = !is_sending && (check.under_way() == 0 || is_quiet);
        if end.is_err() || interrupt.is_set() || is_stuck || is_over {
            break;
        }
    }
    progress.finish_and_clear();
    if let Some(dump) = dump {
        dump.finish()?;
    }
    if interrupt.is_set() {
        println!("stopped by the user");
    }
    let run = Run { elapsed_ns: clock.now_ns() - start, cycle_ns };
    print!("{}", summary::table(&port, run, &loads));
    if let Some(statistics) = port.adapter().cycle_statistics() {
        real_time::print_statistics(port.adapter(), statistics);
    }
    end?;
    Ok(arguments.replay.is_none() || report_replay(&port, &source, &check))
}

/// Says how the replay went; true when every frame came back unchanged and in order.
fn report_replay(port: &Port, source: &Source, check: &Check) -> bool {
    let (sent, returned) = check.counts();
    let mut faults: Vec<String> = check.first_difference().map(String::from).into_iter().collect();
    if !source.is_done() {
        faults.push(format!("{} frames were not sent", source.total() - source.done()));
    }
    if check.under_way() > 0 {
        faults.push(format!("{} frames did not come back", check.under_way()));
    }
    for gateway in port.gateways() {
        let statistics = port.statistics(gateway);
        let errors = statistics.parse_errors + statistics.txpdo_torn;
        if errors + statistics.txpdo_lost > 0 {
            let lost = statistics.txpdo_lost;
            faults.push(format!("{gateway}: {errors} image errors, {lost} images lost"));
        }
        if !port.gateway_is_ready(gateway) {
            faults.push(format!("{gateway} is {}", port.session(gateway)));
        }
    }
    println!("\nreplay: {sent} frames sent, {returned} came back");
    if faults.is_empty() {
        println!("replay: all of them, unchanged and in order");
    }
    for fault in &faults {
        eprintln!("simple_loop: {fault}");
    }
    faults.is_empty()
}
