//! Memory that the simulated library shares with its caller: process data and SDO data.
//!
//! The caller gets a plain `uint8_t *`, as from the real library, and reads and writes it whenever
//! it likes. The library side therefore keeps it in atomic words: both sides may touch the same
//! byte at the same time without undefined behaviour, only with the mixed content that the
//! mapping of a real master would show as well.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

const WORD_BYTES: usize = size_of::<u64>();

/// Zeroed memory of a fixed size, alive as long as one clone is.
#[derive(Clone, Debug)]
pub(crate) struct ProcessMemory {
    words: Arc<[AtomicU64]>,
    len: usize,
}

impl ProcessMemory {
    /// Memory of `len` zero bytes.
    pub(crate) fn new(len: usize) -> Self {
        let words = (0..len.div_ceil(WORD_BYTES).max(1)).map(|_| AtomicU64::new(0)).collect();
        Self { words, len }
    }

    /// Bytes.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// The address to hand to the caller. Valid while a clone of this memory lives.
    pub(crate) fn as_ptr(&self) -> *mut u8 {
        self.words.as_ptr().cast::<u8>().cast_mut()
    }

    /// Copies from `offset` on into `target`; what lies outside is left alone.
    pub(crate) fn read(&self, offset: usize, target: &mut [u8]) {
        let end = self.len.min(offset.saturating_add(target.len()));
        let mut at = offset;
        let mut target = target;
        while at < end {
            let inside = at % WORD_BYTES;
            let take = (WORD_BYTES - inside).min(end - at);
            let (Some(word), Some((now, rest))) =
                (self.words.get(at / WORD_BYTES), target.split_at_mut_checked(take))
            else {
                return;
            };
            let bytes = word.load(Ordering::Relaxed).to_ne_bytes();
            if let Some(bytes) = bytes.get(inside..inside + take) {
                now.copy_from_slice(bytes);
            }
            target = rest;
            at += take;
        }
    }

    /// Copies `source` to `offset`; what lies outside is dropped.
    pub(crate) fn write(&self, offset: usize, source: &[u8]) {
        let end = self.len.min(offset.saturating_add(source.len()));
        let mut at = offset;
        let mut source = source;
        while at < end {
            let inside = at % WORD_BYTES;
            let take = (WORD_BYTES - inside).min(end - at);
            let (Some(word), Some((now, rest))) =
                (self.words.get(at / WORD_BYTES), source.split_at_checked(take))
            else {
                return;
            };
            let mut bytes = word.load(Ordering::Relaxed).to_ne_bytes();
            if let Some(bytes) = bytes.get_mut(inside..inside + take) {
                bytes.copy_from_slice(now);
            }
            word.store(u64::from_ne_bytes(bytes), Ordering::Relaxed);
            source = rest;
            at += take;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_write_is_read_back_and_nothing_else_changes(
            len in 1usize..80,
            offset in 0usize..90,
            data in proptest::collection::vec(1u8.., 0..60),
        ) {
            let memory = ProcessMemory::new(len);
            memory.write(offset, &data);
            let mut all = vec![0; len];
            memory.read(0, &mut all);
            for (at, byte) in all.iter().enumerate() {
                let expected = at.checked_sub(offset).and_then(|i| data.get(i)).copied();
                prop_assert_eq!(*byte, expected.unwrap_or(0));
            }
            let mut part = vec![0xEE; data.len()];
            memory.read(offset, &mut part);
            let inside = len.saturating_sub(offset).min(data.len());
            prop_assert_eq!(&part[..inside], &data[..inside]);
            prop_assert!(part[inside..].iter().all(|byte| *byte == 0xEE));
        }
    }
}
