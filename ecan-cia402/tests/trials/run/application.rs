//! The application and its operator.

use ecan_canopen::{CobId, NodeAddress};
use ecan_cia402::{AxisCommand, FeedForward, StopKind as Stop, Target};
use ecan_mcan_port::{Cycle, PendingStep, ReceivedView};

use super::Trial;
use crate::monitor::{AxisMonitor, StopKind};
use crate::plan::{Action, Command, MS, Plan, Style};
use crate::sdk::{self, Class};

/// Time between two attempts of a gateway's startup.
const RETRY_NS: u64 = 2_000 * MS;
/// Startups without the reference clock after which the operator configures the bus again.
const CLOCK_FAILURES: usize = 3;

impl Trial {
    pub(super) fn operate(&mut self) {
        self.retry_startup();
        let Some(cia402) = &mut self.cia402 else { return };
        let mut done = Vec::new();
        for n in 0..self.plan.axes.len() {
            let step = if self.plan.app.recovers {
                sdk::recover(cia402, n)
            } else {
                sdk::next_step(cia402, n)
            };
            if let Some((name, result)) = step {
                match name {
                    "enable" if result.is_ok() => self.monitors[n].enabling(),
                    "recover" if result.is_ok() => {
                        self.monitors[n].procedure();
                        self.monitors[n].resuming();
                    }
                    "resume" => self.monitors[n].resuming(),
                    _ => {}
                }
                done.push(format!("operator: {name}({n}) {result:?}"));
            }
        }
        done.iter().for_each(|text| self.note(text));
    }

    /// As an operator does who reads what a gateway waits for.
    pub(super) fn retry_startup(&mut self) {
        let Some(port) = &mut self.port else { return };
        let waits = port
            .gateways()
            .any(|gateway| port.waiting_for(gateway) == Some(PendingStep::StartupRetry));
        if waits && self.now >= self.retry_at {
            // A startup takes some time; another request would begin it again.
            self.retry_at = self.now + RETRY_NS;
            let lines = self.simulation.kernel_log();
            let failures = lines.iter().filter(|line| line.contains("did not follow")).count();
            if failures >= self.clock_failures + CLOCK_FAILURES {
                self.clock_failures = failures;
                return self.act(Action::Reconfigure);
            }
            let result = port.retry_startup();
            self.note(&format!("operator: retry_startup {result:?}"));
            let before = self.now;
            self.now = self.world_ns();
            if self.now > before {
                self.monitors.iter_mut().for_each(AxisMonitor::disturbed);
            }
        }
    }

    pub(super) fn command(&mut self, n: usize, command: Command) {
        let now = self.now;
        let Some(cia402) = &mut self.cia402 else { return };
        let class = Class::of(cia402, n);
        let monitor = &mut self.monitors[n];
        monitor.note_class(now, class);
        let mut axis = cia402.axis_mut(n).unwrap();
        let result = match command {
            Command::Enable => axis.enable(),
            Command::Disable => axis.command(AxisCommand::Stop(Stop::Disable)),
            Command::QuickStop => axis.command(AxisCommand::Stop(Stop::QuickStop)),
            Command::Halt => axis.command(AxisCommand::Halt),
            Command::Resume => axis.command(AxisCommand::Resume),
            Command::ResetFault => axis.reset_fault(),
            Command::Configure => axis.configure(),
            Command::Recover => axis.recover(),
            Command::ReadPosition => axis.read_position(),
            Command::ChangeMode(mode) => axis.change_mode(mode),
            Command::Home(homing) => axis.home(homing),
            Command::Target(target) => axis.set_target(target),
            Command::StopAll => cia402.command_all(AxisCommand::Stop(Stop::QuickStopThenDisable)),
        };
        if result.is_ok() {
            match command {
                Command::Enable => monitor.enabling(),
                Command::Halt if class == Class::Running => monitor.halting(),
                Command::Resume => monitor.resuming(),
                Command::Recover => {
                    monitor.procedure();
                    monitor.resuming();
                }
                Command::ChangeMode(_) | Command::Home(_) => monitor.procedure(),
                Command::Configure => monitor.stopping(now, StopKind::Configure, class),
                Command::Disable => monitor.stopping(now, StopKind::Disable, class),
                Command::QuickStop => monitor.stopping(now, StopKind::QuickStop, class),
                Command::StopAll => {
                    for (monitor, class) in self.monitors.iter_mut().zip(&self.classes) {
                        monitor.stopping(now, StopKind::StopAll, *class);
                    }
                }
                _ => {}
            }
        }
        self.note(&format!("application: {command:?} axis {n} {result:?}"));
    }

