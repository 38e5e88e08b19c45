//! Errors of the layers below as codes of C.

use std::fmt::Display;

use ecan_c_boundary::Call;
use ecan_c_boundary::result::ecan_result_t::{self, *};
use ecan_canopen::{
    LssFailure, LssFault, LssStartError, NetworkError, NmtError, SdoFailure, SdoFault, WaitError,
};
use ecan_cia402::{AxisFault, AxisFaults, AxisTimeout, Cia402Error, CommandError, ScheduleError};
use ecan_host::{CycleError, Errno, Error};
use ecan_lite::config::ConfigFileError;
use ecan_mcan_port::{AddressError, Backpressure, PortError, SendError};
use ecan_service::server::ServiceError;

/// An error of the layers below, as C sees it.
pub(crate) trait Coded: Display {
    /// The code, and the abort code of an SDO transfer.
    fn code_of_c(&self) -> (ecan_result_t, u32);
}

/// Results with an error of the layers below.
pub(crate) trait OrCode<T> {
    /// Notes the error of this call and returns its code.
    fn or_code(self, call: Call) -> Result<T, ecan_result_t>;
}

impl<T, E: Coded> OrCode<T> for Result<T, E> {
    #[inline]
    fn or_code(self, call: Call) -> Result<T, ecan_result_t> {
        self.map_err(|error| note(call, &error))
    }
}

#[cold]
pub(crate) fn note(call: Call, error: &dyn Coded) -> ecan_result_t {
    let (code, abort_code) = error.code_of_c();
    call.fail_transfer(code, format_args!("{error}"), abort_code)
}

impl Coded for ecan_lite::Error {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        match self {
            #[cfg(feature = "sim")]
            Self::Open(error) if error.is_scenario() => (ECAN_ERR_FILE, 0),
            _ => (ECAN_ERR_ECRT, 0),
        }
    }
}

impl Coded for ConfigFileError {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        match self {
            Self::Read { .. } => (ECAN_ERR_FILE, 0),
            Self::Faults { .. } => (ECAN_ERR_CONFIG, 0),
        }
    }
}

impl Coded for ServiceError {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        (ECAN_ERR_FILE, 0)
    }
}

impl Coded for CycleError {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        let code = match self {
            Self::NotActive { .. } => ECAN_ERR_ORDER,
            // A value whose length differs from that of the request.
            Self::Library { errno: Errno::EMSGSIZE, .. } => ECAN_ERR_BUFFER,
            _ => ECAN_ERR_MASTER,
        };
        (code, 0)
    }
}

/// Code of a failed cycle, in calls that have no request.
fn cycle_code(error: &CycleError) -> ecan_result_t {
    match error {
        CycleError::NotActive { .. } => ECAN_ERR_ORDER,
        _ => ECAN_ERR_MASTER,
    }
}

impl Coded for Error {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        let code = match self {
            Self::Config(_) | Self::OtherMaster { .. } => ECAN_ERR_CONFIG,
            Self::NoLink | Self::NoSlaves | Self::NoSuchSlave { .. } | Self::SameSlave { .. } => {
                ECAN_ERR_NOT_FOUND
            }
            Self::OwnedMaster | Self::NotAttached { .. } | Self::Phase { .. } => ECAN_ERR_ORDER,
            Self::IdentityMismatch { .. }
            | Self::NotAnEcanLite { .. }
            | Self::Unrecognised { .. }
            | Self::Mapping { .. }
            | Self::MappingCount { .. } => ECAN_ERR_IDENTITY,
            Self::Sdo { abort_code: None, errno: Errno::EOVERFLOW, .. } => ECAN_ERR_BUFFER,
            Self::Sdo { abort_code, .. } => {
                return (ECAN_ERR_SDO, abort_code.map_or(0, |code| code.0));
            }
            Self::Readback { .. } => ECAN_ERR_READBACK,
            Self::NotInPreop { .. } => ECAN_ERR_NOT_OPERATIONAL,
            Self::NotOperational(report) => {
                let cause = report.slaves.iter().find_map(|slave| slave.cause.as_deref());
                return (ECAN_ERR_NOT_OPERATIONAL, cause.map_or(0, |cause| cause.code_of_c().1));
            }
            Self::Attached { .. } => ECAN_ERR_ATTACHED,
            Self::Stopped => ECAN_ERR_STOPPED,
            Self::Thread { .. } => ECAN_ERR_PRIVILEGE,
            Self::SlaveIndex { .. } => ECAN_ERR_SLAVE,
            Self::Cycle(error) => cycle_code(error),
            _ => ECAN_ERR_MASTER,
        };
        (code, 0)
    }
}

