//! Return values

use std::ffi::{CStr, c_char, c_int};

/// What functions return: 0, or one of these negative codes.
///
/// ecan_last_error() tells the particulars: which slave, which object, what was expected.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ecan_result_t {
    /// Done.
    ECAN_OK = 0,
    /// A pointer is NULL that must not be.
    ECAN_ERR_NULL = -1,
    /// A value is out of its range.
    ECAN_ERR_ARGUMENT = -2,
    /// The object was not initialised, is deinitialised, or was copied to another place.
    ECAN_ERR_NOT_INITIALISED = -3,
    /// The call does not fit what was done before: wrong order.
    ECAN_ERR_ORDER = -4,
    /// Another thread, or a callback's caller, is inside this object.
    ECAN_ERR_BUSY = -5,
    /// The buffer is too small; what was needed is told where there is a place for it.
    ECAN_ERR_BUFFER = -6,
    /// A table of the configuration is full.
    ECAN_ERR_FULL = -7,
    /// The configuration has faults; ecan_last_error() names every one.
    ECAN_ERR_CONFIG = -8,
    /// No such slave is configured.
    ECAN_ERR_SLAVE = -9,
    /// The channel does not exist or is not enabled.
    ECAN_ERR_CHANNEL = -10,
    /// Not a CAN frame: identifier, length or flags.
    ECAN_ERR_FRAME = -11,
    /// A CAN FD frame for a channel that is configured for classic CAN.
    ECAN_ERR_NOT_FD = -12,
    /// The frame cannot be scheduled: no Sync0, no such capability, or beyond the period.
    ECAN_ERR_SCHEDULE = -13,
    /// The image of this cycle is full; send again in a later cycle.
    ECAN_ERR_NO_ROOM = -14,
    /// The gateway's transmit queue is full; send again in a later cycle.
    ECAN_ERR_QUEUE_FULL = -15,
    /// The channel is bus-off.
    ECAN_ERR_BUS_OFF = -16,
    /// The gateway is not in service: not in OP, or not verified yet.
    ECAN_ERR_NOT_READY = -17,
    /// The image was being written while it was read; skip it in this cycle.
    ECAN_ERR_IMAGE_BUSY = -18,
    /// The image, or the rest of it, cannot be parsed.
    ECAN_ERR_PARSE = -19,
    /// The EtherCAT master library could not be had, or its setting is wrong.
    ECAN_ERR_ECRT = -20,
    /// The EtherCAT master could not be opened, or a call of its library failed.
    ECAN_ERR_MASTER = -21,
    /// A configured slave is not on the bus.
    ECAN_ERR_NOT_FOUND = -22,
    /// The slave is another one than configured, or no ECAN-Lite.
    ECAN_ERR_IDENTITY = -23,
    /// An SDO transfer failed; ecan_last_abort_code() tells why the slave refused.
    ECAN_ERR_SDO = -24,
    /// An object reads back something else than its configuration demands.
    ECAN_ERR_READBACK = -25,
    /// What was waited for did not happen in time.
    ECAN_ERR_TIMEOUT = -26,
    /// A slave did not reach PREOP or OP.
    ECAN_ERR_NOT_OPERATIONAL = -27,
    /// A gateway in OP was not taken into service: what it reads back is not what was configured.
    ECAN_ERR_VERIFICATION = -28,
    /// The master belongs to someone else: the call is its owner's business.
    ECAN_ERR_ATTACHED = -29,
    /// No such axis.
    ECAN_ERR_AXIS = -30,
    /// The axis cannot do this now, or not at all.
    ECAN_ERR_AXIS_STATE = -31,
    /// One or more axes are not where they are to be; ecan_last_error() names each.
    ECAN_ERR_AXES = -32,
    /// A CANopen transfer or command failed.
    ECAN_ERR_CANOPEN = -33,
    /// The application gave up waiting (ecan_igh_stop_waiting_when()).
    ECAN_ERR_STOPPED = -34,
    /// The system does not grant what a real-time thread needs; ecan_last_error() says why and what
    /// to do.
    ECAN_ERR_PRIVILEGE = -35,
    /// A file cannot be read; ecan_last_error() says which and why.
    ECAN_ERR_FILE = -36,
    /// A fault of the library itself. Please report it with the text of ecan_last_error().
    ECAN_ERR_INTERNAL = -99,
}

