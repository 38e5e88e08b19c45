//! Programs of the SDK and of the system, as commands with their options.

use std::ffi::OsStr;
use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use ecan_tool_support::command_line::new_file;

use super::{Bench, Kind};
use crate::stop::Stop;

impl Bench {
    /// Path of a program of the SDK.
    pub fn program(&self, name: &str) -> Option<PathBuf> {
        let candidates = self.arguments.bin.iter().map(|directory| directory.join(name));
        candidates.filter_map(|path| path.canonicalize().ok()).find(|path| path.is_file())
    }

    fn command(&self, name: &str) -> Command {
        // A missing program fails at its start, with its name.
        let mut command = Command::new(self.program(name).unwrap_or_else(|| PathBuf::from(name)));
        command.env("NO_COLOR", "1").env_remove("RUST_LOG").current_dir(&self.work);
        match self.shared_library_scenario() {
            Some(setting) => command.env("ECAN_ECRT", setting),
            None => command.env_remove("ECAN_ECRT"),
        };
        command
    }

    /// A simulated shared library reads its scenario from the environment.
    fn shared_library_scenario(&self) -> Option<String> {
        let is_shared = self.kind == Kind::Library && !self.library.starts_with("sim");
        (is_shared && self.spec.is_some())
            .then(|| format!("sim:{}", self.scenario_path().display()))
    }

    /// Value of the option `--ecrt`.
    pub fn ecrt(&self) -> String {
        if self.library == "sim" && self.spec.is_some() {
            return format!("sim:{}", self.scenario_path().display());
        }
        self.library.clone()
    }

    /// A program of the SDK without the options of the library.
    pub fn plain<S: AsRef<OsStr>>(
        &self,
        name: &str,
        arguments: impl IntoIterator<Item = S>,
    ) -> Command {
        let mut command = self.command(name);
        command.args(arguments);
        command
    }

    /// A program of the SDK with the library and the master.
    fn command_on_master(&self, name: &str) -> Command {
        let mut command = self.command(name);
        command.arg("--ecrt").arg(self.ecrt());
        // A configuration file names the master itself, so the default, 0, is not given.
        if self.kind != Kind::Library && self.arguments.master != 0 {
            command.arg("--master").arg(self.arguments.master.to_string());
        }
        command
    }

    /// `ecan` with the library and the master.
    pub fn ecan<S: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = S>) -> Command {
        let mut command = self.command_on_master("ecan");
        command.args(arguments);
        command
    }

    /// As [`ecan`](Self::ecan), for the first gateway of the bus.
    pub fn ecan_first<S: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = S>) -> Command {
        let mut command = self.ecan(["--slave", "0"]);
        command.args(arguments);
        command
    }

    /// An example program with the library, the master and the real-time options.
    pub fn example<S: AsRef<OsStr>>(
        &self,
        name: &str,
        arguments: impl IntoIterator<Item = S>,
    ) -> Command {
        let mut command = self.command_on_master(name);
        if self.kind != Kind::Library {
            match name {
                "canopen_sdo_probe" => &mut command,
                // It locks its memory with this option.
                "igh_mcan_gateway_tx_probe" => {
                    command.args(self.real_time_options().iter().take(2))
                }
                _ if name.starts_with("igh_") => &mut command,
                _ => command.args(self.real_time_options()),
            };
        }
        command.args(arguments);
        command
    }

    /// As [`example`](Self::example), with the EtherCAT cycle.
    pub fn cyclic_example<S: AsRef<OsStr>>(
        &self,
        name: &str,
        arguments: impl IntoIterator<Item = S>,
    ) -> Command {
        let mut command = self.example(name, ["--cycle-us"]);
        command.arg(self.arguments.cycle_us.to_string()).args(arguments);
        command
    }

    /// The options `--rt-priority` and `--lock-memory`, if they were asked for.
    pub fn real_time_options(&self) -> Vec<String> {
        self.arguments.rt_priority.map_or_else(Vec::new, |priority| {
            vec!["--rt-priority".to_owned(), priority.to_string(), "--lock-memory".to_owned()]
        })
    }

    /// IgH's tool.
    pub fn ethercat<S: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = S>) -> Command {
        let path = self.arguments.ethercat.as_deref().unwrap_or(Path::new("ethercat"));
        let mut command = Command::new(path);
        command.args(arguments).arg("--master").arg(self.arguments.master.to_string());
        command.current_dir(&self.work);
        command
    }

    /// A command of `ecan` with the option `--ethercat`, if the path of IgH's tool is known.
    pub fn with_ethercat(&self, mut command: Command) -> Command {
        if let Some(path) = &self.arguments.ethercat {
            command.arg("--ethercat").arg(path);
        }
        command
    }

    /// A search path on which `ethercat` is IgH's tool, with the master.
    pub fn ethercat_on_path(&self) -> Result<String, Stop> {
        let directory = self.work.join("tool");
        let path = directory.join("ethercat");
        let tool = self.arguments.ethercat.as_deref().unwrap_or(Path::new("ethercat"));
        let text = format!(
            "#!/bin/sh\nexec '{}' \"$@\" --master {}\n",
            tool.display(),
            self.arguments.master
        );
        std::fs::create_dir_all(&directory)
            .and_then(|()| new_file::write(&path, text))
            .and_then(|()| std::fs::set_permissions(&path, Permissions::from_mode(0o755)))
            .map_err(|error| Stop::file(&path, &error))?;
        let rest = std::env::var("PATH").unwrap_or_default();
        Ok(format!("{}:{rest}", directory.display()))
    }

    /// A script of the SDK.
    pub fn script<S: AsRef<OsStr>>(
        &self,
        name: &str,
        arguments: impl IntoIterator<Item = S>,
    ) -> Command {
        let path = self.arguments.scripts.join(name);
        let mut command = Command::new("bash");
        command.arg(path.canonicalize().unwrap_or(path)).args(arguments).current_dir(&self.work);
        command
    }

    /// A program of the system.
    pub fn system<S: AsRef<OsStr>>(
        &self,
        name: &str,
        arguments: impl IntoIterator<Item = S>,
    ) -> Command {
        let mut command = Command::new(name);
        command.args(arguments).current_dir(&self.work);
        command
    }
}
