//! Whether frames have left: the gateway's results, and what waits in its channels (manual 7, 10).

use std::collections::HashMap;

use ecan_command_line::interrupt::Interrupt;
use ecan_mcan_port::{Port, Received, SendTicket};
use ecan_protocol::{ChannelStatus, ResultCode};

use crate::failure::Failure;
use crate::frames::channels::Channels;
use crate::frames::service::{Cycle, Service, can};

/// Cycles behind the last result after which a channel's status has seen all frames.
const STATUS_CYCLES: u32 = 3;
/// Frames that wait for their results, at first.
const UNDER_WAY: usize = 4096;
/// Where the pending count of the status word ends.
const SATURATED: u32 = 7;

/// The way of frames out of the gateway.
#[derive(Debug)]
pub struct Departures {
    channels: Channels,
    /// Frames without a result, with their numbers.
    open: HashMap<SendTicket, u64>,
    taken: u64,
    handed_over: u64,
    failed: u64,
    first_failure: Option<(u64, ResultCode)>,
    quiet_cycles: u32,
    /// Frames that waited in the channels when the wait ended.
    waiting: u64,
    /// A channel that was off the bus meanwhile; it may be back.
    bus_off: Option<u8>,
    last_progress_ns: u64,
}

impl Departures {
    pub fn new(channels: Channels, now_ns: u64) -> Self {
        Self {
            channels,
            open: HashMap::with_capacity(UNDER_WAY),
            taken: 0,
            handed_over: 0,
            failed: 0,
            first_failure: None,
            quiet_cycles: 0,
            waiting: 0,
            bus_off: None,
            last_progress_ns: now_ns,
        }
    }

    /// A frame was put into an image; its number counts from 0.
    pub fn taken(&mut self, ticket: SendTicket, now_ns: u64) {
        self.open.insert(ticket, self.taken);
        self.taken += 1;
        (self.quiet_cycles, self.last_progress_ns) = (0, now_ns);
    }

    /// Looks at what a cycle brought.
    pub fn look(&mut self, cycle: &Cycle, port: &Port) {
        let is_off = |channel: &u8| port.channel_status(0, *channel).bus_off();
        self.bus_off = self.bus_off.or_else(|| self.channels.iter().find(is_off));
        self.quiet_cycles = self.quiet_cycles.saturating_add(1);
        for arrival in &cycle.arrivals {
            let Received::TransmitReport(report) = &arrival.received else { continue };
            let Some(number) = report.ticket.and_then(|ticket| self.open.remove(&ticket)) else {
                continue;
            };
            (self.quiet_cycles, self.last_progress_ns) = (0, cycle.now_ns);
            if report.code.is_success() {
                self.handed_over += 1;
            } else {
                self.failed += 1;
                self.first_failure.get_or_insert((number, report.code));
            }
        }
    }

    /// The channels that are watched.
    pub fn channels(&self) -> Channels {
        self.channels
    }

    /// Frames put into images.
    pub fn count(&self) -> u64 {
        self.taken
    }

    /// The number of the first frame that the gateway did not take, and what it says.
    pub fn first_failure(&self) -> Option<(u64, ResultCode)> {
        self.first_failure
    }

    /// Since the last frame or result, in nanoseconds.
    pub fn standstill_ns(&self, now_ns: u64) -> u64 {
        now_ns.saturating_sub(self.last_progress_ns)
    }

    /// Whether nothing more is to come: every frame has its result, and no channel holds any.
    pub fn are_settled(&self, port: &Port) -> bool {
        let is_empty = |channel| port.channel_status(0, channel).tx_pending() == 0;
        self.open.is_empty()
            && self.quiet_cycles >= STATUS_CYCLES
            && self.channels.iter().all(is_empty)
    }

    /// Runs the cycle until everything is settled, or for so long since the last progress.
    pub fn wait(
        &mut self,
        service: &mut Service,
        timeout_ns: u64,
        interrupt: &Interrupt,
        mut take: impl FnMut(&Service, &Cycle),
    ) -> Result<(), Failure> {
        let mut pending = u32::MAX;
        while !self.are_settled(service.port()) && !interrupt.is_set() {
            let cycle = service.begin();
            self.look(&cycle, service.port());
            let now_pending = self.pending(service.port());
            if now_pending < pending {
                self.last_progress_ns = cycle.now_ns;
            }
            pending = now_pending;
            let is_over = self.standstill_ns(cycle.now_ns) >= timeout_ns;
            take(service, &cycle);
            service.end(cycle)?;
            if is_over {
                break;
            }
        }
        self.waiting = self.count_waiting(service);
        Ok(())
    }

    /// Frames that wait in the channels, as far as their status tells: it counts to 7.
    fn pending(&self, port: &Port) -> u32 {
        self.channels.iter().map(|it| u32::from(port.channel_status(0, it).tx_pending())).sum()
    }

    /// Frames that wait in the channels, also where the status counts no further (0x9000:11).
    fn count_waiting(&self, service: &mut Service) -> u64 {
        let status_count = self.pending(service.port());
        if status_count < SATURATED {
            return status_count.into();
        }
        let channels: Vec<_> = self.channels.iter().map(u16::from).collect();
        let counted = service.port_mut().diagnose(|diagnostics| {
            let count = |channel| diagnostics.sdo_upload_u32(0, 0x9000 + channel, 11);
            channels.into_iter().map(count).sum::<Result<u32, _>>()
        });
        match counted {
            Ok(Ok(count)) => count.into(),
            // Without an answer the gateway may hold them all.
            Ok(Err(_)) | Err(_) => self.handed_over,
        }
    }

    /// What became of the frames, after [`wait`](Self::wait). Frames that still wait in a channel have not left.
    pub fn outcome(&self, port: &Port) -> Outcome {
        let waiting = self.waiting.min(self.handed_over);
        let stuck = self.channels.iter().find_map(|channel| {
            let status = port.channel_status(0, channel);
            (status.tx_pending() > 0).then_some((channel, status))
        });
        Outcome {
            sent: self.handed_over - waiting,
            refused: self.failed,
            waiting,
            unknown: self.open.len() as u64,
            stuck,
            bus_off: self.bus_off,
        }
    }
}

/// What became of frames.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Known to have left.
    pub sent: u64,
    /// Refused by the gateway.
    pub refused: u64,
    /// Still in a channel.
    pub waiting: u64,
    /// Without a word from the gateway.
    pub unknown: u64,
    /// A channel that does not send.
    stuck: Option<(u8, ChannelStatus)>,
    /// A channel that was off the bus: what it held may be lost.
    pub bus_off: Option<u8>,
}

impl Outcome {
    /// Not known to have left.
    pub fn lost(&self) -> u64 {
        self.refused + self.waiting + self.unknown
    }

    /// Why frames do not leave, as far as the channels tell.
    pub fn cause(&self, port: &Port) -> Option<String> {
        let bitrate = |channel| can(port, channel).map_or(0, |can| can.nominal_bitrate);
        if let Some(channel) = self.bus_off {
            let bitrate = bitrate(channel);
            return Some(format!(
                "channel {channel} went bus-off: do the others on the bus have {bitrate} bit/s, is \
                 the wiring right?"
            ));
        }
        let (channel, status) = self.stuck?;
        let bitrate = bitrate(channel);
        Some(if status.warn() {
            format!(
                "channel {channel} gets no acknowledgement: is there another node at {bitrate} \
                 bit/s, are wiring and termination right?"
            )
        } else {
            format!("channel {channel} has not sent what it holds: is the bus full?")
        })
    }
}
