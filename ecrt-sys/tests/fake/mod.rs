//! Builds the fake libethercat of `libethercat.c`, or any other shared object, with the C
//! compiler of the machine.
#![allow(dead_code)] // Each test program uses its part.

use std::path::{Path, PathBuf};
use std::process::Command;

use ecrt_sys::Ecrt;

/// The crate ecrt-sys, also from the tests of ecan-host.
const SOURCES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../ecrt-sys");

/// A shared object in a directory of its own.
pub struct Fake {
    directory: tempfile::TempDir,
}

impl Fake {
    /// The fake with these macros; `None` with a message without a C compiler.
    pub fn build(macros: &[&str]) -> Option<Self> {
        let source = Path::new(SOURCES).join("tests/fake/libethercat.c");
        Self::compile(&source, macros)
    }

    /// A shared object from this C text.
    pub fn from_text(text: &str) -> Option<Self> {
        let directory = tempfile::tempdir().unwrap();
        let source = directory.path().join("source.c");
        std::fs::write(&source, text).unwrap();
        Self::compile(&source, &[])
    }

    fn compile(source: &Path, macros: &[&str]) -> Option<Self> {
        let directory = tempfile::tempdir().unwrap();
        let fake = Self { directory };
        // Without optimisation: the garbage that a silent function leaves stays where it is.
        let output = Command::new("cc")
            .args(["-shared", "-fPIC", "-O0", "-Wall", "-Wextra", "-Werror", "-I"])
            .arg(SOURCES)
            .args(macros.iter().map(|name| format!("-D{name}")))
            .arg("-o")
            .arg(fake.path())
            .arg(source)
            .output();
        let Ok(output) = output else {
            println!("skipped: there is no C compiler (cc)");
            return None;
        };
        let messages = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "cc: {messages}");
        Some(fake)
    }

    /// Where the shared object is.
    pub fn path(&self) -> PathBuf {
        self.directory.path().join("libfake.so")
    }

    /// The fake, loaded.
    pub fn load(&self) -> Ecrt {
        Ecrt::load(Some(&self.path())).unwrap()
    }
}

/// The two releases as macros: 1.5.2, whose silent functions leave garbage, and 1.6.
pub const RELEASES: [&[&str]; 2] = [&["MAGIC=0x105", "SILENT", "OLD"], &["MAGIC=0x106"]];

#[track_caller]
pub fn assert_contains(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "\"{part}\" is not in \"{text}\"");
    }
}
