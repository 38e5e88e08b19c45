//! Errors of opening or reserving a master.

use std::fs;
use std::io::ErrorKind;
use std::os::fd::AsRawFd as _;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use ecrt_sys::{Ecrt, Errno};
use thiserror::Error;

use crate::real_time::join;

/// A master could not be opened or reserved. The text states the master, the cause and what to do.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("EtherCAT master {index} is not available: {failure}")]
pub struct OpenError {
    /// Number of the master.
    pub index: u32,
    /// The cause.
    pub failure: OpenFailure,
}

/// The cause of an [`OpenError`].
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum OpenFailure {
    /// There is no device node, and the kernel module is not loaded.
    #[error(
        "{} does not exist and the kernel module ec_master is not loaded; start the master \
         service (systemctl start ethercat, or ethercatctl start)",
        device.display()
    )]
    NotRunning {
        /// The device node.
        device: PathBuf,
    },
    /// The kernel module is loaded but has no such master.
    #[error(
        "{} does not exist although the kernel module ec_master is loaded ({}); choose a master \
         that exists, or add one to the master's configuration (MASTER{index}_DEVICE in \
         ethercat.conf) and restart the service",
        device.display(),
        present(masters)
    )]
    NoSuchMaster {
        /// The device node.
        device: PathBuf,
        /// Number of the master.
        index: u32,
        /// Numbers of the masters that exist.
        masters: Vec<u32>,
    },
    /// The simulation has no such master.
    #[error("the simulation has no master {index}; masters count from 0")]
    NotSimulated {
        /// Number of the master.
        index: u32,
    },
    /// The device node may not be opened for reading and writing.
    #[error(
        "{} may not be opened by this user{}; add the user to the node's group, or give the node \
         one with a udev rule (KERNEL==\"EtherCAT[0-9]*\", MODE=\"0660\", GROUP=\"ethercat\")",
        device.display(),
        owner.map_or_else(String::new, |owner| format!(" ({owner})"))
    )]
    NotPermitted {
        /// The device node.
        device: PathBuf,
        /// Owner of the node.
        owner: Option<NodeOwner>,
    },
    /// Another application has reserved the master.
    #[error(
        "another application has reserved it; end that one, or attach to the master that it \
         holds"
    )]
    Busy,
    /// The master has no network interface yet.
    #[error(
        "it still waits for its network interface; check that the interface named by \
         MASTER{index}_DEVICE in ethercat.conf exists and that its driver accepts it"
    )]
    WaitingForInterface {
        /// Number of the master.
        index: u32,
    },
    /// Library and kernel module do not belong together.
    #[error(
        "{} opens, but the library (version {}.{}) rejects the kernel module ({}{}): they are of \
         different versions; install both from one version and reload the module",
        device.display(),
        library.0,
        library.1,
        module.as_ref().map_or_else(|| "of unknown version".into(), |module| format!("version {module}")),
        interface.map_or_else(String::new, |interface| format!(", ioctl interface {interface}"))
    )]
    VersionMismatch {
        /// The device node.
        device: PathBuf,
        /// Release of the library, major and minor.
        library: (u8, u8),
        /// The module's version text.
        module: Option<String>,
        /// Number of the module's ioctl interface, which the library compares with its own (IgH 1.6.2:
        /// 37). Releases with the same major and minor number can differ in it.
        interface: Option<u32>,
    },
    /// Any other cause.
    #[error("{errno}; the kernel log may say more (dmesg | grep EtherCAT)")]
    Other {
        /// Error number of the library.
        errno: Errno,
    },
}

/// Owner, group and mode of a device node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeOwner {
    /// User id.
    pub user: u32,
    /// Group id.
    pub group: u32,
    /// Permission bits.
    pub mode: u32,
}

impl std::fmt::Display for NodeOwner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "owner {}, group {}, mode {:04o}", self.user, self.group, self.mode)
    }
}

fn present(masters: &[u32]) -> String {
    match masters {
        [] => "there is no master at all".into(),
        [one] => format!("there is master {one}"),
        many => format!("there are masters {}", join(many, ", ")),
    }
}

/// Paths of the system that show why a master does not open.
struct System<'a> {
    devices: &'a Path,
    /// The kernel's directory of the loaded module.
    module: &'a Path,
}

