//! The clients of a bridge: queues between the bus and their threads.

use std::collections::VecDeque;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use ecan_protocol::can::CanFrame;

use crate::bus_event::{BusEvent, ErrorCounters, ErrorFrame};
use crate::client_queue::ClientQueue;
use crate::connection::Close;
use crate::rates::BusRates;
use crate::statistics::{BridgeStatistics, Counters, count};

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
}

impl Client {
    fn close(&self) {
        self.queue.close();
        self.connection.close();
    }
}

#[derive(Debug, Default)]
struct State {
    /// The bus accepts no frames of clients.
    is_closed_to_clients: bool,
    waiting_clients: usize,
    clients: Vec<Client>,
    next_client: ClientId,
    closed: bool,
    /// Frames for the bus, with their senders.
    inbox: VecDeque<ClientFrame>,
    /// Bit rates of the bus, once known.
    bus: Option<BusRates>,
}

impl State {
    fn report_result(&self, frame: &ClientFrame, sent_ns: Option<u64>) {
        if let Some(sender) = self.clients.iter().find(|client| client.id == frame.client) {
            sender.queue.report_result(frame.tag, sent_ns);
        }
    }
}

/// The clients of one bridge, with bounded queues. No public method blocks.
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

    /// Counters of the bridge.
    pub fn statistics(&self) -> BridgeStatistics {
        self.counters.read(self.lock().clients.len())
    }

    /// Admits a client; `connection` is closed when it leaves.
    pub(crate) fn join(
        &self,
        connection: impl Close + 'static,
        queue: Arc<ClientQueue>,
    ) -> Option<ClientId> {
        let mut state = self.lock();
        if state.closed || state.clients.len() >= self.max_clients {
            count(&self.counters.rejected_clients);
            return None;
        }
        let id = state.next_client;
        state.next_client += 1;
        state.clients.push(Client { id, queue, connection: Box::new(connection) });
        count(&self.counters.connections);
        Some(id)
    }

    /// Removes a client and closes its connection. Its waiting frames remain.
    pub(crate) fn leave(&self, id: ClientId) {
        let mut state = self.lock();
        if let Some(at) = state.clients.iter().position(|client| client.id == id) {
            state.clients.swap_remove(at).close();
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

    /// Queues a client's frame for the bus; returns false if the queue is full or the bus accepts
    /// none.
    pub(crate) fn submit(&self, frame: ClientFrame) -> bool {
        let mut state = self.lock();
        let has_room = state.inbox.len() < self.queue;
        if state.is_closed_to_clients {
            count(&self.counters.discarded);
        } else if has_room {
            state.inbox.push_back(frame);
        } else {
            count(&self.counters.dropped_to_bus);
        }
        has_room && !state.is_closed_to_clients
    }

    /// As [`submit`](Self::submit), but waits for space while the client is connected.
    pub(crate) fn submit_when_possible(&self, frame: ClientFrame) {
        let mut state = self.lock();
        loop {
            let is_there = state.clients.iter().any(|client| client.id == frame.client);
            if state.is_closed_to_clients || !is_there {
                return count(&self.counters.discarded);
            }
            if state.inbox.len() < self.queue {
                return state.inbox.push_back(frame);
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
    /// Returns the number of frames discarded by this call.
    pub fn set_accepting(&self, is_accepting: bool) -> usize {
        let mut state = self.lock();
        state.is_closed_to_clients = !is_accepting;
        if is_accepting {
            return 0;
        }
        let dropped = state.inbox.len();
        for frame in std::mem::take(&mut state.inbox) {
            state.report_result(&frame, None);
        }
        self.wake(&state);
        self.counters.discarded.fetch_add(dropped as u64, Ordering::Relaxed);
        dropped
    }

    /// Takes the next frame of a client for the bus.
    pub fn next_for_bus(&self) -> Option<ClientFrame> {
        let mut state = self.lock();
        let next = state.inbox.pop_front();
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
        self.lock().report_result(sent, Some(time_ns));
        self.deliver(&sent.frame, time_ns, Some(sent.client));
    }

    /// Reports that a client's frame was not sent.
    pub fn fail(&self, frame: &ClientFrame) {
        count(&self.counters.failed);
        self.lock().report_result(frame, None);
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
