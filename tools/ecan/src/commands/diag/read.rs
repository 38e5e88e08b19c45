//! Reads the values of a gateway, its master and the host.

use ecan_host::Error;
use ecan_protocol::device::AlState;
use ecan_protocol::mapping::SyncManagerLayout;
use ecan_tool_support::diagnosis::{Depth, ReadError, Snapshot};

use crate::commands::doctor;
use crate::context::{Bus, Context, Failure, GlobalOptions, Result, note};
use crate::ethercat_tool::EthercatTool;
use crate::firmware_version::serial_number;
use crate::slave_choice::Recognised;

use super::DiagArguments;
use super::bundle::{Bundle, Gateway, Host, Master, Slave};

/// Selects the slaves, with two differences to other commands: the only slave of a bus is read even
/// if it is not identified as a gateway, and `--all` includes slaves that cannot be identified.
pub(super) fn slaves(bus: &Bus, all: bool) -> Result<Vec<usize>> {
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

pub(super) fn bundle(
    bus: &Bus,
    slave: usize,
    arguments: &DiagArguments,
    context: &Context,
) -> Result<Bundle> {
    let info = bus.diagnostics().slave_info(slave)?;
    let depth = match arguments.record {
        Some(_) => Depth::Everything,
        None => Depth::Findings,
    };
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
    let register = |address, name| register(bus, slave, arguments, address, name);
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
    let gateway = Gateway {
        name: info.name,
        firmware: text(0x100A),
        hardware: text(0x1009),
        serial: serial_number(|subindex| snapshot.get(0xF000, subindex).ok_or(())).ok(),
    };
    Ok(Bundle::new(host(bus, context.global), master(bus)?, gateway, snapshot))
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
    arguments: &DiagArguments,
    address: u16,
    name: &str,
) -> Option<u16> {
    let named = arguments.ethercat.as_deref();
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

fn host(bus: &Bus, global: &GlobalOptions) -> Host {
    let root = doctor::Root::default();
    let checks = doctor::host_checks(&root, global.master());
    Host {
        kernel: root.first_line("proc/version").unwrap_or_default(),
        system: system_name(&root),
        cpus: std::thread::available_parallelism().map_or(1, usize::from),
        library: bus.origin(),
        module: root.first_line("sys/module/ec_master/version"),
        is_simulated: bus.is_simulated(),
        checks: serde_json::to_value(checks).unwrap_or_default(),
    }
}

/// PRETTY_NAME of /etc/os-release.
fn system_name(root: &doctor::Root) -> String {
    let text = root.text("etc/os-release").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("PRETTY_NAME="));
    line.unwrap_or_default().trim_matches('"').to_owned()
}

fn master(bus: &Bus) -> Result<Master> {
    let state = bus.diagnostics().master_state().map_err(Failure::master)?;
    let slaves = bus.slaves()?.into_iter().map(|info| Slave {
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
    Ok(Master {
        index: bus.master(),
        link_up: state.link_up,
        slaves_responding: state.slaves_responding,
        slaves: slaves.collect(),
    })
}
