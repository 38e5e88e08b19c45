//! Quick stops that observers command, for the layer that executes them.

use std::sync::Arc;

use super::handle::Shared;

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
/// Commands to one axis go to the table that was registered last, commands to all axes to every one.
#[derive(Debug)]
pub struct QuickStops {
    shared: Arc<Shared>,
    table: u64,
    /// Commands that were executed: their number, and the count of commands to all axes.
    ticket: u64,
    of_all: u64,
}

impl QuickStops {
    pub(super) fn new(shared: Arc<Shared>, axis_count: usize) -> Self {
        let commands = &shared.commands;
        let of_all = commands.quick_stops_of_all();
        let table = commands.register_table(axis_count);
        Self { table, ticket: commands.last_ticket(), of_all, shared }
    }

    /// Returns whether commands were given since the last [`execute`](Self::execute). Real-time safe.
    #[inline]
    pub fn is_pending(&self) -> bool {
        self.shared.commands.last_ticket() != self.ticket
    }

    /// Executes the commands that were given since the last call, by `stop`, and acknowledges them in
    /// the snapshot of this cycle. Real-time safe.
    pub fn execute(&mut self, mut stop: impl FnMut(QuickStop)) {
        let commands = &self.shared.commands;
        let ticket = commands.last_ticket();
        if ticket == self.ticket {
            return;
        }
        self.ticket = ticket;
        let of_all = commands.quick_stops_of_all();
        if self.of_all != of_all {
            self.of_all = of_all;
            stop(QuickStop::All);
        }
        if !commands.is_table(self.table) {
            return;
        }
        for (first, mut bits) in commands.take_quick_stops() {
            while bits != 0 {
                stop(QuickStop::Axis(first + bits.trailing_zeros() as usize));
                bits &= bits - 1;
            }
        }
        commands.set_executed(ticket);
    }

    /// Returns whether this is the table that writes the section of the axes. Real-time safe.
    pub fn is_observed(&self) -> bool {
        self.shared.commands.is_table(self.table)
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

    #[test]
    fn commands_are_executed_once_and_acknowledged() {
        let shared = Arc::new(Shared::default());
        let commands = &shared.commands;
        let mut stops = QuickStops::new(Arc::clone(&shared), 100);
        assert!(executed(&mut stops).is_empty());
        commands.quick_stop(3).unwrap();
        commands.quick_stop(99).unwrap();
        let last = commands.quick_stop(3).unwrap();
        assert_eq!(commands.executed(), 0);
        assert!(stops.is_pending());
        assert_eq!(executed(&mut stops), [QuickStop::Axis(3), QuickStop::Axis(99)]);
        assert_eq!(CommandTicket(commands.executed()), last);
        assert!(executed(&mut stops).is_empty());
        let all = commands.quick_stop_all();
        assert!(all > last);
        assert_eq!(executed(&mut stops), [QuickStop::All]);
        assert_eq!(commands.quick_stop(100), Err(NoSuchAxis { axis: 100, count: 100 }));
    }

    #[test]
    fn stop_of_all_reaches_every_table() {
        let shared = Arc::new(Shared::default());
        let mut first = QuickStops::new(Arc::clone(&shared), 2);
        let mut second = QuickStops::new(Arc::clone(&shared), 2);
        shared.commands.quick_stop_all();
        let one = shared.commands.quick_stop(1).unwrap();
        assert_eq!(executed(&mut first), [QuickStop::All]);
        assert!(shared.commands.executed() < one.number(), "the later table has the axes");
        assert_eq!(executed(&mut second), [QuickStop::All, QuickStop::Axis(1)]);
        assert_eq!(shared.commands.executed(), one.number());
        assert!(!first.is_observed() && second.is_observed());
    }

    #[test]
    fn without_axes_the_cycle_itself_executes() {
        let shared = Arc::new(Shared::default());
        let stops = QuickStops::new(Arc::clone(&shared), 2);
        let ticket = shared.commands.request_stop();
        assert!(shared.commands.executed() < ticket.number());
        drop(stops);
        assert_eq!(shared.commands.executed(), ticket.number());
        assert!(shared.commands.quick_stop(0).is_err());
    }
}
