//! A CAN interface as the only client of a bridge: one thread for each way.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use ecan_protocol::can::CanFrame;
use rustix::io::Errno;
use socketcan::{CanFdSocket, Socket as _};

use crate::clients::Clients;
use crate::connection::Close;
use crate::hub::{ClientId, Hub};
use crate::outbox::{ClientQueue, Outgoing};
use crate::socketcan::frame::{from_kernel, to_kernel};
use crate::socketcan::interface::{self, SocketCanError};
use crate::statistics::count;

/// Between two looks whether to end.
const LOOK: Duration = Duration::from_millis(50);
/// Between two attempts to write to an interface whose queue is full.
const RETRY: Duration = Duration::from_millis(1);
/// How long a frame may wait for an interface whose queue is full.
const PATIENCE: Duration = Duration::from_millis(200);

/// A CAN interface of Linux, virtual or real, coupled to a bus: whatever program uses the
/// interface takes part. Dropping it ends its threads; the interface stays.
///
/// CAN FD frames go through where the interface's MTU allows them (`ip link set vcan0 mtu 72`);
/// others are counted as [unfit](crate::BridgeStatistics::unfit). What the bridge itself writes does
/// not come back from the interface. Error frames are not passed on.
#[derive(Debug)]
pub struct SocketCanBridge {
    interface: String,
    clients: Clients,
    state: Arc<State>,
    threads: Vec<JoinHandle<()>>,
}

/// What the threads share.
#[derive(Debug, Default)]
struct State {
    is_closed: AtomicBool,
    /// Why the interface cannot be used any more.
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
    /// Opens an interface by its name; `queue` frames may wait for the bus, and for the interface.
    ///
    /// # Errors
    /// There is no such interface, it is down, the kernel has no CAN, or there is no thread.
    pub fn open(interface: &str, queue: usize) -> Result<Self, SocketCanError> {
        let socket = interface::open(interface)?;
        let failed = |error| SocketCanError::Open { interface: interface.to_owned(), error };
        Self::over(socket, interface, queue).map_err(failed)
    }

    /// Over a socket that is open.
    pub(super) fn over(socket: CanFdSocket, interface: &str, queue: usize) -> io::Result<Self> {
        // Where the queue of the socket is full a write waits no longer than that.
        socket.set_write_timeout(LOOK)?;
        let (hub, state) = (Arc::new(Hub::new(queue, 1)), Arc::new(State::default()));
        let outbox = Arc::new(ClientQueue::new(hub.queue()));
        // A new hub has room for one.
        let id = hub.join(Closing(state.clone()), outbox.clone());
        let id = id.ok_or(io::ErrorKind::ConnectionRefused)?;
        let clients = Clients(hub.clone());
        let threads = Vec::with_capacity(2);
        let mut bridge = Self { interface: interface.to_owned(), clients, state, threads };
        let socket = Arc::new(socket);
        let reader =
            Reader { socket: socket.clone(), hub: hub.clone(), state: bridge.state.clone(), id };
        let writer = Writer { socket, hub, state: bridge.state.clone(), is_stuck: false };
        let thread = |way: &str| thread::Builder::new().name(format!("{interface} {way}"));
        bridge.threads.push(thread("reader").spawn(move || reader.run())?);
        bridge.threads.push(thread("writer").spawn(move || writer.run(&outbox))?);
        Ok(bridge)
    }

    /// Name of the interface.
    pub fn interface(&self) -> &str {
        &self.interface
    }

    /// Its only client: the interface.
    pub fn clients(&self) -> &Clients {
        &self.clients
    }

    /// Why the interface cannot be used any more: it was removed. None as long as it can; one that is
    /// down may come up again.
    pub fn end(&self) -> Option<&io::Error> {
        self.state.end.get()
    }
}

impl Drop for SocketCanBridge {
    fn drop(&mut self) {
        self.clients.0.close();
        for thread in self.threads.drain(..) {
            // A panic in it has been reported on stderr already.
            let _ = thread.join();
        }
    }
}

/// Whether an error is this one.
fn is(error: &io::Error, errno: Errno) -> bool {
    error.raw_os_error() == Some(errno.raw_os_error())
}

/// From the interface to the bus.
struct Reader {
    socket: Arc<CanFdSocket>,
    hub: Arc<Hub>,
    state: Arc<State>,
    id: ClientId,
}

impl Reader {
    fn run(self) {
        while !self.state.is_closed() {
            match self.socket.read_frame_timeout(LOOK) {
                Ok(frame) => match from_kernel(&frame) {
                    Some(frame) => self.submit(frame),
                    None => count(&self.hub.counters.refused),
                },
                Err(error) => match error.kind() {
                    io::ErrorKind::TimedOut
                    | io::ErrorKind::WouldBlock
                    | io::ErrorKind::Interrupted => {}
                    // Neither a classic nor a CAN FD frame.
                    io::ErrorKind::InvalidData => count(&self.hub.counters.refused),
                    _ if is(&error, Errno::NODEV) || is(&error, Errno::NXIO) => {
                        let _ = self.state.end.set(error);
                        self.hub.leave(self.id);
                    }
                    // Down; it may come up again.
                    _ => thread::sleep(LOOK),
                },
            }
        }
    }

    fn submit(&self, frame: CanFrame) {
        // Before the bus is known nothing can be sent on it.
        let can_carry = self.hub.bus().is_some_and(|bus| bus.fd || !frame.is_fd());
        if !can_carry {
            count(&self.hub.counters.mismatched);
        }
        if !can_carry || !self.hub.submit(self.id, frame) {
            count(&self.hub.counters.refused);
        }
    }
}

/// From the bus to the interface.
struct Writer {
    socket: Arc<CanFdSocket>,
    hub: Arc<Hub>,
    state: Arc<State>,
    /// The frame before had to be dropped: those behind it do not wait.
    is_stuck: bool,
}

impl Writer {
    /// Until the hub has forgotten the client.
    fn run(mut self, outbox: &ClientQueue) {
        while let Some(outgoing) = outbox.take() {
            // There is nothing to answer to an interface.
            let Outgoing::Frame(frame, _) = outgoing else { continue };
            self.write(&frame);
        }
    }

    fn write(&mut self, frame: &CanFrame) {
        let Some(kernel) = to_kernel(frame) else { return count(&self.hub.counters.unfit) };
        let patience = if self.is_stuck { Duration::ZERO } else { PATIENCE };
        let start = Instant::now();
        loop {
            match self.socket.write_frame(&kernel) {
                Ok(()) => {
                    self.is_stuck = false;
                    return;
                }
                // An interface of classic CAN.
                Err(error) if is(&error, Errno::INVAL) && frame.is_fd() => {
                    return count(&self.hub.counters.unfit);
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => {
                    let is_full =
                        error.kind() == io::ErrorKind::WouldBlock || is(&error, Errno::NOBUFS);
                    if !is_full || self.state.is_closed() || start.elapsed() >= patience {
                        self.is_stuck = is_full;
                        return count(&self.hub.counters.dropped_to_clients);
                    }
                    thread::sleep(RETRY);
                }
            }
        }
    }
}
