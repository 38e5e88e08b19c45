//! Events of the machine and of the application.

use ecan_cia402::Takeover;
use ecan_sim::{DriveFault, Fault, GatewayFault, LossDirection};

use super::{Trial, machine};
use crate::monitor::{
    AxisMonitor, LOST_BY_CLOCK, LOST_IN_BUS_OFF, LOST_IN_HIDDEN_BUS_OFF, RELEASED, RELEASED_BY_BUS,
};
use crate::plan::{Action, MS};
use crate::report::Kind;

/// Correction of a gateway's clock in a cycle.
const CLOCK_STEP_NS: u64 = 2_000;
/// Shortest bus-off: 128 times 11 bits at 1 Mbit/s.
const BUS_OFF_NS: u64 = 1_408_000;

impl Trial {
    pub(super) fn block_all(&mut self, until: u64) {
        for blocked in &mut self.slave_blocked {
            *blocked = until.max(*blocked);
        }
    }

    pub(super) fn act(&mut self, action: Action) {
        self.note(&format!("{action:?}"));
        let now = self.now;
        let cycle = self.plan.cycle_ns;
        match action {
            Action::Fault(fault) => {
                self.disturbs(&fault);
                self.note_unreported_bus_off();
                for (monitor, axis) in self.monitors.iter_mut().zip(&self.plan.axes) {
                    let until = self.slave_blocked[axis.config.address.slave];
                    if until > now {
                        monitor.releasing(until, RELEASED);
                    }
                }
                self.simulation.inject(fault);
            }
            Action::DriveFault(axis, fault) => {
                let number = self.plan.axes[axis].config.node_axis;
                let (axis, fault) = match fault {
                    DriveFault::Error { code } => {
                        (axis, DriveFault::AxisError { axis: number, code })
                    }
                    // The motor of the first axis of the node.
                    fault => (self.plan.axes_of_node(axis).next().unwrap_or(axis), fault),
                };
                if let DriveFault::Blocked { for_ms } = fault {
                    let until = now + u64::from(for_ms) * MS;
                    self.motor_blocked[axis] = until;
                    self.monitors[axis].blocked(until);
                }
                let node = self.plan.axes[axis].node_name();
                self.simulation.inject(Fault::Drive { node, fault });
            }
            Action::Silent(axis, for_ms) => {
                for n in self.plan.axes_of_node(axis) {
                    self.silent[n] = now + u64::from(for_ms) * MS + 20 * MS;
                }
                let node = self.plan.axes[axis].node_name();
                self.simulation.inject(Fault::NodeSilent { node, for_ms });
            }
            Action::Pause(ms) => self.lose_time(u64::from(ms) * MS),
            Action::LoseTime { us, inside: true } => self.stall_ns = us * 1_000,
            Action::LoseTime { us, inside: false } => self.lose_time(us * 1_000),
            Action::Replace { idle_cycles } => {
                self.cia402 = None;
                self.takeover();
                for _ in 0..idle_cycles {
                    if let Some(port) = &mut self.port {
                        let _ = port.next_cycle().end();
                    }
                }
                if let Err(text) = self.make_table() {
                    self.find(Kind::Trial, 0, text);
                }
                let until = self.world_ns() + cycle;
                self.block_all(until);
            }
            Action::Restart(ms) => {
                self.cia402 = None;
                self.port = None;
                self.simulation.pass_ns(u64::from(ms) * MS);
                self.takeover();
                // As service managers do.
                let mut result = self.open();
                for _ in 0..20 {
                    let Err(text) = &result else { break };
                    let text = format!("not started: {text}");
                    self.note(&text);
                    self.simulation.pass_ns(500 * MS);
                    result = self.open();
                }
                if let Err(text) = result {
                    self.find(Kind::NoStart, 0, text);
                    self.port = None;
                }
                let until = self.world_ns() + cycle;
                self.block_all(until);
            }
            Action::Reconfigure => {
                if let Some(port) = &mut self.port {
                    let result = port.reconfigure(machine::config(&self.plan));
                    let result = result.and_then(|()| port.wait_ready());
                    self.note(&format!("reconfigured: {result:?}"));
                    if result.is_err() {
                        // As an application does: it tries again, then restarts.
                        self.act(Action::Restart(1_000));
                        return;
                    }
                }
                let until = self.world_ns() + cycle;
                self.block_all(until);
            }
            Action::Command(..) | Action::CommandAll(_) | Action::Skip { .. } | Action::Twice => {}
        }
        let before = self.now;
        self.now = self.world_ns();
        if self.now > before {
            self.monitors.iter_mut().for_each(AxisMonitor::disturbed);
        }
        self.observe();
    }

