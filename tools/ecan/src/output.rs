//! Output of the program: text for people, JSON for programs.

use std::error::Error;
use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};

use ecan_tool_support::command_line::screen::{self, CleanWriter, Content, Sequence, Stream};
use serde::Serialize;

use crate::failure::{Failure, Result};
use crate::global::Color;
use crate::progress;

#[derive(Clone, Copy, Debug)]
pub struct Output {
    json: bool,
    color: bool,
    is_on_stderr: bool,
}

/// True after standard output has a JSON document or other data, to which none may be added.
static IS_STDOUT_USED: AtomicBool = AtomicBool::new(false);

/// A failure as JSON.
#[derive(Debug, Serialize)]
struct FailureReport {
    error: String,
    status: u8,
    causes: Vec<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    Good,
    Warning,
    Bad,
    Faint,
}

impl Output {
    pub fn new(json: bool, color: Color) -> Self {
        let is_wanted = match color {
            Color::Always => true,
            Color::Never => false,
            Color::Auto => Stream::Output.is_terminal() && std::env::var_os("NO_COLOR").is_none(),
        };
        Self { json, color: is_wanted && !json, is_on_stderr: false }
    }

    /// Redirects to standard error if standard output is in use.
    pub fn on_stderr(self, is_stdout_used: bool) -> Self {
        if is_stdout_used {
            IS_STDOUT_USED.store(true, Ordering::Relaxed);
        }
        Self { is_on_stderr: is_stdout_used, color: self.color && !is_stdout_used, ..self }
    }

    pub fn has_color(&self) -> bool {
        self.color
    }

    pub fn stream(&self) -> CleanWriter {
        progress::clear();
        let stream = if self.is_on_stderr { Stream::Error } else { Stream::Output };
        let content = if self.json { Content::Json } else { Content::Text };
        CleanWriter::with_content(stream, content)
    }

    pub fn toned(&self, tone: Tone, text: impl std::fmt::Display) -> String {
        let start = match tone {
            Tone::Good => Sequence::Green,
            Tone::Warning => Sequence::Yellow,
            Tone::Bad => Sequence::Red,
            Tone::Faint => Sequence::Faint,
        };
        if self.color { format!("{start}{text}{}", Sequence::Reset) } else { text.to_string() }
    }

    /// Prints data as JSON with `--json`, else by `text`. A closed standard output is not an error: the
    /// exit status still reports the result.
    pub fn data<T: Serialize>(
        &self,
        data: &T,
        text: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result {
        let mut stream = self.stream();
        IS_STDOUT_USED.store(true, Ordering::Relaxed);
        let printed = if self.json {
            let printed = serde_json::to_writer_pretty(&mut stream, data);
            printed.map_err(io::Error::from).and_then(|()| writeln!(stream))
        } else {
            text(&mut stream)
        };
        unless_reader_gone(printed.and_then(|()| stream.flush()))
    }

    /// As [`data`](Self::data), for one or several items: JSON is a list only if `is_list`.
    pub fn one_or_list<T: Serialize>(
        &self,
        is_list: bool,
        data: &[T],
        text: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result {
        match data {
            [only] if !is_list => self.data(only, text),
            list => self.data(&list, text),
        }
    }

    pub fn bytes(&self, bytes: &[u8]) -> Result {
        let mut stream = self.stream();
        IS_STDOUT_USED.store(true, Ordering::Relaxed);
        unless_reader_gone(stream.write_all(bytes).and_then(|()| stream.flush()))
    }

    /// Prints a failure on standard output with `--json`, as one line: the last one of a stream of JSON
    /// lines. A document that was printed before reports the failure itself.
    pub fn failure(&self, error: &dyn Error, status: u8) {
        if !self.json || IS_STDOUT_USED.load(Ordering::Relaxed) {
            return;
        }
        let text = error.to_string();
        let mut causes = Vec::new();
        let mut cause = error.source();
        while let Some(it) = cause {
            causes.push(it.to_string());
            cause = it.source();
        }
        // Most messages contain that of their cause.
        causes.retain(|cause| !text.contains(cause));
        if let Ok(line) = serde_json::to_string(&FailureReport { error: text, status, causes }) {
            let mut stream = self.stream();
            let _ = writeln!(stream, "{line}").and_then(|()| stream.flush());
        }
    }

    /// Returns whether progress is printed: not with `--json`.
    pub fn has_progress(&self) -> bool {
        !self.json
    }

    /// Prints progress on standard error, except with `--json`.
    pub fn progress(&self, text: impl std::fmt::Display) {
        if !self.json {
            note(text);
        }
    }
}

/// True while a full-screen view uses the terminal.
static IS_FULL_SCREEN: AtomicBool = AtomicBool::new(false);

/// Discards notes while it exists, because a full-screen view uses the terminal.
pub struct FullScreen(());

impl FullScreen {
    pub fn begin() -> Self {
        IS_FULL_SCREEN.store(true, Ordering::Relaxed);
        Self(())
    }
}

impl Drop for FullScreen {
    fn drop(&mut self) {
        IS_FULL_SCREEN.store(false, Ordering::Relaxed);
    }
}

/// Prints a line on standard error.
pub fn note(text: impl std::fmt::Display) {
    if IS_FULL_SCREEN.load(Ordering::Relaxed) {
        return;
    }
    progress::clear();
    screen::print(Stream::Error, format_args!("{text}\n"));
}

fn unless_reader_gone(printed: io::Result<()>) -> Result {
    match printed.map_err(Failure::from) {
        Err(Failure::ReaderGone) => Ok(()),
        other => other,
    }
}
