//! The CAN interfaces of Linux, virtual or real (`PF_CAN`, raw sockets).

use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;
use std::time::Duration;
use std::{io, thread};

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameKind};
use rustix::io::Errno;
use socketcan::id::FdFlags;
use socketcan::{
    CanAddr, CanAnyFrame, CanDataFrame, CanErrorFrame, CanFdFrame, CanFdSocket, CanRemoteFrame,
    EmbeddedFrame as _, ExtendedId, Id, Socket as _, SocketOptions as _, StandardId,
};
use thiserror::Error;

use super::client_queue::{ClientQueue, Outgoing, Reports};
use super::clients::{ClientFrame, ClientId, Clients};
use super::config::{BusEvent, ErrorFrame, count};
use super::connection::Close;

#[cfg(test)]
mod bridge_tests;
#[cfg(test)]
mod frame_tests;

const LOOK: Duration = Duration::from_millis(50);
/// Interval of attempts to write to an interface with a full queue.
const RETRY: Duration = Duration::from_millis(1);
/// Number of attempts to write a frame to an interface whose queue is full, at 1 ms, and to a socket
/// whose buffer is full, which waits for [`LOOK`]: about 200 ms. Attempts are counted, not time: in a
/// pause of this process nothing was attempted.
const MAX_ATTEMPTS: u32 = 200;
const ATTEMPTS_OF_LOOK: u32 = 50;

/// A CAN interface of Linux, virtual or real, connected to a bus. Dropping it ends its threads; an
/// interface that it did not create remains.
///
/// CAN FD frames pass if the interface's MTU allows them (`ip link set vcan0 mtu 72`); others are
/// counted as [unsupported](super::BridgeStatistics::unsupported). The bridge does not receive its
/// own frames from the interface. [Events of the bus](super::BusEvent) become error frames; error
/// frames of other programs are not forwarded.
///
/// Other programs on the interface receive a frame as soon as it is sent, before it is on the bus: a
/// virtual interface has no transmit result. While the queue to the bus is full, the bridge does not
/// read the interface. Frames then wait in the receive buffer of its socket; frames that do not fit
/// are [lost](super::BridgeStatistics::dropped_to_bus), and an error frame reports them.
#[derive(Debug)]
pub struct SocketCanBridge {
    interface: String,
    clients: Arc<Clients>,
    state: Arc<State>,
    threads: Vec<JoinHandle<()>>,
    /// The interface, if this bridge created it.
    created: Option<VirtualInterface>,
}

#[derive(Debug, Default)]
struct State {
    is_closed: AtomicBool,
    /// The error that ended the use of the interface.
    end: OnceLock<io::Error>,
}

impl State {
    fn is_closed(&self) -> bool {
        self.is_closed.load(Ordering::Acquire)
    }
}

#[derive(Debug)]
struct Closing(Arc<State>);

impl Close for Closing {
    fn close(&self) {
        self.0.is_closed.store(true, Ordering::Release);
    }
}

impl SocketCanBridge {
    /// Opens an interface by name; `queue` is the capacity in frames of the queue to the bus and of
    /// the queue to the interface.
    ///
    /// # Errors
    /// The interface does not exist or is down, the kernel does not support CAN, or no thread is
    /// available.
    pub fn open(interface: &str, queue: usize) -> Result<Self, SocketCanError> {
        let socket = open(interface)?;
        let failed = |error| SocketCanError::Open(interface.to_owned(), error);
        Self::over(socket, interface, queue).map_err(failed)
    }

    /// As [`open`](Self::open); creates a virtual interface for CAN FD if there is none with this
    /// name, and removes it at the end.
    ///
    /// # Errors
    /// As of [`open`](Self::open), or the interface cannot be created.
    pub fn open_or_create(interface: &str, queue: usize) -> Result<Self, SocketCanError> {
        let created = match Self::open(interface, queue) {
            Err(SocketCanError::NoInterface(_)) => VirtualInterface::create(interface)?,
            opened => return opened,
        };
        let mut bridge = Self::open(interface, queue)?;
        bridge.created = Some(created);
        Ok(bridge)
    }

    /// Returns whether this bridge created the interface.
    pub fn has_created_interface(&self) -> bool {
        self.created.is_some()
    }

    fn over(socket: CanFdSocket, interface: &str, queue: usize) -> io::Result<Self> {
        // Limits the time of a write to a full socket queue.
        socket.set_write_timeout(LOOK)?;
        let buffer = ReceiveBuffer::of(&socket);
        let (clients, state) = (Arc::new(Clients::new(queue, 1)), Arc::new(State::default()));
        let queue = Arc::new(ClientQueue::with_reports(clients.queue(), Reports::Events));
        // The first client is always admitted.
        let id = clients.join(Closing(state.clone()), None, queue.clone());
        let id = id.ok_or(io::ErrorKind::ConnectionRefused)?;
        let connection =
            Arc::new(Connection { socket, clients: clients.clone(), state: state.clone(), id });
        let interface = interface.to_owned();
        let mut bridge =
            Self { interface, clients, state, threads: Vec::with_capacity(2), created: None };
        let thread =
            |task: &str| thread::Builder::new().name(format!("{} {task}", bridge.interface));
        let (reader, writer) = (thread("reader"), thread("writer"));
        let shared = connection.clone();
        bridge.threads.push(reader.spawn(move || shared.read_all(buffer))?);
        bridge.threads.push(writer.spawn(move || connection.write_all(&queue))?);
        Ok(bridge)
    }

