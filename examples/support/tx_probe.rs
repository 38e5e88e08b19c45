//! One numbered frame per cycle, sent directly or scheduled: the measurement of manual 13.9.

use std::error::Error;
use std::fmt;
use std::ops::Range;

use ecan_host::CycleStatistics;
use ecan_mcan_port::{
    ChannelHandle, Cycle, FrameRate, FrameStream, Port, PortError, ScheduleAccount, ScheduleFault,
    SendError, SendOptions, SendTicket,
};
use ecan_protocol::can::{CanFrame, CanId, FrameError};
use ecan_protocol::image::Schedule;

use crate::interrupt::Interrupt;
use crate::program::{IDLE_TIMEOUT_NS, STALL_TIMEOUT_NS};

/// CAN ID of the frames.
pub const PROBE_ID: u16 = 0x123;
/// Bytes of a classic frame and of a CAN FD frame.
const CLASSIC_BYTES: usize = 8;
const FD_BYTES: usize = 16;
/// Cycles without a frame before each measurement.
const SETTLE_CYCLES: u32 = 50;
/// Time to wait for the results of the gateway at the end, ns.
const ACCOUNT_NS: u64 = 2_000_000_000;

/// Transmission mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Sent by the gateway on arrival of the image.
    Direct,
    /// Sent by the gateway at a phase of Sync0.
    Scheduled {
        /// The phase after Sync0, in nanoseconds.
        offset_ns: u32,
    },
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Direct => f.write_str("direct"),
            Self::Scheduled { offset_ns } => {
                write!(f, "scheduled {} us", f64::from(*offset_ns) / 1e3)
            }
        }
    }
}

/// Target of the frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Target {
    /// Slave index.
    pub slave: usize,
    /// CAN channel.
    pub channel: u8,
    /// CAN FD frames with bit rate switch.
    pub is_fd: bool,
}

/// Results of a measurement on the host.
#[derive(Debug, Clone)]
pub struct ModeResult {
    /// Transmission mode.
    pub mode: Mode,
    /// Their numbers.
    pub numbers: Range<u64>,
    /// The cycles in which they were sent.
    pub statistics: CycleStatistics,
    /// The periods of these cycles, in nanoseconds.
    pub master_periods_ns: Vec<u64>,
    /// Start of the cycle of each frame, in nanoseconds of the library's clock.
    pub sent_ns: Vec<u64>,
    /// Temporary rejections; the frame was sent in a later cycle.
    pub rejected: u64,
    /// Results of scheduled frames; all 0 for others.
    pub account: ScheduleAccount,
    /// Reason of unknown results.
    pub schedule_fault: Option<ScheduleFault>,
    /// Cycles with an incomplete working counter.
    pub incomplete_cycles: u64,
}

impl Target {
    /// Sends the frame of a number.
    ///
    /// # Errors
    /// The frame was rejected.
    pub fn send(
        &self,
        cycle: &mut Cycle<'_>,
        mode: Mode,
        number: u64,
    ) -> Result<SendTicket, SendError> {
        let to = cycle.channel(self.slave, self.channel)?;
        let frame = self.frame(number)?;
        let schedule = match mode {
            Mode::Direct => None,
            Mode::Scheduled { offset_ns } => Some(Schedule { tag: number as u16, offset_ns }),
        };
        let options = SendOptions { schedule, ..SendOptions::default() };
        cycle.send_with(to, &frame, options)
    }

    /// The frame of a number.
    fn frame(&self, number: u64) -> Result<CanFrame, FrameError> {
        let mut bytes = [0; FD_BYTES];
        let (head, _) = bytes.split_at_mut(CLASSIC_BYTES);
        head.copy_from_slice(&number.to_le_bytes());
        match self.is_fd {
            true => CanFrame::fd(probe_id(), &bytes, true, false),
            false => CanFrame::classic(probe_id(), head),
        }
    }

    /// The frames of a measurement, sent directly, for a [`PortPlan`](ecan_mcan_port::PortPlan).
    ///
    /// # Errors
    /// An invalid frame.
    pub fn traffic(&self) -> Result<FrameStream, FrameError> {
        let Self { slave, channel, .. } = *self;
        Ok(FrameStream::to_bus(slave, channel, self.frame(0)?, FrameRate::PerCycle(1)))
    }

    /// Runs one cycle of a sweep, with a frame scheduled at this offset. The account contains a
    /// temporarily rejected one.
    ///
    /// # Errors
    /// The library failed.
    pub fn sweep_cycle(&self, port: &mut Port, offset_ns: u32) -> Result<(), PortError> {
        let mut cycle = port.begin_cycle();
        cycle.received().for_each(drop);
        let _ = self.send(&mut cycle, Mode::Scheduled { offset_ns }, 0);
        cycle.end()?;
        Ok(())
    }

