//! Finding the network interface by its name.

use nix::ifaddrs::getifaddrs;
use nix::net::if_::InterfaceFlags;
use nix::sys::socket::LinkAddr;
use thiserror::Error;

/// Why an interface cannot be used.
#[derive(Debug, Error)]
pub enum InterfaceError {
    /// The list of interfaces cannot be had.
    #[error("cannot list the network interfaces: {0}")]
    List(nix::Error),
    /// No interface has this name.
    #[error("there is no network interface \"{name}\"; there are: {known}")]
    Unknown {
        /// The name.
        name: String,
        /// Those that there are.
        known: String,
    },
    /// The interface is switched off.
    #[error("the network interface {name} is down: `ip link set {name} up` switches it on")]
    Down {
        /// Its name.
        name: String,
    },
    /// It has no other end.
    #[error("{name} is the loopback interface, it has no other end for a master: make a veth pair")]
    Loopback {
        /// Its name.
        name: String,
    },
}

/// A network interface that is up.
#[derive(Debug, Clone)]
pub struct Interface {
    name: String,
    address: LinkAddr,
    has_link: bool,
}

impl Interface {
    /// The interface of this name.
    pub fn find(name: &str) -> Result<Self, InterfaceError> {
        let mut known = Vec::new();
        for entry in getifaddrs().map_err(InterfaceError::List)? {
            // Each interface has one entry with its link address, up or down.
            let Some(address) = entry.address.as_ref().and_then(|it| it.as_link_addr().copied())
            else {
                continue;
            };
            if entry.interface_name != name {
                known.push(entry.interface_name);
                continue;
            }
            let name = entry.interface_name;
            if entry.flags.contains(InterfaceFlags::IFF_LOOPBACK) {
                return Err(InterfaceError::Loopback { name });
            }
            if !entry.flags.contains(InterfaceFlags::IFF_UP) {
                return Err(InterfaceError::Down { name });
            }
            let has_link = entry.flags.contains(InterfaceFlags::IFF_LOWER_UP);
            return Ok(Self { name, address, has_link });
        }
        known.sort();
        Err(InterfaceError::Unknown { name: name.to_owned(), known: known.join(", ") })
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its address for a packet socket, without a protocol.
    pub fn address(&self) -> LinkAddr {
        self.address
    }

    /// Whether there is a carrier.
    pub fn has_link(&self) -> bool {
        self.has_link
    }
}
