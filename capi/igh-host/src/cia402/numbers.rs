//! Numbers of CiA 301 and CiA 402

use std::ffi::c_int;

use ecan_canopen::{DriveState, NmtCommand, OperatingMode};
use ecan_cia402::NodeReset;
use ecan_mcan_host::boundary::Call;
use ecan_mcan_host::common::result::ecan_result_t;

/// An NMT command.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_canopen_nmt_t {
    /// To Operational: process data run.
    IGH_CANOPEN_NMT_START = 0x01,
    /// To Stopped: only NMT and heartbeat.
    IGH_CANOPEN_NMT_STOP = 0x02,
    /// To Pre-operational: SDO, no process data.
    IGH_CANOPEN_NMT_PRE_OPERATIONAL = 0x80,
    /// Restarts the node.
    IGH_CANOPEN_NMT_RESET_NODE = 0x81,
    /// Restarts the node's communication, with parameters 0x1000.. as at power-on.
    IGH_CANOPEN_NMT_RESET_COMMUNICATION = 0x82,
}

/// The NMT state that a node reports.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_canopen_nmt_state_t {
    /// It has just booted.
    IGH_CANOPEN_NMT_STATE_INITIALISING = 0x00,
    /// Stopped.
    IGH_CANOPEN_NMT_STATE_STOPPED = 0x04,
    /// Operational.
    IGH_CANOPEN_NMT_STATE_OPERATIONAL = 0x05,
    /// Pre-operational.
    IGH_CANOPEN_NMT_STATE_PRE_OPERATIONAL = 0x7F,
    /// Nothing was heard of it, or not since it was reset.
    IGH_CANOPEN_NMT_STATE_UNKNOWN = 0xFF,
}

/// A mode of operation, as 0x6060 takes it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_mode_t {
    /// Profile position. Targets are steps; the drive makes its own way there.
    IGH_CIA402_MODE_PP = 1,
    /// Profile velocity. Targets are velocities in the drive's unit.
    IGH_CIA402_MODE_PV = 3,
    /// Profile torque. Targets are torques in the drive's unit.
    IGH_CIA402_MODE_PT = 4,
    /// Homing; igh_cia402_home() enters and leaves it.
    IGH_CIA402_MODE_HM = 6,
    /// Interpolated position; not driven by this library.
    IGH_CIA402_MODE_IP = 7,
    /// Cyclic synchronous position. Targets are steps, one per cycle.
    IGH_CIA402_MODE_CSP = 8,
    /// Cyclic synchronous velocity.
    IGH_CIA402_MODE_CSV = 9,
    /// Cyclic synchronous torque.
    IGH_CIA402_MODE_CST = 10,
}

/// State of a drive, by its statusword.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_drive_state_t {
    /// No statusword came yet, or one that CiA 402 does not know.
    IGH_CIA402_DRIVE_UNKNOWN = 0,
    /// Starting up.
    IGH_CIA402_DRIVE_NOT_READY = 1,
    /// Power may not be switched on.
    IGH_CIA402_DRIVE_SWITCH_ON_DISABLED = 2,
    /// Power may be switched on.
    IGH_CIA402_DRIVE_READY_TO_SWITCH_ON = 3,
    /// Power is on, the motor is without torque.
    IGH_CIA402_DRIVE_SWITCHED_ON = 4,
    /// The motor follows its targets.
    IGH_CIA402_DRIVE_OPERATION_ENABLED = 5,
    /// A quick stop runs, or has ended with power on.
    IGH_CIA402_DRIVE_QUICK_STOP_ACTIVE = 6,
    /// A fault was found, its reaction runs.
    IGH_CIA402_DRIVE_FAULT_REACTION = 7,
    /// In fault, the motor is without torque.
    IGH_CIA402_DRIVE_FAULT = 8,
}

/// How a node begins its configuration, in igh_cia402_axis_t.reset.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_reset_t {
    /// It is told to go to Pre-operational.
    IGH_CIA402_RESET_NONE = 0,
    /// Its communication is reset: parameters of 0x1000.. as at power-on.
    IGH_CIA402_RESET_COMMUNICATION = 1,
    /// The whole node is reset.
    IGH_CIA402_RESET_NODE = 2,
}

/// How a position counter runs, in igh_cia402_axis_t.range.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_range_t {
    /// It ends at the limits of an int32_t; nothing is commanded beyond them.
    IGH_CIA402_RANGE_LINEAR = 0,
    /// It wraps over the whole int32_t.
    IGH_CIA402_RANGE_WRAPPING = 1,
    /// It wraps within 0x607B: one step beyond range_max is range_min.
    IGH_CIA402_RANGE_MODULO = 2,
}

