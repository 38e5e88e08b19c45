//! Opening and creation of a CAN interface, with explained errors.

use std::io;

use rustix::io::Errno;
use socketcan::{CanAddr, CanFdSocket, Socket as _};
use thiserror::Error;

use crate::bridge::command::run;

/// Any interface: its number for the kernel.
const ANY: u32 = 0;

/// Reason why a CAN interface, given by name, cannot be opened.
#[derive(Debug, Error)]
pub enum SocketCanError {
    /// The kernel does not support CAN.
    #[error(
        "this kernel has no SocketCAN ({1}): modprobe can_raw; for a virtual interface \
         modprobe vcan; ip link add dev {0} mtu 72 type vcan; ip link set {0} up"
    )]
    NoSocketCan(String, io::Error),
    /// The interface does not exist.
    #[error(
        "network interface {0} does not exist; for a virtual one: modprobe vcan; \
         ip link add dev {0} mtu 72 type vcan; ip link set {0} up"
    )]
    NoInterface(String),
    /// The interface is not a CAN interface.
    #[error("{0} is not a CAN interface; see `ip link show type can` and `ip link show type vcan`")]
    NotCan(String),
    /// The interface is down.
    #[error(
        "the CAN interface {0} is down: ip link set {0} up, for a real one with \
         its bit rate: ip link set {0} up type can bitrate 500000"
    )]
    Down(String),
    /// The interface cannot be created.
    #[error(
        "cannot create the CAN interface {interface}: {reason}; as root: modprobe vcan; \
         ip link add dev {interface} mtu 72 type vcan; ip link set {interface} up"
    )]
    Create {
        /// Name of the interface.
        interface: String,
        /// Message of `ip`.
        reason: String,
    },
    /// Another error.
    #[error("cannot open the CAN interface {0}: {1}")]
    Open(String, io::Error),
}

/// A virtual interface that this process created; removed when dropped.
#[derive(Debug)]
pub(super) struct VirtualInterface(String);

impl VirtualInterface {
    /// Creates an interface for CAN FD and sets it up.
    pub(super) fn create(interface: &str) -> Result<Self, SocketCanError> {
        let failed = |reason| SocketCanError::Create { interface: interface.to_owned(), reason };
        run("ip", &["link", "add", "dev", interface, "mtu", "72", "type", "vcan"])
            .map_err(failed)?;
        let created = Self(interface.to_owned());
        run("ip", &["link", "set", "dev", interface, "up"]).map_err(failed)?;
        Ok(created)
    }
}

impl Drop for VirtualInterface {
    fn drop(&mut self) {
        // Another program may have removed it.
        let _ = run("ip", &["link", "delete", "dev", &self.0]);
    }
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
        return Err(SocketCanError::NoSocketCan(name(), error));
    }
    let address =
        CanAddr::from_iface(interface).map_err(|_| SocketCanError::NoInterface(name()))?;
    let socket = CanFdSocket::open_addr(&address).map_err(|error| {
        match error.raw_os_error() == Some(Errno::NODEV.raw_os_error()) {
            true => SocketCanError::NotCan(name()),
            false => SocketCanError::Open(name(), error),
        }
    })?;
    // A raw socket may be bound to an interface that is down; that is then a pending error.
    match socket.as_raw_socket().take_error() {
        Ok(None) => Ok(socket),
        Ok(Some(error)) if error.raw_os_error() == Some(Errno::NETDOWN.raw_os_error()) => {
            Err(SocketCanError::Down(name()))
        }
        Ok(Some(error)) | Err(error) => Err(SocketCanError::Open(name(), error)),
    }
}
