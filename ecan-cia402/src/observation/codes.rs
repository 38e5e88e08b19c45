//! Numbers of the states in a snapshot. Host and observer are the same program: they may change.

use ecan_canopen::{DriveState, Heartbeat, NmtState, OperatingMode};

use crate::axis::power::StopCause;
use crate::axis::status::AxisPhase;
use crate::axis::status::HomingState;
use crate::guard::terms::{GuardState, HoldReason, PositionUnavailable, WaitReason};

/// Number of "none" where 0 is a value.
const NONE: u8 = 0xFF;

/// A function that returns the value with a number, by a list in the order of the declaration.
macro_rules! by_number {
    ($decode:ident: $type:ident { $($variant:ident)* }) => {
        pub(super) fn $decode(number: u8) -> Option<$type> {
            const ALL: &[$type] = &[$($type::$variant),*];
            let found = ALL.get(usize::from(number)).copied();
            debug_assert!(found.is_none_or(|value| value as u8 == number));
            found
        }
    };
}

by_number! { drive_state: DriveState {
    NotReadyToSwitchOn SwitchOnDisabled ReadyToSwitchOn SwitchedOn OperationEnabled QuickStopActive
    FaultReactionActive Fault
} }

by_number! { heartbeat: Heartbeat { Unconfigured Unknown Active TimedOut } }

by_number! { homing_state: HomingState { Running Waiting Found Attained Failing Failed } }

by_number! { wait_reason: WaitReason {
    WorkingCounter ImageUnconfirmed NoFreshPosition HoldsOldTarget ImageFull Backlog NotDue
    NotReceived Together Spent Rejected
} }

by_number! { position_unavailable: PositionUnavailable {
    NoImage Damaged Incomplete Layout Backlog NoTpdo
} }

pub(super) fn drive_state_number(state: Option<DriveState>) -> u8 {
    state.map_or(NONE, |state| state as u8)
}

/// The number that the compiler gives to no state, at present: so nothing is converted.
const NO_NMT_STATE: u8 = 0x80;

/// State of a node: 8 bits.
#[inline(always)]
pub(super) fn nmt_number(state: Option<NmtState>) -> u8 {
    state.map_or(NO_NMT_STATE, |state| state as u8)
}

pub(super) fn nmt_state(number: u8) -> Option<NmtState> {
    NmtState::from_raw(number)
}

/// Declares the numbers of the variants of an enum once: a function to the number and detail of a value, and one
/// back. A variant with fields has the number of its detail, and the value with that number.
macro_rules! numbers {
    ($encode:ident, $decode:ident: $type:ident {
        $($number:literal $variant:ident $(($($field:ident),+) $to:expr => $from:ident: $value:expr)?;)*
    }) => {
        fn $encode(value: $type) -> (u32, u32) {
            match value {
                $($type::$variant $(($($field),+))? => ($number, numbers!(@detail $($to)?)),)*
            }
        }

        fn $decode(number: u32, detail: u32) -> Option<$type> {
            match number {
                $($number => numbers!(@value $type::$variant, detail $(, $from: $value)?),)*
                _ => None,
            }
        }
    };
    (@detail) => { 0 };
    (@detail $to:expr) => { $to };
    (@value $type:ident::$variant:ident, $detail:ident) => { Some($type::$variant) };
    (@value $type:ident::$variant:ident, $detail:ident, $from:ident: $value:expr) => {{
        let $from = $detail;
        $value
    }};
}

numbers! { hold_parts, hold_of: HoldReason {
    1 GatewayLost;
    2 FramesDiscarded;
    3 WorkingCounter;
    4 BusOff;
    5 ChannelStopped;
    6 QueueFull;
    7 TargetLost;
    8 HeartbeatLost;
    9 NotOperational;
    10 Unverified;
    11 TpdoLost(cause) cause as u32 => detail: position_unavailable(detail as u8).map(HoldReason::TpdoLost);
    12 LeftOperationEnabled(state) state as u32 => detail: drive_state(detail as u8).map(HoldReason::LeftOperationEnabled);
    13 NotFollowing;
    14 FollowingError;
    15 Commanded;
    16 NotAtTarget;
} }

/// Reason of a hold: 16 bits, 0 for none.
pub(super) fn hold_number(reason: Option<HoldReason>) -> u16 {
    let (kind, detail) = reason.map_or((0, 0), hold_parts);
    (kind | detail << 8) as u16
}

pub(super) fn hold_reason(number: u16) -> Option<HoldReason> {
    hold_of(u32::from(number) & 0xFF, u32::from(number) >> 8)
}

numbers! { stop_parts, stop_of: StopCause {
    1 QuickStop;
    2 Disable;
    3 StopAll;
    4 Shutdown;
    5 Held(reason) hold_number(Some(reason)).into() => detail: hold_reason(detail as u16).map(StopCause::Held);
    6 Procedure;
    7 EnableTimedOut;
    8 Configure;
    9 Takeover;
} }

/// Cause of a stop: 24 bits, 0 for none.
pub(super) fn stop_number(cause: Option<StopCause>) -> u32 {
    let (kind, detail) = cause.map_or((0, 0), stop_parts);
    kind | detail << 8
}

pub(super) fn stop_cause(number: u32) -> Option<StopCause> {
    stop_of(number & 0xFF, number >> 8 & 0xFFFF)
}

/// Number of [`AxisPhase::Running`].
pub(super) const PHASE_RUNNING: u32 = 8;

