//! Other programs: run to their end, or to a limit of time.

use std::io::Read;
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use thiserror::Error;

/// Between two looks at a program that has closed its output and runs on.
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// Why there is no output of a program.
#[derive(Debug, Error)]
pub enum RunError {
    /// It cannot be started, or not be waited for.
    #[error(transparent)]
    System(#[from] std::io::Error),
    /// It did not end in time, and was ended.
    #[error("it did not end within {} s, and was ended", .0.as_secs())]
    TimedOut(Duration),
}

/// Runs a program without input and collects what it prints. At the limit it is killed; what it
/// started itself is not.
///
/// # Errors
/// [`RunError`].
pub fn run(command: &mut Command, limit: Duration) -> Result<Output, RunError> {
    let deadline = Instant::now() + limit;
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn()?;
    match collect(&mut child, deadline) {
        Ok(Some(output)) => Ok(output),
        other => {
            // It may have ended just now. Nothing is left of it either way.
            let _ = child.kill();
            child.wait()?;
            other?;
            Err(RunError::TimedOut(limit))
        }
    }
}

/// What it printed, once it has ended; `None` at the deadline.
fn collect(child: &mut Child, deadline: Instant) -> std::io::Result<Option<Output>> {
    // Both at once: a pipe that nobody empties stops whoever writes to it.
    let stdout = drain(child.stdout.take())?;
    let stderr = drain(child.stderr.take())?;
    let left = || deadline.saturating_duration_since(Instant::now());
    let Ok(stdout) = stdout.recv_timeout(left()) else { return Ok(None) };
    let Ok(stderr) = stderr.recv_timeout(left()) else { return Ok(None) };
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(Output { status, stdout, stderr }));
        }
        if left().is_zero() {
            return Ok(None);
        }
        std::thread::sleep(LOOK_EVERY.min(left()));
    }
}

/// All that comes out of a pipe, once it is closed. The thread is not waited for: a program that was
/// killed may have left the pipe to others.
fn drain(pipe: Option<impl Read + Send + 'static>) -> std::io::Result<Receiver<Vec<u8>>> {
    let (sender, receiver) = channel();
    std::thread::Builder::new().name("pipe".to_owned()).spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut pipe) = pipe {
            // What was read before an error stays.
            let _ = pipe.read_to_end(&mut bytes);
        }
        let _ = sender.send(bytes);
    })?;
    Ok(receiver)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str) -> Command {
        let mut command = Command::new("/bin/sh");
        command.args(["-c", script]);
        command
    }

    const LONG: Duration = Duration::from_secs(600);

    #[test]
    fn what_a_program_prints_is_collected_however_much_it_is() {
        let both = "head -c 300000 /dev/zero; head -c 300001 /dev/zero >&2; exit 3";
        let output = run(&mut shell(both), LONG).unwrap();
        assert_eq!((output.stdout.len(), output.stderr.len()), (300_000, 300_001));
        assert_eq!(output.status.code(), Some(3));
    }

    #[test]
    fn a_program_that_does_not_end_is_ended() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("pid");
        let hangs = format!("echo $$ > {}; echo begun; exec sleep 1000", file.display());
        // Long enough for the shell to write its number.
        let ended = run(&mut shell(&hangs), Duration::from_secs(2));
        let error = ended.unwrap_err();
        assert!(matches!(error, RunError::TimedOut(_)), "{error}");
        assert_eq!(error.to_string(), "it did not end within 2 s, and was ended");
        let id = std::fs::read_to_string(file).unwrap();
        let process = std::path::Path::new("/proc").join(id.trim());
        assert!(!process.exists(), "it is killed and reaped");
    }

    #[test]
    fn a_program_that_closes_its_output_is_waited_for_and_ended() {
        let closes = "exec >&- 2>&-; exec sleep 1000";
        let ended = run(&mut shell(closes), Duration::from_millis(50));
        assert!(matches!(ended, Err(RunError::TimedOut(_))));
        let output = run(&mut shell("exec >&- 2>&-; sleep 0.01; exit 4"), LONG).unwrap();
        assert_eq!(output.status.code(), Some(4));
    }

    #[test]
    fn a_program_that_is_not_there_is_told() {
        let missing = run(&mut Command::new("/none/such"), LONG);
        assert!(matches!(missing, Err(RunError::System(_))));
    }
}