impl System<'_> {
    fn real() -> System<'static> {
        System { devices: Path::new("/dev"), module: Path::new("/sys/module/ec_master") }
    }

    fn device(&self, index: u32) -> PathBuf {
        self.devices.join(format!("EtherCAT{index}"))
    }

    fn masters(&self) -> Vec<u32> {
        let Ok(entries) = fs::read_dir(self.devices) else {
            return Vec::new();
        };
        let mut masters: Vec<u32> = entries
            .filter_map(|entry| {
                let name = entry.ok()?.file_name();
                name.to_str()?.strip_prefix("EtherCAT")?.parse().ok()
            })
            .collect();
        masters.sort_unstable();
        masters
    }

    fn module_version(&self) -> Option<String> {
        let text = fs::read_to_string(self.module.join("version")).ok()?;
        Some(text.trim().to_owned())
    }
}

impl OpenError {
    /// Returns whether the master may become available without a change by the application: another
    /// application has reserved it, or it waits for its network interface.
    pub fn is_temporary(&self) -> bool {
        matches!(self.failure, OpenFailure::Busy | OpenFailure::WaitingForInterface { .. })
    }

    /// Finds the cause of a NULL: by the error number of the library, and if that is
    /// not specific by checking the device node.
    ///
    /// The node is checked only now: if the library uses another one (RTDM), it opens all
    /// the same.
    pub(super) fn find_cause(index: u32, errno: Errno, ecrt: &Ecrt) -> Self {
        let failure = if ecrt.is_simulated() {
            simulated_failure(index, errno)
        } else {
            failure(index, errno, ecrt.version(), &System::real())
        };
        Self { index, failure }
    }
}

fn simulated_failure(index: u32, errno: Errno) -> OpenFailure {
    match errno {
        Errno::ENOENT | Errno::ENXIO => OpenFailure::NotSimulated { index },
        Errno::EBUSY => OpenFailure::Busy,
        Errno::ENODEV => OpenFailure::WaitingForInterface { index },
        errno => OpenFailure::Other { errno },
    }
}

fn failure(index: u32, errno: Errno, library: (u8, u8), system: &System<'_>) -> OpenFailure {
    let device = system.device(index);
    match errno {
        Errno::ENOENT | Errno::ENXIO => missing(index, device, system),
        Errno::EACCES | Errno::EPERM => not_permitted(device),
        Errno::EBUSY => OpenFailure::Busy,
        Errno::ENODEV if device.exists() => OpenFailure::WaitingForInterface { index },
        Errno::ENODEV => missing(index, device, system),
        errno => {
            let opened = fs::OpenOptions::new().read(true).write(true).open(&device);
            match (opened.map_err(|error| error.kind()), errno.code()) {
                (Err(ErrorKind::NotFound), _) => missing(index, device, system),
                (Err(ErrorKind::PermissionDenied), _) => not_permitted(device),
                // The library compares the module's interface version with its own and sets no
                // error number; a module that does not know the question answers ENOTTY; EBADF
                // is what its message leaves when stderr is closed.
                (Ok(node), 0 | libc::ENOTTY | libc::EBADF) => OpenFailure::VersionMismatch {
                    device,
                    library,
                    module: system.module_version(),
                    interface: module_interface(&node),
                },
                _ => OpenFailure::Other { errno },
            }
        }
    }
}

/// Asks the kernel module for the number of its ioctl interface (`EC_IOCTL_MODULE`).
fn module_interface(node: &fs::File) -> Option<u32> {
    /// `_IOR(0xa4, 0, ec_ioctl_module_t)`.
    const EC_IOCTL_MODULE: libc::Ioctl = 0x8008_A400_u32 as libc::Ioctl;
    /// `ec_ioctl_module_t`.
    #[repr(C)]
    #[derive(Default)]
    struct ModuleData {
        ioctl_version_magic: u32,
        master_count: u32,
    }
    let mut data = ModuleData::default();
    // SAFETY: the request writes at most the 8 bytes that its number states, and `data` has this size.
    let status = unsafe { libc::ioctl(node.as_raw_fd(), EC_IOCTL_MODULE, &raw mut data) };
    (status >= 0 && data.ioctl_version_magic != 0).then_some(data.ioctl_version_magic)
}

fn missing(index: u32, device: PathBuf, system: &System<'_>) -> OpenFailure {
    if system.module.exists() {
        OpenFailure::NoSuchMaster { device, index, masters: system.masters() }
    } else {
        OpenFailure::NotRunning { device }
    }
}

