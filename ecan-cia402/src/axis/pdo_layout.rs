//! Process data of an axis: its RPDOs and TPDOs.

use ecan_canopen::{Controlword, MappingEntry, OperatingMode, Statusword, object};

use super::script::axis_index;

/// Most bytes of a PDO on classic CAN.
const MAX_BYTES: usize = 8;
const MAX_BITS: u32 = 64;

/// The object that the first RPDO carries after the controlword.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum TargetObject {
    /// Target position, 0x607A, I32: CSP, PP and, unused, homing.
    #[default]
    Position,
    /// Target velocity, 0x60FF, I32: CSV and PV.
    Velocity,
    /// Target torque, 0x6071, I16: CST and PT.
    Torque,
    /// Interpolation data record, 0x60C1:01, I32, a position: IP.
    InterpolationData,
    /// Target velocity of the velocity mode, 0x6042, I16: VL.
    VlVelocity,
}

impl TargetObject {
    /// The object that a mode takes its targets from. Homing takes none, and goes with any.
    pub fn of_mode(mode: OperatingMode) -> Self {
        match mode {
            OperatingMode::CyclicPosition
            | OperatingMode::ProfilePosition
            | OperatingMode::Homing => Self::Position,
            OperatingMode::CyclicVelocity | OperatingMode::ProfileVelocity => Self::Velocity,
            OperatingMode::CyclicTorque | OperatingMode::ProfileTorque => Self::Torque,
            OperatingMode::InterpolatedPosition => Self::InterpolationData,
            OperatingMode::Velocity => Self::VlVelocity,
        }
    }

    /// Returns whether a mode can be driven while this object is mapped.
    pub fn serves(self, mode: OperatingMode) -> bool {
        mode == OperatingMode::Homing || Self::of_mode(mode) == self
    }

    fn entry(self) -> MappingEntry {
        match self {
            Self::Position => MappingEntry::new(object::TARGET_POSITION, 0, 32),
            Self::Velocity => MappingEntry::new(object::TARGET_VELOCITY, 0, 32),
            Self::Torque => MappingEntry::new(object::TARGET_TORQUE, 0, 16),
            Self::InterpolationData => MappingEntry::new(object::INTERPOLATION_DATA, 1, 32),
            Self::VlVelocity => MappingEntry::new(object::VL_TARGET_VELOCITY, 0, 16),
        }
    }

    fn is_short(self) -> bool {
        matches!(self, Self::Torque | Self::VlVelocity)
    }
}

/// The process data of an axis.
///
/// | | bytes 0, 1 | bytes 2.. | length |
/// | --- | --- | --- | --- |
/// | RPDO, CSP and PP | controlword 0x6040 | target position 0x607A | 6 |
/// | RPDO, IP | controlword | position 0x60C1:01 | 6 |
/// | RPDO, CSV and PV | controlword | target velocity 0x60FF | 6 |
/// | RPDO, CST and PT | controlword | target torque 0x6071 | 4 |
/// | RPDO, VL | controlword | target velocity 0x6042 | 4 |
/// | TPDO, all modes | statusword 0x6041 | actual position 0x6064 | 6 |
///
/// Statusword and actual position come in one frame, so that they are of one instant: the guard
/// relies on that when it begins at the actual position of an enabled drive.
///
/// Further objects by choice, [`PdoConfig::outputs`](crate::PdoConfig::outputs) and
/// [`PdoConfig::inputs`](crate::PdoConfig::inputs), follow in the order of their lists, each in
/// the first PDO of 8 bytes that has space for it; a PDO is added if none has. Of the outputs only
/// the mode is in the first RPDO. The others have RPDOs without a target, so that a feed-forward can
/// be zeroed, and an output be set, without one.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PdoLayout {
    command: CommandLayout,
    /// RPDOs after the first.
    auxiliary: Vec<Vec<OutputObject>>,
    /// Objects of the TPDOs; in the first one after statusword and actual position.
    inputs: Vec<Vec<InputObject>>,
    node_axis: u8,
}

/// The first RPDO: controlword, target, and the mode by choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct CommandLayout {
    target: TargetObject,
    has_mode: bool,
}

impl CommandLayout {
    pub(crate) fn target(self) -> TargetObject {
        self.target
    }

