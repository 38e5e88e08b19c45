//! Child processes of tests: guards that end them and waiting threads when a test fails, and tshark.

use std::io::{BufRead as _, BufReader, Read};
use std::ops::{Deref, DerefMut};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryIter, channel};
use std::time::Duration;

/// Time limit of a child, far above the duration of a successful test on a busy machine.
const LIMIT: Duration = Duration::from_secs(300);

/// A child that is killed and waited for when this is dropped.
pub struct Killed(Child);

impl Killed {
    /// Starts a program.
    pub fn spawn(command: &mut Command) -> Self {
        Self(command.spawn().unwrap())
    }

    /// Lines of standard output. Each is waited for, at most for 5 minutes.
    pub fn lines(&mut self) -> Lines {
        let output = BufReader::new(self.stdout.take().unwrap());
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            output.lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
        Lines(lines)
    }

    /// Reads both streams to their end and waits for the exit, at most for 5 minutes each.
    pub fn output(mut self) -> Output {
        let streams = (self.stdout.take().map(read_all), self.stderr.take().map(read_all));
        let end = |stream: Option<Receiver<Vec<u8>>>| {
            let bytes = stream.map(|stream| stream.recv_timeout(LIMIT));
            bytes.map_or_else(Vec::new, |bytes| bytes.expect("the program ends"))
        };
        let (stdout, stderr) = (end(streams.0), end(streams.1));
        // Its streams are closed: it is about to exit.
        Output { status: self.wait().unwrap(), stdout, stderr }
    }
}

/// Lines that a child prints.
pub struct Lines(Receiver<String>);

impl Lines {
    /// Lines that have arrived.
    pub fn arrived(&self) -> TryIter<'_, String> {
        self.0.try_iter()
    }
}

impl Iterator for Lines {
    type Item = String;

    fn next(&mut self) -> Option<String> {
        match self.0.recv_timeout(LIMIT) {
            Ok(line) => Some(line),
            Err(RecvTimeoutError::Disconnected) => None,
            Err(RecvTimeoutError::Timeout) => panic!("no line in {LIMIT:?}"),
        }
    }
}

fn read_all(mut stream: impl Read + Send + 'static) -> Receiver<Vec<u8>> {
    let (sender, bytes) = channel();
    std::thread::spawn(move || {
        let mut read = Vec::new();
        let _ = stream.read_to_end(&mut read);
        let _ = sender.send(read);
    });
    bytes
}

/// Runs a program to its end, at most for 5 minutes.
pub fn output(command: &mut Command) -> Output {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    Killed::spawn(command).output()
}

impl Deref for Killed {
    type Target = Child;

    fn deref(&self) -> &Child {
        &self.0
    }
}

impl DerefMut for Killed {
    fn deref_mut(&mut self) -> &mut Child {
        &mut self.0
    }
}

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Calls a function when it is dropped. Within a scope of threads it ends their loops when the test fails;
/// otherwise the scope would wait for them for ever.
pub struct OnDrop<F: FnMut()>(pub F);

impl<F: FnMut()> Drop for OnDrop<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}

/// The fields of each packet that a display filter passes, with `|` between and commas between those
/// of one name; `None` without tshark.
pub fn fields_of(
    capture: &Path,
    dissector: &str,
    filter: &str,
    names: &[&str],
) -> Option<Vec<String>> {
    let mut command = Command::new("tshark");
    command.args(["-X", &format!("lua_script:{dissector}"), "-r"]).arg(capture);
    command.args(["-Y", filter, "-T", "fields", "-E", "separator=|"]);
    command.args(names.iter().flat_map(|name| ["-e", name]));
    // No preferences or plug-ins of whoever runs the test.
    let home = capture.parent().unwrap();
    command.env("HOME", home).env("XDG_CONFIG_HOME", home);
    let output = match command.output() {
        Ok(output) => output,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            eprintln!("skipped: there is no tshark");
            return None;
        }
        Err(error) => panic!("tshark: {error}"),
    };
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !errors.contains("Lua"), "{errors}");
    // From 4.2 on tshark has words for flags.
    let text = String::from_utf8(output.stdout).unwrap();
    let text = text.replace("True", "1").replace("False", "0");
    Some(text.lines().map(str::to_owned).collect())
}
