//! Checks of the master (kernel modules, device node, library) and of its gateways: N against the limit of the
//! master, and SM2 and SM3 in the SII (manual 15.7).

use std::fs::OpenOptions;
use std::io::ErrorKind;
use std::path::Path;

use ecan_host::{Diagnostics, Error, MAX_PLAIN_MULTIPLIER, OpenError, OpenFailure};
use ecan_protocol::mapping::{Direction, SyncManagerLayout};
use ecan_sim::{Backend, BackendError, ClockKind, Simulation};

use super::{Check, Root};
use crate::context::{Context, Result};
use crate::ethercat_tool::{EthercatTool, ToolError};
use crate::slave_choice::{Recognised, Unknown};

const BUS: &str = "bus";

/// The checks of the bus, `None` without a library; `tool` is the path of IgH's tool, if given.
pub(super) fn checks(
    bus: Option<Result<Diagnostics, Error>>,
    simulation: Option<&Simulation>,
    tool: Option<&Path>,
    master: u32,
) -> Vec<Check> {
    let diagnostics = match bus {
        None => return vec![Check::skipped("no library").named(BUS)],
        Some(Ok(diagnostics)) => diagnostics,
        Some(Err(error)) => return vec![unreadable(&error).named(BUS)],
    };
    if let Err(error) = diagnostics.require_slaves() {
        return vec![unreadable(&error).named(BUS)];
    }
    let Recognised { gateways, unknown } =
        Recognised::new(diagnostics.slave_kinds().into_iter().enumerate());
    let slaves = check_slaves(diagnostics.slave_count(), gateways.len(), &unknown).named(BUS);
    let process_data = |slave: &usize| process_data(&diagnostics, *slave).named("process data");
    let layout = |slave: &usize| {
        if let Some(simulation) = simulation {
            return check_layout(*slave, Ok(simulated_sii(simulation, *slave)));
        }
        let tool = EthercatTool::find(tool, master);
        check_layout(*slave, tool.and_then(|tool| tool.sii(*slave)))
    };
    let layouts = gateways.iter().map(|slave| layout(slave).named("SII layout"));
    [slaves].into_iter().chain(gateways.iter().map(process_data)).chain(layouts).collect()
}

fn unreadable(error: &Error) -> Check {
    Check::bad(error.to_string(), "fix the problems above, then run `ecan scan`")
}

fn check_slaves(count: usize, gateways: usize, unknown: &[Unknown]) -> Check {
    let slaves = if count == 1 { "slave" } else { "slaves" };
    let found = format!("{count} {slaves}, {gateways} ECAN-Lite");
    if !unknown.is_empty() {
        let unknown: Vec<_> = unknown.iter().map(ToString::to_string).collect();
        return Check::bad(
            format!("{found}; {}", unknown.join("; ")),
            "bring it to PREOP, check its supply and cable, then run `ecan diag --slave POSITION`; \
             a gateway without a mailbox takes no configuration",
        );
    }
    if gateways == 0 {
        return Check::bad(found, "check cable and supply, then run `ecan scan`");
    }
    Check::good(found)
}

/// Larger N of both directions, from the active or else the requested profile.
fn chunks(diagnostics: &Diagnostics, slave: usize) -> Result<(u32, bool), Error> {
    let value = |index, subindex| diagnostics.sdo_upload_u32(slave, index, subindex);
    let active = value(0x8010, 9)?.max(value(0x8011, 9)?) / 128;
    if active != 0 {
        return Ok((active, true));
    }
    Ok((value(0x8010, 3)?.max(value(0x8011, 3)?), false))
}

fn process_data(diagnostics: &Diagnostics, slave: usize) -> Check {
    match chunks(diagnostics, slave) {
        Ok((n, is_active)) => check_chunks(slave, n, is_active),
        Err(error) => unreadable(&error),
    }
}

/// Bytes of the EEPROM. All slaves of a new simulation are at their positions.
fn simulated_sii(simulation: &Simulation, slave: usize) -> Vec<u8> {
    simulation.with_world(|world| {
        let gateway = world.gateway_at(slave).and_then(|index| world.gateway(index));
        let words = gateway.map_or(&[][..], |gateway| gateway.eeprom());
        words.iter().flat_map(|word| word.to_le_bytes()).collect()
    })
}

