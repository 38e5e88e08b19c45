//! The example `simple_loop` against nodes that return every frame.

use crate::bench::{Bench, Kind};
use crate::bus::BusSpec;
use crate::child::Finished;
use crate::stop::{Stop, check};
use crate::table;

/// Arguments of a run.
#[derive(Debug, Clone, Copy)]
pub struct EchoRun {
    pub program: &'static str,
    pub gateways: u16,
    pub channels: u16,
    pub n: u16,
    pub options: &'static [&'static str],
}

impl EchoRun {
    /// One channel of one gateway with this PDO size.
    pub fn n(n: u16) -> Self {
        Self { program: "simple_loop", gateways: 1, channels: 1, n, options: &[] }
    }

    fn cycles(bench: &Bench) -> u64 {
        if bench.arguments.quick || bench.kind == Kind::Library { 200 } else { 1_000 }
    }

    /// The options of the program.
    pub fn arguments(&self, bench: &Bench) -> Vec<String> {
        let mut arguments: Vec<String> = Vec::new();
        let mut option = |name: &str, value: String| arguments.extend([name.to_owned(), value]);
        option("--slaves", self.gateways.to_string());
        option("--pdo-n", self.n.to_string());
        option("--cycles", Self::cycles(bench).to_string());
        if self.channels > 1 {
            option("--channel", "all".to_owned());
        }
        arguments.extend(self.options.iter().map(|option| (*option).to_owned()));
        arguments
    }
}

/// Runs it on gateways with echo nodes; every frame must be delivered and return.
pub fn run_echo(bench: &mut Bench, run: EchoRun) -> Result<(), Stop> {
    count_echo(bench, run).map(drop)
}

/// As [`run_echo`]; returns the number of frames of each channel.
pub fn count_echo(bench: &mut Bench, run: EchoRun) -> Result<u64, Stop> {
    bench.bus(BusSpec::echo(run.gateways))?;
    let command = bench.cyclic_example(run.program, run.arguments(bench));
    bench.wait_for_preop()?;
    let al_errors = bench.al_errors();
    let finished = bench.run(command)?.expect(0)?;
    let al_errors = bench.al_errors() - al_errors;
    check(al_errors == 0, || format!("{al_errors} AL errors in the log of the gateways"))?;
    if let Some(seconds) = finished.time_of("ready").filter(|_| bench.kind != Kind::Library) {
        bench.figure("ready_s", seconds);
    }
    let frames = EchoRun::cycles(bench);
    check_complete(&finished, run.gateways, run.channels, frames)?;
    if bench.kind != Kind::Library {
        let output = finished.output();
        for gateway in 0..run.gateways {
            if let Some(count) = table::number(&output, "wc miss", &format!("slave {gateway}")) {
                bench.figure(format!("slave{gateway}_incomplete_cycles"), count as f64);
            }
        }
    }
    Ok(frames)
}

/// Runs `simple_loop` with this configuration file on the bus as it is.
pub fn run_with_file(
    bench: &mut Bench,
    name: &str,
    text: &str,
    gateways: u16,
    channels: u16,
) -> Result<(), Stop> {
    let file = bench.write_file(name, text)?;
    let cycles = EchoRun::cycles(bench);
    let count = cycles.to_string();
    let program = bench.example("simple_loop", ["--config", &file, "--cycles", &count]);
    let finished = bench.run(program)?.expect(0)?;
    check_complete(&finished, gateways, channels, cycles)
}

/// Every frame of each channel was accepted, delivered and received.
fn check_complete(
    finished: &Finished,
    gateways: u16,
    channels: u16,
    frames: u64,
) -> Result<(), Stop> {
    let output = finished.output();
    for (gateway, channel) in
        (0..gateways).flat_map(|gateway| (0..channels).map(move |channel| (gateway, channel)))
    {
        let row = format!("slave {gateway} can{channel}");
        let counts =
            ["accepted", "delivered", "received"].map(|name| table::number(&output, name, &row));
        check(counts == [Some(frames); 3], || {
            let end = finished.end_text();
            format!("{row}: (accepted, delivered, received) = {counts:?}, expected {frames}: {end}")
        })?;
    }
    Ok(())
}
