//! Building libraries and programs with `cc`, as a user does.

use std::ffi::OsStr;
use std::fs::DirEntry;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

/// The real library's soname.
pub const SONAME: &str = "libethercat.so.1";

/// This crate's directory.
pub const CRATE: &str = env!("CARGO_MANIFEST_DIR");

/// Returns true if a C compiler and the binary tools are present; else prints a message.
pub fn is_there() -> bool {
    let found = |tool: &str| Command::new(tool).arg("--version").output().is_ok();
    let missing: Vec<_> = ["cc", "nm", "readelf"].into_iter().filter(|tool| !found(tool)).collect();
    if !missing.is_empty() {
        println!("skipped: {} not found", missing.join(", "));
    }
    missing.is_empty()
}

/// Runs a command, which must succeed; returns its output.
pub fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}: {}", output_text(&output));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Output and exit status of a program.
pub fn output_text(output: &Output) -> String {
    format!(
        "{}\n{}{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

/// The static library of this crate that cargo has built last, beside this test.
fn static_library() -> PathBuf {
    let test = std::env::current_exe().expect("a test has a name");
    let folder = test.parent().expect("a program is in a folder");
    let files = std::fs::read_dir(folder).expect("its folder is readable").flatten();
    let is_library = |entry: &DirEntry| {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        name.starts_with("libethercat_sim-") && name.ends_with(".a")
    };
    let built = |entry: &DirEntry| entry.metadata().and_then(|metadata| metadata.modified()).ok();
    let newest = files.filter(is_library).max_by_key(built);
    newest.expect("cargo builds the library with its tests").path()
}

/// Creates a directory with the simulated library.
pub fn simulated_library() -> TempDir {
    let map = Path::new(CRATE).join("libethercat.map");
    let mut script = std::ffi::OsString::from("-Wl,--version-script=");
    script.push(map);
    link_simulated(Some(&script))
}

/// The same without symbol versions.
pub fn simulated_library_without_versions() -> TempDir {
    link_simulated(None)
}

fn link_simulated(version_script: Option<&OsStr>) -> TempDir {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let mut link = Command::new("cc");
    link.args(["-shared", "-Wl,-soname,libethercat.so.1", "-Wl,-z,defs", "-Wl,-z,nodelete"]);
    link.args(version_script);
    link.arg("-o").arg(directory.path().join(SONAME));
    link.args(["-Wl,--gc-sections", "-Wl,--whole-archive"]).arg(static_library());
    link.args(["-Wl,--no-whole-archive", "-lgcc_s", "-lpthread", "-lm", "-ldl", "-lc"]);
    run(&mut link);
    directory
}

/// Builds the plain C master against the library in a directory; returns the program.
pub fn plain_master(library: &TempDir) -> PathBuf {
    let tests = Path::new(CRATE).join("../tests");
    let program = library.path().join("plain_ecrt");
    let mut compile = Command::new("cc");
    compile.args(["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-o"]).arg(&program);
    compile.arg(tests.join("plain_ecrt.c")).arg(library.path().join(SONAME));
    run(&mut compile);
    program
}

/// Runs a program with the library of a directory, by `LD_LIBRARY_PATH`.
pub fn start(program: &Path, library: &TempDir, environment: &[(&str, &OsStr)]) -> Output {
    let mut command = Command::new(program);
    command.env_remove("ECAN_ECRT").env("LD_LIBRARY_PATH", library.path());
    // all symbols are bound at start, so that each missing version is reported
    command.env("LD_BIND_NOW", "1").envs(environment.iter().copied());
    command.output().unwrap_or_else(|error| panic!("{}: {error}", program.display()))
}