    /// Sends the frames of these numbers, one per cycle, and waits for pending ones.
    ///
    /// # Errors
    /// Frames are rejected, or the library fails, for many cycles.
    pub fn measure(
        &self,
        port: &mut Port,
        mode: Mode,
        numbers: Range<u64>,
        interrupt: &Interrupt,
    ) -> Result<ModeResult, Box<dyn Error>> {
        let clock = port.adapter().ecrt().clock().clone();
        let cycle_ns = port.adapter().config().cycle_ns();
        let capacity = usize::try_from((numbers.end - numbers.start) * 2)?;
        let channel = port.channel(self.slave, self.channel)?;
        let account = port.schedule_account(channel);
        let incomplete_cycles = port.statistics(channel.gateway()).incomplete_cycles;
        let mut result = ModeResult {
            mode,
            numbers: numbers.clone(),
            statistics: CycleStatistics::new(cycle_ns),
            master_periods_ns: Vec::with_capacity(capacity),
            sent_ns: Vec::with_capacity(capacity),
            rejected: 0,
            account: ScheduleAccount::default(),
            schedule_fault: None,
            incomplete_cycles: 0,
        };
        for _ in 0..SETTLE_CYCLES {
            port.next_cycle().finish();
        }
        let mut number = numbers.start;
        let (mut last_sent_ns, mut begun_before) = (clock.now_ns(), None);
        while number < numbers.end && !interrupt.is_set() {
            port.wait_next_cycle();
            let start = port.adapter().cycle_start();
            result.statistics.begin(&start);
            let begun_ns = start.begun_ns();
            if let Some(before) = begun_before.replace(begun_ns)
                && result.master_periods_ns.len() < capacity
            {
                result.master_periods_ns.push(begun_ns - before);
            }
            let mut cycle = port.begin_cycle();
            cycle.received().for_each(drop);
            let sent = self.send(&mut cycle, mode, number);
            let ended = cycle.end();
            match sent {
                Ok(_) => {
                    result.sent_ns.push(begun_ns);
                    number += 1;
                    last_sent_ns = begun_ns;
                }
                Err(error)
                    if error.is_temporary()
                        && begun_ns.saturating_sub(last_sent_ns) < STALL_TIMEOUT_NS =>
                {
                    result.rejected += 1;
                }
                Err(error) => return Err(format!("no frame is accepted any more: {error}").into()),
            }
            ended?;
            result.statistics.end(clock.now_ns());
        }
        result.numbers.end = number;
        wait_for_account(port, channel, interrupt);
        let now = port.schedule_account(channel);
        result.account = difference(&now, &account);
        result.schedule_fault = port.schedule_fault(channel.gateway());
        result.incomplete_cycles =
            port.statistics(channel.gateway()).incomplete_cycles - incomplete_cycles;
        Ok(result)
    }
}

/// Runs the cycle until no frame is pending and the gateway has reported the results.
fn wait_for_account(port: &mut Port, channel: ChannelHandle, interrupt: &Interrupt) {
    let clock = port.adapter().ecrt().clock().clone();
    let start = clock.now_ns();
    loop {
        // Single cycles may fail; the timeout ends the wait.
        port.next_cycle().received().for_each(drop);
        let waited_ns = clock.now_ns().saturating_sub(start);
        let is_open = port.schedule_account(channel).open > 0;
        let is_over = waited_ns > IDLE_TIMEOUT_NS && !is_open || waited_ns > ACCOUNT_NS;
        if is_over || interrupt.is_set() {
            return;
        }
    }
}

/// CAN ID of the frames.
pub fn probe_id() -> CanId {
    CanId::standard(PROBE_ID).expect("it has 11 bits")
}

fn difference(now: &ScheduleAccount, before: &ScheduleAccount) -> ScheduleAccount {
    ScheduleAccount {
        scheduled: now.scheduled - before.scheduled,
        sent: now.sent - before.sent,
        queue_full: now.queue_full - before.queue_full,
        not_sent: now.not_sent - before.not_sent,
        withdrawn: now.withdrawn - before.withdrawn,
        unknown: now.unknown - before.unknown,
        open: now.open,
        rejected_late: now.rejected_late - before.rejected_late,
        without_margin: now.without_margin - before.without_margin,
        asked: now.asked - before.asked,
        accepted: now.accepted - before.accepted,
    }
}

/// Modes of a measurement, as an option.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Modes {
    /// Each frame on arrival at the gateway
    Direct,
    /// Each frame at its phase of Sync0
    Scheduled,
    /// One after the other
    Both,
}

impl Modes {
    /// Modes in turn, the scheduled one at this phase.
    pub fn modes(self, offset_ns: u32) -> Vec<Mode> {
        let scheduled = Mode::Scheduled { offset_ns };
        match self {
            Self::Direct => vec![Mode::Direct],
            Self::Scheduled => vec![scheduled],
            Self::Both => vec![Mode::Direct, scheduled],
        }
    }
}
