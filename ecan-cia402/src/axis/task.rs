//! Command that the drive of an axis executes, its procedure and its recovery.

use std::time::Duration;

use ecan_canopen::{Configuring, Controlword, DriveState, Network};

use super::plan::AxisPlan;
use super::power::{FaultReset, PowerGoal, Stop, StopCause};
use super::procedure::Procedure;
use super::procedure::Recovery;
use super::script::Script;

/// State of an axis: the command that its drive executes.
///
/// In parallel with this state, the [`SetupState`](super::setup::SetupState) states how much of the drive's
/// configuration is known, the [`FirstContact`](super::takeover::FirstContact) what is known about
/// a drive at the first contact, the [`MotionGuard`](super::MotionGuard) decides about targets, the
/// [`AxisSetup`](super::setup::AxisSetup) verifies the configuration after a connection
/// loss, and a [`Procedure`] (mode change or homing) issues commands as the application does.
///
/// "Any" includes every setup: a drive that process data do not reach is stopped by SDO. A unit test compares
/// this table with [`AxisState::next`], which ignores an event in every other state.
///
/// | from | event | to |
/// | --- | --- | --- |
/// | any | `Stop`: a command, a hold, a timeout, or an enabled drive at the first contact | `Stopping` |
/// | `Stopping` | `Stop`: by the stronger of both | `Stopping` |
/// | `Stopping` | `Enable`: it waits for the end of the stop | `Stopping` |
/// | `Stopping` | `Stopped`: off, or in Quick Stop Active after a quick stop, and at rest; or it never reported anything and does not answer | `Stopped` |
/// | `Stopped` | `EnabledAgain`: a command to enable was on the path to the drive | `Stopping` |
/// | any but `Stopping` | `Enable`, while the guard follows targets | `Active` |
/// | any but `Stopping` | `Enable`, while it does not | `Enabling` |
/// | `Enabling` | `FirstTarget` was sent | `Active` |
/// | `Enabling` | `OldTarget`: the drive holds one that is far from its position | `ReEnabling` |
/// | `ReEnabling` | `SwitchedOff`: the drive is in Switch On Disabled | `Enabling` |
/// | `Enabling` | `Fault` of the drive | `Standby` |
/// | `ReEnabling` | `Fault` of the drive | `Standby` |
/// | any but `Stopping`, `Stopped`, `Releasing` | `Hold` of the guard, in a position mode | `Standby` |
/// | any but `Stopping`, `Stopped`, `Releasing` | `Hold` of the guard, in another mode | `Stopping` |
/// | `Standby` | `Resume`: the guard held, and the axis may become active again automatically | `Resuming` |
/// | `Resuming` | `FirstTarget` was sent | `Active` |
/// | `Resuming` | `OldTarget`: an axis that resumes is not switched off | `Standby` |
/// | `Resuming` | `LeftOperation`: the drive left Operation Enabled | `Standby` |
/// | any | `ResetFault`, with the drive in Fault or Fault Reaction Active | `ResettingFault` |
/// | `ResettingFault` | `ResetEnded`: the drive left Fault, or stays in it | `Standby` |
/// | `Stopped` | `Release`: shutdown | `Releasing` |
/// | `Releasing` | `Released` | `Standby` |
/// | any but `Stopping` | `Restarted`: the drive lost its configuration | `Standby` |
/// | any | `Configured`: the configuration begins, or the drive is adopted | `Standby` |
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[expect(clippy::large_enum_variant, reason = "a box would allocate in the cycle")]
pub(crate) enum AxisState {
    /// The drive receives no command.
    #[default]
    Standby,
    /// The guard establishes the position, and the drive is brought to Operation Enabled.
    Enabling {
        since_ns: u64,
    },
    /// The drive is switched off, so that it drops an old target, and then enabled.
    ReEnabling {
        since_ns: u64,
    },
    /// The drive is enabled and follows targets.
    Active,
    /// The axis held while its drive stayed enabled, and becomes active again automatically.
    Resuming,
    /// The drive is being stopped. Only completion ends it.
    Stopping(Stop),
    /// The drive reported that it has stopped.
    Stopped(Stop),
    ResettingFault(FaultReset),
    /// Shutdown: the drive stops watching the host's heartbeat.
    Releasing(Script),
}

/// Event that changes the [`AxisState`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(clippy::large_enum_variant, reason = "a box would allocate in the cycle")]
pub(crate) enum StateEvent {
    Stop(StopCause),
    Stopped,
    EnabledAgain,
    Enable { follows_targets: bool },
    FirstTarget,
    OldTarget,
    SwitchedOff,
    Fault,
    Hold { cause: StopCause, must_stop: bool },
    Resume,
    LeftOperation,
    ResetFault(FaultReset),
    ResetEnded,
    Release(Script),
    Released,
    Restarted,
    Configured,
}

