//! Changes of gateways and channels, each told once.

use std::fmt;
use std::time::Duration;

use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;

use crate::address::{ChannelHandle, GatewayHandle};
use crate::port::Port;
use crate::session::machine::Session;
use crate::session::verification::{PendingStep, VerificationFault};
use crate::snapshot::{PortSnapshot, SessionState};
use crate::statistics::{ChannelStatistics, SlaveStatistics};

/// Time for which a gateway waits for something else before that is told: after a loss the master takes several
/// steps. A link that is back takes up to two seconds.
pub const LASTING_CAUSE: Duration = Duration::from_secs(3);
/// Shortest interval of the changes of a channel in the long run, in nanoseconds.
const PAUSE_NS: u64 = 1_000_000_000;
/// Changes of a channel in a burst.
const AT_ONCE: u64 = 3;

/// Tells what changed at the gateways and channels of a [`Port`]: what was lost, why as far as it is known, and
/// what returned after how long. Real-time safe; a program that prints the changes is not.
///
/// ```no_run
/// # use ecan_mcan_port::{BusWatch, Port};
/// # fn control(port: &mut Port) -> Result<(), Box<dyn std::error::Error>> {
/// let mut watch = BusWatch::new(port);
/// loop {
///     port.next_cycle().end()?;
///     for change in watch.changes(port) {
///         println!("{change}");
///     }
/// }
/// # }
/// ```
#[derive(Debug)]
pub struct BusWatch {
    start_ns: u64,
    gateways: Vec<(GatewayHandle, GatewayWatch)>,
}

/// A change that [`BusWatch`] tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BusChange {
    /// Time since the watch began.
    pub time: Duration,
    /// The gateway.
    pub gateway: GatewayHandle,
    /// What changed.
    pub event: BusEvent,
}

/// What changed at a gateway or at one of its channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum BusEvent {
    /// No frame can be sent to the gateway any more. It waits for this step, as far as the master knows it in the
    /// cycle of the loss.
    Lost(PendingStep),
    /// The lost gateway has waited for this for [`LASTING_CAUSE`]. Each [cause](PendingStep::is_cause) is told once in an
    /// outage.
    Waits(PendingStep),
    /// The verification of the gateway failed; it is repeated every second. `None` if the fault is not known.
    Failed(Option<VerificationFault>),
    /// The gateway is ready, this time after its loss; `None` without a loss since the begin of the watch.
    Ready(Option<Duration>),
    /// The gateway was lost and is ready again since it was looked at last.
    Interrupted,
    /// The condition of this channel changed, while its gateway is ready.
    Channel(u8, ChannelChange),
}

impl BusWatch {
    /// Starts with the present states.
    pub fn new(port: &Port) -> Self {
        let start_ns = port.adapter().clock().now_ns();
        let watch = |gateway| {
            let now = GatewayCondition::of(port, gateway);
            (gateway, GatewayWatch::new(now.is_ready(), &now.statistics))
        };
        Self { start_ns, gateways: port.gateways().map(watch).collect() }
    }

    /// The changes up to the last cycle. Those of a channel are told up to once per second in the long run, with
    /// their number.
    pub fn changes(&mut self, port: &Port) -> impl Iterator<Item = BusChange> {
        let now_ns = port.adapter().clock().now_ns();
        let time = Duration::from_nanos(now_ns.saturating_sub(self.start_ns));
        self.gateways.iter_mut().flat_map(move |(gateway, watch)| {
            let gateway = *gateway;
            let events = watch.events(GatewayCondition::of(port, gateway), now_ns);
            events.map(move |event| BusChange { time, gateway, event })
        })
    }
}

