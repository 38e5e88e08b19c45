//! Process data of an axis: its RPDOs and TPDOs.

use ecan_canopen::{Controlword, MappingEntry, OperatingMode, Statusword, object};

use super::input_object::{AxisInputs, InputObject};
use super::node_axis::axis_index;
use super::output_object::{OutputObject, OutputValues};

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
/// Further objects by choice, [`AxisConfig::outputs`](crate::AxisConfig::outputs) and
/// [`AxisConfig::inputs`](crate::AxisConfig::inputs), follow in the order of their lists, each in
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
            _ => self.auxiliary.iter().flatten().any(|it| *it == output),
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
}