impl AxisState {
    /// Returns the state after an event.
    fn next(self, event: StateEvent, now_ns: u64) -> Self {
        match (self, event) {
            (_, StateEvent::Stop(cause)) => self.stopped_by(cause, now_ns),
            (Self::Stopping(stop), StateEvent::Stopped) => Self::Stopped(stop),
            (Self::Stopped(stop), StateEvent::EnabledAgain) => self.stopped_by(stop.cause, now_ns),
            (Self::Stopping(stop), StateEvent::Enable { .. }) => {
                Self::Stopping(stop.then_enable(now_ns))
            }
            (_, StateEvent::Enable { follows_targets: true }) => Self::Active,
            (_, StateEvent::Enable { follows_targets: false }) => {
                Self::Enabling { since_ns: now_ns }
            }
            (Self::Enabling { .. } | Self::Resuming, StateEvent::FirstTarget) => Self::Active,
            (Self::Enabling { since_ns }, StateEvent::OldTarget) => Self::ReEnabling { since_ns },
            (Self::ReEnabling { since_ns }, StateEvent::SwitchedOff) => Self::Enabling { since_ns },
            // Nothing is commanded that could move the axis, and a drive that would continue to move is stopped.
            (
                Self::Stopping(_) | Self::Stopped(_) | Self::Releasing(_),
                StateEvent::Hold { .. },
            ) => self,
            (_, StateEvent::Hold { cause, must_stop: true }) => self.stopped_by(cause, now_ns),
            (Self::Standby, StateEvent::Resume) => Self::Resuming,
            (_, StateEvent::ResetFault(reset)) => Self::ResettingFault(reset),
            (Self::Stopped(_), StateEvent::Release(script)) => Self::Releasing(script),
            (Self::Stopping(_), StateEvent::Restarted) => self,
            (Self::Enabling { .. } | Self::ReEnabling { .. }, StateEvent::Fault)
            | (Self::Resuming, StateEvent::OldTarget | StateEvent::LeftOperation)
            | (Self::ResettingFault(_), StateEvent::ResetEnded)
            | (Self::Releasing(_), StateEvent::Released)
            | (
                _,
                StateEvent::Hold { must_stop: false, .. }
                | StateEvent::Restarted
                | StateEvent::Configured,
            ) => Self::Standby,
            _ => self,
        }
    }

    /// Start of the command to enable, while it is not complete.
    pub(crate) fn enabling_since_ns(&self) -> Option<u64> {
        match *self {
            Self::Enabling { since_ns } | Self::ReEnabling { since_ns } => Some(since_ns),
            Self::Stopping(stop) => stop.enable_since_ns,
            _ => None,
        }
    }

    /// The stop that is pending or complete.
    pub(crate) fn stop(&self) -> Option<&Stop> {
        match self {
            Self::Stopping(stop) | Self::Stopped(stop) => Some(stop),
            _ => None,
        }
    }

    pub(crate) fn is_stopping(&self) -> bool {
        matches!(self, Self::Stopping(_))
    }

    /// The state after a command to stop.
    fn stopped_by(&self, cause: StopCause, now_ns: u64) -> Self {
        let later = Stop::new(cause, now_ns);
        Self::Stopping(self.stop().map_or(later, |before| before.and(later)))
    }

    /// Returns whether the host commands the drive to do more than to stop, so that its node must be
    /// Operational.
    pub(crate) fn needs_operational(&self) -> bool {
        self.stop().is_none()
            && (self.power_goal() != PowerGoal::None || matches!(self, Self::ResettingFault(_)))
    }

    pub(crate) fn power_goal(&self) -> PowerGoal {
        match self {
            Self::Enabling { .. } | Self::Active => PowerGoal::Enabled,
            Self::ReEnabling { .. } | Self::Releasing(_) => PowerGoal::Disabled,
            Self::Stopping(stop) | Self::Stopped(stop) => stop.goal(),
            Self::Standby | Self::Resuming | Self::ResettingFault(_) => PowerGoal::None,
        }
    }

    /// Controlword to send to a drive in this state; `None` if none is to be sent.
    pub(crate) fn controlword(
        &self,
        drive: Option<DriveState>,
        is_at_rest: bool,
    ) -> Option<Controlword> {
        if let Some(stop) = self.stop() {
            return stop.command(drive, is_at_rest).map(Controlword::of);
        }
        let drive = drive?;
        match self {
            Self::ResettingFault(reset) => reset.controlword(drive),
            _ => self.power_goal().command(drive, is_at_rest).map(Controlword::of),
        }
    }
}