/// No frame of a program was delivered, or a channel rejects them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NotDelivered {
    /// No frame was delivered, and this gateway is not ready.
    #[error("no frame was delivered: {gateway} waits for {waits_for}")]
    NotReady {
        /// The gateway.
        gateway: GatewayHandle,
        /// What it waits for.
        waits_for: PendingStep,
    },
    /// A channel is bus-off, or it has rejected frames and its condition is not good.
    #[error(
        "{channel}: frames rejected: {rejected}; {condition}; check that another node is on, and the bit rate"
    )]
    Rejected {
        /// The channel.
        channel: ChannelHandle,
        /// Frames that were rejected so far.
        rejected: u64,
        /// The present condition.
        condition: ChannelChange,
    },
    /// No frame was delivered although the gateways are ready.
    #[error("no frame was delivered")]
    Nothing,
}

/// Checks at the end of a program that sends whether its frames reached the gateways and their buses. Real-time
/// safe.
///
/// # Errors
/// [`NotDelivered`] with the reason, as far as it is known.
pub fn check_delivery(port: &Port) -> Result<(), NotDelivered> {
    let mut delivered = 0;
    for channel in port.channels() {
        let gateway = GatewayHandle::new(channel.slave());
        let statistics = port.statistics(gateway).channels;
        let Some(counts) = statistics.get(usize::from(channel.channel())) else { continue };
        delivered += counts.frames_delivered;
        let rejected = counts.rejected_queue_full + counts.rejected_bus_off;
        let condition = Condition::of(port.channel_status(channel));
        let is_used = rejected > 0 || condition.is_bus_off && counts.frames_accepted > 0;
        if is_used && port.gateway_is_ready(gateway) && !condition.is_good() {
            let condition = ChannelChange { condition, changes: 0 };
            return Err(NotDelivered::Rejected { channel, rejected, condition });
        }
    }
    if delivered > 0 {
        return Ok(());
    }
    let waits = |gateway| Some((gateway, port.waiting_for(gateway)?));
    Err(match port.gateways().find_map(waits) {
        Some((gateway, waits_for)) => NotDelivered::NotReady { gateway, waits_for },
        None => NotDelivered::Nothing,
    })
}

impl fmt::Display for BusChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { time, gateway, event } = self;
        write!(f, "{:9.3} s  {gateway}: {event}", time.as_secs_f64())
    }
}

impl fmt::Display for BusEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lost(step) => write!(f, "lost, waits for {step}"),
            Self::Waits(step) => write!(f, "waits for {step}"),
            Self::Failed(Some(fault)) => write!(f, "not ready: {fault}"),
            Self::Failed(None) => f.write_str("not ready: verification failed"),
            Self::Interrupted => {
                f.write_str("lost and ready again; cause and duration are not known")
            }
            Self::Ready(None) => f.write_str("ready"),
            Self::Ready(Some(after)) => write!(f, "ready after {:.3} s", after.as_secs_f64()),
            Self::Channel(channel, change) => write!(f, "channel {channel}: {change}"),
        }
    }
}

/// Condition of a gateway at one time, for a [`GatewayWatch`].
#[derive(Debug, Clone, Copy, Default)]
pub struct GatewayCondition {
    /// State of the session.
    pub session: SessionState,
    /// Fault of the failed verification, if it is known.
    pub fault: Option<VerificationFault>,
    /// Step that a gateway waits for that is not ready; `None` if it is not known.
    pub waiting_for: Option<PendingStep>,
    /// Status of each enabled channel.
    pub channels: [Option<ChannelStatus>; CHANNELS],
    /// Counters.
    pub statistics: SlaveStatistics,
}

impl GatewayCondition {
    /// The gateway in the last cycle of a Port. Real-time safe.
    pub fn of(port: &Port, gateway: GatewayHandle) -> Self {
        let session = port.session(gateway);
        let channel = |channel: usize| {
            let channel = port.channel(gateway.slave(), channel as u8).ok()?;
            Some(port.channel_status(channel))
        };
        Self {
            session: session.into(),
            fault: match session {
                Session::Failed(fault) => Some(fault),
                _ => None,
            },
            waiting_for: port.waiting_for(gateway),
            channels: std::array::from_fn(channel),
            statistics: port.statistics(gateway),
        }
    }

