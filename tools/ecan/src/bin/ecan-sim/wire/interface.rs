use nix::ifaddrs::getifaddrs;
use nix::net::if_::InterfaceFlags;
use nix::sys::socket::LinkAddr;
use thiserror::Error;

#[derive(Debug, Error)]
pub enum InterfaceError {
    #[error("cannot list the network interfaces: {0}")]
    List(nix::Error),
    #[error("network interface \"{name}\" does not exist; there are: {known}")]
    Unknown { name: String, known: String },
    #[error("network interface {name} is down; use `ip link set {name} up`")]
    Down { name: String },
    #[error(
        "{name} is the loopback interface, which has no other end for a master; create a veth pair"
    )]
    Loopback { name: String },
}

/// A network interface that is up.
#[derive(Debug, Clone)]
pub struct Interface {
    pub name: String,
    /// Address for a packet socket, without a protocol.
    pub address: LinkAddr,
    pub has_link: bool,
}

impl Interface {
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
}
