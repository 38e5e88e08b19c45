//! Short lists of SDO transfers with a drive, without allocation, while the bus runs.

use std::time::Duration;

use ecan_canopen::{NodeSequence, OperatingMode, Step, object};
use ecan_protocol::config::List;

use super::node_axis::axis_step;

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
