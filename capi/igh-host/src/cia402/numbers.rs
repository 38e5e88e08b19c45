//! Numbers of CiA 301 and CiA 402

use std::ffi::c_int;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror};
use ecan_canopen::{
    DriveState, FaultReaction, HaltOption, NmtCommand, NmtState, NodeLossReaction, OperatingMode,
    QuickStopOption, StopOption,
};
use ecan_cia402::{NodeReset, ScaleSource};

mirror! {
    /// An NMT command.
    pub enum igh_canopen_nmt_t as NmtCommand {
        /// To Operational: process data run.
        IGH_CANOPEN_NMT_START = 0x01 => NmtCommand::Start,
        /// To Stopped: only NMT and heartbeat.
        IGH_CANOPEN_NMT_STOP = 0x02 => NmtCommand::Stop,
        /// To Pre-operational: SDO, no process data.
        IGH_CANOPEN_NMT_PRE_OPERATIONAL = 0x80 => NmtCommand::EnterPreOperational,
        /// Restarts the node.
        IGH_CANOPEN_NMT_RESET_NODE = 0x81 => NmtCommand::ResetNode,
        /// Restarts the node's communication, with parameters 0x1000.. as at power-on.
        IGH_CANOPEN_NMT_RESET_COMMUNICATION = 0x82 => NmtCommand::ResetCommunication,
    }
}

mirror! {
    /// NMT state of a node.
    pub enum igh_canopen_nmt_state_t from Option<NmtState> {
        /// Initialising, after boot-up.
        IGH_CANOPEN_NMT_STATE_INITIALISING = 0x00 => Some(NmtState::Initialising),
        /// Stopped.
        IGH_CANOPEN_NMT_STATE_STOPPED = 0x04 => Some(NmtState::Stopped),
        /// Operational.
        IGH_CANOPEN_NMT_STATE_OPERATIONAL = 0x05 => Some(NmtState::Operational),
        /// Pre-operational.
        IGH_CANOPEN_NMT_STATE_PRE_OPERATIONAL = 0x7F => Some(NmtState::PreOperational),
        /// Unknown: no heartbeat so far, or none since its reset.
        IGH_CANOPEN_NMT_STATE_UNKNOWN = 0xFF => None,
    }
}

mirror! {
    /// A mode of operation, as 0x6060 takes it.
    pub enum igh_cia402_mode_t as OperatingMode {
        /// Profile position. Targets are steps; the drive generates the trajectory.
        IGH_CIA402_MODE_PP = 1 => OperatingMode::ProfilePosition,
        /// Velocity (vl). Targets are those of 0x6042, by default revolutions per minute.
        IGH_CIA402_MODE_VL = 2 => OperatingMode::Velocity,
        /// Profile velocity. Targets are velocities in the drive's unit.
        IGH_CIA402_MODE_PV = 3 => OperatingMode::ProfileVelocity,
        /// Profile torque. Targets are torques in the drive's unit.
        IGH_CIA402_MODE_PT = 4 => OperatingMode::ProfileTorque,
        /// Homing; igh_cia402_home() enters and leaves it.
        IGH_CIA402_MODE_HM = 6 => OperatingMode::Homing,
        /// Interpolated position. Targets are steps, one per target period, into the drive's buffer.
        IGH_CIA402_MODE_IP = 7 => OperatingMode::InterpolatedPosition,
        /// Cyclic synchronous position. Targets are steps, one per target period.
        IGH_CIA402_MODE_CSP = 8 => OperatingMode::CyclicPosition,
        /// Cyclic synchronous velocity.
        IGH_CIA402_MODE_CSV = 9 => OperatingMode::CyclicVelocity,
        /// Cyclic synchronous torque.
        IGH_CIA402_MODE_CST = 10 => OperatingMode::CyclicTorque,
    }
}

mirror! {
    /// State of a drive, by its statusword.
    pub enum igh_cia402_drive_state_t from Option<DriveState> {
        /// No statusword was received, or its state is not defined in CiA 402.
        IGH_CIA402_DRIVE_UNKNOWN = 0 => None,
        /// Starting up.
        IGH_CIA402_DRIVE_NOT_READY = 1 => Some(DriveState::NotReadyToSwitchOn),
        /// Power may not be switched on.
        IGH_CIA402_DRIVE_SWITCH_ON_DISABLED = 2 => Some(DriveState::SwitchOnDisabled),
        /// Power may be switched on.
        IGH_CIA402_DRIVE_READY_TO_SWITCH_ON = 3 => Some(DriveState::ReadyToSwitchOn),
        /// Power is on, the motor is without torque.
        IGH_CIA402_DRIVE_SWITCHED_ON = 4 => Some(DriveState::SwitchedOn),
        /// The motor follows targets.
        IGH_CIA402_DRIVE_OPERATION_ENABLED = 5 => Some(DriveState::OperationEnabled),
        /// A quick stop is in progress, or has ended with power on.
        IGH_CIA402_DRIVE_QUICK_STOP_ACTIVE = 6 => Some(DriveState::QuickStopActive),
        /// A fault occurred; its reaction is in progress.
        IGH_CIA402_DRIVE_FAULT_REACTION = 7 => Some(DriveState::FaultReactionActive),
        /// In fault, the motor is without torque.
        IGH_CIA402_DRIVE_FAULT = 8 => Some(DriveState::Fault),
    }
}

