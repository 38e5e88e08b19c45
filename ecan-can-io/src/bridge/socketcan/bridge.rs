//! A CAN interface as the only client of a bridge, with one thread per direction.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use ecan_protocol::can::CanFrame;
use rustix::io::Errno;
use socketcan::{CanAnyFrame, CanFdSocket, Socket as _};

use crate::bridge::bus_event::BusEvent;
use crate::bridge::client_queue::{ClientQueue, Outgoing, Reports};
use crate::bridge::clients::{ClientFrame, ClientId, Clients};
use crate::bridge::connection::Close;
use crate::bridge::socketcan::frame::{error_to_kernel, from_kernel, to_kernel};
use crate::bridge::socketcan::interface::{self, SocketCanError, VirtualInterface};
use crate::bridge::socketcan::receive_buffer::ReceiveBuffer;
use crate::bridge::statistics::count;

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
/// counted as [unsupported](crate::bridge::BridgeStatistics::unsupported). The bridge does not receive its
/// own frames from the interface. [Events of the bus](crate::bridge::BusEvent) become error frames; error
/// frames of other programs are not forwarded.
///
/// Other programs on the interface receive a frame as soon as it is sent, before it is on the bus: a
/// virtual interface has no transmit result. While the queue to the bus is full, the bridge does not
/// read the interface. Frames then wait in the receive buffer of its socket; frames that do not fit
/// are [lost](crate::bridge::BridgeStatistics::dropped_to_bus), and an error frame reports them.
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
        let socket = interface::open(interface)?;
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

    pub(super) fn over(socket: CanFdSocket, interface: &str, queue: usize) -> io::Result<Self> {
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
        self.clients.submit_when_possible(ClientFrame { client: self.id, frame, tag: 0 });
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
