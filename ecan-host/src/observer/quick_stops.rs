//! Quick stops that observers command, for the layer that executes them.

use std::sync::Arc;

use super::commands::Shared;

/// A quick stop that an [`Observer`](crate::Observer) commanded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QuickStop {
    /// Of one axis.
    Axis(usize),
    /// Of all axes.
    All,
}

/// Quick stops commanded by observers, for the table of axes that executes them. For the layers of
/// the SDK.
///
/// Commands to one axis go to the table that was registered last, of those that exist; commands to all
/// axes to every one.
#[derive(Debug)]
pub struct QuickStops {
    shared: Arc<Shared>,
    table: u64,
    slot: Option<usize>,
    /// Commands that were executed: their number, and the count of commands to all axes.
    ticket: u64,
    of_all: u64,
}

impl QuickStops {
    pub(super) fn new(shared: Arc<Shared>, axis_count: usize) -> Self {
        let commands = &shared.commands;
        // Before the term that the registration begins: all commands of that term are executed.
        let ticket = commands.last_quick_stop();
        let of_all = commands.quick_stops_of_all();
        let (table, slot) = commands.register_table(axis_count, ticket);
        Self { table, slot, ticket, of_all, shared }
    }

    /// Returns whether commands were given since the last [`execute`](Self::execute). Real-time safe.
    #[inline]
    pub fn is_pending(&self) -> bool {
        self.shared.commands.last_quick_stop() != self.ticket
    }

    /// Executes the commands that were given since the last call, by `stop`, and acknowledges them in
    /// the snapshot of this cycle. Real-time safe.
    pub fn execute(&mut self, mut stop: impl FnMut(QuickStop)) {
        let commands = &self.shared.commands;
        let ticket = commands.last_quick_stop();
        if ticket == self.ticket {
            return;
        }
        self.ticket = ticket;
        commands.acknowledge(ticket, self.slot, || {
            let of_all = commands.quick_stops_of_all();
            if self.of_all != of_all {
                self.of_all = of_all;
                stop(QuickStop::All);
            }
            if !commands.is_table(self.table) {
                return false;
            }
            for (first, mut bits) in commands.take_quick_stops() {
                while bits != 0 {
                    stop(QuickStop::Axis(first + bits.trailing_zeros() as usize));
                    bits &= bits - 1;
                }
            }
            true
        });
    }

    /// Returns whether this is the table that was registered last, which writes the section of the axes.
    /// Real-time safe.
    pub fn is_observed(&self) -> bool {
        self.shared.commands.is_last_table(self.table)
    }
}

