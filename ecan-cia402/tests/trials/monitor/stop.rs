//! Stops: whether the drive obeys in time, and the permission to enable it again.

use ecan_canopen::OperatingMode;
use ecan_sim::TraceCause;

use super::{AxisMonitor, Path, Permit, REST};
use crate::bounds::LostAttempts;
use crate::plan::MS;
use crate::report::{Kind, StopSample};
use crate::sdk::Class;

/// Origin of a stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum StopKind {
    QuickStop,
    Disable,
    StopAll,
    Takeover,
    /// The SDK holds an axis that would move on.
    Hold,
    Shutdown,
    Configure,
}

#[derive(Debug, Clone, Copy)]
pub struct Stop {
    pub(super) kind: StopKind,
    pub(super) at_ns: u64,
    /// Time for which a frame could reach the drive since the last disturbance of the path.
    pub(super) services_ns: u64,
    pub(super) process_data_ns: u64,
    /// Responses to SDO requests that the application did not take in that time.
    pub(super) lost_responses: u64,
    /// Those of them that a configuration waited for.
    pub(super) lost_by_configuration: u64,
    pub(super) was_blocked: bool,
    pub(super) was_paused: bool,
    pub(super) was_configured: bool,
    /// The drive ceased to follow since the call.
    pub(super) is_obeyed: bool,
    pub(super) class: Class,
    pub(super) velocity: f64,
    /// The drive followed targets at the call: the latency is measured.
    pub(super) is_measured: bool,
    /// Time that the stop may need beyond the bounds.
    pub(super) allowance_ns: u64,
}

impl Stop {
    pub(super) fn forget_losses(&mut self) {
        (self.lost_responses, self.lost_by_configuration) = (0, 0);
    }

    /// Attempts of the stop that were lost.
    fn lost_attempts(&self) -> LostAttempts {
        if !(self.was_blocked || self.was_paused) {
            return LostAttempts::default();
        }
        LostAttempts {
            first: true,
            // The first one was lost while the path was blocked, or is the first of these.
            further: self.lost_responses.saturating_sub(u64::from(!self.was_blocked)),
            // The configuration of a drive that counts as absent reads its state first.
            by_configuration: self.lost_by_configuration,
        }
    }
}

impl AxisMonitor {
    /// The application did not take a response of the drive to an SDO request.
    pub fn response_lost(&mut self, class: Class) {
        if let Some(stop) = &mut self.stop {
            stop.lost_responses += 1;
            stop.lost_by_configuration += u64::from(class == Class::Configuring);
        }
    }

    /// A stop was called, or is due.
    pub fn stopping(&mut self, now: u64, kind: StopKind, class: Class) {
        // A recovery continues after a hold.
        if kind != StopKind::Hold || self.permit != Permit::Procedure {
            self.permit = Permit::None;
        }
        // A stop that is pending already keeps its time.
        let pending = self.stop.filter(|stop| !stop.is_obeyed && self.follows);
        if pending.is_none() {
            self.stop = Some(Stop {
                kind,
                at_ns: now,
                services_ns: 0,
                process_data_ns: 0,
                lost_responses: 0,
                lost_by_configuration: 0,
                was_blocked: false,
                was_paused: false,
                was_configured: self.was_process_data,
                is_obeyed: !self.follows,
                class,
                velocity: self.velocity,
                is_measured: self.follows,
                allowance_ns: 0,
            });
        }
    }

    /// Another owner begins to command the drive: it stops it, or adopts it at rest.
    pub fn takeover(&mut self, now: u64, adopts: bool) {
        let moves_on = matches!(
            self.mode,
            Some(
                OperatingMode::CyclicVelocity
                    | OperatingMode::CyclicTorque
                    | OperatingMode::ProfileVelocity
                    | OperatingMode::ProfileTorque
                    | OperatingMode::Velocity
            )
        );
        self.was_running = false;
        self.adoption_ns = if adopts { self.bounds.adoption_ns() } else { 0 };
        if adopts && !(moves_on && self.is_moving()) {
            // Without targets and SYNC the others come to rest. A stop of the earlier owner may not have left it.
            if self.stop.take().is_some() {
                self.late_enable_until = now + self.bounds.late_enable_ns();
            }
            return;
        }
        if self.bounds.ignores_quick_stop() {
            // The new owner starts its own time for a drive that ignores the quick stop.
            self.stop = None;
        }
        self.stopping(now, StopKind::Takeover, Class::NotConfigured);
        if let Some(stop) = self.stop.as_mut().filter(|_| adopts) {
            stop.allowance_ns = self.adoption_ns;
        }
    }

