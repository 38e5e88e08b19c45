//! First contact with a drive: whether it is enabled or moves, and what is done about it.

use std::time::Duration;

use ecan_canopen::{
    Command, Configuring, Controlword, Expectation, Network, OperatingMode, Statusword, Step,
    object,
};
use ecan_protocol::sequence::{Action, SdoValue};

use super::config::Takeover;
use super::drive_status::{DrivePoll, DriveStatus, GONE_ATTEMPTS};
use super::pdo_layout::TargetObject;
use super::plan::{AxisEvent, AxisPlan};
use super::script::{Script, axis_script};

/// Attempts without an answer after which a drive that was enabled at the first contact counts as gone: until
/// then its channel gets no heartbeat, so that its own watch stops it.
const TAKEOVER_ATTEMPTS: u32 = 24;

/// Longest time in which an enabled drive must show that it is at rest, to be adopted.
const ADOPT_NS: u64 = 200_000_000;

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
enum TakeoverState {
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
struct Adoption {
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

/// What a drive reported at the first contact, for its adoption.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Inspection {
    mode: Option<i8>,
    /// Position of [`AxisPlan::kept_position`].
    kept: Option<i32>,
    quick_stop: Option<i16>,
}

impl Inspection {
    /// Stores the value of an object.
    fn note(&mut self, index: u16, value: u64) {
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

/// First contact with a drive. The channel of an axis gets neither SYNC nor heartbeats until it is
/// complete.
#[derive(Debug)]
pub(crate) struct FirstContact {
    state: TakeoverState,
    inspection: Inspection,
    is_uninspected: bool,
}

/// Situation of an axis in a cycle of the first contact.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Situation {
    pub(crate) reaches_gateway: bool,
    /// The drive answered a round of SDO transfers in this cycle.
    pub(crate) is_answered: bool,
    pub(crate) is_stopping: bool,
    pub(crate) is_setup_pending: bool,
    pub(crate) now_ns: u64,
}

impl Default for FirstContact {
    fn default() -> Self {
        Self {
            state: TakeoverState::Waiting,
            inspection: Inspection::default(),
            is_uninspected: true,
        }
    }
}

impl FirstContact {
    /// Returns whether the drive is inspected, and adopted or stopped if it was enabled.
    pub(crate) fn is_done(&self) -> bool {
        matches!(self.state, TakeoverState::Done)
    }

    /// Returns whether nothing remains to be done.
    pub(crate) fn is_over(&self) -> bool {
        self.is_done() && !self.is_uninspected
    }

    pub(crate) fn is_inspecting(&self) -> bool {
        matches!(self.state, TakeoverState::Inspecting { .. })
    }

    pub(crate) fn is_adopting(&self) -> bool {
        matches!(self.state, TakeoverState::Adopting(_))
    }

    /// Returns whether the channel of the axis gets neither SYNC nor heartbeats.
    pub(crate) fn is_uninspected(&self) -> bool {
        self.is_uninspected
    }

    /// Begins again: the state of the drive is to be read.
    pub(crate) fn restart(&mut self) {
        self.state = TakeoverState::Waiting;
    }

    pub(crate) fn begin_adoption(&mut self, verification: Script, target: i32) {
        let stage = AdoptionStage::Verifying(verification);
        self.state = TakeoverState::Adopting(Adoption { stage, target });
    }

    /// Counts a sent frame of [`adoption_frame`](Self::adoption_frame).
    pub(crate) fn count_frame(&mut self) {
        if let Some(AdoptionStage::Sending { cycles, .. }) = self.adoption_stage() {
            *cycles = cycles.saturating_add(1);
        }
    }

    /// Notes a SYNC on the channel of the axis.
    pub(crate) fn note_sync(&mut self) {
        if let Some(AdoptionStage::Sending { has_sync, .. }) = self.adoption_stage() {
            *has_sync = true;
        }
    }

    fn adoption_stage(&mut self) -> Option<&mut AdoptionStage> {
        match &mut self.state {
            TakeoverState::Adopting(adoption) => Some(&mut adoption.stage),
            _ => None,
        }
    }

    /// Stores the value of an object that was read for the inspection.
    pub(crate) fn note_object(&mut self, index: u16, value: u64) {
        self.inspection.note(index, value);
    }

