//! Return values and constants of all C functions, and the pointers through which they return results.

use std::ffi::{CStr, c_int};
use std::ptr::NonNull;

use Meaning::{Lasting, Temporary};

use crate::mirror;

// Section: Return values

mirror! {
    /// Return value of the functions: 0, or one of these negative codes.
    ///
    /// ecan_last_error() gives the details: the slave, the object, the expected value.
    pub enum ecan_result_t as Meaning {
        /// Done.
        ECAN_OK = 0 => Lasting(c"done"),
        /// A pointer that must not be NULL is NULL.
        ECAN_ERR_NULL = -1 => Lasting(c"a pointer is NULL"),
        /// A value is out of range.
        ECAN_ERR_ARGUMENT = -2 => Lasting(c"an argument is out of range"),
        /// The object is not initialised, is deinitialised, or was moved or copied.
        ECAN_ERR_NOT_INITIALISED = -3 => Lasting(c"the object is not initialised"),
        /// The call does not fit the calls before it: wrong order.
        ECAN_ERR_ORDER = -4 => Lasting(c"the call is not allowed in this state"),
        /// Another thread, or the caller of a callback, uses this object.
        ECAN_ERR_BUSY = -5 => Lasting(c"the object is in use by another call"),
        /// The buffer is too small; the necessary size is returned if the function has a parameter
        /// for it. A text is cut, and is valid.
        ECAN_ERR_BUFFER = -6 => Lasting(c"the buffer is too small"),
        /// A list of the configuration is full.
        ECAN_ERR_FULL = -7 => Lasting(c"a list is full"),
        /// The configuration has faults; ecan_last_error() names every one.
        ECAN_ERR_CONFIG = -8 => Lasting(c"the configuration has faults"),
        /// The slave is not configured.
        ECAN_ERR_SLAVE = -9 => Lasting(c"the slave is not configured"),
        /// The channel does not exist or is not enabled.
        ECAN_ERR_CHANNEL = -10 => Lasting(c"the channel does not exist or is not enabled"),
        /// Not a CAN frame: CAN ID, length or flags.
        ECAN_ERR_FRAME = -11 => Lasting(c"not a CAN frame"),
        /// A CAN FD frame for a channel that is configured for classic CAN.
        ECAN_ERR_NOT_FD = -12 => Lasting(c"the channel is configured for classic CAN"),
        /// The frame cannot be scheduled: no Sync0, no such capability, or beyond the period.
        ECAN_ERR_SCHEDULE = -13 => Lasting(c"the frame cannot be scheduled"),
        /// The image of this cycle is full; send again in a later cycle.
        ECAN_ERR_NO_ROOM = -14 => Temporary(c"the image of this cycle is full"),
        /// The gateway's transmit queue is full; send again in a later cycle.
        ECAN_ERR_QUEUE_FULL = -15 => Temporary(c"the gateway's transmit queue is full"),
        /// The channel is bus-off.
        ECAN_ERR_BUS_OFF = -16 => Temporary(c"the channel is bus-off"),
        /// The gateway is not ready: not in OP, or not verified yet.
        ECAN_ERR_NOT_READY = -17 => Temporary(c"the gateway is not ready"),
        /// The image was being written while it was read; skip it in this cycle.
        ECAN_ERR_IMAGE_BUSY = -18 => Lasting(c"the image changed while it was read"),
        /// The image, or the rest of it, cannot be parsed.
        ECAN_ERR_PARSE = -19 => Lasting(c"the image cannot be parsed"),
        /// The EtherCAT master library cannot be loaded, or its setting is wrong.
        ECAN_ERR_ECRT = -20 => Lasting(c"the EtherCAT master library cannot be loaded"),
        /// The EtherCAT master cannot be opened, or a call of its library failed.
        ECAN_ERR_MASTER = -21 => Lasting(c"a call of the EtherCAT master failed"),
        /// A configured slave is not on the bus.
        ECAN_ERR_NOT_FOUND = -22 => Lasting(c"a configured slave is not on the bus"),
        /// The slave is not the configured one, or not an ECAN-Lite.
        ECAN_ERR_IDENTITY = -23 => Lasting(c"the slave is not the configured one"),
        /// An SDO transfer failed; ecan_last_abort_code() is the slave's reason.
        ECAN_ERR_SDO = -24 => Lasting(c"an SDO transfer failed"),
        /// The readback of an object differs from its configuration.
        ECAN_ERR_READBACK = -25 => Lasting(c"the readback of an object differs"),
        /// A timeout expired.
        ECAN_ERR_TIMEOUT = -26 => Lasting(c"a timeout expired"),
        /// A slave did not reach PREOP or OP.
        ECAN_ERR_NOT_OPERATIONAL = -27 => Lasting(c"a slave did not reach its state"),
        /// The verification of a gateway in OP failed: its readback differs from the configuration.
        ECAN_ERR_VERIFICATION = -28 => Lasting(c"the verification of a gateway failed"),
        /// The context is attached: only the owner of the master may do this.
        ECAN_ERR_ATTACHED = -29 => Lasting(c"only the owner of the master may do this"),
        /// The axis does not exist.
        ECAN_ERR_AXIS = -30 => Lasting(c"the axis does not exist"),
        /// The state or the mode of the axis does not allow this.
        ECAN_ERR_AXIS_STATE = -31 => Lasting(c"the state of the axis does not allow this"),
        /// One or more axes did not reach the requested state; ecan_last_error() names each.
        ECAN_ERR_AXES = -32 => Lasting(c"not every axis reached the requested state"),
        /// A CANopen transfer or command failed.
        ECAN_ERR_CANOPEN = -33 => Lasting(c"a CANopen service failed"),
        /// The application cancelled the wait (ecan_igh_stop_waiting_when()).
        ECAN_ERR_STOPPED = -34 => Lasting(c"cancelled by the application"),
        /// The system denied a real-time request; ecan_last_error() gives the reason and what to
        /// do.
        ECAN_ERR_PRIVILEGE = -35 => Lasting(c"the system denied a real-time request"),
        /// A file or a scenario of the simulator cannot be used; ecan_last_error() names it, with the
        /// reason.
        ECAN_ERR_FILE = -36 => Lasting(c"a file or scenario cannot be used"),
        /// The image has another layout_id than the profile: the device's active profile differs. Its
        /// frames are stored.
        ECAN_ERR_LAYOUT = -37 => Lasting(c"the image has another layout than the profile"),
        /// The CANopen node is not in the network of the context.
        ECAN_ERR_NODE = -38 => Lasting(c"the node is not in the network"),
        /// One or more mandatory nodes are not booted; ecan_last_error() names each.
        ECAN_ERR_BOOT = -39 => Lasting(c"not every mandatory node is booted"),
        /// An internal fault of the library. Please report it with the text of ecan_last_error().
        ECAN_ERR_INTERNAL = -99 => Lasting(c"internal fault of the library"),
    }
}

