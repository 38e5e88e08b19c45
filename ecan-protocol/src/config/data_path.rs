//! The data path of the firmware: 0x8020 and 0x8021..0x8024 (manual 13.2.1, 13.2.2).

use crate::object::SdoWrite;
use crate::object::{
    CHANNEL_DATA_PATH, GLOBAL_DATA_PATH, ObjectType, describe_field, writable_fields,
};
use crate::raw_enum::raw_enum;

/// Most frames per service that a budget can name.
pub const DATA_PATH_BUDGET_MAX: u8 = 8;

/// Number of downloads of [`DataPathGlobal::writes`].
pub const DATA_PATH_GLOBAL_WRITES: usize = 4;

/// Number of downloads of [`DataPathConfig::writes`].
pub const DATA_PATH_CONFIG_WRITES: usize = 17;

const GLOBAL_INDEX: u16 = 0x8020;
const CHANNEL_INDEX: u16 = 0x8021;

const GLOBAL_FIELDS: [(u8, ObjectType); DATA_PATH_GLOBAL_WRITES] =
    writable_fields(&GLOBAL_DATA_PATH, [(4, 7), (0, 0)]);
const CHANNEL_FIELDS: [(u8, ObjectType); DATA_PATH_CONFIG_WRITES] =
    writable_fields(&CHANNEL_DATA_PATH, [(1, 1), (4, 19)]);

/// A fault of a data path configuration: a field out of range, or two that exclude each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DataPathFault {
    /// A field outside the range of its entry.
    #[error("{} is {value}, possible is {min}..{max}", describe_field(*.index, *.subindex))]
    Range {
        /// 0x8020, or 0x8021 for a channel.
        index: u16,
        /// The field's subindex.
        subindex: u8,
        /// Its value.
        value: u32,
        /// Smallest possible value.
        min: u32,
        /// Greatest possible value.
        max: u32,
    },
    /// The receive budget's minimum is above its maximum.
    #[error("RX drain budget from {min} to {max} frames is empty")]
    RxBudget {
        /// Minimum.
        min: u8,
        /// Maximum.
        max: u8,
    },
    /// The transmit budget's minimum is above its maximum.
    #[error("TX budget from {min} to {max} frames is empty")]
    TxBudget {
        /// Minimum.
        min: u8,
        /// Maximum.
        max: u8,
    },
}

/// Data Path Global Control, 0x8020.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DataPathGlobal {
    /// :04 Bits for old and explicit objects side by side.
    pub compat_mode: u16,
    /// :05 Runtime options; the device has none, so 0.
    pub runtime_options: u32,
    /// :06 Diagnostic options; the device has none, so 0.
    pub diagnostic_options: u32,
    /// :07 Time limit of the service in microseconds, 0..1000; 0 is the firmware's default.
    pub max_service_budget_us: u16,
}

impl Default for DataPathGlobal {
    fn default() -> Self {
        Self {
            compat_mode: 3,
            runtime_options: 0,
            diagnostic_options: 0,
            max_service_budget_us: 1000,
        }
    }
}

impl DataPathGlobal {
    /// The downloads, :04..:07. They take effect with [`apply_write`](Self::apply_write).
    pub fn writes(&self) -> [SdoWrite; DATA_PATH_GLOBAL_WRITES] {
        GLOBAL_FIELDS.map(|(subindex, ty)| {
            // infallible: the list holds the fields only, which the tests prove
            let value = self.value(subindex).unwrap_or_default();
            SdoWrite::new(GLOBAL_INDEX, subindex, ty, value)
        })
    }

    /// The download that applies what was written: :02 = 1.
    pub const fn apply_write() -> SdoWrite {
        SdoWrite::new(GLOBAL_INDEX, 2, ObjectType::U8, 1)
    }

    /// The raw value of a field, `None` for a subindex that is not one.
    pub fn value(&self, subindex: u8) -> Option<u32> {
        Some(match subindex {
            4 => self.compat_mode.into(),
            5 => self.runtime_options,
            6 => self.diagnostic_options,
            7 => self.max_service_budget_us.into(),
            _ => return None,
        })
    }

    /// Reports every fault.
    pub fn check(&self, report: &mut dyn FnMut(DataPathFault)) {
        check_ranges(GLOBAL_INDEX, &GLOBAL_FIELDS, |subindex| self.value(subindex), report);
    }
}

raw_enum! {
    /// How many received frames a service takes from the controller (0x8021:06).
    pub enum RxBudget: u8 {
        /// A conservative default of the firmware.
        Balanced = 0,
        /// Between the configured minimum and maximum.
        Limited = 1,
        /// As many as the maximum lets.
        Performance = 2,
        /// By the fill level of the cache.
        Adaptive = 3,
    }
}

