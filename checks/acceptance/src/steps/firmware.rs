//! Firmware over FoE.

use std::path::Path;
use std::time::Duration;

use crate::bench::{Bench, Kind};
use crate::bus::BusSpec;
use crate::child::Finished;
use crate::need::Need;
use crate::step::{Group, Step};
use crate::stop::{Stop, check};

pub const GROUP: Group = Group {
    name: "firmware",
    steps: &[
        Step {
            name: "version",
            proves: "`ecan firmware version` reads the running version.",
            needs: &[],
            run: version,
        },
        Step {
            name: "update",
            proves: "`ecan firmware update` writes a package; the new version runs after the restart.",
            needs: &[Need::Simulated, Need::Program("ecan-sim")],
            run: update,
        },
        Step {
            name: "damaged_file",
            proves: "A damaged package is rejected, and the gateway keeps its version.",
            needs: &[Need::Simulated, Need::Program("ecan-sim")],
            run: damaged_file,
        },
        Step {
            name: "foe_write",
            proves: "IgH's tool writes a package without `ecan` (manual 15.3.1).",
            needs: &[Need::Wire, Need::EthercatTool, Need::Program("ecan-sim")],
            run: foe_write,
        },
    ],
};

/// Version of the package.
const NEW: &str = "3.0.7";
/// Time limit of a transfer, and of the restart after it.
const LIMIT: Duration = Duration::from_secs(60);

fn running_version(bench: &mut Bench) -> Result<String, Stop> {
    let command = bench.ecan_first(["--json", "firmware", "version"]);
    let report = bench.run(command)?.expect(0)?.json()?;
    Ok(report[0]["numbers"].as_str().unwrap_or_default().to_owned())
}

fn version(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let version = running_version(bench)?;
    check(!version.is_empty(), || "no version".to_owned())
}

/// A package for simulated gateways.
fn package(bench: &mut Bench) -> Result<String, Stop> {
    let path = bench.work.join("new.bin").display().to_string();
    let command = bench.plain("ecan-sim", ["firmware", "--version", NEW, "--out", &path]);
    let _ = std::fs::remove_file(&path);
    bench.run(command)?.expect(0)?;
    Ok(path)
}

fn run_update(bench: &mut Bench, file: &str) -> Result<Finished, Stop> {
    let command = bench.ecan_first(["firmware", "update", file, "--yes"]);
    // The simulator rejects the option: it receives the file in this process.
    let command = if bench.kind == Kind::Library { command } else { bench.with_ethercat(command) };
    bench.run(command)
}

fn update(bench: &mut Bench) -> Result<(), Stop> {
    bench.fresh_bus(BusSpec::any(1))?;
    let file = package(bench)?;
    let finished = run_update(bench, &file)?.expect(0)?.expect_text(NEW)?;
    bench.figure("update_s", finished.seconds);
    if bench.kind != Kind::Library {
        let running = running_version(bench)?;
        check(running == NEW, || format!("version {running} runs, expected {NEW}"))?;
    }
    Ok(())
}

fn damaged_file(bench: &mut Bench) -> Result<(), Stop> {
    bench.fresh_bus(BusSpec::any(1))?;
    let before = running_version(bench)?;
    let file = package(bench)?;
    let path = Path::new(&file);
    let mut bytes = std::fs::read(path).map_err(|error| Stop::file(path, &error))?;
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0xFF;
    let file = bench.write_file("damaged.bin", &bytes)?;
    run_update(bench, &file)?.expect_one_of(&[1, 5, 6])?;
    let after = running_version(bench)?;
    check(before == after, || format!("version {after} runs, expected {before}"))
}

fn foe_write(bench: &mut Bench) -> Result<(), Stop> {
    bench.fresh_bus(BusSpec::any(1))?;
    let file = package(bench)?;
    // The master reads the SDO dictionary after a scan; responses of that end the first file.
    bench.poll("the file is written", LIMIT, |bench| {
        let command = bench.ethercat(["foe_write", "-p", "0", "-o", "ecan_lite_app", &file]);
        let finished = bench.run(command)?;
        if finished.errors().contains("FOE_MBOX_PROT_ERROR") {
            read_twice(bench)?;
            return Ok(None);
        }
        finished.expect(0).map(|_| Some(()))
    })?;
    bench.poll("the new version runs", LIMIT, |bench| {
        let command = bench.ecan_first(["--json", "firmware", "version"]);
        let finished = bench.run(command)?;
        let is_new = finished.code() == Some(0) && finished.output().contains(NEW);
        Ok(is_new.then_some(()))
    })
}

/// Two objects, so that no old response is left in the mailbox.
fn read_twice(bench: &mut Bench) -> Result<(), Stop> {
    for object in [["0x1000", "0"], ["0x1018", "1"]] {
        bench.poll("an object is read", LIMIT, |bench| {
            let command = ["upload", "-p", "0", "-t", "uint32", object[0], object[1]];
            let command = bench.ethercat(command);
            Ok((bench.run(command)?.code() == Some(0)).then_some(()))
        })?;
    }
    Ok(())
}