    /// Continues the first contact. `next_verification` returns the script that reads the next PDOs after
    /// those that were verified.
    pub(crate) fn step(
        &mut self,
        plan: &AxisPlan,
        situation: Situation,
        drive: &mut DriveStatus,
        poll: &DrivePoll,
        network: &mut Network,
        next_verification: impl FnOnce() -> Option<Script>,
    ) -> Option<AxisEvent> {
        let Situation { is_stopping, now_ns, .. } = situation;
        match &mut self.state {
            TakeoverState::Waiting => {
                if situation.reaches_gateway {
                    self.inspection = Inspection::default();
                    drive.rest.restart();
                    self.state = TakeoverState::Inspecting { since_ns: now_ns };
                }
                None
            }
            TakeoverState::Inspecting { since_ns } => {
                let since_ns = *since_ns;
                let is_absent = poll.unanswered() >= GONE_ATTEMPTS;
                // The statusword of an attempt that was not answered to its end may have arrived.
                let needs_stop = !poll.is_running() && !drive.is_off_or_unknown();
                if situation.is_answered || needs_stop {
                    return self.inspect(plan, situation, drive, since_ns);
                }
                if is_absent {
                    self.state = TakeoverState::Done;
                }
                None
            }
            TakeoverState::Adopting(_) => {
                if is_stopping {
                    // The first request of the stop aborts the transfer.
                    self.state = TakeoverState::Stopping;
                    return None;
                }
                self.step_adoption(plan, network, now_ns, next_verification)
            }
            TakeoverState::Stopping => {
                if !is_stopping || poll.unanswered() >= TAKEOVER_ATTEMPTS {
                    self.state = TakeoverState::Done;
                }
                None
            }
            TakeoverState::Done => {
                self.is_uninspected = false;
                None
            }
        }
    }

    /// Decides about a drive that has answered: it is off, is adopted, or is stopped.
    fn inspect(
        &mut self,
        plan: &AxisPlan,
        situation: Situation,
        drive: &DriveStatus,
        since_ns: u64,
    ) -> Option<AxisEvent> {
        let Situation { is_stopping, is_setup_pending, now_ns, .. } = situation;
        let is_at_rest = drive.is_at_rest(now_ns, plan.fresh_ns);
        if is_stopping {
            self.state = TakeoverState::Stopping;
        } else if drive.is_off_or_unknown() {
            self.state = TakeoverState::Done;
        } else if plan.takeover == Takeover::Stop || is_setup_pending {
            return self.stop();
        } else if is_at_rest && let Some(target) = self.adoptable_target(plan, drive) {
            return Some(AxisEvent::Adopt { target });
        } else if is_at_rest || now_ns.saturating_sub(since_ns) > ADOPT_NS {
            return self.stop();
        }
        None
    }

    fn stop(&mut self) -> Option<AxisEvent> {
        self.state = TakeoverState::Stopping;
        Some(AxisEvent::EnabledDriveFound)
    }

    /// The target that keeps the drive at standstill; `None` if it cannot be adopted.
    fn adoptable_target(&self, plan: &AxisPlan, drive: &DriveStatus) -> Option<i32> {
        let Inspection { mode, kept, .. } = self.inspection;
        // An axis at rest may hold a load by its torque, which the first target would take away.
        // In IP the last set-point is not in 0x607A.
        let is_excluded = plan.config.mode == OperatingMode::Homing
            || self.inspection.may_stay_in_quick_stop()
            || matches!(
                plan.command_layout.target(),
                TargetObject::Torque | TargetObject::InterpolationData
            );
        if !drive.is_enabled() || mode != Some(plan.config.mode.raw()) || is_excluded {
            return None;
        }
        if plan.kept_position().is_none() {
            return Some(0);
        }
        // A blocked motor would go there as soon as it is free.
        let (kept, position) = (kept?, drive.rest.position()?);
        let distance = plan.config.range.distance(kept, position).unsigned_abs();
        let target = match plan.config.mode {
            OperatingMode::ProfilePosition => position,
            _ => kept,
        };
        (distance <= u64::from(plan.config.step_limit)).then_some(target)
    }

