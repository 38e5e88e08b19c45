//! Reads the diagnostics of scheduled transmission in parallel with the cycle (manual 13.2.4, 13.2.5,
//! 13.7).

use ecan_host::{Adapter, DcSync, Error, RequestState, SdoRequestId};
use ecan_protocol::mapping::CHANNELS;

use crate::schedule::config::ScheduleConfig;

const MAINTENANCE: u16 = 0xB000;
const FLAGS: u8 = 6;
const COMMAND: u8 = 4;
/// Maintenance command "clear runtime diagnostics and legacy diagnostic flags".
const CLEAR_DIAGNOSTICS: u8 = 1 << 5;
const PERFORMANCE: u16 = 0x9011;
const DATA_PATH: u16 = 0x9020;
const REQUEST_TIMEOUT_MS: u32 = 2_000;
const NS_PER_MS: u64 = 1_000_000;

/// Counters of one channel, 0x9020..0x9023 (manual 13.2.5).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ChannelDrops {
    /// Times that the controller's FIFO was full, :11.
    pub fifo_full: u32,
    /// Frames dropped as stale, :12.
    pub stale_drops: u32,
    /// Times that the channel went bus-off, :13.
    pub bus_offs: u32,
}

/// Diagnostics of scheduled transmission of a gateway.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ScheduleDiagnostics {
    /// Legacy maintenance flags, 0xB000:06; they stay until they are cleared.
    pub flags: u16,
    /// Per channel; all 0 for one that is not enabled.
    pub channels: [ChannelDrops; CHANNELS],
    /// Sync0 pulses counted, 0x9011:02.
    pub sync0_count: u32,
    /// Smallest distance from a Sync0 pulse to the arrival of an image, in CPU cycles of the
    /// gateway (0x8000:04), 0x9011:04.
    pub phase_min_cycles: i32,
    /// Largest such distance, 0x9011:05.
    pub phase_max_cycles: i32,
    /// Longest service of scheduled frames, in CPU cycles, 0x9011:13.
    pub service_max_cycles: u32,
    /// Time at which the reading ended, in nanoseconds of the library's clock.
    pub read_at_ns: u64,
}

impl ScheduleDiagnostics {
    /// Flag: a scheduled frame was dropped because its phase had passed (SCHED_LATE_DROP).
    pub const LATE_DROP: u16 = 1 << 6;
    /// Flag: a scheduled frame found the queue full (SCHED_QUEUE_FULL).
    pub const QUEUE_FULL: u16 = 1 << 7;
    /// Flag: the CAN controller rejected a scheduled frame at its phase (SCHED_TX_FAIL).
    pub const TX_FAIL: u16 = 1 << 8;
    /// Flag: the timer of scheduled transmission missed a phase (SCHED_TIMER_MISS).
    pub const TIMER_MISS: u16 = 1 << 9;
}

/// Objects of a reading: the flags, then three for each channel, then four of 0x9011.
const PER_CHANNEL: [u8; 3] = [11, 12, 13];
const PER_GATEWAY: [u8; 4] = [2, 4, 5, 13];
const STEPS: usize = 1 + CHANNELS * PER_CHANNEL.len() + PER_GATEWAY.len();

fn object(step: usize) -> (u16, u8) {
    let Some(step) = step.checked_sub(1) else { return (MAINTENANCE, FLAGS) };
    let (channel, field) = (step / PER_CHANNEL.len(), step % PER_CHANNEL.len());
    if channel < CHANNELS {
        return (DATA_PATH + channel as u16, PER_CHANNEL.get(field).copied().unwrap_or_default());
    }
    let field = step - CHANNELS * PER_CHANNEL.len();
    (PERFORMANCE, PER_GATEWAY.get(field).copied().unwrap_or_default())
}