const fn c_text(text: &'static str) -> &'static CStr {
    match CStr::from_bytes_with_nul(text.as_bytes()) {
        Ok(text) => text,
        Err(_) => c"",
    }
}

macro_rules! results {
    ($($name:ident: $words:literal,)*) => {
        impl ecan_result_t {
            /// All codes.
            pub const ALL: &[Self] = &[$(Self::$name,)*];

            const fn names(self) -> (&'static CStr, &'static CStr) {
                match self {
                    $(Self::$name => (
                        c_text(concat!(stringify!($name), "\0")),
                        c_text(concat!($words, "\0")),
                    ),)*
                }
            }
        }
    };
}

results! {
    ECAN_OK: "done",
    ECAN_ERR_NULL: "a pointer is NULL",
    ECAN_ERR_ARGUMENT: "an argument is out of its range",
    ECAN_ERR_NOT_INITIALISED: "the object is not initialised",
    ECAN_ERR_ORDER: "the call comes at the wrong time",
    ECAN_ERR_BUSY: "the object is in use by another call",
    ECAN_ERR_BUFFER: "the buffer is too small",
    ECAN_ERR_FULL: "the table is full",
    ECAN_ERR_CONFIG: "the configuration has faults",
    ECAN_ERR_SLAVE: "no such slave",
    ECAN_ERR_CHANNEL: "no such channel, or it is not enabled",
    ECAN_ERR_FRAME: "not a CAN frame",
    ECAN_ERR_NOT_FD: "the channel is configured for classic CAN",
    ECAN_ERR_SCHEDULE: "the frame cannot be scheduled",
    ECAN_ERR_NO_ROOM: "the image of this cycle is full",
    ECAN_ERR_QUEUE_FULL: "the gateway's transmit queue is full",
    ECAN_ERR_BUS_OFF: "the channel is bus-off",
    ECAN_ERR_NOT_READY: "the gateway is not in service",
    ECAN_ERR_IMAGE_BUSY: "the image was changing while it was read",
    ECAN_ERR_PARSE: "the image cannot be parsed",
    ECAN_ERR_ECRT: "the EtherCAT master library could not be loaded",
    ECAN_ERR_MASTER: "the EtherCAT master refused",
    ECAN_ERR_NOT_FOUND: "a configured slave is not on the bus",
    ECAN_ERR_IDENTITY: "the slave is not the configured one",
    ECAN_ERR_SDO: "an SDO transfer failed",
    ECAN_ERR_READBACK: "an object reads back another value",
    ECAN_ERR_TIMEOUT: "not done in time",
    ECAN_ERR_NOT_OPERATIONAL: "a slave does not reach its state",
    ECAN_ERR_VERIFICATION: "a gateway failed verification",
    ECAN_ERR_ATTACHED: "the master belongs to another owner",
    ECAN_ERR_AXIS: "no such axis",
    ECAN_ERR_AXIS_STATE: "the axis cannot do this now",
    ECAN_ERR_AXES: "not every axis got there",
    ECAN_ERR_CANOPEN: "a CANopen service failed",
    ECAN_ERR_STOPPED: "the application gave up waiting",
    ECAN_ERR_PRIVILEGE: "the system does not grant a privilege",
    ECAN_ERR_FILE: "a file cannot be read",
    ECAN_ERR_INTERNAL: "internal fault of the library",
}

impl ecan_result_t {
    /// The value that C sees.
    pub const fn code(self) -> c_int {
        self as c_int
    }

    fn of(code: c_int) -> Option<Self> {
        Self::ALL.iter().copied().find(|result| result.code() == code)
    }
}

/// The name of a code, as it is written in this header.
///
/// @usage   rt, any thread, any time
/// @return  "ECAN_ERR_SDO" for example; "unknown result" for a value that is no code. Static.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_result_name(code: c_int) -> *const c_char {
    ecan_result_t::of(code).map_or(c"unknown result", |result| result.names().0).as_ptr()
}

/// What a code means, in a few words.
///
/// @usage   rt, any thread, any time
/// @return  "the EtherCAT master refused" for example. Static.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_result_text(code: c_int) -> *const c_char {
    ecan_result_t::of(code).map_or(c"unknown result", |result| result.names().1).as_ptr()
}

/// Whether a frame that was refused with a code may be sent again in a later cycle: no room, the
/// queue full, bus-off, or the gateway not in service.
///
/// @usage   rt, any thread, any time
/// @return  1 or 0.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_result_is_temporary(code: c_int) -> c_int {
    use ecan_result_t::*;
    let temporary = [ECAN_ERR_NO_ROOM, ECAN_ERR_QUEUE_FULL, ECAN_ERR_BUS_OFF, ECAN_ERR_NOT_READY];
    temporary.iter().any(|result| result.code() == code).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_has_its_name_and_words() {
        for result in ecan_result_t::ALL {
            // SAFETY: both functions return static C strings.
            let name = unsafe { CStr::from_ptr(ecan_result_name(result.code())) };
            // SAFETY: as above.
            let words = unsafe { CStr::from_ptr(ecan_result_text(result.code())) };
            assert_eq!(name.to_str().unwrap(), format!("{result:?}"));
            assert!(!words.is_empty());
            assert!(result.code() <= 0);
        }
        assert_eq!(ecan_result_name(7), c"unknown result".as_ptr());
    }
}
