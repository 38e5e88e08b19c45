use std::io::{BufRead, IsTerminal, Write};

use ecan_tool_support::command_line::screen::{CleanWriter, Stream};

use crate::context::{Failure, Result};

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
