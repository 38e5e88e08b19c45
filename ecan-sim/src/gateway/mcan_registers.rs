//! Registers of the Bosch M_CAN core: offsets, bits, and the values that a user has written (manual 13.5, 13.6).

use std::collections::BTreeMap;

use ecan_protocol::can::{BitTiming, Phase};

/// Register offsets of the Bosch M_CAN core.
pub(super) mod offset {
    pub(in crate::gateway) const ENDIAN: u16 = 0x004;
    pub(in crate::gateway) const DBTP: u16 = 0x00C;
    pub(in crate::gateway) const TEST: u16 = 0x010;
    pub(in crate::gateway) const RWD: u16 = 0x014;
    pub(in crate::gateway) const CCCR: u16 = 0x018;
    pub(in crate::gateway) const NBTP: u16 = 0x01C;
    pub(in crate::gateway) const ECR: u16 = 0x040;
    pub(in crate::gateway) const PSR: u16 = 0x044;
    pub(in crate::gateway) const TDCR: u16 = 0x048;
    pub(in crate::gateway) const IR: u16 = 0x050;
    pub(in crate::gateway) const IE: u16 = 0x054;
    pub(in crate::gateway) const ILS: u16 = 0x058;
    pub(in crate::gateway) const ILE: u16 = 0x05C;
    pub(in crate::gateway) const GFC: u16 = 0x080;
    pub(in crate::gateway) const XIDAM: u16 = 0x090;
    pub(in crate::gateway) const HPMS: u16 = 0x094;
    pub(in crate::gateway) const RXF0S: u16 = 0x0A4;
    pub(in crate::gateway) const RXF0A: u16 = 0x0A8;
    pub(in crate::gateway) const RXF1S: u16 = 0x0B4;
    pub(in crate::gateway) const RXF1A: u16 = 0x0B8;
    pub(in crate::gateway) const TXFQS: u16 = 0x0C4;
    pub(in crate::gateway) const TXBCR: u16 = 0x0D4;
    pub(in crate::gateway) const TXEFS: u16 = 0x0F4;
    pub(in crate::gateway) const TXEFA: u16 = 0x0F8;
}

/// Registers at 0x9000:1 to :8.
pub(super) const STATUS_REGISTERS: [u16; 8] = [
    offset::ECR,
    offset::PSR,
    offset::IR,
    offset::RXF0S,
    offset::RXF1S,
    offset::TXFQS,
    offset::TXEFS,
    offset::HPMS,
];

pub(super) mod cccr {
    pub(in crate::gateway) const INIT: u32 = 1 << 0;
    pub(in crate::gateway) const CCE: u32 = 1 << 1;
    pub(in crate::gateway) const MON: u32 = 1 << 5;
    pub(in crate::gateway) const DAR: u32 = 1 << 6;
    pub(in crate::gateway) const TEST: u32 = 1 << 7;
    pub(in crate::gateway) const FDOE: u32 = 1 << 8;
    pub(in crate::gateway) const BRSE: u32 = 1 << 9;
    /// ASM, and the bits above the bit rate switch.
    pub(in crate::gateway) const KEPT: u32 = 1 << 2 | 0xFC00;
}

pub(super) const TEST_LOOPBACK: u32 = 1 << 4;

/// Written register values since the last restart that the configuration does not contain.
#[derive(Clone, Debug, Default)]
pub(super) struct WrittenRegisters {
    pub(super) is_stopped: bool,
    pub(super) may_change: bool,
    /// By offset; CCCR without INIT and CCE.
    pub(super) values: BTreeMap<u16, u32>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct FramesDropped {
    pub(super) transmit: usize,
    pub(super) receive: usize,
}

/// Shift and number of bits of BRP, TSEG1, TSEG2 and SJW in NBTP or DBTP, which hold values less one.
fn timing_fields(phase: Phase) -> [(u32, u32); 4] {
    match phase {
        Phase::Nominal => [(16, 9), (8, 8), (0, 7), (25, 7)],
        Phase::Data => [(16, 5), (8, 5), (4, 4), (0, 4)],
    }
}

pub(super) fn timing_register(phase: Phase, timing: BitTiming) -> u32 {
    let values = [timing.brp, timing.tseg1, timing.tseg2, timing.sjw];
    let fields = values.into_iter().zip(timing_fields(phase));
    fields.fold(0, |word, (value, (shift, _))| word | u32::from(value.saturating_sub(1)) << shift)
}

/// Timing of a written NBTP or DBTP; segments are raised to the shortest that the core supports.
pub(super) fn written_timing(phase: Phase, word: u32) -> BitTiming {
    let [brp, tseg1, tseg2, sjw] =
        timing_fields(phase).map(|(shift, bits)| 1 + (word >> shift & ((1 << bits) - 1)) as u16);
    let limits = phase.limits();
    BitTiming { brp, tseg1: tseg1.max(limits.tseg1.0), tseg2: tseg2.max(limits.tseg2.0), sjw }
}
