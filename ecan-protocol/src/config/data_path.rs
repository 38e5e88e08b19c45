//! Choice, checks and SDO downloads of the data path policies (manual 13.2.1, 13.2.2).

use crate::object::data_path::{
    CHANNEL_DATA_PATH, CacheDepth, DATA_PATH_BUDGET_MAX, DataPathConfig, DataPathGlobal,
    GLOBAL_DATA_PATH,
};
use crate::object::{ConfigObject, RangeFault, SdoWrite};

/// A fault of a data path configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DataPathFault {
    /// A field outside the range of its entry.
    #[error("{0}")]
    Range(RangeFault),
    /// The minimum of the receive budget is above its maximum.
    #[error("RX drain budget from {min} to {max} frames is empty")]
    RxBudget {
        /// Minimum.
        min: u8,
        /// Maximum.
        max: u8,
    },
    /// The minimum of the transmit budget is above its maximum.
    #[error("TX budget from {min} to {max} frames is empty")]
    TxBudget {
        /// Minimum.
        min: u8,
        /// Maximum.
        max: u8,
    },
}

impl DataPathGlobal {
    /// Returns the downloads, :04 to :07. They take effect with [`apply_write`](Self::apply_write).
    pub fn writes(&self) -> impl Iterator<Item = SdoWrite> + use<> {
        self.writes_to(GLOBAL_DATA_PATH.first)
    }

    /// The download that applies what was written: :02 = 1.
    pub const fn apply_write() -> SdoWrite {
        SdoWrite::apply(&GLOBAL_DATA_PATH, 0)
    }

    /// Reports every fault.
    pub fn check(&self, report: &mut dyn FnMut(DataPathFault)) {
        self.check_ranges(&mut |fault| report(DataPathFault::Range(fault)));
    }
}

impl DataPathConfig {
    /// Creates a policy for this number of frames per cycle from the bus (`rx`) and to it (`tx`).
    ///
    /// The budgets are one frame above the mean if the device allows it (at most 8), so that a
    /// burst drains, and never below the device's defaults. The cache holds four cycles of
    /// received frames, at least 16 and at most 32. Everything else is the default, which keeps the
    /// order of frames.
    ///
    /// More than [`DATA_PATH_BUDGET_MAX`] frames per cycle do not pass permanently; see
    /// [`carries`](Self::carries).
    pub fn for_traffic(rx: u8, tx: u8) -> Self {
        let default = Self::default();
        let budget =
            |frames: u8, least: u8| frames.saturating_add(1).clamp(least, DATA_PATH_BUDGET_MAX);
        let depth = rx.saturating_mul(4).max(default.rx_cache_depth.frames());
        Self {
            rx_drain_max: budget(rx, default.rx_drain_max),
            tx_budget_max: budget(tx, default.tx_budget_max),
            rx_cache_depth: CacheDepth::at_least(depth),
            ..default
        }
    }

    /// True if the budgets permanently carry this number of frames per cycle.
    pub const fn carries(&self, rx: u8, tx: u8) -> bool {
        rx <= self.rx_drain_max && tx <= self.tx_budget_max
    }

    /// Returns the downloads to a channel (0 to 3): :01, then :04 to :19. They take effect with
    /// [`apply_write`](Self::apply_write).
    pub fn writes(&self, channel: u8) -> impl Iterator<Item = SdoWrite> + use<> {
        self.writes_to(CHANNEL_DATA_PATH.first + u16::from(channel))
    }

    /// The download that applies what was written to a channel (0 to 3): :02 = 1.
    pub const fn apply_write(channel: u8) -> SdoWrite {
        SdoWrite::apply(&CHANNEL_DATA_PATH, channel)
    }

    /// The active control word that :20 returns after the policy is applied. Budgets out of range
    /// lose their upper bits.
    pub const fn active_word(&self) -> u32 {
        self.enable as u32
            | (self.rx_drain_min as u32 & 0xF) << 4
            | (self.rx_drain_max as u32 & 0xF) << 8
            | (self.rx_budget.raw() as u32) << 12
            | (self.rx_cache_depth.raw() as u32) << 14
            | (self.rx_overflow.raw() as u32) << 16
            | (self.critical_frames.raw() as u32) << 18
            | (self.tx_budget_min as u32 & 0xF) << 20
            | (self.tx_budget_max as u32 & 0xF) << 24
            | (self.tx_overflow.raw() as u32) << 28
            | (self.bus_off_recovery.raw() as u32) << 30
    }

    /// Reports every fault.
    pub fn check(&self, report: &mut dyn FnMut(DataPathFault)) {
        self.check_ranges(&mut |fault| report(DataPathFault::Range(fault)));
        if self.rx_drain_min > self.rx_drain_max {
            report(DataPathFault::RxBudget { min: self.rx_drain_min, max: self.rx_drain_max });
        }
        if self.tx_budget_min > self.tx_budget_max {
            report(DataPathFault::TxBudget { min: self.tx_budget_min, max: self.tx_budget_max });
        }
    }
}