numbers! { phase_parts, phase_of: AxisPhase {
    0 NotConfigured;
    1 Configuring;
    2 SettingMode(mode) mode_number(mode) => detail: mode(detail as u8).map(AxisPhase::SettingMode);
    3 SetupFailed;
    4 Standby;
    5 Reading(guard, reason) reading_number(guard, reason) => detail: reading(detail);
    6 Ready;
    7 Enabling(state) drive_state_number(state).into() => detail: Some(AxisPhase::Enabling(drive_state(detail as u8)));
    8 Running;
    9 Halted;
    10 Holding(reason) hold_number(Some(reason)).into() => detail: hold_reason(detail as u16).map(AxisPhase::Holding);
    11 Stopping(cause) stop_number(Some(cause)) => detail: stop_cause(detail).map(AxisPhase::Stopping);
    12 Stopped(cause) stop_number(Some(cause)) => detail: stop_cause(detail).map(AxisPhase::Stopped);
    13 Uncontrolled(cause) stop_number(Some(cause)) => detail: stop_cause(detail).map(AxisPhase::Uncontrolled);
    14 Inspecting;
    15 ResettingFault;
    16 Fault;
    17 ChangingMode(mode) mode_number(mode) => detail: mode(detail as u8).map(AxisPhase::ChangingMode);
    18 PreparingHoming;
    19 Homing(state) state as u32 => detail: homing_state(detail as u8).map(AxisPhase::Homing);
} }

/// Detail of [`AxisPhase::Reading`].
fn reading_number(guard: GuardState, reason: Option<HoldReason>) -> u32 {
    u32::from(guard == GuardState::Draining) | u32::from(hold_number(reason)) << 8
}

fn reading(detail: u32) -> Option<AxisPhase> {
    let guard = if detail & 1 == 1 { GuardState::Draining } else { GuardState::Reading };
    Some(AxisPhase::Reading(guard, hold_reason((detail >> 8) as u16)))
}

/// Phase of an axis: 32 bits.
pub(super) fn phase_number(phase: AxisPhase) -> u32 {
    let (kind, detail) = phase_parts(phase);
    kind | detail << 8
}

pub(super) fn phase(number: u32) -> Option<AxisPhase> {
    phase_of(number & 0xFF, number >> 8)
}

pub(super) fn mode_number(mode: OperatingMode) -> u32 {
    u32::from(mode.raw().cast_unsigned())
}

pub(super) fn mode(number: u8) -> Option<OperatingMode> {
    OperatingMode::from_raw(number.cast_signed())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(crate) fn holds() -> Vec<HoldReason> {
        let kinds = (1..=u8::MAX).filter(|kind| *kind != 11 && *kind != 12);
        let plain = kinds.filter_map(|kind| hold_reason(u16::from(kind)));
        let missing = (0..8).filter_map(position_unavailable).map(HoldReason::TpdoLost);
        let left = (0..8).filter_map(drive_state).map(HoldReason::LeftOperationEnabled);
        plain.chain(missing).chain(left).collect()
    }

    pub(crate) fn stops() -> Vec<StopCause> {
        let plain = (0..=0xFF).filter(|kind| *kind != 5).filter_map(stop_cause);
        plain.chain(holds().into_iter().map(StopCause::Held)).collect()
    }

    pub(crate) fn phases() -> Vec<AxisPhase> {
        let modes = || OperatingMode::ALL.iter().copied();
        let mut all = vec![AxisPhase::Enabling(None)];
        all.extend([0, 1, 3, 4, 6, 8, 9, 14, 15, 16, 18].into_iter().filter_map(phase));
        all.extend(modes().map(AxisPhase::SettingMode));
        all.extend(modes().map(AxisPhase::ChangingMode));
        all.extend((0..8).filter_map(drive_state).map(|state| AxisPhase::Enabling(Some(state))));
        all.extend((0..8).filter_map(homing_state).map(AxisPhase::Homing));
        all.extend(holds().into_iter().map(AxisPhase::Holding));
        for guard in [GuardState::Draining, GuardState::Reading] {
            all.push(AxisPhase::Reading(guard, None));
            all.extend(holds().into_iter().map(|reason| AxisPhase::Reading(guard, Some(reason))));
        }
        for cause in stops() {
            all.push(AxisPhase::Stopping(cause));
            all.push(AxisPhase::Stopped(cause));
            all.push(AxisPhase::Uncontrolled(cause));
        }
        all
    }

    #[test]
    fn every_state_is_read_as_written() {
        assert_eq!((holds().len(), stops().len()), (14 + 6 + 8, 8 + 28));
        assert_eq!(hold_reason(hold_number(None)), None);
        assert_eq!(stop_cause(stop_number(None)), None);
        for reason in holds() {
            assert_eq!(hold_reason(hold_number(Some(reason))), Some(reason));
        }
        for cause in stops() {
            assert_eq!(stop_cause(stop_number(Some(cause))), Some(cause));
        }
        for found in phases() {
            assert_eq!(phase(phase_number(found)), Some(found));
        }
        assert_eq!(phase_number(AxisPhase::Running), PHASE_RUNNING);
        assert_eq!(drive_state(drive_state_number(None)), None);
        assert_eq!(nmt_state(nmt_number(None)), None);
        for state in NmtState::ALL {
            assert_eq!(nmt_state(nmt_number(Some(*state))), Some(*state));
        }
        assert_eq!((0..20).filter_map(wait_reason).count(), 11);
        assert_eq!((0..20).filter_map(heartbeat).count(), 4);
    }
}
