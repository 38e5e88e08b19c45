//! First contact with a drive: whether it is enabled or moves, and what is done about it.

use std::time::Duration;

use ecan_canopen::{
    Command, Configuring, Controlword, Expectation, Network, OperatingMode, Statusword, Step,
    object,
};

use super::axis::Axis;
use super::axis_cycle::Outgoing;
use super::pdo_layout::TargetObject;
use super::script::{Script, axis_script};
use ecan_protocol::sequence::{Action, SdoValue};

/// Longest time in which an enabled drive must show that it is at rest, to be adopted.
pub(crate) const ADOPT_NS: u64 = 200_000_000;

/// Treatment of a drive that is enabled when a [`Cia402`](crate::Cia402) begins to command it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Takeover {
    /// The drive is quick-stopped, and switched off at rest.
    #[default]
    Stop,
    /// The drive remains enabled if it is at rest, displays the configured mode, has the process data of the
    /// configuration, and obeys a target that keeps it at standstill: velocity 0 in CSV, PV and VL, a
    /// set-point at its position in PP, in CSP the target that it has. The target in CSP and the demand (0x6062) in PP
    /// must be within the step limit of the position. The target is read back by SDO
    /// before and after the first SYNC. Only then the axis counts as configured, and no target of an
    /// earlier owner is in force. Otherwise, and in the torque modes and IP, the drive is stopped; also one with a quick
    /// stop option (0x605A) above 4, which a frame of the adoption would enable again after a quick stop of its own. A
    /// drive that watches the host's heartbeat must be adopted within its consumer time (0x1016).
    Adopt,
}

/// State of the first contact.
///
/// | from | event | to |
/// | --- | --- | --- |
/// | `Waiting` | the gateway is ready | `Inspecting` |
/// | `Inspecting` | the drive is not enabled, did not answer, or restarted | `Done` |
/// | `Inspecting` | it is enabled | `Stopping` |
/// | `Inspecting` | it is enabled and at rest, and is to be adopted | `Adopting` |
/// | `Adopting` | its configuration is as expected, and it has the target of this owner | `Done` |
/// | `Adopting` | its configuration or its target differs, or it left Operation Enabled | `Stopping` |
/// | `Stopping` | it has stopped, or answers no more | `Done` |
/// | `Done` | a drive that never answered appears; its configuration differs | `Waiting` |
#[expect(clippy::large_enum_variant, reason = "a box would allocate in the cycle")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum TakeoverState {
    #[default]
    Waiting,
    Inspecting {
        since_ns: u64,
    },
    Adopting(Adoption),
    Stopping,
    Done,
}

/// Time for an answer of the set-point handshake.
const HANDSHAKE: Duration = Duration::from_millis(100);
/// Time in which the demand of the drive must reach its target.
const DEMAND: Duration = Duration::from_secs(1);

/// Cycles with an RPDO before the first SYNC, beyond those that a scheduled frame waits in the gateway.
const CYCLES_BEFORE_SYNC: u16 = 2;

/// State of the drive without the bits that do not belong to it: Operation Enabled.
const OPERATION_ENABLED: Expectation = Expectation::Masked { value: 0x27, mask: 0x6F };

/// Adoption of an enabled drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Adoption {
    stage: AdoptionStage,
    /// Target that keeps the drive at standstill, in the units of its mode.
    target: i32,
}

/// Stages of an adoption, in order; a failure ends it with a stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum AdoptionStage {
    /// Mapping and mode are read.
    Verifying(Script),
    /// The target that is in force is replaced by SDO, and read back.
    Replacing(Script),
    /// An RPDO of the earlier owner may wait in the drive for a SYNC: RPDOs of this one replace it, and then
    /// SYNC starts on the channel.
    Sending { cycles: u16, has_sync: bool },
    /// State and target are read back after the SYNC.
    Confirming(Script),
}

impl TakeoverState {
    pub(crate) fn begin_adoption(verification: Script, target: i32) -> Self {
        Self::Adopting(Adoption { stage: AdoptionStage::Verifying(verification), target })
    }

    /// A frame of [`Axis::adoption_frame`] was sent.
    pub(crate) fn frame_sent(&mut self) {
        if let Self::Adopting(Adoption { stage: AdoptionStage::Sending { cycles, .. }, .. }) = self
        {
            *cycles = cycles.saturating_add(1);
        }
    }

    /// A SYNC was sent on the channel of the axis.
    pub(crate) fn sync_sent(&mut self) {
        if let Self::Adopting(Adoption { stage: AdoptionStage::Sending { has_sync, .. }, .. }) =
            self
        {
            *has_sync = true;
        }
    }
}

