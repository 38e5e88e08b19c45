//! Counters, cycle performance (0x9011) and emergencies of a gateway.
//!
//! 0x9011: interrupt counts and cost of the hot paths (manual 13.2.4).
//!
//! The model has no hot path to measure, so costs follow from the work: a fixed part and a part per
//! packet, frame or byte, in CPU cycles. They are plausible, not measured.
//!
//! CoE emergencies that wait for the master (ETG.1000.6, CiA 301).
//!
//! The manual specifies no emergencies. The codes are those of CiA 301 for the same events. A front
//! end without mailbox bytes never fetches any; a full queue drops the oldest.

use std::collections::VecDeque;

use ecan_protocol::device::AlStatusCode;

use super::dc_clock::PulseTrain;
use super::variant::PhaseUnit;

/// Frames from RxPDO images that never reached the CAN bus, by cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TransmitLosses {
    /// The channel could not send: not applied, listening, or FD frame on a classic channel.
    pub invalid_channel: u64,
    /// The channel was bus-off.
    pub bus_off: u64,
    /// The TX ring was full and the overflow policy rejected the new frame.
    pub ring_full: u64,
    /// A queued frame was replaced by a newer one, or became stale by bus-off, restart or leaving
    /// OP.
    pub stale: u64,
    /// Scheduled frame whose phase had passed.
    pub late: u64,
    /// Scheduled frame for a full schedule queue.
    pub schedule_full: u64,
    /// Scheduled frame that the controller rejected at its phase, or whose Sync0 stopped.
    pub schedule_failed: u64,
    /// Skipped by a bypass option or a test policy of 0x8030.
    pub bypassed: u64,
    /// Beyond the budget of the channel in the image, if the variant applies it.
    pub over_budget: u64,
    /// Abandoned by the controller because automatic retransmission is off.
    pub not_retransmitted: u64,
}

/// Frames from the CAN bus that never reached a TxPDO image, by cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceiveLosses {
    /// Rejected by a filter, a non-match rule or a remote rule.
    pub filtered: u64,
    /// The controller's FIFO or buffer was full.
    pub controller_full: u64,
    /// Dropped by the overflow policy of the RX cache.
    pub cache_full: u64,
    /// Too large for the channel's share of any image.
    pub oversized: u64,
    /// Channel outside the TxPDO channel mask.
    pub masked: u64,
    /// Flushed by a restart of the channel or by power loss.
    pub flushed: u64,
}

/// Counters of a gateway since its creation; they survive power cycles and every clear command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GatewayCounters {
    /// Complete SM2 writes accepted from the master.
    pub images_written: u64,
    /// Images among them that arrived within the window around a Sync0 pulse
    /// ([`Sync0Window`](crate::Sync0Window)): the firmware read them only after the next write was
    /// rejected.
    pub outputs_missed: u64,
    /// SM2 writes rejected, for example because the buffer was full.
    pub writes_rejected: u64,
    /// Images parsed without error.
    pub images_parsed: u64,
    /// Repeated images.
    pub images_repeated: u64,
    /// Invalid images.
    pub images_faulty: u64,
    /// Valid frames in RxPDO images.
    pub frames_parsed: u64,
    /// Frames handed to a CAN controller.
    pub frames_to_controller: u64,
    /// Frames sent on a bus.
    pub frames_on_bus: u64,
    /// Frames accepted into the schedule queue.
    pub frames_scheduled: u64,
    /// Scheduled frames released at their phase.
    pub frames_released: u64,
    /// Frames lost towards the bus.
    pub transmit_losses: TransmitLosses,
    /// Frames received by the controllers.
    pub frames_from_bus: u64,
    /// Frames packed into TxPDO images.
    pub frames_to_master: u64,
    /// Frames lost towards the master.
    pub receive_losses: ReceiveLosses,
    /// TX_RESULT packets packed into TxPDO images.
    pub results_to_master: u64,
    /// TX_RESULT packets lost in a full queue.
    pub results_lost: u64,
    /// TxPDO images published in SM3.
    pub images_published: u64,
    /// TxPDO images that the master has read.
    pub images_read: u64,
    /// SM3 reads rejected, for example because the buffer was empty.
    pub reads_rejected: u64,
    /// Data-path services run.
    pub services: u64,
    /// Transitions out of OP by the gateway itself.
    pub al_errors: u64,
}

