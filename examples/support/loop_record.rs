//! Observations of a loop: returned frames, bus loads, sessions, log file and progress.

use std::collections::VecDeque;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

use ecan_host::Clock;
use ecan_mcan_port::{BusWatch, Port, ReceivedView};
use ecan_protocol::can::CanFrame;
use ecan_protocol::mapping::CHANNELS;
use ecan_tool_support::command_line::screen::{Stream, print};
use ecan_tool_support::{print_error_line, print_line};
use indicatif::ProgressBar;

use crate::frame_source::Source;
use crate::program::{IDLE_TIMEOUT_NS, STALL_TIMEOUT_NS};
use crate::summary::BusLoad;
use crate::{log_file, program, real_time, summary};

/// Minimum number of cycles without a frame before the loop ends.
const IDLE_CYCLES: u64 = 20;

/// Observations of a loop. Channels are numbered over all gateways.
pub struct LoopRecord {
    check: EchoCheck,
    loads: Vec<BusLoad>,
    watch: BusWatch,
    dump: Option<log_file::Writer>,
    progress: ProgressBar,
    clock: Arc<dyn Clock>,
    start_ns: u64,
    last_frame_ns: u64,
    cycle_ns: u64,
}

impl LoopRecord {
    /// Starts now; returned frames are written to `dump`.
    ///
    /// # Errors
    /// The log file cannot be created.
    pub fn new(
        port: &Port,
        source: &Source,
        dump: Option<&Path>,
    ) -> Result<Self, log_file::LogFileError> {
        let channels = port.slave_count() * CHANNELS;
        let clock = port.adapter().ecrt().clock().clone();
        Ok(Self {
            check: EchoCheck::new(channels),
            loads: vec![BusLoad::default(); channels],
            watch: BusWatch::new(port),
            dump: dump.map(log_file::Writer::create).transpose()?,
            progress: program::bar(source.total()),
            start_ns: clock.now_ns(),
            last_frame_ns: 0,
            cycle_ns: u64::from(port.adapter().config().cycle_ns()),
            clock,
        })
    }

    /// Time since the start, ns.
    pub fn elapsed_ns(&self) -> u64 {
        self.clock.now_ns() - self.start_ns
    }

    /// Adds an item that the cycle received.
    ///
    /// # Errors
    /// The log file cannot be written.
    pub fn received(
        &mut self,
        source: &Source,
        item: &ReceivedView<'_>,
    ) -> Result<(), log_file::LogFileError> {
        let ReceivedView::Frame { slave, packet } = item else { return Ok(()) };
        let channel = slave * CHANNELS + usize::from(packet.channel);
        let frame = packet.frame.to_owned();
        self.check.received(channel, &frame);
        self.loads[channel].add(&frame);
        self.last_frame_ns = self.elapsed_ns();
        match &mut self.dump {
            Some(dump) => dump.write(source.log_time(self.last_frame_ns), channel, frame),
            None => Ok(()),
        }
    }

    /// Adds a frame that the Port accepted.
    pub fn sent(&mut self, channel: usize, frame: CanFrame) {
        self.check.sent(channel, frame);
        self.loads[channel].add(&frame);
        self.last_frame_ns = self.elapsed_ns();
    }

    /// Prints what changed at gateways and channels in the cycle. Returns whether the loop is over:
    /// all frames have returned, none arrives any more, or the gateway accepts none.
    pub fn end_cycle(&mut self, port: &Port, source: &Source, is_sending: bool) -> bool {
        let now_ns = self.elapsed_ns();
        for change in self.watch.changes(port) {
            self.progress.suspend(|| print_line!("{change}"));
        }
        self.progress.set_position(source.done());
        let idle_ns = now_ns - self.last_frame_ns;
        // A gap of the recording is not a stall.
        let stalled_ns =
            source.next_due_ns().map(|due| now_ns.saturating_sub(due.max(self.last_frame_ns)));
        let is_idle = idle_ns > IDLE_TIMEOUT_NS.max(IDLE_CYCLES * self.cycle_ns);
        stalled_ns.is_some_and(|ns| ns > STALL_TIMEOUT_NS)
            || !is_sending && (is_idle || self.check.pending() == 0 && !has_pending_frames(port))
    }