mirror! {
    /// Start of a node's configuration, in igh_cia402_axis_t.reset.
    pub enum igh_cia402_reset_t as NodeReset {
        /// NMT command Enter Pre-operational.
        IGH_CIA402_RESET_NONE = 0 => NodeReset::None,
        /// NMT command Reset communication: parameters of 0x1000.. as at power-on.
        IGH_CIA402_RESET_COMMUNICATION = 1 => NodeReset::Communication,
        /// NMT command Reset node.
        IGH_CIA402_RESET_NODE = 2 => NodeReset::Node,
    }
}

/// Range of a position counter, in igh_cia402_axis_t.range.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_range_t {
    /// It ends at the limits of an int32_t; nothing is commanded outside of them.
    IGH_CIA402_RANGE_LINEAR = 0,
    /// It wraps over the whole int32_t.
    IGH_CIA402_RANGE_WRAPPING = 1,
    /// It wraps within 0x607B: one step beyond range_max is range_min.
    IGH_CIA402_RANGE_MODULO = 2,
}

/// Check of the revision number, in igh_cia402_axis_t.revision_check. The major revision is in the upper
/// half of the number.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_revision_t {
    /// Every one.
    IGH_CIA402_REVISION_ANY = 0,
    /// Exactly revision_number.
    IGH_CIA402_REVISION_EXACTLY = 1,
    /// The same major revision, and at least the minor one: a compatible drive.
    IGH_CIA402_REVISION_COMPATIBLE = 2,
}

mirror! {
    /// Origin of the scale of an axis, in igh_cia402_axis_t.scale_source.
    pub enum igh_cia402_scale_source_t as ScaleSource {
        /// steps_per_turn and velocity_units; the units of the drive are not read.
        IGH_CIA402_SCALE_CONFIGURED = 0 => ScaleSource::Configured,
        /// These, compared with the units of the drive: igh_cia402_get_drive_units().
        IGH_CIA402_SCALE_CHECKED = 1 => ScaleSource::Checked,
        /// The units of the drive, which must have 0x608F; origin is that of the axis. Not with limits
        /// in rad/s.
        IGH_CIA402_SCALE_DRIVE = 2 => ScaleSource::Drive,
    }
}

mirror! {
    /// Reaction of a drive to a lost heartbeat of the host (0x6007), in
    /// igh_cia402_axis_t.host_loss. A manufacturer may define further, negative ones.
    pub enum igh_cia402_host_loss_t as NodeLossReaction {
        /// Nothing.
        IGH_CIA402_HOST_LOSS_NONE = 0 => NodeLossReaction::None,
        /// Fault.
        IGH_CIA402_HOST_LOSS_FAULT = 1 => NodeLossReaction::Fault,
        /// Disables voltage.
        IGH_CIA402_HOST_LOSS_DISABLE_VOLTAGE = 2 => NodeLossReaction::DisableVoltage,
        /// Quick stop.
        IGH_CIA402_HOST_LOSS_QUICK_STOP = 3 => NodeLossReaction::QuickStop,
    }
}

mirror! {
    /// Kind of a drive's quick stop (0x605A), in igh_cia402_axis_t.quick_stop. A manufacturer may
    /// define further, negative ones.
    pub enum igh_cia402_quick_stop_t as QuickStopOption {
        /// Disables voltage at once.
        IGH_CIA402_QUICK_STOP_DISABLE = 0 => QuickStopOption::Disable,
        /// Slows down by its ramp, then switches off.
        IGH_CIA402_QUICK_STOP_SLOW_DOWN = 1 => QuickStopOption::SlowDown,
        /// Slows down by its quick stop ramp, then switches off.
        IGH_CIA402_QUICK_STOP_RAMP = 2 => QuickStopOption::QuickStop,
        /// Slows down at the current limit, then switches off.
        IGH_CIA402_QUICK_STOP_CURRENT_LIMIT = 3 => QuickStopOption::CurrentLimit,
        /// Slows down at the voltage limit, then switches off.
        IGH_CIA402_QUICK_STOP_VOLTAGE_LIMIT = 4 => QuickStopOption::VoltageLimit,
        /// Slows down by its ramp and stays at rest with power on.
        IGH_CIA402_QUICK_STOP_SLOW_DOWN_AND_STAY = 5 => QuickStopOption::SlowDownAndStay,
        /// Slows down by its quick stop ramp and stays at rest with power on.
        IGH_CIA402_QUICK_STOP_RAMP_AND_STAY = 6 => QuickStopOption::QuickStopAndStay,
        /// Slows down at the current limit and stays at rest with power on.
        IGH_CIA402_QUICK_STOP_CURRENT_LIMIT_AND_STAY = 7 => QuickStopOption::CurrentLimitAndStay,
        /// Slows down at the voltage limit and stays at rest with power on.
        IGH_CIA402_QUICK_STOP_VOLTAGE_LIMIT_AND_STAY = 8 => QuickStopOption::VoltageLimitAndStay,
    }
}

