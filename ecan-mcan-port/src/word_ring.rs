//! Bounded ring of records between one writer and one reader, without locks.

use std::sync::Arc;
use std::sync::atomic::Ordering;
#[cfg(not(loom))]
use std::sync::atomic::{AtomicBool, AtomicU64};

#[cfg(loom)]
use loom::sync::atomic::{AtomicBool, AtomicU64};

/// Both ends of a ring.
#[derive(Debug)]
struct Ring {
    /// Their number is a power of two.
    words: Box<[AtomicU64]>,
    /// Words written and read since the start. On cache lines of their own: each has another writer.
    written: OwnLine,
    read: OwnLine,
    /// The other end is gone.
    is_closed: AtomicBool,
    /// The reader has paused the records.
    is_paused: AtomicBool,
}

#[derive(Debug, Default)]
#[repr(align(64))]
struct OwnLine(AtomicU64);

impl Ring {
    fn slot(&self, position: u64) -> &AtomicU64 {
        // infallible: the number of words is a power of two and not 0
        &self.words[self.index(position)]
    }

    fn index(&self, position: u64) -> usize {
        position as usize & (self.words.len() - 1)
    }

    /// Writes words from `position` on, at most as many as there are; returns the next position. In two
    /// loops over slices, which the compiler unrolls.
    #[inline]
    fn store<T>(&self, position: u64, words: &[T], word_of: impl Fn(&T) -> u64) -> u64 {
        let (second, first) = self.words.split_at(self.index(position));
        let (to_end, from_start) = words.split_at(words.len().min(first.len()));
        for (slots, words) in [(first, to_end), (second, from_start)] {
            slots
                .iter()
                .zip(words)
                .for_each(|(slot, word)| slot.store(word_of(word), Ordering::Relaxed));
        }
        position + words.len() as u64
    }
}

/// Writing end. Dropping it closes the ring.
#[derive(Debug)]
pub(crate) struct RingWriter {
    ring: Arc<Ring>,
    position: u64,
    /// Position of the reader when it was last looked at.
    read: u64,
}

/// Reading end. Dropping it closes the ring.
#[derive(Debug)]
pub(crate) struct RingReader {
    ring: Arc<Ring>,
    position: u64,
    /// End of the record that was looked at; the position if there was none.
    end: u64,
}

/// Creates a ring of at least `words` words, for records of any length below that. Allocates.
pub(crate) fn ring(words: usize) -> (RingWriter, RingReader) {
    let words = words.max(2).next_power_of_two();
    let ring = Arc::new(Ring {
        words: (0..words).map(|_| AtomicU64::new(0)).collect(),
        written: OwnLine::default(),
        read: OwnLine::default(),
        is_closed: AtomicBool::new(false),
        is_paused: AtomicBool::new(false),
    });
    let reader = RingReader { ring: ring.clone(), position: 0, end: 0 };
    (RingWriter { ring, position: 0, read: 0 }, reader)
}

impl RingWriter {
    /// Returns whether the reader is gone.
    pub(crate) fn is_closed(&self) -> bool {
        self.ring.is_closed.load(Ordering::Relaxed)
    }

    /// Returns whether the reader takes records.
    pub(crate) fn is_wanted(&self) -> bool {
        !self.ring.is_paused.load(Ordering::Acquire) && !self.is_closed()
    }

    /// Writes a record: `head`, then `bytes` with zeros up to a whole word. Returns false if it does not
    /// fit; nothing is written then. Real-time safe.
    pub(crate) fn write(&mut self, head: &[u64], bytes: &[u8]) -> bool {
        let count = 1 + head.len() + bytes.len().div_ceil(8);
        let needed = self.position + count as u64;
        let capacity = self.ring.words.len() as u64;
        if needed - self.read > capacity {
            self.read = self.ring.read.0.load(Ordering::Acquire);
            if needed - self.read > capacity {
                return false;
            }
        }
        let (whole, rest) = bytes.as_chunks::<8>();
        let mut last = [0; 8];
        last[..rest.len()].copy_from_slice(rest);
        let last = if rest.is_empty() { &[][..] } else { &[last] };
        let mut position = self.position;
        position = self.ring.store(position, &[count as u64], |word| *word);
        position = self.ring.store(position, head, |word| *word);
        position = self.ring.store(position, whole, |word| u64::from_le_bytes(*word));
        position = self.ring.store(position, last, |word| u64::from_le_bytes(*word));
        self.position = position;
        // The reader that sees this position sees the words before it.
        self.ring.written.0.store(position, Ordering::Release);
        true
    }
}

