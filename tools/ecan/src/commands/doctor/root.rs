//! Files of a host below a root directory.

use std::path::{Path, PathBuf};

/// Where ethtool may be on this host.
const ETHTOOLS: [&str; 4] =
    ["/usr/sbin/ethtool", "/sbin/ethtool", "/usr/bin/ethtool", "/usr/local/sbin/ethtool"];

/// Where the host's /proc, /sys, /dev and /etc are.
#[derive(Clone, Debug)]
pub struct Root {
    path: PathBuf,
    ethtool: Option<PathBuf>,
}

impl Default for Root {
    /// This host.
    fn default() -> Self {
        let ethtool = ETHTOOLS.iter().map(PathBuf::from).find(|path| path.exists());
        Self { path: PathBuf::from("/"), ethtool }
    }
}

impl Root {
    /// Another tree of files. No program of that tree is run.
    pub fn at(path: PathBuf) -> Self {
        Self { path, ethtool: None }
    }

    /// The same, with this ethtool.
    pub fn with_ethtool(self, program: Option<PathBuf>) -> Self {
        Self { ethtool: program.or(self.ethtool), path: self.path }
    }

    /// The program that tells how an interface coalesces interrupts.
    pub fn ethtool(&self) -> Option<&Path> {
        self.ethtool.as_deref()
    }

    /// The path of a file that is named without a slash in front.
    pub fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.path.join(name)
    }

    pub fn exists(&self, name: impl AsRef<Path>) -> bool {
        self.path(name).exists()
    }

    /// A file's text; none where it cannot be read.
    pub fn text(&self, name: impl AsRef<Path>) -> Option<String> {
        std::fs::read_to_string(self.path(name)).ok()
    }

    /// The first line of a file, without blanks around it.
    pub fn first_line(&self, name: impl AsRef<Path>) -> Option<String> {
        Some(self.text(name)?.lines().next().unwrap_or_default().trim().to_owned())
    }

    /// The names in a directory, sorted.
    pub fn names(&self, directory: impl AsRef<Path>) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(directory)).into_iter().flatten().flatten();
        let mut names: Vec<_> =
            entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    /// The last part of what a link points at.
    pub fn link_name(&self, link: impl AsRef<Path>) -> Option<String> {
        let target = std::fs::read_link(self.path(link)).ok()?;
        Some(target.file_name()?.to_string_lossy().into_owned())
    }
}
