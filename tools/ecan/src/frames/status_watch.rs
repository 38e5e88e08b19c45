use ecan_mcan_port::Session;
use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;

use crate::frames::bit_rates::BitRates;
use crate::frames::channels::{Channels, can_config};
use crate::frames::link::{FrameLink, SessionState};

/// Interval of the lines of a channel with frequent changes, in nanoseconds.
const PAUSE_NS: u64 = 1_000_000_000;
/// Maximum number of lines in a burst.
const AT_ONCE: u64 = 3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Condition {
    state: ChannelState,
    has_warning: bool,
    is_bus_off: bool,
}

impl Condition {
    fn of(status: ChannelStatus) -> Self {
        let (state, has_warning) = (status.state(), status.warn());
        Self { state, has_warning, is_bus_off: status.bus_off() }
    }

    fn is_good(self) -> bool {
        let takes_part = matches!(self.state, ChannelState::Run | ChannelState::Listen);
        takes_part && !self.has_warning && !self.is_bus_off
    }

    fn text(self) -> String {
        match self {
            Self { is_bus_off: true, .. } => "bus-off".to_owned(),
            Self { state, has_warning: true, .. } => {
                format!("{state}, warning: error passive or many errors")
            }
            Self { state, .. } => state.to_string(),
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct LastReported {
    seen: Option<Condition>,
    /// Time until which the line budget is used up.
    paid_until_ns: u64,
    changes: u32,
}

impl LastReported {
    /// Updates the state; returns a line if one is due.
    fn next(&mut self, now: Condition, now_ns: u64) -> Option<String> {
        // There is no status before the first image.
        let is_unknown = self.seen.is_none() && now.state == ChannelState::Disabled;
        if is_unknown {
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

    /// Returns a line for unreported changes.
    fn rest(&mut self) -> Option<String> {
        let message = self.seen?.text();
        match std::mem::take(&mut self.changes) {
            0 => None,
            1 => Some(message),
            several => Some(format!("{message} ({several} changes)")),
        }
    }
}

/// Reported number of losses, for example of lost images.
#[derive(Debug, Default)]
pub struct Losses {
    reported: u64,
    next_ns: u64,
}

impl Losses {
    /// Updates the number; returns the number to report, at most once per interval.
    pub fn next(&mut self, lost: u64, now_ns: u64) -> Option<u64> {
        let new = lost.saturating_sub(self.reported);
        if new == 0 || now_ns < self.next_ns {
            return None;
        }
        *self = Self { reported: lost, next_ns: now_ns.saturating_add(PAUSE_NS) };
        Some(new)
    }
}

/// Reported state of a gateway.
#[derive(Debug)]
struct GatewayWatch {
    gateway: usize,
    /// Names the gateway if there are several.
    prefix: String,
    channels: Channels,
    reported: [LastReported; CHANNELS],
    session: SessionState,
    losses: Losses,
    /// Images before the gateway started its sequence again.
    unknown: Losses,
}

impl GatewayWatch {
    fn new(gateway: usize, prefix: String, channels: Channels, link: &dyn FrameLink) -> Self {
        let counters = link.statistics(gateway);
        let since = |reported| Losses { reported, ..Losses::default() };
        Self {
            gateway,
            prefix,
            channels,
            reported: Default::default(),
            session: SessionState::Of(Session::Ready),
            losses: since(counters.txpdo_lost),
            unknown: since(counters.txpdo_unknown),
        }
    }

    fn look(&mut self, link: &dyn FrameLink, now_ns: u64, report: &mut impl FnMut(String)) {
        let session = link.session(self.gateway);
        if session != self.session {
            self.session = session;
            report(format!("{}gateway: {session}", self.prefix));
        }
        self.report_losses(link, now_ns, report);
        if !session.is_ready() {
            return;
        }
        for channel in self.channels.iter() {
            let now = Condition::of(link.channel_status(self.gateway, channel));
            let reported = self.reported.get_mut(usize::from(channel));
            let Some(message) = reported.and_then(|reported| reported.next(now, now_ns)) else {
                continue;
            };
            let can = can_config(link.port_config(), self.gateway, channel);
            let rates = can.filter(|_| now.has_warning || now.is_bus_off);
            let rates = rates.map_or_else(String::new, |can| format!(", at {}", BitRates::of(can)));
            report(format!("{}can{channel}: {message}{rates}", self.prefix));
        }
    }

    fn finish(&mut self, link: &dyn FrameLink, report: &mut impl FnMut(String)) {
        self.report_losses(link, u64::MAX, report);
        for (channel, reported) in self.reported.iter_mut().enumerate() {
            if let Some(message) = reported.rest() {
                report(format!("{}can{channel}: {message}", self.prefix));
            }
        }
    }

    fn report_losses(
        &mut self,
        link: &dyn FrameLink,
        now_ns: u64,
        report: &mut impl FnMut(String),
    ) {
        let (counters, prefix) = (link.statistics(self.gateway), &self.prefix);
        if let Some(lost) = self.losses.next(counters.txpdo_lost, now_ns) {
            report(format!("{prefix}gateway: {lost} images lost, received frames may be missing"));
        }
        if let Some(unknown) = self.unknown.next(counters.txpdo_unknown, now_ns) {
            report(format!(
                "{prefix}gateway: up to {unknown} images unknown, received frames may be missing"
            ));
        }
    }
}

#[derive(Debug)]
pub struct StatusWatch {
    gateways: Vec<GatewayWatch>,
}

impl StatusWatch {
    /// Starts with ready gateways and running channels: the position of each gateway, and the
    /// channels whose changes are reported.
    pub fn new(gateways: &[(usize, Channels)], link: &dyn FrameLink) -> Self {
        let watch = |(gateway, (position, channels)): (usize, &(usize, Channels))| {
            let prefix = match gateways {
                [_] => String::new(),
                _ => format!("slave {position} "),
            };
            GatewayWatch::new(gateway, prefix, *channels, link)
        };
        Self { gateways: gateways.iter().enumerate().map(watch).collect() }
    }

    /// Passes a line for each change to `report`: lost images, and up to one per second and channel in
    /// the long run.
    pub fn look(&mut self, link: &dyn FrameLink, now_ns: u64, mut report: impl FnMut(String)) {
        self.gateways.iter_mut().for_each(|it| it.look(link, now_ns, &mut report));
    }

    pub fn finish(&mut self, link: &dyn FrameLink, mut report: impl FnMut(String)) {
        self.gateways.iter_mut().for_each(|it| it.finish(link, &mut report));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frequent_changes_are_reported_once_a_second() {
        let condition =
            |is_bus_off| Condition { state: ChannelState::Run, has_warning: false, is_bus_off };
        let mut reported = LastReported::default();
        assert_eq!(reported.next(condition(false), 0), None);
        let lines: Vec<_> = (1..=3000_u64)
            .filter_map(|ms| reported.next(condition(ms % 2 == 1), ms * 1_000_000))
            .collect();
        let later = ["bus-off (998 changes)", "bus-off (1000 changes)"];
        assert_eq!(lines, [&["bus-off", "run", "bus-off"][..], &later].concat());
        // Withheld changes are reported later, even without new changes.
        let last = reported.next(condition(false), 3_500_000_000);
        assert_eq!(last.as_deref(), Some("run (999 changes)"));
        assert_eq!(reported.next(condition(false), 9_000_000_000), None);
        assert_eq!(reported.rest(), None);
        let at_once = [true, false, true, false]
            .map(|is_off| reported.next(condition(is_off), 9_000_000_000));
        assert_eq!(at_once.iter().flatten().count(), 3);
        assert_eq!(reported.rest().as_deref(), Some("run"));
    }
}
