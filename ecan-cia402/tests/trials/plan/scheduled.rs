//! Plans with targets and SYNC at phases of Sync0, many axes on a channel, and a host that loses time.

use ecan_canopen::{NodeAddress, NodeId, SyncConfig};
use ecan_cia402::Takeover;
use ecan_sim::{Fault, GatewayFault};

use super::{Action, AxisPlan, Command, Event, MOST_RPDOS, MS, Plan, target_period_cycles};
use crate::random::Random;
use crate::variants;

/// Distinguishes the random numbers of this part from those of the plan that it changes.
const STREAM: u64 = 0x5C4E_D01E;

/// Longest jump of a gateway's clock, ns.
const LONGEST_JUMP_NS: i64 = 2_000_000;

impl Plan {
    /// The same application and faults with scheduled transmission, two to five axes on one channel, and
    /// in addition: pauses of the host up to 2 s at any point of the cycle, with and without a jump of the
    /// gateway's clock, new owners, and commands to enable in any phase of the SYNC period.
    pub fn with_schedule(mut self) -> Self {
        let r = &mut Random::new(self.seed ^ STREAM);
        let cycle_ms = r.pick(&[1, 2, 2, 4]);
        self.cycle_ns = cycle_ms * MS;
        self.gateways = 1;
        self.clock = Some(draw_phases(r, cycle_ms));
        let every_cycles = r.pick(&[1, 1, 2, 3, 5, 8]);
        self.table.motion_div = r.pick(&[1, 1, 2, 3, 4, 8]);
        self.table.sync = SyncConfig { every_cycles, ..SyncConfig::default() };
        self.table.takeover = r.pick(&[Takeover::Stop, Takeover::Adopt]);
        self.draw_axes(r, cycle_ms);
        let axes = self.axes.len();
        self.events.retain(|event| fits(&event.action, axes));
        for _ in 0..r.range(1, 4) {
            self.draw_lost_time(r);
        }
        self.events.sort_by_key(|event| event.at_ns);
        let timing = variants::Timing {
            clock: self.clock,
            target_cycles: target_period_cycles(self.table.motion_div, every_cycles),
            sync_cycles: every_cycles.into(),
        };
        self.variants = variants::draw(r, &self.axes, &timing);
        self
    }

    fn draw_axes(&mut self, r: &mut Random, cycle_ms: u64) {
        let target_ms = self.target_ns() / MS;
        // At 1 ms a channel carries two axes, and scheduled frames of more RPDOs would wait for two pulses.
        let (count, most) = if cycle_ms == 1 { (2, 2) } else { (r.below(4) + 2, MOST_RPDOS) };
        self.axes.clear();
        let mut rpdos = 0;
        for index in 0..count {
            let node = NodeId::new(index as u8 + 1).expect("below 127");
            let address = NodeAddress { slave: 0, channel: 0, node };
            let mut axis = AxisPlan::draw(r, index, address, target_ms);
            let further = count - index - 1;
            if rpdos + axis.config.layout().rpdo_count() + further > most {
                axis.config.pdos.outputs.clear();
            }
            rpdos += axis.config.layout().rpdo_count();
            self.axes.push(axis);
        }
    }

    /// The host loses time, and what an operator does about it.
    fn draw_lost_time(&mut self, r: &mut Random) {
        let cycle_ns = self.cycle_ns;
        let mut at_ns = r.range(0, self.duration_ns as i64) as u64;
        let mut push = |at_ns, action| self.events.push(Event { at_ns, action });
        let ns = r.range(-LONGEST_JUMP_NS, LONGEST_JUMP_NS);
        let jump =
            Action::Fault(Fault::Gateway { gateway: 0, fault: GatewayFault::ClockJump { ns } });
        let (has_jump, jump_first) = (r.chance(50), r.chance(50));
        if has_jump && jump_first {
            push(at_ns, jump.clone());
            at_ns += r.pick(&[0, cycle_ns, 20 * MS, 300 * MS]);
        }
        let pause = r.pick(&[0, 1, 3, 10, 100, 100, 130, 170, 240, 600, 2_000]);
        let part_us = r.pick(&[0, 0, 137, 400, 700, 990]);
        push(at_ns, Action::LoseTime { us: pause * 1_000 + part_us, inside: r.chance(40) });
        if has_jump && !jump_first {
            push(at_ns + r.pick(&[0, cycle_ns, 20 * MS]), jump);
        }
        // In any phase of the SYNC period, also right after the pause.
        let command = r.pick(&[Command::Enable, Command::Enable, Command::Recover]);
        for _ in 0..r.below(4) {
            at_ns += r.range(0, 40) as u64 * cycle_ns;
            let action = match r.below(5) {
                0 => Action::CommandAll(Command::Disable),
                1 => Action::Replace { idle_cycles: r.pick(&[0, 3]) },
                2 => Action::CommandAll(command),
                _ => Action::CommandAll(Command::Enable),
            };
            push(at_ns, action);
        }
    }
}

/// Returns whether an event concerns axes and gateways of this plan.
fn fits(action: &Action, axes: usize) -> bool {
    match action {
        Action::DriveFault(axis, _) | Action::Silent(axis, _) | Action::Command(axis, _) => {
            *axis < axes
        }
        Action::Fault(fault) => match fault {
            Fault::BusOff { gateway, channel } | Fault::ErrorFrames { gateway, channel, .. } => {
                (*gateway, *channel) == (0, 0)
            }
            Fault::PowerCycle { gateway, .. }
            | Fault::LinkLoss { gateway, .. }
            | Fault::Gateway { gateway, .. } => *gateway == 0,
            _ => true,
        },
        _ => true,
    }
}

/// Phases after the pulse of Sync0 (700 us after the cycle's deadline). What is sent at once is on the bus until
/// 850 us after the deadline, with five axes; in between, a target could take effect with one or another SYNC.
fn draw_phases(r: &mut Random, cycle_ms: u64) -> (Option<u32>, Option<u32>) {
    let target = r.range(60, 200) as u32 * 1_000;
    let apart = r.range(0, 100) as u32 * 1_000;
    let late = if cycle_ms == 1 { r.range(60, 250) } else { r.range(300, 1_000) } as u32 * 1_000;
    let both = (Some(target), Some(target + apart));
    // At 1 ms the targets would still be on the bus at the next deadline.
    let first = if cycle_ms == 1 { both } else { (Some(target), None) };
    r.pick(&[both, first, (None, Some(late)), (None, Some(late))])
}
