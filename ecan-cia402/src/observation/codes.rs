//! Numbers of the states in a snapshot. Host and observer are the same program: they may change.

use ecan_canopen::{DriveState, Heartbeat, NmtState, OperatingMode};

use crate::axis::homing::HomingState;
use crate::axis::power::StopCause;
use crate::axis::status::AxisPhase;
use crate::guard::terms::{GuardState, HoldReason, PositionUnavailable, WaitReason};

/// Number of "none" where 0 is a value.
const NONE: u8 = 0xFF;

/// A function that returns the value with a number, by a list in the order of the declaration.
macro_rules! by_number {
    ($decode:ident: $type:ident { $($variant:ident)* }) => {
        pub(super) fn $decode(number: u8) -> Option<$type> {
            const ALL: &[$type] = &[$($type::$variant),*];
            let found = ALL.get(usize::from(number)).copied();
            debug_assert!(found.is_none_or(|it| it as u8 == number));
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

/// Reason of a hold: 16 bits, 0 for none.
pub(super) fn hold_number(reason: Option<HoldReason>) -> u16 {
    let Some(reason) = reason else { return 0 };
    let (kind, detail) = match reason {
        HoldReason::GatewayLost => (1, 0),
        HoldReason::FramesDiscarded => (2, 0),
        HoldReason::WorkingCounter => (3, 0),
        HoldReason::BusOff => (4, 0),
        HoldReason::ChannelStopped => (5, 0),
        HoldReason::QueueFull => (6, 0),
        HoldReason::TargetLost => (7, 0),
        HoldReason::HeartbeatLost => (8, 0),
        HoldReason::NotOperational => (9, 0),
        HoldReason::Unverified => (10, 0),
        HoldReason::TpdoLost(cause) => (11, cause as u8),
        HoldReason::LeftOperationEnabled(state) => (12, state as u8),
        HoldReason::NotFollowing => (13, 0),
        HoldReason::FollowingError => (14, 0),
        HoldReason::Commanded => (15, 0),
        HoldReason::NotAtTarget => (16, 0),
    };
    u16::from_le_bytes([kind, detail])
}

pub(super) fn hold_reason(number: u16) -> Option<HoldReason> {
    let [kind, detail] = number.to_le_bytes();
    Some(match kind {
        1 => HoldReason::GatewayLost,
        2 => HoldReason::FramesDiscarded,
        3 => HoldReason::WorkingCounter,
        4 => HoldReason::BusOff,
        5 => HoldReason::ChannelStopped,
        6 => HoldReason::QueueFull,
        7 => HoldReason::TargetLost,
        8 => HoldReason::HeartbeatLost,
        9 => HoldReason::NotOperational,
        10 => HoldReason::Unverified,
        11 => HoldReason::TpdoLost(position_unavailable(detail)?),
        12 => HoldReason::LeftOperationEnabled(drive_state(detail)?),
        13 => HoldReason::NotFollowing,
        14 => HoldReason::FollowingError,
        15 => HoldReason::Commanded,
        16 => HoldReason::NotAtTarget,
        _ => return None,
    })
}

/// Cause of a stop: 24 bits, 0 for none.
pub(super) fn stop_number(cause: Option<StopCause>) -> u32 {
    let Some(cause) = cause else { return 0 };
    match cause {
        StopCause::QuickStop => 1,
        StopCause::Disable => 2,
        StopCause::StopAll => 3,
        StopCause::Shutdown => 4,
        StopCause::Held(reason) => 5 | u32::from(hold_number(Some(reason))) << 8,
        StopCause::Procedure => 6,
        StopCause::EnableTimedOut => 7,
        StopCause::Configure => 8,
        StopCause::Takeover => 9,
    }
}

pub(super) fn stop_cause(number: u32) -> Option<StopCause> {
    Some(match number & 0xFF {
        1 => StopCause::QuickStop,
        2 => StopCause::Disable,
        3 => StopCause::StopAll,
        4 => StopCause::Shutdown,
        5 => StopCause::Held(hold_reason((number >> 8) as u16)?),
        6 => StopCause::Procedure,
        7 => StopCause::EnableTimedOut,
        8 => StopCause::Configure,
        9 => StopCause::Takeover,
        _ => return None,
    })
}

/// [`AxisPhase::Running`].
pub(super) const PHASE_RUNNING: u32 = 8;

/// Phase of an axis: 32 bits.
pub(super) fn phase_number(phase: AxisPhase) -> u32 {
    let (kind, detail) = match phase {
        AxisPhase::NotConfigured => (0, 0),
        AxisPhase::Configuring => (1, 0),
        AxisPhase::SettingMode(mode) => (2, mode_number(mode)),
        AxisPhase::SetupFailed => (3, 0),
        AxisPhase::Standby => (4, 0),
        AxisPhase::Reading(guard, reason) => {
            let is_draining = u32::from(guard == GuardState::Draining);
            (5, is_draining | u32::from(hold_number(reason)) << 8)
        }
        AxisPhase::Ready => (6, 0),
        AxisPhase::Enabling(state) => (7, u32::from(drive_state_number(state))),
        AxisPhase::Running => (PHASE_RUNNING, 0),
        AxisPhase::Halted => (9, 0),
        AxisPhase::Holding(reason) => (10, u32::from(hold_number(Some(reason)))),
        AxisPhase::Stopping(cause) => (11, stop_number(Some(cause))),
        AxisPhase::Stopped(cause) => (12, stop_number(Some(cause))),
        AxisPhase::Uncontrolled(cause) => (13, stop_number(Some(cause))),
        AxisPhase::Inspecting => (14, 0),
        AxisPhase::ResettingFault => (15, 0),
        AxisPhase::Fault => (16, 0),
        AxisPhase::ChangingMode(mode) => (17, mode_number(mode)),
        AxisPhase::PreparingHoming => (18, 0),
        AxisPhase::Homing(state) => (19, u32::from(state as u8)),
    };
    kind | detail << 8
}

pub(super) fn phase(number: u32) -> Option<AxisPhase> {
    let detail = number >> 8;
    let byte = detail as u8;
    Some(match number & 0xFF {
        0 => AxisPhase::NotConfigured,
        1 => AxisPhase::Configuring,
        2 => AxisPhase::SettingMode(mode(byte)?),
        3 => AxisPhase::SetupFailed,
        4 => AxisPhase::Standby,
        5 => {
            let guard = if byte == 1 { GuardState::Draining } else { GuardState::Reading };
            AxisPhase::Reading(guard, hold_reason((detail >> 8) as u16))
        }
        6 => AxisPhase::Ready,
        7 => AxisPhase::Enabling(drive_state(byte)),
        PHASE_RUNNING => AxisPhase::Running,
        9 => AxisPhase::Halted,
        10 => AxisPhase::Holding(hold_reason(detail as u16)?),
        11 => AxisPhase::Stopping(stop_cause(detail)?),
        12 => AxisPhase::Stopped(stop_cause(detail)?),
        13 => AxisPhase::Uncontrolled(stop_cause(detail)?),
        14 => AxisPhase::Inspecting,
        15 => AxisPhase::ResettingFault,
        16 => AxisPhase::Fault,
        17 => AxisPhase::ChangingMode(mode(byte)?),
        18 => AxisPhase::PreparingHoming,
        19 => AxisPhase::Homing(homing_state(byte)?),
        _ => return None,
    })
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
        all.extend((0..8).filter_map(drive_state).map(|it| AxisPhase::Enabling(Some(it))));
        all.extend((0..8).filter_map(homing_state).map(AxisPhase::Homing));
        all.extend(holds().into_iter().map(AxisPhase::Holding));
        for guard in [GuardState::Draining, GuardState::Reading] {
            all.push(AxisPhase::Reading(guard, None));
            all.extend(holds().into_iter().map(|it| AxisPhase::Reading(guard, Some(it))));
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
        assert_eq!(drive_state(drive_state_number(None)), None);
        assert_eq!(nmt_state(nmt_number(None)), None);
        for state in NmtState::ALL {
            assert_eq!(nmt_state(nmt_number(Some(*state))), Some(*state));
        }
        assert_eq!((0..20).filter_map(wait_reason).count(), 11);
        assert_eq!((0..20).filter_map(heartbeat).count(), 4);
    }
}