/// What a drive reported at the first contact, for its adoption.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Inspection {
    mode: Option<i8>,
    /// Position of [`kept_position`](Axis::kept_position).
    kept: Option<i32>,
    quick_stop: Option<i16>,
}

impl Inspection {
    /// Takes the value of an object.
    pub(crate) fn note(&mut self, index: u16, value: u64) {
        match index {
            object::MODE_DISPLAY => self.mode = Some(value as i8),
            object::TARGET_POSITION | object::POSITION_DEMAND => self.kept = Some(value as i32),
            object::QUICK_STOP_OPTION => self.quick_stop = Some(value as i16),
            _ => {}
        }
    }

    /// Returns whether the drive may stay in Quick Stop Active, which a controlword of the adoption leaves.
    fn may_stay_in_quick_stop(&self) -> bool {
        self.quick_stop.is_some_and(|option| !(0..=4).contains(&option))
    }
}

impl Axis {
    /// Object with the position that a drive keeps at rest: its target in CSP, its demand in PP.
    pub(crate) fn kept_position(&self) -> Option<u16> {
        match self.config.mode {
            OperatingMode::CyclicPosition => Some(object::TARGET_POSITION),
            OperatingMode::ProfilePosition => Some(object::POSITION_DEMAND),
            _ => None,
        }
    }

    /// The target that keeps the drive at standstill; `None` if it cannot be adopted.
    pub(crate) fn adoptable_target(&self) -> Option<i32> {
        let Inspection { mode, kept, .. } = self.inspection;
        // An axis at rest may hold a load by its torque, which the first target would take away.
        // In IP the last set-point is not in 0x607A.
        let is_excluded = self.config.mode == OperatingMode::Homing
            || self.inspection.may_stay_in_quick_stop()
            || matches!(
                self.command_layout.target(),
                TargetObject::Torque | TargetObject::InterpolationData
            );
        if !self.drive.is_enabled() || mode != Some(self.config.mode.raw()) || is_excluded {
            return None;
        }
        if self.kept_position().is_none() {
            return Some(0);
        }
        // A blocked motor would go there as soon as it is free.
        let (kept, position) = (kept?, self.drive.rest.position()?);
        let distance = self.config.range.distance(kept, position).unsigned_abs();
        let target = match self.config.mode {
            OperatingMode::ProfilePosition => position,
            _ => kept,
        };
        (distance <= u64::from(self.config.step_limit)).then_some(target)
    }

    /// Continues an adoption. Returns whether it failed.
    pub(crate) fn step_adoption(&mut self, network: &mut Network, now_ns: u64) -> bool {
        let TakeoverState::Adopting(Adoption { mut stage, target }) = self.takeover else {
            return false;
        };
        let next = match &mut stage {
            AdoptionStage::Sending { cycles, has_sync } => {
                let least = CYCLES_BEFORE_SYNC.saturating_add(self.schedule_images);
                self.is_uninspected = *cycles < least && !*has_sync;
                has_sync.then(|| AdoptionStage::Confirming(self.confirming_script(target)))
            }
            AdoptionStage::Verifying(script)
            | AdoptionStage::Replacing(script)
            | AdoptionStage::Confirming(script) => {
                match script.advance(network, self.node, now_ns, |_, _, _| {}) {
                    Configuring::Running => None,
                    Configuring::Failed(failure) => {
                        tracing::warn!(axis = self.index, "axis {}: {failure}", self.index);
                        return true;
                    }
                    Configuring::Done => match stage {
                        AdoptionStage::Verifying(_) => Some(self.next_verification().map_or_else(
                            || AdoptionStage::Replacing(self.replacing_script(target)),
                            AdoptionStage::Verifying,
                        )),
                        AdoptionStage::Replacing(_) => {
                            Some(AdoptionStage::Sending { cycles: 0, has_sync: false })
                        }
                        AdoptionStage::Sending { .. } => None,
                        AdoptionStage::Confirming(_) => {
                            self.adopt(network);
                            self.takeover = TakeoverState::Done;
                            return false;
                        }
                    },
                }
            }
        };
        self.takeover = TakeoverState::Adopting(Adoption { stage: next.unwrap_or(stage), target });
        false
    }

    pub(crate) fn cancel_adoption(&mut self, network: &mut Network) {
        if let TakeoverState::Adopting(Adoption {
            stage:
                AdoptionStage::Verifying(script)
                | AdoptionStage::Replacing(script)
                | AdoptionStage::Confirming(script),
            ..
        }) = self.takeover
        {
            script.cancel(network, self.node);
        }
    }