impl Coded for PortError {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        match self {
            Self::Config(_) => (ECAN_ERR_CONFIG, 0),
            Self::Adapter(error) => error.code_of_c(),
            Self::Cycle(error) => (cycle_code(error), 0),
            Self::NotReady { .. } => (ECAN_ERR_VERIFICATION, 0),
            Self::Address(error) => error.code_of_c(),
            _ => (ECAN_ERR_INTERNAL, 0),
        }
    }
}

impl Coded for AddressError {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        match self {
            Self::Slave { .. } => (ECAN_ERR_SLAVE, 0),
            _ => (ECAN_ERR_CHANNEL, 0),
        }
    }
}

impl Coded for SendError {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        let code = match self {
            Self::Backpressure {
                what: Backpressure::Image | Backpressure::Share | Backpressure::Phase,
                ..
            } => ECAN_ERR_NO_ROOM,
            Self::BeyondShare { .. } => ECAN_ERR_CONFIG,
            Self::Backpressure { what: Backpressure::Queue, .. } => ECAN_ERR_QUEUE_FULL,
            Self::Backpressure { what: Backpressure::BusOff, .. } => ECAN_ERR_BUS_OFF,
            Self::NotReady { .. } => ECAN_ERR_NOT_READY,
            Self::Address(error) => return error.code_of_c(),
            Self::ReceiveOnly { .. } => ECAN_ERR_CHANNEL,
            Self::NotFd { .. } => ECAN_ERR_NOT_FD,
            Self::NotSchedulable { .. } => ECAN_ERR_SCHEDULE,
            Self::Frame(_) => ECAN_ERR_FRAME,
            _ => ECAN_ERR_INTERNAL,
        };
        (code, 0)
    }
}

impl Coded for CommandError {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        match self {
            Self::NoSuchAxis { .. } => (ECAN_ERR_AXIS, 0),
            Self::Unit { .. } => (ECAN_ERR_ARGUMENT, 0),
            Self::TargetPeriod { .. } => (ECAN_ERR_CONFIG, 0),
            _ => (ECAN_ERR_AXIS_STATE, 0),
        }
    }
}

impl Coded for ScheduleError {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        match self {
            Self::NotSchedulable { .. } => (ECAN_ERR_SCHEDULE, 0),
            Self::Active { .. } => (ECAN_ERR_AXIS_STATE, 0),
            _ => (ECAN_ERR_ARGUMENT, 0),
        }
    }
}

impl Coded for NmtError {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        (ECAN_ERR_CANOPEN, 0)
    }
}

impl Coded for WaitError {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        match self {
            Self::Sdo(SdoFailure { fault, .. }) => match fault {
                SdoFault::Aborted(code) | SdoFault::Violated(code) => (ECAN_ERR_SDO, code.0),
                SdoFault::TimedOut { .. } => (ECAN_ERR_TIMEOUT, 0),
                SdoFault::TooLong { .. } => (ECAN_ERR_BUFFER, 0),
                SdoFault::GatewayLost => (ECAN_ERR_NOT_READY, 0),
                SdoFault::Rejected(error) => error.code_of_c(),
                _ => (ECAN_ERR_CANOPEN, 0),
            },
            Self::Lss(failure) => failure.code_of_c(),
            Self::LssStart(error) => error.code_of_c(),
            Self::TimedOut { .. } => (ECAN_ERR_TIMEOUT, 0),
            Self::Stopped => (ECAN_ERR_STOPPED, 0),
            Self::Cycle(error) => (cycle_code(error), 0),
            _ => (ECAN_ERR_CANOPEN, 0),
        }
    }
}

impl Coded for LssFailure {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        match self.fault {
            LssFault::TimedOut { .. } | LssFault::NotSelected { .. } => (ECAN_ERR_TIMEOUT, 0),
            LssFault::GatewayLost => (ECAN_ERR_NOT_READY, 0),
            LssFault::Rejected(error) => error.code_of_c(),
            _ => (ECAN_ERR_CANOPEN, 0),
        }
    }
}

impl Coded for LssStartError {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        match self {
            Self::Busy { .. } => (ECAN_ERR_ORDER, 0),
            Self::UnknownChannel { .. } => (ECAN_ERR_CHANNEL, 0),
        }
    }
}

