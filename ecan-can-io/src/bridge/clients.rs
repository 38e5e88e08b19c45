//! The clients of a bridge: queues between the bus and their threads.

use super::client_queue::ClientQueue;
use super::server::Close;
use ecan_protocol::can::CanFrame;
use std::collections::VecDeque;
use std::net::IpAddr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Identifies a client of one bridge.
pub type ClientId = u64;

/// A frame of a client for the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClientFrame {
    /// Sender.
    pub client: ClientId,
    /// The frame.
    pub frame: CanFrame,
    /// Number by which the sender recognises the result.
    pub(crate) tag: u32,
}

#[derive(Debug)]
struct Client {
    id: ClientId,
    queue: Arc<ClientQueue>,
    connection: Box<dyn Close>,
    peer: Option<IpAddr>,
    /// The client has opened the bus. Until then its place is free for others if all are occupied.
    has_opened: bool,
}

impl Client {
    fn close(&self) {
        self.queue.close();
        self.connection.close();
    }
}

/// Frames of one client for the bus, at least one.
#[derive(Debug)]
struct Inbox {
    client: ClientId,
    frames: VecDeque<ClientFrame>,
}

#[derive(Debug, Default)]
struct State {
    /// The bus accepts no frames of clients.
    is_closed_to_clients: bool,
    waiting_clients: usize,
    clients: Vec<Client>,
    next_client: ClientId,
    closed: bool,
    /// Frames for the bus, in the order of the turns. The inbox of a client that has left remains
    /// until it is empty.
    inboxes: VecDeque<Inbox>,
    /// Bit rates of the bus, once known.
    bus: Option<BusRates>,
}

impl State {
    fn client(&self, id: ClientId) -> Option<&Client> {
        self.clients.iter().find(|client| client.id == id)
    }

    /// Queues a frame in the inbox of its client; returns false if that holds `limit` frames.
    fn push(&mut self, frame: ClientFrame, limit: usize) -> bool {
        let inbox = self.inboxes.iter_mut().find(|inbox| inbox.client == frame.client);
        match inbox {
            Some(inbox) if inbox.frames.len() >= limit => return false,
            Some(inbox) => inbox.frames.push_back(frame),
            None => {
                let (client, frames) = (frame.client, VecDeque::from([frame]));
                self.inboxes.push_back(Inbox { client, frames });
            }
        }
        true
    }

    /// Removes the next frame: the inboxes have turns of one frame.
    fn pop(&mut self) -> Option<ClientFrame> {
        let mut inbox = self.inboxes.pop_front()?;
        let frame = inbox.frames.pop_front();
        if !inbox.frames.is_empty() {
            self.inboxes.push_back(inbox);
        }
        frame
    }

    /// Removes the largest inbox of a client that has left if there are more than `limit` of them;
    /// returns the number of its frames. Clients that connect, send and leave again and again thus
    /// lose their own frames.
    fn drop_excess_inbox(&mut self, limit: usize) -> usize {
        let has_left = |inbox: &Inbox| self.client(inbox.client).is_none();
        let left = || self.inboxes.iter().enumerate().filter(|(_, inbox)| has_left(inbox));
        if left().count() <= limit {
            return 0;
        }
        let largest = left().max_by_key(|(_, inbox)| inbox.frames.len()).map(|(at, _)| at);
        let dropped = largest.and_then(|at| self.inboxes.remove(at));
        dropped.map_or(0, |inbox| inbox.frames.len())
    }

    /// Removes the client that has to leave if all places are occupied: the oldest of those that
    /// have not opened the bus, from the address with the most such clients.
    fn remove_silent(&mut self) -> Option<Client> {
        let silent = || self.clients.iter().filter(|client| !client.has_opened);
        let from_same =
            |client: &Client| silent().filter(|other| other.peer == client.peer).count();
        let rank = |client: &&Client| (from_same(client), std::cmp::Reverse(client.id));
        let id = silent().max_by_key(rank)?.id;
        let at = self.clients.iter().position(|client| client.id == id)?;
        Some(self.clients.swap_remove(at))
    }
}

