//! Guards for what must not outlive a test, also when it fails: children, and threads that wait.

use std::io::Read;
use std::ops::{Deref, DerefMut};
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, channel};

use super::timed_reader::LIMIT;

/// A child that is killed and waited for when this is dropped.
pub struct Killed(Child);

impl Killed {
    pub fn spawn(command: &mut Command) -> Self {
        Self(command.spawn().unwrap())
    }

    /// Reads both streams to their end and waits for the exit, at most for [`LIMIT`] each.
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

fn read_all(mut stream: impl Read + Send + 'static) -> Receiver<Vec<u8>> {
    let (sender, bytes) = channel();
    std::thread::spawn(move || {
        let mut read = Vec::new();
        let _ = stream.read_to_end(&mut read);
        let _ = sender.send(read);
    });
    bytes
}

/// Runs a program to its end, at most for [`LIMIT`].
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

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    #[test]
    fn failing_test_ends_its_threads_and_children() {
        let mut id = 0;
        let failed = catch_unwind(AssertUnwindSafe(|| {
            let is_over = &AtomicBool::new(false);
            std::thread::scope(|threads| {
                let _end = OnDrop(|| is_over.store(true, Ordering::Release));
                let mut child =
                    Killed::spawn(Command::new("cat").stdin(Stdio::piped()).stdout(Stdio::piped()));
                id = child.id();
                let mut printed = child.stdout.take().unwrap();
                threads.spawn(move || printed.read_to_end(&mut Vec::new()).unwrap());
                threads.spawn(|| {
                    while !is_over.load(Ordering::Acquire) {
                        std::thread::yield_now();
                    }
                });
                panic!("the test fails");
            });
        }));
        assert!(failed.is_err());
        assert!(!std::path::Path::new(&format!("/proc/{id}")).exists(), "waited for");
    }
}
