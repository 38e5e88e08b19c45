//! Reaction of a drive to the loss of the host.

use std::fmt;
use std::time::Duration;

use ecan_canopen::{
    FaultReaction, GuardingConfig, HaltOption, HeartbeatConsumer, NodeAddress, NodeId,
    NodeLossReaction, OperatingMode, QuickStopOption, Step, StopOption, object,
};

/// Entries of 0x1016 that are read. The configuration writes the first one.
const WATCH_ENTRIES: [u8; 2] = [1, 2];

/// Stop behaviour of a drive, read back at the end of its configuration, whether written or not.
/// `None` for an object that the drive does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StopOptions {
    /// Consumer heartbeat entries, 0x1016:01 and 0x1016:02.
    pub watches: [Option<HeartbeatConsumer>; 2],
    /// Life guarding by 0x100C and 0x100D, if the host guards the node; `None` without a life time.
    pub guarding: Option<GuardingConfig>,
    /// Reaction to the loss of the host, 0x6007.
    pub host_loss: Option<NodeLossReaction>,
    /// Quick stop option, 0x605A.
    pub quick_stop: Option<QuickStopOption>,
    /// Shutdown option, 0x605B.
    pub shutdown: Option<StopOption>,
    /// Disable operation option, 0x605C.
    pub disable_operation: Option<StopOption>,
    /// Halt option, 0x605D.
    pub halt: Option<HaltOption>,
    /// Fault reaction option, 0x605E.
    pub fault_reaction: Option<FaultReaction>,
    /// Profile deceleration, 0x6084, in units of the drive.
    pub profile_deceleration: Option<u32>,
    /// Quick stop deceleration, 0x6085, in units of the drive.
    pub quick_stop_deceleration: Option<u32>,
}

impl StopOptions {
    /// Objects of the node that [`from_values`](Self::from_values) needs.
    pub(crate) fn node_steps(is_guarded: bool) -> impl Iterator<Item = Step> {
        let guarding = [object::GUARD_TIME, object::LIFE_TIME_FACTOR];
        let guarding = guarding.into_iter().filter(move |_| is_guarded).map(|index| (index, 0));
        let watches = WATCH_ENTRIES.map(|entry| (object::CONSUMER_HEARTBEAT, entry));
        watches.into_iter().chain(guarding).map(read_option)
    }

    /// Objects of an axis that it needs.
    pub(crate) fn steps() -> impl Iterator<Item = Step> {
        let options = [
            object::ABORT_CONNECTION_OPTION,
            object::QUICK_STOP_OPTION,
            object::SHUTDOWN_OPTION,
            object::DISABLE_OPERATION_OPTION,
            object::HALT_OPTION,
            object::FAULT_REACTION_OPTION,
            object::PROFILE_DECELERATION,
            object::QUICK_STOP_DECELERATION,
        ];
        options.into_iter().map(|index| read_option((index, 0)))
    }

    /// Takes the values of these objects, little-endian without sign.
    pub(crate) fn from_values(value: impl Fn(u16, u8) -> Option<u64>) -> Self {
        let code = |index| value(index, 0).map(|raw| raw as u16 as i16);
        let ramp = |index| value(index, 0).and_then(|raw| u32::try_from(raw).ok());
        Self {
            watches: WATCH_ENTRIES.map(|entry| {
                let raw = value(object::CONSUMER_HEARTBEAT, entry)?;
                HeartbeatConsumer::from_raw(u32::try_from(raw).ok()?)
            }),
            guarding: guarding(value(object::GUARD_TIME, 0), value(object::LIFE_TIME_FACTOR, 0)),
            host_loss: code(object::ABORT_CONNECTION_OPTION).map(NodeLossReaction::from_raw),
            quick_stop: code(object::QUICK_STOP_OPTION).map(QuickStopOption::from_raw),
            shutdown: code(object::SHUTDOWN_OPTION).map(StopOption::from_raw),
            disable_operation: code(object::DISABLE_OPERATION_OPTION).map(StopOption::from_raw),
            halt: code(object::HALT_OPTION).map(HaltOption::from_raw),
            fault_reaction: code(object::FAULT_REACTION_OPTION).map(FaultReaction::from_raw),
            profile_deceleration: ramp(object::PROFILE_DECELERATION),
            quick_stop_deceleration: ramp(object::QUICK_STOP_DECELERATION),
        }
    }

