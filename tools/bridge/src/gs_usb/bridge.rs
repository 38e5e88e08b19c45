//! The emulated device as the only client of a bridge.

use std::collections::{HashMap, VecDeque};
use std::io::{self, Write as _};
use std::net::Shutdown;
use std::os::fd::AsFd as _;
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::{self, JoinHandle};

use ecan_protocol::can::CanFrame;
use rustix::io::Errno;

use crate::client_queue::{ClientQueue, Outgoing, Reports};
use crate::clients::{ClientFrame, ClientId, Clients};
use crate::connection::Close;
use crate::gs_usb::control::{self, Change};
use crate::gs_usb::host_frame::{self, EchoId};
use crate::gs_usb::usbip::{self, Request, Transfer};
use crate::gs_usb::virtual_port;
use crate::rates::BusRates;
use crate::statistics::count;

const ENDPOINT_IN: u32 = 1;
const ENDPOINT_OUT: u32 = 2;
/// Status of a transfer that the device rejects, and of one whose frame was not sent.
const REJECTED: i32 = Errno::PIPE.raw_os_error().wrapping_neg();
const CANCELLED: i32 = Errno::CONNRESET.raw_os_error().wrapping_neg();

/// Distinguishes the devices of a process.
static DEVICES: AtomicU32 = AtomicU32::new(1);

/// A CAN interface of the kernel's driver gs_usb, connected to a bus. The interface exists as long
/// as this value, also if the process is killed.
///
/// Programs receive a frame of the interface, and its sender the confirmation, when the bus has
/// [confirmed](Clients::confirm) it; a [failed](Clients::fail) one counts in the statistics of the
/// interface. Senders get ENOBUFS while the queues are full. Frames have the time stamps of the bus
/// as hardware time stamps. [Events of the bus](crate::BusEvent) set the state of the interface.
#[derive(Debug)]
pub struct UsbCanBridge {
    interface: String,
    clients: Arc<Clients>,
    device: Arc<Device>,
    threads: Vec<JoinHandle<()>>,
}

impl UsbCanBridge {
    /// Creates an interface with this name and the bit rates of the bus, and sets it up; `queue` is
    /// the capacity in frames of the queues. Requires CAP_SYS_ADMIN and CAP_NET_ADMIN.
    ///
    /// # Errors
    /// The kernel has no vhci-hcd or gs_usb, a permission is missing, or no thread is available.
    pub fn create(interface: &str, queue: usize, rates: BusRates) -> Result<Self, String> {
        virtual_port::load_modules()?;
        let failed = |error: io::Error| error.to_string();
        let (ours, kernel) = UnixStream::pair().map_err(failed)?;
        let number = DEVICES.fetch_add(1, Ordering::Relaxed);
        let serial = format!("ecan-{}-{number}", std::process::id());
        let bridge = Self::over(ours, interface, serial.clone(), queue, rates).map_err(failed)?;
        virtual_port::attach(kernel.as_fd(), number)?;
        drop(kernel);
        let found = virtual_port::interface_of(&serial)?;
        virtual_port::set_up(&found, interface, rates)?;
        Ok(bridge)
    }

    pub(super) fn over(
        socket: UnixStream,
        interface: &str,
        serial: String,
        queue: usize,
        rates: BusRates,
    ) -> io::Result<Self> {
        let clients = Arc::new(Clients::new(queue, 1));
        clients.set_bus(rates);
        let reports = Reports::EventsAndResults;
        let queue = Arc::new(ClientQueue::with_reports(clients.queue(), reports));
        let id = clients.join(Closing(socket.try_clone()?), None, queue.clone());
        let id = id.ok_or(io::ErrorKind::ConnectionRefused)?;
        let device = Arc::new(Device {
            socket,
            writing: Mutex::default(),
            state: Mutex::default(),
            changed: Condvar::new(),
            clients: clients.clone(),
            id,
            serial,
            rates,
            end: OnceLock::new(),
        });
        let thread = |task: &str| thread::Builder::new().name(format!("{interface} {task}"));
        let (reader, writer) = (device.clone(), device.clone());
        let mut bridge =
            Self { interface: interface.to_owned(), clients, device, threads: Vec::new() };
        bridge.threads.push(thread("reader").spawn(move || reader.read_all())?);
        bridge.threads.push(thread("writer").spawn(move || writer.write_all(&queue))?);
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

    /// The error if the kernel has detached the device; `None` otherwise.
    pub fn end(&self) -> Option<&io::Error> {
        self.device.end.get()
    }
}

impl Drop for UsbCanBridge {
    fn drop(&mut self) {
        self.clients.close();
        for thread in self.threads.drain(..) {
            // A panic in it has been reported on stderr already.
            let _ = thread.join();
        }
    }
}

#[derive(Debug)]
struct Closing(UnixStream);

impl Close for Closing {
    fn close(&self) {
        let _ = self.0.shutdown(Shutdown::Both);
    }
}

/// A frame of the driver without result.
#[derive(Clone, Copy, Debug)]
struct SentFrame {
    echo: EchoId,
    frame: CanFrame,
    length: usize,
}

#[derive(Debug, Default)]
struct State {
    is_started: bool,
    is_closed: bool,
    /// Transfers in which the kernel waits for frames.
    waiting: VecDeque<u32>,
    sent: HashMap<u32, SentFrame>,
}

#[derive(Debug)]
struct Device {
    socket: UnixStream,
    /// Locked while a message is written.
    writing: Mutex<()>,
    state: Mutex<State>,
    changed: Condvar,
    clients: Arc<Clients>,
    id: ClientId,
    serial: String,
    rates: BusRates,
    end: OnceLock<io::Error>,
}

impl Device {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self, message: &[u8]) {
        let _turn = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        // The reader detects the end.
        let _ = (&self.socket).write_all(message);
    }

