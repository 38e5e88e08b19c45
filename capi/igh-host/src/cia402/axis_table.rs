//! Axis tables of C as Rust has them, with every fault.

use std::fmt;

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, RESERVED_IS_SET};
use ecan_canopen::{
    FaultReaction, HaltOption, NodeAddress, NodeId, NodeLossReaction, OperatingMode,
    QuickStopOption, SdoValue, Step, StopOption,
};
use ecan_cia402::{AxisConfig, AxisFault, AxisFaults, Cia402Error, DriveConfig, PositionRange};

use super::axis;
use super::axis::{IGH_CIA402_UNCHANGED, SEAL, igh_cia402_axis_t, igh_cia402_object_t};
use super::numbers::{igh_cia402_range_t, igh_cia402_reset_t};
use crate::errors;

/// An axis table of C.
#[derive(Debug)]
pub(crate) struct AxisTable {
    /// Axes with their indices, without those of which nothing is known.
    axes: Vec<(usize, AxisConfig)>,
    faults: Vec<(usize, Fault)>,
}

#[derive(Debug)]
enum Fault {
    /// Rust's types cannot hold the value of a field.
    Value(String, i64),
    Reserved,
    Axis(AxisFault),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Value(field, value) => write!(f, "invalid value {value} for `{field}`"),
            Self::Reserved => f.write_str(RESERVED_IS_SET),
            Self::Axis(fault) => fault.fmt(f),
        }
    }
}

impl AxisTable {
    /// Reads a table; axes that are not filled are an error.
    pub(crate) fn read(call: Call, axes: &[igh_cia402_axis_t]) -> Result<Self, ecan_result_t> {
        let unfilled = axes.iter().enumerate().filter(|(_, axis)| axis.seal != SEAL);
        let unfilled: Vec<_> = unfilled.map(|(index, _)| index.to_string()).collect();
        if !unfilled.is_empty() {
            let unfilled = unfilled.join(", ");
            let text =
                format_args!("axis {unfilled} is not filled: call igh_cia402_axis_init first");
            return Err(call.fail(ecan_result_t::ECAN_ERR_NOT_INITIALISED, text));
        }
        let mut table = Self { axes: Vec::new(), faults: Vec::new() };
        for (index, axis) in axes.iter().enumerate() {
            if axis.has_reserved() {
                table.faults.push((index, Fault::Reserved));
            }
            let mut report =
                |field: &str, value| table.faults.push((index, Fault::Value(field.into(), value)));
            table.axes.extend(axis.checked(&mut report).map(|axis| (index, axis)));
        }
        Ok(table)
    }

    /// The axes of a table without faults; `check` finds those that Rust defines.
    pub(crate) fn into_axes(
        mut self,
        call: Call,
        check: impl FnOnce(&mut dyn Iterator<Item = (usize, &AxisConfig)>) -> Vec<(usize, AxisFault)>,
    ) -> Result<Vec<AxisConfig>, ecan_result_t> {
        let faults = check(&mut self.axes.iter().map(|(index, axis)| (*index, axis)));
        if self.faults.is_empty() {
            if faults.is_empty() {
                return Ok(self.axes.into_iter().map(|(_, axis)| axis).collect());
            }
            return Err(errors::note(call, &Cia402Error::Axes(AxisFaults { faults })));
        }
        self.faults.extend(faults.into_iter().map(|(axis, fault)| (axis, Fault::Axis(fault))));
        self.faults.sort_by_key(|(axis, _)| *axis);
        let text: String =
            self.faults.iter().map(|(axis, fault)| format!("\n  - axis {axis}: {fault}")).collect();
        let text = format_args!("the axis table has faults{text}");
        Err(call.fail(ecan_result_t::ECAN_ERR_CONFIG, text))
    }
}