    /// The RPDO. A target beyond an `i16` is cut to its limits if its object has 16 bits.
    pub(crate) fn encode(
        self,
        controlword: Controlword,
        target: i32,
        mode: OperatingMode,
    ) -> RpdoBytes {
        let [low, high] = controlword.0.to_le_bytes();
        let target = if self.target.is_short() {
            target.clamp(i16::MIN.into(), i16::MAX.into())
        } else {
            target
        };
        let [first, second, third, fourth] = target.to_le_bytes();
        if self.has_mode || self.target.is_short() {
            let mode = mode.raw().cast_unsigned();
            let (bytes, length) = if self.target.is_short() {
                ([low, high, first, second, mode, 0, 0, 0], 4)
            } else {
                ([low, high, first, second, third, fourth, mode, 0], 6)
            };
            return RpdoBytes { bytes, length: length + usize::from(self.has_mode) };
        }
        RpdoBytes { bytes: [low, high, first, second, third, fourth, 0, 0], length: 6 }
    }

    /// Reads the first TPDO; `None` if it is shorter than mapped.
    pub(crate) fn decode(data: &[u8]) -> Option<Feedback> {
        let (status, rest) = data.split_first_chunk::<2>()?;
        let (position, _) = rest.split_first_chunk::<4>()?;
        Some(Feedback {
            statusword: Statusword(u16::from_le_bytes(*status)),
            position: i32::from_le_bytes(*position),
        })
    }
}

/// An RPDO, ready to be sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RpdoBytes {
    bytes: [u8; MAX_BYTES],
    length: usize,
}

impl RpdoBytes {
    /// The data of the frame.
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }
}

/// Values of the first TPDO.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Feedback {
    /// The statusword.
    pub statusword: Statusword,
    /// The actual position of the same instant, in steps.
    pub position: i32,
}

impl PdoLayout {
    /// The layout of a mode without further objects.
    pub fn for_mode(mode: OperatingMode) -> Self {
        Self::new(TargetObject::of_mode(mode), &[], &[])
    }

    /// The layout with these further objects; of an object that is listed twice the first one counts.
    pub fn new(target: TargetObject, outputs: &[OutputObject], inputs: &[InputObject]) -> Self {
        let mut auxiliary: Vec<Vec<_>> = Vec::new();
        for output in outputs.iter().filter(|output| **output != OutputObject::Mode) {
            if !auxiliary.iter().flatten().any(|earlier| earlier == output) {
                place(&mut auxiliary, *output, |output| output.entry(), 0);
            }
        }
        let mut tpdos: Vec<Vec<_>> = vec![Vec::new()];
        for input in inputs {
            if !tpdos.iter().flatten().any(|earlier| earlier == input) {
                place(&mut tpdos, *input, |input| input.entry(), FEEDBACK_BITS);
            }
        }
        let has_mode = outputs.contains(&OutputObject::Mode);
        Self { command: CommandLayout { target, has_mode }, auxiliary, inputs: tpdos, node_axis: 0 }
    }

    /// The layout with the objects of an axis of the node, from 0: 0x800 further for each.
    #[must_use]
    pub fn on_node_axis(mut self, axis: u8) -> Self {
        self.node_axis = axis;
        self
    }

    fn on_axis(&self, entry: MappingEntry) -> MappingEntry {
        MappingEntry { index: axis_index(self.node_axis, entry.index), ..entry }
    }

    /// The object after the controlword.
    pub fn target(&self) -> TargetObject {
        self.command.target
    }

    pub(crate) fn command(&self) -> CommandLayout {
        self.command
    }

    /// Number of RPDOs.
    pub fn rpdo_count(&self) -> usize {
        1 + self.auxiliary.len()
    }

    /// Number of TPDOs.
    pub fn tpdo_count(&self) -> usize {
        self.inputs.len().max(1)
    }

    /// Returns whether the RPDOs carry an object.
    pub fn has_output(&self, output: OutputObject) -> bool {
        match output {
            OutputObject::Mode => self.command.has_mode,
            _ => self.auxiliary.iter().flatten().any(|mapped| *mapped == output),
        }
    }

