//! Support bundle: everything that could be read of gateways, their master, a service and the host, with versions.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use clap::Args;
use ecan_host::Error;
use ecan_protocol::device::AlState;
use ecan_protocol::mapping::SyncManagerLayout;
use ecan_protocol::text::Printable;
use ecan_service::client::ClientError;
use ecan_tool_support::command_line::new_file;
use ecan_tool_support::diagnosis::{Depth, ReadError, Snapshot};
use serde::{Deserialize, Serialize};

use crate::bus::serial_number;
use crate::commands::doctor::{Check, Root};
use crate::config_file;
use crate::context::{Bus, Context, Failure, Result, note, open};
use crate::ethercat_tool::EthercatTool;
use crate::frames::ServiceEvents;
use crate::program;
use crate::service_access::ServiceConnection;
use crate::slave_choice::Recognised;

/// Longest time for the kernel log.
const LOG_LIMIT: Duration = Duration::from_secs(5);
const FORMAT: &str = "ecan-diagnosis";
const VERSION: u32 = 2;

#[derive(Debug, Args)]
pub struct RecordArguments {
    /// Write a support bundle with all that can be read, also after a failure
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Configuration file for the bundle [default: /etc/ecan/master<N>.toml]
    #[arg(long, value_name = "FILE", requires = "record")]
    config: Option<PathBuf>,
}

/// What a command has read for a bundle.
pub struct Evidence<'a> {
    pub bus: Option<&'a Bus>,
    /// Results of `ecan doctor`.
    pub checks: &'a [Check],
    pub gateways: Vec<Gateway>,
    /// Failure that does not end the command.
    pub failure: Option<String>,
}

impl RecordArguments {
    pub fn is_requested(&self) -> bool {
        self.record.is_some()
    }

    /// Writes a bundle if one is requested, also after a failure, and names it last.
    pub fn save(&self, mut evidence: Evidence<'_>, result: Result, context: &Context) -> Result {
        let Some(path) = &self.record else { return result };
        let failure =
            result.as_ref().err().filter(|failure| !matches!(failure, Failure::ProblemsFound));
        let is_failed = failure.is_some();
        evidence.failure = failure.map(ToString::to_string).or(evidence.failure);
        let saved = Bundle::gather(evidence, self.config.as_deref(), context).save(path);
        match (saved, result) {
            (Ok(()), Err(Failure::ReaderGone)) => Err(Failure::ReaderGone),
            (Ok(()), Err(failure)) => {
                Err(Failure::Recorded { failure: Box::new(failure), path: path.clone() })
            }
            (Ok(()), Ok(())) => {
                note(format_args!("written to {}", Printable(path.display())));
                Ok(())
            }
            (Err(unsaved), result) if is_failed => {
                note(format_args!("{unsaved}"));
                result
            }
            (unsaved, _) => unsaved,
        }
    }
}

