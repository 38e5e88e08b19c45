//! A program on a pseudo-terminal, which it must restore.

use std::fs::File;
use std::io::Write as _;
use std::process::{Command, Stdio};

use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, Termios, Winsize, tcgetattr, tcsetwinsize};

use super::timed_reader::TimedReader;
use ecan_test_support::Killed;

/// Enter and leave the alternate screen; hide and show the cursor.
pub const ENTER: &str = "\x1b[?1049h";
pub const LEAVE: &str = "\x1b[?1049l";
const HIDE: &str = "\x1b[?25l";
const SHOW: &str = "\x1b[?25h";

/// Pseudo-terminal. Its descriptors are closed on exec, so that children of other tests do not keep
/// it open. It is not the controlling terminal of the tests: its end would end them by SIGHUP.
pub struct Pty {
    pub master: File,
    pub terminal: File,
    pub name: String,
}

impl Pty {
    /// Opens a terminal of this size, in columns and rows.
    pub fn open(size: (u16, u16)) -> Self {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let master = openpt(flags).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let terminal = rustix::fs::open(&name, flags, Mode::empty()).unwrap().into();
        tcsetwinsize(&master, winsize(size)).unwrap();
        Self { master: master.into(), terminal, name }
    }

    /// Another handle of the terminal, for a child.
    pub fn stdio(&self) -> Stdio {
        self.terminal.try_clone().unwrap().into()
    }
}

pub fn winsize((columns, rows): (u16, u16)) -> Winsize {
    Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 }
}

/// Returns whether the terminal is in raw mode.
pub fn is_raw(terminal: &File) -> bool {
    !tcgetattr(terminal).unwrap().local_modes.contains(LocalModes::ICANON)
}

pub struct OnTerminal {
    child: Killed,
    /// Keeps the terminal open after the program.
    pty: Pty,
    before: Termios,
    shown: TimedReader,
}

impl OnTerminal {
    pub fn start(command: &mut Command) -> Self {
        let pty = Pty::open((100, 40));
        let before = tcgetattr(&pty.terminal).unwrap();
        let (stdin, stdout, stderr) = (pty.stdio(), pty.stdio(), pty.stdio());
        command.env("TERM", "xterm").stdin(stdin).stdout(stdout).stderr(stderr);
        let child = Killed::spawn(command);
        let shown = TimedReader::new(pty.master.try_clone().unwrap());
        Self { child, pty, before, shown }
    }

    /// Waits for a text in the output. Blanks may be missing: unchanged cells are not written.
    pub fn wait_for(&mut self, words: &str) {
        self.shown.wait_for(words);
    }

    /// Returns whether the terminal is in raw mode.
    pub fn is_raw(&self) -> bool {
        is_raw(&self.pty.terminal)
    }

    pub fn press(&mut self, keys: &[u8]) {
        self.pty.master.write_all(keys).unwrap();
    }

    pub fn terminate(&self) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
    }

    /// Waits for the exit: status, and the text after the alternate screen. Checks that modes,
    /// screen and cursor are restored.
    pub fn end(mut self) -> (Option<i32>, String) {
        let status = self.shown.end_of(&mut self.child).code();
        // All output of the program precedes this mark.
        let mark = "<the end>";
        self.pty.terminal.write_all(mark.as_bytes()).unwrap();
        self.wait_for(mark);
        let modes = |terminal: Termios| {
            (
                terminal.input_modes,
                terminal.output_modes,
                terminal.control_modes,
                terminal.local_modes,
            )
        };
        assert_eq!(modes(tcgetattr(&self.pty.terminal).unwrap()), modes(self.before.clone()));
        let text = self.shown.text();
        let last = |code: &str| text.rfind(code);
        assert!(last(ENTER) < last(LEAVE), "the alternate screen is not left: {text:?}");
        assert!(last(HIDE) < last(SHOW), "the cursor is not shown: {text:?}");
        let (_, behind) = text.split_once(LEAVE).unwrap();
        (status, behind.trim_end_matches(mark).to_owned())
    }
}

/// Runs a program with a terminal as input and standard error, on which `typed` is typed: exit
/// status and text of the terminal.
pub fn with_answer(command: &mut Command, typed: &str) -> (i32, String) {
    let Pty { mut master, terminal, .. } = Pty::open((80, 24));
    master.write_all(typed.as_bytes()).unwrap();
    let stdin = terminal.try_clone().unwrap();
    command.env("TERM", "xterm").stdin(stdin).stderr(terminal).stdout(Stdio::null());
    let mut child = Killed::spawn(command);
    // The command keeps its handles of the terminal until then.
    command.stdin(Stdio::null()).stderr(Stdio::null());
    let mut shown = TimedReader::new(master);
    let status = shown.end_of(&mut child).code().unwrap();
    (status, shown.rest())
}