/// Check of the SII with IgH's tool: the library does not read it.
fn check_layout(slave: usize, sii: Result<Vec<u8>, ToolError>) -> Check {
    let script = format!("ecan_sii_sm_layout.sh check --position {slave}");
    let sii = match sii {
        Ok(sii) => sii,
        Err(error) => return Check::skipped(format!("slave {slave}: {error}; see {script}")),
    };
    let faults = faults(&sii);
    if faults.is_empty() {
        return Check::good(format!(
            "slave {slave}: SM2 and SM3 match manual 15.7, as of the master's last scan"
        ));
    }
    Check::bad(
        format!("slave {slave}: {}", faults.join(", ")),
        &format!(
            "{script}, then fix, then power-cycle the gateway (manual 15.7, 16.1): otherwise it stays in \
             PREOP with AL status code 0x001D or 0x001E"
        ),
    )
}

fn check_chunks(slave: usize, n: u32, is_active: bool) -> Check {
    let word = if is_active { "active" } else { "requested" };
    let max = u32::from(MAX_PLAIN_MULTIPLIER);
    let found = format!("slave {slave}: N = {n} {word}, a standard master supports {max}");
    if n <= max {
        return Check::good(found);
    }
    Check::warning(
        found,
        "use a smaller N, or a master that splits process data over datagrams; an older one \
         stops sending altogether",
    )
}

const EXPECTED: [(&str, Direction); 2] = [("SM2", Direction::RxPdo), ("SM3", Direction::TxPdo)];

const CATEGORY: u16 = 41;

/// Returns the deviations; empty if the layout is correct.
pub(super) fn faults(sii: &[u8]) -> Vec<String> {
    let Some(managers) = category(sii) else {
        return vec!["the SII has no category 41 (sync managers)".to_owned()];
    };
    let (managers, _) = managers.as_chunks();
    let found = managers.iter().skip(2).copied().map(SyncManagerLayout::from_bytes);
    let mut found = found.map(Some).chain(std::iter::repeat(None));
    let fault = |(name, direction): (&str, Direction)| {
        let required = SyncManagerLayout::required(direction);
        match found.next().flatten() {
            None => Some(format!("{name} is missing")),
            Some(found) if found == required => None,
            Some(found) => Some(format!("{name} has {found} instead of {required}")),
        }
    };
    EXPECTED.into_iter().filter_map(fault).collect()
}

/// Bytes of the category of the sync managers. Categories start at word 0x40, each with type and
/// length in words.
fn category(sii: &[u8]) -> Option<&[u8]> {
    let mut rest = sii.get(2 * 0x40..)?;
    while let [k0, k1, l0, l1, after @ ..] = rest {
        let length = 2 * usize::from(u16::from_le_bytes([*l0, *l1]));
        if u16::from_le_bytes([*k0, *k1]) == CATEGORY {
            return after.get(..length);
        }
        rest = after.get(length..)?;
    }
    None
}

const MASTER: &str = "ec_master";
/// Module of the ACPI embedded controller, with a similar name.
const ACPI: &str = "ec_sys";
const GENERIC: &str = "ec_generic";

pub(super) fn kernel_module(root: &Root) -> Check {
    if !root.exists("sys/module/ec_master") {
        return missing_module(root);
    }
    match root.first_line("sys/module/ec_master/version") {
        Some(version) => Check::good(format!("ec_master {version}")),
        None => Check::good("ec_master, version unknown"),
    }
}

/// States why the module is not loaded, from the files of the host.
fn missing_module(root: &Root) -> Check {
    if let Some(release) = kernel_without_module(root) {
        return Check::bad(
            format!("ec_master is not installed for the kernel {release}"),
            "build IgH's modules for this kernel: make modules, make modules_install, depmod; \
             or boot the kernel that they were built for",
        );
    }
    if requires_signatures(root) {
        return Check::bad(
            "ec_master is not loaded, and the kernel loads signed modules only",
            "sign ec_master.ko and the driver's module with an enrolled key (mokutil --import), \
             then start the master; or switch Secure Boot off",
        );
    }
    Check::bad(
        "ec_master is not loaded",
        "systemctl enable --now ethercat (or ethercatctl start); after a kernel update rebuild \
         the modules",
    )
}

/// Returns the release of the running kernel if no ec_master is installed for it.
fn kernel_without_module(root: &Root) -> Option<String> {
    let release = root.first_line("proc/sys/kernel/osrelease")?;
    let installed = root.text(format!("lib/modules/{release}/modules.dep"))?;
    (!installed.contains("/ec_master.ko")).then_some(release)
}

