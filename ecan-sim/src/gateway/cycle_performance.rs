//! 0x9011: interrupt counts and cost of the hot paths (manual 13.2.4).
//!
//! The model has no hot path to measure, so costs follow from the work: a fixed part and a part per
//! packet, frame or byte, in CPU cycles. They are plausible, not measured.

use super::pulse_train::PulseTrain;
use super::variant::PhaseUnit;

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
