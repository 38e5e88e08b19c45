//! Whether frames have left: the gateway's results, and what waits in its channels (manual 7, 10).

use std::collections::HashMap;

use ecan_command_line::interrupt::Interrupt;
use ecan_mcan_port::{Port, Received, SendTicket, Session};
use ecan_protocol::image::{ChannelStatus, ResultCode};

use crate::failure::Failure;
use crate::frames::bit_rates::BitRates;
use crate::frames::channels::{Channels, can_config};
use crate::frames::service::{Cycle, Service};
use crate::frames::single_gateway::{channel_status, session};

/// Cycles behind the last result after which a channel's status has seen all frames.
const STATUS_CYCLES: usize = 3;
/// Frames that wait for their results, at first.
const UNDER_WAY: usize = 4096;
/// Where the pending count of the status word ends.
const SATURATED: u32 = 7;

/// The way of frames out of the gateway.
#[derive(Debug)]
pub struct TransmitTracker {
    channels: Channels,
    /// Frames without a result, with their numbers.
    open: HashMap<SendTicket, u64>,
    taken: u64,
    handed_over: u64,
    failed: u64,
    first_failure: Option<(u64, ResultCode)>,
    quiet_cycles: usize,
    /// Frames handed over, as of the last cycles, the oldest first.
    recently_handed_over: [u64; STATUS_CYCLES],
    /// Of those handed over, the frames that have left for sure.
    departed: u64,
    /// Frames that the channels hold at the most.
    capacity: u64,
    /// Frames that waited in the channels at the end.
    waiting: u64,
    /// Frames that a lost gateway may have held.
    doubtful: u64,
    pending: u32,
    session: Session,
    was_lost: bool,
    /// The user did not wait for the end.
    is_stopped: bool,
    /// A channel that was off the bus meanwhile; it may be back.
    bus_off: Option<u8>,
    last_progress_ns: u64,
    start_ns: u64,
    last_departure_ns: u64,
}