fn store(diagnostics: &mut ScheduleDiagnostics, step: usize, value: u32) {
    match object(step) {
        (MAINTENANCE, _) => diagnostics.flags = value as u16,
        (PERFORMANCE, 2) => diagnostics.sync0_count = value,
        (PERFORMANCE, 4) => diagnostics.phase_min_cycles = value as i32,
        (PERFORMANCE, 5) => diagnostics.phase_max_cycles = value as i32,
        (PERFORMANCE, _) => diagnostics.service_max_cycles = value,
        (index, field) => {
            let channel = usize::from(index.wrapping_sub(DATA_PATH));
            let Some(channel) = diagnostics.channels.get_mut(channel) else { return };
            match field {
                11 => channel.fifo_full = value,
                12 => channel.stale_drops = value,
                _ => channel.bus_offs = value,
            }
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum WatchResult {
    Nothing,
    Looked(ScheduleDiagnostics),
    /// The flags were cleared, or may have been.
    Cleared,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Activity {
    Idle,
    Reading { step: usize },
    Clearing,
}

#[derive(Debug)]
pub(crate) struct ScheduleWatch {
    read: SdoRequestId,
    command: SdoRequestId,
    channel_mask: u8,
    interval_ns: u64,
    /// Time until an accepted frame has met its phase.
    settling_ns: u64,
    activity: Activity,
    is_clear_wanted: bool,
    next_at_ns: u64,
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
        let read = adapter.create_sdo_request(slave, 4)?;
        let command = adapter.create_sdo_request(slave, 1)?;
        for request in [read, command] {
            adapter.sdo_request_timeout(request, REQUEST_TIMEOUT_MS)?;
        }
        Ok(Self {
            read,
            command,
            channel_mask,
            interval_ns: u64::from(settings.watch_ms) * NS_PER_MS,
            settling_ns,
            activity: Activity::Idle,
            is_clear_wanted: false,
            next_at_ns: 0,
            seen: ScheduleDiagnostics::default(),
            last: None,
        })
    }

    pub(crate) fn last(&self) -> Option<&ScheduleDiagnostics> {
        self.last.as_ref()
    }

    pub(crate) fn want_clear(&mut self) {
        self.is_clear_wanted = true;
    }

    /// A new session: a pending reading does not apply to it.
    pub(crate) fn reset(&mut self) {
        self.activity = Activity::Idle;
        self.is_clear_wanted = false;
        self.next_at_ns = 0;
        self.last = None;
    }

    fn is_read(&self, step: usize) -> bool {
        let (index, _) = object(step);
        let channel = index.wrapping_sub(DATA_PATH);
        usize::from(channel) >= CHANNELS || self.channel_mask >> channel & 1 == 1
    }

    /// One step, once a cycle while the gateway is ready. `is_used`: frames have been scheduled.
    pub(crate) fn step(&mut self, adapter: &mut Adapter, is_used: bool) -> WatchResult {
        match self.activity {
            Activity::Idle => {
                if self.is_clear_wanted {
                    self.begin_clear(adapter);
                } else if is_used && self.interval_ns > 0 {
                    let now = adapter.clock().now_ns();
                    if now >= self.next_at_ns {
                        self.next_at_ns = now.saturating_add(self.interval_ns);
                        self.seen = ScheduleDiagnostics::default();
                        self.begin_read(adapter, 0);
                    }
                }
                WatchResult::Nothing
            }
            Activity::Clearing => match adapter.sdo_request_state(self.command) {
                Ok(RequestState::Busy) => WatchResult::Nothing,
                // Whether it succeeded or not, the flags before it are unknown.
                _ => {
                    self.activity = Activity::Idle;
                    self.last = None;
                    self.next_at_ns = 0;
                    WatchResult::Cleared
                }
            },
            Activity::Reading { step } => match adapter.sdo_request_state(self.read) {
                Ok(RequestState::Busy) => WatchResult::Nothing,
                Ok(RequestState::Success) => {
                    let mut value = [0; 4];
                    for (to, from) in value.iter_mut().zip(adapter.sdo_request_data(self.read)) {
                        *to = *from;
                    }
                    store(&mut self.seen, step, u32::from_le_bytes(value));
                    match (step + 1..STEPS).find(|next| self.is_read(*next)) {
                        Some(next) => {
                            self.begin_read(adapter, next);
                            WatchResult::Nothing
                        }
                        None => {
                            self.activity = Activity::Idle;
                            let now = adapter.clock().now_ns();
                            self.seen.read_at_ns = now;
                            self.next_at_ns = self.next_at_ns.max(now + self.settling_ns);
                            WatchResult::Looked(self.seen)
                        }
                    }
                }
                _ => {
                    // The next reading starts from the beginning.
                    self.activity = Activity::Idle;
                    WatchResult::Nothing
                }
            },
        }
    }

    /// Keeps a reading for the comparison with the next one.
    pub(crate) fn keep(&mut self, seen: ScheduleDiagnostics) {
        self.last = Some(seen);
    }

    fn begin_read(&mut self, adapter: &mut Adapter, step: usize) {
        // A request of an earlier session must end first.
        let is_free = !matches!(adapter.sdo_request_state(self.read), Ok(RequestState::Busy));
        let (index, subindex) = object(step);
        let is_begun = is_free && adapter.sdo_request_read(self.read, index, subindex).is_ok();
        self.activity = if is_begun { Activity::Reading { step } } else { Activity::Idle };
    }

    fn begin_clear(&mut self, adapter: &mut Adapter) {
        if matches!(adapter.sdo_request_state(self.command), Ok(RequestState::Busy)) {
            return;
        }
        let command = [CLEAR_DIAGNOSTICS];
        if adapter.sdo_request_write(self.command, MAINTENANCE, COMMAND, &command).is_ok() {
            self.is_clear_wanted = false;
            self.activity = Activity::Clearing;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_step_reads_another_object_and_stores_it() {
        let objects: Vec<_> = (0..STEPS).map(object).collect();
        let mut distinct = objects.clone();
        distinct.sort_unstable();
        distinct.dedup();
        assert_eq!(distinct.len(), STEPS);
        assert_eq!(
            (objects[0], objects[1], objects[12]),
            ((0xB000, 6), (0x9020, 11), (0x9023, 13))
        );
        assert_eq!(objects[13..], [(0x9011, 2), (0x9011, 4), (0x9011, 5), (0x9011, 13)]);
        let mut seen = ScheduleDiagnostics::default();
        for step in 0..STEPS {
            store(&mut seen, step, 100 + step as u32);
        }
        assert_eq!((seen.flags, seen.sync0_count), (100, 113));
        assert_eq!((seen.phase_min_cycles, seen.phase_max_cycles), (114, 115));
        assert_eq!(seen.service_max_cycles, 116);
        let channel = seen.channels[3];
        assert_eq!((channel.fifo_full, channel.stale_drops, channel.bus_offs), (110, 111, 112));
    }
}
