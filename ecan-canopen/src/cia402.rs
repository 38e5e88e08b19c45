//! Values of CiA 402 objects: controlword, statusword, modes of operation, SI units, option codes and touch
//! probes (CiA 402-2).

/// A command of the state machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Command {
    /// To ready to switch on.
    Shutdown,
    /// To switched on.
    SwitchOn,
    /// To operation enabled.
    EnableOperation,
    /// Power off at once.
    DisableVoltage,
    /// Quick stop.
    QuickStop,
    /// From operation enabled back to switched on.
    DisableOperation,
    /// Out of a fault; works on the rising edge of its bit only.
    FaultReset,
}

/// The controlword, 0x6040.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Controlword(pub u16);

impl Controlword {
    /// Bit 0: switch on.
    pub const SWITCH_ON: u16 = 1 << 0;
    /// Bit 1: enable voltage.
    pub const ENABLE_VOLTAGE: u16 = 1 << 1;
    /// Bit 2: clear for a quick stop.
    pub const QUICK_STOP: u16 = 1 << 2;
    /// Bit 3: enable operation.
    pub const ENABLE_OPERATION: u16 = 1 << 3;
    /// Bit 4: by mode; new set-point in PP, start in homing, interpolation in IP, ramp in VL.
    pub const MODE_4: u16 = 1 << 4;
    /// Bit 5: by mode; change set immediately in PP, ramp not locked in VL.
    pub const MODE_5: u16 = 1 << 5;
    /// Bit 6: by mode; the target is relative in PP, the ramp follows the target in VL.
    pub const MODE_6: u16 = 1 << 6;
    /// Bit 7: fault reset, by its rising edge.
    pub const FAULT_RESET: u16 = 1 << 7;
    /// Bit 8: halt.
    pub const HALT: u16 = 1 << 8;

    /// The bits of a command, all others 0.
    pub const fn of(command: Command) -> Self {
        Self(match command {
            Command::Shutdown => 0x06,
            Command::SwitchOn | Command::DisableOperation => 0x07,
            Command::EnableOperation => 0x0F,
            Command::DisableVoltage => 0x00,
            Command::QuickStop => 0x02,
            Command::FaultReset => 0x80,
        })
    }

    /// The command in this word, `previous` being the word before: fault reset needs an edge.
    ///
    /// 0x07 is [`Command::SwitchOn`] here; in operation enabled it means
    /// [`Command::DisableOperation`].
    pub const fn command(self, previous: Self) -> Command {
        if self.has(Self::FAULT_RESET) && !previous.has(Self::FAULT_RESET) {
            return Command::FaultReset;
        }
        if !self.has(Self::ENABLE_VOLTAGE) {
            Command::DisableVoltage
        } else if !self.has(Self::QUICK_STOP) {
            Command::QuickStop
        } else if !self.has(Self::SWITCH_ON) {
            Command::Shutdown
        } else if self.has(Self::ENABLE_OPERATION) {
            Command::EnableOperation
        } else {
            Command::SwitchOn
        }
    }

    /// Returns whether all of these bits are set.
    pub const fn has(self, bits: u16) -> bool {
        self.0 & bits == bits
    }

    /// The same with these bits set.
    #[must_use]
    pub const fn with(self, bits: u16) -> Self {
        Self(self.0 | bits)
    }
}

ecan_protocol::text_enum! {
    /// State of a drive's power stage.
    pub enum DriveState;
    /// Starting up.
    NotReadyToSwitchOn = "not ready to switch on";
    /// Power may not be switched on.
    SwitchOnDisabled = "switch on disabled";
    /// Power may be switched on.
    ReadyToSwitchOn = "ready to switch on";
    /// Power is on, the motor is without torque.
    SwitchedOn = "switched on";
    /// The motor follows its targets.
    OperationEnabled = "operation enabled";
    /// A quick stop runs or has ended with power on.
    QuickStopActive = "quick stop active";
    /// A fault was found, its reaction runs.
    FaultReactionActive = "fault reaction active";
    /// Faulted, the motor is without torque.
    Fault = "fault";
}

