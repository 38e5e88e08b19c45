//! From the CAN controller to the TxPDO: drain budgets, RX cache and overflow policies (manual
//! 13.2.2).

use std::collections::VecDeque;

use ecan_protocol::can::CanFrame;
use ecan_protocol::config::{CriticalFrames, DataPathConfig, RxBudget, RxOverflow};

use super::controller::CanController;
use super::diagnostics::ReceiveLosses;
use super::message_ram::Received;
use super::variant::{CriticalSet, RxDrain};
use crate::event_queue::take_first;

/// Largest size of an RX cache, 0xF000:28.
const RX_CACHE_MAX: usize = 32;
/// Frames that the balanced policy drains per service, if the maximum is not lower.
const BALANCED_DRAIN: u8 = 2;

/// Sources in the controller: FIFO1 and the buffers first, which hold frames selected by filters.
const BY_FILTER_FIRST: [u8; 3] = [1, 2, 0];

/// RX cache of one channel with its counters of 0x9020..0x9023.
#[derive(Clone, Debug, Default)]
pub(super) struct ReceivePath {
    drain: RxDrain,
    critical: CriticalSet,
    /// Frames at the front of the cache that may leave it until the next service.
    drained: usize,
    cache: VecDeque<Received>,
    pub(super) counters: ReceiveCounters,
    pub(super) dropped_since_image: u32,
    overflows_in_a_row: u32,
    pub(super) is_degraded: bool,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ReceiveCounters {
    pub(super) high_watermark: u16,
    pub(super) drained_last: u16,
    pub(super) drained_max: u16,
    pub(super) dropped_total: u32,
    pub(super) dropped_old: u32,
    pub(super) dropped_new: u32,
    pub(super) dropped_critical: u32,
    pub(super) consumed_last: u16,
    pub(super) consumed_max: u16,
}

impl ReceivePath {
    pub(super) fn new(drain: RxDrain, critical: CriticalSet) -> Self {
        Self { drain, critical, cache: VecDeque::with_capacity(RX_CACHE_MAX), ..Self::default() }
    }

    pub(super) fn waiting(&self) -> usize {
        self.cache.len()
    }

    /// Returns whether at least three quarters of the configured depth are used.
    pub(super) fn is_under_pressure(&self, policy: &DataPathConfig) -> bool {
        self.cache.len() * 4 >= depth(policy) * 3
    }

    /// Frames that may be packed into an image now.
    pub(super) fn available(&self) -> usize {
        match self.drain {
            RxDrain::Controller => self.cache.len(),
            RxDrain::Cache => self.cache.len().min(self.drained),
        }
    }

    pub(super) fn front(&self) -> Option<&Received> {
        self.cache.front().filter(|_| self.available() > 0)
    }

    pub(super) fn pop(&mut self) -> Option<Received> {
        self.drained = self.drained.saturating_sub(1);
        take_first(&mut self.cache)
    }

    pub(super) fn flush(&mut self) -> usize {
        let lost = self.cache.len();
        self.cache.clear();
        self.overflows_in_a_row = 0;
        self.is_degraded = false;
        lost
    }

    /// Reduces the cache to a smaller depth; the oldest frames are dropped.
    pub(super) fn shrink(&mut self, policy: &DataPathConfig, losses: &mut ReceiveLosses) {
        while self.cache.len() > depth(policy) {
            self.cache.pop_front();
            self.count_drop(Dropped::Old);
            losses.cache_full += 1;
        }
    }

    pub(super) fn note_consumed(&mut self, frames: u16) {
        self.counters.consumed_last = frames;
        self.counters.consumed_max = self.counters.consumed_max.max(frames);
    }

    pub(super) fn note_controller_loss(&mut self) {
        self.count_drop(Dropped::New);
    }

    /// One service: moves frames from the controller to the cache, within the policy's budget and
    /// the `allowance` of the service budget; the configured minimum is always granted. Frames of a
    /// channel that the TxPDO does not carry (`carried` false) are dropped. Returns the number of
    /// frames.
    pub(super) fn drain(
        &mut self,
        controller: &mut CanController,
        policy: &DataPathConfig,
        allowance: u32,
        carried: bool,
        losses: &mut ReceiveLosses,
    ) -> u32 {
        let minimum = policy.rx_drain_min;
        let maximum = policy.rx_drain_max;
        let budget = match policy.rx_budget {
            RxBudget::Balanced => maximum.min(BALANCED_DRAIN),
            RxBudget::Adaptive if self.is_under_pressure(policy) => minimum,
            // with `Performance` for each source
            RxBudget::Limited | RxBudget::Performance | RxBudget::Adaptive => maximum,
        };
        let granted = u32::from(budget.max(minimum)).min(allowance.max(u32::from(minimum)));
        let taken = match self.drain {
            RxDrain::Controller => self.take_granted(controller, policy, granted, carried, losses),
            RxDrain::Cache => {
                self.take_all(controller, policy, carried, losses);
                self.drained = granted as usize;
                self.available() as u32
            }
        };
        let drained = u16::try_from(taken).unwrap_or(u16::MAX);
        self.counters.drained_last = drained;
        self.counters.drained_max = self.counters.drained_max.max(drained);
        if self.is_degraded && self.cache.is_empty() {
            self.is_degraded = false;
            self.overflows_in_a_row = 0;
        }
        taken
    }

