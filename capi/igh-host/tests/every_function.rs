//! The C program that calls every function, with the archives of this build.

use std::path::{Path, PathBuf};
use std::process::Command;

#[test]
fn c_program_that_calls_every_function_succeeds() {
    let archives = archives();
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/every_function");
    let sources = files(&tests, |name| name.ends_with(".c"));
    let directory = tempfile::tempdir().unwrap();
    let program = directory.path().join("every_function");
    let built = Command::new("cc")
        .args(["-std=c99", "-I", concat!(env!("CARGO_MANIFEST_DIR"), "/../../include")])
        .args(sources)
        .args(archives)
        .args(["-lpthread", "-ldl", "-lm", "-o"])
        .arg(&program)
        .output()
        .expect("cc, which Rust needs, too");
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    let run = Command::new(&program).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

/// The libraries in the order of linking. Builds of older sources may be beside them.
fn archives() -> [PathBuf; 2] {
    let program = std::env::current_exe().unwrap();
    ["libecan_igh_host-", "libecan_mcan_host-"].map(|start| {
        let newest = files(program.parent().unwrap(), |name| {
            name.starts_with(start) && name.ends_with(".a")
        })
        .into_iter()
        .max_by_key(|path| path.metadata().unwrap().modified().unwrap());
        newest.unwrap_or_else(|| panic!("{start}*.a beside {}", program.display()))
    })
}

fn files(directory: &Path, is_chosen: impl Fn(&str) -> bool) -> Vec<PathBuf> {
    let entries = directory.read_dir().unwrap().map(|entry| entry.unwrap().path());
    entries
        .filter(|path| path.file_name().and_then(|name| name.to_str()).is_some_and(&is_chosen))
        .collect()
}
