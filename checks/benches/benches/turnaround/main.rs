//! Turnaround of `ecan-sim wire`, and of another slave simulator on the same machine.
//!
//! ```text
//! cargo bench -p ecan-bench --bench turnaround -- [--other IFACE] [--rt-priority N]
//! ```
//!
//! The same EtherCAT frames go to each simulator over a veth pair: a broadcast read of the AL status,
//! a read of the system time of one slave, and the two images of N = 3 as one LRW. The turnaround is
//! the time from the call that sends the frame to the kernel's time of the arrival of the response. It
//! contains the wake-up of the simulator, not that of the sender. Segments of both sides alternate.
//!
//! The program makes a network namespace with a veth pair for `ecan-sim`, which needs root. Start the
//! other simulator before, with the same scheduling, and pass the sender's end of its veth pair.
#![allow(missing_docs, clippy::disallowed_macros, clippy::disallowed_methods)]

#[path = "../../../../tools/ecan/tests/ecan_sim/support/network.rs"]
#[allow(dead_code)]
mod network;
#[path = "../../../../tools/ecan/src/bin/ecan-sim/packet_socket.rs"]
#[allow(dead_code)]
mod packet_socket;
#[path = "../../../../tools/ecan/tests/ecan_sim/support/program.rs"]
#[allow(dead_code)]
mod program;
mod requester;

use std::error::Error;

use clap::Parser;
use ecan_bench::measure::{Row, median, print_rows, rounds};
use ecan_tool_support::command_line::options::ThreadArguments;
use nix::sys::signal::Signal;

use packet_socket::Interface;
use program::Running;
use requester::{Kind, Requester, Sample};

const SEGMENTS: usize = 20;
/// Frames of each kind in a segment.
const FRAMES: usize = 1000;

#[derive(Parser)]
struct Arguments {
    /// Interface on whose other end another slave simulator answers
    #[arg(long, value_name = "IFACE")]
    other: Option<String>,
    /// Segments of each side [default: 20]
    #[arg(long, value_name = "N")]
    segments: Option<usize>,
    /// Let `ecan-sim` poll for frames instead of sleeping
    #[arg(long)]
    spin: bool,
    #[command(flatten)]
    thread: ThreadArguments,
    /// Passed by cargo
    #[arg(long, hide = true)]
    bench: bool,
}

/// Quantiles of a segment, ns.
#[derive(Clone, Copy)]
struct Quantiles {
    p50: f64,
    p99: f64,
}

impl Quantiles {
    fn of(mut times: Vec<u64>) -> Self {
        times.sort_unstable();
        let at = |share: f64| {
            let index = (times.len() as f64 * share) as usize;
            times.get(index).map_or(f64::NAN, |ns| *ns as f64)
        };
        Self { p50: at(0.5), p99: at(0.99) }
    }
}

/// A simulator and its segments so far.
struct Side {
    name: &'static str,
    requester: Requester,
    segments: Vec<Vec<Sample>>,
}

impl Side {
    fn new(name: &'static str, interface: &str) -> Result<Self, Box<dyn Error>> {
        let requester = Requester::open(Interface::find(interface)?)?;
        Ok(Self { name, requester, segments: Vec::new() })
    }

    fn run(&mut self) -> Result<(), Box<dyn Error>> {
        let segment = self.requester.segment(rounds(FRAMES))?;
        self.segments.push(segment);
        Ok(())
    }

    /// Of each segment.
    fn quantiles(&self) -> Vec<Quantiles> {
        let times = |samples: &Vec<Sample>| samples.iter().map(|sample| sample.ns).collect();
        self.segments.iter().map(|segment| Quantiles::of(times(segment))).collect()
    }

    fn print(&self) {
        let all = || self.segments.iter().flatten();
        for kind in Kind::ALL {
            let of_kind = all().filter(|sample| sample.kind == kind).map(|sample| sample.ns);
            let Quantiles { p50, p99 } = Quantiles::of(of_kind.collect());
            println!(
                "{:8} {:22} {:8.1} us  {:8.1} us  working counter {}",
                self.name,
                kind.text(),
                p50 / 1e3,
                p99 / 1e3,
                self.requester.working_counter(kind)
            );
        }
        let Quantiles { p50, p99 } = Quantiles::of(all().map(|sample| sample.ns).collect());
        let lost = self.requester.lost();
        let (name, all, p50, p99) = (self.name, "all frames", p50 / 1e3, p99 / 1e3);
        println!("{name:8} {all:22} {p50:8.1} us  {p99:8.1} us  {lost} without a response");
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let segments = arguments.segments.unwrap_or_else(|| rounds(SEGMENTS));
    // It is in the namespace of the caller, so before the new one is entered.
    let mut other = arguments.other.as_deref().map(|name| Side::new("other", name)).transpose()?;
    if !network::enter() {
        return Ok(());
    }
    let settings = arguments.thread.settings();
    let priority = settings.priority.map(|priority| priority.to_string());
    let mut options = vec!["--quiet"];
    options.extend(arguments.spin.then_some("--spin"));
    if let Some(priority) = &priority {
        options.extend(["--rt-priority", priority, "--rt-required"]);
    }
    let mut program = Running::start(&options);
    program.wait_for("SIMULATED");
    let mut own = Side::new("ecan-sim", network::MASTER)?;
    eprint!("{}", settings.apply()?);
    for side in [Some(&mut own), other.as_mut()].into_iter().flatten() {
        side.requester.configure()?;
    }
    for segment in 0..segments {
        if segment % 2 == 0 {
            own.run()?;
        }
        if let Some(other) = &mut other {
            other.run()?;
        }
        if segment % 2 == 1 {
            own.run()?;
        }
    }
    println!("turnaround, {segments} segments of {} frames each", Kind::ALL.len() * rounds(FRAMES));
    println!("                                     p50          p99");
    own.print();
    if let Some(other) = &other {
        other.print();
        let (own, other) = (own.quantiles(), other.quantiles());
        let ratio = |pick: fn(&Quantiles) -> f64| {
            median(own.iter().zip(&other).map(|(own, other)| pick(own) / pick(other)).collect())
        };
        let row = |quantile, value| {
            let scheduling = if priority.is_some() { "SCHED_FIFO" } else { "default scheduling" };
            let measure = format!("turnaround on veth, {scheduling}, {quantile}");
            Row::new(measure, "ecan-sim wire / another slave simulator", value).with_goals(1.0, 1.0)
        };
        print_rows(&[
            row("p50", ratio(|latency| latency.p50)),
            row("p99", ratio(|latency| latency.p99)),
        ]);
    }
    program.end(Signal::SIGTERM);
    Ok(())
}