/// What could be gathered: with a failure, everything up to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bundle {
    format: String,
    version: u32,
    program: String,
    /// Time in seconds since 1970, UTC.
    taken_s: u64,
    /// Error of the command that wrote the bundle.
    pub failure: Option<String>,
    host: Host,
    /// `None` if it could not be reached.
    master: Option<Master>,
    /// State and counters of the service, if the command used one.
    service: Option<serde_json::Value>,
    pub gateways: Vec<Gateway>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Host {
    kernel: String,
    system: String,
    cpus: usize,
    /// `None` if it could not be loaded.
    library: Option<String>,
    module: Option<String>,
    is_simulated: bool,
    /// Results of `ecan doctor`.
    checks: serde_json::Value,
    /// Last lines of the master in the kernel log, or why there is none.
    kernel_log: Vec<String>,
    /// The named configuration file, or why it is not there; otherwise that of the service of this master.
    configuration: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Master {
    index: u32,
    link_up: bool,
    slaves_responding: u32,
    slaves: Vec<Slave>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Slave {
    position: u16,
    alias: u16,
    name: String,
    vendor_id: u32,
    product_code: u32,
    revision: u32,
    al_state: u8,
    has_error_flag: bool,
    sync_managers: u8,
    /// Link state of the ports 0 to 3.
    links: [bool; 4],
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gateway {
    pub name: String,
    /// 0x100A and 0x1009; `None` if not read.
    pub firmware: Option<String>,
    pub hardware: Option<String>,
    pub serial: Option<u64>,
    pub snapshot: Snapshot,
}

impl Bundle {
    /// Gathers the state of the host, the master and the service, with what a command has read.
    pub fn gather(
        Evidence { bus, checks, gateways, failure }: Evidence<'_>,
        config: Option<&Path>,
        context: &Context,
    ) -> Self {
        let since_1970 = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        let master_index = context.global.master();
        let configuration = match config {
            Some(path) => {
                let text = config_file::read_input_text(path);
                Some(text.unwrap_or_else(|error| error.to_string()))
            }
            None => Root::default().text(format!("etc/ecan/master{master_index}.toml")),
        };
        Self {
            format: FORMAT.to_owned(),
            version: VERSION,
            program: format!("ecan {}", env!("CARGO_PKG_VERSION")),
            taken_s: since_1970.map_or(0, |time| time.as_secs()),
            failure,
            host: host(bus, checks, configuration),
            master: bus.and_then(master),
            service: connection(bus, context).as_ref().map(service),
            gateways,
        }
    }

    /// Events of the service.
    pub fn service_events(&self) -> Option<ServiceEvents> {
        let of_service = |name| self.service.as_ref()?.get(name).cloned();
        let hello = serde_json::from_value(of_service("hello")?).ok()?;
        Some(ServiceEvents::new(hello, serde_json::from_value(of_service("events")?).ok()?))
    }

    pub fn save(&self, path: &Path) -> Result {
        let mut text = serde_json::to_string_pretty(self)
            .map_err(|error| Failure::file("write", path, error))?;
        text.push('\n');
        new_file::write(path, text).map_err(|error| Failure::file("write", path, error))
    }

    pub fn load(path: &Path) -> Result<Self> {
        let text = config_file::read_input_text(path)?;
        let wrong = |reason: String| Failure::file("understand", path, reason);
        // Check format and version first: this gives a better message than the first missing field.
        let value: serde_json::Value =
            serde_json::from_str(&text).map_err(|error| wrong(format!("invalid JSON: {error}")))?;
        // The report of a probe contains a bundle.
        let value = value.get("diagnosis").cloned().unwrap_or(value);
        if value["format"] != FORMAT {
            return Err(wrong("not a bundle of `ecan diag --record`".to_owned()));
        }
        if value["version"] != VERSION {
            let version = &value["version"];
            return Err(wrong(format!(
                "bundle version {version} is not supported; supported: {VERSION}"
            )));
        }
        serde_json::from_value(value).map_err(|error| wrong(error.to_string()))
    }
}

/// The service of a bus; a bus that could not be opened may have one all the same.
pub fn connection(bus: Option<&Bus>, context: &Context) -> Option<ServiceConnection> {
    match bus {
        Some(bus) => bus.service().cloned(),
        None => open(context.global, context.global.master()).ok().flatten(),
    }
}

/// Selects the slaves, with two differences to other commands: the only slave of a bus is read even
/// if it is not identified as a gateway, and `--all` includes slaves that cannot be identified.
pub fn selected_slaves(bus: &Bus, all: bool) -> Result<Vec<usize>> {
    match bus.one_or_all(all) {
        Err(Failure::Slave(_)) if !bus.is_chosen() && bus.diagnostics().slave_count() == 1 => {
            Ok(vec![0])
        }
        Err(failure) => Err(failure),
        Ok(Recognised { mut gateways, unknown }) => {
            gateways.extend(unknown.iter().map(|slave| slave.position));
            gateways.sort_unstable();
            Ok(gateways)
        }
    }
}

pub fn read_gateway(
    bus: &Bus,
    slave: usize,
    depth: Depth,
    ethercat: Option<&Path>,
) -> Result<Gateway> {
    let info = bus.diagnostics().slave_info(slave)?;
    let has_mailbox =
        AlState::from_status(info.al_state.into()).is_some_and(|state| state.has_mailbox());
    let mut snapshot = if has_mailbox {
        Snapshot::read(depth, |key| bus.read(slave, key.index, key.subindex).map_err(read_error))
    } else {
        Snapshot::default()
    };
    snapshot.position = info.position;
    snapshot.al_state = info.al_state;
    snapshot.has_error_flag = info.error_flag;
    let register = |address, name| register(bus, slave, ethercat, address, name);
    snapshot.al_status_code = register(AL_STATUS_CODE, "AL status code");
    if snapshot.al_status_code.is_some() && snapshot.state() != Some(AlState::Op) {
        snapshot.sync_managers = sync_managers(|at| register(at, "SM2 and SM3"));
    }
    if snapshot.get(0x9011, SYNC0_COUNT).is_some_and(|pulses| pulses != 0) {
        let half = |address| register(address, "Sync0 period").map(u32::from);
        let [low, high] = [SYNC0_PERIOD, SYNC0_PERIOD + 2].map(half);
        snapshot.sync0_period_ns = low.zip(high).map(|(low, high)| low | high << 16);
    }
    // Each further request to a silent slave takes the mailbox timeout of the master.
    let answers = has_mailbox && snapshot.silence.is_none();
    let text = |index| if answers { bus.text(slave, index).ok() } else { None };
    Ok(Gateway {
        name: info.name,
        firmware: text(0x100A),
        hardware: text(0x1009),
        serial: serial_number(|subindex| snapshot.get(0xF000, subindex).ok_or(())).ok(),
        snapshot,
    })
}

fn read_error(failure: Failure) -> ReadError {
    match failure {
        Failure::Device(Error::Sdo { abort_code: Some(code), .. }) => {
            ReadError::Rejected(code.to_string())
        }
        other => ReadError::Silent(other.to_string()),
    }
}

/// SM2 and SM3 from their registers; `None` if one cannot be read.
fn sync_managers(
    mut register: impl FnMut(u16) -> Option<u16>,
) -> Option<[[u8; SyncManagerLayout::BYTES]; 2]> {
    let mut managers = [[0; SyncManagerLayout::BYTES]; 2];
    let words = managers.iter_mut().flat_map(|manager| manager.as_chunks_mut().0);
    for (word, address) in words.zip((SYNC_MANAGERS..).step_by(2)) {
        *word = register(address)?.to_le_bytes();
    }
    Some(managers)
}

/// AL status code register of the slave controller.
const AL_STATUS_CODE: u16 = 0x0134;
/// Registers of SM2 and SM3.
const SYNC_MANAGERS: u16 = 0x0810;
/// Sync0 period in nanoseconds, 32 bits.
const SYNC0_PERIOD: u16 = 0x09A0;
/// Number of Sync0 pulses in 0x9011.
const SYNC0_COUNT: u8 = 2;

/// Reads a register of 16 bits with IgH's tool: the library reads registers only for the owner of the
/// master. A simulated master has no tool unless one is given; an error of a given tool is
/// reported.
fn register(
    bus: &Bus,
    slave: usize,
    named: Option<&Path>,
    address: u16,
    name: &str,
) -> Option<u16> {
    if named.is_none() && bus.is_simulated() {
        return None;
    }
    let tool = EthercatTool::find(named, bus.master());
    match tool.and_then(|tool| tool.register(slave, address)) {
        Ok(code) => Some(code),
        Err(error) => {
            note(format_args!("{name} not read: {error}"));
            None
        }
    }
}

fn host(bus: Option<&Bus>, checks: &[Check], configuration: Option<String>) -> Host {
    let root = Root::default();
    let is_simulated = bus.is_some_and(Bus::is_simulated);
    Host {
        kernel: root.first_line("proc/version").unwrap_or_default(),
        system: system_name(&root),
        cpus: std::thread::available_parallelism().map_or(1, usize::from),
        library: bus.map(Bus::origin),
        module: root.first_line("sys/module/ec_master/version"),
        is_simulated,
        checks: serde_json::to_value(checks).unwrap_or_default(),
        kernel_log: if is_simulated { Vec::new() } else { kernel_log() },
        configuration,
    }
}

/// Last lines of the master in the kernel log. Its reading may not be permitted.
fn kernel_log() -> Vec<String> {
    const LINES: usize = 200;
    match program::run(&mut Command::new("dmesg"), LOG_LIMIT) {
        Ok(output) if output.status.success() => {
            let text = String::from_utf8_lossy(&output.stdout);
            let mut lines: Vec<_> =
                text.lines().rev().filter(|line| line.contains("EtherCAT")).take(LINES).collect();
            lines.reverse();
            lines.into_iter().map(str::to_owned).collect()
        }
        Ok(output) => vec![format!("dmesg: {}", String::from_utf8_lossy(&output.stderr).trim())],
        Err(error) => vec![format!("dmesg: {error}")],
    }
}

fn service(connection: &ServiceConnection) -> serde_json::Value {
    let client = connection.client();
    let text = |error: ClientError| serde_json::Value::from(error.to_string());
    let stats = client.service_stats().map_or_else(text, |stats| serde_json::json!(stats));
    let state = client.state().map_or_else(text, |state| serde_json::json!(state));
    let events = client.events().map_or_else(text, |events| serde_json::json!(events));
    let hello = connection.hello();
    serde_json::json!({ "hello": hello, "stats": stats, "state": state, "events": events })
}

/// PRETTY_NAME of /etc/os-release.
fn system_name(root: &Root) -> String {
    let text = root.text("etc/os-release").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("PRETTY_NAME="));
    line.unwrap_or_default().trim_matches('"').to_owned()
}

fn master(bus: &Bus) -> Option<Master> {
    let state = bus.diagnostics().master_state().ok()?;
    let slaves = bus.slaves().ok()?.into_iter().map(|info| Slave {
        position: info.position,
        alias: info.alias,
        name: info.name,
        vendor_id: info.vendor_id,
        product_code: info.product_code,
        revision: info.revision_number,
        al_state: info.al_state,
        has_error_flag: info.error_flag,
        sync_managers: info.sync_count,
        links: info.ports.map(|port| port.link_up),
    });
    Some(Master {
        index: bus.master(),
        link_up: state.link_up,
        slaves_responding: state.slaves_responding,
        slaves: slaves.collect(),
    })
}