    /// Moves `granted` frames from the controller to the cache; returns their number.
    fn take_granted(
        &mut self,
        controller: &mut CanController,
        policy: &DataPathConfig,
        granted: u32,
        carried: bool,
        losses: &mut ReceiveLosses,
    ) -> u32 {
        let rounds: &[&[u8]] = match policy.rx_budget {
            RxBudget::Performance => &[&[0], &[1], &[2]],
            _ => &[&BY_FILTER_FIRST],
        };
        let mut taken = 0;
        for sources in rounds {
            let end = taken + granted;
            while taken < end
                && let Some(received) =
                    sources.iter().find_map(|source| controller.take_received(*source))
            {
                match carried {
                    true => self.accept(received, policy, losses),
                    false => losses.masked += 1,
                }
                taken += 1;
            }
        }
        taken
    }

    /// Moves all frames from the controller to the cache.
    fn take_all(
        &mut self,
        controller: &mut CanController,
        policy: &DataPathConfig,
        carried: bool,
        losses: &mut ReceiveLosses,
    ) {
        while let Some(received) =
            BY_FILTER_FIRST.iter().find_map(|source| controller.take_received(*source))
        {
            match carried {
                true => self.accept(received, policy, losses),
                false => losses.masked += 1,
            }
        }
    }

    fn accept(&mut self, received: Received, policy: &DataPathConfig, losses: &mut ReceiveLosses) {
        if self.cache.len() < depth(policy) {
            self.cache.push_back(received);
            self.overflows_in_a_row = 0;
            let fill = u16::try_from(self.cache.len()).unwrap_or(u16::MAX);
            self.counters.high_watermark = self.counters.high_watermark.max(fill);
            return;
        }
        losses.cache_full += 1;
        self.overflows_in_a_row = self.overflows_in_a_row.saturating_add(1);
        match policy.rx_overflow {
            RxOverflow::DropOldest => {
                self.cache.pop_front();
                self.cache.push_back(received);
                self.count_drop(Dropped::Old);
            }
            RxOverflow::DropNewest => self.count_drop(Dropped::New),
            RxOverflow::PreserveCritical => self.preserve(received, policy),
            RxOverflow::Degraded => {
                if self.overflows_in_a_row >= u32::from(policy.degraded_threshold) {
                    self.is_degraded = true;
                }
                self.count_drop(Dropped::New);
            }
        }
    }

    /// Full cache with the preserve-critical policy: a critical frame replaces an uncritical one;
    /// among critical frames the oldest is dropped.
    fn preserve(&mut self, received: Received, policy: &DataPathConfig) {
        let critical = self.critical;
        if !is_critical(&received.frame, policy.critical_frames, critical) {
            self.count_drop(Dropped::New);
            return;
        }
        let is_replaceable =
            |waiting: &Received| !is_critical(&waiting.frame, policy.critical_frames, critical);
        let victim = self.cache.iter().position(is_replaceable);
        self.cache.remove(victim.unwrap_or(0));
        self.cache.push_back(received);
        self.count_drop(Dropped::Old);
        self.counters.dropped_critical = self.counters.dropped_critical.saturating_add(1);
    }

    fn count_drop(&mut self, which: Dropped) {
        self.counters.dropped_total = self.counters.dropped_total.saturating_add(1);
        self.dropped_since_image = self.dropped_since_image.saturating_add(1);
        let counter = match which {
            Dropped::Old => &mut self.counters.dropped_old,
            Dropped::New => &mut self.counters.dropped_new,
        };
        *counter = counter.saturating_add(1);
    }
}

#[derive(Clone, Copy)]
enum Dropped {
    Old,
    New,
}

fn depth(policy: &DataPathConfig) -> usize {
    usize::from(policy.rx_cache_depth.frames()).min(RX_CACHE_MAX)
}

/// Returns whether a frame belongs to the CANopen services that a policy protects, by the predefined
/// connection set: NMT, EMCY and heartbeat for "CANopen safety"; SYNC, TIME and SDO as well for
/// "CANopen all". No policy protects process data: the next cycle replaces it.
fn is_critical(frame: &CanFrame, policy: CriticalFrames, set: CriticalSet) -> bool {
    let id = frame.id();
    if id.is_extended() {
        return false;
    }
    let safety = matches!(id.raw(), 0x000 | 0x081..=0x0FF | 0x701..=0x77F)
        || set == CriticalSet::WithSync && id.raw() == 0x080;
    let control = matches!(id.raw(), 0x080 | 0x100 | 0x581..=0x5FF | 0x601..=0x67F);
    match policy {
        CriticalFrames::None => false,
        CriticalFrames::CanopenSafety => safety,
        CriticalFrames::CanopenAll => safety || control,
    }
}
