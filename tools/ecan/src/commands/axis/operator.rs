//! The operator: keys, and the dead-man function of standard input and signals.

use std::cell::Cell;
use std::fs::File;
use std::io::{Read, stdin};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use ecan_tool_support::command_line::interrupt::Interrupt;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::FileType;
use rustix::io::Errno;
use rustix::termios::{
    LocalModes, OptionalActions, SpecialCodeIndex, Termios, isatty, tcgetattr, tcsetattr,
};

use crate::context::{Failure, Result};

use super::key_hold::{Hold, KeyHold};
use super::key_parser::{Key, KeyParser};

/// Longest time for the rest of an escape sequence.
const SEQUENCE: Timespec = Timespec { tv_sec: 0, tv_nsec: 50_000_000 };

/// Kind of standard input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputKind {
    /// A terminal: keys.
    Terminal,
    /// A pipe or socket: its end is the end of the motion.
    Stream,
    /// A file or device, which cannot report that the operator is gone.
    None,
}

/// Reason for which the operator ends a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopRequest {
    /// SIGINT or SIGTERM; a second one exits the process at once.
    Signal,
    /// SIGHUP.
    HungUp,
    /// The terminal was closed.
    TerminalLost,
    /// The pipe of standard input was closed.
    InputClosed,
    /// A key.
    Key,
    /// The key that had to be held was released.
    KeyReleased,
}

impl StopRequest {
    pub fn text(self) -> &'static str {
        match self {
            Self::Signal => "Ctrl-C or SIGTERM",
            Self::HungUp => "SIGHUP",
            Self::TerminalLost => "the terminal was closed",
            Self::InputClosed => "standard input was closed",
            Self::Key => "a key",
            Self::KeyReleased => "the key was released",
        }
    }

    /// Returns whether the operator is gone.
    pub fn is_lost(self) -> bool {
        matches!(self, Self::HungUp | Self::TerminalLost | Self::InputClosed)
    }
}

/// Reports of the reading thread.
#[derive(Debug)]
struct Shared {
    start: Instant,
    hold: Mutex<KeyHold<Key>>,
    is_closed: AtomicBool,
    has_hung_up: AtomicBool,
    /// Enter, Esc, q, Ctrl-C or Ctrl-D.
    has_end_key: AtomicBool,
    /// Any key, or any byte of a stream.
    has_any_key: AtomicBool,
}

impl Shared {
    fn press(&self, key: Key) {
        self.has_any_key.store(true, Ordering::Release);
        let is_end = matches!(key, Key::Enter | Key::Escape | Key::Control | Key::Character(b'q'));
        if is_end {
            self.has_end_key.store(true, Ordering::Release);
        }
        let mut hold = self.hold.lock().unwrap_or_else(PoisonError::into_inner);
        match is_end {
            true => hold.release(),
            false => hold.press(key, self.start.elapsed()),
        }
    }
}

/// Restores the modes of the terminal when dropped.
#[derive(Debug)]
struct KeyMode(Termios);

impl KeyMode {
    /// Keys without line editing and echo. Ctrl-C remains a signal; Ctrl-Z would stop the cycle and is a
    /// key.
    fn enter() -> rustix::io::Result<Self> {
        let before = tcgetattr(stdin())?;
        let mut modes = before.clone();
        modes.local_modes.remove(LocalModes::ICANON | LocalModes::ECHO);
        for code in [SpecialCodeIndex::VSUSP, SpecialCodeIndex::VQUIT] {
            modes.special_codes[code] = 0;
        }
        modes.special_codes[SpecialCodeIndex::VMIN] = 1;
        modes.special_codes[SpecialCodeIndex::VTIME] = 0;
        tcsetattr(stdin(), OptionalActions::Now, &modes)?;
        Ok(Self(before))
    }
}

impl Drop for KeyMode {
    fn drop(&mut self) {
        // A closed terminal needs no restoring.
        let _ = tcsetattr(stdin(), OptionalActions::Now, &self.0);
    }
}

/// Standard input and the signals, watched from the start of a command to the end of its motion.
#[derive(Debug)]
pub struct Operator {
    interrupt: Interrupt,
    shared: Arc<Shared>,
    kind: InputKind,
    /// A motion needs a held key.
    needs_key: bool,
    /// Last state of the keys, for a cycle in which a key is being read.
    held: Cell<Hold<Key>>,
    _mode: Option<KeyMode>,
}

