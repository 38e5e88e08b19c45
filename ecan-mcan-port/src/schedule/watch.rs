//! Reads the diagnostics of scheduled transmission in parallel with the cycle.

use ecan_host::{Adapter, DcSync, Error, RequestState, SdoRequestId};

use super::diagnostics::{Object, ScheduleDiagnostics, decisive_objects, other_objects};
use crate::config::ScheduleConfig;

/// Object and value that clear the diagnostics and legacy flags (manual 13.7).
const MAINTENANCE_COMMAND: Object = (0xB000, 4);
const CLEAR_DIAGNOSTICS: u8 = 1 << 5;
const NS_PER_MS: u64 = 1_000_000;
/// Failed readings in a row after which an object counts as unreadable: a single transfer also fails if it meets
/// another one in the mailbox.
const FAILURES_MAX: u8 = 3;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum WatchResult {
    Nothing,
    /// A reading follows when the frames that are accepted by now have met their phase.
    Due,
    /// A reading of what decides on these frames, and the one before.
    Looked(ScheduleDiagnostics, Option<ScheduleDiagnostics>),
    /// Several readings in a row failed at this object, which decides on frames.
    Unreadable(Object),
    /// The flags were cleared, or may have been.
    Cleared,
}

/// Transfers of a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Reading {
    since_ns: u64,
    begun: usize,
    ended: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Activity {
    Idle,
    /// The frames meet their phase until this time.
    Settling(u64),
    Reading(Reading),
}

/// Each read has a request of its own: the master executes requests that are queued together one
/// after the other, in the order in which they were created. Between single ones it polls all
/// slaves, which takes longer than a transfer.
#[derive(Debug)]
pub(crate) struct ScheduleWatch {
    /// One for each decisive object, and after the command one for the others.
    requests: Vec<SdoRequestId>,
    command: SdoRequestId,
    /// Objects that decide on frames.
    decisive: Vec<Object>,
    /// The other objects: one of them with each reading, in turn.
    others: Vec<Object>,
    /// Number of reads of them in this session.
    others_read: usize,
    interval_ns: u64,
    /// Time until an accepted frame has met its phase.
    settling_ns: u64,
    activity: Activity,
    is_clear_wanted: bool,
    is_clearing: bool,
    next_at_ns: u64,
    /// Readings in a row that failed at a decisive object, and at one of the others.
    failures: u8,
    other_failures: u8,
    /// Others read since one of them was skipped.
    others_known: usize,
    seen: ScheduleDiagnostics,
    last: Option<ScheduleDiagnostics>,
}

impl ScheduleWatch {
    /// Creates the requests; the Adapter must be configured and not yet active.
    pub(crate) fn new(
        adapter: &mut Adapter,
        slave: usize,
        channel_mask: u8,
        settings: &ScheduleConfig,
        dc: Option<DcSync>,
    ) -> Result<Self, Error> {
        // The pulse comes within one Sync0 period, the phase after it within another.
        let settling_ns = dc.map_or(0, |dc| 2 * u64::from(dc.cycle_ns()))
            + u64::from(adapter.config().cycle_ns());
        let mut request = |size| {
            let request = adapter.requests().create_sdo(slave, size)?;
            // It waits for the requests of all slaves.
            adapter.requests().sdo_timeout(request, 0)?;
            Ok::<_, Error>(request)
        };
        let decisive: Vec<_> = decisive_objects(channel_mask).collect();
        let mut requests = Vec::new();
        for _ in &decisive {
            requests.push(request(4)?);
        }
        let command = request(1)?;
        requests.push(request(4)?);
        Ok(Self {
            requests,
            command,
            decisive,
            others: other_objects(channel_mask).collect(),
            others_read: 0,
            interval_ns: u64::from(settings.watch_ms) * NS_PER_MS,
            settling_ns,
            activity: Activity::Idle,
            is_clear_wanted: false,
            is_clearing: false,
            next_at_ns: 0,
            failures: 0,
            other_failures: 0,
            others_known: 0,
            seen: ScheduleDiagnostics::default(),
            last: None,
        })
    }

    pub(crate) fn last(&self) -> Option<&ScheduleDiagnostics> {
        self.last.as_ref().filter(|_| self.others_known >= self.others.len())
    }

    /// Request and object of a transfer of a reading.
    fn transfer(&self, number: usize) -> Option<(SdoRequestId, Object)> {
        let other = self.others_read.checked_rem(self.others.len());
        let object = self.decisive.get(number).or_else(|| self.others.get(other?))?;
        Some((*self.requests.get(number)?, *object))
    }

    fn has_all(&self) -> bool {
        self.others_read >= self.others.len()
    }

    pub(crate) fn want_clear(&mut self) {
        self.is_clear_wanted = true;
    }

    /// A new session: a pending reading does not apply to it. A pending clear does, because the
    /// master may still execute it.
    pub(crate) fn reset(&mut self) {
        self.activity = Activity::Idle;
        self.is_clear_wanted = false;
        self.next_at_ns = 0;
        self.seen = ScheduleDiagnostics::default();
        self.others_read = 0;
        self.others_known = 0;
        (self.failures, self.other_failures) = (0, 0);
        self.last = None;
    }

