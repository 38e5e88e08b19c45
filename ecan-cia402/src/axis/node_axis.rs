//! Objects of the axes of a node (CiA 402-1): those of axis n are 0x800 n above those of the first one.

use ecan_canopen::Step;
use ecan_protocol::sequence::Action;

/// Most axes of a node.
pub(crate) const MOST_AXES: u8 = 8;

/// Objects of the profile of the first axis.
const FIRST: std::ops::Range<u16> = 0x6000..0x6800;
const DISTANCE: u16 = 0x800;

/// Index of an object of an axis, by its index for the first one. Other objects belong to the node.
pub(crate) fn axis_index(axis: u8, index: u16) -> u16 {
    if FIRST.contains(&index) {
        index + DISTANCE * u16::from(axis.min(MOST_AXES - 1))
    } else {
        index
    }
}

/// Index of an object of an axis for the first one.
pub(crate) fn first_index(axis: u8, index: u16) -> u16 {
    let first = index.checked_sub(DISTANCE * u16::from(axis));
    first.filter(|first| FIRST.contains(first)).unwrap_or(index)
}

/// The step for an axis, by that for the first one.
pub(crate) fn axis_step(axis: u8, mut step: Step) -> Step {
    match &mut step.action {
        Action::Write { index, .. }
        | Action::Modify { index, .. }
        | Action::Read { index, .. }
        | Action::Expect { index, .. }
        | Action::Await { index, .. } => *index = axis_index(axis, *index),
        Action::Pause(_) | Action::Device(_) => {}
    }
    step
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_canopen::object;

    #[test]
    fn objects_of_the_profile_are_shifted() {
        assert_eq!(axis_index(0, object::CONTROLWORD), 0x6040);
        assert_eq!(axis_index(1, object::CONTROLWORD), 0x6840);
        assert_eq!(axis_index(7, 0x67FF), 0x9FFF);
        assert_eq!(axis_index(3, object::PRODUCER_HEARTBEAT), 0x1017);
        for axis in 0..MOST_AXES {
            assert_eq!(first_index(axis, axis_index(axis, object::STATUSWORD)), 0x6041);
            assert_eq!(first_index(axis, object::IDENTITY), object::IDENTITY);
        }
        let step = axis_step(2, Step::expect(object::MODE_DISPLAY, 0, 8_i8));
        assert_eq!(step.action.to_string(), "check 0x7061:00");
    }
}
