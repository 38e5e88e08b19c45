//! Where the bus and the threads of its clients meet.

use std::collections::VecDeque;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use ecan_protocol::can::CanFrame;

use crate::connection::Close;
use crate::outbox::ClientQueue;
use crate::rates::BusRates;
use crate::statistics::{BridgeStatistics, Counters, count};

/// Names a client of one bridge.
pub type ClientId = u64;

/// A client as the bus sees it.
#[derive(Debug)]
struct Client {
    id: ClientId,
    outbox: Arc<ClientQueue>,
    connection: Box<dyn Close>,
}

impl Client {
    fn close(&self) {
        self.outbox.close();
        self.connection.close();
    }
}

#[derive(Debug, Default)]
struct State {
    /// The bus takes no frames of clients.
    is_barred: bool,
    /// Clients that wait for room.
    held_back: usize,
    clients: Vec<Client>,
    next_client: ClientId,
    closed: bool,
    /// Frames for the bus, with their senders.
    inbox: VecDeque<(ClientId, CanFrame)>,
    /// The bit rates of the bus, once they are known.
    bus: Option<BusRates>,
}

/// Bounded queues between the bus and the clients. Nothing that the bus does blocks.
#[derive(Debug)]
pub(crate) struct Hub {
    state: Mutex<State>,
    queue: usize,
    max_clients: usize,
    /// There is room again, or no use in waiting for it.
    changed: Condvar,
    pub(crate) counters: Counters,
}

impl Hub {
    pub(crate) fn new(queue: usize, max_clients: usize) -> Self {
        let (changed, counters) = (Condvar::new(), Counters::default());
        Self { state: Mutex::default(), queue: queue.max(1), max_clients, changed, counters }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Places in a client's queue.
    pub(crate) fn queue(&self) -> usize {
        self.queue
    }

    pub(crate) fn statistics(&self) -> BridgeStatistics {
        self.counters.read(self.lock().clients.len())
    }

    // Clients

    /// Admits a client; `connection` is closed with it.
    pub(crate) fn join(
        &self,
        connection: impl Close + 'static,
        outbox: Arc<ClientQueue>,
    ) -> Option<ClientId> {
        let mut state = self.lock();
        if state.closed || state.clients.len() >= self.max_clients {
            count(&self.counters.turned_away);
            return None;
        }
        let id = state.next_client;
        state.next_client += 1;
        state.clients.push(Client { id, outbox, connection: Box::new(connection) });
        count(&self.counters.connections);
        Some(id)
    }

    /// Forgets a client and closes its connection. Its frames that wait for the bus stay.
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

    /// The bit rates of the bus; `None` before they are known.
    pub(crate) fn bus(&self) -> Option<BusRates> {
        self.lock().bus
    }

    /// A client's frame for the bus; false when too many wait already, or the bus takes none.
    pub(crate) fn submit(&self, id: ClientId, frame: CanFrame) -> bool {
        let mut state = self.lock();
        let has_room = state.inbox.len() < self.queue;
        if state.is_barred {
            count(&self.counters.not_taken);
        } else if has_room {
            state.inbox.push_back((id, frame));
        } else {
            count(&self.counters.dropped_to_bus);
        }
        has_room && !state.is_barred
    }

    /// As [`submit`](Self::submit), but waits while too many wait already and the client is there.
    pub(crate) fn submit_when_possible(&self, id: ClientId, frame: CanFrame) {
        let mut state = self.lock();
        loop {
            let is_there = state.clients.iter().any(|client| client.id == id);
            if state.is_barred || !is_there {
                return count(&self.counters.not_taken);
            }
            if state.inbox.len() < self.queue {
                return state.inbox.push_back((id, frame));
            }
            state.held_back += 1;
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
            state.held_back -= 1;
        }
    }

    /// Lets those who wait for room look again.
    fn wake(&self, state: &State) {
        if state.held_back > 0 {
            self.changed.notify_all();
        }
    }

    // Bus

    pub(crate) fn set_bus(&self, rates: BusRates) {
        self.lock().bus = Some(rates);
    }

    pub(crate) fn has_clients(&self) -> bool {
        !self.lock().clients.is_empty()
    }

    /// Whether the bus takes frames. Drops those that wait when it does not; how many that were.
    pub(crate) fn set_taking(&self, is_taking: bool) -> usize {
        let mut state = self.lock();
        state.is_barred = !is_taking;
        if is_taking {
            return 0;
        }
        let dropped = state.inbox.len();
        state.inbox.clear();
        self.wake(&state);
        self.counters.not_taken.fetch_add(dropped as u64, Ordering::Relaxed);
        dropped
    }

    /// The next frame for the bus.
    pub(crate) fn next_for_bus(&self) -> Option<(ClientId, CanFrame)> {
        let mut state = self.lock();
        let next = state.inbox.pop_front();
        self.wake(&state);
        next
    }

    /// Hands a frame to every client but its sender.
    pub(crate) fn deliver(&self, frame: &CanFrame, now: u64, sender: Option<ClientId>) {
        for client in self.lock().clients.iter().filter(|client| Some(client.id) != sender) {
            let counters = &self.counters;
            let is_taken = client.outbox.offer(frame, now);
            count(if is_taken { &counters.delivered } else { &counters.dropped_to_clients });
        }
    }
}