    /// Detection of the loss of a host that sends its heartbeat as `host`; `None` for one
    /// that sends none. A drive that is guarded detects it by the requests, too.
    pub fn host_watch(&self, host: Option<NodeId>) -> HostWatch {
        let by_heartbeat = self.heartbeat_watch(host);
        match (by_heartbeat, self.guarding.map(|guarding| guarding.life_time())) {
            (HostWatch::Active(time), Some(life_time)) if time <= life_time => by_heartbeat,
            (_, Some(life_time)) => HostWatch::Guarded(life_time),
            (_, None) => by_heartbeat,
        }
    }

    fn heartbeat_watch(&self, host: Option<NodeId>) -> HostWatch {
        let Some(host) = host else { return HostWatch::NoHeartbeat };
        let entry = self.watches.iter().flatten().find(|entry| entry.producer == host);
        entry.map_or(HostWatch::NoEntry, |entry| {
            HostWatch::Active(Duration::from_millis(entry.time_ms.into()))
        })
    }

    /// Reaction of an enabled drive when the host with this heartbeat dies, is killed or loses the
    /// link. Pure.
    ///
    /// A drive that does not detect the loss, or has 0x6007 = 0, does what its mode determines.
    ///
    /// | 0x6007 | reaction |
    /// | --- | --- |
    /// | 0 | as without detection: CSP and IP hold the last position, all other modes run on |
    /// | 1 | fault reaction 0x605E |
    /// | 2 | power off, the motor coasts |
    /// | 3 | quick stop 0x605A |
    /// | missing, another value, or an option that is missing | unknown |
    pub fn host_loss_reaction(
        &self,
        mode: OperatingMode,
        host: Option<NodeId>,
    ) -> HostLossReaction {
        use HostLossReaction as R;
        let watch = self.host_watch(host);
        if !matches!(watch, HostWatch::Active(_) | HostWatch::Guarded(_)) {
            return undetected(mode);
        }
        match self.host_loss {
            Some(NodeLossReaction::None) => undetected(mode),
            Some(NodeLossReaction::Fault) => match self.fault_reaction {
                Some(FaultReaction::Disable) => R::Coasts,
                Some(FaultReaction::SlowDown) => R::Fault(StopRamp::Profile),
                Some(FaultReaction::QuickStop) => R::Fault(StopRamp::QuickStop),
                Some(FaultReaction::CurrentLimit) => R::Fault(StopRamp::CurrentLimit),
                Some(FaultReaction::VoltageLimit) => R::Fault(StopRamp::VoltageLimit),
                Some(FaultReaction::Other(_)) | None => R::Unknown,
            },
            Some(NodeLossReaction::DisableVoltage) => R::Coasts,
            Some(NodeLossReaction::QuickStop) => match self.quick_stop {
                Some(QuickStopOption::Disable) => R::Coasts,
                Some(QuickStopOption::SlowDown | QuickStopOption::SlowDownAndStay) => {
                    R::QuickStop(StopRamp::Profile)
                }
                Some(QuickStopOption::QuickStop | QuickStopOption::QuickStopAndStay) => {
                    R::QuickStop(StopRamp::QuickStop)
                }
                Some(QuickStopOption::CurrentLimit | QuickStopOption::CurrentLimitAndStay) => {
                    R::QuickStop(StopRamp::CurrentLimit)
                }
                Some(QuickStopOption::VoltageLimit | QuickStopOption::VoltageLimitAndStay) => {
                    R::QuickStop(StopRamp::VoltageLimit)
                }
                Some(QuickStopOption::Other(_)) | None => R::Unknown,
            },
            Some(NodeLossReaction::Other(_)) | None => R::Unknown,
        }
    }

    /// The deceleration of a ramp, in units of the drive; `None` for a limit of the drive, or an
    /// object that it does not have.
    pub fn deceleration(&self, ramp: StopRamp) -> Option<u32> {
        match ramp {
            StopRamp::Profile => self.profile_deceleration,
            StopRamp::QuickStop => self.quick_stop_deceleration,
            StopRamp::CurrentLimit | StopRamp::VoltageLimit => None,
        }
    }
}

