//! Result of a check, and the files of the examined system.

use std::path::{Path, PathBuf};

use serde::Serialize;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    Good,
    /// The cycle has more jitter than necessary.
    Warning,
    /// EtherCAT cannot work.
    Bad,
    Skipped,
}

impl Verdict {
    pub fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Warning => "warning",
            Self::Bad => "bad",
            Self::Skipped => "skipped",
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Check {
    pub name: &'static str,
    pub verdict: Verdict,
    pub found: String,
    /// Remedy; empty without a problem.
    pub remedy: String,
}

impl Check {
    pub fn good(found: impl Into<String>) -> Self {
        Self { name: "", verdict: Verdict::Good, found: found.into(), remedy: String::new() }
    }

    pub fn skipped(found: impl Into<String>) -> Self {
        Self { verdict: Verdict::Skipped, ..Self::good(found) }
    }

    pub fn warning(found: impl Into<String>, remedy: &str) -> Self {
        Self { verdict: Verdict::Warning, remedy: remedy.to_owned(), ..Self::good(found) }
    }

    pub fn bad(found: impl Into<String>, remedy: &str) -> Self {
        Self { verdict: Verdict::Bad, ..Self::warning(found, remedy) }
    }

    pub fn named(self, name: &'static str) -> Self {
        Self { name, ..self }
    }

    pub fn has_problem(&self) -> bool {
        matches!(self.verdict, Verdict::Warning | Verdict::Bad)
    }
}

const ETHTOOLS: [&str; 4] =
    ["/usr/sbin/ethtool", "/sbin/ethtool", "/usr/bin/ethtool", "/usr/local/sbin/ethtool"];

/// Directory with /proc, /sys, /dev and /etc of a host.
#[derive(Clone, Debug)]
pub struct Root {
    path: PathBuf,
    ethtool: Option<PathBuf>,
    /// Address of the network interface that the running master uses.
    main_device: Option<String>,
}

impl Default for Root {
    fn default() -> Self {
        let ethtool = ETHTOOLS.iter().map(PathBuf::from).find(|path| path.exists());
        Self { path: PathBuf::from("/"), ethtool, main_device: None }
    }
}

impl Root {
    /// Another file tree. Its programs are not run.
    pub fn at(path: PathBuf) -> Self {
        Self { path, ethtool: None, main_device: None }
    }

    pub fn with_ethtool(self, program: Option<PathBuf>) -> Self {
        Self { ethtool: program.or(self.ethtool), ..self }
    }

    /// Sets the address that IgH's tool reports for the running master.
    pub fn with_main_device(self, address: Option<String>) -> Self {
        Self { main_device: address, ..self }
    }

    pub fn main_device(&self) -> Option<&str> {
        self.main_device.as_deref()
    }

    pub fn ethtool(&self) -> Option<&Path> {
        self.ethtool.as_deref()
    }

    /// Path of a file, given without a leading slash.
    pub fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.path.join(name)
    }

    pub fn exists(&self, name: impl AsRef<Path>) -> bool {
        self.path(name).exists()
    }

    pub fn text(&self, name: impl AsRef<Path>) -> Option<String> {
        std::fs::read_to_string(self.path(name)).ok()
    }

    pub fn first_line(&self, name: impl AsRef<Path>) -> Option<String> {
        Some(self.text(name)?.lines().next().unwrap_or_default().trim().to_owned())
    }

    pub fn names(&self, directory: impl AsRef<Path>) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(directory)).into_iter().flatten().flatten();
        let mut names: Vec<_> =
            entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    /// Last component of the target of a link.
    pub fn link_name(&self, link: impl AsRef<Path>) -> Option<String> {
        let target = std::fs::read_link(self.path(link)).ok()?;
        Some(target.file_name()?.to_string_lossy().into_owned())
    }
}