/// The clients of one bridge, with bounded queues. No public method blocks.
///
/// Each client has a queue to the bus of its own, and they take turns: a client that sends more than
/// the bus carries loses its own frames only. A frame of any length occupies the same memory,
/// so the limit in frames is a limit in bytes.
#[derive(Debug)]
pub struct Clients {
    state: Mutex<State>,
    queue: usize,
    max_clients: usize,
    /// Space is available, or waiting has become pointless.
    changed: Condvar,
    pub(crate) counters: Counters,
}

impl Clients {
    pub(crate) fn new(queue: usize, max_clients: usize) -> Self {
        let (changed, counters) = (Condvar::new(), Counters::default());
        Self { state: Mutex::default(), queue: queue.max(1), max_clients, changed, counters }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn queue(&self) -> usize {
        self.queue
    }

    /// Maximum number of clients.
    pub fn max_clients(&self) -> usize {
        self.max_clients
    }

    /// Counters of the bridge.
    pub fn statistics(&self) -> BridgeStatistics {
        self.counters.read(self.lock().clients.len())
    }

    /// Admits a client; `connection` is closed when it leaves. If all places are occupied, a client
    /// that has not opened the bus loses its place.
    pub(crate) fn join(
        &self,
        connection: impl Close + 'static,
        peer: Option<IpAddr>,
        queue: Arc<ClientQueue>,
    ) -> Option<ClientId> {
        let mut state = self.lock();
        if !state.closed
            && state.clients.len() >= self.max_clients
            && let Some(silent) = state.remove_silent()
        {
            count(&self.counters.silent_clients);
            silent.close();
        }
        if state.closed || state.clients.len() >= self.max_clients {
            count(&self.counters.rejected_clients);
            return None;
        }
        let id = state.next_client;
        state.next_client += 1;
        let connection = Box::new(connection);
        state.clients.push(Client { id, queue, connection, peer, has_opened: false });
        count(&self.counters.connections);
        Some(id)
    }

    /// The client has opened the bus: it keeps its place until it leaves.
    pub(crate) fn keep(&self, id: ClientId) {
        if let Some(client) = self.lock().clients.iter_mut().find(|client| client.id == id) {
            client.has_opened = true;
        }
    }

    /// Removes a client and closes its connection. Its waiting frames remain; of the clients that have
    /// left, at most `max_clients` have waiting frames.
    pub(crate) fn leave(&self, id: ClientId) {
        let mut state = self.lock();
        if let Some(at) = state.clients.iter().position(|client| client.id == id) {
            state.clients.swap_remove(at).close();
            let dropped = state.drop_excess_inbox(self.max_clients);
            self.counters.dropped_to_bus.fetch_add(dropped as u64, Ordering::Relaxed);
            self.wake(&state);
        }
    }

    /// Closes every connection and admits no further client.
    pub(crate) fn close(&self) {
        let mut state = self.lock();
        state.closed = true;
        for client in state.clients.drain(..) {
            client.close();
        }
        self.wake(&state);
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.lock().closed
    }

    pub(crate) fn bus(&self) -> Option<BusRates> {
        self.lock().bus
    }

    /// Queues a client's frame for the bus; returns false if its queue is full or the bus accepts
    /// none.
    pub(crate) fn submit(&self, frame: ClientFrame) -> bool {
        let mut state = self.lock();
        if state.is_closed_to_clients {
            count(&self.counters.discarded);
            return false;
        }
        let has_room = state.push(frame, self.queue);
        if !has_room {
            count(&self.counters.dropped_to_bus);
        }
        has_room
    }

    /// As [`submit`](Self::submit), but waits for space while the client is connected.
    pub(crate) fn submit_when_possible(&self, frame: ClientFrame) {
        let mut state = self.lock();
        loop {
            if state.is_closed_to_clients || state.client(frame.client).is_none() {
                return count(&self.counters.discarded);
            }
            if state.push(frame, self.queue) {
                return;
            }
            state.waiting_clients += 1;
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
            state.waiting_clients -= 1;
        }
    }

    fn wake(&self, state: &State) {
        if state.waiting_clients > 0 {
            self.changed.notify_all();
        }
    }

    /// Sets the bit rates of the bus.
    pub fn set_bus(&self, rates: BusRates) {
        self.lock().bus = Some(rates);
    }

    /// Returns whether a client is connected.
    pub fn is_any_connected(&self) -> bool {
        !self.lock().clients.is_empty()
    }

    /// Sets whether the bus accepts frames of clients; by default it does. While it does not, new
    /// frames are rejected and waiting frames are discarded, because they would be stale later.
    /// Their clients receive a report of the loss. Returns the number of frames discarded by this
    /// call, at a time in nanoseconds of the bus's clock.
    pub fn set_accepting(&self, is_accepting: bool, time_ns: u64) -> usize {
        let mut state = self.lock();
        state.is_closed_to_clients = !is_accepting;
        if is_accepting {
            return 0;
        }
        let mut dropped = 0;
        for inbox in std::mem::take(&mut state.inboxes) {
            dropped += inbox.frames.len();
            let Some(sender) = state.client(inbox.client) else { continue };
            inbox.frames.iter().for_each(|frame| sender.queue.report_lost(frame.tag, time_ns));
            if !sender.queue.offer_loss_event(time_ns) {
                count(&self.counters.dropped_to_clients);
            }
        }
        self.wake(&state);
        self.counters.discarded.fetch_add(dropped as u64, Ordering::Relaxed);
        dropped
    }

    /// Takes the next frame of a client for the bus. The clients take turns.
    pub fn next_for_bus(&self) -> Option<ClientFrame> {
        let mut state = self.lock();
        let next = state.pop();
        self.wake(&state);
        next
    }

    /// Counts a client frame that was sent on the bus.
    pub fn count_sent(&self) {
        count(&self.counters.sent);
    }

    /// Reports that a client's frame was sent on the bus, with its end time: all other clients
    /// receive the frame, and a CAN interface echoes it to its programs.
    pub fn confirm(&self, sent: &ClientFrame, time_ns: u64) {
        self.count_sent();
        if let Some(sender) = self.lock().client(sent.client) {
            sender.queue.report_sent(sent.tag, time_ns);
        }
        self.deliver(&sent.frame, time_ns, Some(sent.client));
    }

    /// Reports to a client that its frame was not sent, or that the result is unknown.
    pub fn fail(&self, frame: &ClientFrame, time_ns: u64) {
        count(&self.counters.failed);
        if let Some(sender) = self.lock().client(frame.client) {
            sender.queue.report_lost(frame.tag, time_ns);
        }
    }

    /// Reports an event of the bus to the CAN interfaces, with the error counters if they are known.
    pub fn report(&self, event: BusEvent, counters: Option<ErrorCounters>, time_ns: u64) {
        let error = ErrorFrame::of(event, counters);
        for client in &self.lock().clients {
            if !client.queue.offer_error(error, time_ns) {
                count(&self.counters.dropped_to_clients);
            }
        }
    }

    /// Passes a frame of the bus to every client except its sender, with its end time in
    /// nanoseconds of the bus's clock.
    pub fn deliver(&self, frame: &CanFrame, time_ns: u64, sender: Option<ClientId>) {
        for client in self.lock().clients.iter().filter(|client| Some(client.id) != sender) {
            let counters = &self.counters;
            let is_taken = client.queue.offer(frame, time_ns);
            count(if is_taken { &counters.delivered } else { &counters.dropped_to_clients });
        }
    }
}

macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// Counters of a bridge.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct BridgeStatistics {
            /// Number of connected clients.
            pub clients: usize,
            $($(#[$doc])* pub $name: u64,)*
        }

        /// The same counters, for several threads.
        #[derive(Debug, Default)]
        pub(crate) struct Counters {
            $(pub(crate) $name: AtomicU64,)*
        }

        impl Counters {
            pub(crate) fn read(&self, clients: usize) -> BridgeStatistics {
                BridgeStatistics { clients, $($name: self.$name.load(Ordering::Relaxed),)* }
            }
        }
    };
}

