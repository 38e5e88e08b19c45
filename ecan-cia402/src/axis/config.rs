//! What an axis is told: plain data.

use std::time::Duration;

use ecan_canopen::{NodeAddress, NodeLossReaction, OperatingMode, QuickStopOption, Step};
use ecan_protocol::mapping::CHANNELS;
use thiserror::Error;

use super::pdo_layout::{PdoLayout, TargetObject};
use super::units::Scale;
use crate::guard::position_range::PositionRange;
use crate::guard::terms::{GuardLimits, TargetKind};

/// Least following-error window, in step limits: what an axis lags behind by the way out and back
/// while it moves at its limit.
const WINDOW_STEPS: u32 = 8;

/// How a node begins its start-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NodeReset {
    /// It is told to go to Pre-operational.
    #[default]
    None,
    /// Its communication is reset: parameters of 0x1000.. as at power-on.
    Communication,
    /// The whole node is reset.
    Node,
}

/// How a drive is configured before it is enabled. Objects marked (if there) are skipped where the
/// drive does not have them.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveConfig {
    /// How it begins.
    pub reset: NodeReset,
    /// Longest time for the boot-up message after a reset.
    pub boot_timeout: Duration,
    /// Vendor id and product code that 0x1018 must have.
    pub identity: Option<(u32, u32)>,
    /// Whether the low half of 0x1000 must be 402.
    pub expect_profile_402: bool,
    /// Producer heartbeat time 0x1017 in milliseconds (if there); 0 switches it off. The host
    /// watches it: it is lost after three and a half of them.
    pub heartbeat_ms: u16,
    /// Consumer heartbeat time of the host, 0x1016:01, in milliseconds (if there); 0 leaves the
    /// object alone. With it a drive notices that the host has died.
    pub host_heartbeat_ms: u16,
    /// What the drive does then, 0x6007 (if there); `None` leaves the object alone.
    pub host_loss: Option<NodeLossReaction>,
    /// Quick stop option 0x605A (if there); `None` leaves it alone.
    pub quick_stop: Option<QuickStopOption>,
    /// Following error window 0x6065 in steps and time 0x6066 in milliseconds (if there); `None`
    /// leaves them alone. Should not be below [`AxisConfig::following_window`].
    pub following_error: Option<(u32, u16)>,
    /// Writes [`AxisConfig::bounds`] to 0x607D too, where the mode is a position mode (if
    /// there).
    pub write_position_limits: bool,
    /// Switches TPDO 2 to 4 off (if there), so that nothing else takes bus time.
    pub silence_other_tpdos: bool,
    /// Further steps, done after the mapping and before the mode, while Pre-operational.
    pub further: Vec<Step>,
}

impl Default for DriveConfig {
    /// No reset, heartbeats of 100 ms from the drive and a consumer time of 250 ms for the host's,
    /// quick stop when the host is lost.
    fn default() -> Self {
        Self {
            reset: NodeReset::None,
            boot_timeout: Duration::from_secs(5),
            identity: None,
            expect_profile_402: true,
            heartbeat_ms: 100,
            host_heartbeat_ms: 250,
            host_loss: Some(NodeLossReaction::QuickStop),
            quick_stop: None,
            following_error: None,
            write_position_limits: false,
            silence_other_tpdos: true,
            further: Vec::new(),
        }
    }
}

/// One axis: a line of the axis table.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisConfig {
    /// Where the drive is.
    pub address: NodeAddress,
    /// The mode in which it is driven. It decides what the RPDO carries.
    pub mode: OperatingMode,
    /// Steps of the position counter per turn, for angles.
    pub scale: Scale,
    /// How the position counter runs.
    pub range: PositionRange,
    /// Smallest and largest target, in steps or in units of velocity or torque.
    pub bounds: Option<(i32, i32)>,
    /// Farthest that a target may be from the one before, per cycle in which targets are sent.
    /// In PP, PV and PT the drive makes the way itself, and it is of no meaning.
    pub step_limit: u32,
    /// Farthest that a position target may be from the actual position; at least eight step
    /// limits, since a moving axis lags by the way out and back.
    pub following_window: u32,
    /// How far an axis at rest may be off from one actual position to the next, by noise. An axis
    /// that moves faster is not taken up. At most the step limit.
    pub standstill: u32,
    /// The step that [`send_target_step`](super::Cia402::send_target_step) makes per cycle.
    pub target_step: i32,
    /// How much a step that the host makes itself may change per cycle: for
    /// [`send_target_step`](super::Cia402::send_target_step), halt and shutdown.
    pub ramp: u32,
    /// SYNC periods in a row without a usable TPDO that are put up with.
    pub tpdo_timeout: u16,
    /// Cycles in a row with an incomplete working counter that are put up with; the Port repeats
    /// the last image meanwhile, and no target goes out.
    pub wc_misses: u16,
    /// New images that must be seen, at least, while stale targets are waited out.
    pub drain_images: u16,
    /// Takes the axis up again by itself after it held for a reason on the way to a drive that
    /// stayed enabled; in CSP only, where the drive stands meanwhile. Off, only the application
    /// does. A drive that left Operation Enabled is never enabled by itself.
    pub auto_resume: bool,
    /// Longest time for enabling: brake and power stage.
    pub enable_timeout: Duration,
    /// Number of the RPDO and the TPDO that are used, 1 to 4.
    pub pdo_number: u8,
    /// The configuration of the drive.
    pub drive: DriveConfig,
}