    /// The frame that keeps a drive at standstill while it is adopted; `repeats` as for commands.
    pub(crate) fn adoption_frame(&self, repeats: bool) -> Option<Outgoing> {
        let TakeoverState::Adopting(Adoption { stage, target }) = self.takeover else {
            return None;
        };
        let is_due = match stage {
            AdoptionStage::Verifying(_) | AdoptionStage::Replacing(_) => false,
            AdoptionStage::Sending { has_sync, .. } => !has_sync || repeats,
            AdoptionStage::Confirming(_) => repeats,
        };
        let word = Controlword::of(Command::EnableOperation).with(match self.config.mode {
            OperatingMode::ProfilePosition => Controlword::MODE_5,
            OperatingMode::Velocity => {
                Controlword::MODE_4 | Controlword::MODE_5 | Controlword::MODE_6
            }
            _ => 0,
        });
        let rpdo = self.command_layout.encode(word, target, self.config.mode);
        is_due.then_some(Outgoing { rpdo, command: Some(word), ramp: None })
    }

    /// Replaces the target that is in force in the drive.
    fn replacing_script(&self, target: i32) -> Script {
        let axis = self.config.node_axis;
        let replace = |index, value: SdoValue| {
            let write = Step::write(index, 0, value).named("standstill");
            [write, Step::expect(index, 0, value).named("standstill")]
        };
        match self.config.mode {
            OperatingMode::Velocity => {
                // infallible: it is 0
                axis_script(axis, replace(object::VL_TARGET_VELOCITY, (target as i16).into()))
            }
            OperatingMode::ProfileVelocity => {
                axis_script(axis, replace(object::TARGET_VELOCITY, target.into()))
            }
            OperatingMode::CyclicVelocity => {
                // With an offset, velocity 0 is not standstill.
                let offset = Step::expect(object::VELOCITY_OFFSET, 0, 0_i32).if_present();
                let velocity = replace(object::TARGET_VELOCITY, target.into());
                axis_script(axis, [offset].into_iter().chain(velocity))
            }
            OperatingMode::ProfilePosition => {
                let enabled = Controlword::of(Command::EnableOperation);
                let write = |bits| {
                    let word = enabled.with(bits);
                    Step::write(object::CONTROLWORD, 0, word.0).named("set-point at standstill")
                };
                let acknowledged = |value: u16| Action::Await {
                    index: object::STATUSWORD,
                    subindex: 0,
                    expected: Expectation::Masked {
                        value: value.into(),
                        mask: Statusword::MODE_12.into(),
                    },
                    timeout: HANDSHAKE,
                };
                // The halt keeps an earlier set-point from being continued until the new one replaces it at once.
                axis_script(
                    axis,
                    [
                        write(Controlword::HALT | Controlword::MODE_5),
                        Step::write(object::TARGET_POSITION, 0, target).named("standstill"),
                        acknowledged(0).into(),
                        write(Controlword::MODE_4 | Controlword::MODE_5),
                        acknowledged(Statusword::MODE_12).into(),
                        write(Controlword::MODE_5),
                    ],
                )
            }
            _ => axis_script(axis, [Step::expect(object::TARGET_POSITION, 0, target)]),
        }
    }

    /// Reads state and target of the drive after a SYNC.
    fn confirming_script(&self, target: i32) -> Script {
        let state = Step::expect_that(object::STATUSWORD, 0, OPERATION_ENABLED);
        let await_zero = |index, zero: SdoValue| {
            Step::await_value(index, 0, zero, DEMAND).named("demand at standstill").if_present()
        };
        let (in_force, demand) = match self.config.mode {
            OperatingMode::Velocity => {
                let demand = await_zero(object::VL_VELOCITY_DEMAND, 0_i16.into());
                // infallible: it is 0
                (Step::expect(object::VL_TARGET_VELOCITY, 0, target as i16), Some(demand))
            }
            OperatingMode::ProfileVelocity => {
                let demand = await_zero(object::VELOCITY_DEMAND, 0_i32.into());
                (Step::expect(object::TARGET_VELOCITY, 0, target), Some(demand))
            }
            OperatingMode::CyclicVelocity => {
                (Step::expect(object::TARGET_VELOCITY, 0, target), None)
            }
            OperatingMode::ProfilePosition => {
                let demand = Step::await_value(object::POSITION_DEMAND, 0, target, DEMAND);
                let demand = demand.named("demand at standstill").if_present();
                (Step::expect(object::TARGET_POSITION, 0, target), Some(demand))
            }
            _ => (Step::expect(object::TARGET_POSITION, 0, target), None),
        };
        let in_force = in_force.named("target of this owner");
        axis_script(self.config.node_axis, [in_force].into_iter().chain(demand).chain([state]))
    }
}
