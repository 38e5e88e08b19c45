//! Programs in Python that take part in a test.
#![allow(missing_docs)]

use std::fmt::Display;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Names the interpreter, usually that of a virtual environment.
const PYTHON_VARIABLE: &str = "ECAN_PYTHON";
/// Nothing takes anywhere near as long, unless it fails.
pub const PATIENCE: Duration = Duration::from_secs(300);

/// An interpreter that has the packages; says why, where there is none.
///
/// One that was named has to be right.
pub fn python() -> Option<PathBuf> {
    let named = std::env::var_os(PYTHON_VARIABLE).filter(|value| !value.is_empty());
    let interpreter = named.as_ref().map_or_else(|| PathBuf::from("python3"), PathBuf::from);
    let has_packages = imports(&interpreter, "canopen, can, durand, serial");
    assert!(
        has_packages.is_ok() || named.is_none(),
        "{PYTHON_VARIABLE}={}: {}",
        interpreter.display(),
        has_packages.unwrap_err()
    );
    if let Err(why) = &has_packages {
        // Past the harness, which would keep it to itself.
        let _ = writeln!(
            std::io::stderr(),
            "skipped: no peer in Python: {why} ({PYTHON_VARIABLE} may name an interpreter with the \
             packages canopen, durand, python-can and pyserial)"
        );
    }
    has_packages.ok().map(|()| interpreter)
}

fn imports(interpreter: &Path, modules: &str) -> Result<(), String> {
    let import = format!("import {modules}");
    let output = Command::new(interpreter).args(["-c", &import]).stdin(Stdio::null()).output();
    let output = output.map_err(|error| format!("{}: {error}", interpreter.display()))?;
    if output.status.success() {
        return Ok(());
    }
    let text = String::from_utf8_lossy(&output.stderr);
    Err(text.lines().last().unwrap_or("it failed without a word").to_owned())
}

/// A running script. Dropping it ends it.
pub struct Peer {
    script: String,
    child: Child,
    input: Option<ChildStdin>,
    lines: Receiver<String>,
    reader: Option<JoinHandle<()>>,
    begun: Instant,
}

impl Peer {
    /// Runs a script of `tests/python` with arguments by name.
    pub fn start<A: Display>(python: &Path, script: &str, arguments: &[(&str, A)]) -> Self {
        let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python");
        let mut child = Command::new(python)
            .arg("-B")
            .arg(directory.join(script))
            .args(arguments.iter().map(|(name, value)| format!("--{name}={value}")))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| panic!("{script}: {error}"));
        let output = BufReader::new(child.stdout.take().expect("piped"));
        let (sender, lines) = channel();
        let read = move || {
            for line in output.lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        };
        Self {
            script: script.to_owned(),
            input: child.stdin.take(),
            child,
            lines,
            reader: Some(std::thread::spawn(read)),
            begun: Instant::now(),
        }
    }

    /// The next line that the script has written, if there is one. Panics where the script has
    /// ended badly, or takes too long.
    pub fn line(&mut self) -> Option<String> {
        match self.lines.try_recv() {
            Ok(line) => return Some(line),
            Err(TryRecvError::Empty) => {}
            Err(TryRecvError::Disconnected) => {
                let status = self.child.wait().expect("wait");
                assert!(status.success(), "{}: {status}", self.script);
            }
        }
        assert!(self.begun.elapsed() < PATIENCE, "{} takes too long", self.script);
        None
    }

    /// Waits for the next line while something else moves the simulation.
    pub fn wait_line(&mut self) -> String {
        loop {
            if let Some(line) = self.line() {
                return line;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Lets the script go on.
    pub fn answer(&mut self) {
        let input = self.input.as_mut().expect("open");
        input.write_all(b"go on\n").unwrap_or_else(|error| panic!("{}: {error}", self.script));
    }

    /// Ends the script's input, which ends the script; its status, once it has ended.
    pub fn try_finish(&mut self) -> Option<ExitStatus> {
        self.input = None;
        assert!(self.begun.elapsed() < PATIENCE, "{} does not end", self.script);
        self.child.try_wait().expect("wait")
    }

    /// Ends the script at once.
    pub fn kill(&mut self) {
        // One that has ended already is no error.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.kill();
        if let Some(reader) = self.reader.take() {
            let _ = reader.join();
        }
    }
}
