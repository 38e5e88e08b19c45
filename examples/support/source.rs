//! The frames that a loop sends: a counter, or a recording.

use ecan_mcan_port::{Cycle, FrameRate, FrameStream, OkOrTemporary, PortConfig, SendError};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::mapping::CHANNELS;

use crate::log_file::LoggedFrame;

/// Channels that a program uses, of those that each gateway has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channels {
    /// One channel.
    One(u8),
    /// All of them.
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

    /// Where frames go to, in the order of the gateways and their channels.
    pub fn places(self, config: &PortConfig) -> Vec<Place> {
        let mut places = Vec::new();
        for (slave, gateway) in config.gateways.iter().enumerate() {
            for (channel, settings) in (0..).zip(&gateway.channels) {
                if let Some(settings) = settings.as_ref().filter(|_| self.contains(channel)) {
                    places.push(Place { slave, channel, is_fd: settings.can.fd });
                }
            }
        }
        places
    }

    /// The gateway and the channel that a recorded frame goes to: `canN` to channel N over all
    /// gateways where all channels are used, otherwise each frame to the first of the places.
    pub fn place_of(self, interface: &str, places: &[Place], gateways: usize) -> (usize, u8) {
        let index = match self {
            Self::One(_) => places.first().map_or(0, |first| first.index()),
            Self::All => {
                let digits = interface.trim_start_matches(|c: char| !c.is_ascii_digit());
                digits.parse::<usize>().unwrap_or(0) % (gateways * CHANNELS).max(1)
            }
        };
        (index / CHANNELS, (index % CHANNELS) as u8)
    }
}

/// A channel of a gateway that frames go to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// The gateway, from 0.
    pub slave: usize,
    /// Its channel.
    pub channel: u8,
    /// Whether the channel carries CAN FD.
    pub is_fd: bool,
}

impl Place {
    /// The channel, counted over all gateways.
    pub fn index(self) -> usize {
        self.slave * CHANNELS + usize::from(self.channel)
    }
}

/// A recorded frame and where it goes to.
#[derive(Debug, Clone)]
pub struct PlacedFrame {
    /// Where it goes to.
    pub place: Place,
    /// The frame.
    pub logged: LoggedFrame,
}

/// Sends what is due in a cycle.
#[derive(Debug)]
pub enum Source {
    /// One frame per channel and cycle with the number of the cycle in it.
    Counter {
        /// Identifier of the frames.
        id: CanId,
        /// Where they go to: as CAN FD frames of 64 bytes, or as classic ones of 8.
        places: Vec<Place>,
        /// Cycles to send in.
        cycles: u64,
        /// Cycles sent in so far.
        done: u64,
    },
    /// The frames of a recording, none before its time, all that the gateway takes.
    Recording {
        /// The recording.
        frames: Vec<PlacedFrame>,
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
            Self::Recording { frames, .. } => start_ns(frames) + elapsed_ns,
        }
    }

    /// When the next frame of a recording is due, in nanoseconds after the start.
    pub fn next_due_ns(&self) -> Option<u64> {
        let Self::Recording { frames, done } = self else { return None };
        let next = frames.get(*done)?;
        Some(next.logged.time_ns.saturating_sub(start_ns(frames)))
    }

    /// The frames for a plan: each goes out and comes back. Those of a recording are spread over
    /// its length.
    ///
    /// # Errors
    /// A counter frame that is none.
    pub fn traffic(&self) -> Result<Vec<FrameStream>, SendError> {
        let mut sent = Vec::new();
        match self {
            Self::Counter { id, places, .. } => {
                for Place { slave, channel, is_fd } in places {
                    let frame = counter_frame(*id, *is_fd, 0)?;
                    let rate = FrameRate::PerCycle(1);
                    sent.push(FrameStream::to_bus(*slave, *channel, frame, rate));
                }
            }
            Self::Recording { frames, .. } => {
                let last_ns = frames.last().map_or(0, |last| last.logged.time_ns);
                let seconds = last_ns.saturating_sub(start_ns(frames)) as f64 / 1e9;
                for (place, frame, count) in kinds(frames) {
                    let rate = if seconds > 0.0 {
                        FrameRate::PerSecond(f64::from(count) / seconds)
                    } else {
                        FrameRate::PerCycle(count)
                    };
                    sent.push(FrameStream::to_bus(place.slave, place.channel, frame, rate));
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
        cycle: &mut Cycle<'_>,
        elapsed_ns: u64,
        mut sent: impl FnMut(usize, CanFrame),
    ) -> Result<(), SendError> {
        match self {
            Self::Counter { id, places, done, .. } => {
                for place in places {
                    let frame = counter_frame(*id, place.is_fd, *done)?;
                    let to = cycle.channel(place.slave, place.channel)?;
                    if cycle.send(to, &frame).ok_or_temporary()?.is_some() {
                        sent(place.index(), frame);
                    }
                }
                *done += 1;
                Ok(())
            }
            Self::Recording { frames, done } => {
                let start = start_ns(frames);
                while let Some(PlacedFrame { place, logged }) = frames.get(*done) {
                    if logged.time_ns.saturating_sub(start) > elapsed_ns {
                        break;
                    }
                    let to = cycle.channel(place.slave, place.channel)?;
                    if cycle.send(to, &logged.frame).ok_or_temporary()?.is_none() {
                        break;
                    }
                    sent(place.index(), logged.frame);
                    *done += 1;
                }
                Ok(())
            }
        }
    }
}

/// When a recording begins.
fn start_ns(frames: &[PlacedFrame]) -> u64 {
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

/// Frames of one length and format on a channel: the first of them, and how many there are.
fn kinds(frames: &[PlacedFrame]) -> Vec<(Place, CanFrame, u32)> {
    let alike = |a: &CanFrame, b: &CanFrame| {
        (a.kind(), a.len(), a.id().is_extended()) == (b.kind(), b.len(), b.id().is_extended())
    };
    let mut kinds: Vec<(Place, CanFrame, u32)> = Vec::new();
    for PlacedFrame { place, logged } in frames {
        let frame = &logged.frame;
        match kinds.iter_mut().find(|(to, first, _)| to == place && alike(first, frame)) {
            Some((_, _, count)) => *count += 1,
            None => kinds.push((*place, *frame, 1)),
        }
    }
    kinds
}
