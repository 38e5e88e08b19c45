//! Commands of EtherCAT datagrams (ETG.1000.4).

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Access {
    Read,
    Write,
    /// Both; the memory is read before it is written.
    Exchange,
}

impl Access {
    pub(super) fn reads(self) -> bool {
        self != Self::Write
    }

    pub(super) fn writes(self) -> bool {
        self != Self::Read
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Command {
    /// NOP: passes through.
    None,
    /// APRD, APWR, APRW: the slave that finds the address 0; each one counts it up.
    Position(Access),
    /// FPRD, FPWR, FPRW: the slave with this station address.
    Station(Access),
    /// BRD, BWR, BRW: all slaves; what is read is combined by OR.
    Broadcast(Access),
    /// LRD, LWR, LRW: the slaves that map the logical address.
    Logical(Access),
    /// ARMW: the slave at the position is read, all others are written.
    PositionReadOthersWrite,
    /// FRMW: the slave with the station address is read, all others are written.
    StationReadOthersWrite,
}

impl Command {
    pub(super) fn from_raw(raw: u8) -> Option<Self> {
        use Access::{Exchange, Read, Write};
        Some(match raw {
            0 => Self::None,
            1 => Self::Position(Read),
            2 => Self::Position(Write),
            3 => Self::Position(Exchange),
            4 => Self::Station(Read),
            5 => Self::Station(Write),
            6 => Self::Station(Exchange),
            7 => Self::Broadcast(Read),
            8 => Self::Broadcast(Write),
            9 => Self::Broadcast(Exchange),
            10 => Self::Logical(Read),
            11 => Self::Logical(Write),
            12 => Self::Logical(Exchange),
            13 => Self::PositionReadOthersWrite,
            14 => Self::StationReadOthersWrite,
            _ => return None,
        })
    }
}
