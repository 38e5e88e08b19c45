//! The manual's minimal CAN loop (15.4): sends frames through ECAN-Lite gateways every cycle and
//! receives frames; or replays a recording and checks that every frame returns unchanged.
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
use ecan_example_support::frame_source::{Channels, Source};
use ecan_example_support::loop_record::LoopRecord;
use ecan_example_support::loop_setup::{GatewayArguments, LoopSetup};
use ecan_example_support::sync0::print_sync0;
use ecan_example_support::{
    EXIT_STATUS, Interrupt, RealTimeArguments, print_plan, report_exit, run_options, wait_ready,
};
use ecan_lite::EcrtOptions;
use ecan_mcan_port::{Port, check_delivery};
use ecan_protocol::can::CanId;
use ecan_protocol::mapping::CHANNELS;
use ecan_protocol::text::Printable;
use ecan_tool_support::command_line::screen::parse_arguments;
use ecan_tool_support::print_line;

/// CAN ID of the frames that the plain loop sends.
const LOOP_ID: u16 = 0x123;
/// Default number of cycles of the plain loop.
const DEFAULT_CYCLES: u64 = 1000;
/// Options that a configuration file replaces.
const REPLACED_BY_FILE: [&str; 7] =
    ["slaves", "pdo_n", "large_pdos", "bitrate", "fd", "cycle_us", "master"];

/// Send CAN frames through ECAN-Lite gateways every cycle and receive frames
#[derive(Debug, Parser)]
#[command(name = "simple_loop", version, after_help = EXIT_STATUS)]
struct Arguments {
    #[command(flatten)]
    gateways: GatewayArguments,
    /// Configuration file with gateways, channels, bit rates, filters, cycle and clocks (`ecan config
    /// example` prints one); replaces --slaves, --pdo-n, --large-pdos, --bitrate, --fd, --cycle-us
    /// and --master
    #[arg(long, value_name = "FILE", conflicts_with_all = REPLACED_BY_FILE)]
    config: Option<PathBuf>,
    /// EtherCAT cycle
    #[arg(long, value_name = "US", default_value_t = 10_000)]
    cycle_us: u32,
    /// Number of cycles with frames [default: 1000, or the length of the recording]
    #[arg(long, value_name = "N", conflicts_with = "replay")]
    cycles: Option<u64>,
    /// CAN channel of every gateway, 0 to 3, or `all` [default: 0, with --config all]. With `all` a
    /// recorded frame of `canN` goes to channel N, counted over all gateways
    #[arg(long, value_name = "CHANNEL", value_parser = parse_channels)]
    channel: Option<Channels>,
    /// Send the frames of a recording at their times and check that each returns
    #[arg(long, value_name = "FILE")]
    replay: Option<PathBuf>,
    /// Write received frames as a candump log
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
    report_exit("simple_loop", run(&parse_arguments()))
}

/// Runs the loop. Returns false if a replayed frame did not return unchanged.
fn run(arguments: &Arguments) -> Result<bool, Box<dyn Error>> {
    let setup = setup(arguments)?;
    let mut source = source(arguments, &setup)?;
    if arguments.gateways.plan {
        print_plan(&setup.adapter, &setup.port, &source.traffic()?)?;
        return Ok(true);
    }

    // The EtherCAT master library, or the simulated one; then the real-time thread.
    let interrupt = Interrupt::install()?;
    let backend =
        arguments.gateways.master.open("echo", EcrtOptions::for_gateways(&setup.adapter))?;
    arguments.thread.apply(|line| print_line!("{line}"))?;

    print_sync0(&setup.adapter, &setup.port);
    // Checks the configuration and registers the startup SDOs, which the master then executes; the
    // gateways are verified in OP.
    let mut port = Port::open(&backend.ecrt, (setup.adapter, setup.port))?;
    if !wait_ready(&mut port, &interrupt)? {
        return Ok(true);
    }
    print_line!("{} gateway(s) ready", port.slave_count());
    run_options(&mut port, &arguments.thread, arguments.gateways.master.real_time);

    let mut record = LoopRecord::new(&port, &source, arguments.dump.as_deref())?;
    let result = exchange_frames(&mut port, &mut source, &mut record, &interrupt);
    let delivery = check_delivery(&port);
    port.leave_op();
    if interrupt.is_set() {
        print_line!("stopped by the user");
    }
    record.print_summary(&port)?;
    result?;
    let is_good = arguments.replay.is_none() || record.print_replay_result(&port, &source);
    if !interrupt.is_set() {
        delivery?;
    }
    Ok(is_good)
}

/// The cycle: wait and receive, take the received frames, send, end.
fn exchange_frames(
    port: &mut Port,
    source: &mut Source,
    record: &mut LoopRecord,
    interrupt: &Interrupt,
) -> Result<(), Box<dyn Error>> {
    loop {
        let mut cycle = port.next_cycle();
        for item in cycle.received() {
            record.received(source, &item)?;
        }
        let is_sending = !interrupt.is_set() && !source.is_done();
        if is_sending {
            source.send(&mut cycle, record.elapsed_ns(), |channel, frame| {
                record.sent(channel, frame);
            })?;
        }
        // Lost frames and outages are part of the statistics; an error here is final.
        cycle.end()?;
        if record.end_cycle(port, source, is_sending) || interrupt.is_set() {
            return Ok(());
        }
    }
}

/// Gateways and channels, from the configuration file or from the options.
fn setup(arguments: &Arguments) -> Result<LoopSetup, Box<dyn Error>> {
    let Some(path) = &arguments.config else {
        let channels = arguments.channel.unwrap_or(Channels::One(0));
        return Ok(LoopSetup::from_arguments(&arguments.gateways, arguments.cycle_us, channels));
    };
    LoopSetup::from_file(path, arguments.channel.unwrap_or(Channels::All))
}

/// The frames to send: a counter, or a recording.
fn source(arguments: &Arguments, setup: &LoopSetup) -> Result<Source, Box<dyn Error>> {
    let Some(path) = &arguments.replay else {
        let cycles = arguments.cycles.unwrap_or(DEFAULT_CYCLES);
        return Ok(setup.counter(CanId::standard(LOOP_ID)?, cycles));
    };
    let is_same = |dump: &PathBuf| path.canonicalize().ok() == dump.canonicalize().ok();
    if arguments.dump.as_ref().is_some_and(is_same) {
        return Err(
            format!("--dump would overwrite the recording {}", Printable(path.display())).into()
        );
    }
    setup.recording(path)
}
