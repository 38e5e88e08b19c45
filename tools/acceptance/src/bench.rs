//! What steps work with: the bus, the programs, and the record of the running step.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use ecan_command_line::interrupt::Interrupt;
use nix::unistd::Uid;

use crate::arguments::Arguments;
use crate::bus::{BusSpec, Nodes};
use crate::child::{CommandRecord, Finished, Running};
use crate::kernel_log::KernelLog;
use crate::need::Need;
use crate::slave::{Slave, SlaveReport};
use crate::stop::{Stop, check};

/// Time limit of a program that ends by itself.
const PROGRAM_LIMIT: Duration = Duration::from_secs(180);
/// Time limit for the master to find the slaves.
const SCAN_LIMIT: Duration = Duration::from_secs(60);

/// Kind of the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A master and simulated gateways on the other end of its cable.
    Wire,
    /// A master and connected gateways.
    Device,
    /// A simulated library: a new bus in each program.
    Library,
}

/// Record of the running step.
#[derive(Debug, Default)]
pub struct Record {
    pub commands: Vec<CommandRecord>,
    pub figures: BTreeMap<String, f64>,
    /// Lines of the kernel about EtherCAT.
    pub kernel_log: Vec<String>,
    /// Complete output of all programs.
    pub log: String,
}

pub struct Bench {
    pub arguments: Arguments,
    pub kind: Kind,
    pub interrupt: Interrupt,
    pub record: Record,
    /// Directory for files of the steps.
    pub work: PathBuf,
    library: String,
    slave: Option<Slave>,
    spec: Option<BusSpec>,
    random: u64,
    kernel_log: KernelLog,
}

/// A slave in the list of IgH's tool.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ListedSlave {
    pub state: String,
    pub has_error: bool,
    pub name: String,
}

impl Bench {
    /// # Errors
    /// The options contradict each other, or the directory of the report cannot be written.
    pub fn new(arguments: Arguments, interrupt: Interrupt) -> Result<Self, String> {
        let library = arguments.library.clone().unwrap_or_default();
        let work = arguments.report.join("files");
        std::fs::create_dir_all(&work).map_err(|error| format!("{}: {error}", work.display()))?;
        let work = work.canonicalize().map_err(|error| format!("{}: {error}", work.display()))?;
        let random = arguments.seed.max(1);
        let mut bench = Self {
            arguments,
            kind: Kind::Library,
            interrupt,
            record: Record::default(),
            work,
            library,
            slave: None,
            spec: None,
            random,
            kernel_log: KernelLog::open(),
        };
        if bench.program("ecan").is_none() {
            return Err("no program ecan; name its directory with --bin".to_owned());
        }
        if !bench.is_simulated_library()? {
            if bench.arguments.like_igh {
                return Err("--like-igh needs a simulated library".to_owned());
            }
            bench.kind = if bench.arguments.device { Kind::Device } else { Kind::Wire };
            if bench.kind == Kind::Wire && bench.arguments.interface.is_none() {
                return Err(
                    "--interface or --device is missing: where are the gateways?".to_owned()
                );
            }
            if bench.arguments.ethercat.is_none() {
                return Err("--ethercat is missing: the path of IgH's tool".to_owned());
            }
        } else if bench.arguments.interface.is_some() || bench.arguments.device {
            return Err("a simulated library has no --interface and no --device".to_owned());
        }
        Ok(bench)
    }

    /// A simulated library identifies itself on standard error.
    fn is_simulated_library(&mut self) -> Result<bool, String> {
        if self.library == "sim" || self.library.starts_with("sim:") {
            return Ok(true);
        }
        let scan = self.ecan(["scan"]);
        let finished = self.run(scan).map_err(|stop| stop.to_string())?;
        Ok(finished.errors().contains("SIMULATED:"))
    }

    pub fn library(&self) -> &str {
        &self.library
    }

    // ---- programs

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

    fn scenario_path(&self) -> PathBuf {
        self.work.join("scenario.toml")
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

    /// `ecan` with the library and the master.
    pub fn ecan<S: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = S>) -> Command {
        let mut command = self.command("ecan");
        command.arg("--ecrt").arg(self.ecrt());
        if self.kind != Kind::Library && self.arguments.master != 0 {
            command.arg("--master").arg(self.arguments.master.to_string());
        }
        command.args(arguments);
        command
    }

