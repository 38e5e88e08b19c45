//! Numbers of commands.

use std::fmt;

const NUMBER_BITS: u32 = 40;
const TERM_BITS: u32 = 22;
const NUMBER_MASK: u64 = (1 << NUMBER_BITS) - 1;
const TERM_MASK: u64 = (1 << TERM_BITS) - 1;

/// Kind of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Stop = 1,
    /// Quick stop of one axis.
    One = 2,
    /// Quick stop of all axes.
    All = 3,
}

/// Number of a command. The cycle has executed it as soon as a snapshot
/// [has it](crate::Snapshot::has_executed).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct CommandTicket(u64);

impl CommandTicket {
    pub(super) fn new(kind: Kind, term: u64, number: u64) -> Self {
        let number = number & NUMBER_MASK;
        Self(
            (kind as u64) << (TERM_BITS + NUMBER_BITS) | (term & TERM_MASK) << NUMBER_BITS | number,
        )
    }

    /// The ticket with a [`number`](Self::number). Of a number that no command returned, as 0, nothing
    /// is executed.
    pub fn from_number(number: u64) -> Self {
        Self(number)
    }

    /// The number: not 0, and different for each command of an Adapter.
    pub fn number(self) -> u64 {
        self.0
    }

    pub(super) fn kind(self) -> Option<Kind> {
        match self.0 >> (TERM_BITS + NUMBER_BITS) {
            1 => Some(Kind::Stop),
            2 => Some(Kind::One),
            3 => Some(Kind::All),
            _ => None,
        }
    }

    pub(super) fn term(self) -> u64 {
        self.0 >> NUMBER_BITS & TERM_MASK
    }

    /// Returns whether this ticket, if executed, says that another one is: of the same kind and term,
    /// and not later.
    pub(super) fn covers(self, other: Self) -> bool {
        self.0 >> NUMBER_BITS == other.0 >> NUMBER_BITS
            && (1..=self.0 & NUMBER_MASK).contains(&(other.0 & NUMBER_MASK))
    }
}

impl fmt::Display for CommandTicket {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticket_covers_earlier_ones_of_its_kind_and_term() {
        let last = CommandTicket::new(Kind::One, 5, 7);
        assert_eq!((last.kind(), last.term()), (Some(Kind::One), 5));
        for (kind, term, number, is_covered) in [
            (Kind::One, 5, 7, true),
            (Kind::One, 5, 1, true),
            (Kind::One, 5, 0, false),
            (Kind::One, 5, 8, false),
            (Kind::One, 4, 7, false),
            (Kind::One, 6, 7, false),
            (Kind::All, 5, 7, false),
            (Kind::Stop, 5, 7, false),
        ] {
            let other = CommandTicket::new(kind, term, number);
            assert_eq!(last.covers(other), is_covered, "{kind:?} {term} {number}");
        }
        assert_eq!(CommandTicket::from_number(0).kind(), None);
    }
}