impl igh_cia402_axis_t {
    /// Converts to Rust. Reports every value that Rust's types cannot hold; the table as a whole is
    /// checked later. `None` if nothing else of the axis can be checked.
    fn checked(&self, report: &mut dyn FnMut(&str, i64)) -> Option<AxisConfig> {
        let node = NodeId::from_raw(self.node_id);
        if node.is_none() {
            report("node_id", self.node_id.into());
        }
        let mode = OperatingMode::from_raw(self.mode);
        if mode.is_none() {
            report("mode", self.mode.into());
        }
        let reset = igh_cia402_reset_t::to_rust(self.reset);
        if reset.is_none() {
            report("reset", self.reset.into());
        }
        let range = self.range();
        if range.is_none() {
            report("range", self.range.into());
        }
        let further = self.further.get(..usize::from(self.further_count));
        if further.is_none() {
            report("further_count", self.further_count.into());
        }
        let further: Vec<_> = further.unwrap_or_default().iter().collect();
        for object in further.iter().filter(|object| object.step().is_none()) {
            report("further", object.value);
        }
        let mut code = |name, code: i32| {
            let short = (code != IGH_CIA402_UNCHANGED).then(|| i16::try_from(code));
            short.and_then(|short| short.map_err(|_| report(name, code.into())).ok())
        };
        let drive = DriveConfig {
            reset: reset.unwrap_or_default(),
            host_loss: code("host_loss", self.host_loss).map(NodeLossReaction::from_raw),
            quick_stop: code("quick_stop", self.quick_stop).map(QuickStopOption::from_raw),
            shutdown: code("shutdown", self.shutdown).map(StopOption::from_raw),
            disable_operation: code("disable_operation", self.disable_operation)
                .map(StopOption::from_raw),
            halt: code("halt", self.halt).map(HaltOption::from_raw),
            fault_reaction: code("fault_reaction", self.fault_reaction)
                .map(FaultReaction::from_raw),
            further: further.into_iter().filter_map(igh_cia402_object_t::step).collect(),
            ..DriveConfig::default()
        };
        let (slave, channel) = (self.slave.into(), self.channel);
        let mut settings = AxisConfig {
            mode: mode?,
            range: range.unwrap_or(PositionRange::Linear),
            drive,
            ..AxisConfig::new(NodeAddress { slave, channel, node: node? })
        };
        axis::apply(self, &mut settings, report);
        let mut settings = settings.with_step_limit(self.step_limit);
        if self.following_window != 0 {
            settings.following_window = self.following_window;
        }
        Some(settings)
    }

    fn range(&self) -> Option<PositionRange> {
        use igh_cia402_range_t::*;
        const LINEAR: u8 = IGH_CIA402_RANGE_LINEAR as u8;
        const WRAPPING: u8 = IGH_CIA402_RANGE_WRAPPING as u8;
        const MODULO: u8 = IGH_CIA402_RANGE_MODULO as u8;
        Some(match self.range {
            LINEAR => PositionRange::Linear,
            WRAPPING => PositionRange::Wrapping,
            MODULO => PositionRange::Modulo { min: self.range_min, max: self.range_max },
            _ => return None,
        })
    }
}

impl igh_cia402_object_t {
    /// Step that writes the object; `None` if the value does not fit the size.
    fn step(&self) -> Option<Step> {
        // A value fits where it is that of the object, read with or without sign.
        let value = self.value;
        let sized: SdoValue = match self.size {
            1 => i8::try_from(value).map(Into::into).or(u8::try_from(value).map(Into::into)),
            2 => i16::try_from(value).map(Into::into).or(u16::try_from(value).map(Into::into)),
            4 => i32::try_from(value).map(Into::into).or(u32::try_from(value).map(Into::into)),
            8 => Ok(value.into()),
            _ => return None,
        }
        .ok()?;
        let step = Step::write(self.index, self.subindex, sized);
        Some(if self.is_optional != 0 { step.if_present() } else { step })
    }
}

#[cfg(test)]
mod tests {
    use std::ffi::c_int;

    use ecan_c_boundary::call;
    use ecan_canopen::IdentityCheck;
    use ecan_cia402::{PdoConfig, Scale};
    use ecan_mcan_host::common::ecan_last_error;

    use super::super::axis::igh_cia402_axis_init;
    use super::*;

    fn axis(target_step: i32) -> igh_cia402_axis_t {
        let mut axis = std::mem::MaybeUninit::uninit();
        // SAFETY: the pointer is valid for writing.
        let code = unsafe { igh_cia402_axis_init(axis.as_mut_ptr(), 2, 1, 5, target_step) };
        assert_eq!(code, 0);
        // SAFETY: filled by the call above.
        unsafe { axis.assume_init() }
    }

    fn to_rust(axis: &igh_cia402_axis_t) -> Result<AxisConfig, c_int> {
        let mut settings = None;
        let code = call("to_rust", |call| {
            let table = AxisTable::read(call, std::slice::from_ref(axis))?;
            settings = table.into_axes(call, |_| Vec::new())?.pop();
            Ok(())
        });
        settings.ok_or(code)
    }

    fn defaults(target_step: i32) -> AxisConfig {
        let node = NodeId::new(5).unwrap();
        AxisConfig::new(NodeAddress { slave: 2, channel: 1, node }).with_target_step(target_step)
    }

    #[test]
    fn defaults_of_c_are_those_of_rust() {
        for target_step in [0, 10, -1000, 5000, i32::MIN] {
            assert_eq!(to_rust(&axis(target_step)), Ok(defaults(target_step)));
        }
    }

    #[test]
    fn limits_follow_the_step_limit_by_default() {
        let mut small = axis(0);
        small.step_limit = 3;
        assert_eq!(to_rust(&small), Ok(defaults(0).with_step_limit(3)));
        let mut large = axis(0);
        large.step_limit = 100_000;
        assert_eq!(to_rust(&large).unwrap().following_window, 800_000);
        large.following_window = 900_000;
        assert_eq!(to_rust(&large).unwrap().following_window, 900_000);
    }