    /// As [`ecan`](Self::ecan), for the first gateway of the bus.
    pub fn ecan_first<S: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = S>) -> Command {
        let mut command = self.ecan(["--slave", "0"]);
        command.args(arguments);
        command
    }

    /// An example program with the library, the master and the cycle.
    pub fn example<S: AsRef<OsStr>>(
        &self,
        name: &str,
        arguments: impl IntoIterator<Item = S>,
    ) -> Command {
        let mut command = self.command(name);
        command.arg("--ecrt").arg(self.ecrt());
        if self.kind != Kind::Library {
            // A configuration file names the master itself; the default is 0.
            if self.arguments.master != 0 {
                command.arg("--master").arg(self.arguments.master.to_string());
            }
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
            .and_then(|()| std::fs::write(&path, text))
            .and_then(|()| std::fs::set_permissions(&path, Permissions::from_mode(0o755)))
            .map_err(|error| Stop::Failed(format!("{}: {error}", path.display())))?;
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

    /// A time limit of this machine.
    pub fn limit(&self, time: Duration) -> Duration {
        time * self.arguments.patience
    }

    /// Runs a program to its end.
    ///
    /// # Errors
    /// It cannot be started or does not end in time, or the user interrupts.
    pub fn run(&mut self, command: Command) -> Result<Finished, Stop> {
        let running = self.start(command)?;
        let finished = running.finish(self.limit(PROGRAM_LIMIT))?;
        Ok(self.note(finished))
    }

    /// Starts a program; pass its end to [`note`](Self::note).
    pub fn start(&mut self, command: Command) -> Result<Running, Stop> {
        if self.interrupt.is_set() {
            return Err(Stop::Interrupted);
        }
        Running::start(command, &self.interrupt)
    }

    /// Records the end of a program.
    pub fn note(&mut self, finished: Finished) -> Finished {
        let log = &mut self.record.log;
        log.push_str(&format!("$ {}\n", finished.command));
        for line in &finished.lines {
            log.push_str(&format!("{:9.3} {}\n", line.at.as_secs_f64(), line.text));
        }
        log.push_str(&format!("= {:?}\n\n", finished.status.code()));
        self.record.commands.push(finished.record());
        finished
    }

    /// Records a measured value.
    pub fn figure(&mut self, name: impl Into<String>, value: f64) {
        self.record.figures.insert(name.into(), value);
    }

    /// Returns whether the lines of the kernel are part of the report.
    pub fn has_kernel_log(&self) -> bool {
        self.kind != Kind::Library && self.kernel_log.is_readable()
    }

    /// Ignores the lines so far.
    pub fn forget_kernel_log(&mut self) {
        self.kernel_log.take();
    }

    /// The lines of the kernel about EtherCAT since the start of the step.
    pub fn kernel_lines(&mut self) -> &[String] {
        if self.has_kernel_log() {
            let lines = self.kernel_log.take();
            self.record.kernel_log.extend(lines);
        }
        &self.record.kernel_log
    }

    /// # Errors
    /// The kernel has reported this since the start of the step.
    pub fn expect_no_kernel_line(&mut self, text: &str) -> Result<(), Stop> {
        let line = self.kernel_lines().iter().find(|line| line.contains(text)).cloned();
        line.map_or(Ok(()), |line| Err(Stop::Failed(format!("the kernel log has: {line}"))))
    }

    /// Writes a file for programs; returns its path.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write_file(&self, name: &str, text: &str) -> Result<String, Stop> {
        let path = self.work.join(name);
        std::fs::write(&path, text)
            .map_err(|error| Stop::Failed(format!("{}: {error}", path.display())))?;
        Ok(path.display().to_string())
    }

    // ---- time

    /// Waits, unless the user interrupts.
    pub fn pause(&self, time: Duration) -> Result<(), Stop> {
        let begin = Instant::now();
        while begin.elapsed() < time {
            if self.interrupt.is_set() {
                return Err(Stop::Interrupted);
            }
            std::thread::sleep(Duration::from_millis(20).min(time));
        }
        Ok(())
    }

    /// Repeats a question until it has an answer.
    pub fn poll<T>(
        &mut self,
        what: &str,
        limit: Duration,
        mut ask: impl FnMut(&mut Self) -> Result<Option<T>, Stop>,
    ) -> Result<T, Stop> {
        let (begin, limit) = (Instant::now(), self.limit(limit));
        loop {
            if let Some(answer) = ask(self)? {
                return Ok(answer);
            }
            if begin.elapsed() >= limit {
                return Err(Stop::Failed(format!("not within {} s: {what}", limit.as_secs())));
            }
            self.pause(Duration::from_millis(100))?;
        }
    }

    /// Random time up to this one, from the seed.
    pub fn random_time(&mut self, most: Duration) -> Duration {
        // xorshift64
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        most.mul_f64((self.random >> 11) as f64 / (1_u64 << 53) as f64)
    }

    // ---- bus

    /// Provides a bus. Simulated gateways are started again only if another bus is needed.
    ///
    /// # Errors
    /// Skips the step if there is no such bus.
    pub fn bus(&mut self, mut spec: BusSpec) -> Result<(), Stop> {
        if self.kind != Kind::Device && spec.nodes == Nodes::Any {
            spec.nodes = Nodes::Echo;
        }
        let is_running = self.slave.as_mut().is_some_and(Slave::is_running);
        let is_present = self.kind != Kind::Wire || is_running;
        if self.spec.as_ref() == Some(&spec) && is_present {
            return Ok(());
        }
        match self.kind {
            Kind::Device => self.check_device(&spec)?,
            Kind::Library => {}
            Kind::Wire => {
                let most = self.arguments.gateways;
                if spec.gateways > most {
                    let text = format!("needs {} gateways, --gateways is {most}", spec.gateways);
                    return Err(Stop::Skipped(text));
                }
            }
        }
        self.stop_slave()?;
        let path = self.scenario_path();
        let head = if self.arguments.like_igh { "[master]\nlike = \"igh\"\n" } else { "" };
        std::fs::write(&path, spec.scenario(head))
            .map_err(|error| Stop::Failed(format!("{}: {error}", path.display())))?;
        self.spec = Some(spec);
        if self.kind == Kind::Wire {
            self.wait_for_slaves(0)?;
            self.start_slave()?;
        }
        if self.kind != Kind::Library {
            let begin = Instant::now();
            self.wait_for_slaves(self.gateway_count())?;
            self.figure("bus_scan_s", begin.elapsed().as_secs_f64());
        }
        Ok(())
    }

    /// As [`bus`](Self::bus), with gateways that have just been switched on, if they are simulated.
    pub fn fresh_bus(&mut self, spec: BusSpec) -> Result<(), Stop> {
        self.spec = None;
        self.bus(spec)
    }

    fn check_device(&self, spec: &BusSpec) -> Result<(), Stop> {
        let present = self.arguments.gateways;
        let reason = if spec.needs_simulation() {
            "needs faults of simulated gateways".to_owned()
        } else if spec.nodes == Nodes::Drives {
            "needs simulated drives".to_owned()
        } else if spec.nodes == Nodes::Echo && !self.arguments.echo_nodes {
            "needs nodes that return every frame; connect them and give --echo-nodes".to_owned()
        } else if spec.gateways > present {
            format!("needs {} gateways, --gateways is {present}", spec.gateways)
        } else {
            return Ok(());
        };
        Err(Stop::Skipped(reason))
    }

    /// Number of gateways on the present bus.
    pub fn gateway_count(&self) -> u16 {
        match (self.kind, &self.spec) {
            (Kind::Device, _) => self.arguments.gateways,
            (_, Some(spec)) => spec.gateways,
            (_, None) => 0,
        }
    }

    /// Starts the simulated gateways on the wire.
    pub fn start_slave(&mut self) -> Result<(), Stop> {
        let interface = self.arguments.interface.clone().unwrap_or_default();
        let mut command = self.plain("ecan-sim", ["wire", "--interface", &interface, "--scenario"]);
        command.arg(self.scenario_path()).args(self.real_time_options());
        let gateways = self.gateway_count();
        self.slave = Some(Slave::start(command, gateways, &self.interrupt)?);
        Ok(())
    }

    /// Ends the simulated gateways on the wire; `None` if there are none.
    pub fn stop_slave(&mut self) -> Result<Option<SlaveReport>, Stop> {
        let Some(slave) = self.slave.take() else { return Ok(None) };
        let mut slave = slave;
        if !slave.is_running() {
            return Ok(None);
        }
        let report = slave.stop()?;
        self.note(report.0.clone());
        Ok(Some(report))
    }

    /// The simulated gateways on the wire.
    pub fn slave(&mut self) -> Result<&mut Slave, Stop> {
        self.slave
            .as_mut()
            .ok_or_else(|| Stop::Skipped("no simulated gateways on the wire".to_owned()))
    }

    /// Switches the gateways off for this time and on again, while programs run.
    pub fn power_cycle(&mut self, off: Duration) -> Result<(), Stop> {
        match self.kind {
            Kind::Wire => {
                self.stop_slave()?;
                self.pause(off)?;
                self.start_slave()
            }
            Kind::Device => {
                let Some(command) = self.arguments.power_cycle.clone() else {
                    return Err(Stop::Skipped("needs --power-cycle COMMAND".to_owned()));
                };
                let command = self.system("sh", ["-c", &command]);
                self.run(command)?.expect(0).map(drop)
            }
            Kind::Library => {
                Err(Stop::Skipped("a simulated library has no power switch".to_owned()))
            }
        }
    }

    /// The slaves that IgH's tool lists.
    pub fn listed_slaves(&mut self) -> Result<Vec<ListedSlave>, Stop> {
        let command = self.ethercat(["slaves"]);
        let running = Running::start(command, &self.interrupt)?;
        let finished = running.finish(self.limit(PROGRAM_LIMIT))?.expect(0)?;
        Ok(finished.output().lines().filter_map(ListedSlave::parse).collect())
    }

    /// Waits until the master lists these slaves, all in PREOP or above.
    pub fn wait_for_slaves(&mut self, count: u16) -> Result<(), Stop> {
        let mut last = Vec::new();
        let found = self.poll("the master lists the slaves", SCAN_LIMIT, |bench| {
            last = bench.listed_slaves()?;
            let is_up = |slave: &ListedSlave| slave.is_up();
            let is_expected = last.len() == usize::from(count)
                // Other slaves may be connected too.
                || bench.kind == Kind::Device && last.len() > usize::from(count);
            let is_complete = is_expected && last.iter().all(is_up);
            Ok(is_complete.then_some(()))
        });
        match found {
            Err(Stop::Failed(message)) => {
                Err(Stop::Failed(format!("{message}: expected {count}, listed {last:?}")))
            }
            other => other,
        }
    }

    /// Number of AL errors that the simulated gateways on the wire have reported; 0 for others.
    pub fn al_errors(&mut self) -> usize {
        self.slave.as_mut().map_or(0, |slave| slave.count_lines("AL error"))
    }

    // ---- conditions

    /// The reason for which a step does not apply.
    pub fn missing(&self, need: Need) -> Option<String> {
        let is_missing = match need {
            Need::LastingBus => self.kind == Kind::Library,
            Need::Wire => self.kind != Kind::Wire,
            Need::Simulated => self.kind == Kind::Device,
            Need::EchoNodes => self.kind == Kind::Device && !self.arguments.echo_nodes,
            Need::WriteFlash => self.kind == Kind::Device && !self.arguments.write_flash,
            Need::EthercatTool => self.arguments.ethercat.is_none(),
            Need::Root => !Uid::effective().is_root(),
            Need::Gateways(count) => self.kind != Kind::Library && self.arguments.gateways < count,
            Need::Program(name) => self.program(name).is_none(),
            Need::System(name) => !is_on_path(name),
            Need::Full => self.arguments.quick,
        };
        is_missing.then(|| match need {
            Need::LastingBus => "the bus of a simulated library lasts for one program".to_owned(),
            Need::Wire => "needs simulated gateways on the wire".to_owned(),
            Need::Simulated => "needs simulated gateways".to_owned(),
            Need::EchoNodes => "needs nodes that return every frame (--echo-nodes)".to_owned(),
            Need::WriteFlash => "would replace the saved configuration (--write-flash)".to_owned(),
            Need::EthercatTool => "needs IgH's tool (--ethercat)".to_owned(),
            Need::Root => "needs root".to_owned(),
            Need::Gateways(count) => format!("needs {count} gateways (--gateways)"),
            Need::Program(name) => format!("no program {name} (--bin)"),
            Need::System(name) => format!("no program {name} on this system"),
            Need::Full => "not in the short list (--quick)".to_owned(),
        })
    }

    /// # Errors
    /// The gateways are lost.
    pub fn check_slave(&mut self) -> Result<(), Stop> {
        let is_present = self.slave.as_mut().is_none_or(Slave::is_running);
        check(is_present, || "the simulated gateways have ended by themselves".to_owned())
    }
}

fn is_on_path(name: &str) -> bool {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&paths).any(|directory| directory.join(name).is_file())
}

impl ListedSlave {
    /// Returns whether it is in PREOP or above, without an error.
    fn is_up(&self) -> bool {
        !self.has_error && ["PREOP", "SAFEOP", "OP"].contains(&self.state.as_str())
    }

    /// A line of `ethercat slaves`: `0  0:0  PREOP  +  ECAN-Lite`.
    fn parse(line: &str) -> Option<Self> {
        let mut words = line.split_whitespace();
        let _position: u16 = words.next()?.parse().ok()?;
        let _address = words.next()?;
        let (state, flag) = (words.next()?.to_owned(), words.next()?);
        let name = words.collect::<Vec<_>>().join(" ");
        Some(Self { state, has_error: flag == "E", name })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_the_tool_are_parsed() {
        let slave = ListedSlave::parse("1  5555:1  SAFEOP+ERROR  E  ECAN Lite").unwrap();
        assert_eq!(
            slave,
            ListedSlave { state: "SAFEOP+ERROR".into(), has_error: true, name: "ECAN Lite".into() }
        );
        assert_eq!(ListedSlave::parse("no slaves"), None);
    }
}
