//! Short lists of SDO transfers with a drive, without allocation, while the bus runs.

use std::time::Duration;

use ecan_canopen::{NodeSequence, OperatingMode, Step, object};
use ecan_protocol::config::List;
use ecan_protocol::sequence::Action;

/// Most steps of a script.
const MAX_STEPS: usize = 12;

/// Longest time that a drive may take to display a new mode.
const MODE_TIMEOUT: Duration = Duration::from_secs(1);

pub(crate) type Script = NodeSequence<List<Step, MAX_STEPS>>;

/// Creates a script; steps beyond the capacity are dropped, which no caller reaches.
fn script(steps: impl IntoIterator<Item = Step>) -> Script {
    let mut list = List::new();
    for step in steps {
        let pushed = list.push(step);
        debug_assert!(pushed.is_ok(), "script of more than {MAX_STEPS} steps");
    }
    NodeSequence::new(list)
}

/// Creates a script for an axis of a node, from steps for the first one.
pub(crate) fn axis_script(axis: u8, steps: impl IntoIterator<Item = Step>) -> Script {
    script(steps.into_iter().map(|step| axis_step(axis, step)))
}

/// Writes a mode and waits until the drive displays it.
pub(crate) fn mode_steps(mode: OperatingMode) -> [Step; 2] {
    let purpose = match mode {
        OperatingMode::ProfilePosition => "mode PP",
        OperatingMode::Velocity => "mode VL",
        OperatingMode::ProfileVelocity => "mode PV",
        OperatingMode::ProfileTorque => "mode PT",
        OperatingMode::Homing => "mode HM",
        OperatingMode::InterpolatedPosition => "mode IP",
        OperatingMode::CyclicPosition => "mode CSP",
        OperatingMode::CyclicVelocity => "mode CSV",
        OperatingMode::CyclicTorque => "mode CST",
    };
    [
        Step::write(object::MODE_OF_OPERATION, 0, mode.raw()).named(purpose),
        Step::await_value(object::MODE_DISPLAY, 0, mode.raw(), MODE_TIMEOUT).named(purpose),
    ]
}

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