    /// The TPDO that carries an object, 0 is the first; `None` if none does.
    pub fn tpdo_of(&self, input: InputObject) -> Option<usize> {
        self.inputs.iter().position(|objects| objects.contains(&input))
    }

    /// Returns whether there are objects beyond controlword, target, statusword and actual position.
    pub(crate) fn is_extended(&self) -> bool {
        !self.auxiliary.is_empty() || self.inputs.iter().any(|objects| !objects.is_empty())
    }

    /// Entries of the mapping of an RPDO, 0 is the first. Real-time safe.
    pub fn rpdo_entries(&self, nth: usize) -> impl Iterator<Item = MappingEntry> {
        let controlword = MappingEntry::new(object::CONTROLWORD, 0, 16);
        let first = [Some(controlword), Some(self.command.target.entry())];
        let mode = self.command.has_mode.then(|| OutputObject::Mode.entry());
        let first = first.into_iter().chain([mode]).flatten().filter(move |_| nth == 0);
        let others = nth.checked_sub(1).and_then(|nth| self.auxiliary.get(nth));
        let entries = first.chain(others.into_iter().flatten().map(|output| output.entry()));
        entries.map(|entry| self.on_axis(entry))
    }

    /// Entries of the mapping of a TPDO, 0 is the first. Real-time safe.
    pub fn tpdo_entries(&self, nth: usize) -> impl Iterator<Item = MappingEntry> {
        let first = [
            MappingEntry::new(object::STATUSWORD, 0, 16),
            MappingEntry::new(object::POSITION_ACTUAL, 0, 32),
        ];
        let objects = self.inputs.get(nth).into_iter().flatten();
        let first = first.into_iter().filter(move |_| nth == 0);
        first.chain(objects.map(|input| input.entry())).map(|entry| self.on_axis(entry))
    }

    /// The first RPDO. A target beyond an `i16` is cut to its limits if its object has 16 bits.
    /// Real-time safe.
    pub fn encode(&self, controlword: Controlword, target: i32, mode: OperatingMode) -> RpdoBytes {
        self.command.encode(controlword, target, mode)
    }

    /// The RPDOs after the first. Real-time safe.
    pub fn encode_auxiliary(&self, values: &OutputValues) -> impl Iterator<Item = RpdoBytes> {
        self.auxiliary.iter().map(|outputs| {
            let (mut bytes, mut length) = ([0; MAX_BYTES], 0);
            for output in outputs {
                let size = usize::from(output.entry().bits / 8);
                let value = values.bytes(*output);
                let to = bytes.get_mut(length..).unwrap_or_default();
                length += fill(to, value.get(..size).unwrap_or_default());
            }
            RpdoBytes { bytes, length }
        })
    }

    /// Reads the first TPDO; `None` if it is shorter than mapped. Real-time safe.
    pub fn decode(&self, data: &[u8]) -> Option<Feedback> {
        CommandLayout::decode(data)
    }

    /// Reads the further objects of a TPDO, 0 is the first. Returns false if it is shorter than
    /// mapped; then nothing is changed. Real-time safe.
    pub fn decode_inputs(&self, nth: usize, data: &[u8], inputs: &mut AxisInputs) -> bool {
        let Some(objects) = self.inputs.get(nth) else { return nth == 0 };
        let mut at = if nth == 0 { FEEDBACK_BITS as usize / 8 } else { 0 };
        let end = objects.iter().map(|input| usize::from(input.entry().bits / 8)).sum::<usize>();
        if data.len() < at + end {
            return false;
        }
        for input in objects {
            let size = usize::from(input.entry().bits / 8);
            let bytes = data.get(at..at + size).unwrap_or_default();
            let raw = bytes.iter().rev().fold(0, |raw, byte| raw << 8 | u32::from(*byte));
            inputs.set(*input, raw);
            at += size;
        }
        true
    }
}

/// Bits of statusword and actual position.
const FEEDBACK_BITS: u32 = 48;

