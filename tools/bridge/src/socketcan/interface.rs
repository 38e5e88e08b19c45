//! Opening of a CAN interface, with explained errors.

use std::io;

use rustix::io::Errno;
use socketcan::{CanAddr, CanFdSocket, Socket as _};
use thiserror::Error;

/// Any interface: its number for the kernel.
const ANY: u32 = 0;

/// Reason why a CAN interface cannot be opened.
#[derive(Debug, Error)]
pub enum SocketCanError {
    /// The kernel does not support CAN.
    #[error(
        "this kernel has no SocketCAN ({error}): modprobe can_raw; for a virtual interface \
         modprobe vcan; ip link add dev {interface} type vcan; ip link set {interface} up"
    )]
    NoSocketCan {
        /// Interface name.
        interface: String,
        /// The system's error.
        error: io::Error,
    },
    /// The interface does not exist.
    #[error(
        "network interface {interface} does not exist; for a virtual one: modprobe vcan; \
         ip link add dev {interface} type vcan; ip link set {interface} up"
    )]
    NoInterface {
        /// Interface name.
        interface: String,
    },
    /// The interface is not a CAN interface.
    #[error(
        "{interface} is not a CAN interface; see `ip link show type can` and `ip link show type vcan`"
    )]
    NotCan {
        /// Interface name.
        interface: String,
    },
    /// The interface is down.
    #[error(
        "the CAN interface {interface} is down: ip link set {interface} up, for a real one with \
         its bit rate: ip link set {interface} up type can bitrate 500000"
    )]
    Down {
        /// Interface name.
        interface: String,
    },
    /// Another error.
    #[error("cannot open the CAN interface {interface}: {error}")]
    Open {
        /// Interface name.
        interface: String,
        /// The system's error.
        error: io::Error,
    },
}

/// Opens an interface for classic and CAN FD frames. Own frames are not received, but other
/// programs on the interface receive them.
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
    // A raw socket may be bound to an interface that is down; that is then a pending error.
    match socket.as_raw_socket().take_error() {
        Ok(None) => Ok(socket),
        Ok(Some(error)) if error.raw_os_error() == Some(Errno::NETDOWN.raw_os_error()) => {
            Err(SocketCanError::Down { interface: name() })
        }
        Ok(Some(error)) | Err(error) => Err(SocketCanError::Open { interface: name(), error }),
    }
}