/// Task of an axis: the command that its drive executes, and what issues further commands.
#[derive(Debug, Default)]
pub(crate) struct AxisTask {
    state: AxisState,
    pub(crate) procedure: Option<Procedure>,
    pub(crate) recovery: Option<Recovery>,
}

impl AxisTask {
    pub(crate) fn state(&self) -> &AxisState {
        &self.state
    }

    /// Applies an event to the state.
    pub(crate) fn apply(&mut self, event: StateEvent, now_ns: u64) {
        self.state = self.state.next(event, now_ns);
    }

    pub(crate) fn is_stopping(&self) -> bool {
        self.state.is_stopping()
    }

    pub(crate) fn is_stopped(&self) -> bool {
        matches!(self.state, AxisState::Stopped(_))
    }

    /// Returns whether a command to enable is not complete.
    pub(crate) fn is_enabling(&self) -> bool {
        self.state.enabling_since_ns().is_some()
    }

    /// Returns whether the drive is being switched off, in place of remaining in Quick Stop Active.
    pub(crate) fn is_switching_off(&self) -> bool {
        matches!(self.state, AxisState::Stopping(stop) if stop.goal() != PowerGoal::QuickStopped)
    }

    /// The drive of a pending stop does not remain in Quick Stop Active.
    pub(crate) fn switch_off_at_rest(&mut self) {
        if let AxisState::Stopping(stop) = &mut self.state {
            stop.switch_off_at_rest();
        }
    }

    /// Counts a cycle of a pending stop, and returns the stop. `is_fresh` states whether the drive's status is
    /// present.
    pub(crate) fn note_status(&mut self, is_fresh: bool, now_ns: u64) -> Option<Stop> {
        let AxisState::Stopping(stop) = &mut self.state else { return None };
        stop.note_status(is_fresh, now_ns);
        Some(*stop)
    }

    /// Ends a command to enable that has waited too long for the end of a stop; returns its time.
    pub(crate) fn expire_enable(&mut self, timeout: Duration, now_ns: u64) -> Option<Duration> {
        let AxisState::Stopping(stop) = &mut self.state else { return None };
        let waited = Duration::from_nanos(now_ns.saturating_sub(stop.enable_since_ns?));
        if waited <= timeout {
            return None;
        }
        stop.enable_since_ns = None;
        Some(waited)
    }

    /// Counts a sent frame of a fault reset.
    pub(crate) fn count_reset_frame(&mut self) {
        if let AxisState::ResettingFault(reset) = &mut self.state {
            reset.count_frame();
        }
    }

    /// Continues the release of a drive. Returns whether it has ended; a drive that does not answer needs no
    /// release.
    pub(crate) fn step_release(
        &mut self,
        plan: &AxisPlan,
        network: &mut Network,
        now_ns: u64,
    ) -> bool {
        let AxisState::Releasing(script) = &mut self.state else { return false };
        match script.advance(network, plan.node, now_ns, |_, _, _| {}) {
            Configuring::Running => false,
            Configuring::Done | Configuring::Failed(_) => true,
        }
    }