/// Puts an object into the first PDO with space; the first PDO has `used` bits already.
fn place<T: Copy>(pdos: &mut Vec<Vec<T>>, object: T, entry: impl Fn(T) -> MappingEntry, used: u32) {
    let bits = |object: T| u32::from(entry(object).bits);
    let has_space = |(nth, pdo): &(usize, &mut Vec<T>)| {
        let before = if *nth == 0 { used } else { 0 };
        before + pdo.iter().copied().map(bits).sum::<u32>() + bits(object) <= MAX_BITS
    };
    match pdos.iter_mut().enumerate().find(has_space) {
        Some((_, pdo)) => pdo.push(object),
        None => pdos.push(vec![object]),
    }
}

fn fill(to: &mut [u8], from: &[u8]) -> usize {
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
    from.len()
}

ecan_protocol::text_enum! {
    /// Object that the TPDOs of an axis carry, beyond statusword and actual position, see
    /// [`PdoConfig::inputs`](crate::PdoConfig::inputs).
    pub enum InputObject: u8;
    /// Actual velocity 0x606C, I32, in units of the drive's velocity.
    Velocity = 0, "actual velocity 0x606C";
    /// Actual torque 0x6077, I16, in thousandths of the rated torque.
    Torque = 1, "actual torque 0x6077";
    /// Error code 0x603F, U16.
    ErrorCode = 2, "error code 0x603F";
    /// Digital inputs 0x60FD, U32.
    DigitalInputs = 3, "digital inputs 0x60FD";
    /// Mode display 0x6061, I8.
    ModeDisplay = 4, "mode display 0x6061";
    /// Following error 0x60F4 by the drive, I32, in steps.
    FollowingError = 5, "following error 0x60F4";
    /// Touch probe status 0x60B9, U16.
    ProbeStatus = 6, "touch probe status 0x60B9";
    /// Position at the positive edge of touch probe 1, 0x60BA, I32, in steps.
    Probe1Positive = 7, "touch probe 1 position 0x60BA";
    /// Position at the negative edge of touch probe 1, 0x60BB, I32, in steps.
    Probe1Negative = 8, "touch probe 1 position 0x60BB";
    /// Position at the positive edge of touch probe 2, 0x60BC, I32, in steps.
    Probe2Positive = 9, "touch probe 2 position 0x60BC";
    /// Position at the negative edge of touch probe 2, 0x60BD, I32, in steps.
    Probe2Negative = 10, "touch probe 2 position 0x60BD";
    /// Actual velocity of the velocity mode, 0x6044, I16.
    VlVelocity = 11, "actual velocity 0x6044";
}

/// Number of the objects.
const COUNT: usize = 12;

impl InputObject {
    /// Entry of a PDO mapping, of the first axis of a node.
    pub fn entry(self) -> MappingEntry {
        let (index, bits) = match self {
            Self::Velocity => (object::VELOCITY_ACTUAL, 32),
            Self::Torque => (object::TORQUE_ACTUAL, 16),
            Self::ErrorCode => (object::ERROR_CODE, 16),
            Self::DigitalInputs => (object::DIGITAL_INPUTS, 32),
            Self::ModeDisplay => (object::MODE_DISPLAY, 8),
            Self::FollowingError => (object::FOLLOWING_ERROR, 32),
            Self::ProbeStatus => (object::PROBE_STATUS, 16),
            Self::Probe1Positive => (object::PROBE_1_POSITIVE, 32),
            Self::Probe1Negative => (object::PROBE_1_NEGATIVE, 32),
            Self::Probe2Positive => (object::PROBE_2_POSITIVE, 32),
            Self::Probe2Negative => (object::PROBE_2_NEGATIVE, 32),
            Self::VlVelocity => (object::VL_VELOCITY_ACTUAL, 16),
        };
        MappingEntry::new(index, 0, bits)
    }

    /// The value of these bits, with the sign of the object's type.
    fn value(self, raw: u32) -> i32 {
        match self {
            Self::Torque | Self::VlVelocity => (raw as u16).cast_signed().into(),
            Self::ErrorCode | Self::ProbeStatus => (raw as u16).into(),
            Self::ModeDisplay => (raw as u8).cast_signed().into(),
            _ => raw.cast_signed(),
        }
    }
}

/// Values of the last TPDOs of a drive. A value is `None` if its object is not in
/// [`PdoConfig::inputs`](crate::PdoConfig::inputs), or if no TPDO with it has arrived since the
/// configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AxisInputs {
    values: [i32; COUNT],
    /// A bit per object.
    present: u16,
}