/// Meaning of a return value.
#[derive(Clone, Copy, Debug)]
pub enum Meaning {
    /// Text of a code that the same call returns again.
    Lasting(&'static CStr),
    /// Text of a code after which a frame may be sent again in a later cycle.
    Temporary(&'static CStr),
}

impl ecan_result_t {
    /// The value that C gets.
    pub const fn code(self) -> c_int {
        self as c_int
    }
}

// Section: Constants

/// Cycle for the first startup, in microseconds (manual 15.5.2).
pub const ECAN_DEFAULT_CYCLE_US: u32 = 10_000;
/// PDO size for classic CAN and CANopen, in chunks of 128 bytes (manual 15.5.2).
pub const ECAN_DEFAULT_PDO_MULTIPLIER: u32 = 3;
/// PDO size for CAN FD, in chunks of 128 bytes (manual 15.5.2).
pub const ECAN_DEFAULT_FD_PDO_MULTIPLIER: u32 = 8;
/// Bytes of a PDO chunk (manual 5.1).
pub const ECAN_PDO_CHUNK_BYTES: usize = 128;
/// Bytes of an image's header (manual 6).
pub const ECAN_PDO_HEADER_BYTES: usize = 24;
/// Most chunks of a PDO (manual 5.2).
pub const ECAN_PDO_MAX_MULTIPLIER: u32 = 24;
/// Most chunks that IgH 1.6.2 carries per direction: a sync manager never spans two datagrams of
/// at most 1486 bytes.
pub const ECAN_PDO_MAX_PLAIN_MULTIPLIER: u32 = 11;
/// Most packets of an image: its header counts them in a byte.
pub const ECAN_PDO_MAX_PACKETS: usize = 255;
/// CAN channels of a gateway.
pub const ECAN_MCAN_CHANNELS: usize = 4;
/// Most data bytes of a CAN FD frame.
pub const ECAN_CANFD_MAX_BYTES: usize = 64;

/// The CAN channels of a gateway, by number.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ecan_mcan_channel_t {
    /// CAN0.
    ECAN_MCAN0 = 0,
    /// CAN1.
    ECAN_MCAN1 = 1,
    /// CAN2.
    ECAN_MCAN2 = 2,
    /// CAN3.
    ECAN_MCAN3 = 3,
}

const _: () = {
    assert!(ECAN_PDO_CHUNK_BYTES == ecan_protocol::mapping::CHUNK_BYTES);
    assert!(ECAN_PDO_HEADER_BYTES == ecan_protocol::mapping::HEADER_BYTES);
    assert!(ECAN_PDO_MAX_MULTIPLIER == ecan_protocol::mapping::MAX_MULTIPLIER as u32);
    assert!(ECAN_PDO_MAX_PACKETS == ecan_protocol::mapping::MAX_PACKETS);
    assert!(ECAN_MCAN_CHANNELS == ecan_protocol::mapping::CHANNELS);
};

/// A pointer of C for a result.
#[derive(Debug)]
pub struct OutPointer<T>(NonNull<T>);

impl<T> OutPointer<T> {
    /// `pointer` must be valid for writing as long as this lives, or NULL.
    pub(crate) fn new(pointer: *mut T) -> Option<Self> {
        NonNull::new(pointer).map(Self)
    }