    fn read_all(&self) {
        let error = loop {
            match Request::read(&mut &self.socket) {
                Ok(Request::Submit(transfer)) => self.submit(&transfer),
                Ok(Request::Unlink { number, victim }) => self.unlink(number, victim),
                Err(error) => break error,
            }
        };
        if !self.clients.is_closed() {
            let _ = self.end.set(error);
        }
        self.lock().is_closed = true;
        self.changed.notify_all();
        self.clients.leave(self.id);
    }

    fn submit(&self, transfer: &Transfer) {
        match (transfer.endpoint, transfer.is_in) {
            (0, _) => self.control(transfer),
            (ENDPOINT_IN, true) => {
                self.lock().waiting.push_back(transfer.number);
                self.changed.notify_all();
            }
            (ENDPOINT_OUT, false) => self.send(transfer),
            _ => self.write(&usbip::fail(transfer.number, REJECTED)),
        }
    }

    fn control(&self, transfer: &Transfer) {
        let response = control::respond(transfer.setup, &transfer.data, &self.serial, self.rates);
        let Some((mut data, change)) = response else {
            return self.write(&usbip::fail(transfer.number, REJECTED));
        };
        match change {
            Change::None => {}
            Change::Started => self.lock().is_started = true,
            Change::Stopped => self.lock().is_started = false,
        }
        self.changed.notify_all();
        data.truncate(transfer.length);
        self.write(&match transfer.is_in {
            true => usbip::complete_in(transfer.number, &data),
            false => usbip::complete_out(transfer.number, transfer.length),
        });
    }

    /// Takes a frame of the driver. Its transfer ends with the result.
    fn send(&self, transfer: &Transfer) {
        let number = transfer.number;
        let decoded = host_frame::decode(&transfer.data);
        let Some((echo, frame)) = decoded.filter(|(_, frame)| self.rates.fd || !frame.is_fd())
        else {
            count(&self.clients.counters.mismatched);
            count(&self.clients.counters.rejected);
            return self.write(&usbip::fail(number, REJECTED));
        };
        let length = transfer.length;
        self.lock().sent.insert(number, SentFrame { echo, frame, length });
        if !self.clients.submit(ClientFrame { client: self.id, frame, tag: number }) {
            count(&self.clients.counters.rejected);
            self.finish(number, None);
        }
    }

    fn unlink(&self, number: u32, victim: u32) {
        let mut state = self.lock();
        let before = state.waiting.len();
        state.waiting.retain(|waiting| *waiting != victim);
        // The result of a cancelled frame is ignored.
        let is_found = state.waiting.len() < before || state.sent.remove(&victim).is_some();
        drop(state);
        self.write(&usbip::unlinked(number, if is_found { CANCELLED } else { 0 }));
    }

    fn write_all(&self, queue: &ClientQueue) {
        let mut dropped_before = 0;
        while let Some(outgoing) = queue.take() {
            match outgoing {
                Outgoing::Frame(frame, time_ns) => {
                    let dropped = self.clients.counters.dropped_to_clients.load(Ordering::Relaxed);
                    let has_overflow = dropped > dropped_before;
                    dropped_before = dropped;
                    self.pass(&host_frame::encode(None, &frame, time_ns, has_overflow));
                }
                Outgoing::Error(error, time_ns) => {
                    self.pass(&host_frame::encode_error(error, time_ns));
                }
                Outgoing::Result(number, sent_ns) => self.finish(number, sent_ns),
                // An interface gets no answers.
                Outgoing::Answer(..) | Outgoing::Lost(..) => {}
            }
        }
    }

    /// Ends the transfer of a frame, with its echo if it was sent.
    fn finish(&self, number: u32, sent_ns: Option<u64>) {
        let Some(SentFrame { echo, frame, length }) = self.lock().sent.remove(&number) else {
            return;
        };
        let Some(sent_ns) = sent_ns else {
            return self.write(&usbip::fail(number, REJECTED));
        };
        self.write(&usbip::complete_out(number, length));
        self.pass(&host_frame::encode(Some(echo), &frame, sent_ns, false));
    }

    /// Passes a frame to the driver when it waits for one. Without effect while the interface is
    /// down.
    fn pass(&self, bytes: &[u8]) {
        let is_waiting =
            |state: &mut State| !state.is_closed && state.is_started && state.waiting.is_empty();
        let waited = self.changed.wait_while(self.lock(), is_waiting);
        let mut state = waited.unwrap_or_else(PoisonError::into_inner);
        let number = if state.is_started { state.waiting.pop_front() } else { None };
        drop(state);
        if let Some(number) = number {
            self.write(&usbip::complete_in(number, bytes));
        }
    }
}
