//! Circumstances of a run, for reports and pictures.

use std::fmt;

use ecan_host::ECRT_VARIABLE;
use jiff::{Timestamp, Unit};

/// Date, program, kernel and command line of this run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunInfo {
    date: String,
    program: String,
    kernel: String,
    /// Program and arguments as the user typed them.
    words: Vec<String>,
    command_line: String,
}

impl RunInfo {
    /// Reads the circumstances of this process; `program` and `version` are those of the program.
    pub fn of_this_run(program: &str, version: &str) -> Self {
        let now = Timestamp::now();
        let kernel = rustix::system::uname();
        let part = |text: &std::ffi::CStr| text.to_string_lossy().into_owned();
        // The program without the path of this machine.
        let arguments = std::env::args_os().skip(1);
        let arguments = arguments.map(|argument| argument.to_string_lossy().into_owned());
        let words: Vec<_> = std::iter::once(program.to_owned()).chain(arguments).collect();
        let words = with_environment(words, std::env::var(ECRT_VARIABLE).ok());
        let command_line = words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ");
        Self {
            date: now.round(Unit::Second).unwrap_or(now).to_string(),
            program: format!("{program} {version}"),
            kernel: format!(
                "{} {} {}",
                part(kernel.sysname()),
                part(kernel.release()),
                part(kernel.machine())
            ),
            words,
            command_line,
        }
    }

    /// Date and time of the report, UTC: `2026-11-24T10:20:30Z`.
    pub fn date(&self) -> &str {
        &self.date
    }

    /// Program and version.
    pub fn program(&self) -> &str {
        &self.program
    }

    /// System, release and machine of the kernel.
    pub fn kernel(&self) -> &str {
        &self.kernel
    }

    /// Command line, quoted for a shell.
    pub fn command_line(&self) -> &str {
        &self.command_line
    }

    /// Returns the command line in lines of this number of characters, which a shell reads as one.
    pub fn command_lines(&self, most: usize) -> Vec<String> {
        continued(&self.words, most)
    }

    /// Names and values, in the order of a report.
    pub fn rows(&self) -> [(&'static str, &str); 4] {
        [
            ("date", self.date()),
            ("program", self.program()),
            ("kernel", self.kernel()),
            ("command line", self.command_line()),
        ]
    }
}

impl fmt::Display for RunInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (number, (name, value)) in self.rows().into_iter().enumerate() {
            let separator = if number == 0 { "" } else { "\n" };
            write!(f, "{separator}{name}: {value}")?;
        }
        Ok(())
    }
}

/// Adds the environment variable of the master library, unless an argument selects the library.
fn with_environment(words: Vec<String>, setting: Option<String>) -> Vec<String> {
    let is_option = |word: &String| word == "--ecrt" || word.starts_with("--ecrt=");
    let setting = setting.filter(|value| !value.is_empty() && !words.iter().any(is_option));
    let variable = setting.map(|value| format!("{ECRT_VARIABLE}={value}"));
    variable.into_iter().chain(words).collect()
}

/// Quotes an argument if a shell would split or expand it.
pub fn quoted(argument: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_=+./:,@%#".contains(c);
    // A comment begins with `#` in front of a word.
    if !argument.is_empty() && argument.chars().all(is_plain) && !argument.starts_with('#') {
        return argument.to_owned();
    }
    // A shell sets a variable only if its name is not quoted.
    if let Some((name, value)) = argument.split_once('=')
        && name.starts_with(|c: char| c.is_ascii_uppercase())
        && name.chars().all(|c| c.is_ascii_uppercase() || c == '_')
    {
        return format!("{name}={}", quoted(value));
    }
    if argument.chars().any(char::is_control) {
        // The quotes of bash with escapes keep the text on one line.
        let escaped = argument.chars().map(|character| match character {
            '\'' | '\\' => format!("\\{character}"),
            _ if character.is_control() => format!("\\u{:04x}", u32::from(character)),
            _ => character.to_string(),
        });
        return format!("$'{}'", escaped.collect::<String>());
    }
    format!("'{}'", argument.replace('\'', "'\\''"))
}

/// Quotes words, and breaks lines by `\` between them. A word that is longer than a line is broken into
/// parts, which a shell joins again.
fn continued(words: &[String], most: usize) -> Vec<String> {
    // A line ends with a space and `\`; quotes may double the length of a part.
    let most = most.saturating_sub(2).max(8);
    let mut lines = vec![String::new()];
    for (number, word) in words.iter().enumerate() {
        let whole = quoted(word);
        let characters: Vec<char> = word.chars().collect();
        let parts = match whole.chars().count() > most {
            true => characters
                .chunks(most / 4)
                .map(|part| quoted(&part.iter().collect::<String>()))
                .collect(),
            false => vec![whole],
        };
        for (nth, part) in parts.iter().enumerate() {
            let separator = if number > 0 && nth == 0 { " " } else { "" };
            if let Some(line) = lines.last_mut() {
                let length = line.chars().count() + separator.len() + part.chars().count();
                if length > most {
                    line.push_str(separator);
                    line.push('\\');
                    lines.push(part.clone());
                } else {
                    line.push_str(separator);
                    line.push_str(part);
                }
            }
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn run_has_date_program_and_kernel() {
        let run = RunInfo::of_this_run("demo", "1.2.3");
        assert!(run.date().parse::<Timestamp>().is_ok(), "{run}");
        assert!(run.date().len() == "2026-11-24T10:20:30Z".len(), "whole seconds: {run}");
        assert_eq!(run.program(), "demo 1.2.3");
        assert!(run.kernel().starts_with("Linux ") && run.command_line().starts_with("demo"));
    }

    #[test]
    fn arguments_are_quoted_where_a_shell_needs_it() {
        assert_eq!(quoted("--ecrt=sim:a/b.toml"), "--ecrt=sim:a/b.toml");
        assert_eq!(quoted("two words"), "'two words'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
        assert_eq!(quoted(""), "''");
        assert_eq!(quoted("a\nb"), "$'a\\u000ab'");
    }

    #[test]
    fn command_line_has_the_variable_of_the_library() {
        let words =
            |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>();
        let command = |arguments: &[&str], setting: Option<&str>| {
            with_environment(words(arguments), setting.map(str::to_owned))
                .iter()
                .map(|word| quoted(word))
                .collect::<Vec<_>>()
                .join(" ")
        };
        assert_eq!(command(&["demo", "-v"], Some("sim:a b")), "ECAN_ECRT='sim:a b' demo -v");
        assert_eq!(command(&["demo", "--ecrt", "sim"], Some("x")), "demo --ecrt sim");
        assert_eq!(command(&["demo"], None), "demo");
    }

    #[test]
    fn continued_lines_are_the_command_for_a_shell() {
        let long = format!("it's {}", "a long name ".repeat(20));
        let words = ["printf", "%s|", "--plot", "two words", &long, "", "a.svg"].map(str::to_owned);
        let lines = continued(&words, 40);
        assert!(
            lines.len() > 5 && lines.iter().all(|line| line.chars().count() <= 40),
            "{lines:?}"
        );
        let shell = std::process::Command::new("sh").arg("-c").arg(lines.join("\n")).output();
        let printed = String::from_utf8(shell.unwrap().stdout).unwrap();
        assert_eq!(printed, format!("--plot|two words|{long}||a.svg|"));
        assert_eq!(continued(&words[..2], 40), ["printf '%s|'"]);
    }
}
