//! The clients of a bridge: queues between the bus and their threads.

use std::collections::VecDeque;
use std::net::IpAddr;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use ecan_protocol::can::CanFrame;

use super::config::{
    BridgeStatistics, BusEvent, BusRates, Counters, ErrorCounters, ErrorFrame, count,
};
use crate::bridge::client_queue::ClientQueue;
use crate::bridge::connection::Close;

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
    /// The bus accepts no frames of clients, since this time of its clock.
    closed_to_clients_ns: Option<u64>,
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

    /// Queues a client's frame for the bus, and waits for space while the client is connected: its connection stops
    /// it. Returns false if the bus accepts none.
    pub(crate) fn submit(&self, frame: ClientFrame) -> bool {
        let mut state = self.lock();
        loop {
            if state.closed_to_clients_ns.is_some() || state.client(frame.client).is_none() {
                count(&self.counters.discarded);
                return false;
            }
            if state.push(frame, self.queue) {
                return true;
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
        state.closed_to_clients_ns = (!is_accepting).then_some(time_ns);
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

    /// Reports to a client that a frame of it was not accepted.
    pub(crate) fn reject(&self, id: ClientId) {
        let state = self.lock();
        let time_ns = state.closed_to_clients_ns.unwrap_or(0);
        if let Some(client) = state.client(id) {
            client.queue.report_lost(0, time_ns);
        }
    }

    /// Reports an event of the bus, with the error counters if they are known.
    pub fn report(&self, event: BusEvent, counters: Option<ErrorCounters>, time_ns: u64) {
        let error = ErrorFrame::of(event, counters);
        for client in &self.lock().clients {
            if !client.queue.offer_event(event, error, time_ns) {
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