    /// A gateway in a snapshot; `None` without it.
    pub fn of_snapshot(port: PortSnapshot<'_>, slave: usize) -> Option<Self> {
        Some(Self {
            session: port.session(slave)?,
            fault: None,
            waiting_for: port.waiting_for(slave),
            channels: std::array::from_fn(|channel| port.channel_status(slave, channel as u8)),
            statistics: port.statistics(slave)?,
        })
    }

    /// Returns whether frames can be sent to the gateway.
    pub fn is_ready(&self) -> bool {
        self.session == SessionState::Ready
    }

    /// The step that a gateway waits for that is not ready; without a known one it is as far as after any loss.
    pub fn step(&self) -> PendingStep {
        self.waiting_for.unwrap_or(PendingStep::Operational)
    }
}

/// Tells what changed at one gateway, for programs that see it otherwise than by a [`Port`]. A loss and a bus-off
/// between two calls are told, too. Real-time safe.
#[derive(Debug)]
pub struct GatewayWatch {
    outage: Option<Outage>,
    /// Times that the gateway was lost, as far as they are told.
    losses: u64,
    channels: [ChannelWatch; CHANNELS],
}

#[derive(Debug)]
struct Outage {
    /// `None` for one from the begin of the watch.
    since_ns: Option<u64>,
    /// Codes of the causes that have been told.
    told: u16,
    step: PendingStep,
    step_since_ns: u64,
    /// Failure that has been told, with its fault if it is known.
    failure: Option<Option<VerificationFault>>,
}

impl Outage {
    fn begin(since_ns: Option<u64>) -> Self {
        Self {
            since_ns,
            told: 0,
            step: PendingStep::Operational,
            step_since_ns: since_ns.unwrap_or_default(),
            failure: None,
        }
    }

    /// Returns whether a step is a cause that lasts and has not been told.
    fn is_news(&mut self, step: PendingStep, now_ns: u64) -> bool {
        if std::mem::replace(&mut self.step, step) != step {
            self.step_since_ns = now_ns;
        }
        Duration::from_nanos(now_ns.saturating_sub(self.step_since_ns)) >= LASTING_CAUSE
            && self.tell(step)
    }

    /// Returns whether a step is a cause that has not been told.
    fn tell(&mut self, step: PendingStep) -> bool {
        let bit = 1 << PendingStep::encode(Some(step)) as u8;
        let is_told = self.told & bit != 0;
        self.told |= bit;
        step.is_cause() && !is_told
    }
}

impl GatewayWatch {
    /// Starts with running channels, and the counters of the gateway.
    pub fn new(is_ready: bool, statistics: &SlaveStatistics) -> Self {
        let channel = |counts: ChannelStatistics| ChannelWatch {
            bus_off_images: counts.bus_off_images,
            ..ChannelWatch::default()
        };
        Self {
            outage: (!is_ready).then(|| Outage::begin(None)),
            losses: statistics.sessions_lost,
            channels: statistics.channels.map(channel),
        }
    }

    /// The changes since the last call. Those of a channel are told up to once per second in the long run.
    pub fn events(&mut self, now: GatewayCondition, now_ns: u64) -> impl Iterator<Item = BusEvent> {
        std::iter::from_fn(move || self.next(&now, now_ns))
    }

    /// The changes of channels that were not told, at the end of a program.
    pub fn rest(&mut self) -> impl Iterator<Item = BusEvent> {
        let rest = |(channel, watch): (u8, &mut ChannelWatch)| {
            Some(BusEvent::Channel(channel, watch.rest()?))
        };
        (0..).zip(&mut self.channels).filter_map(rest)
    }

    fn next(&mut self, now: &GatewayCondition, now_ns: u64) -> Option<BusEvent> {
        let losses = now.statistics.sessions_lost;
        let is_lost_again = std::mem::replace(&mut self.losses, losses) < losses;
        if now.is_ready() {
            return self.next_of_ready(now, is_lost_again, now_ns);
        }
        let step = now.step();
        let Some(outage) = &mut self.outage else {
            self.outage.insert(Outage::begin(Some(now_ns))).tell(step);
            return Some(BusEvent::Lost(step));
        };
        if now.session == SessionState::Failed
            && outage.failure.replace(now.fault) != Some(now.fault)
        {
            return Some(BusEvent::Failed(now.fault));
        }
        outage.is_news(step, now_ns).then_some(BusEvent::Waits(step))
    }

