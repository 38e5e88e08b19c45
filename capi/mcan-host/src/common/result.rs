//! Return values

use std::ffi::{CStr, c_char, c_int};

macro_rules! results {
    ($($(#[$doc:meta])* $name:ident = $value:literal, $words:literal;)*) => {
        /// What functions return: 0, or one of these negative codes.
        ///
        /// ecan_last_error() tells the particulars: which slave, which object, what was expected.
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum ecan_result_t {
            $($(#[$doc])* $name = $value,)*
        }

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

const fn c_text(text: &'static str) -> &'static CStr {
    match CStr::from_bytes_with_nul(text.as_bytes()) {
        Ok(text) => text,
        Err(_) => c"",
    }
}

results! {
    /// Done.
    ECAN_OK = 0, "done";
    /// A pointer is NULL that must not be.
    ECAN_ERR_NULL = -1, "a pointer is NULL";
    /// A value is out of its range.
    ECAN_ERR_ARGUMENT = -2, "an argument is out of its range";
    /// The object was not initialised, is deinitialised, or was copied to another place.
    ECAN_ERR_NOT_INITIALISED = -3, "the object is not initialised";
    /// The call does not fit what was done before: wrong order.
    ECAN_ERR_ORDER = -4, "the call comes at the wrong time";
    /// Another thread, or a callback's caller, is inside this object.
    ECAN_ERR_BUSY = -5, "the object is in use by another call";
    /// The buffer is too small; what was needed is told where there is a place for it.
    ECAN_ERR_BUFFER = -6, "the buffer is too small";
    /// A table of the configuration is full.
    ECAN_ERR_FULL = -7, "the table is full";
    /// The configuration has faults; ecan_last_error() names every one.
    ECAN_ERR_CONFIG = -8, "the configuration has faults";
    /// No such slave is configured.
    ECAN_ERR_SLAVE = -9, "no such slave";
    /// The channel does not exist or is not enabled.
    ECAN_ERR_CHANNEL = -10, "no such channel, or it is not enabled";
    /// Not a CAN frame: identifier, length or flags.
    ECAN_ERR_FRAME = -11, "not a CAN frame";
    /// A CAN FD frame for a channel that is configured for classic CAN.
    ECAN_ERR_NOT_FD = -12, "the channel is configured for classic CAN";
    /// The frame cannot be scheduled: no Sync0, no such capability, or beyond the period.
    ECAN_ERR_SCHEDULE = -13, "the frame cannot be scheduled";
    /// The image of this cycle is full; send again in a later cycle.
    ECAN_ERR_NO_ROOM = -14, "the image of this cycle is full";
    /// The gateway's transmit queue is full; send again in a later cycle.
    ECAN_ERR_QUEUE_FULL = -15, "the gateway's transmit queue is full";
    /// The channel is bus-off.
    ECAN_ERR_BUS_OFF = -16, "the channel is bus-off";
    /// The gateway is not in service: not in OP, or not verified yet.
    ECAN_ERR_NOT_READY = -17, "the gateway is not in service";
    /// The image was being written while it was read; skip it in this cycle.
    ECAN_ERR_IMAGE_BUSY = -18, "the image was changing while it was read";
    /// The image, or the rest of it, cannot be parsed.
    ECAN_ERR_PARSE = -19, "the image cannot be parsed";
    /// The EtherCAT master library could not be had, or its setting is wrong.
    ECAN_ERR_ECRT = -20, "the EtherCAT master library could not be loaded";
    /// The EtherCAT master could not be opened, or a call of its library failed.
    ECAN_ERR_MASTER = -21, "the EtherCAT master refused";
    /// A configured slave is not on the bus.
    ECAN_ERR_NOT_FOUND = -22, "a configured slave is not on the bus";
    /// The slave is another one than configured, or no ECAN-Lite.
    ECAN_ERR_IDENTITY = -23, "the slave is not the configured one";
    /// An SDO transfer failed; ecan_last_abort_code() tells why the slave refused.
    ECAN_ERR_SDO = -24, "an SDO transfer failed";
    /// An object reads back something else than its configuration demands.
    ECAN_ERR_READBACK = -25, "an object reads back another value";
    /// What was waited for did not happen in time.
    ECAN_ERR_TIMEOUT = -26, "not done in time";
    /// A slave did not reach PREOP or OP.
    ECAN_ERR_NOT_OPERATIONAL = -27, "a slave does not reach its state";
    /// A gateway in OP was not taken into service: what it reads back is not what was configured.
    ECAN_ERR_VERIFICATION = -28, "a gateway failed verification";
    /// The master belongs to someone else: the call is its owner's business.
    ECAN_ERR_ATTACHED = -29, "the master belongs to another owner";
    /// No such axis.
    ECAN_ERR_AXIS = -30, "no such axis";
    /// The axis cannot do this now, or not at all.
    ECAN_ERR_AXIS_STATE = -31, "the axis cannot do this now";
    /// One or more axes are not where they are to be; ecan_last_error() names each.
    ECAN_ERR_AXES = -32, "not every axis got there";
    /// A CANopen transfer or command failed.
    ECAN_ERR_CANOPEN = -33, "a CANopen service failed";
    /// A fault of the library itself. Please report it with the text of ecan_last_error().
    ECAN_ERR_INTERNAL = -99, "internal fault of the library";
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
pub extern "C" fn ecan_result_words(code: c_int) -> *const c_char {
    ecan_result_t::of(code).map_or(c"unknown result", |result| result.names().1).as_ptr()
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
            let words = unsafe { CStr::from_ptr(ecan_result_words(result.code())) };
            assert_eq!(name.to_str().unwrap(), format!("{result:?}"));
            assert!(!words.is_empty());
            assert!(result.code() <= 0);
        }
        assert_eq!(ecan_result_name(7), c"unknown result".as_ptr());
    }
}
