//! Frames that a loop sends: a counter or a recording.

use ecan_can_io::recording::LoggedFrame;
use ecan_mcan_port::{Cycle, FrameRate, FrameStream, OkOrTemporary, PortConfig, SendError};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::mapping::{CHANNELS, Direction};

/// Selection of the channels of each gateway.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channels {
    /// One channel.
    One(u8),
    /// All of them.
    All,
}

impl Channels {
    /// Returns true if the selection contains the channel.
    pub fn contains(self, channel: u8) -> bool {
        match self {
            Self::One(one) => one == channel,
            Self::All => true,
        }
    }

    /// Selected channels of a configuration, ordered by gateway and channel.
    pub fn targets(self, config: &PortConfig) -> Vec<Target> {
        let mut targets = Vec::new();
        for (slave, gateway) in config.gateways.iter().enumerate() {
            for (channel, settings) in (0..).zip(&gateway.channels) {
                let is_chosen =
                    self.contains(channel) && gateway.carries(Direction::RxPdo, channel);
                if let Some(settings) = settings.as_ref().filter(|_| is_chosen) {
                    targets.push(Target { slave, channel, is_fd: settings.can.fd });
                }
            }
        }
        targets
    }

    /// Gateway and channel of a recorded frame. If all channels are selected, `canN` is channel N
    /// counted over all gateways, otherwise every frame goes to the first target.
    pub fn target_of(self, interface: &str, targets: &[Target], gateways: usize) -> (usize, u8) {
        let index = match self {
            Self::One(_) => targets.first().map_or(0, |first| first.index()),
            Self::All => {
                let digits = interface.trim_start_matches(|c: char| !c.is_ascii_digit());
                digits.parse::<usize>().unwrap_or(0) % (gateways * CHANNELS).max(1)
            }
        };
        (index / CHANNELS, (index % CHANNELS) as u8)
    }
}

/// Channel that receives frames of the source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Target {
    /// Slave index.
    pub slave: usize,
    /// Channel, 0 to 3.
    pub channel: u8,
    /// CAN FD instead of classic CAN.
    pub is_fd: bool,
}

impl Target {
    /// Channel number counted over all gateways.
    pub fn index(self) -> usize {
        self.slave * CHANNELS + usize::from(self.channel)
    }
}

/// Recorded frame and its target.
#[derive(Debug, Clone)]
pub struct RecordedFrame {
    /// Target.
    pub target: Target,
    /// Frame.
    pub logged: LoggedFrame,
}

/// Source of the frames that are due in a cycle.
#[derive(Debug)]
pub enum Source {
    /// One frame per channel and cycle that contains the cycle number.
    Counter {
        /// CAN ID of the frames.
        id: CanId,
        /// Targets: CAN FD frames have 64 bytes, classic ones 8.
        targets: Vec<Target>,
        /// Number of cycles.
        cycles: u64,
        /// Cycles done.
        done: u64,
    },
    /// Frames of a recording, each at its time or later.
    Recording {
        /// Recording.
        frames: Vec<RecordedFrame>,
        /// Frames sent.
        done: usize,
    },
}

impl Source {
    /// Total number of steps: cycles or frames.
    pub fn total(&self) -> u64 {
        match self {
            Self::Counter { cycles, .. } => *cycles,
            Self::Recording { frames, .. } => frames.len() as u64,
        }
    }

    /// Steps done.
    pub fn done(&self) -> u64 {
        match self {
            Self::Counter { done, .. } => *done,
            Self::Recording { done, .. } => *done as u64,
        }
    }

    /// Returns true if all frames were sent.
    pub fn is_done(&self) -> bool {
        self.done() >= self.total()
    }

    /// Timestamp of a log line `elapsed_ns` after the start; continues the time of the recording.
    pub fn log_time(&self, elapsed_ns: u64) -> u64 {
        match self {
            Self::Counter { .. } => elapsed_ns,
            Self::Recording { frames, .. } => start_ns(frames) + elapsed_ns,
        }
    }

    /// Due time of the next frame of a recording, ns after the start.
    pub fn next_due_ns(&self) -> Option<u64> {
        let Self::Recording { frames, done } = self else { return None };
        let next = frames.get(*done)?;
        Some(next.logged.time_ns.saturating_sub(start_ns(frames)))
    }