    fn next_of_ready(
        &mut self,
        now: &GatewayCondition,
        is_lost_again: bool,
        now_ns: u64,
    ) -> Option<BusEvent> {
        if let Some(Outage { since_ns, .. }) = self.outage.take() {
            let after = since_ns.map(|since_ns| now_ns.saturating_sub(since_ns));
            return Some(BusEvent::Ready(after.map(Duration::from_nanos)));
        }
        if is_lost_again {
            return Some(BusEvent::Interrupted);
        }
        let counts = now.channels.iter().zip(&now.statistics.channels);
        let mut channels = (0..).zip(&mut self.channels).zip(counts);
        channels.find_map(|((channel, watch), (status, counts))| {
            let change = watch.next((*status)?, counts.bus_off_images, now_ns)?;
            Some(BusEvent::Channel(channel, change))
        })
    }
}

/// Condition of a CAN channel by its status word (manual 7).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Condition {
    state: ChannelState,
    has_warning: bool,
    is_bus_off: bool,
}

impl Condition {
    fn of(status: ChannelStatus) -> Self {
        let (has_warning, is_bus_off) = (status.warn(), status.bus_off());
        Self { state: status.state(), has_warning, is_bus_off }
    }

    fn is_good(self) -> bool {
        let takes_part = matches!(self.state, ChannelState::Run | ChannelState::Listen);
        takes_part && !self.has_warning && !self.is_bus_off
    }
}

/// New condition of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChannelChange {
    condition: Condition,
    changes: u32,
}

impl fmt::Display for ChannelChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.condition {
            Condition { is_bus_off: true, .. } => f.write_str("bus-off")?,
            Condition { state, has_warning: true, .. } => {
                write!(f, "{state}, warning: error passive or many errors")?;
            }
            Condition { state, .. } => write!(f, "{state}")?,
        }
        match self.changes {
            0 | 1 => Ok(()),
            several => write!(f, " ({several} changes)"),
        }
    }
}

/// Watches the status of one channel: its changes, up to one per second in the long run. Starts with a running
/// channel. Real-time safe.
#[derive(Debug, Clone, Copy, Default)]
struct ChannelWatch {
    seen: Option<Condition>,
    /// Images with bus-off so far.
    bus_off_images: u64,
    /// Time until which the budget of changes is used up.
    paid_until_ns: u64,
    changes: u32,
}

impl ChannelWatch {
    /// Takes the present status; returns a change if one is due. A bus-off since the last call comes first.
    fn next(
        &mut self,
        status: ChannelStatus,
        bus_off_images: u64,
        now_ns: u64,
    ) -> Option<ChannelChange> {
        let mut now = Condition::of(status);
        let has_been_off =
            std::mem::replace(&mut self.bus_off_images, bus_off_images) < bus_off_images;
        let is_known = now.is_bus_off || self.seen.is_some_and(|seen| seen.is_bus_off);
        if has_been_off && !is_known {
            now = Condition { state: ChannelState::BusOff, has_warning: false, is_bus_off: true };
        }
        // There is no status before the first image.
        if self.seen.is_none() && now.state == ChannelState::Disabled {
            return None;
        }
        let before = self.seen.replace(now);
        let is_change = before.map_or(!now.is_good(), |before| before != now);
        self.changes += u32::from(is_change);
        let paid_until_ns = self.paid_until_ns.max(now_ns) + PAUSE_NS;
        if self.changes == 0 || paid_until_ns - now_ns > AT_ONCE * PAUSE_NS {
            return None;
        }
        self.paid_until_ns = paid_until_ns;
        self.rest()
    }

    /// The changes that were not told, at the end of a program.
    fn rest(&mut self) -> Option<ChannelChange> {
        let changes = std::mem::take(&mut self.changes);
        (changes > 0).then_some(ChannelChange { condition: self.seen?, changes })
    }
}