fn read_option((index, subindex): (u16, u8)) -> Step {
    Step::read(index, subindex).named("stop options").if_accepted()
}

/// Life guarding of these values; none if one of them is missing or 0.
fn guarding(time_ms: Option<u64>, factor: Option<u64>) -> Option<GuardingConfig> {
    let guarding = GuardingConfig {
        guard_time: Duration::from_millis(time_ms?),
        life_time_factor: u8::try_from(factor?).ok()?,
    };
    Some(guarding).filter(GuardingConfig::is_valid)
}

/// Reaction of an enabled drive to missing targets.
fn undetected(mode: OperatingMode) -> HostLossReaction {
    match mode {
        OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition => {
            HostLossReaction::HoldsPosition
        }
        _ => HostLossReaction::RunsOn,
    }
}

/// Deceleration of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum StopRamp {
    /// Profile deceleration, 0x6084.
    Profile,
    /// Quick stop deceleration, 0x6085.
    QuickStop,
    /// Current limit of the drive.
    CurrentLimit,
    /// Voltage limit of the drive.
    VoltageLimit,
}

impl fmt::Display for StopRamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Profile => "profile deceleration 0x6084",
            Self::QuickStop => "quick stop deceleration 0x6085",
            Self::CurrentLimit => "current limit",
            Self::VoltageLimit => "voltage limit",
        })
    }
}

/// Detection of the loss of the host by a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum HostWatch {
    /// Not at all: the configuration of the drive was not read yet.
    Unread,
    /// Not at all: the host sends no heartbeat.
    NoHeartbeat,
    /// Not at all: 0x1016 has no entry for the node-ID of the host.
    NoEntry,
    /// By 0x1016, after this time without a heartbeat. The watch starts with the first heartbeat.
    Active(Duration),
    /// By life guarding, after this time without a request. The watch starts with the first request.
    Guarded(Duration),
}

impl fmt::Display for HostWatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unread => f.write_str("stop options not read yet"),
            Self::NoHeartbeat => f.write_str("the host sends no heartbeat"),
            Self::NoEntry => f.write_str("0x1016 has no entry for the host"),
            Self::Active(time) => {
                write!(f, "detected after {} ms without a heartbeat", time.as_millis())
            }
            Self::Guarded(time) => {
                write!(f, "detected after {} ms without a guarding request", time.as_millis())
            }
        }
    }
}

/// Reaction of an enabled drive to the loss of the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum HostLossReaction {
    /// Quick stop with this ramp.
    QuickStop(StopRamp),
    /// Stops with this ramp, then Fault.
    Fault(StopRamp),
    /// Switches power off; the motor coasts.
    Coasts,
    /// Keeps the last target position: the motion ends there. A drive that extrapolates missing
    /// targets moves on first; the SDK cannot detect that.
    HoldsPosition,
    /// Continues with the last velocity or torque; in PP it moves to the end of its set-points, in
    /// homing to the end of homing.
    RunsOn,
    /// The SDK cannot determine it: not read yet, or an object is missing or manufacturer-specific.
    Unknown,
}

impl HostLossReaction {
    /// True if the drive brings the motor to rest and controls it until then.
    pub fn is_controlled_stop(self) -> bool {
        matches!(self, Self::QuickStop(_) | Self::Fault(_) | Self::HoldsPosition)
    }
}

impl fmt::Display for HostLossReaction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::QuickStop(ramp) => write!(f, "quick stop ({ramp})"),
            Self::Fault(ramp) => write!(f, "fault reaction ({ramp})"),
            Self::Coasts => f.write_str("power off, the motor coasts"),
            Self::HoldsPosition => f.write_str("holds its last target position"),
            Self::RunsOn => f.write_str("runs on"),
            Self::Unknown => f.write_str("unknown reaction"),
        }
    }
}

/// Reaction of one axis to the loss of the host, by the options that its drive reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HostLoss {
    /// Index in the axis table.
    pub axis: usize,
    /// Address of the drive.
    pub address: NodeAddress,
    /// Operating mode.
    pub mode: OperatingMode,
    /// Detection of the loss.
    pub watch: HostWatch,
    /// Reaction of the drive while it is enabled.
    pub reaction: HostLossReaction,
    /// Deceleration of a stop in units of the drive, if an object determines it.
    pub deceleration: Option<u32>,
}