    /// One step, once a cycle while the gateway is ready. `is_used`: frames have been scheduled.
    pub(crate) fn step(&mut self, adapter: &mut Adapter, is_used: bool) -> WatchResult {
        let now_ns = adapter.clock().now_ns();
        let may_read = is_used && self.interval_ns > 0;
        if self.is_clearing {
            // Checked before the reads: one that ends in the same cycle may have followed the clear.
            if !is_busy(adapter, self.command) {
                return self.on_flags_cleared();
            }
        } else if self.is_clear_wanted {
            // The decisive reads come first: otherwise frames before the clear are unknown.
            match self.activity {
                Activity::Settling(_) => {}
                Activity::Reading(reading) if reading.ended < self.decisive.len() => {
                    self.clear(adapter)
                }
                _ if may_read => (self.activity, self.next_at_ns) = (Activity::Idle, now_ns),
                _ => self.clear(adapter),
            }
        }
        match self.activity {
            Activity::Idle if may_read && !self.is_clearing && now_ns >= self.next_at_ns => {
                self.activity = Activity::Settling(now_ns.saturating_add(self.settling_ns));
                return WatchResult::Due;
            }
            Activity::Settling(until_ns) if now_ns >= until_ns => {
                let reading = Reading { since_ns: now_ns, begun: 0, ended: 0 };
                return self.read(adapter, reading, now_ns);
            }
            Activity::Reading(reading) => return self.read(adapter, reading, now_ns),
            _ => {}
        }
        WatchResult::Nothing
    }

    /// Begins one transfer and ends one: the master takes longer than a cycle for each.
    fn read(&mut self, adapter: &mut Adapter, mut reading: Reading, now_ns: u64) -> WatchResult {
        if let Some((request, (index, subindex))) = self.transfer(reading.begun)
            // One of an earlier reading must end first.
            && !is_busy(adapter, request)
            && adapter.requests().sdo_read(request, index, subindex).is_ok()
        {
            reading.begun += 1;
        }
        self.activity = Activity::Reading(reading);
        let is_begun = reading.ended < reading.begun;
        let Some((request, object)) = self.transfer(reading.ended).filter(|_| is_begun) else {
            return WatchResult::Nothing;
        };
        match adapter.requests().sdo_state(request) {
            Ok(RequestState::Success) => {}
            Ok(RequestState::Busy) => return WatchResult::Nothing,
            _ => return self.on_failed_reading(reading, object, now_ns),
        }
        let mut value = [0; 4];
        for (to, from) in value.iter_mut().zip(adapter.requests().sdo_data(request)) {
            *to = *from;
        }
        self.seen.store(object, u32::from_le_bytes(value));
        reading.ended += 1;
        self.activity = Activity::Reading(reading);
        if reading.ended == self.decisive.len() {
            self.seen.read_at_ns = now_ns;
            self.failures = 0;
            return WatchResult::Looked(self.seen, self.last.replace(self.seen));
        }
        if reading.ended == self.requests.len() {
            self.others_read += 1;
            self.others_known += 1;
            self.other_failures = 0;
            self.end_reading(reading, now_ns);
        }
        WatchResult::Nothing
    }

    /// A transfer failed. One of the other objects that fails again and again is skipped.
    fn on_failed_reading(&mut self, reading: Reading, object: Object, now_ns: u64) -> WatchResult {
        let is_decisive = reading.ended < self.decisive.len();
        let failures = if is_decisive { &mut self.failures } else { &mut self.other_failures };
        *failures = failures.saturating_add(1);
        let is_final = *failures >= FAILURES_MAX;
        if is_final && !is_decisive {
            self.others_read += 1;
            (self.others_known, self.other_failures) = (0, 0);
        }
        self.end_reading(reading, now_ns);
        match is_final && is_decisive {
            true => WatchResult::Unreadable(object),
            false => WatchResult::Nothing,
        }
    }

    /// The next reading waits at least as long as this one took: while requests are queued, the master
    /// serves no other gateway after this one, no other program, and polls no slave.
    fn end_reading(&mut self, reading: Reading, now_ns: u64) {
        self.activity = Activity::Idle;
        let taken_ns = now_ns.saturating_sub(reading.since_ns);
        let interval_ns = if self.has_all() { self.interval_ns } else { 0 };
        let pause_end_ns = now_ns.saturating_add(taken_ns);
        self.next_at_ns = pause_end_ns.max(reading.since_ns.saturating_add(interval_ns));
    }

    fn clear(&mut self, adapter: &mut Adapter) {
        let (index, subindex) = MAINTENANCE_COMMAND;
        let is_begun = adapter
            .requests()
            .sdo_write(self.command, index, subindex, &[CLEAR_DIAGNOSTICS])
            .is_ok();
        self.is_clearing |= is_begun;
        self.is_clear_wanted &= !is_begun;
    }

    /// The flags before the command are unknown, even if it failed.
    fn on_flags_cleared(&mut self) -> WatchResult {
        self.is_clearing = false;
        self.activity = Activity::Idle;
        self.next_at_ns = 0;
        self.last = None;
        WatchResult::Cleared
    }
}

fn is_busy(adapter: &mut Adapter, request: SdoRequestId) -> bool {
    matches!(adapter.requests().sdo_state(request), Ok(RequestState::Busy))
}
