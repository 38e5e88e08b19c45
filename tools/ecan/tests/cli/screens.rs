//! The screens in screens/tool.txt, in docs/TOOL.md and in the pages of docs/guide are what the program prints.
//!
//! In a block of kind `console` a line that begins with `$ ` is a command, the lines after it are its
//! output and its error messages. A line `...` stands for any number of lines, `...` in a line for any
//! text. A command that ends in ` &` runs in the background until `kill %1`; its lines are those of its
//! start. A comment of one line `<!-- $ command -->` prepares what a reader has anyway. Those of a document
//! run in one directory, in their order. The banner of a simulation and the note on a service are left out.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use rustix::process::{Pid, Signal, kill_process};

use crate::support::timed_reader::TimedReader;
use ecan_test_support::{Killed, output};

struct Screen<'a> {
    line: usize,
    command: &'a str,
    /// None: it only prepares.
    expected: Option<Vec<&'a str>>,
}

fn screens(document: &str) -> Vec<Screen<'_>> {
    let mut screens: Vec<Screen<'_>> = Vec::new();
    let mut is_inside = false;
    for (index, line) in document.lines().enumerate() {
        let prepares = line.strip_prefix("<!-- $ ").and_then(|rest| rest.strip_suffix(" -->"));
        if line.starts_with("```") {
            is_inside = line == "```console";
        } else if let Some(command) = prepares {
            screens.push(Screen { line: index + 1, command, expected: None });
        } else if is_inside && let Some(command) = line.strip_prefix("$ ") {
            screens.push(Screen { line: index + 1, command, expected: Some(Vec::new()) });
        } else if is_inside {
            let last = screens.last_mut().expect("a screen begins with a command");
            last.expected.as_mut().expect("behind a command").push(line);
        }
    }
    screens
}

/// Runs the commands of the screens.
struct Shell {
    directory: PathBuf,
    background: Option<(Killed, TimedReader)>,
}

impl Shell {
    fn command(&self, script: &str) -> Command {
        let programs = Path::new(env!("CARGO_BIN_EXE_ecan")).parent().unwrap();
        let path = std::env::var("PATH").unwrap();
        let mut command = Command::new("sh");
        command
            .args(["-c", script])
            .current_dir(&self.directory)
            .env("PATH", format!("{}:{path}", programs.display()))
            .env("EXAMPLES", concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples"))
            .env("COLUMNS", "100")
            .env_remove("ECAN_ECRT");
        command
    }

    /// Returns the output of a command; of one in the background the first `lines`.
    fn run(&mut self, command: &str, lines: usize) -> String {
        if let Some(command) = command.strip_suffix(" &") {
            return self.start(command, lines);
        }
        if command == "kill %1" {
            let (mut child, mut reader) = self.background.take().expect("a background command");
            kill_process(Pid::from_child(&child), Signal::TERM).unwrap();
            let status = reader.end_of(&mut child);
            assert!(status.success(), "{status}: {}", reader.text());
            return String::new();
        }
        let output = output(&mut self.command(&format!("{{ {command}\n}} 2>&1")));
        let shown = String::from_utf8(output.stdout).unwrap();
        shown.lines().filter_map(shown_line).collect()
    }

    fn start(&mut self, command: &str, lines: usize) -> String {
        let mut command = self.command(&format!("exec {command} 2>&1"));
        let mut child = Killed::spawn(command.stdin(Stdio::null()).stdout(Stdio::piped()));
        let mut reader = TimedReader::new(child.stdout.take().unwrap());
        let line = || String::from_utf8(reader.through(b'\n')).unwrap();
        let read = std::iter::repeat_with(line).take_while(|line| !line.is_empty());
        let shown = read.filter_map(|line| shown_line(&line)).take(lines).collect();
        self.background = Some((child, reader));
        shown
    }
}

/// The line as the document has it, with a line break.
fn shown_line(line: &str) -> Option<String> {
    // Also commands of builds with further features.
    let is_left_out =
        ["SIMULATED", "via ", "  zenoh  "].iter().any(|prefix| line.starts_with(prefix));
    (!is_left_out).then(|| line.trim_end().to_owned() + "\n")
}

/// Returns whether the lines are those that are expected.
fn fits(expected: &[&str], lines: &[&str]) -> bool {
    match (expected.split_first(), lines.split_first()) {
        (None, None) => true,
        (Some((&"...", rest)), _) => (0..=lines.len()).any(|skipped| fits(rest, &lines[skipped..])),
        (Some((wanted, expected)), Some((line, lines))) => {
            line_fits(wanted, line) && fits(expected, lines)
        }
        _ => false,
    }
}

fn line_fits(wanted: &str, line: &str) -> bool {
    match wanted.split_once("...") {
        None => wanted == line,
        Some((start, rest)) => line.strip_prefix(start).is_some_and(|line| {
            let tails = line.char_indices().map(|(at, _)| &line[at..]).chain([""]);
            tails.into_iter().any(|tail| line_fits(rest, tail))
        }),
    }
}

/// Runs the screens of a document and adds those that differ. Returns their number.
fn run_document(document: &Path, wrong: &mut String) -> usize {
    let text = std::fs::read_to_string(document).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let mut shell = Shell { directory: directory.path().to_owned(), background: None };
    let screens = screens(&text);
    for screen in &screens {
        let Screen { line, command, expected } = screen;
        let shown = shell.run(command, expected.as_ref().map_or(0, Vec::len));
        let Some(expected) = expected else { continue };
        if !fits(expected, &shown.lines().collect::<Vec<_>>()) {
            wrong.push_str(&format!("{}:{line}: $ {command}\n{shown}\n", document.display()));
        }
    }
    screens.len()
}

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs")
}

#[test]
fn screens_of_each_command_match_the_program() {
    let screens = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/screens/tool.txt");
    let mut wrong = String::new();
    let count = run_document(&screens, &mut wrong);
    assert!(count > 80, "{count} screens");
    assert!(wrong.is_empty(), "the program prints:\n{wrong}");
}

#[test]
fn screens_of_tool_md_match_the_program() {
    let mut wrong = String::new();
    let count = run_document(&docs().join("TOOL.md"), &mut wrong);
    assert!(count > 10, "{count} screens");
    assert!(wrong.is_empty(), "the program prints:\n{wrong}");
}

#[test]
fn screens_of_the_guide_match_the_program() {
    let mut wrong = String::new();
    let mut count = 0;
    for entry in std::fs::read_dir(docs().join("guide")).unwrap() {
        count += run_document(&entry.unwrap().path(), &mut wrong);
    }
    assert!(count > 10, "{count} screens");
    assert!(wrong.is_empty(), "the program prints:\n{wrong}");
}

#[test]
fn dots_match_any_number_of_lines() {
    assert!(fits(&["a", "...", "d"], &["a", "b", "c", "d"]));
    assert!(fits(&["a", "...", "d"], &["a", "d"]));
    assert!(fits(&["..."], &[]));
    assert!(!fits(&["a", "...", "d"], &["a", "b"]));
    assert!(!fits(&["a"], &["a", "b"]));
}

#[test]
fn dots_in_a_line_match_any_text() {
    assert!(line_fits("... s: fault", "1.25 s: fault"));
    assert!(line_fits("from ... to ... at once", "from a to b to c at once"));
    assert!(line_fits("at ...", "at "));
    assert!(!line_fits("from ... to", "from a to b"));
    assert!(!line_fits("... s: fault", "1.25 s: fault 2"));
}
