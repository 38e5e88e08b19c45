//! Peers in Python.

use std::io::Write as _;
use std::process::Command;

/// Names the interpreter, usually that of a virtual environment.
const PYTHON_VARIABLE: &str = "ECAN_PYTHON";

/// An interpreter with these modules; prints the reason if there is none. A named one must have them.
pub fn python_with(modules: &[&str], packages: &str) -> Option<String> {
    let named = std::env::var(PYTHON_VARIABLE).ok().filter(|value| !value.is_empty());
    let interpreter = named.clone().unwrap_or_else(|| "python3".to_owned());
    let import = format!("import {}", modules.join(", "));
    let imported = Command::new(&interpreter).args(["-c", &import]).output();
    let is_there = imported.is_ok_and(|output| output.status.success());
    assert!(is_there || named.is_none(), "{PYTHON_VARIABLE}={interpreter} has no {packages}");
    if !is_there {
        skip(&format!("{interpreter} has no {packages}; {PYTHON_VARIABLE} may name another"));
    }
    is_there.then_some(interpreter)
}

/// Prints why a test is skipped, past the harness, which would keep it to itself.
pub fn skip(reason: &str) {
    let _ = writeln!(std::io::stderr(), "skipped: {reason}");
}
