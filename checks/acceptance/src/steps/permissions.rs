//! Users without rights.

use crate::bench::Bench;
use crate::bus::BusSpec;
use crate::need::Need;
use crate::step::{Group, Step};
use crate::stop::Stop;

pub const GROUP: Group = Group {
    name: "permissions",
    steps: &[
        Step {
            name: "no_access",
            proves: "A user without access to the master gets an error with the file and the remedy.",
            needs: &[Need::LastingBus, Need::Root, Need::System("setpriv")],
            run: no_access,
        },
        Step {
            name: "no_real_time",
            proves: "`--rt-required` fails with the reason for a user without real-time rights.",
            needs: &[Need::Root, Need::System("setpriv")],
            run: no_real_time,
        },
        Step {
            name: "setup_host",
            proves: "`scripts/setup_host.sh` shows rule and limits without changing the host.",
            needs: &[],
            run: setup_host,
        },
    ],
};

/// User and group `nobody`.
const NOBODY: &str = "65534";

/// The command without rights.
fn as_nobody(bench: &Bench, command: &std::process::Command) -> std::process::Command {
    let mut nobody = bench.system(
        "setpriv",
        [
            "--reuid",
            NOBODY,
            "--regid",
            NOBODY,
            "--clear-groups",
            "--no-new-privs",
            "--bounding-set=-all",
            "--inh-caps=-all",
        ],
    );
    nobody.arg(command.get_program()).args(command.get_args());
    // The working directory may be closed to others.
    nobody.current_dir("/");
    nobody
}

fn no_access(bench: &mut Bench) -> Result<(), Stop> {
    use std::os::unix::fs::PermissionsExt;
    bench.bus(BusSpec::any(1))?;
    let device = format!("/dev/EtherCAT{}", bench.arguments.master);
    let mode = std::fs::metadata(&device).map(|metadata| metadata.permissions().mode());
    if mode.is_ok_and(|mode| mode & 0o004 != 0) {
        return Err(Stop::Skipped(format!("{device} is readable for every user")));
    }
    let command = as_nobody(bench, &bench.ecan(["scan"]));
    bench.run(command)?.expect(3)?.expect_text(&device).map(drop)
}

fn no_real_time(bench: &mut Bench) -> Result<(), Stop> {
    let send = bench.plain(
        "ecan",
        ["--ecrt", "sim:echo", "send", "--rt-priority", "80", "--rt-required", "123#11"],
    );
    let command = as_nobody(bench, &send);
    bench.run(command)?.expect(7).map(drop)
}

fn setup_host(bench: &mut Bench) -> Result<(), Stop> {
    let command = bench.script("setup_host.sh", ["show"]);
    bench.run(command)?.expect(0)?.expect_text("EtherCAT").map(drop)
}
