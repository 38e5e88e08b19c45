//! Generates from the sources of `capi/`: the C headers in `include/`, the codes of the C++ header, the version
//! scripts of the libraries, and the test of NULL pointers. Checks that every exported function has a `@usage`.
//!
//! ```text
//! scripts/regenerate-headers.sh           writes the files
//! scripts/regenerate-headers.sh --check   reports stale or missing parts
//! ```

mod expand;
mod manifest;
mod null_calls;
mod render;
mod sources;
mod symbols;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;

/// Generate the C headers and what depends on them, and check exported functions.
#[derive(Debug, Parser)]
#[command(name = "ecan-headers", version)]
struct Arguments {
    /// Only report stale or missing parts.
    #[arg(long)]
    check: bool,
    /// Root of the repository.
    #[arg(long, value_name = "DIRECTORY", default_value = ".")]
    root: PathBuf,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(faults) if faults.is_empty() => ExitCode::SUCCESS,
        Ok(faults) => {
            for fault in faults {
                eprintln!("ecan-headers: {fault}");
            }
            ExitCode::FAILURE
        }
        Err(error) => {
            eprintln!("ecan-headers: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<Vec<String>, String> {
    let root = &arguments.root;
    let mut faults = Vec::new();
    let mut files = Vec::new();
    for header in manifest::HEADERS {
        files.push((root.join("include").join(header.name), render::header(root, header)?));
    }
    for library in manifest::LIBRARIES {
        let path = root.join(format!("capi/lib{}.map", library.name));
        files.push((path, symbols::version_script(root, library)?));
    }
    files.push((root.join(render::CPP_HEADER), render::cpp_header(root)?));
    let path = root.join("capi/tests/every_function/null_pointers.c");
    files.push((path, null_calls::test(root)?));
    for (path, text) in files {
        if read(&path).is_ok_and(|found| found == text) {
            continue;
        }
        if arguments.check {
            faults.push(format!(
                "{} is stale: run scripts/regenerate-headers.sh and commit it",
                path.display()
            ));
        } else {
            std::fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))?;
            println!("{} written", path.display());
        }
    }
    sources::audit(root, &mut faults)?;
    Ok(faults)
}

fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
}
