//! 0x8020 Data Path Global Control and 0x8021..0x8024 MCAN Data Path Control
//! (manual 13.2.1, 13.2.2).

use super::ObjectType::{U8, U16, U32};
use super::declare::object;
use super::entry::{Entry, Object};
use super::value::{KeyForm, ObjectValue, raw_enum};
use super::{ConfigObject, RangeFault, SdoWrite};

const APPLY: &[(u32, &str)] = &[(0, "no-op"), (1, "apply")];

/// Most frames per service that a budget can have.
pub const DATA_PATH_BUDGET_MAX: u8 = 8;
const BUDGET_MAX: u32 = DATA_PATH_BUDGET_MAX as u32;

object! {
    /// Data Path Global Control, 0x8020 (manual 13.2.1). The default is the device's.
    pub struct DataPathGlobal {}
    const GLOBAL_DATA_PATH =
        Object::single(0x8020, "Data Path Global Control", "13.2.1", DataPathGlobal::ENTRIES)
            .applied_by(2, 3)
            .saved();
    entries {
        entry(Entry::highest(10));
        entry(Entry::ro(1, "Control format", U16).default(1));
        entry(Entry::rw(2, "Apply command", U8).default(0).range(0, 1).values(APPLY));
        entry(Entry::ro(3, "Apply status", U8).default(0));
        /// Bits for legacy and explicit objects that coexist (:04).
        4 "Compat mode" compat_mode: u16 = 3;
        // The capability masks 0xF000:26 and :27 are 0, so 0 is the only valid value.
        /// Runtime options (:05); the device has none, so 0.
        5 "Runtime option flags" runtime_options: u32 = 0, range(0, 0);
        /// Diagnostic options (:06); the device has none, so 0.
        6 "Diagnostic option flags" diagnostic_options: u32 = 0, range(0, 0);
        /// Time limit of the service in microseconds, 0 to 1000 (:07); 0 is the firmware's default.
        7 "Max service budget us" max_service_budget_us: u16 = 1000, range(0, 1000), unit("us");
        entry(Entry::ro(8, "Reserved0", U16).default(0));
        entry(Entry::ro(9, "Reserved1", U32).default(0));
        entry(Entry::ro(10, "Reserved2", U32).default(0));
    }
}

raw_enum! {
    /// Number of received frames that a service reads from the controller (0x8021:06).
    pub enum RxBudget: u8;
    /// A conservative default of the firmware.
    Balanced = 0, "balanced";
    /// Between the configured minimum and maximum.
    Limited = 1, "limited";
    /// Up to the maximum.
    Performance = 2, "performance";
    /// Depends on the fill level of the cache.
    Adaptive = 3, "adaptive";
}

raw_enum! {
    /// Depth of the receive cache of a channel (0x8021:07). The device also accepts the number of
    /// frames.
    pub enum CacheDepth: u8, KeyForm::Size(&[32, 8, 16, 24]);
    D32 = 0 | 32, "32 frames";
    D8 = 1 | 8, "8 frames";
    /// 16 frames, the default.
    D16 = 2 | 16, "16 frames";
    D24 = 3 | 24, "24 frames";
}

impl CacheDepth {
    /// Depth in frames.
    pub const fn frames(self) -> u8 {
        match self {
            Self::D32 => 32,
            Self::D8 => 8,
            Self::D16 => 16,
            Self::D24 => 24,
        }
    }

    /// Returns the depth for a value written to 0x8021:07: the number 0 to 3, or 8, 16, 24 or 32
    /// frames.
    pub fn from_written(value: u8) -> Option<Self> {
        Self::try_from_raw(value.into())
    }

    /// Returns the smallest depth for this number of frames, at most 32.
    pub const fn at_least(frames: u8) -> Self {
        match frames {
            0..=8 => Self::D8,
            9..=16 => Self::D16,
            17..=24 => Self::D24,
            _ => Self::D32,
        }
    }
}

raw_enum! {
    /// Reaction to a full receive cache (0x8021:08).
    pub enum RxOverflow: u8;
    DropOldest = 0, "drop oldest";
    /// Drops the new frame, the default.
    DropNewest = 1, "drop newest";
    /// Keeps critical frames while possible.
    PreserveCritical = 2, "preserve critical";
    Degraded = 3, "degraded";
}