    /// Traffic for a plan: each frame is sent and received. Frames of a recording are distributed evenly
    /// over its length.
    ///
    /// # Errors
    /// The counter frame is invalid.
    pub fn traffic(&self) -> Result<Vec<FrameStream>, SendError> {
        let mut sent = Vec::new();
        match self {
            Self::Counter { id, targets, .. } => {
                for Target { slave, channel, is_fd } in targets {
                    let frame = counter_frame(*id, *is_fd, 0)?;
                    let rate = FrameRate::PerCycle(1);
                    sent.push(FrameStream::to_bus(*slave, *channel, frame, rate));
                }
            }
            Self::Recording { frames, .. } => {
                let last_ns = frames.last().map_or(0, |last| last.logged.time_ns);
                let seconds = last_ns.saturating_sub(start_ns(frames)) as f64 / 1e9;
                for (target, frame, count) in kinds(frames) {
                    let rate = if seconds > 0.0 {
                        FrameRate::PerSecond(f64::from(count) / seconds)
                    } else {
                        FrameRate::PerCycle(count)
                    };
                    sent.push(FrameStream::to_bus(target.slave, target.channel, frame, rate));
                }
            }
        }
        let received: Vec<_> = sent
            .iter()
            .map(|s| FrameStream::from_bus(s.slave, s.channel, s.frame, s.rate))
            .collect();
        Ok([sent, received].concat())
    }

    /// Sends the frames that are due `elapsed_ns` after the start and passes each to `sent` with its
    /// channel number over all gateways. After a temporary rejection a recording continues in the next
    /// cycle, in order.
    ///
    /// # Errors
    /// The Port rejected a frame, and not temporarily.
    pub fn send(
        &mut self,
        cycle: &mut Cycle<'_>,
        elapsed_ns: u64,
        mut sent: impl FnMut(usize, CanFrame),
    ) -> Result<(), SendError> {
        match self {
            Self::Counter { id, targets, done, .. } => {
                for target in targets {
                    let frame = counter_frame(*id, target.is_fd, *done)?;
                    let to = cycle.channel(target.slave, target.channel)?;
                    if cycle.send(to, &frame).ok_or_temporary()?.is_some() {
                        sent(target.index(), frame);
                    }
                }
                *done += 1;
                Ok(())
            }
            Self::Recording { frames, done } => {
                let start = start_ns(frames);
                while let Some(RecordedFrame { target, logged }) = frames.get(*done) {
                    if logged.time_ns.saturating_sub(start) > elapsed_ns {
                        break;
                    }
                    let to = cycle.channel(target.slave, target.channel)?;
                    if cycle.send(to, &logged.frame).ok_or_temporary()?.is_none() {
                        break;
                    }
                    sent(target.index(), logged.frame);
                    *done += 1;
                }
                Ok(())
            }
        }
    }
}

/// Time of the first frame of a recording.
fn start_ns(frames: &[RecordedFrame]) -> u64 {
    frames.first().map_or(0, |first| first.logged.time_ns)
}

fn counter_frame(id: CanId, is_fd: bool, count: u64) -> Result<CanFrame, SendError> {
    let mut data = [0; 64];
    data[..8].copy_from_slice(&count.to_le_bytes());
    let frame = if is_fd {
        CanFrame::fd(id, &data, true, false)
    } else {
        CanFrame::classic(id, &data[..8])
    };
    frame.map_err(SendError::from)
}

/// Frames by target, format and length: the first of them, and their number.
fn kinds(frames: &[RecordedFrame]) -> Vec<(Target, CanFrame, u32)> {
    let alike = |a: &CanFrame, b: &CanFrame| {
        (a.kind(), a.len(), a.id().is_extended()) == (b.kind(), b.len(), b.id().is_extended())
    };
    let mut kinds: Vec<(Target, CanFrame, u32)> = Vec::new();
    for RecordedFrame { target, logged } in frames {
        let frame = &logged.frame;
        match kinds.iter_mut().find(|(to, first, _)| to == target && alike(first, frame)) {
            Some((_, _, count)) => *count += 1,
            None => kinds.push((*target, *frame, 1)),
        }
    }
    kinds
}