/// What a drive does when the host's heartbeat stays away (0x6007), in igh_cia402_axis_t.host_loss.
/// A manufacturer may have further, negative ones.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_host_loss_t {
    /// Nothing.
    IGH_CIA402_HOST_LOSS_NONE = 0,
    /// It goes to fault.
    IGH_CIA402_HOST_LOSS_FAULT = 1,
    /// It switches its power off.
    IGH_CIA402_HOST_LOSS_DISABLE_VOLTAGE = 2,
    /// It makes a quick stop.
    IGH_CIA402_HOST_LOSS_QUICK_STOP = 3,
}

/// How a drive makes a quick stop (0x605A), in igh_cia402_axis_t.quick_stop. A manufacturer may
/// have further, negative ones.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_quick_stop_t {
    /// Switches its power off at once.
    IGH_CIA402_QUICK_STOP_DISABLE = 0,
    /// Slows down by its ramp, then switches off.
    IGH_CIA402_QUICK_STOP_SLOW_DOWN = 1,
    /// Slows down by its quick stop ramp, then switches off.
    IGH_CIA402_QUICK_STOP_RAMP = 2,
    /// Slows down at the current limit, then switches off.
    IGH_CIA402_QUICK_STOP_CURRENT_LIMIT = 3,
    /// Slows down at the voltage limit, then switches off.
    IGH_CIA402_QUICK_STOP_VOLTAGE_LIMIT = 4,
    /// Slows down by its ramp and stays at rest with power on.
    IGH_CIA402_QUICK_STOP_SLOW_DOWN_AND_STAY = 5,
    /// Slows down by its quick stop ramp and stays at rest with power on.
    IGH_CIA402_QUICK_STOP_RAMP_AND_STAY = 6,
    /// Slows down at the current limit and stays at rest with power on.
    IGH_CIA402_QUICK_STOP_CURRENT_LIMIT_AND_STAY = 7,
    /// Slows down at the voltage limit and stays at rest with power on.
    IGH_CIA402_QUICK_STOP_VOLTAGE_LIMIT_AND_STAY = 8,
}

/// A mode that C gives by its number.
pub(crate) fn mode(call: Call, number: c_int) -> Result<OperatingMode, ecan_result_t> {
    i8::try_from(number).ok().and_then(OperatingMode::from_raw).ok_or_else(|| {
        call.argument("mode", format_args!("{number} is no mode, see igh_cia402_mode_t"))
    })
}

/// An NMT command that C gives by its number.
pub(crate) fn nmt_command(call: Call, number: c_int) -> Result<NmtCommand, ecan_result_t> {
    u8::try_from(number).ok().and_then(NmtCommand::from_raw).ok_or_else(|| {
        call.argument("command", format_args!("{number} is no command, see igh_canopen_nmt_t"))
    })
}

/// A way to begin that C gives by its number.
pub(crate) fn node_reset(number: u8) -> Option<NodeReset> {
    Some(match number {
        0 => NodeReset::None,
        1 => NodeReset::Communication,
        2 => NodeReset::Node,
        _ => return None,
    })
}

/// The number of a drive's state.
pub(crate) fn drive_state(state: Option<DriveState>) -> u8 {
    use igh_cia402_drive_state_t::*;
    let number = match state {
        None => IGH_CIA402_DRIVE_UNKNOWN,
        Some(DriveState::NotReadyToSwitchOn) => IGH_CIA402_DRIVE_NOT_READY,
        Some(DriveState::SwitchOnDisabled) => IGH_CIA402_DRIVE_SWITCH_ON_DISABLED,
        Some(DriveState::ReadyToSwitchOn) => IGH_CIA402_DRIVE_READY_TO_SWITCH_ON,
        Some(DriveState::SwitchedOn) => IGH_CIA402_DRIVE_SWITCHED_ON,
        Some(DriveState::OperationEnabled) => IGH_CIA402_DRIVE_OPERATION_ENABLED,
        Some(DriveState::QuickStopActive) => IGH_CIA402_DRIVE_QUICK_STOP_ACTIVE,
        Some(DriveState::FaultReactionActive) => IGH_CIA402_DRIVE_FAULT_REACTION,
        Some(DriveState::Fault) => IGH_CIA402_DRIVE_FAULT,
    };
    number as u8
}

#[cfg(test)]
mod tests {
    use ecan_canopen::{NmtState, NodeLossReaction, QuickStopOption};

    use super::*;