    fn step_adoption(
        &mut self,
        plan: &AxisPlan,
        network: &mut Network,
        now_ns: u64,
        next_verification: impl FnOnce() -> Option<Script>,
    ) -> Option<AxisEvent> {
        let TakeoverState::Adopting(Adoption { mut stage, target }) = self.state else {
            return None;
        };
        let next = match &mut stage {
            AdoptionStage::Sending { cycles, has_sync } => {
                let least = CYCLES_BEFORE_SYNC.saturating_add(plan.schedule_images);
                self.is_uninspected = *cycles < least && !*has_sync;
                has_sync.then(|| AdoptionStage::Confirming(confirming_script(plan, target)))
            }
            AdoptionStage::Verifying(script)
            | AdoptionStage::Replacing(script)
            | AdoptionStage::Confirming(script) => {
                match script.advance(network, plan.node, now_ns, |_, _, _| {}) {
                    Configuring::Running => None,
                    Configuring::Failed(failure) => {
                        tracing::warn!(axis = plan.index, "axis {}: {failure}", plan.index);
                        return self.stop();
                    }
                    Configuring::Done => match stage {
                        AdoptionStage::Verifying(_) => Some(next_verification().map_or_else(
                            || AdoptionStage::Replacing(replacing_script(plan, target)),
                            AdoptionStage::Verifying,
                        )),
                        AdoptionStage::Replacing(_) => {
                            Some(AdoptionStage::Sending { cycles: 0, has_sync: false })
                        }
                        AdoptionStage::Sending { .. } => None,
                        AdoptionStage::Confirming(_) => {
                            self.state = TakeoverState::Done;
                            return Some(AxisEvent::Adopted);
                        }
                    },
                }
            }
        };
        let stage = next.unwrap_or(stage);
        self.state = TakeoverState::Adopting(Adoption { stage, target });
        None
    }

    /// Controlword and target of the frame that keeps a drive at standstill while it is adopted. `repeats`
    /// states whether this cycle carries a repetition of a command.
    pub(crate) fn adoption_frame(
        &self,
        plan: &AxisPlan,
        repeats: bool,
    ) -> Option<(Controlword, i32)> {
        let TakeoverState::Adopting(Adoption { stage, target }) = self.state else {
            return None;
        };
        let is_due = match stage {
            AdoptionStage::Verifying(_) | AdoptionStage::Replacing(_) => false,
            AdoptionStage::Sending { has_sync, .. } => !has_sync || repeats,
            AdoptionStage::Confirming(_) => repeats,
        };
        let word = Controlword::of(Command::EnableOperation).with(match plan.config.mode {
            OperatingMode::ProfilePosition => Controlword::MODE_5,
            OperatingMode::Velocity => {
                Controlword::MODE_4 | Controlword::MODE_5 | Controlword::MODE_6
            }
            _ => 0,
        });
        is_due.then_some((word, target))
    }
}

/// Replaces the target that is in force in the drive.
fn replacing_script(plan: &AxisPlan, target: i32) -> Script {
    let axis = plan.config.node_axis;
    let replace = |index, value: SdoValue| {
        let write = Step::write(index, 0, value).named("standstill");
        [write, Step::expect(index, 0, value).named("standstill")]
    };
    match plan.config.mode {
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
fn confirming_script(plan: &AxisPlan, target: i32) -> Script {
    let state = Step::expect_that(object::STATUSWORD, 0, OPERATION_ENABLED);
    let await_zero = |index, zero: SdoValue| {
        Step::await_value(index, 0, zero, DEMAND).named("demand at standstill").if_present()
    };
    let (in_force, demand) = match plan.config.mode {
        OperatingMode::Velocity => {
            let demand = await_zero(object::VL_VELOCITY_DEMAND, 0_i16.into());
            // infallible: it is 0
            (Step::expect(object::VL_TARGET_VELOCITY, 0, target as i16), Some(demand))
        }
        OperatingMode::ProfileVelocity => {
            let demand = await_zero(object::VELOCITY_DEMAND, 0_i32.into());
            (Step::expect(object::TARGET_VELOCITY, 0, target), Some(demand))
        }
        OperatingMode::CyclicVelocity => (Step::expect(object::TARGET_VELOCITY, 0, target), None),
        OperatingMode::ProfilePosition => {
            let demand = Step::await_value(object::POSITION_DEMAND, 0, target, DEMAND);
            let demand = demand.named("demand at standstill").if_present();
            (Step::expect(object::TARGET_POSITION, 0, target), Some(demand))
        }
        _ => (Step::expect(object::TARGET_POSITION, 0, target), None),
    };
    let in_force = in_force.named("target of this owner");
    axis_script(plan.config.node_axis, [in_force].into_iter().chain(demand).chain([state]))
}
