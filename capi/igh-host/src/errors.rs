//! Errors of the layers below as codes of C.

use std::fmt::Display;

use ecan_canopen::{NmtError, SdoFailure, SdoFault, WaitError};
use ecan_cia402::{Cia402Error, CommandError, ScheduleError};
use ecan_config_file::ConfigFileError;
use ecan_host::{CycleError, Errno, Error};
use ecan_mcan_host::boundary::Call;
use ecan_mcan_host::common::last_error;
use ecan_mcan_host::common::result::ecan_result_t::{self, *};
use ecan_mcan_port::{AddressError, Backpressure, PortError, SendError};

/// Notes an error in words and gives its code.
#[cold]
fn note(call: Call, code: ecan_result_t, error: &dyn Display, abort_code: u32) -> ecan_result_t {
    last_error::note_with_abort_code(call.function(), code, format_args!("{error}"), abort_code);
    code
}

#[cold]
pub(crate) fn config_file(call: Call, error: &ConfigFileError) -> ecan_result_t {
    let code = match error {
        ConfigFileError::Read { .. } => ECAN_ERR_FILE,
        ConfigFileError::Faults { .. } => ECAN_ERR_CONFIG,
    };
    note(call, code, error, 0)
}

#[cold]
pub(crate) fn cycle(call: Call, error: &CycleError) -> ecan_result_t {
    let code = match error {
        CycleError::NotActive { .. } => ECAN_ERR_ORDER,
        // A value of another length than the request's.
        CycleError::Library { errno: Errno::EMSGSIZE, .. } => ECAN_ERR_BUFFER,
        _ => ECAN_ERR_MASTER,
    };
    note(call, code, error, 0)
}

#[cold]
pub(crate) fn adapter(call: Call, error: &Error) -> ecan_result_t {
    let (code, abort_code) = adapter_code(error);
    note(call, code, error, abort_code)
}

fn adapter_code(error: &Error) -> (ecan_result_t, u32) {
    let code = match error {
        Error::Config(_) => ECAN_ERR_CONFIG,
        Error::NoSuchSlave { .. } | Error::SameSlave { .. } => ECAN_ERR_NOT_FOUND,
        Error::OwnedMaster | Error::NotAttached { .. } | Error::Phase { .. } => ECAN_ERR_ORDER,
        Error::OtherMaster { .. } => ECAN_ERR_CONFIG,
        Error::WrongIdentity { .. }
        | Error::NotAnEcanLite { .. }
        | Error::Unrecognised { .. }
        | Error::Mapping { .. }
        | Error::MappingCount { .. } => ECAN_ERR_IDENTITY,
        Error::Sdo { abort_code: None, errno: Errno::EOVERFLOW, .. } => ECAN_ERR_BUFFER,
        Error::Sdo { abort_code, .. } => {
            return (ECAN_ERR_SDO, abort_code.map_or(0, |code| code.0));
        }
        Error::Readback { .. } => ECAN_ERR_READBACK,
        Error::NotInPreop { .. } | Error::NotOperational(_) => ECAN_ERR_NOT_OPERATIONAL,
        Error::Attached { .. } => ECAN_ERR_ATTACHED,
        Error::Stopped => ECAN_ERR_STOPPED,
        Error::SlaveIndex { .. } => ECAN_ERR_SLAVE,
        Error::Cycle(CycleError::NotActive { .. }) => ECAN_ERR_ORDER,
        _ => ECAN_ERR_MASTER,
    };
    (code, 0)
}

/// Whether a reconfiguration that ended with an error has touched anything.
pub(crate) fn has_changed(error: &Error) -> bool {
    !matches!(error, Error::Config(_) | Error::OtherMaster { .. } | Error::Attached { .. })
}

/// As [`has_changed`].
pub(crate) fn port_has_changed(error: &PortError) -> bool {
    match error {
        PortError::Config(_) => false,
        PortError::Adapter(error) => has_changed(error),
        _ => true,
    }
}

/// A slave index that is not configured.
#[cold]
pub(crate) fn no_slave(call: Call, slave: usize, count: usize) -> ecan_result_t {
    let text = format_args!("slave index {slave} is out of range: {count} slave(s) are configured");
    call.fail(ECAN_ERR_SLAVE, text)
}

/// A call that runs the cycle itself, on a master of another owner.
#[cold]
pub(crate) fn attached(call: Call) -> ecan_result_t {
    let words = "this context is attached to its owner's master: run the cycle around \
                 ecan_igh_receive and ecan_igh_send, and poll";
    note(call, ECAN_ERR_ATTACHED, &words, 0)
}

#[cold]
pub(crate) fn port(call: Call, error: &PortError) -> ecan_result_t {
    let (code, abort_code) = match error {
        PortError::Config(_) => (ECAN_ERR_CONFIG, 0),
        PortError::Adapter(error) => adapter_code(error),
        PortError::Cycle(CycleError::NotActive { .. }) => (ECAN_ERR_ORDER, 0),
        PortError::Cycle(_) => (ECAN_ERR_MASTER, 0),
        PortError::NotReady { .. } => (ECAN_ERR_VERIFICATION, 0),
        PortError::Address(error) => (address_code(error), 0),
        _ => (ECAN_ERR_INTERNAL, 0),
    };
    note(call, code, error, abort_code)
}

