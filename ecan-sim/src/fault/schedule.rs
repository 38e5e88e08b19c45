//! The faults of a world: those that are scheduled, those that are active, and the log of those that took effect.

use std::collections::VecDeque;
use std::fmt::{self, Display, Formatter};

use super::table::{Fault, LibraryCall, LossDirection};

/// Time of a scheduled fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    /// At the n-th send with process data since the start of the simulation, from 1.
    Cycle(u64),
    /// Nanoseconds after the start of the simulation.
    At(u64),
    /// Nanoseconds after the first send with process data at which all gateways are in OP.
    AfterOp(u64),
    /// Nanoseconds after a Port reports all its gateways ready for the first time
    /// ([`Clock::gateways_ready`](ecrt_sys::Clock::gateways_ready)).
    AfterReady(u64),
}

/// A fault and its time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScriptedFault {
    /// Time.
    pub when: When,
    /// Fault.
    pub fault: Fault,
}

/// The scheduled faults. Those of one instant occur in the order in which they were added.
#[derive(Clone, Debug, Default)]
pub(crate) struct FaultScript {
    by_cycle: VecDeque<(u64, Fault)>,
    by_time: VecDeque<(u64, Fault)>,
    op: Milestone,
    ready: Milestone,
}

/// An event whose time is not known in advance.
#[derive(Clone, Debug, Default)]
struct Milestone {
    at: Option<u64>,
    /// Faults with their distance from it, until its time is known.
    waiting: VecDeque<(u64, Fault)>,
}

impl FaultScript {
    /// Adds a fault; `start_ns` is the start of the simulation.
    pub(crate) fn add(&mut self, start_ns: u64, scripted: ScriptedFault) {
        let fault = scripted.fault;
        let (milestone, ns) = match scripted.when {
            When::Cycle(cycle) => return insert(&mut self.by_cycle, cycle, fault),
            When::At(ns) => return insert(&mut self.by_time, start_ns.saturating_add(ns), fault),
            When::AfterOp(ns) => (&mut self.op, ns),
            When::AfterReady(ns) => (&mut self.ready, ns),
        };
        match milestone.at {
            Some(at) => insert(&mut self.by_time, at.saturating_add(ns), fault),
            None => insert(&mut milestone.waiting, ns, fault),
        }
    }

    /// Time at which all gateways were in OP for the first time.
    pub(crate) fn op_at(&self) -> Option<u64> {
        self.op.at
    }

    /// Time at which the program had all gateways ready for the first time.
    pub(crate) fn ready_at(&self) -> Option<u64> {
        self.ready.at
    }

    /// All gateways are in OP. Only the first call has an effect.
    pub(crate) fn begin_op(&mut self, now: u64) {
        self.op.begin(now, &mut self.by_time);
    }

    /// As [`begin_op`](Self::begin_op), for gateways that are ready.
    pub(crate) fn begin_ready(&mut self, now: u64) {
        self.ready.begin(now, &mut self.by_time);
    }

