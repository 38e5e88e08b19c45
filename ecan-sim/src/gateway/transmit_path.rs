//! From the RxPDO to the CAN controller: TX ring, service budget, and overflow policies (manual 10,
//! 13.2.2).
//!
//! Scheduled transmission: frames that wait for a phase of a Sync0 cycle
//! (manual 8.4 and 13.8).

use std::collections::VecDeque;

use ecan_protocol::can::CanFrame;
use ecan_protocol::config::{DataPathConfig, TxOverflow};
use ecan_protocol::image::{ResultCode, TxResult};

use super::controller::{CanController, Rejection};
use super::diagnostics::{GatewayCounters, TransmitLosses};
use super::variant::{GatewayVariant, ScheduledResults, TxResults, UnsendableResult};
use crate::event_queue::take_first;
use crate::random::Random;

/// Size of a TX ring, 0xF000:29.
const TX_RING: usize = 64;
/// TX_RESULT packets that can wait for a TxPDO image: those of two full images.
const RESULTS_MAX: usize = 512;
/// Longest backoff, in doublings of the base.
const BACKOFF_DOUBLINGS: u32 = 4;

/// Image and frame that a TX_RESULT refers to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Reference {
    pub(super) channel: u8,
    pub(super) sequence: u16,
    pub(super) frame_index: u8,
}

/// A frame in the TX ring. `reference` is set until its result is reported.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pending {
    pub(super) frame: CanFrame,
    pub(super) reference: Option<Reference>,
}

#[derive(Clone, Debug)]
pub(super) struct ResultQueue {
    results: VecDeque<TxResult>,
    /// Results of the image in progress, not sorted yet.
    fresh: Vec<TxResult>,
    frames: TxResults,
    of_scheduled: ScheduledResults,
    of_unsendable: UnsendableResult,
}

impl ResultQueue {
    pub(super) fn new(variant: &GatewayVariant) -> Self {
        Self {
            results: VecDeque::with_capacity(RESULTS_MAX),
            fresh: Vec::with_capacity(RESULTS_MAX),
            frames: variant.tx_results,
            of_scheduled: variant.scheduled_results,
            of_unsendable: variant.unsendable_result,
        }
    }

    /// Adds the result of a frame of the image in progress, if it is requested.
    pub(super) fn report(&mut self, reference: Option<Reference>, code: ResultCode) {
        let is_wanted = (self.frames == TxResults::EachFrame || !code.is_success())
            && (code != ResultCode::InvalidChannel
                || self.of_unsendable == UnsendableResult::InvalidChannel);
        if let Some(Reference { channel, sequence, frame_index }) = reference
            && is_wanted
            && self.fresh.len() < RESULTS_MAX
        {
            self.fresh.push(TxResult { channel, sequence, frame_index, code });
        }
    }

    /// Adds the second result of a scheduled frame, if the variant has it.
    pub(super) fn report_released(
        &mut self,
        reference: Option<Reference>,
        rejection: Option<Rejection>,
    ) {
        let code = match rejection {
            None => ResultCode::Ok,
            Some(Rejection::Full) => ResultCode::TxFifoFull,
            Some(Rejection::BusOff) => ResultCode::BusOff,
            Some(Rejection::CannotSend) => ResultCode::InvalidChannel,
        };
        if self.of_scheduled == ScheduledResults::Two {
            self.report(reference, code);
        }
    }

    /// Ends an image: queues its results in the order of its frames.
    pub(super) fn settle(&mut self, counters: &mut GatewayCounters) {
        self.fresh.sort_unstable_by_key(|result| result.frame_index);
        for result in self.fresh.drain(..) {
            if self.results.len() >= RESULTS_MAX {
                self.results.pop_front();
                counters.results_lost += 1;
            }
            self.results.push_back(result);
        }
    }

    pub(super) fn front(&self) -> Option<&TxResult> {
        self.results.front()
    }

    pub(super) fn pop(&mut self) -> Option<TxResult> {
        take_first(&mut self.results)
    }

