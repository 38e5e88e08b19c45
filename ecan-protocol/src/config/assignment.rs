//! The PDO assignment 0x1C12 / 0x1C13 as SDO downloads (manual 5.4.1, 5.4.3 phase B).

use crate::mapping::{Direction, MAX_MULTIPLIER, assignment_index, pdo_map_index};
use crate::object::ObjectType;
use crate::object::SdoWrite;

/// Returns the downloads that assign the first `multiplier` chunks of a direction: count 0, the
/// chunks, the count. A multiplier above 24 counts as 24.
pub fn assignment_writes(direction: Direction, multiplier: u8) -> AssignmentWrites {
    AssignmentWrites { direction, multiplier: multiplier.min(MAX_MULTIPLIER), next: 0 }
}

/// Iterator of [`assignment_writes`].
#[derive(Clone, Debug)]
pub struct AssignmentWrites {
    direction: Direction,
    multiplier: u8,
    next: u8,
}

impl Iterator for AssignmentWrites {
    type Item = SdoWrite;

    fn next(&mut self) -> Option<SdoWrite> {
        let step = self.next;
        let index = assignment_index(self.direction);
        let write = match step {
            0 => SdoWrite::new(index, 0, ObjectType::U8, 0),
            s if s <= self.multiplier => {
                let map = pdo_map_index(self.direction, s - 1);
                SdoWrite::new(index, s, ObjectType::U16, u32::from(map))
            }
            s if s == self.multiplier + 1 => {
                SdoWrite::new(index, 0, ObjectType::U8, u32::from(self.multiplier))
            }
            _ => return None,
        };
        self.next += 1;
        Some(write)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = usize::from((self.multiplier + 2).saturating_sub(self.next));
        (left, Some(left))
    }
}

impl ExactSizeIterator for AssignmentWrites {}