    #[test]
    fn modes_have_the_numbers_of_0x6060() {
        use igh_cia402_mode_t::*;
        let modes = [
            (IGH_CIA402_MODE_PP, OperatingMode::ProfilePosition),
            (IGH_CIA402_MODE_PV, OperatingMode::ProfileVelocity),
            (IGH_CIA402_MODE_PT, OperatingMode::ProfileTorque),
            (IGH_CIA402_MODE_HM, OperatingMode::Homing),
            (IGH_CIA402_MODE_IP, OperatingMode::InterpolatedPosition),
            (IGH_CIA402_MODE_CSP, OperatingMode::CyclicPosition),
            (IGH_CIA402_MODE_CSV, OperatingMode::CyclicVelocity),
            (IGH_CIA402_MODE_CST, OperatingMode::CyclicTorque),
        ];
        assert_eq!(modes.map(|(_, mode)| mode), OperatingMode::ALL);
        assert!(modes.iter().all(|(c, mode)| *c as i8 == mode.raw()));
    }

    #[test]
    fn nmt_has_the_numbers_of_cia_301() {
        use igh_canopen_nmt_state_t::*;
        use igh_canopen_nmt_t::*;
        let commands = [
            (IGH_CANOPEN_NMT_START, NmtCommand::Start),
            (IGH_CANOPEN_NMT_STOP, NmtCommand::Stop),
            (IGH_CANOPEN_NMT_PRE_OPERATIONAL, NmtCommand::EnterPreOperational),
            (IGH_CANOPEN_NMT_RESET_NODE, NmtCommand::ResetNode),
            (IGH_CANOPEN_NMT_RESET_COMMUNICATION, NmtCommand::ResetCommunication),
        ];
        assert!(commands.iter().all(|(c, command)| *c as u8 == command.raw()));
        let states = [
            (IGH_CANOPEN_NMT_STATE_INITIALISING, NmtState::Initialising),
            (IGH_CANOPEN_NMT_STATE_STOPPED, NmtState::Stopped),
            (IGH_CANOPEN_NMT_STATE_OPERATIONAL, NmtState::Operational),
            (IGH_CANOPEN_NMT_STATE_PRE_OPERATIONAL, NmtState::PreOperational),
        ];
        assert!(states.iter().all(|(c, state)| *c as u8 == state.raw()));
    }

    #[test]
    fn option_codes_have_the_numbers_of_cia_402() {
        use igh_cia402_host_loss_t::*;
        use igh_cia402_quick_stop_t::*;
        let losses = [
            (IGH_CIA402_HOST_LOSS_NONE, NodeLossReaction::None),
            (IGH_CIA402_HOST_LOSS_FAULT, NodeLossReaction::Fault),
            (IGH_CIA402_HOST_LOSS_DISABLE_VOLTAGE, NodeLossReaction::DisableVoltage),
            (IGH_CIA402_HOST_LOSS_QUICK_STOP, NodeLossReaction::QuickStop),
        ];
        assert!(losses.iter().all(|(c, reaction)| *c as i16 == reaction.raw()));
        let stops = [
            (IGH_CIA402_QUICK_STOP_DISABLE, QuickStopOption::Disable),
            (IGH_CIA402_QUICK_STOP_SLOW_DOWN, QuickStopOption::SlowDown),
            (IGH_CIA402_QUICK_STOP_RAMP, QuickStopOption::QuickStop),
            (IGH_CIA402_QUICK_STOP_CURRENT_LIMIT, QuickStopOption::CurrentLimit),
            (IGH_CIA402_QUICK_STOP_VOLTAGE_LIMIT, QuickStopOption::VoltageLimit),
            (IGH_CIA402_QUICK_STOP_SLOW_DOWN_AND_STAY, QuickStopOption::SlowDownAndStay),
            (IGH_CIA402_QUICK_STOP_RAMP_AND_STAY, QuickStopOption::QuickStopAndStay),
            (IGH_CIA402_QUICK_STOP_CURRENT_LIMIT_AND_STAY, QuickStopOption::CurrentLimitAndStay),
            (IGH_CIA402_QUICK_STOP_VOLTAGE_LIMIT_AND_STAY, QuickStopOption::VoltageLimitAndStay),
        ];
        assert!(stops.iter().all(|(c, option)| *c as i16 == option.raw()));
    }

    #[test]
    fn resets_have_their_numbers() {
        use igh_cia402_reset_t::*;
        let resets = [
            (IGH_CIA402_RESET_NONE, NodeReset::None),
            (IGH_CIA402_RESET_COMMUNICATION, NodeReset::Communication),
            (IGH_CIA402_RESET_NODE, NodeReset::Node),
        ];
        assert!(resets.iter().all(|(c, reset)| node_reset(*c as u8) == Some(*reset)));
        assert_eq!(node_reset(3), None);
    }
}
