//! Memory that the simulated library shares with its caller: process data and SDO data.
//!
//! The caller gets a plain `uint8_t *`, as from the real library, and reads and writes it at any
//! time. The library keeps it in atomic words, so concurrent accesses are not undefined behaviour;
//! they can give mixed contents, as with the mapping of a real master.

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
    pub(crate) fn new(len: usize) -> Self {
        let words = (0..len.div_ceil(WORD_BYTES).max(1)).map(|_| AtomicU64::new(0)).collect();
        Self { words, len }
    }

    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Address for the caller. Valid while a clone of this memory lives.
    pub(crate) fn as_ptr(&self) -> *mut u8 {
        self.words.as_ptr().cast::<u8>().cast_mut()
    }

    /// Copies from `offset` into `target`; bytes outside keep their value.
    pub(crate) fn read(&self, offset: usize, target: &mut [u8]) {
        let inside = self.len.saturating_sub(offset).min(target.len());
        let Some(target) = target.get_mut(..inside) else { return };
        let Some((head, words, skip)) = self.split(offset, inside) else { return };
        let (first, rest) = target.split_at_mut(head);
        if let (true, Some((word, _))) = (head > 0, words.split_first()) {
            copy(first, word.load(Ordering::Relaxed).to_ne_bytes().get(skip..skip + head));
        }
        let words = words.get(usize::from(head > 0)..).unwrap_or_default();
        for (bytes, word) in rest.chunks_mut(WORD_BYTES).zip(words) {
            let length = bytes.len();
            copy(bytes, word.load(Ordering::Relaxed).to_ne_bytes().get(..length));
        }
    }

    /// Copies `source` to `offset`; bytes outside are dropped.
    pub(crate) fn write(&self, offset: usize, source: &[u8]) {
        let inside = self.len.saturating_sub(offset).min(source.len());
        let Some(source) = source.get(..inside) else { return };
        let Some((head, words, skip)) = self.split(offset, inside) else { return };
        let (first, rest) = source.split_at(head);
        if let (true, Some((word, _))) = (head > 0, words.split_first()) {
            change(word, skip, first);
        }
        let words = words.get(usize::from(head > 0)..).unwrap_or_default();
        for (bytes, word) in rest.chunks(WORD_BYTES).zip(words) {
            match <[u8; WORD_BYTES]>::try_from(bytes) {
                Ok(whole) => word.store(u64::from_ne_bytes(whole), Ordering::Relaxed),
                Err(_) => change(word, 0, bytes),
            }
        }
    }

    /// Number of bytes from `offset` in a word that begins before it, the words from that one on,
    /// and the start of the bytes in it.
    fn split(&self, offset: usize, length: usize) -> Option<(usize, &[AtomicU64], usize)> {
        let skip = offset % WORD_BYTES;
        let head = if skip == 0 { 0 } else { (WORD_BYTES - skip).min(length) };
        Some((head, self.words.get(offset / WORD_BYTES..)?, skip))
    }
}

/// Copies `source` if it has the length of `target`.
fn copy(target: &mut [u8], source: Option<&[u8]>) {
    if let Some(source) = source.filter(|source| source.len() == target.len()) {
        target.copy_from_slice(source);
    }
}

fn change(word: &AtomicU64, skip: usize, source: &[u8]) {
    let mut bytes = word.load(Ordering::Relaxed).to_ne_bytes();
    if let Some(part) = bytes.get_mut(skip..skip + source.len()) {
        part.copy_from_slice(source);
        word.store(u64::from_ne_bytes(bytes), Ordering::Relaxed);
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