    /// The host loses time: everything else continues.
    pub(super) fn lose_time(&mut self, ns: u64) {
        self.simulation.pass_ns(ns);
        self.slave_blocked.iter_mut().for_each(|until| *until += ns);
        self.monitors.iter_mut().for_each(|monitor| monitor.time_lost(ns));
        self.now = self.world_ns();
        self.resumed_until = self.now + 5 * self.plan.cycle_ns;
        self.monitors.iter_mut().for_each(AxisMonitor::disturbed);
        self.observe();
    }

    /// The owner of the axes is gone: the next one must stop what it left.
    pub(super) fn takeover(&mut self) {
        self.now = self.world_ns();
        self.observe();
        let adopts = self.plan.table.takeover == Takeover::Adopt;
        self.monitors.iter_mut().for_each(|monitor| monitor.takeover(self.now, adopts));
        self.configured.fill(false);
    }

    /// Notes for how long a fault disturbs the path; when a gateway is verified again, and a channel
    /// back on the bus, is observed.
    pub(super) fn disturbs(&mut self, fault: &Fault) {
        let (now, cycle) = (self.now, self.plan.cycle_ns);
        let ms = |ms: u32| u64::from(ms) * MS;
        if let Fault::LostFrame { direction: LossDirection::Return, cycles } = *fault {
            let until = now + (u64::from(cycles) + 4) * cycle;
            self.images_damaged.extend((0..self.plan.gateways).map(|gateway| (gateway, until)));
        }
        match *fault {
            Fault::LostFrame { cycles, .. }
            | Fault::WorkingCounterOffset { cycles, .. }
            | Fault::LibraryError { times: cycles, .. } => {
                self.block_all(now + (u64::from(cycles) + 4) * cycle);
            }
            Fault::PowerCycle { gateway, off_ms: for_ms } | Fault::LinkLoss { gateway, for_ms } => {
                // On a line those downstream are cut off, too.
                for blocked in self.slave_blocked.iter_mut().skip(gateway) {
                    *blocked = (*blocked).max(now + ms(for_ms) + 10 * cycle + 20 * MS);
                }
            }
            Fault::Gateway { gateway, fault } => {
                let ns = match fault {
                    GatewayFault::TornTxPdo { images } | GatewayFault::CrcErrorTxPdo { images } => {
                        let ns = (u64::from(images) + 4) * cycle;
                        self.images_damaged.push((gateway, now + ns));
                        ns
                    }
                    GatewayFault::ServiceStall { ms: stall } => ms(stall) + 4 * cycle + 5 * MS,
                    GatewayFault::AlError { .. } => 10 * cycle + 20 * MS,
                    GatewayFault::ClockJump { ns } if self.plan.schedules_frames() => {
                        let until = now + ns.unsigned_abs() / CLOCK_STEP_NS * cycle;
                        for (monitor, axis) in self.monitors.iter_mut().zip(&self.plan.axes) {
                            if axis.config.address.slave == gateway {
                                monitor.releasing(until, LOST_BY_CLOCK);
                            }
                        }
                        return;
                    }
                    _ => return,
                };
                if let Some(blocked) = self.slave_blocked.get_mut(gateway) {
                    *blocked = (*blocked).max(now + ns);
                }
            }
            Fault::BusOff { gateway, channel } => {
                let until = now + 10 * cycle + 20 * MS;
                self.bus_offs.push((gateway, channel as u8, until));
                self.channel_blocked.push((gateway, channel as u8, now + 10 * cycle + 20 * MS));
            }
            Fault::ErrorFrames { gateway, channel, frames } => {
                let until = now + u64::from(frames) * MS / 2 + 4 * cycle;
                for (monitor, axis) in self.monitors.iter_mut().zip(&self.plan.axes) {
                    let address = axis.config.address;
                    if (address.slave, usize::from(address.channel)) == (gateway, channel) {
                        monitor.releasing(until, RELEASED_BY_BUS);
                    }
                }
                self.channel_blocked.push((gateway, channel as u8, until));
            }
            _ => {}
        }
    }

    /// The channel may be back before an image reports its bus-off: that loses more than one target.
    fn note_unreported_bus_off(&mut self) {
        let now = self.now;
        let is_long = self.plan.target_ns() < BUS_OFF_NS;
        for (monitor, axis) in self.monitors.iter_mut().zip(&self.plan.axes) {
            let address = axis.config.address;
            let is_damaged = self
                .images_damaged
                .iter()
                .any(|(slave, until)| *slave == address.slave && now <= *until);
            let lost = match (is_damaged, is_long) {
                (true, _) => LOST_IN_HIDDEN_BUS_OFF,
                (false, true) => LOST_IN_BUS_OFF,
                (false, false) => continue,
            };
            for (slave, channel, until) in &self.bus_offs {
                if (*slave, *channel) == (address.slave, address.channel) && now <= *until {
                    monitor.releasing(*until, lost);
                }
            }
        }
    }
}
