//! Test bench of the steps: the bus, the programs, and the record of the running step.

mod execution;
mod listed_slaves;
mod present_bus;
mod programs;
mod waiting;

use std::path::PathBuf;

use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::new_file;

use crate::arguments::Arguments;
use crate::bus::BusSpec;
use crate::kernel_log::KernelLog;
use crate::record::Record;
use crate::slave::Slave;
use crate::stop::Stop;

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

/// Bus, programs and record that a step works with.
pub struct Bench {
    pub arguments: Arguments,
    pub kind: Kind,
    pub interrupt: Interrupt,
    pub record: Record,
    /// Directory for files of the steps.
    pub work: PathBuf,
    /// Keys of every simulated gateway, as in a scenario file.
    gateway_keys: String,
    library: String,
    /// Simulated gateways on the wire.
    slave: Option<Slave>,
    /// The present bus.
    spec: Option<BusSpec>,
    /// State of the random numbers; never 0.
    random: u64,
    kernel_log: KernelLog,
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
            gateway_keys: String::new(),
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

    /// The steps that follow run with gateways that have these keys.
    ///
    /// # Errors
    /// The present gateways cannot be stopped.
    pub fn change_gateways(&mut self, keys: String) -> Result<(), Stop> {
        self.gateway_keys = keys;
        self.spec = None;
        self.stop_slave().map(drop)
    }

    pub fn library(&self) -> &str {
        &self.library
    }

    /// Writes a file for programs; returns its path.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write_file(&self, name: &str, contents: impl AsRef<[u8]>) -> Result<String, Stop> {
        let path = self.work.join(name);
        new_file::write(&path, contents).map_err(|error| Stop::file(&path, &error))?;
        Ok(path.display().to_string())
    }
}
