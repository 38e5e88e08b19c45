//! The configuration file: to the gateway, its Flash and other masters.

use crate::bench::{Bench, Kind};
use crate::bus::BusSpec;
use crate::need::Need;
use crate::step::{Group, Step};
use crate::stop::{Stop, check};

pub const GROUP: Group = Group {
    name: "configuration",
    steps: &[
        Step {
            name: "check",
            proves: "The example file is valid; a wrong value is reported with its line.",
            needs: &[],
            run: check_file,
        },
        Step {
            name: "plan",
            proves: "`ecan plan` estimates the load of the file offline.",
            needs: &[],
            run: plan,
        },
        Step {
            name: "apply",
            proves: "`ecan config apply` writes the file; `config diff` finds no difference afterwards.",
            needs: &[],
            run: apply,
        },
        Step {
            name: "save_and_factory",
            proves: "A saved configuration outlives a restart; `config factory` removes it.",
            needs: &[Need::LastingBus, Need::WriteFlash],
            run: save_and_factory,
        },
        Step {
            name: "load",
            proves: "`ecan config load` restores the saved configuration.",
            needs: &[Need::LastingBus, Need::WriteFlash],
            run: load,
        },
        Step {
            name: "export",
            proves: "The startup list is exported in every format.",
            needs: &[],
            run: export,
        },
        Step {
            name: "exported_script",
            proves: "The exported `ethercat` script configures the gateway as `config apply` does.",
            needs: &[Need::LastingBus, Need::EthercatTool],
            run: exported_script,
        },
    ],
};

/// A file with one classic and one CAN FD channel.
fn file(bench: &Bench) -> Result<String, Stop> {
    let text = "[[gateway]]\nposition = 0\nn = 5\n[gateway.can0]\nbitrate = 250_000\n\
                [gateway.can1]\nbitrate = 500_000\ndata_bitrate = 2_000_000\n";
    bench.write_file("cell.toml", text)
}

fn check_file(bench: &mut Bench) -> Result<(), Stop> {
    let example = bench.plain("ecan", ["config", "example"]);
    let example = bench.run(example)?.expect(0)?.output();
    let good = bench.write_file("example.toml", &example)?;
    let command = bench.plain("ecan", ["config", "check", &good]);
    bench.run(command)?.expect(0)?;
    let bad = bench.write_file("wrong.toml", "[[gateway]]\nn = 30\n")?;
    let command = bench.plain("ecan", ["config", "check", &bad]);
    bench.run(command)?.expect(1)?.expect_text("wrong.toml:2").map(drop)
}

fn plan(bench: &mut Bench) -> Result<(), Stop> {
    let file = file(bench)?;
    let command = bench.plain("ecan", ["plan", "--config", &file]);
    bench.run(command)?.expect(0)?.expect_text("working counter").map(drop)
}

fn diff(bench: &mut Bench, file: &str) -> Result<Option<i32>, Stop> {
    let command = bench.ecan(["config", "diff", file]);
    Ok(bench.run(command)?.expect_one_of(&[0, 1])?.code())
}

fn expect_diff(bench: &mut Bench, file: &str, code: i32) -> Result<(), Stop> {
    let found = diff(bench, file)?;
    check(found == Some(code), || format!("config diff: exit status {found:?}, expected {code}"))
}

fn apply(bench: &mut Bench) -> Result<(), Stop> {
    bench.fresh_bus(BusSpec::any(1))?;
    let file = file(bench)?;
    expect_diff(bench, &file, 1)?;
    let command = bench.ecan(["config", "apply", &file]);
    bench.run(command)?.expect(0)?;
    match bench.kind {
        Kind::Library => Ok(()),
        Kind::Wire | Kind::Device => expect_diff(bench, &file, 0),
    }
}

fn reboot(bench: &mut Bench) -> Result<(), Stop> {
    let command = bench.ecan_first(["reboot", "--wait"]);
    bench.run(command)?.expect(0).map(drop)
}

fn config(bench: &mut Bench, arguments: &[&str]) -> Result<(), Stop> {
    let mut command = bench.ecan_first(["config"]);
    command.args(arguments);
    bench.run(command)?.expect(0).map(drop)
}

fn save_and_factory(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let file = file(bench)?;
    config(bench, &["apply", &file])?;
    config(bench, &["save"])?;
    reboot(bench)?;
    expect_diff(bench, &file, 0)?;
    config(bench, &["factory", "--yes"])?;
    reboot(bench)?;
    expect_diff(bench, &file, 1)
}

fn load(bench: &mut Bench) -> Result<(), Stop> {
    bench.bus(BusSpec::any(1))?;
    let file = file(bench)?;
    config(bench, &["apply", &file])?;
    config(bench, &["save"])?;
    let write = bench.ecan_first(["sdo", "write", "0x8001:19", "125000"]);
    bench.run(write)?.expect(0)?;
    expect_diff(bench, &file, 1)?;
    config(bench, &["load"])?;
    expect_diff(bench, &file, 0)?;
    config(bench, &["factory", "--yes"])
}

fn export(bench: &mut Bench) -> Result<(), Stop> {
    let file = file(bench)?;
    let formats = [("csv", "0xF000"), ("twincat", "<"), ("codesys", ";"), ("ethercat", "download")];
    for (format, text) in formats {
        let command = bench.plain("ecan", ["config", "export", &file, "--format", format]);
        bench.run(command)?.expect(0)?.expect_text(text)?;
    }
    Ok(())
}

fn exported_script(bench: &mut Bench) -> Result<(), Stop> {
    bench.fresh_bus(BusSpec::any(1))?;
    let file = file(bench)?;
    let command = bench.plain("ecan", ["config", "export", &file, "--format", "ethercat"]);
    let script = bench.run(command)?.expect(0)?.output();
    let script = bench.write_file("startup.sh", &script)?;
    let tool = bench.ethercat_on_path()?;
    let mut run = bench.system("sh", [&script]);
    run.env("PATH", tool);
    bench.run(run)?.expect(0)?;
    expect_diff(bench, &file, 0)
}