impl Operator {
    /// Watches signals, and standard input on a detached thread. `release` is the time without a repetition after
    /// which a held key counts as released. With `needs_key` motions need a held key.
    pub fn watch(release: Duration, needs_key: bool) -> Result<Self> {
        let kind = input_kind();
        let mode = match kind {
            InputKind::Terminal => {
                Some(KeyMode::enter().map_err(|error| Failure::Input(error.into()))?)
            }
            InputKind::Stream | InputKind::None => None,
        };
        let shared = Arc::new(Shared {
            start: Instant::now(),
            hold: Mutex::new(KeyHold::new(release)),
            is_closed: AtomicBool::new(false),
            has_hung_up: AtomicBool::new(false),
            has_end_key: AtomicBool::new(false),
            has_any_key: AtomicBool::new(false),
        });
        let hung_up = shared.clone();
        let before = mode.as_ref().map(|KeyMode(before)| before.clone());
        let interrupt = Interrupt::install_with_exit(
            move || hung_up.has_hung_up.store(true, Ordering::Release),
            move || {
                if let Some(before) = &before {
                    let _ = tcsetattr(stdin(), OptionalActions::Now, before);
                }
            },
        )?;
        if kind != InputKind::None {
            let descriptor = stdin().as_fd().try_clone_to_owned().map_err(Failure::Input)?;
            let (input, reader) = (File::from(descriptor), shared.clone());
            let thread = std::thread::Builder::new().name("operator".to_owned());
            thread.spawn(move || read_keys(input, &Closing(reader))).map_err(Failure::of_thread)?;
        }
        Ok(Self { interrupt, shared, kind, needs_key, held: Cell::new(Hold::None), _mode: mode })
    }

    pub fn kind(&self) -> InputKind {
        self.kind
    }

    /// The request to stop: a signal, or the loss of standard input.
    pub fn stop_request(&self) -> Option<StopRequest> {
        if self.shared.is_closed.load(Ordering::Acquire) {
            return Some(match self.kind {
                InputKind::Terminal => StopRequest::TerminalLost,
                InputKind::Stream | InputKind::None => StopRequest::InputClosed,
            });
        }
        if self.shared.has_hung_up.load(Ordering::Acquire) {
            return Some(StopRequest::HungUp);
        }
        self.interrupt.is_set().then_some(StopRequest::Signal)
    }

    /// Returns whether a key that ends a command was pressed: Enter, Esc, q. A line of a stream counts.
    pub fn has_end_key(&self) -> bool {
        self.shared.has_end_key.load(Ordering::Acquire)
    }

    /// Returns whether motions need a held key.
    pub fn needs_key(&self) -> bool {
        self.needs_key
    }

    /// Returns whether a key is held.
    pub fn has_held_key(&self) -> bool {
        matches!(self.hold(), Hold::Held(_))
    }

    /// The request to end a motion that continues without further keys: any key, or the release of the
    /// one that has to be held.
    pub fn motion_request(&self) -> Option<StopRequest> {
        if self.needs_key {
            return (!self.has_held_key()).then_some(StopRequest::KeyReleased);
        }
        let has_key = self.shared.has_any_key.load(Ordering::Acquire);
        has_key.then_some(StopRequest::Key)
    }

    /// The held key. Does not block.
    pub fn hold(&self) -> Hold<Key> {
        if let Ok(hold) = self.shared.hold.try_lock() {
            self.held.set(hold.state(self.shared.start.elapsed()));
        }
        self.held.get()
    }
}

pub fn input_kind() -> InputKind {
    if isatty(stdin()) {
        return InputKind::Terminal;
    }
    let kind = rustix::fs::fstat(stdin()).map(|it| FileType::from_raw_mode(it.st_mode));
    match kind {
        Ok(FileType::Fifo | FileType::Socket) => InputKind::Stream,
        _ => InputKind::None,
    }
}

/// Reports the end of the reading thread, with any cause.
struct Closing(Arc<Shared>);

impl Drop for Closing {
    fn drop(&mut self) {
        self.0.is_closed.store(true, Ordering::Release);
    }
}

/// Returns when the input ends: closed by the other end, or an error.
fn read_keys(mut input: File, Closing(shared): &Closing) {
    let mut parser = KeyParser::default();
    let mut bytes = [0; 256];
    loop {
        let timeout = parser.is_pending().then_some(&SEQUENCE);
        let mut ends = [PollFd::new(&input, PollFlags::IN)];
        match poll(&mut ends, timeout) {
            Ok(0) => parser.timed_out().into_iter().for_each(|key| shared.press(key)),
            Ok(_) => match input.read(&mut bytes) {
                Ok(0) => return,
                Ok(length) => {
                    let read = bytes.get(..length).unwrap_or_default();
                    read.iter()
                        .filter_map(|byte| parser.byte(*byte))
                        .for_each(|key| shared.press(key));
                }
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(_) => return,
            },
            Err(Errno::INTR) => {}
            Err(_) => return,
        }
    }
}