/// The statusword, 0x6041.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Statusword(pub u16);

impl Statusword {
    /// Bit 5: clear while a quick stop is active.
    pub const QUICK_STOP: u16 = 1 << 5;
    /// Bit 7: warning.
    pub const WARNING: u16 = 1 << 7;
    /// Bit 9: the drive follows the controlword.
    pub const REMOTE: u16 = 1 << 9;
    /// Bit 10: target reached (profile modes, homing).
    pub const TARGET_REACHED: u16 = 1 << 10;
    /// Bit 11: an internal limit is active.
    pub const INTERNAL_LIMIT: u16 = 1 << 11;
    /// Bit 12: by mode; in cyclic modes the drive follows its target, in PP the set-point is
    /// acknowledged, in PV the speed is 0, in IP the interpolation is active, in homing the home position is found.
    pub const MODE_12: u16 = 1 << 12;
    /// Bit 13: by mode; following error in position modes, homing error in homing.
    pub const MODE_13: u16 = 1 << 13;

    /// The state; `None` for a combination that CiA 402 does not know.
    pub const fn state(self) -> Option<DriveState> {
        Some(match self.0 & 0x6F {
            0x00 | 0x20 => DriveState::NotReadyToSwitchOn,
            0x40 | 0x60 => DriveState::SwitchOnDisabled,
            0x21 => DriveState::ReadyToSwitchOn,
            0x23 => DriveState::SwitchedOn,
            0x27 => DriveState::OperationEnabled,
            0x07 => DriveState::QuickStopActive,
            0x0F | 0x2F => DriveState::FaultReactionActive,
            0x08 | 0x28 => DriveState::Fault,
            _ => return None,
        })
    }

    /// The bits of a state, with voltage enabled where power is on.
    pub const fn of_state(state: DriveState) -> Self {
        Self(match state {
            DriveState::NotReadyToSwitchOn => 0x00,
            DriveState::SwitchOnDisabled => 0x40,
            DriveState::ReadyToSwitchOn => 0x21,
            DriveState::SwitchedOn => 0x33,
            DriveState::OperationEnabled => 0x37,
            DriveState::QuickStopActive => 0x17,
            DriveState::FaultReactionActive => 0x1F,
            DriveState::Fault => 0x08,
        })
    }

    /// Returns whether all of these bits are set.
    pub const fn has(self, bits: u16) -> bool {
        self.0 & bits == bits
    }
}

ecan_protocol::text_enum! {
    /// A mode of operation, 0x6060 and 0x6061.
    pub enum OperatingMode: i8;
    /// Profile position (PP).
    ProfilePosition = 1, "PP";
    /// Velocity (vl), of frequency converters.
    Velocity = 2, "VL";
    /// Profile velocity (PV).
    ProfileVelocity = 3, "PV";
    /// Profile torque (PT).
    ProfileTorque = 4, "PT";
    /// Homing (HM).
    Homing = 6, "HM";
    /// Interpolated position (IP).
    InterpolatedPosition = 7, "IP";
    /// Cyclic synchronous position (CSP).
    CyclicPosition = 8, "CSP";
    /// Cyclic synchronous velocity (CSV).
    CyclicVelocity = 9, "CSV";
    /// Cyclic synchronous torque (CST).
    CyclicTorque = 10, "CST";
}

impl OperatingMode {
    /// Returns whether a target comes with every cycle.
    pub const fn is_cyclic(self) -> bool {
        matches!(
            self,
            Self::InterpolatedPosition
                | Self::CyclicPosition
                | Self::CyclicVelocity
                | Self::CyclicTorque
        )
    }
}

/// The modes that a drive has, 0x6502.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SupportedModes(pub u32);

impl SupportedModes {
    /// The bit of a mode: its number minus one.
    pub const fn bit(mode: OperatingMode) -> u32 {
        1 << (mode.raw() - 1)
    }

    /// Returns whether the drive has a mode.
    pub const fn contains(self, mode: OperatingMode) -> bool {
        self.0 & Self::bit(mode) != 0
    }

