use std::collections::VecDeque;

use crate::fault::{Fault, ScriptedFault, When};

/// The scheduled faults. Those of one instant occur in the order in which they were added.
#[derive(Debug, Default)]
pub(crate) struct FaultScript {
    by_cycle: VecDeque<(u64, Fault)>,
    by_time: VecDeque<(u64, Fault)>,
    /// Faults with their distance from the time in `op_at`, until that is known.
    after_op: VecDeque<(u64, Fault)>,
    op_at: Option<u64>,
}

impl FaultScript {
    /// Adds a fault; `start_ns` is the start of the simulation.
    pub(crate) fn add(&mut self, start_ns: u64, scripted: ScriptedFault) {
        let (list, at) = match (scripted.when, self.op_at) {
            (When::Cycle(cycle), _) => (&mut self.by_cycle, cycle),
            (When::At(ns), _) => (&mut self.by_time, start_ns.saturating_add(ns)),
            (When::AfterOp(ns), Some(op_at)) => (&mut self.by_time, op_at.saturating_add(ns)),
            (When::AfterOp(ns), None) => (&mut self.after_op, ns),
        };
        insert(list, at, scripted.fault);
    }

    /// Returns whether [`begin_op`](Self::begin_op) was not called yet.
    pub(crate) fn waits_for_op(&self) -> bool {
        self.op_at.is_none()
    }

    /// All gateways are in OP for the first time.
    pub(crate) fn begin_op(&mut self, now: u64) {
        self.op_at = Some(now);
        for (ns, fault) in std::mem::take(&mut self.after_op) {
            insert(&mut self.by_time, now.saturating_add(ns), fault);
        }
    }

    pub(crate) fn next_time(&self) -> Option<u64> {
        self.by_time.front().map(|(at, _)| *at)
    }

    pub(crate) fn due_time(&mut self, now: u64) -> Option<Fault> {
        take_due(&mut self.by_time, now)
    }

    pub(crate) fn due_cycle(&mut self, cycle: u64) -> Option<Fault> {
        take_due(&mut self.by_cycle, cycle)
    }
}

fn insert(list: &mut VecDeque<(u64, Fault)>, at: u64, fault: Fault) {
    let index = list.partition_point(|(other, _)| *other <= at);
    list.insert(index, (at, fault));
}

fn take_due(list: &mut VecDeque<(u64, Fault)>, now: u64) -> Option<Fault> {
    list.pop_front_if(|(at, _)| *at <= now).map(|(_, fault)| fault)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn power(gateway: usize) -> Fault {
        Fault::PowerOff { gateway }
    }

    #[test]
    fn faults_are_ordered_by_time() {
        let mut script = FaultScript::default();
        for (when, gateway) in [(30, 3), (10, 1), (30, 4), (20, 2)] {
            script.add(1000, ScriptedFault { when: When::At(when), fault: power(gateway) });
        }
        script.add(1000, ScriptedFault { when: When::Cycle(7), fault: power(9) });
        assert_eq!(script.next_time(), Some(1010));
        assert_eq!(script.due_time(1009), None);
        let due: Vec<_> = std::iter::from_fn(|| script.due_time(1030)).collect();
        assert_eq!(due, [power(1), power(2), power(3), power(4)]);
        assert_eq!(script.due_cycle(6), None);
        assert_eq!(script.due_cycle(7), Some(power(9)));
        assert_eq!(script.due_cycle(8), None);
    }

    #[test]
    fn faults_after_op_wait_for_it() {
        let mut script = FaultScript::default();
        let after_op =
            |ns, gateway| ScriptedFault { when: When::AfterOp(ns), fault: power(gateway) };
        script.add(0, after_op(20, 2));
        script.add(0, after_op(10, 1));
        assert_eq!((script.next_time(), script.waits_for_op()), (None, true));
        script.begin_op(500);
        assert!(!script.waits_for_op());
        script.add(0, after_op(15, 3));
        let due: Vec<_> = std::iter::from_fn(|| script.due_time(515)).collect();
        assert_eq!(due, [power(1), power(3)]);
        assert_eq!(script.next_time(), Some(520));
    }
}