    #[test]
    fn every_field_arrives() {
        let mut axis = axis(0);
        axis.mode = OperatingMode::CyclicVelocity.raw();
        (axis.node_axis, axis.pdo_number) = (2, 300);
        (axis.range, axis.range_min, axis.range_max) = (2, -5, 7);
        (axis.has_bounds, axis.bound_min, axis.bound_max) = (1, -3, 3);
        (axis.steps_per_turn, axis.origin) = (4096.0, 11);
        (axis.check_identity, axis.vendor_id, axis.product_code) = (1, 0x99, 0x402);
        (axis.host_loss, axis.quick_stop) = (IGH_CIA402_UNCHANGED, -2);
        (axis.shutdown, axis.disable_operation, axis.halt, axis.fault_reaction) = (1, 0, 2, 3);
        axis.write_following_error = 1;
        (axis.following_error_window, axis.following_error_ms) = (12_000, 20);
        (axis.reset, axis.auto_resume, axis.write_position_limits) = (1, 1, 1);
        axis.further_count = 2;
        axis.further[0] =
            igh_cia402_object_t { value: -1, index: 0x2000, size: 2, ..Default::default() };
        axis.further[1] = igh_cia402_object_t {
            value: 200,
            index: 0x2001,
            subindex: 3,
            size: 1,
            is_optional: 1,
            reserved: [0; 3],
        };
        let drive = DriveConfig {
            reset: ecan_cia402::NodeReset::Communication,
            identity: IdentityCheck {
                vendor_id: Some(0x99),
                product_code: Some(0x402),
                ..IdentityCheck::default()
            },
            host_loss: None,
            quick_stop: Some(QuickStopOption::Other(-2)),
            shutdown: Some(StopOption::SlowDown),
            disable_operation: Some(StopOption::Disable),
            halt: Some(HaltOption::QuickStop),
            fault_reaction: Some(FaultReaction::CurrentLimit),
            following_error: Some((12_000, 20)),
            write_position_limits: true,
            further: vec![
                Step::write(0x2000, 0, -1_i16),
                Step::write(0x2001, 3, 200_u8).if_present(),
            ],
            ..DriveConfig::default()
        };
        let expected = AxisConfig {
            node_axis: 2,
            mode: OperatingMode::CyclicVelocity,
            pdos: PdoConfig { number: 300, ..PdoConfig::default() },
            range: PositionRange::Modulo { min: -5, max: 7 },
            bounds: Some((-3, 3)),
            scale: Scale::steps_per_turn(4096.0).with_origin(11),
            auto_resume: true,
            drive,
            ..defaults(0)
        };
        assert_eq!(to_rust(&axis), Ok(expected));
    }

    #[test]
    fn invalid_values_return_errors() {
        let config = Err(ecan_result_t::ECAN_ERR_CONFIG.code());
        let faulty = |change: fn(&mut igh_cia402_axis_t)| {
            let mut axis = axis(0);
            change(&mut axis);
            to_rust(&axis)
        };
        assert_eq!(faulty(|axis| axis.node_id = 128), config);
        assert_eq!(faulty(|axis| axis.mode = 5), config);
        assert_eq!(faulty(|axis| axis.range = 3), config);
        assert_eq!(faulty(|axis| axis.reset = 3), config);
        assert_eq!(faulty(|axis| axis.host_loss = 0x8000), config);
        assert_eq!(faulty(|axis| axis.further_count = 17), config);
        assert_eq!(faulty(|axis| axis.further_count = 1), config, "a size of 0");
        let unfilled = Err(ecan_result_t::ECAN_ERR_NOT_INITIALISED.code());
        assert_eq!(faulty(|axis| axis.seal = 0), unfilled);
    }

    #[test]
    fn every_faulty_axis_is_named() {
        let mut table = [axis(0), axis(0), axis(0)];
        table[0].mode = 5;
        (table[2].range, table[2].halt) = (3, 0x8000);
        let rejected = |table: &[igh_cia402_axis_t]| {
            let rejected = call("f", |call| {
                AxisTable::read(call, table)?
                    .into_axes(call, |axes| {
                        axes.map(|(axis, _)| (axis, AxisFault::NoStep)).collect()
                    })
                    .map(|_| ())
            });
            // SAFETY: the text ends with NUL and is not changed while it is read.
            let text = unsafe { std::ffi::CStr::from_ptr(ecan_last_error()) };
            (rejected, text.to_str().unwrap().to_owned())
        };
        let expected = "f: the axis table has faults\n  \
                        - axis 0: invalid value 5 for `mode`\n  \
                        - axis 1: the step limit is 0; must be at least 1\n  \
                        - axis 2: invalid value 3 for `range`\n  \
                        - axis 2: invalid value 32768 for `halt`\n  \
                        - axis 2: the step limit is 0; must be at least 1";
        let config = ecan_result_t::ECAN_ERR_CONFIG.code();
        assert_eq!(rejected(&table), (config, expected.into()));
        (table[0].seal, table[1].seal) = (0, 1);
        let (code, text) = rejected(&table);
        assert_eq!(code, ecan_result_t::ECAN_ERR_NOT_INITIALISED.code());
        assert!(text.contains("axis 0, 1 is not filled"), "{text}");
    }
}
