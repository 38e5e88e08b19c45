use std::process::Command;

use serde::Serialize;

use crate::bench::{Bench, Kind};

/// Versions and options of a run.
#[derive(Debug, Serialize)]
pub struct Versions {
    pub sdk: String,
    pub library: String,
    /// Release of the library, as IgH's tool or the simulator states it.
    pub master: String,
    pub kernel: String,
    pub gateways: String,
    pub options: String,
}

fn first_line(command: Command, bench: &mut Bench) -> String {
    let lines = bench.run(command).map(|finished| finished.lines).unwrap_or_default();
    lines.into_iter().map(|line| line.text).find(|text| !text.trim().is_empty()).unwrap_or_default()
}

impl Versions {
    /// Reads them from the system; what cannot be read is empty.
    pub fn read(bench: &mut Bench) -> Self {
        let (sdk, kernel) = (bench.plain("ecan", ["--version"]), bench.system("uname", ["-srvm"]));
        let (master, gateways) = match bench.kind {
            Kind::Library => {
                let like = if bench.arguments.like_igh { ", pace of IgH" } else { "" };
                (format!("simulated{like}"), "in the library".to_owned())
            }
            kind => {
                let version = bench.ethercat(["version"]);
                let gateways = match (kind, &bench.arguments.interface) {
                    (Kind::Wire, Some(interface)) => format!("simulated, on {interface}"),
                    _ => format!("{} connected", bench.arguments.gateways),
                };
                (first_line(version, bench), gateways)
            }
        };
        let arguments = &bench.arguments;
        let options = format!(
            "cycle {} us, seed {}{}{}",
            arguments.cycle_us,
            arguments.seed,
            if arguments.quick { ", quick" } else { "" },
            arguments
                .rt_priority
                .map_or_else(String::new, |priority| format!(", priority {priority}"))
        );
        Self {
            sdk: first_line(sdk, bench),
            library: bench.library().to_owned(),
            master,
            kernel: first_line(kernel, bench),
            gateways,
            options,
        }
    }

    /// Names and values, in the order of the report.
    pub fn rows(&self) -> [(&'static str, String); 6] {
        [
            ("sdk", self.sdk.clone()),
            ("library", self.library.clone()),
            ("master", self.master.clone()),
            ("kernel", self.kernel.clone()),
            ("gateways", self.gateways.clone()),
            ("options", self.options.clone()),
        ]
    }
}
