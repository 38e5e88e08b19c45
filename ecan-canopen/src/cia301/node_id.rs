//! Node ids (CiA 301, 7.3.3).

use core::fmt;

/// Node id of a CANopen device, 1 to 127.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(u8);

impl NodeId {
    /// The lowest id.
    pub const MIN: Self = Self(1);
    /// The highest id.
    pub const MAX: Self = Self(127);

    /// The id with this number; `None` outside 1 to 127.
    pub const fn new(id: u8) -> Option<Self> {
        if id >= 1 && id <= 127 { Some(Self(id)) } else { None }
    }

    /// The number.
    pub const fn get(self) -> u8 {
        self.0
    }
}

impl fmt::Display for NodeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}