mirror! {
    /// Stop of a drive by shutdown (0x605B) and disable operation (0x605C), in
    /// igh_cia402_axis_t.shutdown and disable_operation. A manufacturer may define further, negative
    /// ones.
    pub enum igh_cia402_stop_option_t as StopOption {
        /// Disables voltage at once; the motor coasts.
        IGH_CIA402_STOP_OPTION_DISABLE = 0 => StopOption::Disable,
        /// Slows down by its ramp, then switches off.
        IGH_CIA402_STOP_OPTION_SLOW_DOWN = 1 => StopOption::SlowDown,
    }
}

mirror! {
    /// Kind of a drive's halt (0x605D), in igh_cia402_axis_t.halt. It stays enabled. A manufacturer
    /// may define further, negative ones.
    pub enum igh_cia402_halt_option_t as HaltOption {
        /// Slows down by its ramp.
        IGH_CIA402_HALT_SLOW_DOWN = 1 => HaltOption::SlowDown,
        /// Slows down by its quick stop ramp.
        IGH_CIA402_HALT_QUICK_STOP_RAMP = 2 => HaltOption::QuickStop,
        /// Slows down at the current limit.
        IGH_CIA402_HALT_CURRENT_LIMIT = 3 => HaltOption::CurrentLimit,
        /// Slows down at the voltage limit.
        IGH_CIA402_HALT_VOLTAGE_LIMIT = 4 => HaltOption::VoltageLimit,
    }
}

mirror! {
    /// Reaction of a drive to a fault (0x605E), in igh_cia402_axis_t.fault_reaction; then it
    /// switches off. A manufacturer may define further, negative ones.
    pub enum igh_cia402_fault_reaction_t as FaultReaction {
        /// Disables voltage at once; the motor coasts.
        IGH_CIA402_FAULT_REACTION_DISABLE = 0 => FaultReaction::Disable,
        /// Slows down by its ramp.
        IGH_CIA402_FAULT_REACTION_SLOW_DOWN = 1 => FaultReaction::SlowDown,
        /// Slows down by its quick stop ramp.
        IGH_CIA402_FAULT_REACTION_QUICK_STOP_RAMP = 2 => FaultReaction::QuickStop,
        /// Slows down at the current limit.
        IGH_CIA402_FAULT_REACTION_CURRENT_LIMIT = 3 => FaultReaction::CurrentLimit,
        /// Slows down at the voltage limit.
        IGH_CIA402_FAULT_REACTION_VOLTAGE_LIMIT = 4 => FaultReaction::VoltageLimit,
    }
}

pub(crate) fn mode(call: Call, number: c_int) -> Result<OperatingMode, ecan_result_t> {
    igh_cia402_mode_t::to_rust(number).ok_or_else(|| {
        call.argument("mode", format_args!("{number} is invalid; allowed: igh_cia402_mode_t"))
    })
}

pub(crate) fn nmt_command(call: Call, number: c_int) -> Result<NmtCommand, ecan_result_t> {
    igh_canopen_nmt_t::to_rust(number).ok_or_else(|| {
        call.argument("command", format_args!("{number} is invalid; allowed: igh_canopen_nmt_t"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_have_the_numbers_of_0x6060() {
        let modes = igh_cia402_mode_t::PAIRS;
        assert!(modes.iter().map(|(.., mode)| *mode).eq(OperatingMode::ALL.iter().copied()));
        assert!(modes.iter().all(|(number, _, mode)| *number as i8 == mode.raw()));
    }

    #[test]
    fn nmt_has_the_numbers_of_cia_301() {
        let commands = igh_canopen_nmt_t::PAIRS;
        assert!(commands.iter().all(|(number, _, command)| *number as u8 == command.raw()));
        use NmtState::*;
        for state in [Initialising, Stopped, Operational, PreOperational] {
            assert_eq!(igh_canopen_nmt_state_t::from(Some(state)) as u8, state.raw());
        }
    }

    #[test]
    fn option_codes_have_the_numbers_of_cia_402() {
        let losses = igh_cia402_host_loss_t::PAIRS;
        assert!(losses.iter().all(|(number, _, reaction)| *number as i16 == reaction.raw()));
        let stops = igh_cia402_quick_stop_t::PAIRS;
        assert!(stops.iter().all(|(number, _, option)| *number as i16 == option.raw()));
        let others = igh_cia402_stop_option_t::PAIRS;
        assert!(others.iter().all(|(number, _, option)| *number as i16 == option.raw()));
        let halts = igh_cia402_halt_option_t::PAIRS;
        assert!(halts.iter().all(|(number, _, option)| *number as i16 == option.raw()));
        let reactions = igh_cia402_fault_reaction_t::PAIRS;
        assert!(reactions.iter().all(|(number, _, option)| *number as i16 == option.raw()));
    }

    #[test]
    fn resets_have_their_numbers() {
        let resets = igh_cia402_reset_t::PAIRS;
        assert!(resets.iter().all(|(number, _, reset)| *number as u8 == *reset as u8));
        assert_eq!(igh_cia402_reset_t::to_rust(3), None);
    }
}