    /// The faults whose time has not come: by time, by cycle, by the time after OP and after ready.
    pub(crate) fn pending(&self, start_ns: u64) -> impl Iterator<Item = ScriptedFault> {
        let with = |when: fn(u64) -> When, from: u64| {
            move |(at, fault): &(u64, Fault)| ScriptedFault {
                when: when(at.saturating_sub(from)),
                fault: fault.clone(),
            }
        };
        let by_time = self.by_time.iter().map(with(When::At, start_ns));
        let by_cycle = self.by_cycle.iter().map(with(When::Cycle, 0));
        let after_op = self.op.waiting.iter().map(with(When::AfterOp, 0));
        let after_ready = self.ready.waiting.iter().map(with(When::AfterReady, 0));
        by_time.chain(by_cycle).chain(after_op).chain(after_ready)
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

impl Milestone {
    fn begin(&mut self, now: u64, by_time: &mut VecDeque<(u64, Fault)>) {
        self.at.get_or_insert(now);
        for (ns, fault) in std::mem::take(&mut self.waiting) {
            insert(by_time, now.saturating_add(ns), fault);
        }
    }
}

fn insert(list: &mut VecDeque<(u64, Fault)>, at: u64, fault: Fault) {
    let index = list.partition_point(|(other, _)| *other <= at);
    list.insert(index, (at, fault));
}

fn take_due(list: &mut VecDeque<(u64, Fault)>, now: u64) -> Option<Fault> {
    let (_, fault) = if list.front()?.0 <= now { list.pop_front()? } else { return None };
    Some(fault)
}

/// Number of records that are kept.
const CAPACITY: usize = 256;

/// A fault that took effect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FaultRecord {
    /// Nanoseconds since the start of the simulation.
    pub time_ns: u64,
    /// Number of sends with process data until then.
    pub cycle: u64,
    /// Fault.
    pub fault: Fault,
}

/// The line that programs print: `1.234 s: fault: link loss before gateway 0 for 300 ms`.
impl Display for FaultRecord {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} s: fault: {}", self.time_ns as f64 / 1e9, self.fault)
    }
}

/// Effect of a fault on command, see [`Simulation::execute`](crate::Simulation::execute).
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FaultEffect {
    /// The fault took effect.
    Injected(FaultRecord),
    /// Its time has not come.
    Scheduled(ScriptedFault),
    /// Nothing has changed, for example because the gateway has its supply already.
    Nothing(Fault),
}

impl Display for When {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let seconds = |ns: u64| ns as f64 / 1e9;
        match *self {
            Self::Cycle(cycle) => write!(f, "at cycle {cycle}"),
            Self::At(ns) => write!(f, "at {:.3} s", seconds(ns)),
            Self::AfterOp(ns) => write!(f, "{:.3} s after OP", seconds(ns)),
            Self::AfterReady(ns) => write!(f, "{:.3} s after ready", seconds(ns)),
        }
    }
}

impl Display for ScriptedFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.when, self.fault)
    }
}

/// The line that programs print: that of the record, or of the fault with its time.
impl Display for FaultEffect {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Injected(record) => record.fmt(f),
            Self::Scheduled(fault) => fault.fmt(f),
            Self::Nothing(fault) => write!(f, "no effect: {fault}"),
        }
    }
}

type Observer = Box<dyn Fn(&FaultRecord) + Send>;

/// The last faults that took effect, and the observer of each.
#[derive(Default)]
pub(crate) struct FaultLog {
    records: VecDeque<FaultRecord>,
    observer: Option<Observer>,
}

impl FaultLog {
    /// The records, without the observer.
    pub(crate) fn unobserved(&self) -> Self {
        Self { records: self.records.clone(), observer: None }
    }

    pub(crate) fn add(&mut self, record: FaultRecord) {
        if let Some(observer) = &self.observer {
            observer(&record);
        }
        if self.records.len() == CAPACITY {
            self.records.pop_front();
        }
        self.records.push_back(record);
    }

    pub(crate) fn observe(&mut self, observer: Observer) {
        self.observer = Some(observer);
    }

    pub(crate) fn records(&self) -> impl Iterator<Item = &FaultRecord> {
        self.records.iter()
    }
}

/// Effect of the faults on the frames of one send.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct CycleFaults {
    pub(crate) lost: Option<LossDirection>,
    pub(crate) counter_offset: i32,
}

/// An effect with the number of times that it still occurs.
#[derive(Clone, Copy, Debug, Default)]
struct Repeated<T> {
    effect: T,
    times: u32,
}

impl<T: Copy> Repeated<T> {
    fn get(&self) -> Option<T> {
        (self.times > 0).then_some(self.effect)
    }

    fn take(&mut self) -> Option<T> {
        let effect = self.get();
        self.times = self.times.saturating_sub(1);
        effect
    }
}

