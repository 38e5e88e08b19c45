//! Checks of the master: kernel modules, device node, library.

use std::fs::OpenOptions;
use std::io::ErrorKind;

use ecan_host::{Error, OpenError, OpenFailure};
use ecan_sim::{Backend, BackendError, ClockKind};

use super::{Check, Root};
use crate::context::{Context, Result};

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
            "run scripts/setup_host.sh apply for a group by a udev rule; then join the group and \
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
