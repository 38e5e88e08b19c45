//! Times and queues of pending events.

use std::collections::VecDeque;

/// Time of an event that does not occur.
pub(crate) const NEVER: u64 = u64::MAX;

/// Milliseconds in nanoseconds.
pub(crate) fn ms(ms: u32) -> u64 {
    u64::from(ms) * 1_000_000
}

/// The earliest of several times; `u64::MAX` counts as `None`. Runs after every event: branch-free.
#[inline]
pub(crate) fn earliest(times: impl IntoIterator<Item = Option<u64>>) -> Option<u64> {
    let first = times.into_iter().fold(NEVER, |first, time| first.min(time.unwrap_or(NEVER)));
    (first != NEVER).then_some(first)
}

/// Takes the first element. An empty queue continues at the begin of its memory: a queue that is mostly
/// empty then stays in the processor's cache instead of moving through all of its capacity.
pub(crate) fn take_first<T>(queue: &mut VecDeque<T>) -> Option<T> {
    let first = queue.pop_front();
    if queue.is_empty() {
        queue.clear();
    }
    first
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absent_time_is_never_first() {
        assert_eq!(earliest([None, Some(7), Some(3), None]), Some(3));
        assert_eq!(earliest([None, Some(u64::MAX)]), None);
        assert_eq!(earliest([]), None);
    }

    #[test]
    fn emptied_queue_uses_the_same_memory_again() {
        let mut queue = VecDeque::with_capacity(4);
        let mut places = Vec::new();
        for value in 0..8 {
            queue.push_back(value);
            places.push(queue.front().map(std::ptr::from_ref));
            assert_eq!(take_first(&mut queue), Some(value));
        }
        assert!(places.iter().all(|place| *place == places[0]));
        queue.extend([1, 2]);
        assert_eq!([take_first(&mut queue), take_first(&mut queue)], [Some(1), Some(2)]);
        assert_eq!(take_first(&mut queue), None);
    }
}