impl Coded for NetworkError {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        match self {
            Self::Channel { .. } | Self::NoChannel { .. } => (ECAN_ERR_CHANNEL, 0),
            Self::Guarding { .. } | Self::TimeReference { .. } => (ECAN_ERR_ARGUMENT, 0),
            _ => (ECAN_ERR_CONFIG, 0),
        }
    }
}

impl Coded for Cia402Error {
    fn code_of_c(&self) -> (ecan_result_t, u32) {
        match self {
            Self::Command(error) => error.code_of_c(),
            Self::Nmt(error) => error.code_of_c(),
            // The text names the axes, too.
            Self::AxisTimeout(AxisTimeout {
                cycle_error: Some(error @ CycleError::NotActive { .. }),
                ..
            }) => error.code_of_c(),
            Self::AxisTimeout(_) => (ECAN_ERR_AXES, 0),
            Self::BootTimeout(_) => (ECAN_ERR_BOOT, 0),
            Self::Wait(error) => error.code_of_c(),
            Self::Axes(AxisFaults { faults }) => (faults_code(faults), 0),
            _ => (ECAN_ERR_CONFIG, 0),
        }
    }
}

/// Code of the faults of an axis table: one for slaves and channels that the Port does not have.
fn faults_code(faults: &[(usize, AxisFault)]) -> ecan_result_t {
    let has_only = |is_such: fn(&AxisFault) -> bool| faults.iter().all(|(_, fault)| is_such(fault));
    if has_only(|fault| matches!(fault, AxisFault::NoSuchSlave { .. })) {
        ECAN_ERR_SLAVE
    } else if has_only(|fault| matches!(fault, AxisFault::ChannelNotEnabled { .. })) {
        ECAN_ERR_CHANNEL
    } else {
        ECAN_ERR_CONFIG
    }
}

/// Returns false if a reconfiguration ended with this error before it changed anything.
pub(crate) fn has_changed(error: &Error) -> bool {
    !matches!(error, Error::Config(_) | Error::OtherMaster { .. } | Error::Attached { .. })
}

/// As [`has_changed`], of a Port.
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

/// A call that runs the cycle, on a master of another owner.
#[cold]
pub(crate) fn reject_attached(call: Call) -> ecan_result_t {
    let text = format_args!(
        "this context is attached to its owner's master: run the cycle around ecan_igh_receive and \
         ecan_igh_send, and poll"
    );
    call.fail(ECAN_ERR_ATTACHED, text)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use ecan_canopen::LssCommand;
    use ecan_host::Phase;

    use super::*;

    fn code(error: &dyn Coded) -> ecan_result_t {
        error.code_of_c().0
    }

    #[test]
    fn error_of_a_lower_layer_keeps_its_code() {
        let not_active = || CycleError::NotActive { is: Phase::Configured };
        assert_eq!(code(&Error::Cycle(not_active())), ECAN_ERR_ORDER);
        assert_eq!(code(&PortError::Adapter(Error::NoSlaves)), ECAN_ERR_NOT_FOUND);
        assert_eq!(code(&PortError::Cycle(not_active())), ECAN_ERR_ORDER);
        let not_in_preop = Error::NotInPreop {
            slave: 0,
            al_state: 1,
            error_flag: false,
            timeout: Duration::from_secs(10),
        };
        assert_eq!(code(&not_in_preop), ECAN_ERR_NOT_OPERATIONAL);
        let channel = SendError::NotFd { slave: 0, channel: 1 };
        let expected = code(&channel);
        let fault = LssFault::Rejected(channel);
        let command = LssCommand::SwitchGlobal { configuration: true };
        let rejected = LssFailure { slave: 0, channel: 1, command, fault };
        assert!(expected != ECAN_ERR_CANOPEN && code(&rejected) == expected, "{expected:?}");
    }

    #[test]
    fn axes_that_did_not_get_there_have_a_code_of_their_own() {
        let timeout = |cycle_error| AxisTimeout {
            what: "configured",
            waited: Duration::ZERO,
            axes: Vec::new(),
            cycle_error,
        };
        let code_of = |cycle_error| code(&Cia402Error::AxisTimeout(timeout(cycle_error)));
        assert_eq!(code_of(None), ECAN_ERR_AXES);
        assert_eq!(code_of(Some(CycleError::NotActive { is: Phase::Configured })), ECAN_ERR_ORDER);
    }
}
