//! The frames that a loop sends: a counter, or a recording.

use ecan_mcan_port::{FrameRate, FrameStream, Port, SendError};
use ecan_protocol::{CHANNELS, CanFrame, CanId};

use crate::log_file::LoggedFrame;

/// Channels that a program uses, on every gateway.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channels {
    /// One channel.
    One(u8),
    /// All four.
    All,
}

impl Channels {
    /// Whether the channel is used.
    pub fn contains(self, channel: u8) -> bool {
        match self {
            Self::One(one) => one == channel,
            Self::All => true,
        }
    }
}

/// Sends what is due in a cycle.
#[derive(Debug)]
pub enum Source {
    /// One frame per channel and cycle with the number of the cycle in it.
    Counter {
        /// Identifier of the frames.
        id: CanId,
        /// Whether they are CAN FD frames of 64 bytes instead of classic ones of 8.
        is_fd: bool,
        /// Cycles to send in.
        cycles: u64,
        /// Cycles sent in so far.
        done: u64,
    },
    /// The frames of a recording, none before its time, all that the gateway takes.
    Recording {
        /// The recording.
        frames: Vec<LoggedFrame>,
        /// Frames sent so far.
        done: usize,
    },
}

impl Source {
    /// Number of steps in all: cycles or frames.
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

    /// Whether everything was sent.
    pub fn is_done(&self) -> bool {
        self.done() >= self.total()
    }

    /// Time stamp for a log line `elapsed_ns` after the start: the time of the recording goes on.
    pub fn log_time(&self, elapsed_ns: u64) -> u64 {
        match self {
            Self::Counter { .. } => elapsed_ns,
            Self::Recording { frames, .. } => frames.first().map_or(0, |f| f.time_ns) + elapsed_ns,
        }
    }

    /// When the next frame of a recording is due, in nanoseconds after the start.
    pub fn next_due_ns(&self) -> Option<u64> {
        let Self::Recording { frames, done } = self else { return None };
        let (first, next) = (frames.first()?, frames.get(*done)?);
        Some(next.time_ns.saturating_sub(first.time_ns))
    }

    /// The frames for a plan: each goes out and comes back. Those of a recording are spread over
    /// its length.
    ///
    /// # Errors
    /// A counter frame that is none.
    pub fn traffic(
        &self,
        slaves: usize,
        channels: Channels,
    ) -> Result<Vec<FrameStream>, SendError> {
        let mut sent = Vec::new();
        match self {
            Self::Counter { id, is_fd, .. } => {
                let frame = counter_frame(*id, *is_fd, 0)?;
                for slave in 0..slaves {
                    let used = (0..CHANNELS as u8).filter(|c| channels.contains(*c));
                    sent.extend(used.map(|channel| {
                        FrameStream::to_bus(slave, channel, frame, FrameRate::PerCycle(1))
                    }));
                }
            }
            Self::Recording { frames, .. } => {
                let ends = frames.first().zip(frames.last());
                let seconds = ends.map_or(0.0, |(first, last)| {
                    last.time_ns.saturating_sub(first.time_ns) as f64 / 1e9
                });
                for (place, frame, count) in kinds(frames, channels, slaves) {
                    let (slave, channel) = (place / CHANNELS, (place % CHANNELS) as u8);
                    let rate = if seconds > 0.0 {
                        FrameRate::PerSecond(f64::from(count) / seconds)
                    } else {
                        FrameRate::PerCycle(count)
                    };
                    sent.push(FrameStream::to_bus(slave, channel, frame, rate));
                }
            }
        }
        let back: Vec<_> = sent
            .iter()
            .map(|s| FrameStream::from_bus(s.slave, s.channel, s.frame, s.rate))
            .collect();
        Ok([sent, back].concat())
    }

    /// Sends what is due `elapsed_ns` after the start and reports each frame to `sent` with its
    /// channel, counted over all gateways. A frame for which there is no room waits for the next
    /// cycle, and with it all that come after it, so that their order holds.
    ///
    /// # Errors
    /// A frame that the port does not take for another reason.
    pub fn send(
        &mut self,
        port: &mut Port,
        channels: Channels,
        elapsed_ns: u64,
        mut sent: impl FnMut(usize, CanFrame),
    ) -> Result<(), SendError> {
        match self {
            Self::Counter { id, is_fd, done, .. } => {
                let frame = counter_frame(*id, *is_fd, *done)?;
                *done += 1;
                for slave in 0..port.slave_count() {
                    for channel in (0..CHANNELS as u8).filter(|c| channels.contains(*c)) {
                        if taken(port.send(slave, channel, frame.as_ref()))? {
                            sent(slave * CHANNELS + usize::from(channel), frame);
                        }
                    }
                }
                Ok(())
            }
            Self::Recording { frames, done } => {
                let start = frames.first().map_or(0, |f| f.time_ns);
                while let Some(next) = frames.get(*done) {
                    if next.time_ns.saturating_sub(start) > elapsed_ns {
                        break;
                    }
                    let place = place(channels, port.slave_count(), &next.interface);
                    let (slave, channel) = (place / CHANNELS, (place % CHANNELS) as u8);
                    if !taken(port.send(slave, channel, next.frame.as_ref()))? {
                        break;
                    }
                    sent(place, next.frame);
                    *done += 1;
                }
                Ok(())
            }
        }
    }
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

/// Frames of one length and format on a channel, counted over all gateways: the first of them, and
/// how many there are.
fn kinds(frames: &[LoggedFrame], channels: Channels, slaves: usize) -> Vec<(usize, CanFrame, u32)> {
    let alike = |a: &CanFrame, b: &CanFrame| {
        (a.kind(), a.len(), a.id().is_extended()) == (b.kind(), b.len(), b.id().is_extended())
    };
    let mut kinds: Vec<(usize, CanFrame, u32)> = Vec::new();
    for LoggedFrame { frame, interface, .. } in frames {
        let to = place(channels, slaves, interface);
        match kinds.iter_mut().find(|(place, first, _)| *place == to && alike(first, frame)) {
            Some((_, _, count)) => *count += 1,
            None => kinds.push((to, *frame, 1)),
        }
    }
    kinds
}

/// `canN` of a recording goes to channel N over all gateways when all are used.
fn place(channels: Channels, slaves: usize, interface: &str) -> usize {
    match channels {
        Channels::One(channel) => usize::from(channel),
        Channels::All => {
            let digits = interface.trim_start_matches(|c: char| !c.is_ascii_digit());
            digits.parse::<usize>().unwrap_or(0) % (slaves * CHANNELS).max(1)
        }
    }
}

fn taken<T>(result: Result<T, SendError>) -> Result<bool, SendError> {
    match result {
        Ok(_) => Ok(true),
        Err(SendError::NoRoom { .. } | SendError::NotReady { .. }) => Ok(false),
        Err(error) => Err(error),
    }
}
