//! Lists in the parameters of requests: limit, range and no duplicates are checked while a list is read,
//! so that a longer one takes no memory.

use std::fmt::{self, Debug};
use std::marker::PhantomData;

use serde::de::{Deserialize, Deserializer, Error, SeqAccess, Visitor};

use ecan_protocol::mapping::CHANNELS;

use crate::protocol::subscription::{EventKind, IdFilter, ImageDirection};

/// Most filters of a subscription.
pub const MAX_FILTERS: usize = 256;
/// Most gateways of a subscription, and the first index that is out of range.
pub const MAX_GATEWAYS: usize = 256;

/// Entry of a list. A list has at most [`MAX`](Self::MAX) different ones.
pub(crate) trait Entry: Debug + PartialEq {
    const LIST: &'static str;
    const MAX: usize;

    fn is_in_range(&self) -> bool {
        true
    }
}

/// Index of a gateway.
impl Entry for u16 {
    const LIST: &'static str = "gateways";
    const MAX: usize = MAX_GATEWAYS;

    fn is_in_range(&self) -> bool {
        usize::from(*self) < MAX_GATEWAYS
    }
}

/// Channel of a gateway.
impl Entry for u8 {
    const LIST: &'static str = "channels";
    const MAX: usize = CHANNELS;

    fn is_in_range(&self) -> bool {
        usize::from(*self) < CHANNELS
    }
}

impl Entry for EventKind {
    const LIST: &'static str = "kinds";
    const MAX: usize = 5;
}

impl Entry for IdFilter {
    const LIST: &'static str = "filters";
    const MAX: usize = MAX_FILTERS;
}

impl Entry for ImageDirection {
    const LIST: &'static str = "directions";
    const MAX: usize = 2;
}

/// Reads a list of different entries in their range.
pub(crate) fn read_list<'de, D, T>(from: D) -> Result<Vec<T>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de> + Entry,
{
    from.deserialize_seq(ListVisitor(PhantomData))
}

struct ListVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de> + Entry> Visitor<'de> for ListVisitor<T> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a list of {} with at most {} entries", T::LIST, T::MAX)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<Vec<T>, A::Error> {
        let mut list = Vec::new();
        while let Some(entry) = entries.next_element::<T>()? {
            if !entry.is_in_range() {
                return Err(A::Error::custom(format_args!(
                    "{}: {entry:?} is out of range; allowed: 0 to {}",
                    T::LIST,
                    T::MAX - 1
                )));
            }
            if list.contains(&entry) {
                return Err(A::Error::custom(format_args!(
                    "{}: {entry:?} is in the list twice; allowed: each entry once",
                    T::LIST
                )));
            }
            if list.len() == T::MAX {
                return Err(A::Error::custom(format_args!(
                    "{}: more than {} entries; allowed: at most {}",
                    T::LIST,
                    T::MAX,
                    T::MAX
                )));
            }
            list.push(entry);
        }
        Ok(list)
    }
}
