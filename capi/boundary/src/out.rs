//! Pointers of C for results.

use std::ptr::NonNull;

use crate::result::ecan_result_t;

/// A pointer of C for a result.
#[derive(Debug)]
pub struct OutPointer<T>(NonNull<T>);

impl<T> OutPointer<T> {
    /// `pointer` must be valid for writing as long as this lives, or NULL.
    pub(crate) fn new(pointer: *mut T) -> Option<Self> {
        NonNull::new(pointer).map(Self)
    }

    /// Stores the result.
    pub fn set(&self, value: T) {
        // SAFETY: `Call::out` was promised that it is valid for writing.
        unsafe { self.0.write(value) };
    }

    /// Stores a result, if it is not an error.
    pub fn store(&self, result: Result<T, ecan_result_t>) -> Result<(), ecan_result_t> {
        result.map(|value| self.set(value))
    }

    /// The pointer itself.
    pub fn as_ptr(&self) -> *mut T {
        self.0.as_ptr()
    }

    /// The same pointer for another type, which must fit.
    pub(crate) fn cast<U>(&self) -> OutPointer<U> {
        OutPointer(self.0.cast())
    }
}

/// An array of C for items.
#[derive(Debug)]
pub struct OutArray<T> {
    items: *mut T,
    capacity: usize,
    count: usize,
}

impl<T> OutArray<T> {
    /// `items` must be valid for writing `capacity` items as long as this lives.
    pub(crate) fn new(items: *mut T, capacity: usize) -> Self {
        Self { items, capacity, count: 0 }
    }

    /// Stores the next item; returns false if the array is full.
    #[inline(always)]
    pub fn push(&mut self, item: T) -> bool {
        if self.count == self.capacity {
            return false;
        }
        // SAFETY: below the capacity for which `Call::room` was promised validity.
        unsafe { self.items.add(self.count).write(item) };
        self.count += 1;
        true
    }

    /// Returns true if no other item fits.
    #[inline]
    pub fn is_full(&self) -> bool {
        self.count == self.capacity
    }

    /// Stores the first item, if there is room, which the next `push` replaces.
    pub(crate) fn start_with(&mut self, item: T) {
        self.push(item);
        self.count = 0;
    }

    /// Number of items that fit.
    pub(crate) fn capacity(&self) -> usize {
        self.capacity
    }

    /// Number of stored items.
    #[inline]
    pub fn count(&self) -> usize {
        self.count
    }
}

impl OutArray<u8> {
    /// Stores the bytes that fit; returns false if some do not.
    pub fn push_bytes(&mut self, bytes: &[u8]) -> bool {
        bytes.iter().all(|byte| self.push(*byte))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_array_rejects_items() {
        let mut buffer = [0; 3];
        let mut room = OutArray::new(buffer.as_mut_ptr(), 2);
        assert!(!room.push_bytes(&[1, 2, 3]));
        assert!(room.is_full());
        assert_eq!((room.count(), buffer), (2, [1, 2, 0]));
    }
}