impl AxisConfig {
    /// A CSP axis at an address, with a limit of 1000 steps per cycle.
    pub fn new(address: NodeAddress) -> Self {
        Self {
            address,
            mode: OperatingMode::CyclicPosition,
            scale: Scale::default(),
            range: PositionRange::Linear,
            bounds: None,
            step_limit: 1_000,
            following_window: 10_000,
            standstill: 20,
            target_step: 0,
            ramp: 20,
            tpdo_timeout: 5,
            wc_misses: 3,
            drain_images: 3,
            auto_resume: false,
            enable_timeout: Duration::from_secs(5),
            pdo_number: 1,
            drive: DriveConfig::default(),
        }
    }

    /// The same with a step per cycle, and limits that let it pass.
    #[must_use]
    pub fn with_target_step(mut self, step: i32) -> Self {
        self.target_step = step;
        let limit = self.step_limit.max(step.unsigned_abs());
        self.with_step_limit(limit)
    }

    /// The same with a step limit, and a following-error window that is not too small for it.
    #[must_use]
    pub fn with_step_limit(mut self, limit: u32) -> Self {
        self.step_limit = limit;
        self.following_window = self.following_window.max(limit.saturating_mul(WINDOW_STEPS));
        self.standstill = self.standstill.min(limit);
        self
    }

    /// The same in another mode.
    #[must_use]
    pub fn with_mode(mut self, mode: OperatingMode) -> Self {
        self.mode = mode;
        self
    }

    /// What the process data carry; that of CSP for a mode that is not driven.
    pub fn layout(&self) -> PdoLayout {
        PdoLayout::for_mode(self.mode).unwrap_or_default()
    }

    /// The rules of the motion guard in a mode, with `cycles_per_sync` cycles from SYNC to SYNC.
    pub fn guard_limits(&self, mode: OperatingMode, cycles_per_sync: u32) -> GuardLimits {
        let cycles = u16::try_from(cycles_per_sync.max(1)).unwrap_or(u16::MAX);
        let kind = target_kind(mode);
        let makes_its_own_way = !mode.is_cyclic();
        GuardLimits {
            kind,
            range: self.range,
            step: if makes_its_own_way { u32::MAX } else { self.step_limit },
            window: self.following_window,
            bounds: if kind == TargetKind::None { None } else { self.bounds },
            standstill: self.standstill,
            tpdo_timeout: self.tpdo_timeout.saturating_mul(cycles),
            wc_misses: self.wc_misses,
            drain_images: self.drain_images,
        }
    }

    /// Checks the settings as a whole and reports every fault.
    pub fn check(&self, report: &mut dyn FnMut(AxisFault)) {
        if usize::from(self.address.channel) >= CHANNELS {
            report(AxisFault::Channel { channel: self.address.channel });
        }
        if PdoLayout::for_mode(self.mode).is_none() {
            report(AxisFault::Mode { mode: self.mode });
        }
        if !(1..=4).contains(&self.pdo_number) {
            report(AxisFault::PdoNumber { number: self.pdo_number });
        }
        if !self.scale.is_valid() {
            report(AxisFault::Scale { steps_per_turn: self.scale.steps() });
        }
        if self.step_limit == 0 {
            report(AxisFault::NoStep);
        }
        if self.target_step.unsigned_abs() > self.step_limit {
            report(AxisFault::TargetStep { step: self.target_step, limit: self.step_limit });
        }
        if self.standstill > self.step_limit {
            report(AxisFault::Standstill { standstill: self.standstill, limit: self.step_limit });
        }
        let least = self.step_limit.saturating_mul(WINDOW_STEPS);
        if target_kind(self.mode) == TargetKind::Position && self.following_window < least {
            report(AxisFault::Window { window: self.following_window, least });
        }
        if let Some((min, max)) = self.bounds
            && min > max
        {
            report(AxisFault::Bounds { min, max });
        }
        if let PositionRange::Modulo { min, max } = self.range
            && min >= max
        {
            report(AxisFault::Range { min, max });
        }
        if self.tpdo_timeout == 0 {
            report(AxisFault::TpdoTimeout);
        }
    }
}