/// CPU cycles per two and a half nanoseconds: 400 MHz (0x8000:4).
const CYCLES_NUMERATOR: u64 = 2;
const CYCLES_DENOMINATOR: u64 = 5;

pub(super) fn cycles(ns: u64) -> u32 {
    u32::try_from(ns.saturating_mul(CYCLES_NUMERATOR) / CYCLES_DENOMINATOR).unwrap_or(u32::MAX)
}

fn cost(fixed: u32, each: u32, count: usize) -> u32 {
    let count = u32::try_from(count).unwrap_or(u32::MAX);
    fixed.saturating_add(each.saturating_mul(count))
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CyclePerformance {
    pdi_interrupts: u32,
    /// Sync0 pulses before this number are not counted.
    sync0_before: u64,
    phase: Option<(u32, u32)>,
    output_mapping_max: u32,
    input_mapping_max: u32,
    service_max: u32,
    shadow_max: u32,
    parse_max: u32,
    esc_read_max: u32,
    esc_write_max: u32,
    schedule_max: u32,
    /// Time of the last release, and number of frames released then.
    released: (u64, usize),
    unit: PhaseUnit,
}

impl CyclePerformance {
    pub(super) fn new(unit: PhaseUnit) -> Self {
        Self { unit, ..Self::default() }
    }

    pub(super) fn pdi_interrupt(&mut self, now: u64, pulses: Option<PulseTrain>, write: bool) {
        self.pdi_interrupts = self.pdi_interrupts.wrapping_add(1);
        let Some(pulses) = pulses.filter(|pulses| write && pulses.pulses_until(now) > 0) else {
            return;
        };
        let phase_ns = pulses.phase(now);
        let phase = match self.unit {
            PhaseUnit::Cycles => cycles(phase_ns),
            PhaseUnit::Nanoseconds => u32::try_from(phase_ns).unwrap_or(u32::MAX),
        };
        let (min, max) = self.phase.unwrap_or((phase, phase));
        self.phase = Some((min.min(phase), max.max(phase)));
    }

    pub(super) fn outputs_read(&mut self, bytes: usize) {
        self.esc_read_max = self.esc_read_max.max(cost(200, 2, bytes));
        self.output_mapping_max = self.output_mapping_max.max(cost(400, 2, bytes));
    }

    pub(super) fn image_parsed(&mut self, packets: usize) {
        self.parse_max = self.parse_max.max(cost(600, 180, packets));
    }

    pub(super) fn inputs_published(&mut self, bytes: usize) {
        self.esc_write_max = self.esc_write_max.max(cost(200, 2, bytes));
        self.shadow_max = self.shadow_max.max(cost(300, 1, bytes));
        self.input_mapping_max = self.input_mapping_max.max(cost(700, 3, bytes));
    }

    pub(super) fn served(&mut self, frames: usize) -> u32 {
        let cycles = cost(1_500, 260, frames);
        self.service_max = self.service_max.max(cycles);
        cycles
    }

    /// A scheduled frame was released; frames of one time share a service.
    pub(super) fn scheduled_released(&mut self, now: u64) {
        let (at, count) = self.released;
        let count = if at == now { count + 1 } else { 1 };
        self.released = (now, count);
        self.schedule_max = self.schedule_max.max(cost(150, 200, count));
    }

    pub(super) fn clear(&mut self, now: u64, pulses: Option<PulseTrain>) {
        *self = Self {
            sync0_before: pulses.map_or(0, |pulses| pulses.pulses_until(now)),
            ..Self::new(self.unit)
        };
    }

    pub(super) fn restart_pulses(&mut self) {
        self.sync0_before = 0;
    }

    /// Value of a subindex of 0x9011; `None` for the clear command and reserved ones.
    pub(super) fn readback(
        &self,
        subindex: u8,
        now: u64,
        pulses: Option<PulseTrain>,
    ) -> Option<u32> {
        Some(match subindex {
            1 => self.pdi_interrupts,
            2 => {
                let pulses = pulses.map_or(0, |pulses| pulses.pulses_until(now));
                pulses.saturating_sub(self.sync0_before) as u32
            }
            3 => 0,
            4 => self.phase.map_or(0, |(min, _)| min),
            5 => self.phase.map_or(0, |(_, max)| max),
            6 => self.output_mapping_max,
            7 => self.input_mapping_max,
            8 => self.service_max,
            9 => self.shadow_max,
            10 => self.parse_max,
            11 => self.esc_read_max,
            12 => self.esc_write_max,
            13 => self.schedule_max,
            _ => return None,
        })
    }
}

const KEPT: usize = 8;

mod code {
    pub(super) const COMMUNICATION: u16 = 0x8100;
    /// Life guarding: expected messages are missing.
    pub(super) const LIFE_GUARD: u16 = 0x8130;
    pub(super) const RECOVERED: u16 = 0x8140;
    pub(super) const PROTOCOL: u16 = 0x8200;
}

const COMMUNICATION_ERROR: u8 = 0x11;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Emergency {
    pub(crate) code: u16,
    pub(crate) register: u8,
    pub(crate) data: [u8; 5],
}

impl Emergency {
    /// A channel went bus-off; its number (0 to 3) is in the first byte.
    pub(super) fn bus_off(channel: usize) -> Self {
        Self::of_channel(code::COMMUNICATION, COMMUNICATION_ERROR, channel)
    }

    /// A channel takes part in its bus again; its number is in the first byte.
    pub(super) fn bus_off_recovered(channel: usize) -> Self {
        Self::of_channel(code::RECOVERED, 0, channel)
    }

    fn of_channel(code: u16, register: u8, channel: usize) -> Self {
        Self { code, register, data: [channel.to_le_bytes()[0], 0, 0, 0, 0] }
    }

    /// Error code, error register and data.
    pub(crate) fn message(self) -> [u8; 8] {
        let ([low, high], [a, b, c, d, e]) = (self.code.to_le_bytes(), self.data);
        [low, high, self.register, a, b, c, d, e]
    }

    /// The slave fell back on its own; the AL status code is in the first two bytes.
    pub(super) fn al_error(status: AlStatusCode) -> Self {
        let code = match status {
            AlStatusCode::SM_WATCHDOG => code::LIFE_GUARD,
            _ => code::PROTOCOL,
        };
        let [low, high] = status.0.to_le_bytes();
        Self { code, register: COMMUNICATION_ERROR, data: [low, high, 0, 0, 0] }
    }
}

#[derive(Clone, Debug)]
pub(super) struct EmergencyQueue {
    pub(super) waiting: VecDeque<Emergency>,
}

impl EmergencyQueue {
    pub(super) fn new() -> Self {
        Self { waiting: VecDeque::with_capacity(KEPT) }
    }

    pub(super) fn push(&mut self, emergency: Emergency) {
        if self.waiting.len() >= KEPT {
            self.waiting.pop_front();
        }
        self.waiting.push_back(emergency);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn oldest_emergency_is_dropped() {
        let mut queue = EmergencyQueue::new();
        for channel in 0..KEPT + 3 {
            queue.push(Emergency::bus_off(channel));
        }
        assert_eq!(queue.waiting.len(), KEPT);
        assert_eq!(queue.waiting.front(), Some(&Emergency::bus_off(3)));
        assert_eq!(queue.waiting.back(), Some(&Emergency::bus_off(KEPT + 2)));
    }

    #[test]
    fn watchdog_emergency_has_its_own_code() {
        let watchdog = Emergency::al_error(AlStatusCode::SM_WATCHDOG);
        assert_eq!((watchdog.code, watchdog.data), (0x8130, [0x1B, 0, 0, 0, 0]));
        let sync = Emergency::al_error(AlStatusCode::FATAL_SYNC);
        assert_eq!((sync.code, sync.data), (0x8200, [0x2C, 0, 0, 0, 0]));
    }
}