impl Drop for QuickStops {
    fn drop(&mut self) {
        self.shared.commands.remove_table(self.table);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observer::{CommandTicket, NoSuchAxis};

    fn executed(stops: &mut QuickStops) -> Vec<QuickStop> {
        let mut all = Vec::new();
        stops.execute(|stop| all.push(stop));
        all
    }

    fn has_executed(shared: &Shared, ticket: CommandTicket) -> bool {
        shared.commands.has_executed(&shared.commands.executed(), ticket)
    }

    #[test]
    fn commands_are_executed_once_and_acknowledged() {
        let shared = Arc::new(Shared::default());
        let commands = &shared.commands;
        let mut stops = QuickStops::new(Arc::clone(&shared), 100);
        assert!(executed(&mut stops).is_empty());
        let given = [3, 99, 3].map(|axis| commands.quick_stop(axis).unwrap());
        assert!(given.iter().all(|ticket| !has_executed(&shared, *ticket)));
        assert!(stops.is_pending());
        assert_eq!(executed(&mut stops), [QuickStop::Axis(3), QuickStop::Axis(99)]);
        assert!(given.iter().all(|ticket| has_executed(&shared, *ticket)));
        assert!(executed(&mut stops).is_empty());
        let all = commands.quick_stop_all();
        assert!(!has_executed(&shared, all));
        assert_eq!(executed(&mut stops), [QuickStop::All]);
        assert!(has_executed(&shared, all));
        assert_eq!(commands.quick_stop(100), Err(NoSuchAxis { axis: 100, count: 100 }));
        assert!(!has_executed(&shared, CommandTicket::from_number(0)));
    }

    #[test]
    fn stop_of_all_is_executed_by_every_table() {
        let shared = Arc::new(Shared::default());
        let mut first = QuickStops::new(Arc::clone(&shared), 2);
        let mut second = QuickStops::new(Arc::clone(&shared), 2);
        let all = shared.commands.quick_stop_all();
        let one = shared.commands.quick_stop(1).unwrap();
        assert_eq!(executed(&mut second), [QuickStop::All, QuickStop::Axis(1)]);
        assert!(has_executed(&shared, one), "the later table has the axes");
        assert!(!has_executed(&shared, all), "the first table has not executed it");
        assert_eq!(executed(&mut first), [QuickStop::All]);
        assert!(has_executed(&shared, all));
        assert!(!first.is_observed() && second.is_observed());
    }

    #[test]
    fn dropped_quick_stops_are_never_acknowledged() {
        let shared = Arc::new(Shared::default());
        let commands = &shared.commands;
        let mut stops = QuickStops::new(Arc::clone(&shared), 2);
        let done = [commands.quick_stop(0).unwrap(), commands.quick_stop_all()];
        assert_eq!(executed(&mut stops).len(), 2);
        let dropped = [commands.quick_stop(0).unwrap(), commands.quick_stop_all()];
        drop(stops);
        let assert_unchanged = || {
            assert!(done.iter().all(|ticket| has_executed(&shared, *ticket)));
            assert!(dropped.iter().all(|ticket| !has_executed(&shared, *ticket)));
        };
        assert_unchanged();
        assert!(commands.quick_stop(0).is_err());
        let without_axes = commands.quick_stop_all();
        let mut stops = QuickStops::new(Arc::clone(&shared), 2);
        assert!(executed(&mut stops).is_empty());
        assert_unchanged();
        let later = commands.quick_stop(1).unwrap();
        assert_eq!(executed(&mut stops), [QuickStop::Axis(1)]);
        assert!(has_executed(&shared, later) && !has_executed(&shared, without_axes));
        assert_unchanged();
        // Forgotten, but never reported wrongly.
        for _ in 0..200 {
            let mut stops = QuickStops::new(Arc::clone(&shared), 2);
            commands.quick_stop(1).unwrap();
            assert_eq!(executed(&mut stops), [QuickStop::Axis(1)]);
            assert!(dropped.iter().all(|ticket| !has_executed(&shared, *ticket)));
        }
    }

    #[test]
    fn end_of_a_table_returns_commands_to_the_one_before() {
        let shared = Arc::new(Shared::default());
        let commands = &shared.commands;
        let mut first = QuickStops::new(Arc::clone(&shared), 3);
        let early = commands.quick_stop(2).unwrap();
        let second = QuickStops::new(Arc::clone(&shared), 2);
        let lost = [commands.quick_stop(1).unwrap(), commands.quick_stop_all()];
        drop(second);
        assert_eq!(commands.axis_count(), 3);
        assert_eq!(executed(&mut first), [QuickStop::All]);
        assert!(
            !has_executed(&shared, early)
                && lost.iter().all(|ticket| !has_executed(&shared, *ticket))
        );
        let given = [commands.quick_stop(2).unwrap(), commands.quick_stop_all()];
        assert!(given.iter().all(|ticket| !has_executed(&shared, *ticket)));
        assert_eq!(executed(&mut first), [QuickStop::All, QuickStop::Axis(2)]);
        assert!(given.iter().all(|ticket| has_executed(&shared, *ticket)));
        assert!(!first.is_observed(), "the snapshot has no room for its axes");
    }

    #[test]
    fn stop_of_all_with_many_tables_is_not_acknowledged() {
        let shared = Arc::new(Shared::default());
        let mut tables: Vec<_> = (0..9).map(|_| QuickStops::new(Arc::clone(&shared), 1)).collect();
        let all = shared.commands.quick_stop_all();
        assert!(tables.iter_mut().all(|table| executed(table) == [QuickStop::All]));
        assert!(!has_executed(&shared, all));
        tables.pop();
        let all = shared.commands.quick_stop_all();
        assert!(tables.iter_mut().all(|table| executed(table) == [QuickStop::All]));
        assert!(has_executed(&shared, all));
    }

    #[test]
    fn stop_request_is_acknowledged_without_targets() {
        let shared = Arc::new(Shared::default());
        let before = shared.commands.executed();
        let stops = QuickStops::new(Arc::clone(&shared), 2);
        let ticket = shared.commands.request_stop();
        assert!(!shared.commands.has_executed(&before, ticket));
        assert!(has_executed(&shared, ticket));
        drop(stops);
        assert!(has_executed(&shared, ticket));
    }
}
