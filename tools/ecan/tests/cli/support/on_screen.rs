//! The program on a terminal with an emulated screen.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::num::NonZero;
use std::os::fd::{AsFd, OwnedFd};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::process::{Pid, PidfdFlags, Signal, kill_process, pidfd_open};
use rustix::termios::tcsetwinsize;

use super::terminal::{Pty, is_raw, winsize};
use super::timed_reader::{LIMIT, is_readable};
use ecan_test_support::Killed;

const LAST_OUTPUT: Duration = Duration::from_secs(5);

/// Program on a terminal.
pub struct OnScreen {
    child: Killed,
    /// Master side; `None` after it was closed.
    master: Option<File>,
    /// Keeps the terminal open after the program.
    terminal: File,
    name: String,
    screen: vt100::Parser,
}

/// Time in which the system moves what was written to a terminal.
const MOVED: Duration = Duration::from_millis(300);

impl OnScreen {
    /// Starts the program on a terminal of this size, in columns and rows.
    pub fn start(size: (u16, u16), arguments: &[&str]) -> Self {
        Self::spawn(size, &[&[env!("CARGO_BIN_EXE_ecan")][..], arguments].concat())
    }

    /// As [`start`](Self::start), as a session leader, which gets SIGHUP when the terminal closes.
    pub fn start_leader(size: (u16, u16), arguments: &[&str]) -> Self {
        let leader = ["setsid", "--ctty", env!("CARGO_BIN_EXE_ecan")];
        Self::spawn(size, &[&leader[..], arguments].concat())
    }

    fn spawn(size: (u16, u16), line: &[&str]) -> Self {
        let pty = Pty::open(size);
        let child = Killed::spawn(
            Command::new(line[0])
                .args(&line[1..])
                .env_remove("ECAN_ECRT")
                .env_remove("NO_COLOR")
                .env("TERM", "xterm-256color")
                .stdin(pty.stdio())
                .stdout(pty.stdio())
                .stderr(Stdio::piped()),
        );
        let (rows, columns) = cells(size);
        let screen = vt100::Parser::new(rows, columns, 0);
        let Pty { master, terminal, name } = pty;
        Self { child, master: Some(master), terminal, name, screen }
    }

    /// Text of the screen, without trailing blanks.
    pub fn screen(&self) -> String {
        self.screen.screen().contents()
    }

    /// Returns whether the alternate screen is active.
    pub fn has_own_screen(&self) -> bool {
        self.screen.screen().alternate_screen()
    }

    /// Returns whether the terminal is in raw mode.
    pub fn is_raw(&self) -> bool {
        is_raw(&self.terminal)
    }

    /// Reads until the screen matches.
    pub fn wait_until(&mut self, what: &str, fits: impl Fn(&Self) -> bool) {
        let deadline = Instant::now() + LIMIT;
        let mut buffer = [0; 4096];
        while !fits(self) {
            if !self.has_output(deadline) || Instant::now() > deadline {
                panic!("no {what}:\n{}\n{}", self.screen(), self.stopped());
            }
            let master = self.master.as_mut().unwrap();
            let length = master.read(&mut buffer).unwrap();
            self.screen.process(&buffer[..length]);
        }
    }

    /// Waits for output; `false` without any until the deadline or the end of the program.
    fn has_output(&self, deadline: Instant) -> bool {
        let master = self.master.as_ref().unwrap();
        let process = self.process();
        let mut ends = [PollFd::new(master, PollFlags::IN), PollFd::new(&process, PollFlags::IN)];
        let left = deadline.saturating_duration_since(Instant::now());
        poll(&mut ends, Some(&left.try_into().unwrap())).unwrap();
        // The last output may become readable after the end of the program.
        ends[0].revents().contains(PollFlags::IN) || is_ready(master, Instant::now() + LAST_OUTPUT)
    }

    fn process(&self) -> OwnedFd {
        pidfd_open(Pid::from_child(&self.child), PidfdFlags::empty()).unwrap()
    }

    /// Kills the program; returns its status if it had ended before, and its standard error.
    fn stopped(&mut self) -> String {
        let status = self.child.try_wait().unwrap();
        let _ = self.child.kill();
        let mut errors = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut errors).unwrap();
        format!("status {status:?}, standard error:\n{errors}")
    }

    /// Reads until the screen contains a text.
    pub fn wait_for(&mut self, words: &str) {
        self.wait_until(words, |terminal| terminal.screen().contains(words));
    }

    /// Types keys.
    pub fn press(&mut self, keys: &[u8]) {
        self.master.as_mut().unwrap().write_all(keys).unwrap();
    }

    /// Resizes the terminal.
    pub fn resize(&mut self, size: (u16, u16)) {
        tcsetwinsize(self.master.as_ref().unwrap(), winsize(size)).unwrap();
        // Terminals differ in how they resize their contents: this one clears them.
        let (rows, columns) = cells(size);
        let has_own_screen = self.has_own_screen();
        self.screen = vt100::Parser::new(rows, columns, 0);
        if has_own_screen {
            self.screen.process(b"\x1b[?1049h");
        }
        self.signal(Signal::WINCH);
    }

    /// Fills the output buffer of the terminal.
    pub fn fill(&self) {
        let flags = OFlags::WRONLY | OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::CLOEXEC;
        let terminal = rustix::fs::open(&self.name, flags, Mode::empty()).unwrap();
        loop {
            match rustix::io::write(&terminal, &[b' '; 256]) {
                Ok(_) => {}
                // The system still moves what was written to the reader, which makes room.
                Err(Errno::AGAIN) => {
                    let mut end = [PollFd::new(&terminal, PollFlags::OUT)];
                    if poll(&mut end, Some(&MOVED.try_into().unwrap())).unwrap() == 0 {
                        return;
                    }
                }
                Err(error) => panic!("{error}"),
            }
        }
    }

    /// Closes the terminal.
    pub fn close(&mut self) {
        self.master = None;
    }

    /// Sends a signal.
    pub fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Ends a program by its key; the status must be 0.
    #[track_caller]
    pub fn quit(&mut self) {
        self.press(b"q");
        self.ends(0);
    }

    /// Standard error of a program that ends with this status.
    #[track_caller]
    pub fn ends(&mut self, status: i32) -> String {
        let is_over = is_ready(self.process(), Instant::now() + LIMIT);
        assert!(is_over, "it does not end:\n{}", self.screen());
        let mut errors = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut errors).unwrap();
        assert_eq!(self.child.wait().unwrap().code(), Some(status), "{errors}");
        errors
    }
}

/// Rows and columns for the emulator.
fn cells((columns, rows): (u16, u16)) -> (NonZero<u16>, NonZero<u16>) {
    (NonZero::new(rows).unwrap(), NonZero::new(columns).unwrap())
}

fn is_ready(descriptor: impl AsFd, deadline: Instant) -> bool {
    is_readable(descriptor, deadline.saturating_duration_since(Instant::now())).unwrap()
}