counters! {
    /// Number of connections, without rejected clients.
    connections,
    /// Number of clients rejected because too many were connected.
    rejected_clients,
    /// Number of connections closed because their client did not open the bus: within the time for
    /// it, or before another client needed the place.
    silent_clients,
    /// Client frames that were sent on the bus.
    sent,
    /// Client frames that were passed to the bus and not sent, or without result.
    failed,
    /// Client frames rejected because the queue to the bus was full.
    dropped_to_bus,
    /// Client frames rejected or discarded because the bus accepted none, for example while the
    /// gateway was not ready.
    discarded,
    /// Frames put into the queue of a client, including those outside its receive settings.
    delivered,
    /// Frames dropped because the queue of a client was full.
    dropped_to_clients,
    /// Commands and frames of clients that were rejected: malformed, unknown, at the wrong time, or
    /// for one of the reasons counted separately.
    rejected,
    /// Client frames rejected because of the client's bit rate, or because a CAN FD frame was for a
    /// classic bus.
    mismatched,
    /// Frames of the bus that the client cannot represent: CAN FD on a classic CAN interface.
    unsupported,
}

pub(crate) fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// Bit rates of a bus. Plain data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusRates {
    /// Bit rate of the arbitration phase in bit/s.
    pub nominal_bitrate: u32,
    /// Bit rate of the data phase of CAN FD frames with bit rate switch in bit/s.
    pub data_bitrate: u32,
    /// True if CAN FD frames can be on the bus.
    pub fd: bool,
}

