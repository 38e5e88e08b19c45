use std::io::Read;
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use thiserror::Error;

/// Poll interval of a program that has closed its output.
const LOOK_EVERY: Duration = Duration::from_millis(5);

#[derive(Debug, Error)]
pub enum RunError {
    #[error(transparent)]
    System(#[from] std::io::Error),
    #[error("the program did not exit within {} s and was killed", .0.as_secs())]
    TimedOut(Duration),
}

/// Runs a program without input and collects its output. At the limit the program is killed, but
/// not its children.
pub fn run(command: &mut Command, limit: Duration) -> Result<Output, RunError> {
    let deadline = Instant::now() + limit;
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn()?;
    match collect(&mut child, deadline) {
        Ok(Some(output)) => Ok(output),
        other => {
            // It may have exited just now; either way it is reaped.
            let _ = child.kill();
            child.wait()?;
            other?;
            Err(RunError::TimedOut(limit))
        }
    }
}

/// Returns the output after the program exits; `None` at the deadline.
fn collect(child: &mut Child, deadline: Instant) -> std::io::Result<Option<Output>> {
    // Read both pipes in parallel: a full pipe blocks the program.
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

/// Reads a pipe until it is closed. The thread is not joined: children of a killed program may keep
/// the pipe open.
fn drain(pipe: Option<impl Read + Send + 'static>) -> std::io::Result<Receiver<Vec<u8>>> {
    let (sender, receiver) = channel();
    std::thread::Builder::new().name("pipe".to_owned()).spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut pipe) = pipe {
            // Keep what was read before an error.
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
    fn large_output_is_collected() {
        let both = "head -c 300000 /dev/zero; head -c 300001 /dev/zero >&2; exit 3";
        let output = run(&mut shell(both), LONG).unwrap();
        assert_eq!((output.stdout.len(), output.stderr.len()), (300_000, 300_001));
        assert_eq!(output.status.code(), Some(3));
    }

    #[test]
    fn hanging_program_is_killed() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("pid");
        let hangs = format!("echo $$ > {}; echo begun; exec sleep 1000", file.display());
        // Until a limit is long enough for the shell to write its process ID.
        let limits = [1, 2, 60].into_iter();
        let id = limits.map(Duration::from_secs).find_map(|limit| {
            let error = run(&mut shell(&hangs), limit).unwrap_err();
            assert!(matches!(error, RunError::TimedOut(_)), "{error}");
            let seconds = limit.as_secs();
            let expected = format!("the program did not exit within {seconds} s and was killed");
            assert_eq!(error.to_string(), expected);
            std::fs::read_to_string(&file).ok().filter(|id| id.ends_with('\n'))
        });
        let id = id.unwrap();
        let process = std::path::Path::new("/proc").join(id.trim());
        assert!(!process.exists(), "it is killed and reaped");
    }

    #[test]
    fn program_that_closes_its_output_is_waited_for() {
        let closes = "exec >&- 2>&-; exec sleep 1000";
        let ended = run(&mut shell(closes), Duration::from_millis(50));
        assert!(matches!(ended, Err(RunError::TimedOut(_))));
        let output = run(&mut shell("exec >&- 2>&-; sleep 0.01; exit 4"), LONG).unwrap();
        assert_eq!(output.status.code(), Some(4));
    }

    #[test]
    fn missing_program_returns_error() {
        let missing = run(&mut Command::new("/none/such"), LONG);
        assert!(matches!(missing, Err(RunError::System(_))));
    }
}
