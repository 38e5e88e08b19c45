//! SDO downloads in a form that the tests compare.
// Each test file uses only a part.
#![allow(dead_code)]

use ecan_protocol::object::{SdoWrite, lookup};

/// A download as a master sends it: index, subindex, bytes, value.
pub type Sent = (u16, u8, usize, u32);

pub fn sent(write: &SdoWrite) -> Sent {
    (write.index, write.subindex, write.bytes().1, write.value)
}

pub fn all_sent<'a>(writes: impl IntoIterator<Item = &'a SdoWrite>) -> Vec<Sent> {
    writes.into_iter().map(sent).collect()
}

/// Every download has a writable entry of its size in the dictionary, which accepts the value.
pub fn in_table<'a>(writes: impl IntoIterator<Item = &'a SdoWrite>) {
    for write in writes {
        let (_, entry) = lookup(write.index, write.subindex).expect("in the table");
        assert!(entry.access.can_write(), "{write}");
        assert_eq!(entry.ty.size_bytes(), Some(write.bytes().1), "{write}");
        assert!(entry.accepts(write.value), "{write}");
    }
}
