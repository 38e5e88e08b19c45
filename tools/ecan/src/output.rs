//! Terminal of the program: text for people, JSON for programs, tables, progress of long work, and questions to the
//! user.

use std::error::Error;
use std::io;
use std::io::{BufRead, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use ecan_tool_support::command_line::screen;
use ecan_tool_support::command_line::screen::{CleanWriter, Content, Sequence, Stream};
use serde::Serialize;

use crate::failure::{Failure, Result};
use crate::global::Color;

#[derive(Clone, Copy, Debug)]
pub struct Output {
    json: bool,
    color: bool,
    is_on_stderr: bool,
}

/// True after standard output has a JSON document or other data, to which none may be added.
static IS_STDOUT_USED: AtomicBool = AtomicBool::new(false);

/// Returns whether the bus of this run is simulated, once it is open.
static IS_SIMULATED: OnceLock<bool> = OnceLock::new();

/// States whether the bus of this run is simulated: each JSON document has it from now on.
pub fn set_simulated(is_simulated: bool) {
    // Of several buses, for example after a reconnection, the first one counts.
    let _ = IS_SIMULATED.set(is_simulated);
}

/// JSON of an object, or of each object of a list, pretty or in one line, with `is_simulated` as its first
/// field, unless it has this field or there is no bus.
pub fn with_simulated(json: String) -> String {
    let Some(is_simulated) = IS_SIMULATED.get() else { return json };
    mark(json, *is_simulated)
}

fn mark(json: String, is_simulated: bool) -> String {
    // Quotation marks in texts are escaped, and texts have no line breaks: the patterns match structure only.
    let field = |gap: &str| format!("\"is_simulated\":{gap}{is_simulated},");
    if json.contains("\"is_simulated\":") {
        json
    } else if json.starts_with("{\n") {
        json.replacen("{\n", &format!("{{\n  {}\n", field(" ")), 1)
    } else if json.starts_with("[\n") {
        json.replace("\n  {\n", &format!("\n  {{\n    {}\n", field(" ")))
    } else {
        json.replacen("{\"", &format!("{{{}\"", field("")), 1)
    }
}

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
        clear();
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
            let json = serde_json::to_string_pretty(data).map_err(io::Error::from);
            json.and_then(|json| writeln!(stream, "{}", with_simulated(json)))
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
            let _ = writeln!(stream, "{}", with_simulated(line)).and_then(|()| stream.flush());
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
    clear();
    screen::print_note(text);
}

fn unless_reader_gone(printed: io::Result<()>) -> Result {
    match printed.map_err(Failure::from) {
        Err(Failure::ReaderGone) => Ok(()),
        other => other,
    }
}

/// Prints a row per item with columns as wide as their widest cell; the last column is not padded.
pub fn print<T, const N: usize>(
    out: &mut dyn Write,
    items: impl IntoIterator<Item = T>,
    mut row: impl FnMut(T) -> [String; N],
) -> io::Result<()> {
    // A line break of a name does not begin a row.
    let cell = |text: String| text.replace('\n', "\\n").replace('\t', "\\t");
    let rows: Vec<_> = items.into_iter().map(|item| row(item).map(cell)).collect();
    let width = |column: usize| rows.iter().map(|row| screen::width(&row[column])).max();
    let widths: [usize; N] = std::array::from_fn(|column| width(column).unwrap_or(0));
    for row in &rows {
        let mut line = String::new();
        for (cell, width) in row.iter().zip(widths) {
            line.push_str(cell);
            let gap = (width + 2).saturating_sub(screen::width(cell));
            line.extend(std::iter::repeat_n(' ', gap));
        }
        writeln!(out, "{}", line.trim_end())?;
    }
    Ok(())
}

/// As [`print`], after a row of titles.
pub fn print_with_titles<T, const N: usize>(
    out: &mut dyn Write,
    titles: [&str; N],
    items: impl IntoIterator<Item = T>,
    row: impl FnMut(T) -> [String; N],
) -> io::Result<()> {
    let titles = [titles.map(str::to_owned)];
    print(out, titles.into_iter().chain(items.into_iter().map(row)), |row| row)
}

/// Text of a value in a table, `-` without one.
pub fn or_dash(value: Option<impl ToString>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| value.to_string())
}

