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

    /// Time at which all gateways were in OP for the first time.
    pub(crate) fn op_at(&self) -> Option<u64> {
        self.op_at
    }

    /// All gateways are in OP for the first time.
    pub(crate) fn begin_op(&mut self, now: u64) {
        self.op_at = Some(now);
        for (ns, fault) in std::mem::take(&mut self.after_op) {
            insert(&mut self.by_time, now.saturating_add(ns), fault);
        }
    }

    /// The faults whose time has not come: by time, by cycle, by the time after OP.
    pub(crate) fn pending(&self, start_ns: u64) -> impl Iterator<Item = ScriptedFault> {
        let with = |when: fn(u64) -> When, from: u64| {
            move |(at, fault): &(u64, Fault)| ScriptedFault {
                when: when(at.saturating_sub(from)),
                fault: fault.clone(),
            }
        };
        let by_time = self.by_time.iter().map(with(When::At, start_ns));
        let by_cycle = self.by_cycle.iter().map(with(When::Cycle, 0));
        by_time.chain(by_cycle).chain(self.after_op.iter().map(with(When::AfterOp, 0)))
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
        let pending: Vec<_> = script.pending(1000).collect();
        assert_eq!(pending, [ScriptedFault { when: When::Cycle(7), fault: power(9) }]);
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
        assert_eq!((script.next_time(), script.op_at()), (None, None));
        script.begin_op(500);
        assert_eq!(script.op_at(), Some(500));
        script.add(0, after_op(15, 3));
        let times: Vec<_> = script.pending(100).map(|it| it.when).collect();
        assert_eq!(times, [When::At(410), When::At(415), When::At(420)]);
        let due: Vec<_> = std::iter::from_fn(|| script.due_time(515)).collect();
        assert_eq!(due, [power(1), power(3)]);
        assert_eq!(script.next_time(), Some(520));
    }
}