    /// Name of the interface.
    pub fn interface(&self) -> &str {
        &self.interface
    }

    /// The only client: the interface.
    pub fn clients(&self) -> &Arc<Clients> {
        &self.clients
    }

    /// The error if the interface was removed; `None` otherwise. An interface that is down may come
    /// up again.
    pub fn end(&self) -> Option<&io::Error> {
        self.state.end.get()
    }
}

impl Drop for SocketCanBridge {
    fn drop(&mut self) {
        self.clients.close();
        for thread in self.threads.drain(..) {
            // A panic in it has been reported on stderr already.
            let _ = thread.join();
        }
    }
}

fn is(error: &io::Error, errno: Errno) -> bool {
    error.raw_os_error() == Some(errno.raw_os_error())
}

/// Shared by the threads: the reader from the interface to the bus, the writer in the other
/// direction.
struct Connection {
    socket: CanFdSocket,
    clients: Arc<Clients>,
    state: Arc<State>,
    id: ClientId,
}

impl Connection {
    fn read_all(&self, mut buffer: ReceiveBuffer) {
        while !self.state.is_closed() {
            let lost = buffer.newly_lost(&self.socket);
            if lost > 0 {
                self.clients.counters.dropped_to_bus.fetch_add(lost, Ordering::Relaxed);
                self.clients.report(BusEvent::TransmitOverflow, None, 0);
            }
            match self.socket.read_frame_timeout(LOOK) {
                Ok(frame) => match from_kernel(&frame) {
                    Some(frame) => self.submit(frame),
                    None => count(&self.clients.counters.rejected),
                },
                Err(error) => match error.kind() {
                    io::ErrorKind::TimedOut
                    | io::ErrorKind::WouldBlock
                    | io::ErrorKind::Interrupted => {}
                    // Neither a classic nor a CAN FD frame.
                    io::ErrorKind::InvalidData => count(&self.clients.counters.rejected),
                    _ if is(&error, Errno::NODEV) || is(&error, Errno::NXIO) => {
                        let _ = self.state.end.set(error);
                        self.clients.leave(self.id);
                    }
                    // The interface is down; it may come up again.
                    _ => thread::sleep(LOOK),
                },
            }
        }
    }

    fn submit(&self, frame: CanFrame) {
        // Before the bit rates of the bus are known, frames cannot be sent.
        let can_carry = self.clients.bus().is_some_and(|bus| bus.fd || !frame.is_fd());
        if !can_carry {
            count(&self.clients.counters.mismatched);
            count(&self.clients.counters.rejected);
            return self.clients.report(BusEvent::TransmitFailed, None, 0);
        }
        let _ = self.clients.submit(ClientFrame { client: self.id, frame, tag: 0 });
    }

    fn write_all(&self, queue: &ClientQueue) {
        // The previous frame was dropped: the following ones do not wait.
        let mut is_stuck = false;
        while let Some(outgoing) = queue.take() {
            let kernel = match outgoing {
                Outgoing::Frame(frame, _) => to_kernel(&frame),
                Outgoing::Error(error, _) => error_to_kernel(error),
                // An interface gets no answers and requests no results.
                Outgoing::Answer(..) | Outgoing::Result(..) | Outgoing::Lost(..) => continue,
            };
            match kernel {
                Some(kernel) => self.write(&kernel, &mut is_stuck),
                None => count(&self.clients.counters.unsupported),
            }
        }
    }

