//! Faults of a master that every program reports with the same text.
#![allow(dead_code, missing_docs)]

use std::path::{Path, PathBuf};
use std::process::Command;

/// Fake of a libethercat, of `ecrt-sys`, whose masters fail by their numbers, and of a device node.
pub struct FakeMaster(tempfile::TempDir);

impl FakeMaster {
    /// `None` without a C compiler, with a message.
    pub fn build(sources: &Path) -> Option<Self> {
        let fake = Self(tempfile::tempdir().unwrap());
        for (file, library) in [("libethercat.c", fake.library()), ("device.c", fake.device())] {
            let compiled = Command::new("cc")
                .args(["-shared", "-fPIC", "-I"])
                .arg(sources)
                .arg("-o")
                .arg(library)
                .arg(sources.join("tests/fake").join(file))
                .arg("-ldl")
                .status();
            let Ok(compiled) = compiled else {
                println!("skipped: there is no C compiler (cc)");
                return None;
            };
            assert!(compiled.success());
        }
        Some(fake)
    }

    pub fn library(&self) -> PathBuf {
        self.0.path().join("libethercat.so")
    }

    /// To be preloaded.
    pub fn device(&self) -> PathBuf {
        self.0.path().join("libdevice.so")
    }
}

/// A fault, the arguments with which a program meets it, and the text of its report.
pub struct MasterFault {
    pub arguments: Vec<String>,
    pub text: &'static str,
}

/// Faults of library, kernel module, device node, cable and bus. Their scenarios are in `directory`.
pub fn master_faults(fake: &FakeMaster, directory: &Path) -> Vec<MasterFault> {
    let library = fake.library().display().to_string();
    let of_master = |master: &str, text| MasterFault {
        arguments: ["--ecrt", &library, "--master", master].map(str::to_owned).to_vec(),
        text,
    };
    let of_scenario = |name: &str, scenario: &str, text| {
        let path = directory.join(name).with_extension("toml");
        std::fs::write(&path, scenario).unwrap();
        let setting = format!("sim:{}", path.display());
        MasterFault { arguments: vec!["--ecrt".to_owned(), setting], text }
    };
    let absent = ["--ecrt", "/no/such/libethercat.so"].map(str::to_owned).to_vec();
    vec![
        MasterFault {
            arguments: absent,
            text: "the EtherCAT master library /no/such/libethercat.so was not found",
        },
        of_master("101", "EtherCAT master 101 is not available: /dev/EtherCAT101 does not exist"),
        of_master(
            "102",
            "EtherCAT master 102 is not available: /dev/EtherCAT102 may not be opened by this user",
        ),
        of_master(
            "104",
            "EtherCAT master 104 is not available: /dev/EtherCAT104 opens, but the library (version 1.6) \
             rejects the kernel module (",
        ),
        of_master(
            "104",
            "ioctl interface 39): they are of different versions; install both from one",
        ),
        of_master("105", "EtherCAT master 105 is not available: "),
        of_scenario("no_slave", "", "no slave responds on the bus; check supply and cabling"),
    ]
}

/// Runs a program with each fault. It fails, and names the fault once.
pub fn check_reports(sources: &Path, command: impl Fn() -> Command) {
    let Some(fake) = FakeMaster::build(sources) else { return };
    let directory = tempfile::tempdir().unwrap();
    for MasterFault { arguments, text } in master_faults(&fake, directory.path()) {
        let mut command = command();
        command.args(&arguments).env_remove("ECAN_ECRT").env("LD_PRELOAD", fake.device());
        let output = command.output().unwrap();
        let report = [output.stdout, output.stderr].concat();
        let report = String::from_utf8_lossy(&report);
        assert!(!output.status.success(), "{arguments:?} succeeded");
        assert_eq!(report.matches(text).count(), 1, "{arguments:?}: {report}");
    }
}