/// Secure Boot locks the kernel down; `module.sig_enforce` has the same effect on modules.
fn requires_signatures(root: &Root) -> bool {
    let lockdown = root.first_line("sys/kernel/security/lockdown").unwrap_or_default();
    ["[integrity]", "[confidentiality]"].iter().any(|mode| lockdown.contains(mode))
        || root.first_line("sys/module/module/parameters/sig_enforce").as_deref() == Some("Y")
}

/// Modules of the master for network interfaces.
fn drivers(root: &Root) -> Vec<String> {
    let modules = root.names("sys/module");
    let is_driver =
        |name: &String| name.starts_with("ec_") && ![MASTER, ACPI].contains(&name.as_str());
    modules.into_iter().filter(is_driver).collect()
}

pub(super) fn has_native_driver(root: &Root) -> bool {
    drivers(root).iter().any(|name| name != GENERIC)
}

pub(super) fn network_driver(root: &Root) -> Check {
    let drivers = drivers(root);
    if drivers.is_empty() {
        return Check::bad(
            "no network driver of the master is loaded",
            "set DEVICE_MODULES in /etc/ethercat.conf, to generic or to the native driver of the \
             interface, and restart the master",
        );
    }
    let kind = match drivers.iter().any(|name| name != GENERIC) {
        true => "native",
        false => "generic: frames pass the network stack; a native driver has less jitter",
    };
    Check::good(format!("{} ({kind})", drivers.join(", ")))
}

pub(super) fn device_node(root: &Root, master: u32) -> Check {
    let node = format!("/dev/EtherCAT{master}");
    let path = root.path(node.trim_start_matches('/'));
    match OpenOptions::new().read(true).write(true).open(path) {
        Ok(_) => Check::good(format!("{node} can be opened")),
        Err(error) => check_opening(&node, error.kind(), &error.to_string()),
    }
}

fn check_opening(node: &str, kind: ErrorKind, reason: &str) -> Check {
    match kind {
        ErrorKind::NotFound => Check::bad(
            format!("{node} does not exist"),
            "load the module; select an existing master (--master); in a container, pass the \
             device in",
        ),
        ErrorKind::PermissionDenied => Check::bad(
            format!("no permission for {node}"),
            "run setup_host.sh apply for a group by a udev rule; then join the group and \
             log in again",
        ),
        _ => Check::bad(
            format!("{node} cannot be opened: {reason}"),
            "read the kernel log (dmesg | grep EtherCAT)",
        ),
    }
}

/// Loads the library. An invalid setting is an error of the program, not a result.
pub(super) fn load(context: &Context) -> Result<Result<Backend, String>> {
    match context.backend(&context.setting()?, ClockKind::Stepped) {
        Ok(backend) => Ok(Ok(backend)),
        Err(BackendError::Load(error)) => Ok(Err(error.to_string())),
        Err(other) => Err(other.into()),
    }
}

pub(super) fn check(library: &Result<Backend, String>) -> Check {
    match library {
        Ok(Backend { ecrt, .. }) => {
            let (major, minor) = ecrt.version();
            if let Some(warning) = ecrt.release_warning() {
                return Check::warning(
                    warning,
                    "use a tested release, or test the machine with it",
                );
            }
            Check::good(format!("{}, version {major}.{minor}", ecrt.origin()))
        }
        Err(error) if cfg!(all(target_env = "musl", target_feature = "crt-static")) => {
            Check::bad(error, "install the Debian package of ecan, or use a service (--via)")
        }
        Err(error) => Check::bad(
            error,
            "install the IgH EtherCAT master's library (make install, then ldconfig), or name it \
             with --ecrt",
        ),
    }
}

