//! Faults that a scenario scripts or a test injects, and when they strike.

use std::collections::VecDeque;

use crate::gateway::GatewayFault;

/// Which half of a frame's way loses it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LossDirection {
    /// Before the first slave: no slave sees the frame.
    Outward,
    /// Behind the last slave: every slave has acted on it, the master does not learn so.
    Return,
}

/// A call of libethercat that [`Fault::LibraryError`] makes fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LibraryCall {
    /// `ecrt_master_receive`: what has arrived stays where it is for the next call.
    Receive,
    /// `ecrt_master_send`: what is queued stays queued.
    Send,
    /// `ecrt_domain_process`: the domain keeps its last working counter.
    DomainProcess,
    /// `ecrt_domain_queue`
    DomainQueue,
    /// `ecrt_domain_state`
    DomainState,
}

impl LibraryCall {
    /// How many there are.
    pub(crate) const COUNT: usize = 5;
}

/// A fault of the library, on the line, in a gateway, on a bus or in a node.
///
/// `gateway` is the position on the EtherCAT line, from 0; one that does not exist makes the
/// fault do nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The frames of the next `cycles` sends get lost.
    LostFrame {
        /// Where.
        way: LossDirection,
        /// How many sends.
        cycles: u32,
    },
    /// The working counter of every process data datagram of the next `cycles` sends arrives
    /// changed by `offset`; it does not fall below 0.
    WorkingCounterOffset {
        /// Difference.
        offset: i32,
        /// How many sends.
        cycles: u32,
    },
    /// The gateway loses its supply for `off_ms` milliseconds, then boots.
    PowerCycle {
        /// Position.
        gateway: usize,
        /// Milliseconds without supply.
        off_ms: u32,
    },
    /// The gateway loses its supply for good.
    PowerOff {
        /// Position.
        gateway: usize,
    },
    /// The cable in front of the gateway is open for `for_ms` milliseconds: it and those behind
    /// it keep their power, but answer no frame. At position 0 the master's own link is down.
    LinkLoss {
        /// Position.
        gateway: usize,
        /// Milliseconds.
        for_ms: u32,
    },
    /// A fault inside a gateway.
    Gateway {
        /// Position.
        gateway: usize,
        /// What.
        fault: GatewayFault,
    },
    /// The gateway's CAN controller of this channel goes bus-off.
    BusOff {
        /// Position.
        gateway: usize,
        /// Channel, 0 to 3.
        channel: usize,
    },
    /// The next `frames` transmissions of the gateway's channel end in error frames.
    ErrorFrames {
        /// Position.
        gateway: usize,
        /// Channel, 0 to 3.
        channel: usize,
        /// How many.
        frames: u32,
    },
    /// The node sends nothing for `for_ms` milliseconds. It still acknowledges. So a drive falls
    /// silent too.
    NodeSilent {
        /// Name of the node.
        node: String,
        /// Milliseconds.
        for_ms: u32,
    },
    /// The next `times` calls of this function of the library fail without doing their work, as
    /// when a signal interrupts them (`EINTR`). In 1.5 they fail silently. Struck with a cycle, it
    /// concerns the calls behind that cycle's send.
    LibraryError {
        /// Which function.
        call: LibraryCall,
        /// Error number, positive.
        errno: i32,
        /// How many calls.
        times: u32,
    },
    /// The master begins no SDO or register request of a configuration for `for_ms` milliseconds,
    /// as where process data leave its mailbox traffic no room. Requests stay busy, whatever their
    /// timeout.
    RequestsHeld {
        /// Milliseconds.
        for_ms: u32,
    },
    /// A fault in a drive. Nothing happens when the node is none.
    Drive {
        /// Name of the node.
        node: String,
        /// What.
        fault: DriveFault,
    },
}

/// A fault in a simulated drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DriveFault {
    /// The drive finds a fault: emergency message, fault reaction (0x605E), state fault.
    Error {
        /// Error code of CiA 402, as 0x2310.
        code: u16,
    },
    /// An error comes and goes: an emergency message without a change of state.
    Emcy {
        /// Error code.
        code: u16,
        /// Error register in the message.
        register: u8,
    },
    /// The drive loses its supply for `off_ms` milliseconds, then boots. Its motor coasts.
    PowerCycle {
        /// Milliseconds without supply.
        off_ms: u32,
    },
    /// The machine is jammed for `for_ms` milliseconds: the motor stands whatever its torque.
    Blocked {
        /// Milliseconds.
        for_ms: u32,
    },
}

/// When a scripted fault strikes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    /// With the n-th send that carries process data since the simulation began, from 1.
    Cycle(u64),
    /// So many nanoseconds after the simulation began.
    At(u64),
}

/// A fault and its time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScriptedFault {
    /// When.
    pub when: When,
    /// What.
    pub fault: Fault,
}

/// The faults still to come.
#[derive(Debug, Default)]
pub(crate) struct FaultScript {
    by_cycle: VecDeque<(u64, Fault)>,
    by_time: VecDeque<(u64, Fault)>,
}

impl FaultScript {
    /// Adds a fault; `start_ns` is the beginning of the simulation. Faults of one instant strike
    /// in the order in which they were added.
    pub(crate) fn add(&mut self, start_ns: u64, scripted: ScriptedFault) {
        let (list, at) = match scripted.when {
            When::Cycle(cycle) => (&mut self.by_cycle, cycle),
            When::At(ns) => (&mut self.by_time, start_ns.saturating_add(ns)),
        };
        let place = list.partition_point(|(other, _)| *other <= at);
        list.insert(place, (at, scripted.fault));
    }

    /// The next fault by time, in simulated nanoseconds.
    pub(crate) fn next_time(&self) -> Option<u64> {
        self.by_time.front().map(|(at, _)| *at)
    }

    /// Takes a fault that is due at this time.
    pub(crate) fn due_time(&mut self, now: u64) -> Option<Fault> {
        take_due(&mut self.by_time, now)
    }

    /// Takes a fault that is due in this cycle.
    pub(crate) fn due_cycle(&mut self, cycle: u64) -> Option<Fault> {
        take_due(&mut self.by_cycle, cycle)
    }
}

fn take_due(list: &mut VecDeque<(u64, Fault)>, now: u64) -> Option<Fault> {
    if list.front().is_some_and(|(at, _)| *at <= now) {
        list.pop_front().map(|(_, fault)| fault)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_come_in_the_order_of_their_time() {
        let mut script = FaultScript::default();
        let power = |gateway| Fault::PowerOff { gateway };
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
}