impl AxisInputs {
    pub(crate) fn set(&mut self, object: InputObject, raw: u32) {
        let nth = usize::from(object.raw());
        if let Some(value) = self.values.get_mut(nth) {
            *value = object.value(raw);
            self.present |= 1 << nth;
        }
    }

    /// Value of an object; an unsigned one of 32 bits has the bits of the number. Real-time safe.
    pub fn get(&self, object: InputObject) -> Option<i32> {
        let nth = usize::from(object.raw());
        self.values.get(nth).copied().filter(|_| self.present & 1 << nth != 0)
    }

    /// Actual velocity 0x606C, in units of the drive's velocity.
    pub fn velocity(&self) -> Option<i32> {
        self.get(InputObject::Velocity)
    }

    /// Actual torque 0x6077, in thousandths of the rated torque.
    pub fn torque(&self) -> Option<i32> {
        self.get(InputObject::Torque)
    }

    /// Error code 0x603F.
    pub fn error_code(&self) -> Option<u16> {
        self.get(InputObject::ErrorCode).map(|value| value as u16)
    }

    /// Digital inputs 0x60FD.
    pub fn digital_inputs(&self) -> Option<u32> {
        self.get(InputObject::DigitalInputs).map(i32::cast_unsigned)
    }

    /// Mode display 0x6061, as the drive reports it.
    pub fn mode_display(&self) -> Option<i8> {
        self.get(InputObject::ModeDisplay).map(|value| value as i8)
    }

    /// Following error 0x60F4 by the drive, in steps.
    pub fn following_error(&self) -> Option<i32> {
        self.get(InputObject::FollowingError)
    }

    /// Touch probe status 0x60B9.
    pub fn probe_status(&self) -> Option<u16> {
        self.get(InputObject::ProbeStatus).map(|value| value as u16)
    }

    /// Values and presence as words of a snapshot.
    pub(crate) fn parts(&self) -> (&[i32; COUNT], u16) {
        (&self.values, self.present)
    }

    pub(crate) fn of_parts(values: [i32; COUNT], present: u16) -> Self {
        Self { values, present }
    }
}

ecan_protocol::text_enum! {
    /// Object that the RPDOs of an axis carry, beyond controlword and target, see
    /// [`PdoConfig::outputs`](crate::PdoConfig::outputs).
    pub enum OutputObject: u8;
    /// Velocity offset 0x60B1, I32, in units of the drive's velocity: feed-forward in CSP.
    VelocityOffset = 0, "velocity offset 0x60B1";
    /// Torque offset 0x60B2, I16, in thousandths of the rated torque: feed-forward in CSP and CSV.
    TorqueOffset = 1, "torque offset 0x60B2";
    /// Touch probe function 0x60B8, U16.
    ProbeFunction = 2, "touch probe function 0x60B8";
    /// Digital outputs 0x60FE:01, U32. The configuration writes the mask 0x60FE:02.
    DigitalOutputs = 3, "digital outputs 0x60FE:01";
    /// Mode of operation 0x6060, I8: the mode of the axis. It is in the RPDO of the controlword.
    Mode = 4, "mode of operation 0x6060";
}

impl OutputObject {
    /// Entry of a PDO mapping, of the first axis of a node.
    pub fn entry(self) -> MappingEntry {
        match self {
            Self::VelocityOffset => MappingEntry::new(object::VELOCITY_OFFSET, 0, 32),
            Self::TorqueOffset => MappingEntry::new(object::TORQUE_OFFSET, 0, 16),
            Self::ProbeFunction => MappingEntry::new(object::PROBE_FUNCTION, 0, 16),
            Self::DigitalOutputs => MappingEntry::new(object::DIGITAL_OUTPUTS, 1, 32),
            Self::Mode => MappingEntry::new(object::MODE_OF_OPERATION, 0, 8),
        }
    }

    /// Returns whether a drive uses the object in a mode.
    pub fn serves(self, mode: OperatingMode) -> bool {
        match self {
            Self::VelocityOffset => mode == OperatingMode::CyclicPosition,
            Self::TorqueOffset => {
                matches!(mode, OperatingMode::CyclicPosition | OperatingMode::CyclicVelocity)
            }
            Self::ProbeFunction | Self::DigitalOutputs | Self::Mode => true,
        }
    }

