//! Where the bus and the threads of its clients meet.

use std::collections::VecDeque;
use std::sync::mpsc::{SyncSender, TrySendError};
use std::sync::{Mutex, MutexGuard, PoisonError};

use ecan_protocol::CanFrame;

use crate::connection::Close;
use crate::rates::BusRates;
use crate::statistics::{BridgeStatistics, Counters, count};

/// Names a client of one bridge.
pub type ClientId = u64;

/// Something for a client.
#[derive(Debug)]
pub(crate) enum Outgoing {
    /// A frame of the bus and when it was complete, in nanoseconds of the bus's
    /// clock.
    Frame(CanFrame, u64),
    /// Bytes of the protocol.
    Answer(Vec<u8>),
}

/// A client as the bus sees it.
#[derive(Debug)]
struct Client {
    id: ClientId,
    outbox: SyncSender<Outgoing>,
    connection: Box<dyn Close>,
}

#[derive(Debug, Default)]
struct State {
    clients: Vec<Client>,
    next_client: ClientId,
    closed: bool,
    /// Frames for the bus, with their senders.
    inbox: VecDeque<(ClientId, CanFrame)>,
    /// The bit rates of the bus, once they are known.
    bus: Option<BusRates>,
}

/// Bounded queues between the bus and the clients. Nobody blocks in here.
#[derive(Debug)]
pub(crate) struct Hub {
    state: Mutex<State>,
    queue: usize,
    max_clients: usize,
    pub(crate) counters: Counters,
}

impl Hub {
    pub(crate) fn new(queue: usize, max_clients: usize) -> Self {
        let counters = Counters::default();
        Self { state: Mutex::default(), queue: queue.max(1), max_clients, counters }
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
        outbox: SyncSender<Outgoing>,
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
            state.clients.swap_remove(at).connection.close();
        }
    }

    /// Closes every connection and admits no further client.
    pub(crate) fn close(&self) {
        let mut state = self.lock();
        state.closed = true;
        for client in state.clients.drain(..) {
            client.connection.close();
        }
    }

    /// The bit rates of the bus; `None` before they are known.
    pub(crate) fn bus(&self) -> Option<BusRates> {
        self.lock().bus
    }

    /// A client's frame for the bus; false when too many wait already.
    pub(crate) fn submit(&self, id: ClientId, frame: CanFrame) -> bool {
        let mut state = self.lock();
        let has_room = state.inbox.len() < self.queue;
        if has_room {
            state.inbox.push_back((id, frame));
        } else {
            count(&self.counters.dropped_to_bus);
        }
        has_room
    }

    // Bus

    pub(crate) fn set_bus(&self, rates: BusRates) {
        self.lock().bus = Some(rates);
    }

    pub(crate) fn has_clients(&self) -> bool {
        !self.lock().clients.is_empty()
    }

    /// The next frame for the bus.
    pub(crate) fn next_for_bus(&self) -> Option<(ClientId, CanFrame)> {
        self.lock().inbox.pop_front()
    }

    /// Hands a frame to every client but its sender.
    pub(crate) fn deliver(&self, frame: &CanFrame, now: u64, sender: Option<ClientId>) {
        for client in self.lock().clients.iter().filter(|client| Some(client.id) != sender) {
            match client.outbox.try_send(Outgoing::Frame(*frame, now)) {
                Ok(()) => count(&self.counters.delivered),
                Err(TrySendError::Full(_)) => count(&self.counters.dropped_to_clients),
                Err(TrySendError::Disconnected(_)) => {}
            }
        }
    }
}
