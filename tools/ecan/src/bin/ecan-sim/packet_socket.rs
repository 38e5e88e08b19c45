//! Network interface, and packet socket for its EtherCAT frames (packet(7)).

use std::io::IoSliceMut;
use std::num::NonZeroU32;
use std::os::fd::{AsFd, AsRawFd, OwnedFd};

use ecan_sim::ETHERCAT_ETHERTYPE;
use nix::errno::Errno;
use nix::ifaddrs::getifaddrs;
use nix::net::if_::InterfaceFlags;
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::socket::{
    ControlMessageOwned, LinkAddr, MsgFlags, bind, getsockopt, recvmsg, send, setsockopt, sockopt,
};
use nix::sys::time::{TimeSpec, TimeValLike};
use nix::{getsockopt_impl, setsockopt_impl, sockopt_impl};
use rustix::net::{AddressFamily, Protocol, SocketFlags, SocketType, socket_with};
use thiserror::Error;

sockopt_impl!(
    /// Receives frames to every address.
    Membership,
    SetOnly,
    libc::SOL_PACKET,
    libc::PACKET_ADD_MEMBERSHIP,
    libc::packet_mreq
);
sockopt_impl!(
    /// Frames dropped by the system since the last read.
    Losses,
    GetOnly,
    libc::SOL_PACKET,
    libc::PACKET_STATISTICS,
    libc::tpacket_stats
);

/// Size of the control message with the arrival time.
const CONTROL_BYTES: usize = 128;

#[derive(Debug, Error)]
pub enum SocketError {
    #[error(
        "no permission for raw Ethernet frames on {interface}; run as root, or give the program \
         the capability CAP_NET_RAW (`setcap cap_net_raw+ep` on its file)"
    )]
    NotPermitted { interface: String },
    #[error("cannot open {interface} for raw Ethernet frames: {errno}")]
    Open { interface: String, errno: Errno },
    #[error("network interface {interface} was removed")]
    Gone { interface: String },
    #[error("cannot receive from {interface}: {errno}")]
    Receive { interface: String, errno: Errno },
    #[error("cannot send to {interface}: {errno}")]
    Send { interface: String, errno: Errno },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received {
    /// A frame of this size, and its arrival time by the system's real-time clock, ns.
    Frame {
        bytes: usize,
        arrived_ns: Option<u64>,
    },
    Nothing,
    Down,
}

/// The socket. Frames that this machine sends on the interface are skipped.
pub struct PacketSocket {
    descriptor: OwnedFd,
    pub interface: Interface,
    control: [u8; CONTROL_BYTES],
}

impl PacketSocket {
    pub fn open(interface: Interface) -> Result<Self, SocketError> {
        let fault = |errno: Errno| match errno {
            Errno::EPERM | Errno::EACCES => {
                SocketError::NotPermitted { interface: interface.name.clone() }
            }
            errno => SocketError::Open { interface: interface.name.clone(), errno },
        };
        let descriptor = socket_with(
            AddressFamily::PACKET,
            SocketType::RAW,
            SocketFlags::CLOEXEC | SocketFlags::NONBLOCK,
            NonZeroU32::new(ETHERCAT_ETHERTYPE.to_be().into()).map(Protocol::from_raw),
        )
        .map_err(|error| fault(Errno::from_raw(error.raw_os_error())))?;
        let address = interface.address;
        // The address has no protocol: the socket keeps its own.
        bind(descriptor.as_raw_fd(), &address).map_err(fault)?;
        let membership = libc::packet_mreq {
            mr_ifindex: address.ifindex() as i32,
            mr_type: libc::PACKET_MR_PROMISC as u16,
            mr_alen: 0,
            mr_address: [0; 8],
        };
        setsockopt(&descriptor, Membership, &membership).map_err(fault)?;
        setsockopt(&descriptor, sockopt::ReceiveTimestampns, &true).map_err(fault)?;
        Ok(Self { descriptor, interface, control: [0; CONTROL_BYTES] })
    }

    /// Receives a frame, if there is one, without waiting.
    pub fn receive(&mut self, frame: &mut [u8]) -> Result<Received, SocketError> {
        loop {
            let mut parts = [IoSliceMut::new(frame)];
            let message = match recvmsg::<LinkAddr>(
                self.descriptor.as_raw_fd(),
                &mut parts,
                Some(&mut self.control),
                MsgFlags::MSG_DONTWAIT,
            ) {
                Ok(message) => message,
                Err(Errno::EAGAIN) => return Ok(Received::Nothing),
                Err(Errno::EINTR) => continue,
                Err(Errno::ENETDOWN) => {
                    self.check_interface()?;
                    return Ok(Received::Down);
                }
                Err(errno) => {
                    let interface = self.interface.name.clone();
                    return Err(SocketError::Receive { interface, errno });
                }
            };
            // Until it was bound the socket received frames of every interface.
            let is_for_us = message.address.is_none_or(|from| {
                from.pkttype() != libc::PACKET_OUTGOING
                    && from.ifindex() == self.interface.address.ifindex()
            });
            if !is_for_us {
                continue;
            }
            let time = |control| match control {
                ControlMessageOwned::ScmTimestampns(time) => {
                    u64::try_from(time.num_nanoseconds()).ok()
                }
                _ => None,
            };
            let arrived_ns = message.cmsgs().ok().and_then(|mut controls| controls.find_map(time));
            return Ok(Received::Frame { bytes: message.bytes, arrived_ns });
        }
    }

    /// Fails if the interface was removed. The system reports only that it is down, which happens
    /// before the removal: call again while it is down.
    pub fn check_interface(&self) -> Result<(), SocketError> {
        let is_there = nix::net::if_::if_nametoindex(self.interface.name.as_str())
            .is_ok_and(|index| index as usize == self.interface.address.ifindex());
        if is_there {
            Ok(())
        } else {
            Err(SocketError::Gone { interface: self.interface.name.clone() })
        }
    }

    /// Sends a frame; returns false if the queue is full or the interface is down.
    pub fn send(&self, frame: &[u8]) -> Result<bool, SocketError> {
        match send(self.descriptor.as_raw_fd(), frame, MsgFlags::MSG_DONTWAIT) {
            Ok(_) => Ok(true),
            // Down or removed: receiving reports it.
            Err(Errno::ENETDOWN | Errno::ENXIO | Errno::ENODEV) => Ok(false),
            Err(Errno::EAGAIN | Errno::ENOBUFS | Errno::EMSGSIZE | Errno::EINTR) => Ok(false),
            Err(errno) => Err(SocketError::Send { interface: self.interface.name.clone(), errno }),
        }
    }

    /// Waits for a frame, at most this long.
    pub fn wait(&self, timeout_ns: u64) {
        let timeout = TimeSpec::nanoseconds(i64::try_from(timeout_ns).unwrap_or(i64::MAX));
        let mut descriptors = [PollFd::new(self.descriptor.as_fd(), PollFlags::POLLIN)];
        // On a signal or socket error the caller checks anyway.
        let _ = ppoll(&mut descriptors, Some(timeout), None);
    }

    /// Frames dropped by the system since the last call.
    pub fn losses(&self) -> u64 {
        getsockopt(&self.descriptor, Losses).map_or(0, |losses| losses.tp_drops.into())
    }
}

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
            let Some(address) =
                entry.address.as_ref().and_then(|address| address.as_link_addr().copied())
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