    /// The same with a mode.
    #[must_use]
    pub const fn with(self, mode: OperatingMode) -> Self {
        Self(self.0 | Self::bit(mode))
    }
}

/// A unit: prefix, numerator and denominator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SiUnit(pub u32);

const RADIAN: u8 = 0x10;
const DEGREE: u8 = 0x41;
const REVOLUTION: u8 = 0xB4;
const INCREMENT: u8 = 0xB5;
const SECOND: u8 = 0x03;
const MINUTE: u8 = 0x47;

/// Unit of an angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AngleUnit {
    /// Increments of the encoder.
    Increment,
    /// This number of units is a revolution.
    PerRevolution(f64),
}

impl SiUnit {
    const fn byte(self, shift: u32) -> u8 {
        (self.0 >> shift) as u8
    }

    /// Exponent of the power of ten in front of the unit.
    pub const fn exponent(self) -> i8 {
        self.byte(24).cast_signed()
    }

    /// Units per angle of the numerator, the power of ten included; `None` for a unit of another kind,
    /// and for increments with a power of ten.
    pub fn angle(self) -> Option<AngleUnit> {
        let units = match self.byte(16) {
            INCREMENT if self.exponent() == 0 => return Some(AngleUnit::Increment),
            REVOLUTION => 1.0,
            DEGREE => 360.0,
            RADIAN => core::f64::consts::TAU,
            _ => return None,
        };
        Some(AngleUnit::PerRevolution(units / power_of_ten(self.exponent())))
    }

    /// Time of the denominator in seconds; `None` for a unit without a time.
    pub const fn seconds(self) -> Option<f64> {
        match self.byte(8) {
            SECOND => Some(1.0),
            MINUTE => Some(60.0),
            _ => None,
        }
    }
}

fn power_of_ten(exponent: i8) -> f64 {
    let power = (0..exponent.unsigned_abs()).fold(1.0, |power, _| power * 10.0);
    if exponent < 0 { 1.0 / power } else { power }
}

ecan_protocol::open_enum! {
    /// Quick stop option code, 0x605A.
    pub enum QuickStopOption: i16 else Other;
    /// Power off, the motor coasts.
    Disable = 0;
    /// Slow down on the profile deceleration, then power off.
    SlowDown = 1;
    /// Slow down on the quick stop deceleration, then power off.
    QuickStop = 2;
    /// Slow down on the current limit, then power off.
    CurrentLimit = 3;
    /// Slow down on the voltage limit, then power off.
    VoltageLimit = 4;
    /// Slow down on the profile deceleration and stay in quick stop active.
    SlowDownAndStay = 5;
    /// Slow down on the quick stop deceleration and stay in quick stop active.
    QuickStopAndStay = 6;
    /// Slow down on the current limit and stay in quick stop active.
    CurrentLimitAndStay = 7;
    /// Slow down on the voltage limit and stay in quick stop active.
    VoltageLimitAndStay = 8;
}

ecan_protocol::open_enum! {
    /// Shutdown and disable operation option codes, 0x605B and 0x605C.
    pub enum StopOption: i16 else Other;
    /// Power off, the motor coasts.
    Disable = 0;
    /// Slow down on the profile deceleration, then power off.
    SlowDown = 1;
}

ecan_protocol::open_enum! {
    /// Halt option code, 0x605D.
    pub enum HaltOption: i16 else Other;
    /// Slow down on the profile deceleration and stay enabled.
    SlowDown = 1;
    /// Slow down on the quick stop deceleration and stay enabled.
    QuickStop = 2;
    /// Slow down on the current limit and stay enabled.
    CurrentLimit = 3;
    /// Slow down on the voltage limit and stay enabled.
    VoltageLimit = 4;
}

ecan_protocol::open_enum! {
    /// Fault reaction option code, 0x605E.
    pub enum FaultReaction: i16 else Other;
    /// Power off, the motor coasts.
    Disable = 0;
    /// Slow down on the profile deceleration.
    SlowDown = 1;
    /// Slow down on the quick stop deceleration.
    QuickStop = 2;
    /// Slow down on the current limit.
    CurrentLimit = 3;
    /// Slow down on the voltage limit.
    VoltageLimit = 4;
}