/// Library and kernel module must have the same version. `failure`: the error of opening the master,
/// because releases with equal numbers may have different interfaces, which the library compares.
pub(super) fn same_version(root: &Root, library: (u8, u8), failure: Option<&Error>) -> Check {
    const REMEDY: &str = "install both from one version, and reload the module";
    let (major, minor) = library;
    if let Some(Error::Open(OpenError { failure, .. })) = failure
        && matches!(failure, OpenFailure::VersionMismatch { .. })
    {
        return Check::bad(failure.to_string(), REMEDY);
    }
    let Some(module) = root.first_line("sys/module/ec_master/version") else {
        return Check::skipped("module version unknown");
    };
    let found = format!("library {major}.{minor}, module {module}");
    let mut parts = module.split(['.', ' ', '-']).map(|part| part.parse::<u8>().ok());
    if [parts.next(), parts.next()] == [Some(Some(major)), Some(Some(minor))] {
        return Check::good(found);
    }
    Check::bad(found, REMEDY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unreadable_sii_refers_to_the_script() {
        let check = check_layout(3, Err(ToolError::NotFound));
        assert!(!check.has_problem());
        assert!(check.found.ends_with("see ecan_sii_sm_layout.sh check --position 3"));
        let check = check_layout(1, Ok(Vec::new()));
        assert_eq!(check.found, "slave 1: the SII has no category 41 (sync managers)");
        assert!(check.has_problem());
    }

    #[test]
    fn multiplier_is_compared_with_master_limit() {
        assert!(!check_chunks(0, 11, true).has_problem());
        let large = check_chunks(2, 12, false);
        assert_eq!(large.found, "slave 2: N = 12 requested, a standard master supports 11");
        assert!(large.has_problem());
    }

    fn image(categories: &[u16]) -> Vec<u8> {
        let head = std::iter::repeat_n(0, 0x40).chain(categories.iter().copied());
        head.flat_map(u16::to_le_bytes).collect()
    }

    const GOOD: [u16; 22] = [
        30, 1, 7, // Another category before it.
        41, 16, //
        0x1000, 128, 0x26, 0x0101, //
        0x1080, 128, 0x22, 0x0201, //
        0x1100, 3072, 0x66, 0x0301, //
        0x1D00, 3072, 0x22, 0x0401, //
        0xFFFF,
    ];

    #[test]
    fn layout_of_the_manual_has_no_fault() {
        assert_eq!(faults(&image(&GOOD)), [""; 0]);
    }

    #[test]
    fn each_fault_is_named() {
        let changed = |changes: &[(usize, u16)]| {
            let mut words = GOOD;
            changes.iter().for_each(|(at, value)| words[*at] = *value);
            faults(&image(&words))
        };
        let sm2 = "instead of start 0x1100, 3072 bytes, control byte 0x66";
        let sm3 = "instead of start 0x1D00, 3072 bytes, control byte 0x22";
        assert_eq!(
            changed(&[(13, 0x1180)]),
            [format!("SM2 has start 0x1180, 3072 bytes, control byte 0x66 {sm2}")]
        );
        assert_eq!(
            changed(&[(18, 1024)]),
            [format!("SM3 has start 0x1D00, 1024 bytes, control byte 0x22 {sm3}")]
        );
        assert_eq!(
            changed(&[(15, 0x64), (19, 0x20)]),
            [
                format!("SM2 has start 0x1100, 3072 bytes, control byte 0x64 {sm2}"),
                format!("SM3 has start 0x1D00, 3072 bytes, control byte 0x20 {sm3}"),
            ]
        );
        assert_eq!(changed(&[(4, 8)]), ["SM2 is missing", "SM3 is missing"]);
        assert_eq!(changed(&[(4, 12)]), ["SM3 is missing"]);
        let none = ["the SII has no category 41 (sync managers)"];
        assert_eq!(changed(&[(3, 42)]), none);
        assert_eq!(changed(&[(4, 0x7FFF)]), none);
        assert_eq!(faults(b"abc"), none);
    }

    #[test]
    fn forbidden_and_missing_node_differ() {
        let check = |kind| check_opening("/dev/EtherCAT0", kind, "reason");
        let forbidden = check(ErrorKind::PermissionDenied);
        assert_eq!(forbidden.found, "no permission for /dev/EtherCAT0");
        assert!(forbidden.remedy.contains("udev rule"));
        assert!(check(ErrorKind::NotFound).remedy.contains("load the module"));
        assert!(check(ErrorKind::Other).found.ends_with("reason"));
    }

    #[test]
    fn library_and_module_versions_are_compared() {
        let directory = tempfile::tempdir().unwrap();
        let root = Root::at(directory.path().to_owned());
        assert!(!same_version(&root, (1, 6), None).has_problem());
        let module = directory.path().join("sys/module/ec_master");
        std::fs::create_dir_all(&module).unwrap();
        std::fs::write(module.join("version"), "1.6.2 1.6.2-2-gabcdef\n").unwrap();
        assert!(!same_version(&root, (1, 6), None).has_problem());
        let other = same_version(&root, (1, 5), None);
        assert_eq!(other.found, "library 1.5, module 1.6.2 1.6.2-2-gabcdef");
        assert!(other.has_problem() && other.remedy.contains("from one version"));
    }
}