impl RingReader {
    /// Returns whether the writer is gone; what it wrote before can still be read.
    pub(crate) fn is_closed(&self) -> bool {
        self.ring.is_closed.load(Ordering::Acquire)
    }

    /// Copies the first record into `record`; returns its length in words, 0 if there is none. `record`
    /// must be as long as the longest record. It stays in the ring until [`remove`](Self::remove).
    /// Real-time safe.
    pub(crate) fn peek(&mut self, record: &mut [u64]) -> usize {
        self.end = self.position;
        if self.position == self.ring.written.0.load(Ordering::Acquire) {
            return 0;
        }
        let count = self.ring.slot(self.position).load(Ordering::Relaxed);
        self.end += count;
        for (word, position) in record.iter_mut().zip(self.position + 1..self.end) {
            *word = self.ring.slot(position).load(Ordering::Relaxed);
        }
        count as usize - 1
    }

    /// Sets whether the writer shall pause.
    pub(crate) fn set_paused(&self, is_paused: bool) {
        self.ring.is_paused.store(is_paused, Ordering::Release);
    }

    /// Removes all records that were written so far.
    pub(crate) fn clear(&mut self) {
        self.end = self.ring.written.0.load(Ordering::Acquire);
        self.remove();
    }

    /// Removes the record that was looked at last, if there was one. Real-time safe.
    pub(crate) fn remove(&mut self) {
        self.position = self.end;
        // The writer that sees this position may overwrite the words before it.
        self.ring.read.0.store(self.position, Ordering::Release);
    }
}

impl Drop for RingWriter {
    fn drop(&mut self) {
        self.ring.is_closed.store(true, Ordering::Release);
    }
}

impl Drop for RingReader {
    fn drop(&mut self) {
        self.ring.is_closed.store(true, Ordering::Release);
    }
}

#[cfg(all(test, loom))]
mod interleaving_tests;

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    fn take(reader: &mut RingReader) -> Option<Vec<u64>> {
        let mut record = [0; 16];
        let words = reader.peek(&mut record);
        reader.remove();
        (words > 0).then(|| record[..words].to_vec())
    }

    #[test]
    fn records_arrive_in_order_over_the_end_of_the_ring() {
        let (mut writer, mut reader) = ring(8);
        for round in 0..20 {
            assert!(writer.write(&[round], &[1, 2, 3]));
            assert!(writer.write(&[round, 7], &[]));
            assert_eq!(take(&mut reader), Some(vec![round, 0x03_02_01]));
            assert_eq!(take(&mut reader), Some(vec![round, 7]));
            assert_eq!(take(&mut reader), None);
        }
    }

    #[test]
    fn record_that_does_not_fit_is_rejected_as_a_whole() {
        let (mut writer, mut reader) = ring(8);
        assert!(writer.write(&[1; 5], &[]));
        assert!(!writer.write(&[2; 2], &[]), "three words, two are free");
        assert!(writer.write(&[3], &[]));
        assert!(!writer.write(&[], &[]));
        assert_eq!(take(&mut reader), Some(vec![1; 5]));
        assert!(writer.write(&[4; 5], &[]));
        assert_eq!(take(&mut reader), Some(vec![3]));
        assert_eq!(take(&mut reader), Some(vec![4; 5]));
    }

    #[test]
    fn each_end_reports_that_the_other_is_gone() {
        let (mut writer, reader) = ring(8);
        assert!(!writer.is_closed() && !reader.is_closed());
        drop(reader);
        assert!(writer.is_closed());
        let (mut other, mut reader) = ring(8);
        assert!(writer.write(&[1], &[]) && other.write(&[2], &[]));
        drop(other);
        assert!(reader.is_closed());
        assert_eq!(take(&mut reader), Some(vec![2]), "written before");
    }

    #[test]
    fn threads_exchange_records_without_loss_or_change() {
        const RECORDS: u64 = if cfg!(miri) { 200 } else { 200_000 };
        let (mut writer, mut reader) = ring(64);
        let sender = std::thread::spawn(move || {
            for number in 0..RECORDS {
                let words = vec![number; 1 + number as usize % 7];
                while !writer.write(&words, &[]) {
                    std::thread::yield_now();
                }
            }
        });
        for number in 0..RECORDS {
            let record = loop {
                match take(&mut reader) {
                    Some(record) => break record,
                    None => std::thread::yield_now(),
                }
            };
            assert_eq!(record, vec![number; 1 + number as usize % 7]);
        }
        sender.join().unwrap();
    }
}