raw_enum! {
    /// Frames that the receive cache of a channel holds (0x8021:07).
    pub enum CacheDepth: u8 {
        /// 32 frames.
        D32 = 0,
        /// 8 frames.
        D8 = 1,
        /// 16 frames, the default.
        D16 = 2,
        /// 24 frames.
        D24 = 3,
    }
}

impl CacheDepth {
    /// The depth in frames.
    pub const fn frames(self) -> u8 {
        match self {
            Self::D32 => 32,
            Self::D8 => 8,
            Self::D16 => 16,
            Self::D24 => 24,
        }
    }

    /// The depth for a value that was written to 0x8021:07: the enumeration 0..3 or the frames
    /// 8, 16, 24, 32 themselves.
    pub const fn from_written(value: u8) -> Option<Self> {
        match value {
            8 => Some(Self::D8),
            16 => Some(Self::D16),
            24 => Some(Self::D24),
            32 => Some(Self::D32),
            other => Self::from_raw(other),
        }
    }

    /// The smallest depth for so many frames, 32 at most.
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
    /// What happens when the receive cache is full (0x8021:08).
    pub enum RxOverflow: u8 {
        /// The oldest frame goes.
        DropOldest = 0,
        /// The new frame goes, the default.
        DropNewest = 1,
        /// Critical frames stay as long as possible.
        PreserveCritical = 2,
        /// The channel counts as degraded.
        Degraded = 3,
    }
}

raw_enum! {
    /// Which frames are critical (0x8021:09).
    pub enum CriticalFrames: u16 {
        /// None.
        None = 0,
        /// CANopen safety and status frames, the default.
        CanopenSafety = 1,
        /// All CANopen control and status frames.
        CanopenAll = 2,
    }
}

raw_enum! {
    /// What happens when the transmit cache is full (0x8021:13).
    pub enum TxOverflow: u8 {
        /// The new frame goes.
        DropNewest = 0,
        /// The oldest frame goes, the default.
        DropOldest = 1,
        /// The firmware waits.
        Backoff = 2,
        /// After a while the channel counts as degraded.
        Degraded = 3,
    }
}

raw_enum! {
    /// How a channel comes back from bus-off (0x8021:14).
    pub enum BusOffRecovery: u8 {
        /// The host brings it back.
        Manual = 0,
        /// By itself, the default.
        Auto = 1,
        /// By itself, sooner.
        Aggressive = 2,
        /// Not at all, so that the bus is left in peace.
        Degraded = 3,
    }
}

/// MCAN Data Path Control of one channel, 0x8021..0x8024. The default is the device's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DataPathConfig {
    /// :01 Use this policy.
    pub enable: bool,
    /// :04 Fewest frames that a service takes from the controller, 0..8.
    pub rx_drain_min: u8,
    /// :05 Most frames that a service takes from the controller, 0..8.
    pub rx_drain_max: u8,
    /// :06 How the number is chosen.
    pub rx_budget: RxBudget,
    /// :07 Depth of the receive cache.
    pub rx_cache_depth: CacheDepth,
    /// :08 When the receive cache is full.
    pub rx_overflow: RxOverflow,
    /// :09 Which frames are critical.
    pub critical_frames: CriticalFrames,
    /// :10 Reserved by the manual, 0.
    pub id_priority: u16,
    /// :11 Fewest frames that a service hands to the controller, 0..8.
    pub tx_budget_min: u8,
    /// :12 Most frames that a service hands to the controller, 0..8.
    pub tx_budget_max: u8,
    /// :13 When the transmit cache is full.
    pub tx_overflow: TxOverflow,
    /// :14 Way back from bus-off.
    pub bus_off_recovery: BusOffRecovery,
    /// :15 Cycles to wait after transmit backpressure.
    pub backoff_base_cycles: u16,
    /// :16 Threshold of the degraded state.
    pub degraded_threshold: u16,
    /// :17..:19 Reserved for extensions, 0.
    pub reserved: [u32; 3],
}

impl Default for DataPathConfig {
    fn default() -> Self {
        Self {
            enable: true,
            rx_drain_min: 0,
            rx_drain_max: 2,
            rx_budget: RxBudget::Limited,
            rx_cache_depth: CacheDepth::D16,
            rx_overflow: RxOverflow::DropNewest,
            critical_frames: CriticalFrames::CanopenSafety,
            id_priority: 0,
            tx_budget_min: 0,
            tx_budget_max: 4,
            tx_overflow: TxOverflow::DropOldest,
            bus_off_recovery: BusOffRecovery::Auto,
            backoff_base_cycles: 2,
            degraded_threshold: 64,
            reserved: [0; 3],
        }
    }
}