    /// Returns whether the object is a feed-forward.
    pub fn is_feed_forward(self) -> bool {
        matches!(self, Self::VelocityOffset | Self::TorqueOffset)
    }
}

/// Values of the RPDOs after the first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OutputValues {
    /// Velocity offset 0x60B1.
    pub velocity_offset: i32,
    /// Torque offset 0x60B2.
    pub torque_offset: i16,
    /// Touch probe function 0x60B8.
    pub probe_function: u16,
    /// Digital outputs 0x60FE:01.
    pub digital_outputs: u32,
}

impl OutputValues {
    /// Bytes of an object, little-endian; the first ones count.
    pub(crate) fn bytes(&self, object: OutputObject) -> [u8; 4] {
        match object {
            OutputObject::VelocityOffset => self.velocity_offset.to_le_bytes(),
            OutputObject::TorqueOffset => i32::from(self.torque_offset).to_le_bytes(),
            OutputObject::ProbeFunction => u32::from(self.probe_function).to_le_bytes(),
            OutputObject::DigitalOutputs => self.digital_outputs.to_le_bytes(),
            // In the first RPDO, by the mode of the axis.
            OutputObject::Mode => [0; 4],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_canopen::Command;

    const CSP: OperatingMode = OperatingMode::CyclicPosition;

    fn raw(entries: impl Iterator<Item = MappingEntry>) -> Vec<u32> {
        entries.map(|entry| entry.raw()).collect()
    }

    #[test]
    fn csp_rpdo_is_six_bytes_little_endian() {
        let enable = Controlword::of(Command::EnableOperation);
        let encode = |mode, word, target| PdoLayout::for_mode(mode).encode(word, target, mode);
        let rpdo = encode(CSP, enable, 0x1234_5678);
        assert_eq!(rpdo.as_slice(), [0x0F, 0x00, 0x78, 0x56, 0x34, 0x12]);
        let rpdo = encode(OperatingMode::CyclicVelocity, Controlword(0x10F), -2);
        assert_eq!(rpdo.as_slice(), [0x0F, 0x01, 0xFE, 0xFF, 0xFF, 0xFF]);
        let rpdo = encode(OperatingMode::CyclicTorque, enable, -40_000);
        assert_eq!(rpdo.as_slice(), [0x0F, 0x00, 0x00, 0x80]);
        let rpdo = encode(OperatingMode::InterpolatedPosition, Controlword(0x1F), 0x0102_0304);
        assert_eq!(rpdo.as_slice(), [0x1F, 0x00, 0x04, 0x03, 0x02, 0x01]);
        let rpdo = encode(OperatingMode::Velocity, Controlword(0x7F), -300);
        assert_eq!(rpdo.as_slice(), [0x7F, 0x00, 0xD4, 0xFE]);
    }

    #[test]
    fn mapping_matches_the_encoded_length() {
        for &mode in OperatingMode::ALL {
            for outputs in [&[][..], &[OutputObject::Mode]] {
                let layout = PdoLayout::new(TargetObject::of_mode(mode), outputs, &[]);
                let bits: usize = layout.rpdo_entries(0).map(|e| usize::from(e.bits)).sum();
                let rpdo = layout.encode(Controlword(0), 0, mode);
                assert_eq!(rpdo.as_slice().len() * 8, bits);
                assert!(
                    layout.target().serves(mode) && layout.target().serves(OperatingMode::Homing)
                );
            }
        }
        let layout = PdoLayout::default();
        assert_eq!(raw(layout.rpdo_entries(0)), [0x6040_0010, 0x607A_0020]);
        assert_eq!(raw(layout.tpdo_entries(0)), [0x6041_0010, 0x6064_0020]);
        assert_eq!((layout.rpdo_count(), layout.tpdo_count()), (1, 1));
        assert!(!layout.is_extended() && !PdoLayout::for_mode(CSP).is_extended());
        assert!(!TargetObject::Position.serves(OperatingMode::CyclicVelocity));
    }

    #[test]
    fn feed_forward_has_an_rpdo_of_its_own() {
        use OutputObject as O;
        let outputs =
            [O::VelocityOffset, O::Mode, O::TorqueOffset, O::DigitalOutputs, O::ProbeFunction];
        let layout = PdoLayout::new(TargetObject::Position, &outputs, &[]);
        assert_eq!(raw(layout.rpdo_entries(0)), [0x6040_0010, 0x607A_0020, 0x6060_0008]);
        assert_eq!(raw(layout.rpdo_entries(1)), [0x60B1_0020, 0x60B2_0010, 0x60B8_0010]);
        assert_eq!(raw(layout.rpdo_entries(2)), [0x60FE_0120]);
        let rpdo = layout.encode(Controlword(0x0F), -1, CSP);
        assert_eq!(rpdo.as_slice(), [0x0F, 0, 0xFF, 0xFF, 0xFF, 0xFF, 8]);
        let values = OutputValues {
            velocity_offset: -2,
            torque_offset: -3,
            probe_function: 0x1122,
            digital_outputs: 0xAABB_CCDD,
        };
        let rpdos: Vec<Vec<u8>> =
            layout.encode_auxiliary(&values).map(|rpdo| rpdo.as_slice().to_vec()).collect();
        assert_eq!(rpdos[0], [0xFE, 0xFF, 0xFF, 0xFF, 0xFD, 0xFF, 0x22, 0x11]);
        assert_eq!(rpdos[1], [0xDD, 0xCC, 0xBB, 0xAA]);
    }

    #[test]
    fn inputs_fill_the_tpdos_in_order() {
        use InputObject as I;
        let inputs = [I::Velocity, I::Torque, I::ErrorCode, I::Velocity, I::ModeDisplay];
        let layout = PdoLayout::new(TargetObject::Position, &[], &inputs);
        assert_eq!(raw(layout.tpdo_entries(0)), [0x6041_0010, 0x6064_0020, 0x6077_0010]);
        assert_eq!(raw(layout.tpdo_entries(1)), [0x606C_0020, 0x603F_0010, 0x6061_0008]);
        let mut values = AxisInputs::default();
        assert!(layout.decode_inputs(0, &[0, 0, 0, 0, 0, 0, 0xFE, 0xFF], &mut values));
        assert!(!layout.decode_inputs(1, &[1, 0, 0, 0, 2, 0], &mut values), "too short");
        assert_eq!((values.velocity(), values.torque()), (None, Some(-2)));
        assert!(layout.decode_inputs(1, &[0xFF, 0xFF, 0xFF, 0xFF, 0x10, 0x23, 0xFF], &mut values));
        assert_eq!((values.velocity(), values.error_code()), (Some(-1), Some(0x2310)));
        assert_eq!(values.mode_display(), Some(-1));
        assert!(!layout.decode_inputs(2, &[0; 8], &mut values), "no such TPDO");
    }

    #[test]
    fn short_tpdo_is_rejected() {
        let data = [0x37, 0x12, 0xFF, 0xFF, 0xFF, 0xFF];
        let feedback = Feedback { statusword: Statusword(0x1237), position: -1 };
        assert_eq!(PdoLayout::default().decode(&data), Some(feedback));
        for length in 0..6 {
            assert_eq!(PdoLayout::default().decode(&data[..length]), None);
        }
    }

    #[test]
    fn values_have_the_sign_of_their_type() {
        assert_eq!(InputObject::ALL.len(), COUNT);
        let mut inputs = AxisInputs::default();
        assert!(InputObject::ALL.iter().all(|object| inputs.get(*object).is_none()));
        for &object in InputObject::ALL {
            inputs.set(object, 0xFFFF_FFFE);
        }
        assert_eq!((inputs.velocity(), inputs.torque()), (Some(-2), Some(-2)));
        assert_eq!((inputs.error_code(), inputs.probe_status()), (Some(0xFFFE), Some(0xFFFE)));
        assert_eq!(inputs.digital_inputs(), Some(0xFFFF_FFFE));
        assert_eq!(inputs.mode_display(), Some(-2));
        assert_eq!(inputs.get(InputObject::VlVelocity), Some(-2));
        let (values, present) = inputs.parts();
        assert_eq!(AxisInputs::of_parts(*values, present), inputs);
    }
}