raw_enum! {
    /// Frames that are critical (0x8021:09).
    pub enum CriticalFrames: u16;
    None = 0, "none";
    /// CANopen safety and status frames, the default.
    CanopenSafety = 1, "CANopen safety";
    CanopenAll = 2, "CANopen all";
}

raw_enum! {
    /// Reaction to a full transmit cache (0x8021:13).
    pub enum TxOverflow: u8;
    DropNewest = 0, "drop newest";
    /// Drops the oldest frame, the default.
    DropOldest = 1, "drop oldest";
    /// The firmware waits.
    Backoff = 2, "backoff";
    /// The channel enters the degraded state if it persists.
    Degraded = 3, "degraded";
}

raw_enum! {
    /// Recovery of a channel from bus-off (0x8021:14).
    pub enum BusOffRecovery: u8;
    /// By the host.
    Manual = 0, "manual";
    /// Automatic, the default.
    Auto = 1, "auto";
    /// Automatic, with shorter pauses.
    Aggressive = 2, "aggressive";
    /// None, so that the channel does not disturb the bus again.
    Degraded = 3, "degraded";
}

object! {
    /// MCAN Data Path Control of one channel, 0x8021..0x8024 (manual 13.2.2). The default is the
    /// device's.
    pub struct DataPathConfig {}
    const CHANNEL_DATA_PATH =
        Object::family(0x8021, 4, 1, "MCAN Data Path Control", "13.2.2", DataPathConfig::ENTRIES)
            .applied_by(2, 3)
            .saved();
    entries {
        entry(Entry::highest(20));
        /// Use this policy (:01).
        1 "Enable" enable: bool = true;
        entry(Entry::rw(2, "Apply command", U8).default(0).range(0, 1).values(APPLY));
        entry(Entry::ro(3, "Apply status", U8).default(0));
        /// Fewest frames that a service reads from the controller, 0 to 8 (:04).
        4 "RX drain budget min" rx_drain_min: u8 = 0, range(0, BUDGET_MAX), unit("frames");
        /// Most frames that a service reads from the controller, 0 to 8 (:05).
        5 "RX drain budget max" rx_drain_max: u8 = 2, range(0, BUDGET_MAX), unit("frames");
        /// Choice of the number between them (:06).
        6 "RX budget policy" rx_budget: RxBudget = RxBudget::Limited;
        /// Depth of the receive cache (:07).
        7 "RX cache depth" rx_cache_depth: CacheDepth = CacheDepth::D16;
        /// Reaction to a full receive cache (:08).
        8 "RX overflow policy" rx_overflow: RxOverflow = RxOverflow::DropNewest;
        /// Frames that are critical (:09).
        9 "Critical frame policy" critical_frames: CriticalFrames = CriticalFrames::CanopenSafety;
        /// Reserved by the manual, 0 (:10).
        10 "CAN ID priority policy" id_priority: u16 = 0;
        /// Fewest frames that a service passes to the controller, 0 to 8 (:11).
        11 "TX budget min" tx_budget_min: u8 = 0, range(0, BUDGET_MAX), unit("frames");
        /// Most frames that a service passes to the controller, 0 to 8 (:12).
        12 "TX budget max" tx_budget_max: u8 = 4, range(0, BUDGET_MAX), unit("frames");
        /// Reaction to a full transmit cache (:13).
        13 "TX overflow policy" tx_overflow: TxOverflow = TxOverflow::DropOldest;
        /// Recovery from bus-off (:14).
        14 "Bus-off recovery policy" bus_off_recovery: BusOffRecovery = BusOffRecovery::Auto;
        /// Cycles to wait after transmit backpressure (:15).
        15 "Backoff base cycles" backoff_base_cycles: u16 = 2, unit("cycles");
        /// Threshold of the degraded state (:16).
        16 "Degraded threshold" degraded_threshold: u16 = 64;
        /// Reserved for extensions, 0 (:17).
        17 "Reserved0" reserved0: u32 = 0;
        /// Reserved for extensions, 0 (:18).
        18 "Reserved1" reserved1: u32 = 0;
        /// Reserved for extensions, 0 (:19).
        19 "Reserved2" reserved2: u32 = 0;
        // The default in the manual is 0; with the defaults applied the device reports 0x54059201.
        entry(Entry::ro(20, "Active control word", U32).default(0));
    }
}

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
