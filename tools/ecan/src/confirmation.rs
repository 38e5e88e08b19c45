//! Asking before something that cannot be taken back.

use std::io::{BufRead, IsTerminal, Write};

use crate::failure::Failure;

/// Asks on the terminal, unless the user has said `--yes`. `what` is to be confirmed; `refused` says
/// what did not happen without.
///
/// # Errors
/// [`Failure::Usage`] where nobody is there to be asked, or the answer is no.
pub fn confirm(
    is_granted: bool,
    what: &str,
    question: std::fmt::Arguments<'_>,
    refused: &str,
) -> Result<(), Failure> {
    if is_granted {
        return Ok(());
    }
    let stdin = std::io::stdin();
    if !stdin.is_terminal() {
        let words = format!("nobody is there to confirm {what}; say --yes to do it without asking");
        return Err(Failure::Usage(words));
    }
    let mut stderr = std::io::stderr();
    // Where nobody can read the question nobody confirms it.
    let _ = write!(stderr, "{question} [y/N] ").and_then(|()| stderr.flush());
    let mut answer = String::new();
    stdin.lock().read_line(&mut answer).map_err(Failure::Input)?;
    match answer.trim() {
        "y" | "Y" | "yes" => Ok(()),
        _ => Err(Failure::Usage(format!("{refused}: not confirmed"))),
    }
}
