//! The simulated gateways on the wire, with their own counters.

use std::process::Command;
use std::time::Duration;

use ecan_tool_support::command_line::interrupt::Interrupt;
use nix::sys::signal::Signal;

use crate::child::{Finished, Running};
use crate::stop::Stop;

/// `ecan-sim wire` in a process.
#[derive(Debug)]
pub struct Slave(Running);

/// Counters that the gateways print at their end.
#[derive(Debug, Clone)]
pub struct SlaveReport(pub Finished);

impl Slave {
    /// Starts it and waits until the gateways have booted.
    pub fn start(
        command: Command,
        gateways: u16,
        limit: Duration,
        interrupt: &Interrupt,
    ) -> Result<Self, Stop> {
        let mut running = Running::start(command, interrupt)?;
        if let Some(last) = gateways.checked_sub(1) {
            running.wait_for(&format!("gateway {last}: booted"), limit)?;
        }
        Ok(Self(running))
    }

    /// Number of lines with this text so far.
    pub fn count_lines(&mut self, text: &str) -> usize {
        self.0.collect();
        self.0.lines.iter().filter(|line| line.text.contains(text)).count()
    }

    /// Returns whether the last change of state of this gateway led to PREOP.
    pub fn is_in_preop(&mut self, gateway: u16) -> bool {
        self.0.collect();
        let name = format!("gateway {gateway}: ");
        let is_change = |text: &&str| text.contains(&name) && text.contains(" -> ");
        let last = self.0.lines.iter().rev().map(|line| line.text.as_str()).find(is_change);
        last.is_some_and(|text| text.ends_with("-> PREOP"))
    }

    pub fn is_running(&mut self) -> bool {
        self.0.is_running()
    }

    /// Its output, after an unexpected end.
    pub fn ended(self) -> Result<Finished, Stop> {
        self.0.finish(Duration::ZERO)
    }

    /// Stops and continues the whole process: no frame returns in between.
    pub fn signal(&self, signal: Signal) {
        self.0.signal(signal);
    }

    /// Ends it; its counters follow.
    pub fn stop(self, limit: Duration) -> Result<SlaveReport, Stop> {
        self.0.stop(Signal::SIGINT, limit)?.expect(0).map(SlaveReport)
    }
}

impl SlaveReport {
    fn line(&self, start: &str) -> Option<&str> {
        let line = self.0.lines.iter().rev().find(|line| line.text.starts_with(start))?;
        Some(&line.text)
    }

    /// Number before these words in the last line that begins like this.
    fn number(&self, start: &str, words: &str) -> Option<u64> {
        let line = self.line(start)?;
        let before = &line[..line.find(&format!(" {words}"))?];
        before.rsplit(' ').next()?.parse().ok()
    }

    /// Frames that the channel of a gateway has sent to its bus.
    pub fn sent_to_bus(&self, gateway: u16, channel: u16) -> Option<u64> {
        self.number(&format!("  can{channel} on bus {gateway}.{channel}:"), "sent")
    }

    /// Frames that the channel of a gateway has received from its bus.
    pub fn received_from_bus(&self, gateway: u16, channel: u16) -> Option<u64> {
        self.number(&format!("  can{channel} on bus {gateway}.{channel}:"), "received")
    }

    /// Frames of the master that were no EtherCAT frames.
    pub fn faulty_frames(&self) -> Option<u64> {
        self.number("frames:", "faulty")
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::process::ExitStatusExt;
    use std::process::ExitStatus;

    use super::*;
    use crate::child::{Line, Stream};

    #[test]
    fn unexpected_end_is_reported_with_its_output() {
        let mut command = Command::new("sh");
        command.args(["-c", "echo fault >&2; exit 3"]);
        let limit = Duration::from_secs(60);
        let mut slave = Slave::start(command, 0, limit, &Interrupt::default()).unwrap();
        while slave.is_running() {
            std::thread::yield_now();
        }
        let text = slave.ended().unwrap().end_text();
        assert!(text.contains("exit status 3") && text.contains("fault"), "{text}");
    }

    #[test]
    fn counters_are_read_from_the_summary() {
        let text = "\
frames: 1200 EtherCAT, 3 faulty, 0 foreign, 0 lost; 0 dropped by the system, 0 answers not sent
gateway 0: PREOP, 100 images received, 99 sent, 10 frames to the buses, 11 from them
  can0 on bus 0.0: 10 sent, 11 received, 0 error frames on the bus
  can1 on bus 0.1: 0 sent, 0 received, 0 error frames on the bus";
        let line =
            |text: &str| Line { at: Duration::ZERO, stream: Stream::Output, text: text.to_owned() };
        let report = SlaveReport(Finished {
            command: String::new(),
            status: ExitStatus::from_raw(0),
            seconds: 0.0,
            lines: text.lines().map(line).collect(),
        });
        assert_eq!(report.faulty_frames(), Some(3));
        assert_eq!(
            (report.sent_to_bus(0, 0), report.received_from_bus(0, 0)),
            (Some(10), Some(11))
        );
        assert_eq!((report.sent_to_bus(0, 1), report.sent_to_bus(1, 0)), (Some(0), None));
    }
}
