//! The manual's minimal CAN loop (15.4): sends frames through ECAN-Lite gateways every cycle and
//! receives what comes back; or replays a recording and checks that it comes back unchanged.
//!
//! ```text
//! simple_loop --ecrt sim
//! simple_loop --ecrt sim --replay drive.log --dump back.log
//! simple_loop --plan --slaves 3 --pdo-n 5 --cycle-us 1000 --channel all
//! ```

use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use ecan_examples::bus_load::BusLoad;
use ecan_examples::check::Check;
use ecan_examples::gateway_arguments::GatewayArguments;
use ecan_examples::interrupt::Interrupt;
use ecan_examples::log_file::{self, LoggedFrame};
use ecan_examples::open::{Configure, open};
use ecan_examples::patience::{MAX_FAILED_CYCLES, QUIET_NS, STUCK_NS};
use ecan_examples::plan;
use ecan_examples::progress;
use ecan_examples::real_time::{self, RealTimeArguments};
use ecan_examples::source::{Channels, Source};
use ecan_examples::summary::{self, Run};
use ecan_examples::watch::SessionWatch;
use ecan_host::AdapterConfig;
use ecan_mcan_port::{GatewayConfig, Port, PortConfig, Received, Session};
use ecan_protocol::{CHANNELS, CanId};

/// Identifier of the frames that the plain loop sends.
const LOOP_ID: u16 = 0x123;
/// Cycles of the plain loop unless told otherwise.
const DEFAULT_CYCLES: u64 = 1000;
/// The end waits for frames under way for so many cycles at least.
const QUIET_CYCLES: u64 = 20;
/// Gaps of a recording from which the user is told, in nanoseconds.
const LONG_GAP_NS: u64 = 60_000_000_000;

/// Sends CAN frames through ECAN-Lite gateways every cycle and receives what comes back.
#[derive(Debug, Parser)]
#[command(name = "simple_loop", version)]
struct Arguments {
    #[command(flatten)]
    gateways: GatewayArguments,
    /// EtherCAT cycle in microseconds.
    #[arg(long, value_name = "US", default_value_t = 10_000)]
    cycle_us: u32,
    /// Number of cycles to send in [default: 1000]; a recording is sent to its end.
    #[arg(long, value_name = "N", conflicts_with = "replay")]
    cycles: Option<u64>,
    /// CAN channel of every gateway, 0 to 3, or `all`. With `all` a recorded frame goes to the
    /// channel that its interface names, counted over all gateways.
    #[arg(long, value_name = "CHANNEL", default_value = "0", value_parser = parse_channels)]
    channel: Channels,
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
    ecan_examples::exit::report("simple_loop", run(&Arguments::parse()))
}

/// The gateways: N, cycle and channels.
fn configuration(arguments: &Arguments) -> (AdapterConfig, PortConfig) {
    let adapter = arguments.gateways.adapter(arguments.cycle_us);
    let settings = arguments.gateways.channel();
    let gateway = match arguments.channel {
        Channels::One(channel) => GatewayConfig::on_channel(channel, settings),
        Channels::All => GatewayConfig::on_all_channels(&settings),
    };
    (adapter, PortConfig::uniform(usize::from(arguments.gateways.slaves), gateway))
}

/// What is sent: the recording, or a counter.
fn source(arguments: &Arguments) -> Result<Source, Box<dyn Error>> {
    let is_fd = arguments.gateways.fd.is_some();
    let Some(path) = &arguments.replay else {
        let cycles = arguments.cycles.unwrap_or(DEFAULT_CYCLES);
        return Ok(Source::Counter { id: CanId::standard(LOOP_ID)?, is_fd, cycles, done: 0 });
    };
    let name = path.display();
    let frames: Vec<LoggedFrame> = log_file::read(path)?;
    if let Some(fd) = frames.iter().find(|f| f.frame.as_ref().is_fd() && !is_fd) {
        return Err(
            format!("{name}, line {} is a CAN FD frame: give --fd DATA_BITRATE", fd.line).into()
        );
    }
    let same = |dump: &PathBuf| path.canonicalize().ok() == dump.canonicalize().ok();
    if arguments.dump.as_ref().is_some_and(same) {
        return Err(format!("--dump would overwrite the recording {name}").into());
    }
    for pair in frames.windows(2) {
        let gap = pair[1].time_ns.saturating_sub(pair[0].time_ns);
        if gap > LONG_GAP_NS {
            println!("{name}, line {}: {} s without a frame", pair[1].line, gap / 1_000_000_000);
        }
    }
    Ok(Source::Recording { frames, done: 0 })
}

