//! The screens in docs/TOOL.md are what the program prints.
//!
//! In a block of kind `console` a line that begins with `$ ` is a command, the lines behind it are its
//! output and its error messages, `...` stands for any number of lines. A comment of one line
//! `<!-- $ command -->` prepares what a reader has anyway. All run in one directory, in their order.

use std::path::Path;
use std::process::Command;

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
        let prepares = line.strip_prefix("<!-- $ ").and_then(|it| it.strip_suffix(" -->"));
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

fn run(command: &str, directory: &Path) -> String {
    let programs = Path::new(env!("CARGO_BIN_EXE_ecan")).parent().unwrap();
    let path = std::env::var("PATH").unwrap();
    let output = Command::new("sh")
        .args(["-c", &format!("{{ {command}\n}} 2>&1")])
        .current_dir(directory)
        .env("PATH", format!("{}:{path}", programs.display()))
        .env("COLUMNS", "100")
        .env_remove("ECAN_ECRT")
        .output()
        .unwrap();
    let shown = String::from_utf8(output.stdout).unwrap();
    shown
        .lines()
        .filter(|line| !line.starts_with("SIMULATED"))
        // Commands of builds with further features.
        .filter(|line| !line.starts_with("  zenoh  "))
        .fold(String::new(), |text, line| text + line.trim_end() + "\n")
}

/// Returns whether the lines are those that are expected, with `...` for any number of lines.
fn fits(expected: &[&str], lines: &[&str]) -> bool {
    match (expected.split_first(), lines.split_first()) {
        (None, None) => true,
        (Some((&"...", rest)), _) => (0..=lines.len()).any(|skipped| fits(rest, &lines[skipped..])),
        (Some((wanted, expected)), Some((line, lines))) => wanted == line && fits(expected, lines),
        _ => false,
    }
}

#[test]
fn screens_of_tool_md_match_the_program() {
    let document =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/TOOL.md"))
            .unwrap();
    let directory = tempfile::tempdir().unwrap();
    let screens = screens(&document);
    assert!(screens.len() > 10, "{} screens", screens.len());
    let mut wrong = String::new();
    for screen in screens {
        let shown = run(screen.command, directory.path());
        let Some(expected) = screen.expected else { continue };
        if !fits(&expected, &shown.lines().collect::<Vec<_>>()) {
            let Screen { line, command, .. } = screen;
            wrong.push_str(&format!("docs/TOOL.md:{line}: $ {command}\n{shown}\n"));
        }
    }
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