/// Images of a gateway that were lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageLoss {
    /// Images that did not arrive.
    Lost(u64),
    /// The largest number of images before the gateway started its sequence again.
    Unknown(u64),
    /// Images of which the gateway has left frames out.
    Incomplete(u64),
}

impl fmt::Display for ImageLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lost(images) => write!(f, "{images} images lost, received frames may be missing"),
            Self::Unknown(images) => {
                write!(f, "up to {images} images unknown, received frames may be missing")
            }
            Self::Incomplete(images) => {
                write!(f, "{images} images incomplete, it has dropped frames")
            }
        }
    }
}

/// Watches a counter of losses, which are told at most once per interval. Real-time safe.
#[derive(Debug, Clone, Copy)]
pub struct LossWatch {
    interval_ns: u64,
    told: u64,
    next_ns: u64,
}

impl LossWatch {
    /// Starts with this count.
    pub fn new(count: u64, interval: Duration) -> Self {
        let interval_ns = u64::try_from(interval.as_nanos()).unwrap_or(u64::MAX);
        Self { interval_ns, told: count, next_ns: 0 }
    }

    /// The new losses, if they are due; all of them at the largest time.
    pub fn next(&mut self, count: u64, now_ns: u64) -> Option<u64> {
        let new = count.saturating_sub(self.told);
        if new == 0 || now_ns < self.next_ns {
            return None;
        }
        (self.told, self.next_ns) = (count, now_ns.saturating_add(self.interval_ns));
        Some(new)
    }
}

/// Watches the lost images of one gateway: each kind is told at most once per interval. Real-time safe.
#[derive(Debug, Clone, Copy)]
pub struct ImageLossWatch([LossWatch; 3]);

impl ImageLossWatch {
    /// Starts with these counters.
    pub fn new(statistics: &SlaveStatistics, interval: Duration) -> Self {
        Self(Self::counts(statistics).map(|count| LossWatch::new(count, interval)))
    }

    fn counts(statistics: &SlaveStatistics) -> [u64; 3] {
        [statistics.txpdo_lost, statistics.txpdo_unknown, statistics.txpdo_incomplete]
    }

    /// The losses that are due; all of them at the largest time.
    pub fn losses(
        &mut self,
        statistics: &SlaveStatistics,
        now_ns: u64,
    ) -> impl Iterator<Item = ImageLoss> {
        let kinds = [ImageLoss::Lost, ImageLoss::Unknown, ImageLoss::Incomplete];
        let counts = kinds.into_iter().zip(Self::counts(statistics));
        let watches = counts.zip(&mut self.0);
        watches.filter_map(move |((kind, count), watch)| watch.next(count, now_ns).map(kind))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn status(is_bus_off: bool) -> ChannelStatus {
        ChannelStatus::default().with_state(ChannelState::Run).with_bus_off(is_bus_off)
    }

    #[test]
    fn frequent_changes_are_told_once_a_second() {
        let mut watch = ChannelWatch::default();
        let mut next = |is_bus_off, now_ms: u64| {
            watch.next(status(is_bus_off), 0, now_ms * MS).map(|change| change.to_string())
        };
        assert_eq!(next(false, 0), None);
        let told: Vec<_> = (1..=3000_u64).filter_map(|ms| next(ms % 2 == 1, ms)).collect();
        let later = ["bus-off (998 changes)", "bus-off (1000 changes)"];
        assert_eq!(told, [&["bus-off", "run", "bus-off"][..], &later].concat());
        // Withheld changes are told later, even without new changes.
        assert_eq!(next(false, 3_500).as_deref(), Some("run (999 changes)"));
        assert_eq!(next(false, 9_000), None);
        let at_once = [true, false, true, false].map(|is_bus_off| next(is_bus_off, 9_000));
        assert_eq!(at_once.iter().flatten().count(), 3);
        assert_eq!(watch.rest().map(|change| change.to_string()).as_deref(), Some("run"));
        assert_eq!(watch.rest(), None);
    }
}