    fn write(&self, kernel: &CanAnyFrame, is_stuck: &mut bool) {
        let mut attempts_left = if *is_stuck { 0 } else { MAX_ATTEMPTS };
        loop {
            match self.socket.write_frame(kernel) {
                Ok(()) => {
                    *is_stuck = false;
                    return;
                }
                // The interface supports only classic CAN.
                Err(error) if is(&error, Errno::INVAL) && matches!(kernel, CanAnyFrame::Fd(_)) => {
                    return count(&self.clients.counters.unsupported);
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => {
                    let has_waited = error.kind() == io::ErrorKind::WouldBlock;
                    let is_full = has_waited || is(&error, Errno::NOBUFS);
                    if !is_full || self.state.is_closed() || attempts_left == 0 {
                        *is_stuck = is_full;
                        return count(&self.clients.counters.dropped_to_clients);
                    }
                    let attempts = if has_waited { ATTEMPTS_OF_LOOK } else { 1 };
                    attempts_left = attempts_left.saturating_sub(attempts);
                    thread::sleep(RETRY);
                }
            }
        }
    }
}

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
struct VirtualInterface(String);

impl VirtualInterface {
    /// Creates an interface for CAN FD and sets it up.
    fn create(interface: &str) -> Result<Self, SocketCanError> {
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
fn open(interface: &str) -> Result<CanFdSocket, SocketCanError> {
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

/// A frame for the kernel; `None` if the kernel has no such frame.
fn to_kernel(frame: &CanFrame) -> Option<CanAnyFrame> {
    let raw = frame.id().raw();
    let id: Id = match frame.id().is_extended() {
        true => ExtendedId::new(raw)?.into(),
        false => StandardId::new(u16::try_from(raw).ok()?)?.into(),
    };
    match frame.kind() {
        FrameKind::Data => CanDataFrame::new(id, frame.data()).map(Into::into),
        FrameKind::Remote => {
            CanRemoteFrame::new_remote(id, frame.dlc().value().into()).map(Into::into)
        }
        FrameKind::Fd { brs, esi } => {
            let mut flags = FdFlags::FDF;
            flags.set(FdFlags::BRS, brs);
            flags.set(FdFlags::ESI, esi);
            CanFdFrame::with_flags(id, frame.data(), flags).map(Into::into)
        }
    }
}

/// An error frame for the kernel.
fn error_to_kernel(error: ErrorFrame) -> Option<CanAnyFrame> {
    CanErrorFrame::new_error(error.class, &error.data).ok().map(Into::into)
}

/// A frame for the bus; `None` for an error frame. A CAN FD frame whose length has no DLC is padded
/// with zeros, as by the kernel's drivers.
fn from_kernel(frame: &CanAnyFrame) -> Option<CanFrame> {
    let id = |id: Id| match id {
        Id::Standard(id) => CanId::standard(id.as_raw()).ok(),
        Id::Extended(id) => CanId::extended(id.as_raw()).ok(),
    };
    match frame {
        CanAnyFrame::Normal(frame) => CanFrame::classic(id(frame.id())?, frame.data()).ok(),
        CanAnyFrame::Remote(frame) => {
            CanFrame::remote(id(frame.id())?, Dlc::from_classic_len(frame.dlc())?).ok()
        }
        CanAnyFrame::Fd(frame) => {
            CanFrame::fd(id(frame.id())?, frame.data(), frame.is_brs(), frame.is_esi()).ok()
        }
        CanAnyFrame::Error(_) => None,
    }
}

// Options of `asm-generic/socket.h`.
const SOL_SOCKET: i32 = 1;
const SO_RCVBUF: i32 = 8;
const SO_RCVBUFFORCE: i32 = 33;
const SO_MEMINFO: i32 = 55;
/// Index of the counter of lost frames in the result of `SO_MEMINFO` (`linux/sock_diag.h`).
const DROPS: usize = 8;

/// Requested size in bytes. The kernel counts about 800 bytes for a frame.
const BYTES: i32 = 4 * 1024 * 1024;

/// Enlarges the buffer and counts frames that did not fit.
#[derive(Debug)]
struct ReceiveBuffer {
    lost: u32,
}

impl ReceiveBuffer {
    fn of(socket: &CanFdSocket) -> Self {
        // Without CAP_NET_ADMIN the kernel limits the size to net.core.rmem_max.
        let forced = socket.set_socket_option_int(SOL_SOCKET, SO_RCVBUFFORCE, BYTES);
        if forced.is_err() {
            let _ = socket.set_socket_option_int(SOL_SOCKET, SO_RCVBUF, BYTES);
        }
        Self { lost: lost(socket) }
    }

    /// Number of frames lost since the last call.
    fn newly_lost(&mut self, socket: &CanFdSocket) -> u64 {
        let before = std::mem::replace(&mut self.lost, lost(socket));
        self.lost.wrapping_sub(before).into()
    }
}

/// The kernel's counter of lost frames; 0 if the kernel has none.
fn lost(socket: &CanFdSocket) -> u32 {
    let mut values = [0; 4 * (DROPS + 1)];
    let read = socket.get_socket_option_bytes(SOL_SOCKET, SO_MEMINFO, &mut values);
    let last = values.last_chunk().filter(|_| read.is_ok());
    last.map_or(0, |bytes| u32::from_ne_bytes(*bytes))
}

/// Runs a program; returns its message on failure.
pub(crate) fn run(program: &str, arguments: &[&str]) -> Result<(), String> {
    let output = Command::new(program).args(arguments).stdin(Stdio::null()).output();
    let output = output.map_err(|error| format!("{program}: {error}"))?;
    match output.status.success() {
        true => Ok(()),
        false => Err(String::from_utf8_lossy(&output.stderr).trim().to_owned()),
    }
}