ecan_protocol::open_enum! {
    /// Reaction of a drive to a missing heartbeat of the host, 0x6007.
    pub enum NodeLossReaction: i16 else Other;
    /// Nothing.
    None = 0;
    /// Goes to fault.
    Fault = 1;
    /// Disables voltage.
    DisableVoltage = 2;
    /// Quick stop.
    QuickStop = 3;
}

/// A touch probe of a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Probe {
    /// Touch probe 1.
    One,
    /// Touch probe 2.
    Two,
}

impl Probe {
    /// Both probes.
    pub const ALL: [Self; 2] = [Self::One, Self::Two];

    /// Place of the probe's byte in function and status: 0 or 1.
    pub const fn byte(self) -> usize {
        self as usize
    }
}

/// Signal whose edges a touch probe samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ProbeSource {
    /// The probe's input.
    #[default]
    Input,
    /// The index pulse of the encoder.
    IndexPulse,
}

/// Function of a touch probe, its byte in 0x60B8.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ProbeTrigger {
    /// Signal.
    pub source: ProbeSource,
    /// Samples the position at positive edges.
    pub positive: bool,
    /// Samples the position at negative edges.
    pub negative: bool,
    /// Samples at every edge; otherwise at the first one only.
    pub is_continuous: bool,
}

impl ProbeTrigger {
    /// Samples the first positive edge of a signal.
    pub const fn first_positive(source: ProbeSource) -> Self {
        Self { source, positive: true, negative: false, is_continuous: false }
    }

    /// The byte of the probe, enabled.
    pub const fn byte(self) -> u8 {
        1 | (self.is_continuous as u8) << 1
            | match self.source {
                ProbeSource::Input => 0,
                ProbeSource::IndexPulse => 1 << 2,
            }
            | (self.positive as u8) << 4
            | (self.negative as u8) << 5
    }
}

/// The touch probe status, 0x60B9.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ProbeStatus(pub u16);

impl ProbeStatus {
    const fn bit(self, probe: Probe, bit: usize) -> bool {
        self.0 >> (8 * probe.byte() + bit) & 1 != 0
    }

    /// Returns whether a probe is enabled.
    pub const fn is_enabled(self, probe: Probe) -> bool {
        self.bit(probe, 0)
    }

    /// Returns whether the position at a positive edge is stored.
    pub const fn has_positive(self, probe: Probe) -> bool {
        self.bit(probe, 1)
    }