    /// Closes the log file and prints the summary.
    ///
    /// # Errors
    /// The log file cannot be written.
    pub fn print_summary(&mut self, port: &Port) -> Result<(), Box<dyn Error>> {
        self.progress.finish_and_clear();
        if let Some(dump) = self.dump.take() {
            dump.finish()?;
        }
        print(Stream::Output, summary::table(port, self.elapsed_ns(), &self.loads));
        if let Some(statistics) = port.adapter().cycle_statistics() {
            real_time::print_statistics(port.adapter(), statistics);
        }
        Ok(())
    }

    /// Prints the result of a replay. Returns whether every frame returned unchanged and in order.
    pub fn print_replay_result(&self, port: &Port, source: &Source) -> bool {
        let (sent, returned) = self.check.counts();
        let mut faults: Vec<String> =
            self.check.first_difference().map(String::from).into_iter().collect();
        if !source.is_done() {
            faults.push(format!("{} frames were not sent", source.total() - source.done()));
        }
        if self.check.pending() > 0 {
            faults.push(format!("{} frames did not return", self.check.pending()));
        }
        for gateway in port.gateways() {
            let statistics = port.statistics(gateway);
            let errors = statistics.parse_errors + statistics.txpdo_torn;
            let lost = statistics.txpdo_lost + statistics.txpdo_unknown;
            if errors + lost > 0 {
                let text = format!("{errors} image errors, {lost} images lost or unknown");
                faults.push(format!("{gateway}: {text}"));
            }
            if !port.gateway_is_ready(gateway) {
                faults.push(format!("{gateway}: {}", port.session(gateway)));
            }
        }
        print_line!("\nreplay: {sent} frames sent, {returned} returned");
        if faults.is_empty() {
            print_line!("replay: all frames unchanged and in order");
        }
        for fault in &faults {
            print_error_line!("simple_loop: {fault}");
        }
        faults.is_empty()
    }
}

/// Returns whether the delivery of a frame is not proven yet.
fn has_pending_frames(port: &Port) -> bool {
    port.gateways()
        .any(|at| port.statistics(at).channels.iter().any(|channel| channel.frames_pending > 0))
}

/// Expects every frame back on its channel, unchanged and in order. Channels are numbered over all
/// gateways.
#[derive(Debug, Default)]
struct EchoCheck {
    pending: Vec<VecDeque<CanFrame>>,
    sent: u64,
    returned: u64,
    first_difference: Option<String>,
}

impl EchoCheck {
    fn new(channels: usize) -> Self {
        Self { pending: vec![VecDeque::new(); channels], ..Self::default() }
    }

    fn sent(&mut self, channel: usize, frame: CanFrame) {
        self.sent += 1;
        if let Some(queue) = self.pending.get_mut(channel) {
            queue.push_back(frame);
        }
    }

    /// Compares a returned frame with the oldest pending one of its channel.
    fn received(&mut self, channel: usize, frame: &CanFrame) {
        self.returned += 1;
        let expected = self.pending.get_mut(channel).and_then(VecDeque::pop_front);
        if expected.as_ref() != Some(frame) && self.first_difference.is_none() {
            let expected = expected.map_or_else(|| "none".into(), |f| format!("{f:?}"));
            self.first_difference = Some(format!(
                "frame {} on can{channel}: received {frame:?}, expected {expected}",
                self.returned
            ));
        }
    }

    fn pending(&self) -> usize {
        self.pending.iter().map(VecDeque::len).sum()
    }

    fn counts(&self) -> (u64, u64) {
        (self.sent, self.returned)
    }

    fn first_difference(&self) -> Option<&str> {
        self.first_difference.as_deref()
    }
}
