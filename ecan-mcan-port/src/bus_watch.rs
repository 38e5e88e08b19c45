//! Changes of gateways and channels, each told once.

use std::fmt;
use std::time::Duration;

use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;

use crate::address::{ChannelHandle, GatewayHandle};
use crate::port::Port;
use crate::session::machine::Session;
use crate::session::verification::{PendingStep, VerificationFault};

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
    gateways: Vec<GatewayWatch>,
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
    /// The verification of the gateway failed; it is repeated every second.
    Failed(VerificationFault),
    /// The gateway is ready, this time after its loss; `None` without a loss since the begin of the watch.
    Ready(Option<Duration>),
    /// The condition of this channel changed, while its gateway is ready.
    Channel(u8, ChannelChange),
}

impl BusWatch {
    /// Starts with the present states.
    pub fn new(port: &Port) -> Self {
        let start_ns = port.adapter().clock().now_ns();
        let watch = |gateway| GatewayWatch {
            gateway,
            outage: (!port.gateway_is_ready(gateway)).then(|| Outage::begin(None)),
            channels: [ChannelWatch::default(); CHANNELS],
        };
        Self { start_ns, gateways: port.gateways().map(watch).collect() }
    }

    /// The changes up to the last cycle. Those of a channel are told up to once per second in the long run, with
    /// their number.
    pub fn changes(&mut self, port: &Port) -> impl Iterator<Item = BusChange> {
        let now_ns = port.adapter().clock().now_ns();
        let time = Duration::from_nanos(now_ns.saturating_sub(self.start_ns));
        let mut watches = self.gateways.iter_mut();
        let mut current = watches.next();
        std::iter::from_fn(move || {
            while let Some(watch) = &mut current {
                if let Some(event) = watch.next(port, now_ns) {
                    return Some(BusChange { time, gateway: watch.gateway, event });
                }
                current = watches.next();
            }
            None
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
            Self::Failed(fault) => write!(f, "not ready: {fault}"),
            Self::Ready(None) => f.write_str("ready"),
            Self::Ready(Some(after)) => write!(f, "ready after {:.3} s", after.as_secs_f64()),
            Self::Channel(channel, change) => write!(f, "channel {channel}: {change}"),
        }
    }
}

#[derive(Debug)]
struct GatewayWatch {
    gateway: GatewayHandle,
    outage: Option<Outage>,
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
    fault: Option<VerificationFault>,
}

impl Outage {
    fn begin(since_ns: Option<u64>) -> Self {
        Self {
            since_ns,
            told: 0,
            step: PendingStep::Operational,
            step_since_ns: since_ns.unwrap_or_default(),
            fault: None,
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
    fn next(&mut self, port: &Port, now_ns: u64) -> Option<BusEvent> {
        let gateway = self.gateway;
        let Some(waits_for) = port.waiting_for(gateway) else {
            return self.next_of_ready(port, now_ns);
        };
        let Some(outage) = &mut self.outage else {
            self.outage.insert(Outage::begin(Some(now_ns))).tell(waits_for);
            return Some(BusEvent::Lost(waits_for));
        };
        if let Session::Failed(fault) = port.session(gateway)
            && outage.fault.replace(fault) != Some(fault)
        {
            return Some(BusEvent::Failed(fault));
        }
        outage.is_news(waits_for, now_ns).then_some(BusEvent::Waits(waits_for))
    }

    fn next_of_ready(&mut self, port: &Port, now_ns: u64) -> Option<BusEvent> {
        if let Some(Outage { since_ns, .. }) = self.outage.take() {
            let after = since_ns.map(|since_ns| now_ns.saturating_sub(since_ns));
            return Some(BusEvent::Ready(after.map(Duration::from_nanos)));
        }
        (0_u8..).zip(&mut self.channels).find_map(|(channel, watch)| {
            let handle = port.channel(self.gateway.slave(), channel).ok()?;
            let change = watch.next(port.channel_status(handle), now_ns)?;
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
pub struct ChannelWatch {
    seen: Option<Condition>,
    /// Time until which the budget of changes is used up.
    paid_until_ns: u64,
    changes: u32,
}

impl ChannelWatch {
    /// Takes the present status; returns a change if one is due.
    pub fn next(&mut self, status: ChannelStatus, now_ns: u64) -> Option<ChannelChange> {
        let now = Condition::of(status);
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
    pub fn rest(&mut self) -> Option<ChannelChange> {
        let changes = std::mem::take(&mut self.changes);
        (changes > 0).then_some(ChannelChange { condition: self.seen?, changes })
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
            watch.next(status(is_bus_off), now_ms * MS).map(|change| change.to_string())
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