#[cold]
pub(crate) fn address(call: Call, error: &AddressError) -> ecan_result_t {
    note(call, address_code(error), error, 0)
}

fn address_code(error: &AddressError) -> ecan_result_t {
    match error {
        AddressError::Slave { .. } => ECAN_ERR_SLAVE,
        _ => ECAN_ERR_CHANNEL,
    }
}

#[cold]
pub(crate) fn send(call: Call, error: &SendError) -> ecan_result_t {
    note(call, send_code(error), error, 0)
}

fn send_code(error: &SendError) -> ecan_result_t {
    match error {
        SendError::Backpressure { what: Backpressure::Image, .. } => ECAN_ERR_NO_ROOM,
        SendError::Backpressure { what: Backpressure::Queue, .. } => ECAN_ERR_QUEUE_FULL,
        SendError::Backpressure { what: Backpressure::Phase, .. } => ECAN_ERR_NO_ROOM,
        SendError::Backpressure { what: Backpressure::BusOff, .. } => ECAN_ERR_BUS_OFF,
        SendError::NotReady { .. } => ECAN_ERR_NOT_READY,
        SendError::Address(error) => address_code(error),
        SendError::NotFd { .. } => ECAN_ERR_NOT_FD,
        SendError::NotSchedulable { .. } => ECAN_ERR_SCHEDULE,
        SendError::Frame(_) => ECAN_ERR_FRAME,
        _ => ECAN_ERR_INTERNAL,
    }
}

#[cold]
pub(crate) fn command(call: Call, error: &CommandError) -> ecan_result_t {
    note(call, command_code(error), error, 0)
}

fn command_code(error: &CommandError) -> ecan_result_t {
    match error {
        CommandError::NoSuchAxis { .. } => ECAN_ERR_AXIS,
        CommandError::Unit { .. } => ECAN_ERR_ARGUMENT,
        _ => ECAN_ERR_AXIS_STATE,
    }
}

#[cold]
pub(crate) fn schedule(call: Call, error: &ScheduleError) -> ecan_result_t {
    let code = match error {
        ScheduleError::NotSchedulable { .. } => ECAN_ERR_SCHEDULE,
        ScheduleError::TakenUp { .. } => ECAN_ERR_AXIS_STATE,
        _ => ECAN_ERR_ARGUMENT,
    };
    note(call, code, error, 0)
}

#[cold]
pub(crate) fn nmt(call: Call, error: &NmtError) -> ecan_result_t {
    note(call, ECAN_ERR_CANOPEN, error, 0)
}

#[cold]
pub(crate) fn wait(call: Call, error: &WaitError) -> ecan_result_t {
    let (code, abort_code) = wait_code(error);
    note(call, code, error, abort_code)
}

fn wait_code(error: &WaitError) -> (ecan_result_t, u32) {
    match error {
        WaitError::Sdo(SdoFailure { fault, .. }) => match fault {
            SdoFault::Aborted(code) | SdoFault::Violated(code) => (ECAN_ERR_SDO, code.0),
            SdoFault::TimedOut { .. } => (ECAN_ERR_TIMEOUT, 0),
            SdoFault::TooLong { .. } => (ECAN_ERR_BUFFER, 0),
            SdoFault::GatewayLost => (ECAN_ERR_NOT_READY, 0),
            SdoFault::Refused(error) => (send_code(error), 0),
            _ => (ECAN_ERR_CANOPEN, 0),
        },
        WaitError::TimedOut { .. } => (ECAN_ERR_TIMEOUT, 0),
        WaitError::Stopped => (ECAN_ERR_STOPPED, 0),
        WaitError::Cycle(CycleError::NotActive { .. }) => (ECAN_ERR_ORDER, 0),
        WaitError::Cycle(_) => (ECAN_ERR_MASTER, 0),
        _ => (ECAN_ERR_CANOPEN, 0),
    }
}

#[cold]
pub(crate) fn cia402(call: Call, error: &Cia402Error) -> ecan_result_t {
    let (code, abort_code) = match error {
        Cia402Error::Command(error) => (command_code(error), 0),
        Cia402Error::Nmt(_) => (ECAN_ERR_CANOPEN, 0),
        Cia402Error::AxisTimeout(_) => (ECAN_ERR_AXES, 0),
        Cia402Error::Wait(error) => wait_code(error),
        Cia402Error::NoSuchSlave { .. } => (ECAN_ERR_SLAVE, 0),
        Cia402Error::ChannelNotEnabled { .. } => (ECAN_ERR_CHANNEL, 0),
        _ => (ECAN_ERR_CONFIG, 0),
    };
    note(call, code, error, abort_code)
}