impl HostLoss {
    pub(crate) fn new(
        (axis, address): (usize, NodeAddress),
        mode: OperatingMode,
        options: Option<&StopOptions>,
        host: Option<NodeId>,
    ) -> Self {
        let Some(options) = options else {
            let (watch, reaction) = (HostWatch::Unread, HostLossReaction::Unknown);
            return Self { axis, address, mode, watch, reaction, deceleration: None };
        };
        let reaction = options.host_loss_reaction(mode, host);
        let deceleration = match reaction {
            HostLossReaction::QuickStop(ramp) | HostLossReaction::Fault(ramp) => {
                options.deceleration(ramp)
            }
            _ => None,
        };
        Self { axis, address, mode, watch: options.host_watch(host), reaction, deceleration }
    }
}

/// `axis 2, node 5 (slave 0, channel 1), CSV: runs on if the host is lost (0x1016 has no entry for the host)`
impl fmt::Display for HostLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { axis, address, mode, watch, reaction, .. } = self;
        write!(f, "axis {axis}, {address}, {mode}: {reaction} if the host is lost ({watch})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use HostLossReaction as R;
    use OperatingMode as M;

    const HOST: NodeId = NodeId::MAX;

    fn options(host_loss: i16, quick_stop: i16, fault_reaction: i16) -> StopOptions {
        StopOptions {
            watches: [None, Some(HeartbeatConsumer { producer: HOST, time_ms: 250 })],
            host_loss: Some(NodeLossReaction::from_raw(host_loss)),
            quick_stop: Some(QuickStopOption::from_raw(quick_stop)),
            fault_reaction: Some(FaultReaction::from_raw(fault_reaction)),
            profile_deceleration: Some(1_000),
            quick_stop_deceleration: Some(5_000),
            ..StopOptions::default()
        }
    }

    #[test]
    fn detected_loss_follows_the_option_codes_in_every_mode() {
        let codes = [
            (options(1, 2, 0), R::Coasts),
            (options(1, 2, 1), R::Fault(StopRamp::Profile)),
            (options(1, 2, 2), R::Fault(StopRamp::QuickStop)),
            (options(1, 2, 3), R::Fault(StopRamp::CurrentLimit)),
            (options(1, 2, 4), R::Fault(StopRamp::VoltageLimit)),
            (options(1, 2, -1), R::Unknown),
            (options(2, 2, 2), R::Coasts),
            (options(3, 0, 2), R::Coasts),
            (options(3, 1, 2), R::QuickStop(StopRamp::Profile)),
            (options(3, 2, 2), R::QuickStop(StopRamp::QuickStop)),
            (options(3, 3, 2), R::QuickStop(StopRamp::CurrentLimit)),
            (options(3, 4, 2), R::QuickStop(StopRamp::VoltageLimit)),
            (options(3, 5, 2), R::QuickStop(StopRamp::Profile)),
            (options(3, 6, 2), R::QuickStop(StopRamp::QuickStop)),
            (options(3, 7, 2), R::QuickStop(StopRamp::CurrentLimit)),
            (options(3, 8, 2), R::QuickStop(StopRamp::VoltageLimit)),
            (options(3, -2, 2), R::Unknown),
            (options(-7, 2, 2), R::Unknown),
        ];
        for &mode in M::ALL {
            for (options, reaction) in codes {
                assert_eq!(options.host_loss_reaction(mode, Some(HOST)), reaction, "{options:?}");
            }
        }
    }

    #[test]
    fn undetected_loss_runs_on_except_in_position_interpolation() {
        let other = NodeId::new(5).unwrap();
        let unwatched = StopOptions { watches: [None, None], ..options(3, 2, 2) };
        let cases = [
            (options(3, 2, 2), None, HostWatch::NoHeartbeat),
            (options(3, 2, 2), Some(other), HostWatch::NoEntry),
            (unwatched, Some(HOST), HostWatch::NoEntry),
            (options(0, 2, 2), Some(HOST), HostWatch::Active(Duration::from_millis(250))),
        ];
        for (options, host, watch) in cases {
            assert_eq!(options.host_watch(host), watch);
            for &mode in M::ALL {
                let is_held = matches!(mode, M::CyclicPosition | M::InterpolatedPosition);
                let expected = if is_held { R::HoldsPosition } else { R::RunsOn };
                assert_eq!(options.host_loss_reaction(mode, host), expected, "{mode}");
            }
        }
    }

    #[test]
    fn guarded_drive_detects_the_loss_by_the_shorter_time() {
        let values = |time_ms, factor| {
            StopOptions::from_values(|index, _| match index {
                0x100C => Some(time_ms),
                0x100D => Some(factor),
                _ => None,
            })
        };
        let guarded = values(50, 4);
        let life = HostWatch::Guarded(Duration::from_millis(200));
        assert_eq!(guarded.host_watch(None), life);
        let both = StopOptions { guarding: guarded.guarding, ..options(3, 2, 2) };
        assert_eq!(both.host_watch(Some(HOST)), life, "the heartbeat takes 250 ms");
        let slower = StopOptions { guarding: values(100, 4).guarding, ..options(3, 2, 2) };
        let heartbeat = HostWatch::Active(Duration::from_millis(250));
        assert_eq!(slower.host_watch(Some(HOST)), heartbeat);
        assert_eq!(values(50, 0).host_watch(Some(HOST)), HostWatch::NoEntry);
        let reaction = slower.host_loss_reaction(M::CyclicVelocity, None);
        assert_eq!(reaction, R::QuickStop(StopRamp::QuickStop));
    }

    #[test]
    fn missing_objects_are_unknown() {
        let missing = [
            StopOptions { host_loss: None, ..options(3, 2, 2) },
            StopOptions { quick_stop: None, ..options(3, 2, 2) },
            StopOptions { fault_reaction: None, ..options(1, 2, 2) },
        ];
        for options in missing {
            assert_eq!(options.host_loss_reaction(M::CyclicVelocity, Some(HOST)), R::Unknown);
        }
    }

    #[test]
    fn values_are_read_as_the_drive_encodes_them() {
        let read = StopOptions::from_values(|index, subindex| match (index, subindex) {
            (0x1016, 1) => Some(0x007F_00FA),
            (0x1016, 2) => Some(0),
            (0x6007, 0) => Some(0x0003),
            (0x605A, 0) => Some(0xFFFF),
            (0x605E, 0) => Some(2),
            (0x6085, 0) => Some(0xFFFF_FFFF),
            _ => None,
        });
        let expected = StopOptions {
            watches: [Some(HeartbeatConsumer { producer: HOST, time_ms: 250 }), None],
            host_loss: Some(NodeLossReaction::QuickStop),
            quick_stop: Some(QuickStopOption::Other(-1)),
            fault_reaction: Some(FaultReaction::QuickStop),
            quick_stop_deceleration: Some(u32::MAX),
            ..StopOptions::default()
        };
        assert_eq!(read, expected);
    }

    #[test]
    fn text_names_axis_mode_reaction_and_cause() {
        let address = NodeAddress { slave: 0, channel: 1, node: NodeId::new(5).unwrap() };
        let text = |options: Option<StopOptions>, host| {
            HostLoss::new((2, address), M::CyclicVelocity, options.as_ref(), host).to_string()
        };
        let begin = "axis 2, node 5 (slave 0, channel 1), CSV: ";
        let expected = [
            (
                Some(options(3, 2, 2)),
                Some(HOST),
                "quick stop (quick stop deceleration 0x6085) if the host is lost (detected after \
                 250 ms without a heartbeat)",
            ),
            (
                Some(options(3, 2, 2)),
                None,
                "runs on if the host is lost (the host sends no heartbeat)",
            ),
            (None, Some(HOST), "unknown reaction if the host is lost (stop options not read yet)"),
        ];
        for (options, host, end) in expected {
            assert_eq!(text(options, host), format!("{begin}{end}"));
        }
        let loss =
            HostLoss::new((2, address), M::ProfilePosition, Some(&options(3, 1, 2)), Some(HOST));
        assert_eq!(loss.deceleration, Some(1_000));
        assert!(loss.reaction.is_controlled_stop());
    }
}