/// Time after which the line appears.
const PATIENCE: Duration = Duration::from_secs(2);
const REDRAW: Duration = Duration::from_millis(200);

/// The terminal is one for all threads.
static LINE: Mutex<Option<Line>> = Mutex::new(None);

struct Line {
    subject: String,
    started: Instant,
    drawn: Option<Instant>,
    transfers: u32,
}

/// Shows the progress of SDO transfers until it is dropped; nothing unless standard error is a
/// terminal.
pub struct Progress(());

impl Progress {
    /// `subject`: what is done, for example "reading slave 0".
    pub fn show(subject: impl Into<String>) -> Self {
        if Stream::Error.is_terminal() {
            let line = Line {
                subject: subject.into(),
                started: Instant::now(),
                drawn: None,
                transfers: 0,
            };
            *lock() = Some(line);
        }
        Self(())
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        clear();
        *lock() = None;
    }
}

/// Counts an SDO transfer.
pub fn step() {
    let mut line = lock();
    let Some(line) = &mut *line else { return };
    line.transfers += 1;
    if line.started.elapsed() < PATIENCE || line.drawn.is_some_and(|drawn| drawn.elapsed() < REDRAW)
    {
        return;
    }
    line.drawn = Some(Instant::now());
    let Line { subject, transfers, started, .. } = line;
    let seconds = started.elapsed().as_secs();
    screen::print(
        Stream::Error,
        format_args!("{}{subject}: {transfers} transfers, {seconds} s", Sequence::ClearLine),
    );
}

/// Removes the line before other output; the next transfer shows it again.
pub fn clear() {
    if let Some(line) = &mut *lock()
        && line.drawn.take().is_some()
    {
        screen::print(Stream::Error, Sequence::ClearLine);
    }
}

fn lock() -> std::sync::MutexGuard<'static, Option<Line>> {
    LINE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Asks on the terminal, unless `--yes` was given. `what` is the action to confirm; `rejected`
/// states what was not done.
pub fn confirm(
    is_granted: bool,
    what: &str,
    question: std::fmt::Arguments<'_>,
    rejected: &str,
) -> Result {
    if is_granted {
        return Ok(());
    }
    let stdin = std::io::stdin();
    if !stdin.is_terminal() {
        return Err(Failure::Usage(format!("cannot ask for confirmation of {what}; use --yes")));
    }
    let mut screen = CleanWriter::new(Stream::Error);
    // If the question cannot be written, nothing is confirmed.
    let _ = write!(screen, "{question} [y/N] ").and_then(|()| screen.flush());
    let mut answer = String::new();
    stdin.lock().read_line(&mut answer).map_err(Failure::Input)?;
    match answer.trim() {
        "y" | "Y" | "yes" => Ok(()),
        _ => Err(Failure::Usage(format!("{rejected}: not confirmed"))),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    #[test]
    fn each_object_of_a_document_states_the_simulation() {
        let item = json!({ "name": "a \n{\"is\": 1}", "inner": [{ "n": 1 }] });
        let marked =
            |text: String| -> Value { serde_json::from_str(&super::mark(text, true)).unwrap() };
        let mut expected = item.clone();
        expected["is_simulated"] = true.into();
        let pretty = serde_json::to_string_pretty(&item).unwrap();
        assert_eq!(marked(pretty.clone()), expected);
        assert_eq!(marked(item.to_string()), expected);
        assert_eq!(super::mark(super::mark(pretty.clone(), true), true), super::mark(pretty, true));
        let list = serde_json::to_string_pretty(&[&item, &item]).unwrap();
        assert_eq!(marked(list), json!([expected, expected]));
        for text in ["[]", "{}", "[\n  1\n]"] {
            assert_eq!(super::mark(text.to_owned(), true), text);
        }
    }

    #[test]
    fn columns_are_aligned() {
        let rows = [["a", "long one", ""], ["bcd", "x", "end"]];
        let mut out = Vec::new();
        super::print(&mut out, rows, |row| row.map(str::to_owned)).unwrap();
        assert_eq!(String::from_utf8(out).unwrap(), "a    long one\nbcd  x         end\n");
    }
}
