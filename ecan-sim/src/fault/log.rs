use std::collections::VecDeque;
use std::fmt;

use crate::fault::Fault;

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
impl fmt::Display for FaultRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} s: fault: {}", self.time_ns as f64 / 1e9, self.fault)
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

#[cfg(test)]
mod tests {
    use super::*;

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