fn not_permitted(device: PathBuf) -> OpenFailure {
    let owner = fs::metadata(&device).ok().map(|metadata| NodeOwner {
        user: metadata.uid(),
        group: metadata.gid(),
        mode: metadata.mode() & 0o7777,
    });
    OpenFailure::NotPermitted { device, owner }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sandbox {
        _root: tempfile::TempDir,
        devices: PathBuf,
        module: PathBuf,
    }

    impl Sandbox {
        /// A machine with these device nodes, and the module loaded in this version.
        fn new(masters: &[u32], module_version: Option<&str>) -> Self {
            let root = tempfile::tempdir().unwrap();
            let devices = root.path().join("dev");
            let module = root.path().join("ec_master");
            fs::create_dir(&devices).unwrap();
            fs::write(devices.join("null"), "").unwrap();
            for index in masters {
                fs::write(devices.join(format!("EtherCAT{index}")), "").unwrap();
            }
            if let Some(version) = module_version {
                fs::create_dir(&module).unwrap();
                fs::write(module.join("version"), format!("{version}\n")).unwrap();
            }
            Self { _root: root, devices, module }
        }

        fn text(&self, index: u32, errno: Errno) -> String {
            let system = System { devices: &self.devices, module: &self.module };
            let failure = failure(index, errno, (1, 6), &system);
            OpenError { index, failure }.to_string()
        }
    }

    #[track_caller]
    fn says(text: &str, words: &[&str]) {
        for word in words {
            assert!(text.contains(word), "\"{word}\" is not in \"{text}\"");
        }
    }

    #[test]
    fn missing_service_error_says_how_to_start_it() {
        let text = Sandbox::new(&[], None).text(0, Errno::ENOENT);
        says(&text, &["EtherCAT master 0", "dev/EtherCAT0 does not exist"]);
        says(&text, &["ec_master is not loaded", "systemctl start ethercat"]);
    }

    #[test]
    fn missing_master_error_lists_existing_masters() {
        let text = Sandbox::new(&[0, 1], Some("1.6.2")).text(4, Errno::ENOENT);
        says(&text, &["EtherCAT4 does not exist", "masters 0, 1", "MASTER4_DEVICE"]);
    }

    #[test]
    fn permission_error_names_owner_and_udev_rule() {
        let text = Sandbox::new(&[0], Some("1.6.2")).text(0, Errno::EACCES);
        says(&text, &["may not be opened by this user (owner ", "mode 0"]);
        says(&text, &["udev rule", "GROUP=\"ethercat\""]);
    }

    #[test]
    fn reserved_master_is_busy() {
        let text = Sandbox::new(&[0], Some("1.6.2")).text(0, Errno::EBUSY);
        says(&text, &["another application has reserved it", "attach"]);
    }

    #[test]
    fn master_without_interface_waits() {
        let text = Sandbox::new(&[0], Some("1.6.2")).text(0, Errno::ENODEV);
        says(&text, &["waits for its network interface", "MASTER0_DEVICE"]);
    }

    #[test]
    fn failure_without_error_number_is_a_version_mismatch() {
        let machine = Sandbox::new(&[0], Some("1.5.2 master branch"));
        for errno in [0, libc::ENOTTY] {
            let text = machine.text(0, Errno::new(errno));
            says(&text, &["library (version 1.6)", "version 1.5.2 master branch"]);
            says(&text, &["install both from one version"]);
        }
        let text = Sandbox::new(&[0], None).text(0, Errno::new(0));
        says(&text, &["of unknown version"]);
    }

    #[test]
    fn missing_error_number_checks_the_device_node() {
        let text = Sandbox::new(&[], None).text(0, Errno::new(0));
        says(&text, &["EtherCAT0 does not exist"]);
    }

    #[test]
    fn other_error_keeps_the_text_of_the_system() {
        let text = Sandbox::new(&[0], Some("1.6.2")).text(0, Errno::EIO);
        says(&text, &["Input/output error", "kernel log"]);
    }

    #[test]
    fn simulated_failure_names_the_simulation() {
        let text = |errno| simulated_failure(3, errno).to_string();
        says(&text(Errno::ENOENT), &["the simulation has no master 3"]);
        says(&text(Errno::EBUSY), &["reserved"]);
        assert!(!text(Errno::new(0)).contains("/dev"));
    }
}
