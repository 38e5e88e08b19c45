//! The operator: keys, held keys, and the dead-man function of standard input and signals.

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
    let kind = rustix::fs::fstat(stdin()).map(|status| FileType::from_raw_mode(status.st_mode));
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

/// Key that a command uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    Left,
    Right,
    Up,
    Down,
    Enter,
    Escape,
    /// Ctrl-C or Ctrl-D as a byte.
    Control,
    Character(u8),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
enum State {
    #[default]
    Ground,
    /// After ESC.
    Escape,
    /// After ESC [ or ESC O, with parameters that are ignored.
    Sequence,
}

/// Reads keys from bytes, also if a sequence arrives in parts.
#[derive(Debug, Default)]
pub struct KeyParser(State);

impl KeyParser {
    /// Reads a byte; `None` within a sequence, and for sequences of other keys.
    pub fn byte(&mut self, byte: u8) -> Option<Key> {
        match (self.0, byte) {
            (State::Escape, b'[' | b'O') => {
                self.0 = State::Sequence;
                None
            }
            (State::Sequence, b'0'..=b'9' | b';' | b':' | b'?') => None,
            (State::Sequence, byte) => {
                self.0 = State::Ground;
                match byte {
                    b'A' => Some(Key::Up),
                    b'B' => Some(Key::Down),
                    b'C' => Some(Key::Right),
                    b'D' => Some(Key::Left),
                    _ => None,
                }
            }
            (_, 0x1B) => {
                self.0 = State::Escape;
                None
            }
            (_, byte) => {
                self.0 = State::Ground;
                Some(match byte {
                    b'\r' | b'\n' => Key::Enter,
                    0x03 | 0x04 => Key::Control,
                    byte => Key::Character(byte),
                })
            }
        }
    }

    /// Returns whether an escape byte waits for the rest of a sequence.
    pub fn is_pending(&self) -> bool {
        self.0 != State::Ground
    }

    /// The rest of a sequence did not come: the key Esc, or nothing.
    pub fn timed_out(&mut self) -> Option<Key> {
        let state = std::mem::take(&mut self.0);
        (state == State::Escape).then_some(Key::Escape)
    }
}

/// Longest delay of the first repetition: terminals wait 250 to 700 ms.
const FIRST: Duration = Duration::from_millis(1_000);

/// State of the keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold<K> {
    /// No key, or released.
    None,
    /// Pressed; the terminal does not repeat it yet.
    Pressed(K),
    /// Held.
    Held(K),
}

/// Keys as a terminal reports them: pressed, and repeated while held. Times are those since any start.
#[derive(Clone, Copy, Debug)]
pub struct KeyHold<K> {
    /// Time without a repetition after which a key is released.
    timeout: Duration,
    last: Option<(K, Duration)>,
    is_repeating: bool,
}

impl<K: Copy + PartialEq> KeyHold<K> {
    pub fn new(timeout: Duration) -> Self {
        Self { timeout, last: None, is_repeating: false }
    }

    /// A key was pressed or repeated. Presses at intervals above the timeout do not count as held.
    pub fn press(&mut self, key: K, at: Duration) {
        self.is_repeating = matches!(self.last, Some((last, since))
            if last == key && at.saturating_sub(since) <= self.timeout);
        self.last = Some((key, at));
    }

    /// Another key was pressed.
    pub fn release(&mut self) {
        (self.last, self.is_repeating) = (None, false);
    }

    pub fn state(&self, now: Duration) -> Hold<K> {
        let Some((key, at)) = self.last else { return Hold::None };
        let since = now.saturating_sub(at);
        if self.is_repeating {
            return if since <= self.timeout { Hold::Held(key) } else { Hold::None };
        }
        if since <= FIRST { Hold::Pressed(key) } else { Hold::None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(bytes: &[u8]) -> Vec<Key> {
        let mut parser = KeyParser::default();
        let mut keys: Vec<_> = bytes.iter().filter_map(|byte| parser.byte(*byte)).collect();
        keys.extend(parser.timed_out());
        keys
    }

    #[test]
    fn arrows_of_both_cursor_modes_are_keys() {
        let arrows = [Key::Up, Key::Down, Key::Right, Key::Left];
        assert_eq!(keys(b"\x1b[A\x1b[B\x1b[C\x1b[D"), arrows);
        assert_eq!(keys(b"\x1bOA\x1bOB\x1bOC\x1bOD"), arrows);
        assert_eq!(keys(b"\x1b[1;5C"), [Key::Right], "with Ctrl");
    }

    #[test]
    fn other_sequences_are_ignored_and_escape_alone_is_a_key() {
        assert_eq!(keys(b"\x1b[5~q\n\x03"), [Key::Character(b'q'), Key::Enter, Key::Control]);
        assert_eq!(keys(b"\x1b"), [Key::Escape]);
        assert_eq!(keys(b"\x1b\x1b[A"), [Key::Up]);
        assert_eq!(keys(b"\x1b["), []);
    }

    const TIMEOUT: Duration = Duration::from_millis(200);

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn repeated_key_is_held_until_the_timeout() {
        let mut keys = KeyHold::new(TIMEOUT);
        assert_eq!(keys.state(ms(0)), Hold::None);
        keys.press('a', ms(100));
        assert_eq!(keys.state(ms(600)), Hold::Pressed('a'), "before the first repetition");
        keys.press('a', ms(600));
        assert_eq!(keys.state(ms(610)), Hold::Pressed('a'), "two presses may be single ones");
        keys.press('a', ms(640));
        assert_eq!(keys.state(ms(840)), Hold::Held('a'));
        assert_eq!(keys.state(ms(841)), Hold::None, "released");
        keys.press('a', ms(900));
        assert_eq!(keys.state(ms(901)), Hold::Pressed('a'), "it begins again");
    }

    #[test]
    fn other_key_ends_the_hold() {
        let mut keys = KeyHold::new(TIMEOUT);
        (0..5).for_each(|nth| keys.press('a', ms(nth * 30)));
        assert_eq!(keys.state(ms(121)), Hold::Held('a'));
        keys.press('b', ms(130));
        assert_eq!(keys.state(ms(131)), Hold::Pressed('b'));
        keys.release();
        assert_eq!(keys.state(ms(132)), Hold::None);
    }

    #[test]
    fn single_presses_are_no_held_key() {
        let mut keys = KeyHold::new(TIMEOUT);
        for nth in 0..10 {
            keys.press('a', ms(nth * 250));
            assert_eq!(keys.state(ms(nth * 250 + 1)), Hold::Pressed('a'));
        }
        assert_eq!(keys.state(ms(9 * 250 + 1_001)), Hold::None);
    }
}
