//! What the other tests wait with: a limit that holds, and guards that end children and threads.

use std::io::{Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::support::timed_reader::TimedReader;
use ecan_test_support::{Killed, OnDrop};

/// The words of a panic.
fn panic_of(work: impl FnOnce()) -> String {
    let panic = catch_unwind(AssertUnwindSafe(work)).unwrap_err();
    *panic.downcast::<String>().unwrap()
}

#[test]
fn timeout_fails_with_received_text() {
    let (mut other, ours) = UnixStream::pair().unwrap();
    let mut heard = TimedReader::with_limit(ours, Duration::from_millis(50));
    other.write_all(b"one two").unwrap();
    heard.wait_for("two");
    let words = panic_of(|| heard.wait_for("three"));
    assert!(words.starts_with("\"three\" did not come in 50ms; this came: one two"), "{words}");
    let words = panic_of(|| drop(heard.bytes(8)));
    assert!(words.starts_with("8 bytes did not come in 50ms; this came: one two"), "{words}");
    drop(other);
    let words = panic_of(|| heard.wait_for("three"));
    assert_eq!(words, "the end came before \"three\", behind: one two");
}

#[test]
fn pieces_are_read_in_order() {
    let (mut other, ours) = UnixStream::pair().unwrap();
    let mut heard = TimedReader::new(ours);
    other.write_all(b"first\nsecond\nabcdef").unwrap();
    assert_eq!(heard.through(b'\n'), b"first\n");
    heard.wait_for("abc");
    assert_eq!(heard.bytes(3), b"sec");
    assert_eq!(heard.through(b'\n'), b"ond\n");
    drop(other);
    assert_eq!(heard.rest(), "abcdef");
    assert_eq!(heard.through(b'\n'), b"");
}

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