impl TransmitTracker {
    /// Of a gateway in service, from now on.
    pub fn new(channels: Channels, service: &Service) -> Self {
        let now_ns = service.now_ns();
        Self {
            channels,
            open: HashMap::with_capacity(UNDER_WAY),
            taken: 0,
            handed_over: 0,
            failed: 0,
            first_failure: None,
            quiet_cycles: 0,
            recently_handed_over: [0; STATUS_CYCLES],
            departed: 0,
            capacity: channels.iter().map(|channel| service.capacity(channel)).sum(),
            waiting: 0,
            doubtful: 0,
            pending: 0,
            session: session(service.port()),
            was_lost: false,
            is_stopped: false,
            bus_off: None,
            last_progress_ns: now_ns,
            start_ns: now_ns,
            last_departure_ns: now_ns,
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
        self.watch_session(session(port));
        let is_off = |channel: &u8| channel_status(port, *channel).bus_off();
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
                self.last_departure_ns = cycle.now_ns;
            } else {
                self.failed += 1;
                self.first_failure.get_or_insert((number, report.code));
            }
        }
        if self.session != Session::Ready {
            return;
        }
        let pending = pending(self.channels, port);
        if pending < self.pending {
            (self.last_progress_ns, self.last_departure_ns) = (cycle.now_ns, cycle.now_ns);
        }
        self.pending = pending;
        if pending < SATURATED {
            // What was handed over so long ago and does not wait has left.
            let [oldest, ..] = self.recently_handed_over;
            self.departed = self.departed.max(oldest.saturating_sub(pending.into()));
        }
        self.recently_handed_over.rotate_left(1);
        let [.., newest] = &mut self.recently_handed_over;
        *newest = self.handed_over;
    }

    /// A gateway that is lost forgets what it holds.
    fn watch_session(&mut self, session: Session) {
        if self.session == Session::Ready && session != Session::Ready {
            self.was_lost = true;
            self.doubtful += self.possibly_held();
            self.departed = self.handed_over;
        }
        self.session = session;
    }

    /// Frames that the channels may hold.
    fn possibly_held(&self) -> u64 {
        (self.handed_over - self.departed).min(self.capacity)
    }

    /// The channels that are watched.
    pub fn channels(&self) -> Channels {
        self.channels
    }

    /// Frames put into images.
    pub fn count(&self) -> u64 {
        self.taken
    }

    /// From the start to the last frame that is known to have left, in nanoseconds.
    pub fn elapsed_ns(&self) -> u64 {
        self.last_departure_ns.saturating_sub(self.start_ns)
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
        self.open.is_empty()
            && self.quiet_cycles >= STATUS_CYCLES
            && self.channels.iter().all(|it| channel_status(port, it).tx_pending() == 0)
    }

    /// No more cycles follow: counts what waits in the channels. A gateway that answers is asked.
    pub fn close(&mut self, service: &mut Service, interrupt: &Interrupt, has_answers: bool) {
        self.is_stopped = interrupt.is_set();
        if !has_answers || self.session != Session::Ready {
            self.doubtful += self.possibly_held();
            return;
        }
        if self.pending < SATURATED {
            self.waiting = self.pending.into();
            return;
        }
        // The status counts no further (0x9000:11).
        let channels: Vec<_> = self.channels.iter().map(u16::from).collect();
        let counted = service.port_mut().diagnose(|diagnostics| {
            let count = |channel| diagnostics.sdo_upload_u32(0, 0x9000 + channel, 11);
            channels.into_iter().map(count).sum::<Result<u32, _>>()
        });
        match counted {
            Ok(Ok(count)) => self.waiting = count.into(),
            Ok(Err(_)) | Err(_) => self.doubtful += self.possibly_held(),
        }
    }

    /// What became of the frames, once [closed](Self::close). Frames that still wait in a channel
    /// have not left.
    pub fn outcome(&self) -> Outcome {
        let doubtful = self.doubtful.min(self.handed_over);
        let waiting = self.waiting.min(self.handed_over - doubtful);
        let (held, open) = (waiting, self.open.len() as u64);
        let is_under_way = self.is_stopped && !self.was_lost;
        Outcome {
            sent: self.handed_over - waiting - doubtful,
            refused: self.failed,
            waiting: if is_under_way { 0 } else { held },
            unknown: doubtful + if is_under_way { 0 } else { open },
            under_way: if is_under_way { held + open } else { 0 },
            bus_off: self.bus_off,
        }
    }

    /// That frames stayed behind, in these words, and why, as far as gateway and channels tell.
    pub fn failure(&self, service: &Service, words: String, otherwise: Option<&str>) -> Failure {
        if self.was_lost {
            return service.out_of_service(&words);
        }
        match self.cause(service.port()).or(otherwise.map(str::to_owned)) {
            Some(cause) => Failure::TooFew(format!("{words}: {cause}")),
            None => Failure::TooFew(words),
        }
    }

    /// Why frames do not leave, as far as the channels tell.
    fn cause(&self, port: &Port) -> Option<String> {
        let rates = |channel| {
            can_config(port, channel).map_or_else(String::new, |can| BitRates::of(can).to_string())
        };
        if let Some(channel) = self.bus_off {
            let rates = rates(channel);
            return Some(format!(
                "channel {channel} went bus-off: do the others on the bus have {rates}, is the wiring \
                 right?"
            ));
        }
        let holds_frames = |channel: &u8| channel_status(port, *channel).tx_pending() > 0;
        let channel = self.channels.iter().find(holds_frames)?;
        let status: ChannelStatus = channel_status(port, channel);
        let rates = rates(channel);
        Some(if status.warn() {
            format!(
                "channel {channel} gets no acknowledgement: is there another node at {rates}, \
                 are wiring and termination right?"
            )
        } else {
            format!("channel {channel} has not sent what it holds: is the bus full?")
        })
    }
}

/// Frames that wait in the channels, as far as their status tells: it counts to 7.
fn pending(channels: Channels, port: &Port) -> u32 {
    channels.iter().map(|it| u32::from(channel_status(port, it).tx_pending())).sum()
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
    /// Without a word from the gateway, or in one that was lost.
    pub unknown: u64,
    /// On their way when the user stopped.
    pub under_way: u64,
    /// A channel that was off the bus: what it held may be lost.
    pub bus_off: Option<u8>,
}

impl Outcome {
    /// Not known to have left.
    pub fn lost(&self) -> u64 {
        self.refused + self.waiting + self.unknown
    }
}