/// What kind of targets a mode takes.
pub(crate) fn target_kind(mode: OperatingMode) -> TargetKind {
    match mode {
        OperatingMode::Homing => TargetKind::None,
        OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition => TargetKind::Position,
        OperatingMode::ProfilePosition => TargetKind::Profile,
        _ => match TargetObject::of_mode(mode) {
            Some(TargetObject::Position) | None => TargetKind::Position,
            Some(TargetObject::Velocity | TargetObject::Torque) => TargetKind::Rate,
        },
    }
}

/// What is wrong with the settings of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum AxisFault {
    /// A gateway has four channels.
    #[error("channel {channel}: a gateway has channels 0 to 3 only")]
    Channel {
        /// The channel given.
        channel: u8,
    },
    /// The mode is not driven.
    #[error("mode {mode} is not driven by this library")]
    Mode {
        /// The mode.
        mode: OperatingMode,
    },
    /// The predefined connection set has four PDOs each way.
    #[error("PDO number {number} is not 1 to 4")]
    PdoNumber {
        /// The number given.
        number: u8,
    },
    /// The scale cannot be calculated with.
    #[error("{steps_per_turn} steps per turn is no scale")]
    Scale {
        /// Steps per turn.
        steps_per_turn: f64,
    },
    /// With a step limit of 0 the axis could never move.
    #[error("the step limit is 0")]
    NoStep,
    /// The step that is asked for exceeds the limit.
    #[error("the target step {step} exceeds the step limit {limit}")]
    TargetStep {
        /// The step.
        step: i32,
        /// The limit.
        limit: u32,
    },
    /// An axis that moves faster than its targets may does not stand still.
    #[error("the standstill window {standstill} exceeds the step limit {limit}")]
    Standstill {
        /// The window.
        standstill: u32,
        /// The limit.
        limit: u32,
    },
    /// The following-error window is smaller than what a sound axis lags behind.
    #[error("the following-error window {window} is below {least}, eight step limits")]
    Window {
        /// The window.
        window: u32,
        /// The least that makes sense.
        least: u32,
    },
    /// No target is inside the bounds.
    #[error("the bounds {min}..{max} are empty")]
    Bounds {
        /// Smallest.
        min: i32,
        /// Largest.
        max: i32,
    },
    /// The counter has no position.
    #[error("the position range {min}..{max} is empty")]
    Range {
        /// Smallest.
        min: i32,
        /// Largest.
        max: i32,
    },
    /// Not a single missing TPDO is put up with, though one is missing whenever a reply is lost.
    #[error("the TPDO timeout is 0")]
    TpdoTimeout,
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_canopen::NodeId;

    fn settings() -> AxisConfig {
        let node = NodeId::new(1).unwrap();
        AxisConfig::new(NodeAddress { slave: 0, channel: 0, node })
    }

    fn faults(settings: &AxisConfig) -> Vec<AxisFault> {
        let mut faults = Vec::new();
        settings.check(&mut |fault| faults.push(fault));
        faults
    }

    #[test]
    fn what_is_given_by_default_is_sound() {
        assert_eq!(faults(&settings()), []);
        assert_eq!(faults(&settings().with_target_step(-5_000)), []);
        assert_eq!(faults(&settings().with_step_limit(3)), []);
        for mode in OperatingMode::ALL {
            let expected = usize::from(mode == OperatingMode::InterpolatedPosition);
            assert_eq!(faults(&settings().with_mode(mode)).len(), expected, "{mode}");
        }
    }

    #[test]
    fn every_fault_is_reported() {
        let mut bad = settings();
        bad.address.channel = 4;
        bad.mode = OperatingMode::InterpolatedPosition;
        bad.pdo_number = 0;
        bad.scale = Scale::steps_per_turn(0.0);
        bad.step_limit = 0;
        bad.target_step = 1;
        bad.following_window = 0;
        bad.bounds = Some((1, 0));
        bad.range = PositionRange::Modulo { min: 0, max: 0 };
        bad.tpdo_timeout = 0;
        assert_eq!(faults(&bad).len(), 10, "{:?}", faults(&bad));
        bad.step_limit = 100;
        assert!(faults(&bad).contains(&AxisFault::Window { window: 0, least: 800 }));
    }

    #[test]
    fn modes_have_their_rules() {
        let limits = settings().guard_limits(OperatingMode::CyclicPosition, 2);
        assert_eq!(
            (limits.kind, limits.step, limits.tpdo_timeout),
            (TargetKind::Position, 1000, 10)
        );
        let limits = settings().guard_limits(OperatingMode::CyclicTorque, 1);
        assert_eq!((limits.kind, limits.step), (TargetKind::Rate, 1000));
        let limits = settings().guard_limits(OperatingMode::ProfileVelocity, 1);
        assert_eq!((limits.kind, limits.step), (TargetKind::Rate, u32::MAX));
        assert_eq!(target_kind(OperatingMode::ProfilePosition), TargetKind::Profile);
        assert_eq!(target_kind(OperatingMode::Homing), TargetKind::None);
    }
}
