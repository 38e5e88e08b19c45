//! Circumstances of a run, for reports and pictures.

use std::fmt;

use jiff::{Timestamp, Unit};

/// Date, program, kernel and command line of this run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunInfo {
    date: String,
    program: String,
    kernel: String,
    command_line: String,
}

impl RunInfo {
    /// Reads the circumstances of this process; `program` and `version` are those of the program.
    pub fn of_this_run(program: &str, version: &str) -> Self {
        let now = Timestamp::now();
        let kernel = rustix::system::uname();
        let part = |text: &std::ffi::CStr| text.to_string_lossy().into_owned();
        let mut arguments = std::env::args_os();
        // The program without the path of this machine.
        let _ = arguments.next();
        let arguments = arguments.map(|argument| quoted(&argument.to_string_lossy()));
        let command_line =
            std::iter::once(program.to_owned()).chain(arguments).collect::<Vec<_>>().join(" ");
        Self {
            date: now.round(Unit::Second).unwrap_or(now).to_string(),
            program: format!("{program} {version}"),
            kernel: format!(
                "{} {} {}",
                part(kernel.sysname()),
                part(kernel.release()),
                part(kernel.machine())
            ),
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

/// Quotes an argument if a shell would split or expand it.
fn quoted(argument: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_=+./:,@%".contains(c);
    match !argument.is_empty() && argument.chars().all(is_plain) {
        true => argument.to_owned(),
        false => format!("'{}'", argument.replace('\'', "'\\''")),
    }
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
    }
}