    /// Cancels the transfers of a release. Returns whether one was running.
    pub(crate) fn cancel_release(&self, plan: &AxisPlan, network: &mut Network) -> bool {
        let AxisState::Releasing(script) = self.state else { return false };
        script.cancel(network, plan.node);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::script::axis_script;
    use crate::guard::terms::HoldReason;
    use ecan_canopen::Command;

    const HELD: StopCause = StopCause::Held(HoldReason::BusOff);
    const COMMANDING: [AxisState; 4] = [
        AxisState::Active,
        AxisState::Enabling { since_ns: 1 },
        AxisState::ReEnabling { since_ns: 1 },
        AxisState::Resuming,
    ];

    fn hold(must_stop: bool) -> StateEvent {
        StateEvent::Hold { cause: HELD, must_stop }
    }

    /// All states, with their names.
    fn states() -> Vec<(&'static str, AxisState)> {
        let stop = Stop::new(StopCause::Disable, 1);
        vec![
            ("Standby", AxisState::Standby),
            ("Enabling", AxisState::Enabling { since_ns: 1 }),
            ("ReEnabling", AxisState::ReEnabling { since_ns: 1 }),
            ("Active", AxisState::Active),
            ("Resuming", AxisState::Resuming),
            ("Stopping", AxisState::Stopping(stop)),
            ("Stopped", AxisState::Stopped(stop)),
            ("ResettingFault", AxisState::ResettingFault(FaultReset::new(1))),
            ("Releasing", AxisState::Releasing(axis_script(0, []))),
        ]
    }

    /// All events, with their texts in the table.
    fn events() -> Vec<(&'static str, StateEvent)> {
        let follows = |follows_targets| StateEvent::Enable { follows_targets };
        vec![
            ("`Stop`", StateEvent::Stop(StopCause::StopAll)),
            ("`Stopped`", StateEvent::Stopped),
            ("`EnabledAgain`", StateEvent::EnabledAgain),
            ("`Enable`, while the guard follows targets", follows(true)),
            ("`Enable`, while it does not", follows(false)),
            ("`FirstTarget`", StateEvent::FirstTarget),
            ("`OldTarget`", StateEvent::OldTarget),
            ("`SwitchedOff`", StateEvent::SwitchedOff),
            ("`Fault`", StateEvent::Fault),
            ("`Hold` of the guard, in a position mode", hold(false)),
            ("`Hold` of the guard, in another mode", hold(true)),
            ("`Resume`", StateEvent::Resume),
            ("`LeftOperation`", StateEvent::LeftOperation),
            ("`ResetFault`", StateEvent::ResetFault(FaultReset::new(2))),
            ("`ResetEnded`", StateEvent::ResetEnded),
            ("`Release`", StateEvent::Release(axis_script(1, []))),
            ("`Released`", StateEvent::Released),
            ("`Restarted`", StateEvent::Restarted),
            ("`Configured`", StateEvent::Configured),
        ]
    }

    /// State of the table after an event; `None` if no row applies.
    fn documented(from: &str, event: &str) -> Option<String> {
        let rows = include_str!("task.rs").lines().filter_map(|line| line.strip_prefix("/// | "));
        let rows = rows.map(|row| row.trim_end_matches(" |").splitn(3, " | ").collect::<Vec<_>>());
        let mut found = None;
        for row in rows {
            let [states, text, to] = row[..] else { continue };
            let applies = match states.strip_prefix("any") {
                Some(excluded) => !excluded.contains(&format!("`{from}`")),
                None => states == format!("`{from}`"),
            };
            if applies && (text.starts_with(event) || event.starts_with(text)) {
                // A row of one state precedes those of any state.
                let is_special = !states.starts_with("any");
                if found.is_none() || is_special {
                    found = Some(to.trim_matches('`').to_owned());
                }
            }
        }
        found
    }

    #[test]
    fn table_of_the_documentation_is_the_state_machine() {
        for (from, state) in states() {
            for (text, event) in events() {
                let next = state.next(event, 5);
                let is_to =
                    |to: &AxisState| std::mem::discriminant(to) == std::mem::discriminant(&next);
                let to = states().into_iter().find(|(_, to)| is_to(to)).map(|(name, _)| name);
                let event_name = match text.split_once(", ") {
                    Some((name, _)) if from == "Stopping" && name == "`Enable`" => name,
                    _ => text,
                };
                match documented(from, event_name) {
                    Some(documented) => assert_eq!(to, Some(&*documented), "{from} {text}"),
                    None => assert_eq!(next, state, "{from} {text}: no row, so no change"),
                }
            }
        }
    }

    #[test]
    fn hold_never_enables_and_stops_a_moving_drive() {
        for state in COMMANDING {
            assert_eq!(state.next(hold(false), 5), AxisState::Standby, "{state:?}");
            let stopped = state.next(hold(true), 5);
            assert_eq!(stopped.power_goal(), PowerGoal::QuickStopped, "{state:?}");
        }
        let off = AxisState::Stopped(Stop::new(StopCause::Disable, 1));
        assert_eq!(off.next(hold(true), 5), off);
    }

    #[test]
    fn stop_begins_in_every_state_and_is_never_weakened() {
        let quick = AxisState::default().stopped_by(StopCause::QuickStop, 1);
        let states = COMMANDING.into_iter().chain([AxisState::Standby, quick]);
        for state in states {
            let stopping = state.stopped_by(StopCause::StopAll, 2);
            assert!(stopping.is_stopping(), "{state:?}");
            let word = stopping.controlword(Some(DriveState::OperationEnabled), false);
            assert_eq!(word, Some(Controlword::of(Command::QuickStop)), "{state:?}");
        }
        let off = quick.stopped_by(StopCause::Disable, 2);
        let braking = off.controlword(Some(DriveState::QuickStopActive), false);
        assert_eq!(braking, Some(Controlword::of(Command::QuickStop)));
    }

    #[test]
    fn standby_sends_no_command() {
        for drive in [None, Some(DriveState::OperationEnabled), Some(DriveState::Fault)] {
            assert_eq!(AxisState::Standby.controlword(drive, true), None);
        }
        assert!(!AxisState::Standby.needs_operational());
    }
}