    pub(super) fn clear(&mut self) {
        self.results.clear();
        self.fresh.clear();
    }
}

/// TX ring of one channel with its counters of 0x9020..0x9023.
#[derive(Clone, Debug, Default)]
pub(super) struct TransmitPath {
    ring: VecDeque<Pending>,
    backoff_left: u32,
    backoff_step: u32,
    congested_services: u32,
    pub(super) is_degraded: bool,
    pub(super) counters: TransmitCounters,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TransmitCounters {
    pub(super) fifo_full: u32,
    pub(super) backpressure: u32,
    pub(super) stale_dropped: u32,
}

impl TransmitPath {
    pub(super) fn new() -> Self {
        Self { ring: VecDeque::with_capacity(TX_RING), ..Self::default() }
    }

    pub(super) fn waiting(&self) -> usize {
        self.ring.len()
    }

    pub(super) fn is_filled_to(&self, percent: u8) -> bool {
        self.ring.len() * 100 >= TX_RING * usize::from(percent)
    }

    /// Puts a frame into the ring; the overflow policy decides which frame a full ring drops. `Err`
    /// is the result code of a rejected new frame.
    pub(super) fn enqueue(
        &mut self,
        pending: Pending,
        policy: &DataPathConfig,
        results: &mut ResultQueue,
        losses: &mut TransmitLosses,
    ) -> Result<(), ResultCode> {
        if self.is_degraded || self.ring.len() >= TX_RING {
            self.note_backpressure();
            if self.is_degraded || policy.tx_overflow != TxOverflow::DropOldest {
                losses.ring_full += 1;
                let is_busy = self.is_degraded || self.backoff_left > 0;
                return Err(if is_busy { ResultCode::BusBusy } else { ResultCode::TxFifoFull });
            }
            if let Some(oldest) = self.ring.pop_front() {
                self.counters.stale_dropped = self.counters.stale_dropped.saturating_add(1);
                losses.stale += 1;
                results.report(oldest.reference, ResultCode::TxFifoFull);
            }
        }
        self.ring.push_back(pending);
        Ok(())
    }

    /// One service: hands frames to the controller, within the policy's budget and the `allowance`
    /// of the service budget; the configured minimum is always granted, even during a backoff.
    /// Returns the number of frames.
    pub(super) fn serve(
        &mut self,
        controller: &mut CanController,
        policy: &DataPathConfig,
        allowance: u32,
        results: &mut ResultQueue,
        counters: &mut GatewayCounters,
    ) -> u32 {
        let minimum = u32::from(policy.tx_budget_min);
        let maximum = u32::from(policy.tx_budget_max).max(minimum);
        let mut granted = maximum.min(allowance.max(minimum));
        if self.backoff_left > 0 {
            self.backoff_left -= 1;
            granted = minimum;
        }
        let mut sent = 0;
        while sent < granted
            && let Some(pending) = self.ring.front().copied()
        {
            let code = match controller.submit(pending.frame) {
                Ok(()) => {
                    counters.frames_to_controller += 1;
                    ResultCode::Ok
                }
                Err(Rejection::Full) => {
                    self.note_fifo_full();
                    self.congest(policy);
                    return sent;
                }
                Err(Rejection::BusOff) => break,
                Err(Rejection::CannotSend) => {
                    counters.transmit_losses.invalid_channel += 1;
                    ResultCode::InvalidChannel
                }
            };
            take_first(&mut self.ring);
            sent += 1;
            results.report(pending.reference, code);
        }
        if sent > 0 || self.ring.is_empty() {
            self.congested_services = 0;
            self.backoff_step = 0;
        }
        if self.ring.is_empty() {
            self.is_degraded = false;
        }
        sent
    }

    /// Reports the frames of the image in progress that stay in the ring as queued.
    pub(super) fn report_queued(&mut self, results: &mut ResultQueue) {
        for pending in &mut self.ring {
            results.report(pending.reference.take(), ResultCode::Queued);
        }
    }

