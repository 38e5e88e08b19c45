//! The shared library as a linker and a loader see it.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use tempfile::TempDir;

use crate::toolchain::{CRATE, SONAME, output_text, plain_master, run, simulated_library, start};

/// Functions of libethercat 1.6.2 with their versions, one a line.
const EXPORTED: &str = include_str!("exported-symbols.txt");

/// Message of the loader for a library without the versions that a program needs.
const WARNING: &str = "no version information available";

fn committed() -> Vec<&'static str> {
    EXPORTED.lines().collect()
}

#[test]
fn committed_list_is_that_of_the_real_library() {
    let path = Path::new(CRATE).join("../../../shared/igh/libethercat-1.6.2-symbols.txt");
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("skipped: {} is not there", path.display());
        return;
    };
    let mut real: Vec<_> = text
        .lines()
        .filter_map(|line| line.split_whitespace().nth(2))
        .filter(|symbol| symbol.contains("@@"))
        .collect();
    real.sort_unstable();
    assert_eq!(committed(), real);
}

#[test]
fn soname_and_symbols_are_the_real_ones() {
    if !crate::toolchain::is_there() {
        return;
    }
    let library = simulated_library();
    let file = library.path().join(SONAME);
    let dynamic = run(Command::new("readelf").arg("-d").arg(&file));
    assert!(dynamic.contains("Library soname: [libethercat.so.1]"), "{dynamic}");
    assert!(dynamic.contains("NODELETE"), "{dynamic}");

    let symbols = run(Command::new("nm").args(["-D", "--defined-only"]).arg(&file));
    let (nodes, mut functions): (Vec<_>, Vec<_>) = symbols
        .lines()
        .filter_map(|line| line.split_once(' '))
        .partition(|(_, symbol)| symbol.starts_with("A "));
    let mut nodes: Vec<_> = nodes.into_iter().map(|(_, symbol)| symbol).collect();
    nodes.sort_unstable();
    let versions = ["A LIBETHERCAT_1.5.2", "A LIBETHERCAT_1.5.3", "A LIBETHERCAT_1.6"];
    assert_eq!(nodes, [&["A ECAN_SIM_0.2"], &versions[..]].concat());
    functions.retain(|(_, symbol)| !symbol.ends_with("@@ECAN_SIM_0.2"));
    functions.sort_unstable_by_key(|(_, symbol)| *symbol);
    let names: Vec<_> =
        functions.iter().map(|(_, symbol)| symbol.trim_start_matches("T ")).collect();
    assert_eq!(names, committed());
}

/// A library without contents, with soname, functions and versions of the real one, to link a
/// program like on a machine with IgH.
fn stub_of_the_real_library() -> TempDir {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let mut versions: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for symbol in committed() {
        let (name, version) = symbol.split_once("@@").expect("each has a version");
        versions.entry(version).or_default().push(name);
    }
    let (mut source, mut map, mut before) = (String::new(), String::new(), "");
    for (version, names) in versions {
        source
            .extend(names.iter().map(|name| format!("void {name}(void);void {name}(void) {{}}\n")));
        map += &format!("{version} {{ global: {}; }} {before};\n", names.join("; "));
        before = version;
    }
    let path = |name: &str| directory.path().join(name);
    std::fs::write(path("stub.c"), source).expect("room for the source");
    std::fs::write(path("stub.map"), map).expect("room for the map");
    let mut link = Command::new("cc");
    link.args(["-shared", "-fPIC", "-w", "-Wl,-soname,libethercat.so.1", "-o"]).arg(path(SONAME));
    link.arg(format!("-Wl,--version-script={}", path("stub.map").display())).arg(path("stub.c"));
    run(&mut link);
    directory
}

#[test]
fn program_linked_against_the_real_library_gets_no_warning() {
    if !crate::toolchain::is_there() {
        return;
    }
    let program_with_stub = stub_of_the_real_library();
    let program = plain_master(&program_with_stub);
    let output = start(&program, &simulated_library(), &[]);
    assert!(output.status.success(), "{}", output_text(&output));
    assert!(!output_text(&output).contains(WARNING), "{}", output_text(&output));

    // a library without versions gives the warning
    let output = start(&program, &crate::toolchain::simulated_library_without_versions(), &[]);
    assert!(output_text(&output).contains(WARNING), "{}", output_text(&output));
}
