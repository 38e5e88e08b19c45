//! A packet socket that takes the EtherCAT frames of one interface (packet(7)).

use std::fmt;
use std::io::IoSliceMut;
use std::num::NonZeroU32;
use std::os::fd::{AsFd, AsRawFd, OwnedFd};

use ecan_sim::ETHERCAT_ETHERTYPE;
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::socket::{
    ControlMessageOwned, LinkAddr, MsgFlags, bind, getsockopt, recvmsg, send, setsockopt, sockopt,
};
use nix::sys::time::{TimeSpec, TimeValLike};
use nix::{getsockopt_impl, setsockopt_impl, sockopt_impl};
use rustix::net::{AddressFamily, Protocol, SocketFlags, SocketType, socket_with};
use thiserror::Error;

use super::interface::Interface;

sockopt_impl!(
    /// Takes frames to every address.
    Membership,
    SetOnly,
    libc::SOL_PACKET,
    libc::PACKET_ADD_MEMBERSHIP,
    libc::packet_mreq
);
sockopt_impl!(
    /// Frames that there was no room for, since the last look.
    Losses,
    GetOnly,
    libc::SOL_PACKET,
    libc::PACKET_STATISTICS,
    libc::tpacket_stats
);

/// Room for the control message with the time of arrival.
const CONTROL_BYTES: usize = 128;

/// Why there is no socket, or no longer.
#[derive(Debug, Error)]
pub enum SocketError {
    /// The system keeps raw sockets for those who may.
    #[error(
        "no permission for raw Ethernet frames on {interface}: run as root, or give the program \
         the capability CAP_NET_RAW (`setcap cap_net_raw+ep` on its file)"
    )]
    NotPermitted {
        /// Which interface.
        interface: String,
    },
    /// Setting up.
    #[error("cannot open {interface} for raw Ethernet frames: {errno}")]
    Open {
        /// Which interface.
        interface: String,
        /// What the system says.
        errno: Errno,
    },
    /// The interface was removed.
    #[error("the network interface {interface} is gone")]
    Gone {
        /// Which interface.
        interface: String,
    },
    /// Receiving.
    #[error("cannot receive from {interface}: {errno}")]
    Receive {
        /// Which interface.
        interface: String,
        /// What the system says.
        errno: Errno,
    },
    /// Sending.
    #[error("cannot send to {interface}: {errno}")]
    Send {
        /// Which interface.
        interface: String,
        /// What the system says.
        errno: Errno,
    },
}

/// What [`PacketSocket::receive`] found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received {
    /// A frame of so many bytes, and when it arrived by the system's real-time clock, ns.
    Frame {
        /// Bytes.
        bytes: usize,
        /// Where the system told it.
        arrived_ns: Option<u64>,
    },
    /// Nothing is there.
    Nothing,
    /// The interface was switched off.
    Down,
}

/// The socket. It receives what others send; what this machine sends from the interface is left
/// out.
pub struct PacketSocket {
    descriptor: OwnedFd,
    interface: Interface,
    control: [u8; CONTROL_BYTES],
}

impl PacketSocket {
    /// Opens it, for frames to every address.
    pub fn open(interface: Interface) -> Result<Self, SocketError> {
        let fault = |errno: Errno| match errno {
            Errno::EPERM | Errno::EACCES => {
                SocketError::NotPermitted { interface: interface.name().to_owned() }
            }
            errno => SocketError::Open { interface: interface.name().to_owned(), errno },
        };
        let descriptor = socket_with(
            AddressFamily::PACKET,
            SocketType::RAW,
            SocketFlags::CLOEXEC | SocketFlags::NONBLOCK,
            NonZeroU32::new(ETHERCAT_ETHERTYPE.to_be().into()).map(Protocol::from_raw),
        )
        .map_err(|error| fault(Errno::from_raw(error.raw_os_error())))?;
        let address = interface.address();
        // The address names no protocol: the socket keeps its own.
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

    /// The interface.
    pub fn interface(&self) -> &Interface {
        &self.interface
    }

    /// Takes a frame, if there is one, without waiting.
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
                    let interface = self.interface.name().to_owned();
                    return Err(SocketError::Receive { interface, errno });
                }
            };
            // Until it was bound the socket took frames of every interface.
            let is_for_us = message.address.is_none_or(|from| {
                from.pkttype() != libc::PACKET_OUTGOING
                    && from.ifindex() == self.interface.address().ifindex()
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

    /// Fails where the interface was removed. The system tells only that it goes down, which it does
    /// before it is removed, too: ask again while it is down.
    pub fn check_interface(&self) -> Result<(), SocketError> {
        let is_there = nix::net::if_::if_nametoindex(self.interface.name())
            .is_ok_and(|index| index as usize == self.interface.address().ifindex());
        if is_there {
            Ok(())
        } else {
            Err(SocketError::Gone { interface: self.interface.name().to_owned() })
        }
    }

    /// Sends a frame; false where there was no room for it, or the interface is down.
    pub fn send(&self, frame: &[u8]) -> Result<bool, SocketError> {
        match send(self.descriptor.as_raw_fd(), frame, MsgFlags::MSG_DONTWAIT) {
            Ok(_) => Ok(true),
            // Switched off, or removed: receiving tells.
            Err(Errno::ENETDOWN | Errno::ENXIO | Errno::ENODEV) => Ok(false),
            Err(Errno::EAGAIN | Errno::ENOBUFS | Errno::EMSGSIZE | Errno::EINTR) => Ok(false),
            Err(errno) => {
                Err(SocketError::Send { interface: self.interface.name().to_owned(), errno })
            }
        }
    }

    /// Waits until there is something to receive, but no longer than this.
    pub fn wait(&self, timeout_ns: u64) {
        let timeout = TimeSpec::nanoseconds(i64::try_from(timeout_ns).unwrap_or(i64::MAX));
        let mut descriptors = [PollFd::new(self.descriptor.as_fd(), PollFlags::POLLIN)];
        // A signal, a fault of the socket: whoever waited looks for them anyway.
        let _ = ppoll(&mut descriptors, Some(timeout), None);
    }

    /// Frames that the system had no room for, since the last call.
    pub fn losses(&self) -> u64 {
        getsockopt(&self.descriptor, Losses).map_or(0, |losses| losses.tp_drops.into())
    }
}

impl fmt::Debug for PacketSocket {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PacketSocket")
            .field("interface", &self.interface.name())
            .finish_non_exhaustive()
    }
}