    /// Returns whether the position at a negative edge is stored.
    pub const fn has_negative(self, probe: Probe) -> bool {
        self.bit(probe, 2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_read_as_they_are_written() {
        let idle = Controlword(0);
        for command in [
            Command::Shutdown,
            Command::SwitchOn,
            Command::EnableOperation,
            Command::DisableVoltage,
            Command::QuickStop,
            Command::FaultReset,
        ] {
            assert_eq!(Controlword::of(command).command(idle), command);
            let with_mode = Controlword::of(command).with(Controlword::MODE_4 | Controlword::HALT);
            assert_eq!(with_mode.command(idle), command);
        }
    }

    #[test]
    fn fault_reset_needs_its_edge() {
        let reset = Controlword::of(Command::FaultReset);
        assert_eq!(reset.command(reset), Command::DisableVoltage);
        assert_eq!(Controlword(0x86).command(reset), Command::Shutdown);
    }

    const ALL: [DriveState; 8] = [
        DriveState::NotReadyToSwitchOn,
        DriveState::SwitchOnDisabled,
        DriveState::ReadyToSwitchOn,
        DriveState::SwitchedOn,
        DriveState::OperationEnabled,
        DriveState::QuickStopActive,
        DriveState::FaultReactionActive,
        DriveState::Fault,
    ];

    /// The masks and values of the standard, bit by bit.
    fn by_the_table(word: u16) -> Option<DriveState> {
        let table = [
            (0x4F, 0x00, DriveState::NotReadyToSwitchOn),
            (0x4F, 0x40, DriveState::SwitchOnDisabled),
            (0x6F, 0x21, DriveState::ReadyToSwitchOn),
            (0x6F, 0x23, DriveState::SwitchedOn),
            (0x6F, 0x27, DriveState::OperationEnabled),
            (0x6F, 0x07, DriveState::QuickStopActive),
            (0x4F, 0x0F, DriveState::FaultReactionActive),
            (0x4F, 0x08, DriveState::Fault),
        ];
        table.iter().find(|(mask, value, _)| word & mask == *value).map(|(.., state)| *state)
    }

    #[test]
    fn every_word_reads_as_the_table_says() {
        for word in 0..=u16::MAX {
            assert_eq!(Statusword(word).state(), by_the_table(word), "0x{word:04X}");
        }
    }

    #[test]
    fn states_come_back() {
        for state in ALL {
            assert_eq!(Statusword::of_state(state).state(), Some(state));
        }
    }

    #[test]
    fn modes_and_their_bits() {
        for &mode in OperatingMode::ALL {
            assert_eq!(OperatingMode::from_raw(mode.raw()), Some(mode));
        }
        assert_eq!(OperatingMode::from_raw(0), None);
        assert_eq!(SupportedModes::bit(OperatingMode::CyclicPosition), 0x80);
        let modes = SupportedModes::default().with(OperatingMode::Homing);
        assert_eq!(modes.0, 0x20);
        assert!(modes.contains(OperatingMode::Homing));
        assert!(!modes.contains(OperatingMode::CyclicTorque));
    }

    #[test]
    fn units_are_read_as_the_standard_encodes_them() {
        assert_eq!(SiUnit(0x00B5_0000).angle(), Some(AngleUnit::Increment));
        assert_eq!(SiUnit(0xFD41_0000).angle(), Some(AngleUnit::PerRevolution(360_000.0)));
        // 1/min, and 0.1/min
        let rpm = SiUnit(0x00B4_4700);
        assert_eq!((rpm.angle(), rpm.seconds()), (Some(AngleUnit::PerRevolution(1.0)), Some(60.0)));
        assert_eq!(SiUnit(0xFFB4_4700).angle(), Some(AngleUnit::PerRevolution(10.0)));
        assert_eq!(SiUnit(0x00B5_0300).seconds(), Some(1.0));
        // Metres, and no unit.
        assert_eq!((SiUnit(0x0001_0000).angle(), SiUnit(0).seconds()), (None, None));
        assert_eq!(SiUnit(0x01B5_0000).angle(), None);
    }

    #[test]
    fn numbers_come_back() {
        for raw in -3..=10 {
            assert_eq!(QuickStopOption::from_raw(raw).raw(), raw);
            assert_eq!(StopOption::from_raw(raw).raw(), raw);
            assert_eq!(HaltOption::from_raw(raw).raw(), raw);
            assert_eq!(FaultReaction::from_raw(raw).raw(), raw);
            assert_eq!(NodeLossReaction::from_raw(raw).raw(), raw);
        }
        assert_eq!(QuickStopOption::from_raw(6), QuickStopOption::QuickStopAndStay);
    }

    #[test]
    fn function_and_status_have_the_bits_of_the_standard() {
        let trigger = ProbeTrigger::first_positive(ProbeSource::Input);
        assert_eq!(trigger.byte(), 0x11);
        let trigger = ProbeTrigger {
            source: ProbeSource::IndexPulse,
            positive: false,
            negative: true,
            is_continuous: true,
        };
        assert_eq!(trigger.byte(), 0x27);
        let status = ProbeStatus(0x0503);
        assert!(status.is_enabled(Probe::One) && status.has_positive(Probe::One));
        assert!(!status.has_negative(Probe::One));
        assert!(status.is_enabled(Probe::Two) && status.has_negative(Probe::Two));
        assert!(!status.has_positive(Probe::Two));
    }
}
