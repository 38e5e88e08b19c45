//! The example `simple_loop` in the background, with its accounts at the end.

use std::time::Duration;

use nix::sys::signal::Signal;

use crate::bench::Bench;
use crate::child::{Finished, Running};
use crate::stop::{Stop, check};
use crate::table;

/// Time to become ready, and to end.
const LIMIT: Duration = Duration::from_secs(120);

/// More cycles than any step lasts.
const ENDLESS: &[&str] = &["--cycles", "1000000000"];

/// The running program.
pub struct RunningLoop {
    running: Running,
    gateways: u16,
}

/// Its end.
pub struct EndedLoop(Finished);

impl RunningLoop {
    /// Starts it with one channel of each gateway, and waits until the gateways are ready.
    pub fn start(bench: &mut Bench, gateways: u16) -> Result<Self, Stop> {
        Self::start_with(bench, gateways, ENDLESS)
    }

    /// As [`start`](Self::start), with these options.
    pub fn start_with(bench: &mut Bench, gateways: u16, options: &[&str]) -> Result<Self, Stop> {
        let mut running = Self::launch_with(bench, gateways, options)?;
        let at = running.running.wait_for("ready", bench.limit(LIMIT));
        match at {
            Ok(at) => bench.figure("ready_s", at.as_secs_f64()),
            Err(stop) => {
                let _ = running.end(bench);
                return Err(stop);
            }
        }
        Ok(running)
    }

    /// Starts it without waiting; it ends only by [`end`](Self::end) or [`kill`](Self::kill).
    pub fn launch(bench: &mut Bench, gateways: u16) -> Result<Self, Stop> {
        Self::launch_with(bench, gateways, ENDLESS)
    }

    fn launch_with(bench: &mut Bench, gateways: u16, options: &[&str]) -> Result<Self, Stop> {
        let slaves = gateways.to_string();
        let mut command = bench.cyclic_example("simple_loop", ["--slaves", &slaves]);
        command.args(options);
        Ok(Self { running: bench.start(command)?, gateways })
    }

    /// Waits until the gateways are ready for the first time.
    pub fn wait_ready(&mut self, bench: &Bench) -> Result<Duration, Stop> {
        self.running.wait_for("gateway(s) ready", bench.limit(LIMIT))
    }

    /// Number of lines so far, for [`wait_ready_again`](Self::wait_ready_again).
    pub fn mark(&mut self) -> usize {
        self.running.collect();
        self.running.lines.len()
    }

    /// Waits until every gateway is reported as ready after the mark; returns the time since then.
    pub fn wait_ready_again(&mut self, bench: &Bench, mark: usize) -> Result<Duration, Stop> {
        let begin = self.running.elapsed();
        for gateway in 0..self.gateways {
            let text = format!("slave {gateway}: ready");
            self.running.wait_for_next(&text, mark, bench.limit(LIMIT))?;
        }
        Ok(self.running.elapsed().saturating_sub(begin))
    }

    /// Ends it as Ctrl-C does.
    pub fn end(self, bench: &mut Bench) -> Result<EndedLoop, Stop> {
        let finished = self.running.stop(Signal::SIGINT, bench.limit(LIMIT))?;
        Ok(EndedLoop(bench.note(finished)))
    }

    /// Kills it, as the system does when memory runs out.
    pub fn kill(self, bench: &mut Bench) -> Result<(), Stop> {
        let finished = self.running.stop(Signal::SIGKILL, bench.limit(LIMIT))?;
        bench.note(finished);
        Ok(())
    }
}

impl EndedLoop {
    /// # Errors
    /// The program failed, or an account does not add up.
    pub fn expect_accounts(&self, gateways: u16) -> Result<(), Stop> {
        check(self.0.code() == Some(0), || self.0.end_text())?;
        expect_accounts(&self.0, gateways)
    }

    /// As [`expect_accounts`](Self::expect_accounts), after a replay: status 1 if frames of it have not
    /// returned.
    pub fn expect_accounts_of_replay(&self, gateways: u16) -> Result<(), Stop> {
        check(matches!(self.0.code(), Some(0 | 1)), || self.0.end_text())?;
        expect_accounts(&self.0, gateways)
    }

    /// # Errors
    /// A frame of channel 0 is missing, apart from those of the last cycles.
    pub fn expect_complete(&self, gateways: u16) -> Result<(), Stop> {
        /// Frames in flight at the end.
        const IN_TRANSIT: u64 = 8;
        self.expect_accounts(gateways)?;
        let output = self.0.output();
        for gateway in 0..gateways {
            let row = format!("slave {gateway} can0");
            let sent = table::number(&output, "accepted", &row);
            let received = table::number(&output, "received", &row);
            let is_complete = matches!((sent, received), (Some(sent), Some(received))
                if received + IN_TRANSIT >= sent && received <= sent && sent > 0);
            check(is_complete, || {
                format!("{row}: sent {sent:?}, received {received:?}: {}", self.0.end_text())
            })?;
        }
        Ok(())
    }
}

/// Every accepted frame is delivered, lost, discarded, unknown or pending.
///
/// # Errors
/// The program sent nothing, or the accounts of a channel do not add up.
pub fn expect_accounts(finished: &Finished, gateways: u16) -> Result<(), Stop> {
    let output = finished.output();
    for gateway in 0..gateways {
        let row = format!("slave {gateway} can0");
        let count = |name: &str| table::number(&output, name, &row);
        let Some(accepted) = count("accepted").filter(|accepted| *accepted > 0) else {
            return Err(Stop::Failed(format!("{row}: no frame sent: {}", finished.end_text())));
        };
        let parts = ["delivered", "lost", "discarded", "unknown", "pending"];
        let parts = parts.map(|name| (name, count(name)));
        let sum: Option<u64> = parts.iter().map(|(_, count)| *count).sum();
        check(sum == Some(accepted), || {
            format!("{row}: accepted {accepted}, but {parts:?}: {}", finished.end_text())
        })?;
    }
    Ok(())
}
