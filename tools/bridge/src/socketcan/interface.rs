//! Opening an interface, and what is said where that fails.

use std::io;

use rustix::io::Errno;
use socketcan::{CanAddr, CanFdSocket, Socket as _};
use thiserror::Error;

/// Any interface: its number for the kernel.
const ANY: u32 = 0;

/// Why a CAN interface cannot be had.
#[derive(Debug, Error)]
pub enum SocketCanError {
    /// The kernel does not know CAN.
    #[error(
        "this kernel has no SocketCAN ({error}): modprobe can_raw; for a virtual interface \
         modprobe vcan; ip link add dev {interface} type vcan; ip link set {interface} up"
    )]
    NoSocketCan {
        /// The interface that was asked for.
        interface: String,
        /// What the kernel says.
        error: io::Error,
    },
    /// There is no such interface.
    #[error(
        "there is no network interface {interface}; for a virtual one: modprobe vcan; \
         ip link add dev {interface} type vcan; ip link set {interface} up"
    )]
    NoInterface {
        /// The interface that was asked for.
        interface: String,
    },
    /// It is an interface for something else.
    #[error("{interface} is no CAN interface; `ip link show type can` and `type vcan` list those")]
    NotCan {
        /// The interface that was asked for.
        interface: String,
    },
    /// It is switched off.
    #[error(
        "the CAN interface {interface} is down: ip link set {interface} up, for a real one with \
         its bit rate: ip link set {interface} up type can bitrate 500000"
    )]
    Down {
        /// The interface.
        interface: String,
    },
    /// The kernel refuses it for another reason.
    #[error("cannot open the CAN interface {interface}: {error}")]
    Open {
        /// The interface that was asked for.
        interface: String,
        /// What the kernel says.
        error: io::Error,
    },
}

/// Opens an interface for classic and CAN FD frames. What is written to it does not come back,
/// other programs on it do see it.
pub(super) fn open(interface: &str) -> Result<CanFdSocket, SocketCanError> {
    let name = || interface.to_owned();
    let is_missing = |error: &io::Error| {
        let kinds = [Errno::AFNOSUPPORT, Errno::PROTONOSUPPORT];
        error.raw_os_error().is_some_and(|raw| kinds.iter().any(|kind| kind.raw_os_error() == raw))
    };
    // First without a name: a kernel without CAN has no CAN interfaces either.
    if let Err(error) = CanFdSocket::open_iface(ANY)
        && is_missing(&error)
    {
        return Err(SocketCanError::NoSocketCan { interface: name(), error });
    }
    let address = CanAddr::from_iface(interface)
        .map_err(|_| SocketCanError::NoInterface { interface: name() })?;
    let socket = CanFdSocket::open_addr(&address).map_err(|error| {
        match error.raw_os_error() == Some(Errno::NODEV.raw_os_error()) {
            true => SocketCanError::NotCan { interface: name() },
            false => SocketCanError::Open { interface: name(), error },
        }
    })?;
    // A raw socket may be bound to an interface that is down; that waits there as an error.
    match socket.as_raw_socket().take_error() {
        Ok(None) => Ok(socket),
        Ok(Some(error)) if error.raw_os_error() == Some(Errno::NETDOWN.raw_os_error()) => {
            Err(SocketCanError::Down { interface: name() })
        }
        Ok(Some(error)) | Err(error) => Err(SocketCanError::Open { interface: name(), error }),
    }
}