impl BusRates {
    /// A classic bus.
    #[must_use]
    pub const fn classic(bitrate: u32) -> Self {
        Self { nominal_bitrate: bitrate, data_bitrate: bitrate, fd: false }
    }

    /// A CAN FD bus.
    #[must_use]
    pub const fn fd(nominal_bitrate: u32, data_bitrate: u32) -> Self {
        Self { nominal_bitrate, data_bitrate, fd: true }
    }
}

/// Event of a bus. CAN interfaces receive it as an error frame (`candump -e`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusEvent {
    /// The controller is off the bus after too many errors.
    BusOff,
    /// The controller takes part again after bus-off.
    Restarted,
    /// Error active again.
    ErrorActive,
    /// Error warning: an error counter has reached 96, or the gateway reports many errors.
    ErrorWarning,
    /// Error passive: an error counter has reached 128.
    ErrorPassive,
    /// No node acknowledges the pending frames.
    NotAcknowledged,
    /// The frame lost arbitration and was not sent.
    LostArbitration,
    /// A frame was dropped: a queue to the bus was full.
    TransmitOverflow,
    /// Frames from the bus were dropped: a queue was full.
    ReceiveOverflow,
    /// The frame was not sent for another reason, or its result is unknown.
    TransmitFailed,
}

/// Error counters of a CAN controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ErrorCounters {
    /// Transmit error counter.
    pub transmit: u8,
    /// Receive error counter.
    pub receive: u8,
}

const TX_TIMEOUT: u32 = 0x001;
const LOST_ARBITRATION: u32 = 0x002;
const CONTROLLER: u32 = 0x004;
const NOT_ACKNOWLEDGED: u32 = 0x020;
const BUS_OFF: u32 = 0x040;
const RESTARTED: u32 = 0x100;
const COUNTERS: u32 = 0x200;