    /// Drops everything as stale; returns the number of frames.
    pub(super) fn flush(&mut self) -> usize {
        let dropped = self.drop_unsent();
        self.note_stale(dropped);
        let ring = std::mem::take(&mut self.ring);
        *self = Self { ring, counters: self.counters, ..Self::default() };
        dropped
    }

    /// Drops all unsent frames without counting them as stale: a test policy disables sending.
    pub(super) fn drop_unsent(&mut self) -> usize {
        let dropped = self.ring.len();
        self.ring.clear();
        dropped
    }

    pub(super) fn note_stale(&mut self, frames: usize) {
        let frames = u32::try_from(frames).unwrap_or(u32::MAX);
        self.counters.stale_dropped = self.counters.stale_dropped.saturating_add(frames);
    }

    pub(super) fn note_fifo_full(&mut self) {
        self.counters.fifo_full = self.counters.fifo_full.saturating_add(1);
        self.note_backpressure();
    }

    fn note_backpressure(&mut self) {
        self.counters.backpressure = self.counters.backpressure.saturating_add(1);
    }

    fn congest(&mut self, policy: &DataPathConfig) {
        self.congested_services = self.congested_services.saturating_add(1);
        match policy.tx_overflow {
            TxOverflow::Backoff if self.backoff_left == 0 => {
                self.backoff_left = u32::from(policy.backoff_base_cycles) << self.backoff_step;
                self.backoff_step = (self.backoff_step + 1).min(BACKOFF_DOUBLINGS);
            }
            TxOverflow::Degraded
                if self.congested_services >= u32::from(policy.degraded_threshold) =>
            {
                self.is_degraded = true;
            }
            _ => {}
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Scheduled {
    pub(super) due_ns: u64,
    pub(super) channel: usize,
    pub(super) frame: CanFrame,
    /// For a result when the phase has come.
    pub(super) reference: Option<Reference>,
}

/// Waiting frames in the order of their phases; equal phases keep PDO order.
#[derive(Clone, Debug)]
pub(super) struct ScheduleQueue {
    entries: VecDeque<Scheduled>,
    /// Largest number of waiting frames.
    depth: usize,
    /// Upper bound of the timer delay, and the seed of its random numbers.
    jitter_ns: u64,
    seed: u64,
}

impl ScheduleQueue {
    pub(super) fn new(depth: usize, jitter_ns: u64, seed: u64) -> Self {
        Self { entries: VecDeque::with_capacity(depth), depth, jitter_ns, seed }
    }

    /// Timer delay at a phase: random, equal for all frames of a phase.
    fn timer_delay(&self, due_ns: u64) -> u64 {
        match self.jitter_ns {
            0 => 0,
            jitter_ns => Random::new(self.seed ^ due_ns).below(jitter_ns + 1),
        }
    }

    /// Adds a frame; returns `false` if the queue is full.
    pub(super) fn insert(&mut self, entry: Scheduled) -> bool {
        if self.entries.len() >= self.depth {
            return false;
        }
        let index = self.entries.partition_point(|waiting| waiting.due_ns <= entry.due_ns);
        self.entries.insert(index, entry);
        true
    }

    /// When the next frame goes to its controller.
    pub(super) fn next_due(&self) -> Option<u64> {
        self.entries
            .front()
            .map(|entry| entry.due_ns.saturating_add(self.timer_delay(entry.due_ns)))
    }

    pub(super) fn pop_due(&mut self, now: u64) -> Option<Scheduled> {
        if self.next_due()? <= now { self.entries.pop_front() } else { None }
    }

    pub(super) fn waiting(&self, channel: usize) -> usize {
        self.entries.iter().filter(|entry| entry.channel == channel).count()
    }

    pub(super) fn flush(&mut self) -> usize {
        let dropped = self.entries.len();
        self.entries.clear();
        dropped
    }

    pub(super) fn flush_channel(&mut self, channel: usize) -> usize {
        let before = self.entries.len();
        self.entries.retain(|entry| entry.channel != channel);
        before - self.entries.len()
    }
}
