//! A list of fixed capacity that is plain `Copy` data, for configurations.

use core::fmt;
use core::ops::{Deref, DerefMut};

/// A list of at most `N` items without allocation: plain `Copy` data, read as a slice.
///
/// Configurations use it so that they can be copied, compared and handed to C by value. Two lists
/// are equal if their items are; unused elements do not count.
///
/// ```
/// use ecan_protocol::config::List;
///
/// let mut numbers: List<u32, 4> = List::from([1, 2]);
/// numbers.push(3)?;
/// assert_eq!(numbers.iter().sum::<u32>(), 6);
/// assert!(List::<u32, 2>::collect(0..3).is_err());
/// # Ok::<(), ecan_protocol::config::ListFull>(())
/// ```
#[derive(Clone, Copy)]
pub struct List<T, const N: usize> {
    items: [T; N],
    len: usize,
}

/// Error: a [`List`] has no space for another item.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("list is full; allowed: at most {capacity} items")]
pub struct ListFull {
    /// Capacity of the list.
    pub capacity: usize,
}

impl<T: Copy + Default, const N: usize> List<T, N> {
    /// Creates an empty list.
    pub fn new() -> Self {
        Self { items: [T::default(); N], len: 0 }
    }

    /// Collects the items of an iterator.
    ///
    /// # Errors
    /// [`ListFull`] if the iterator yields more than `N` items.
    pub fn collect(items: impl IntoIterator<Item = T>) -> Result<Self, ListFull> {
        let mut list = Self::new();
        for item in items {
            list.push(item)?;
        }
        Ok(list)
    }
}

impl<T, const N: usize> List<T, N> {
    /// Appends an item.
    ///
    /// # Errors
    /// [`ListFull`] if the list already has `N` items; it is unchanged.
    pub fn push(&mut self, item: T) -> Result<(), ListFull> {
        let slot = self.items.get_mut(self.len).ok_or(ListFull { capacity: N })?;
        *slot = item;
        self.len += 1;
        Ok(())
    }

    /// Removes all items.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Most items that the list can hold.
    pub const fn capacity(&self) -> usize {
        N
    }
}

impl<T, const N: usize> Deref for List<T, N> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        self.items.get(..self.len).unwrap_or_default()
    }
}

impl<T, const N: usize> DerefMut for List<T, N> {
    fn deref_mut(&mut self) -> &mut [T] {
        self.items.get_mut(..self.len).unwrap_or_default()
    }
}

impl<T: Copy + Default, const N: usize> Default for List<T, N> {
    fn default() -> Self {
        Self::new()
    }
}

/// From an array of at most `N` items; a longer one does not compile.
impl<T: Copy + Default, const N: usize, const M: usize> From<[T; M]> for List<T, N> {
    fn from(from: [T; M]) -> Self {
        const { assert!(M <= N, "the array has more items than the list can hold") };
        let mut list = Self::new();
        for (slot, item) in list.items.iter_mut().zip(from) {
            *slot = item;
        }
        list.len = M;
        list
    }
}

impl<T: fmt::Debug, const N: usize> fmt::Debug for List<T, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl<T: PartialEq, const N: usize> PartialEq for List<T, N> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<T: Eq, const N: usize> Eq for List<T, N> {}

impl<T: PartialEq, const N: usize> PartialEq<[T]> for List<T, N> {
    fn eq(&self, other: &[T]) -> bool {
        **self == *other
    }
}

impl<T: PartialEq, const N: usize, const M: usize> PartialEq<[T; M]> for List<T, N> {
    fn eq(&self, other: &[T; M]) -> bool {
        **self == *other
    }
}

impl<T: Copy, const N: usize> IntoIterator for List<T, N> {
    type Item = T;
    type IntoIter = core::iter::Take<core::array::IntoIter<T, N>>;

    fn into_iter(self) -> Self::IntoIter {
        self.items.into_iter().take(self.len)
    }
}

impl<'a, T, const N: usize> IntoIterator for &'a List<T, N> {
    type Item = &'a T;
    type IntoIter = core::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<'a, T, const N: usize> IntoIterator for &'a mut List<T, N> {
    type Item = &'a mut T;
    type IntoIter = core::slice::IterMut<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter_mut()
    }
}

/// Serialization of a [`List`]: a sequence of its items.
#[cfg(feature = "serde")]
mod serialization {
    use core::fmt;
    use core::marker::PhantomData;

    use serde::de::{Deserialize, Deserializer, Error, SeqAccess, Visitor};
    use serde::ser::{Serialize, Serializer};

    use super::List;

    impl<T: Serialize, const N: usize> Serialize for List<T, N> {
        fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
            serializer.collect_seq(self.iter())
        }
    }

    impl<'de, T, const N: usize> Deserialize<'de> for List<T, N>
    where
        T: Deserialize<'de> + Copy + Default,
    {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            deserializer.deserialize_seq(Items(PhantomData))
        }
    }

    struct Items<T, const N: usize>(PhantomData<T>);

    impl<'de, T, const N: usize> Visitor<'de> for Items<T, N>
    where
        T: Deserialize<'de> + Copy + Default,
    {
        type Value = List<T, N>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "at most {N} items")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Self::Value, A::Error> {
            let mut list = List::new();
            while let Some(item) = items.next_element()? {
                list.push(item).map_err(A::Error::custom)?;
            }
            Ok(list)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_list_returns_error_and_keeps_items() {
        let mut list: List<u8, 2> = List::new();
        assert!(list.is_empty());
        assert_eq!(list.push(1), Ok(()));
        assert_eq!(list.push(2), Ok(()));
        assert_eq!(list.push(3), Err(ListFull { capacity: 2 }));
        assert_eq!(list, [1, 2]);
        assert_eq!(List::<u8, 2>::collect([1, 2, 3]), Err(ListFull { capacity: 2 }));
    }

    #[test]
    fn equality_ignores_unused_elements() {
        let mut list = List::<u8, 4>::from([1, 2]);
        list.clear();
        assert_eq!(list, List::default());
        assert_eq!(list, []);
        for item in &mut list {
            *item += 1;
        }
        assert_eq!(List::<u8, 4>::from([5, 6]).into_iter().sum::<u8>(), 11);
    }
}