    pub(super) fn set_targets(&mut self) {
        let Some(cia402) = &mut self.cia402 else { return };
        for n in 0..self.plan.axes.len() {
            let Some(last) = cia402.axis(n).unwrap().target() else {
                self.own[n] = None;
                continue;
            };
            let axis = &self.plan.axes[n];
            let mode = cia402.axis(n).unwrap().mode();
            let r = &mut self.random;
            let (since, centre) = *self.own[n].get_or_insert((self.now, last));
            let elapsed = self.now - since;
            let limit = axis.config.step_limit.min(i32::MAX as u32) as i32;
            let (low, high) = axis.config.bounds.unwrap_or((centre - 50_000, centre + 50_000));
            if !mode.is_cyclic() {
                // A profile needs some time for its targets.
                if r.below(100) == 0 {
                    let target = match axis.style {
                        Style::Wild if r.chance(30) => r.pick(&[i32::MIN, i32::MAX]),
                        Style::Rest => centre,
                        _ => r.range(low.into(), high.into()) as i32,
                    };
                    let _ = cia402.axis_mut(n).unwrap().set_target(target);
                }
                continue;
            }
            let target = match axis.style {
                Style::Rest => last,
                Style::Climb => last.saturating_add(limit),
                Style::Reverse(ms) => {
                    let sign = if (elapsed / MS / ms).is_multiple_of(2) { 1 } else { -1 };
                    last.saturating_add(sign * limit)
                }
                Style::Sine(ms) => {
                    let phase = elapsed as f64 / 1e6 / ms as f64 * std::f64::consts::TAU;
                    // At 70 % of the limit where it is fastest.
                    let period = ms as f64 * 1e6 / self.plan.target_ns() as f64;
                    let amplitude = 0.7 * f64::from(limit) * period / std::f64::consts::TAU;
                    centre.saturating_add((amplitude * phase.sin()) as i32)
                }
                Style::Wild => match r.below(12) {
                    0 => r.range(i32::MIN.into(), i32::MAX.into()) as i32,
                    1 => last.saturating_add(3 * limit),
                    _ => last.saturating_add(r.range(-i64::from(limit), i64::from(limit)) as i32),
                },
            };
            let target = match axis.style {
                Style::Wild => target,
                _ if axis.config.bounds.is_some() => target.clamp(low.min(last), high.max(last)),
                _ => target,
            };
            let limits = axis.config.feed_forward;
            if axis.config.pdos.outputs.is_empty() || r.below(20) == 0 {
                let _ = cia402.axis_mut(n).unwrap().set_target(target);
                continue;
            }
            // In the direction of the motion, or anything, also beyond the limits.
            let velocity = limits.velocity.min(i32::MAX as u32) as i32;
            let forward = match r.below(4) {
                0 => r.pick(&[i32::MIN, -velocity, 0, velocity, i32::MAX]),
                _ => velocity * (target > last) as i32 - velocity * (target < last) as i32,
            };
            let torque = limits.torque as i16;
            let torque = r.pick(&[i16::MIN, -torque, 0, torque, i16::MAX]);
            let _ = cia402.axis_mut(n).unwrap().set_target(
                Target::from(target).with_feed_forward(FeedForward { velocity: forward, torque }),
            );
        }
    }
}

/// Counts the responses to SDO requests in a cycle that the application skips.
pub fn note_lost_responses(
    cycle: &mut Cycle<'_>,
    plan: &Plan,
    classes: &[Class],
    monitors: &mut [AxisMonitor],
) {
    for item in cycle.received() {
        let ReceivedView::Frame { slave: from, packet } = item else { continue };
        for (n, axis) in plan.axes.iter().enumerate() {
            let NodeAddress { slave, channel, node } = axis.config.address;
            let is_response = packet.frame.id() == CobId::sdo_server(node).can_id();
            if is_response && (from, packet.channel) == (slave, channel) {
                monitors[n].response_lost(classes[n]);
            }
        }
    }
}