const RX_OVERFLOW: u8 = 0x01;
const TX_OVERFLOW: u8 = 0x02;
const RX_WARNING: u8 = 0x04;
const TX_WARNING: u8 = 0x08;
const RX_PASSIVE: u8 = 0x10;
const TX_PASSIVE: u8 = 0x20;
const ACTIVE: u8 = 0x40;

/// An error frame: the error classes of its CAN ID, and 8 data bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ErrorFrame {
    pub(crate) class: u32,
    pub(crate) data: [u8; 8],
}

impl ErrorFrame {
    pub(crate) fn of(event: BusEvent, counters: Option<ErrorCounters>) -> Self {
        let controller = |problem| (CONTROLLER, problem);
        // The direction whose counter has reached the limit; both if the counters are unknown.
        let level = |limit: u8, tx: u8, rx: u8| match counters {
            Some(it) if it.transmit >= limit && it.receive < limit => controller(tx),
            Some(it) if it.receive >= limit && it.transmit < limit => controller(rx),
            _ => controller(tx | rx),
        };
        let (mut class, problem) = match event {
            BusEvent::BusOff => (BUS_OFF, 0),
            BusEvent::Restarted => (RESTARTED, 0),
            BusEvent::ErrorActive => controller(ACTIVE),
            BusEvent::ErrorWarning => level(96, TX_WARNING, RX_WARNING),
            BusEvent::ErrorPassive => level(128, TX_PASSIVE, RX_PASSIVE),
            BusEvent::NotAcknowledged => (NOT_ACKNOWLEDGED, 0),
            BusEvent::LostArbitration => (LOST_ARBITRATION, 0),
            BusEvent::TransmitOverflow => controller(TX_OVERFLOW),
            BusEvent::ReceiveOverflow => controller(RX_OVERFLOW),
            BusEvent::TransmitFailed => (TX_TIMEOUT, 0),
        };
        let mut data = [0, problem, 0, 0, 0, 0, 0, 0];
        if let Some(ErrorCounters { transmit, receive }) = counters {
            class |= COUNTERS;
            (data[6], data[7]) = (transmit, receive);
        }
        Self { class, data }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Classes and data as the drivers of Linux report them (`linux/can/error.h`).
    #[test]
    fn events_have_the_codes_of_linux() {
        let frame = |event, counters: Option<[u8; 2]>| {
            let counters = counters.map(|[transmit, receive]| ErrorCounters { transmit, receive });
            let ErrorFrame { class, data } = ErrorFrame::of(event, counters);
            (class, data)
        };
        assert_eq!(frame(BusEvent::BusOff, None), (0x40, [0; 8]));
        assert_eq!(frame(BusEvent::Restarted, None), (0x100, [0; 8]));
        assert_eq!(frame(BusEvent::LostArbitration, None), (2, [0; 8]));
        assert_eq!(frame(BusEvent::NotAcknowledged, None), (0x20, [0; 8]));
        assert_eq!(frame(BusEvent::TransmitFailed, None), (1, [0; 8]));
        assert_eq!(frame(BusEvent::ErrorActive, None), (4, [0, 0x40, 0, 0, 0, 0, 0, 0]));
        assert_eq!(frame(BusEvent::ErrorWarning, None), (4, [0, 0x0C, 0, 0, 0, 0, 0, 0]));
        let warning = (0x204, [0, 0x08, 0, 0, 0, 0, 100, 3]);
        assert_eq!(frame(BusEvent::ErrorWarning, Some([100, 3])), warning);
        let passive = (0x204, [0, 0x10, 0, 0, 0, 0, 3, 130]);
        assert_eq!(frame(BusEvent::ErrorPassive, Some([3, 130])), passive);
        assert_eq!(frame(BusEvent::TransmitOverflow, None), (4, [0, 2, 0, 0, 0, 0, 0, 0]));
        assert_eq!(frame(BusEvent::ReceiveOverflow, None), (4, [0, 1, 0, 0, 0, 0, 0, 0]));
    }
}