    /// The drive got the velocity 0: with it the next owner may adopt a drive at rest, since no velocity and no
    /// stop of the earlier one is in force.
    pub(super) fn stand(&mut self) {
        if self.stop.as_ref().is_some_and(|stop| stop.allowance_ns > 0) {
            self.stop = None;
        }
        let may_adopt = self.adoption_ns > 0 && !self.was_running;
        if may_adopt && !self.is_moving() {
            self.targets.clear();
        }
    }

    /// A running axis was halted and must be at rest after its bound, in undisturbed cycles.
    pub fn halting(&mut self) {
        self.halt.get_or_insert(self.bounds.halt_ns());
    }

    pub fn resuming(&mut self) {
        self.halt = None;
    }

    pub(super) fn check_halt(&mut self, now: u64, ns: u64, path: Path, class: Class) {
        let Some(left) = &mut self.halt else { return };
        if class != Class::Halted && class != Class::Running || now < self.unlimited_until {
            self.halt = None;
            return;
        }
        if path == Path::ProcessData {
            *left = left.saturating_sub(ns);
        }
        if *left == 0 && self.is_moving() && self.follows {
            let text = format!("{:.0}/s, {:?}", self.velocity, self.mode);
            self.report(now, Kind::Halt, text);
        }
    }

    pub(super) fn check_stopped(&mut self, now: u64, ns: u64, path: Path, is_stopped: bool) {
        match path {
            Path::Paused => {}
            Path::Services | Path::ProcessData if is_stopped && self.follows => {
                self.not_stopped_ns += ns;
            }
            _ => self.not_stopped_ns = 0,
        }
        if self.not_stopped_ns > self.bounds.stop_by_sdo_ns(LostAttempts::default()) {
            let text = format!("{:.0}/s in {}, {:?}", self.velocity, self.state, self.mode);
            self.report(now, Kind::NotStopped, text);
        }
    }

    pub(super) fn check_stop(&mut self, now: u64, ns: u64, path: Path) {
        let Some(stop) = &mut self.stop else { return };
        match path {
            Path::Blocked | Path::Resumed => {
                stop.services_ns = 0;
                stop.process_data_ns = 0;
                stop.forget_losses();
                stop.was_blocked = true;
            }
            Path::Paused => stop.was_paused = true,
            Path::Services => stop.services_ns += ns,
            Path::ProcessData => {
                stop.services_ns += ns;
                stop.process_data_ns += ns;
            }
        }
        let data_ns = self.bounds.stop_by_process_data_ns();
        let data_ns = data_ns + self.bounds.ignored_stop_ns(data_ns) + stop.allowance_ns;
        let sdo_ns = self.bounds.stop_by_sdo_ns(stop.lost_attempts());
        let sdo_ns = sdo_ns + self.bounds.ignored_stop_ns(sdo_ns) + stop.allowance_ns;
        let by_process_data = stop.process_data_ns > data_ns;
        if !by_process_data && stop.services_ns <= sdo_ns {
            return;
        }
        let stop = *stop;
        let is_enabled_again = stop.is_obeyed && self.permit != Permit::None;
        if self.follows && !is_enabled_again {
            let kind = if by_process_data { Kind::StopByPdo } else { Kind::StopBySdo };
            let text = format!(
                "{:?} in {:?} at {:.0}/s: still in {}, {:.0}/s, after {} ms ({} ms reachable)",
                stop.kind,
                stop.class,
                stop.velocity,
                self.state,
                self.velocity,
                (now - stop.at_ns) / MS,
                stop.services_ns / MS,
            );
            self.report(now, kind, text);
            if !stop.is_obeyed && (now - stop.at_ns) < 20_000 * MS {
                // Its latency is still measured.
                return;
            }
        }
        self.stop = None;
    }

    /// The drive ceased to follow targets.
    pub(super) fn unfollow(&mut self, at_ns: u64, cause: TraceCause) {
        if !self.follows {
            return;
        }
        self.follows = false;
        if let Some(stop) = &mut self.stop
            && !stop.is_obeyed
        {
            stop.is_obeyed = true;
            if stop.is_measured && matches!(cause, TraceCause::Command(_)) {
                let ns = at_ns.saturating_sub(stop.at_ns);
                // Since the last disturbance; the present cycle is not in the sum yet.
                let clear_ns =
                    if stop.was_blocked || stop.was_paused { stop.services_ns.min(ns) } else { ns };
                self.samples.push(StopSample {
                    kind: stop.kind,
                    class: stop.class,
                    was_configured: stop.was_configured,
                    ignores_quick_stop: self.bounds.ignores_quick_stop(),
                    is_moving: stop.velocity.abs() > REST,
                    was_blocked: stop.was_blocked,
                    was_paused: stop.was_paused,
                    ns,
                    clear_ns,
                });
            }
        }
        let is_own = !matches!(cause, TraceCause::Command(_));
        if is_own && self.permit == Permit::Used {
            self.permit = Permit::None;
        }
    }
}
