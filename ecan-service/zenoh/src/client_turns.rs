//! Turns of remote clients: a bounded queue for each client, and one client after the other.

use std::collections::VecDeque;

/// Limits of what waits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TurnLimits {
    /// Clients that have something waiting or running.
    pub(crate) clients: usize,
    /// Items of one client.
    pub(crate) items: usize,
    /// Bytes of all clients.
    pub(crate) bytes: usize,
    /// Items of one client that run at the same time.
    pub(crate) running: usize,
}

/// Limit that an item exceeds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FullTurns {
    Clients(usize),
    Items(usize),
    Bytes(usize),
}

impl std::fmt::Display for FullTurns {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Clients(limit) => write!(f, "{limit} remote clients have requests"),
            Self::Items(limit) => write!(f, "{limit} requests or frames of this client wait"),
            Self::Bytes(limit) => write!(f, "requests with {limit} bytes wait"),
        }
    }
}

/// Items of all clients. A client that fills its queue delays and rejects its own items only.
#[derive(Debug)]
pub(crate) struct ClientTurns<T> {
    limits: TurnLimits,
    /// In the order of their turns.
    clients: VecDeque<ClientQueue<T>>,
    bytes: usize,
}

#[derive(Debug)]
struct ClientQueue<T> {
    name: String,
    waiting: VecDeque<(T, usize)>,
    running: usize,
}

impl<T> ClientTurns<T> {
    pub(crate) fn new(limits: TurnLimits) -> Self {
        Self { limits, clients: VecDeque::new(), bytes: 0 }
    }

    /// Adds items of a client with their bytes: all of them, or none and the limit.
    pub(crate) fn push(
        &mut self,
        client: &str,
        items: impl ExactSizeIterator<Item = T>,
        bytes_of_each: usize,
    ) -> Result<(), FullTurns> {
        let TurnLimits { clients, items: max_items, bytes, .. } = self.limits;
        let found = self.clients.iter().position(|queue| queue.name == client);
        let waiting =
            found.and_then(|at| self.clients.get(at)).map_or(0, |queue| queue.waiting.len());
        let added = items.len().saturating_mul(bytes_of_each);
        if found.is_none() && self.clients.len() >= clients {
            return Err(FullTurns::Clients(clients));
        }
        if waiting.saturating_add(items.len()) > max_items {
            return Err(FullTurns::Items(max_items));
        }
        if self.bytes.saturating_add(added) > bytes {
            return Err(FullTurns::Bytes(bytes));
        }
        let at = found.unwrap_or(self.clients.len());
        if found.is_none() {
            let name = client.to_owned();
            self.clients.push_back(ClientQueue { name, waiting: VecDeque::new(), running: 0 });
        }
        self.bytes += added;
        if let Some(queue) = self.clients.get_mut(at) {
            queue.waiting.extend(items.map(|item| (item, bytes_of_each)));
        }
        Ok(())
    }

    /// Takes the next item whose client may run it and which is ready, with the name of its client.
    /// The item runs until [`finish`](Self::finish).
    pub(crate) fn take(&mut self, mut is_ready: impl FnMut(&T) -> bool) -> Option<(String, T)> {
        let limit = self.limits.running;
        let at = self.clients.iter().position(|queue| {
            queue.running < limit && queue.waiting.front().is_some_and(|(item, _)| is_ready(item))
        })?;
        let mut queue = self.clients.remove(at)?;
        let (item, bytes) = queue.waiting.pop_front()?;
        self.bytes -= bytes;
        queue.running += 1;
        let name = queue.name.clone();
        self.clients.push_back(queue);
        Some((name, item))
    }

    /// Ends an item of a client that was taken.
    pub(crate) fn finish(&mut self, client: &str) {
        let Some(at) = self.clients.iter().position(|queue| queue.name == client) else { return };
        let Some(queue) = self.clients.get_mut(at) else { return };
        queue.running = queue.running.saturating_sub(1);
        if queue.running == 0 && queue.waiting.is_empty() {
            self.clients.remove(at);
        }
    }

    /// Removes all items that wait, in the order of the clients.
    pub(crate) fn drain(&mut self) -> Vec<T> {
        self.bytes = 0;
        let waiting = self.clients.drain(..).flat_map(|queue| queue.waiting);
        waiting.map(|(item, _)| item).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: TurnLimits = TurnLimits { clients: 2, items: 3, bytes: 40, running: 2 };

    fn push(turns: &mut ClientTurns<u8>, client: &str, items: &[u8]) -> Result<(), FullTurns> {
        turns.push(client, items.iter().copied(), 10)
    }

    fn take(turns: &mut ClientTurns<u8>) -> Option<u8> {
        let (client, item) = turns.take(|_| true)?;
        turns.finish(&client);
        Some(item)
    }

    #[test]
    fn clients_take_turns() {
        let mut turns = ClientTurns::new(LIMITS);
        push(&mut turns, "flooder", &[1, 2, 3]).unwrap();
        push(&mut turns, "probe", &[9]).unwrap();
        let taken: Vec<_> = std::iter::from_fn(|| take(&mut turns)).collect();
        assert_eq!(taken, [1, 9, 2, 3]);
        assert!(turns.clients.is_empty() && turns.bytes == 0);
    }

    #[test]
    fn item_that_is_not_ready_blocks_its_own_client_only() {
        let mut turns = ClientTurns::new(LIMITS);
        push(&mut turns, "a", &[1, 2]).unwrap();
        push(&mut turns, "b", &[3]).unwrap();
        assert_eq!(turns.take(|item| *item != 1).unwrap(), ("b".to_owned(), 3));
        assert_eq!(turns.take(|item| *item != 1), None);
        assert_eq!(take(&mut turns), Some(1));
    }

    #[test]
    fn running_items_of_a_client_are_limited() {
        let mut turns = ClientTurns::new(LIMITS);
        push(&mut turns, "a", &[1, 2, 3]).unwrap();
        assert_eq!(turns.take(|_| true).unwrap().1, 1);
        assert_eq!(turns.take(|_| true).unwrap().1, 2);
        assert_eq!(turns.take(|_| true), None);
        turns.finish("a");
        assert_eq!(turns.take(|_| true).unwrap().1, 3);
    }

    #[test]
    fn each_limit_rejects_only_what_exceeds_it() {
        let mut turns = ClientTurns::new(LIMITS);
        assert_eq!(push(&mut turns, "a", &[1; 4]), Err(FullTurns::Items(3)));
        push(&mut turns, "a", &[1; 3]).unwrap();
        assert_eq!(push(&mut turns, "b", &[1; 2]), Err(FullTurns::Bytes(40)));
        push(&mut turns, "b", &[1]).unwrap();
        assert_eq!(push(&mut turns, "c", &[1]), Err(FullTurns::Clients(2)));
        while take(&mut turns).is_some() {}
        push(&mut turns, "c", &[1]).unwrap();
        assert_eq!(turns.drain(), [1]);
        assert_eq!((take(&mut turns), turns.bytes), (None, 0));
    }
}