impl DataPathConfig {
    /// Policy for so many frames per cycle from the bus (`rx`) and to it (`tx`).
    ///
    /// The budgets are one frame above the mean where the device lets (8 at most), so that a
    /// burst drains, and never below the device's defaults. The cache holds four cycles of
    /// received frames, 16 at least and 32 at most. Everything else is the default, which keeps
    /// the order of frames.
    ///
    /// More than [`DATA_PATH_BUDGET_MAX`] frames per cycle do not pass in the long run;
    /// [`carries`](Self::carries) tells.
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

    /// True when the budgets carry so many frames per cycle in the long run.
    pub const fn carries(&self, rx: u8, tx: u8) -> bool {
        rx <= self.rx_drain_max && tx <= self.tx_budget_max
    }

    /// The downloads to a channel (0..3): :01, then :04..:19. They take effect with
    /// [`apply_write`](Self::apply_write).
    pub fn writes(&self, channel: u8) -> [SdoWrite; DATA_PATH_CONFIG_WRITES] {
        CHANNEL_FIELDS.map(|(subindex, ty)| {
            // infallible: the list holds the fields only, which the tests prove
            let value = self.value(subindex).unwrap_or_default();
            SdoWrite::new(CHANNEL_INDEX + u16::from(channel), subindex, ty, value)
        })
    }

    /// The download that applies what was written to a channel (0..3): :02 = 1.
    pub const fn apply_write(channel: u8) -> SdoWrite {
        SdoWrite::new(CHANNEL_INDEX + channel as u16, 2, ObjectType::U8, 1)
    }

    /// The raw value of a field, `None` for a subindex that is not one.
    pub fn value(&self, subindex: u8) -> Option<u32> {
        let [reserved0, reserved1, reserved2] = self.reserved;
        Some(match subindex {
            1 => self.enable.into(),
            4 => self.rx_drain_min.into(),
            5 => self.rx_drain_max.into(),
            6 => self.rx_budget.raw().into(),
            7 => self.rx_cache_depth.raw().into(),
            8 => self.rx_overflow.raw().into(),
            9 => self.critical_frames.raw().into(),
            10 => self.id_priority.into(),
            11 => self.tx_budget_min.into(),
            12 => self.tx_budget_max.into(),
            13 => self.tx_overflow.raw().into(),
            14 => self.bus_off_recovery.raw().into(),
            15 => self.backoff_base_cycles.into(),
            16 => self.degraded_threshold.into(),
            17 => reserved0,
            18 => reserved1,
            19 => reserved2,
            _ => return None,
        })
    }

    /// Reads a configuration from raw values, as a device or a project file has them; `read`
    /// gets the subindex. `None` when a value has no meaning.
    pub fn from_values(mut read: impl FnMut(u8) -> u32) -> Option<Self> {
        let mut byte = |subindex| u8::try_from(read(subindex)).ok();
        let config = Self {
            enable: match byte(1)? {
                0 => false,
                1 => true,
                _ => return None,
            },
            rx_drain_min: byte(4)?,
            rx_drain_max: byte(5)?,
            rx_budget: RxBudget::from_raw(byte(6)?)?,
            rx_cache_depth: CacheDepth::from_written(byte(7)?)?,
            rx_overflow: RxOverflow::from_raw(byte(8)?)?,
            critical_frames: CriticalFrames::from_raw(byte(9)?.into())?,
            tx_budget_min: byte(11)?,
            tx_budget_max: byte(12)?,
            tx_overflow: TxOverflow::from_raw(byte(13)?)?,
            bus_off_recovery: BusOffRecovery::from_raw(byte(14)?)?,
            ..Self::default()
        };
        Some(Self {
            id_priority: u16::try_from(read(10)).ok()?,
            backoff_base_cycles: u16::try_from(read(15)).ok()?,
            degraded_threshold: u16::try_from(read(16)).ok()?,
            reserved: [read(17), read(18), read(19)],
            ..config
        })
    }

    /// The active control word that :20 echoes once the policy is applied. Budgets out of range
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
        check_ranges(CHANNEL_INDEX, &CHANNEL_FIELDS, |subindex| self.value(subindex), report);
        if self.rx_drain_min > self.rx_drain_max {
            report(DataPathFault::RxBudget { min: self.rx_drain_min, max: self.rx_drain_max });
        }
        if self.tx_budget_min > self.tx_budget_max {
            report(DataPathFault::TxBudget { min: self.tx_budget_min, max: self.tx_budget_max });
        }
    }
}

fn check_ranges(
    index: u16,
    fields: &[(u8, ObjectType)],
    value: impl Fn(u8) -> Option<u32>,
    report: &mut dyn FnMut(DataPathFault),
) {
    for &(subindex, _) in fields {
        let Some((_, entry)) = crate::object::lookup(index, subindex) else {
            continue;
        };
        let value = value(subindex).unwrap_or_default();
        if !(entry.min..=entry.max).contains(&value) {
            let (min, max) = (entry.min, entry.max);
            report(DataPathFault::Range { index, subindex, value, min, max });
        }
    }
}