    /// Stores the result.
    pub fn set(&self, value: T) {
        // SAFETY: `Call::out` was promised that it is valid for writing.
        unsafe { self.0.write(value) };
    }

    /// Stores a result, if it is not an error.
    pub fn store(&self, result: Result<T, ecan_result_t>) -> Result<(), ecan_result_t> {
        result.map(|value| self.set(value))
    }

    /// The pointer itself.
    pub fn as_ptr(&self) -> *mut T {
        self.0.as_ptr()
    }

    /// Returns this pointer with another type, which must fit what it points to.
    pub(crate) fn cast<U>(&self) -> OutPointer<U> {
        OutPointer(self.0.cast())
    }
}

/// An array of C for items.
#[derive(Debug)]
pub struct OutArray<T> {
    items: *mut T,
    capacity: usize,
    count: usize,
}

impl<T> OutArray<T> {
    /// `items` must be valid for writing `capacity` items as long as this lives.
    pub(crate) fn new(items: *mut T, capacity: usize) -> Self {
        Self { items, capacity, count: 0 }
    }

    /// Stores the next item; returns false if the array is full.
    #[inline(always)]
    pub fn push(&mut self, item: T) -> bool {
        if self.count == self.capacity {
            return false;
        }
        // SAFETY: below the capacity for which `Call::room` was promised validity.
        unsafe { self.items.add(self.count).write(item) };
        self.count += 1;
        true
    }

    /// Returns true if no other item fits.
    #[inline]
    pub fn is_full(&self) -> bool {
        self.count == self.capacity
    }

    /// Stores the first item, if there is room, which the next `push` replaces.
    pub(crate) fn start_with(&mut self, item: T) {
        self.push(item);
        self.count = 0;
    }

    /// Number of items that fit.
    pub(crate) fn capacity(&self) -> usize {
        self.capacity
    }

    /// Number of stored items.
    #[inline]
    pub fn count(&self) -> usize {
        self.count
    }
}

impl OutArray<u8> {
    /// Stores the bytes that fit; returns false if some do not.
    pub fn push_bytes(&mut self, bytes: &[u8]) -> bool {
        bytes.iter().all(|byte| self.push(*byte))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_array_rejects_items() {
        let mut buffer = [0; 3];
        let mut room = OutArray::new(buffer.as_mut_ptr(), 2);
        assert!(!room.push_bytes(&[1, 2, 3]));
        assert!(room.is_full());
        assert_eq!((room.count(), buffer), (2, [1, 2, 0]));
    }
}