/// Opens the gateways and waits until they are in service; `None` when the user gave up.
fn open_port(arguments: &Arguments, interrupt: &Interrupt) -> Result<Option<Port>, Box<dyn Error>> {
    let (adapter, config) = configuration(arguments);
    let backend = arguments.gateways.open_backend("echo")?;
    arguments.thread.apply(|line| println!("{line}"))?;
    open(&backend.ecrt, adapter, config, Configure::Write, interrupt)
}

/// Runs the loop; false when a recording did not come back as it was sent.
fn run(arguments: &Arguments) -> Result<bool, Box<dyn Error>> {
    let mut source = source(arguments)?;
    if arguments.gateways.plan {
        let (adapter, config) = configuration(arguments);
        let traffic = source.traffic(adapter.slaves.len(), arguments.channel)?;
        plan::print(&adapter, &config, &traffic)?;
        return Ok(true);
    }
    let interrupt = Interrupt::install()?;
    let Some(mut port) = open_port(arguments, &interrupt)? else {
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
    let cycle_ns = u64::from(arguments.cycle_us) * 1000;
    let quiet_ns = QUIET_NS.max(QUIET_CYCLES * cycle_ns);
    let start = clock.now_ns();
    let (mut last_activity, mut failed_cycles) = (start, 0);
    let is_measured = arguments.gateways.real_time || arguments.thread.is_given();
    if is_measured {
        port.adapter_mut().measure_cycles();
    }
    arguments.thread.set_timing(port.adapter_mut());
    let mut end: Result<(), Box<dyn Error>> = Ok(());
    loop {
        port.wait_next_cycle();
        let begun = port.cycle_begin();
        let now = clock.now_ns();
        let mut written = Ok(());
        port.receive_each(|item| {
            let Received::Frame(received) = item else { return };
            let channel = received.slave * CHANNELS + usize::from(received.channel);
            check.received(channel, &received.frame);
            loads[channel].add(&received.frame);
            last_activity = now;
            if let (Some(dump), Ok(())) = (&mut dump, &written) {
                written = dump.write(source.log_time(now - start), channel, received.frame);
            }
        });
        let is_sending = !interrupt.is_set() && !source.is_done();
        let mut sent = Ok(());
        if is_sending {
            sent = source.send(&mut port, arguments.channel, now - start, |channel, frame| {
                check.sent(channel, frame);
                loads[channel].add(&frame);
                last_activity = now;
            });
        }
        let cycle = port.cycle_end().and(begun);
        failed_cycles = if cycle.is_err() { failed_cycles + 1 } else { 0 };
        for line in watch.changes(&port) {
            progress.suspend(|| println!("{:>9.3} s  {line}", (now - start) as f64 / 1e9));
        }
        progress.set_position(source.done());
        if failed_cycles > MAX_FAILED_CYCLES {
            end = cycle.map_err(Box::from);
        } else if let Err(error) = written {
            end = Err(error.into());
        } else if let Err(error) = sent {
            end = Err(error.into());
        }
        // A gap of the recording is no standstill.
        let due = source.next_due_ns().map_or(last_activity, |due| last_activity.max(start + due));
        let is_stuck = source.next_due_ns().is_some() && now.saturating_sub(due) > STUCK_NS;
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
    let run = Run {
        nominal_bitrate: arguments.gateways.bitrate,
        data_bitrate: arguments.gateways.fd.unwrap_or(arguments.gateways.bitrate),
        elapsed_ns: clock.now_ns() - start,
        cycle_ns: arguments.cycle_us * 1000,
    };
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
    for slave in 0..port.slave_count() {
        let statistics = port.statistics(slave);
        let errors = statistics.parse_errors + statistics.txpdo_torn;
        if errors + statistics.txpdo_lost > 0 {
            let lost = statistics.txpdo_lost;
            faults.push(format!("slave {slave}: {errors} image errors, {lost} images lost"));
        }
        if !matches!(port.session(slave), Session::Ready) {
            faults.push(format!("slave {slave} is {}", port.session(slave)));
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