/// The faults of a world: those to come, those of the master's frames and calls that are active, and the log.
#[derive(Default)]
pub(crate) struct FaultSchedule {
    script: FaultScript,
    log: FaultLog,
    lost: Repeated<LossDirection>,
    counter_offset: Repeated<i32>,
    /// Error numbers by call of the library.
    library_errors: [Repeated<i32>; LibraryCall::ALL.len()],
    /// Time until which the master starts no request.
    requests_held_until: u64,
}

impl FaultSchedule {
    /// A copy without the observer.
    pub(crate) fn unobserved(&self) -> Self {
        Self { script: self.script.clone(), log: self.log.unobserved(), ..*self }
    }

    pub(crate) fn script(&self) -> &FaultScript {
        &self.script
    }

    pub(crate) fn script_mut(&mut self) -> &mut FaultScript {
        &mut self.script
    }

    pub(crate) fn log(&self) -> &FaultLog {
        &self.log
    }

    pub(crate) fn log_mut(&mut self) -> &mut FaultLog {
        &mut self.log
    }

    pub(crate) fn lose_frames(&mut self, direction: LossDirection, cycles: u32) {
        self.lost = Repeated { effect: direction, times: cycles };
    }

    pub(crate) fn offset_counters(&mut self, offset: i32, cycles: u32) {
        self.counter_offset = Repeated { effect: offset, times: cycles };
    }

    pub(crate) fn fail_calls(&mut self, call: LibraryCall, errno: i32, times: u32) {
        if let Some(entry) = self.library_errors.get_mut(call as usize) {
            *entry = Repeated { effect: errno, times };
        }
    }

    pub(crate) fn hold_requests(&mut self, until: u64) {
        self.requests_held_until = until;
    }

    /// Takes the faults of a send with process data.
    pub(crate) fn take_cycle_faults(&mut self) -> CycleFaults {
        let counter_offset = self.counter_offset.take().unwrap_or_default();
        CycleFaults { lost: self.lost.take(), counter_offset }
    }

    /// Faults of a send without process data.
    pub(crate) fn faults_between_cycles(&self) -> CycleFaults {
        CycleFaults { lost: self.lost.get(), ..CycleFaults::default() }
    }

    /// Error number of this call of the library, if a fault makes the call fail.
    pub(crate) fn library_call(&mut self, call: LibraryCall) -> Result<(), i32> {
        let entry = self.library_errors.get_mut(call as usize);
        entry.and_then(Repeated::take).map_or(Ok(()), Err)
    }

    /// Time from which the master starts requests again, if a fault prevents it now.
    pub(crate) fn requests_held_until(&self, now: u64) -> Option<u64> {
        (self.requests_held_until > now).then_some(self.requests_held_until)
    }
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
        let times: Vec<_> = script.pending(100).map(|scripted| scripted.when).collect();
        assert_eq!(times, [When::At(410), When::At(415), When::At(420)]);
        script.begin_op(510);
        assert_eq!((script.op_at(), script.ready_at()), (Some(500), None));
        let due: Vec<_> = std::iter::from_fn(|| script.due_time(515)).collect();
        assert_eq!(due, [power(1), power(3)]);
        assert_eq!(script.next_time(), Some(520));
    }

    #[test]
    fn log_keeps_the_last_records() {
        let mut log = FaultLog::default();
        let (sender, receiver) = std::sync::mpsc::channel();
        log.observe(Box::new(move |record| sender.send(record.cycle).unwrap()));
        for cycle in 0..CAPACITY as u64 + 2 {
            log.add(FaultRecord { time_ns: 0, cycle, fault: Fault::PowerOff { gateway: 0 } });
        }
        assert_eq!(log.records().count(), CAPACITY);
        assert_eq!(log.records().next().map(|record| record.cycle), Some(2));
        assert_eq!(receiver.try_iter().count(), CAPACITY + 2);
    }
}
