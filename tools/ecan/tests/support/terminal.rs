//! A program on a terminal of its own, which has to be afterwards as it was before.
#![allow(dead_code)]

use std::fs::File;
use std::io::Write as _;
use std::os::fd::OwnedFd;
use std::process::{Child, Command, Stdio};

use nix::pty::{Winsize, openpty};
use nix::sys::termios::{LocalFlags, Termios, tcgetattr};

use super::deadline::Deadlined;

/// The alternate screen, entered and left; the cursor, hidden and shown.
pub const ENTER: &str = "\x1b[?1049h";
pub const LEAVE: &str = "\x1b[?1049l";
const HIDE: &str = "\x1b[?25l";
const SHOW: &str = "\x1b[?25h";

pub struct OnTerminal {
    child: Child,
    master: File,
    /// Keeps the terminal after the program.
    terminal: OwnedFd,
    before: Termios,
    shown: Deadlined,
}

impl OnTerminal {
    pub fn start(command: &mut Command) -> Self {
        let size = Winsize { ws_row: 40, ws_col: 100, ws_xpixel: 0, ws_ypixel: 0 };
        let pty = openpty(Some(&size), None).unwrap();
        let before = tcgetattr(&pty.slave).unwrap();
        let end = || Stdio::from(pty.slave.try_clone().unwrap());
        let child =
            command.env("TERM", "xterm").stdin(end()).stdout(end()).stderr(end()).spawn().unwrap();
        let master = File::from(pty.master);
        let shown = Deadlined::new(master.try_clone().unwrap());
        Self { child, master, terminal: pty.slave, before, shown }
    }

    /// Waits until the screen has had these words; blanks are not written where nothing was.
    pub fn wait_for(&mut self, words: &str) {
        self.shown.wait_for(words);
    }

    /// Whether keys go to the program as they are.
    pub fn is_raw(&self) -> bool {
        !tcgetattr(&self.terminal).unwrap().local_flags.contains(LocalFlags::ICANON)
    }

    pub fn press(&mut self, keys: &[u8]) {
        self.master.write_all(keys).unwrap();
    }

    pub fn terminate(&self) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
    }

    /// Waits for the end: the exit status, and what was said behind the alternate screen. The
    /// terminal has to be as it was: its modes, the screen, the cursor.
    pub fn end(mut self) -> (Option<i32>, String) {
        let status = self.shown.end_of(&mut self.child).code();
        // What the program wrote before its end is there already; this is behind it.
        let mark = "<the end>";
        File::from(self.terminal.try_clone().unwrap()).write_all(mark.as_bytes()).unwrap();
        self.wait_for(mark);
        assert_eq!(tcgetattr(&self.terminal).unwrap(), self.before);
        let text = self.shown.text();
        let last = |code: &str| text.rfind(code);
        assert!(last(ENTER) < last(LEAVE), "the alternate screen is not left: {text:?}");
        assert!(last(HIDE) < last(SHOW), "the cursor is not shown: {text:?}");
        let (_, behind) = text.split_once(LEAVE).unwrap();
        (status, behind.trim_end_matches(mark).to_owned())
    }
}

impl Drop for OnTerminal {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Runs a program with a terminal for input and messages, at which this is typed: its exit status,
/// and what the terminal shows.
pub fn with_answer(command: &mut Command, typed: &str) -> (i32, String) {
    let pty = openpty(None, None).unwrap();
    let mut screen = File::from(pty.master);
    screen.write_all(typed.as_bytes()).unwrap();
    let end = || Stdio::from(pty.slave.try_clone().unwrap());
    let mut child = command
        .env("TERM", "xterm")
        .stdin(end())
        .stderr(end())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    // The command keeps its own ends of the terminal until then.
    command.stdin(Stdio::null()).stderr(Stdio::null());
    drop(pty.slave);
    let mut shown = Deadlined::new(screen);
    let status = shown.end_of(&mut child).code().unwrap();
    (status, shown.rest())
}
