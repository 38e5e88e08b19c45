//! The steps that bring a drive from whatever state to Operational with its PDOs mapped.

use ecan_canopen::{
    Expectation, HeartbeatConsumer, HostHeartbeat, NmtCommand, NodeAction, OperatingMode,
    ParameterSet, PdoDirection, PdoMapping, PdoMappingError, Step, SupportedModes, SyncConfig,
    object,
};

use super::config::{AxisConfig, LAST_PDO};
use super::config::{DriveConfig, NodeReset};
use super::host_loss::StopOptions;
use super::limits::DriveLimits;
use super::pdo_layout::OutputObject;
use super::pdo_layout::TargetObject;
use super::script::axis_step;
use super::targets::interpolation_time;
use super::units::{DriveUnits, ScaleSource};

/// Device profile of a drive in the low half of the device type.
const PROFILE_402: Expectation = Expectation::Masked { value: 402, mask: 0xFFFF };
/// Statusword bit 2: set in Operation Enabled, Quick Stop Active and Fault Reaction Active only.
const NOT_ENERGISED: Expectation = Expectation::Masked { value: 0, mask: 0x0004 };
const NS_PER_US: u64 = 1_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct BusConfig {
    pub(crate) sync_period_ns: u64,
    pub(crate) target_period_ns: u64,
    pub(crate) host: Option<HostHeartbeat>,
    pub(crate) sync: SyncConfig,
}

/// The steps for the axes of a node, in order:
///
/// 1. NMT: reset where asked for, then Pre-operational.
/// 2. Device type, identity, supported modes.
/// 3. Power off by SDO, of a drive that is not enabled: it must not be mapped while it moves, nor lose
///    its voltage.
/// 4. Parameters of the application, for example those of a DCF.
/// 5. Heartbeats or guarding both ways, and what happens when the host's stays away.
/// 6. Mapping of the RPDOs and the TPDOs, other TPDOs off.
/// 7. SYNC counter and period, interpolation time (the target period), stop options, limits, further steps of
///    the application.
/// 8. Stop options, and limits and units where asked for, as the drive has them now.
/// 9. NMT: start.
///
/// The mode of each axis follows after that, with its confirmation. The first axis has the settings of the
/// node, which are those of all.
pub(crate) fn steps(axes: &[&AxisConfig], bus: &BusConfig) -> Result<Vec<Step>, PdoMappingError> {
    let mut steps = Vec::new();
    let Some(node) = axes.first() else { return Ok(steps) };
    if node.drive.reset == NodeReset::None {
        for_each_axis(&mut steps, axes, |steps, _| push_off_check(steps));
    }
    push_nmt(&mut steps, node);
    push_identity(&mut steps, node);
    for_each_axis(&mut steps, axes, push_mode_check);
    for_each_axis(&mut steps, axes, |steps, _| {
        push_off_check(steps);
        steps.push(Step::write(object::CONTROLWORD, 0, 0_u16).named("power off").if_accepted());
    });
    if *node.drive.parameters != ParameterSet::default() {
        steps.push(Step::device(NodeAction::WriteParameters));
    }
    push_heartbeats(&mut steps, node, bus);
    for_each_axis(&mut steps, axes, |steps, axis| push_host_loss(steps, axis, bus));
    for axis in axes {
        for pdo in axis.pdo_mappings() {
            steps.extend(pdo.steps()?);
        }
        for_each_axis(&mut steps, &[*axis], push_outputs);
    }
    push_other_tpdos(&mut steps, axes)?;
    push_sync(&mut steps, bus);
    for_each_axis(&mut steps, axes, |steps, axis| push_interpolation_time(steps, axis, bus));
    for axis in axes {
        for_each_axis(&mut steps, &[*axis], |steps, axis| {
            push_stop_options(steps, axis);
            push_limits(steps, axis);
            push_mode_parameters(steps, axis);
        });
        steps.extend(axis.drive.further.iter().copied());
    }
    steps.extend(StopOptions::node_steps(node.drive.guarding.is_some()));
    for_each_axis(&mut steps, axes, |steps, axis| {
        steps.extend(StopOptions::steps());
        if axis.reads_limits() {
            steps.extend(DriveLimits::steps());
        }
        if axis.scale_source != ScaleSource::Configured || axis.reads_limits() {
            steps.extend(DriveUnits::steps(axis.scale_source == ScaleSource::Drive));
        }
    });
    steps.push(Step::device(NodeAction::Nmt(NmtCommand::Start)));
    Ok(steps)
}

/// Adds steps with the objects of the first axis for each axis.
fn for_each_axis(
    steps: &mut Vec<Step>,
    axes: &[&AxisConfig],
    push: impl Fn(&mut Vec<Step>, &AxisConfig),
) {
    for axis in axes {
        let mut of_first = Vec::new();
        push(&mut of_first, axis);
        steps.extend(of_first.into_iter().map(|step| axis_step(axis.node_axis, step)));
    }
}

fn push_nmt(steps: &mut Vec<Step>, config: &AxisConfig) {
    let reset = match config.drive.reset {
        NodeReset::None => None,
        NodeReset::Communication => Some(NmtCommand::ResetCommunication),
        NodeReset::Node => Some(NmtCommand::ResetNode),
    };
    if let Some(command) = reset {
        steps.push(Step::device(NodeAction::Nmt(command)));
        let timeout = config.drive.boot_timeout;
        steps.push(Step::device(NodeAction::AwaitBootUp { timeout }));
    }
    steps.push(Step::device(NodeAction::Nmt(NmtCommand::EnterPreOperational)));
}

/// The drive must not be energised: it would coast without voltage. Its state was read before, but a
/// drive that did not answer then may answer now.
fn push_off_check(steps: &mut Vec<Step>) {
    let step = Step::expect_that(object::STATUSWORD, 0, NOT_ENERGISED);
    steps.push(step.named("drive not enabled").if_present());
}

fn push_identity(steps: &mut Vec<Step>, config: &AxisConfig) {
    let drive = &config.drive;
    if drive.expect_profile_402 {
        let step = Step::expect_that(object::DEVICE_TYPE, 0, PROFILE_402);
        steps.push(step.named("drive profile"));
    }
    steps.extend(drive.identity.steps());
}

fn push_mode_check(steps: &mut Vec<Step>, config: &AxisConfig) {
    let mode = Expectation::HasBits(SupportedModes::bit(config.mode).into());
    let modes = Step::expect_that(object::SUPPORTED_MODES, 0, mode);
    steps.push(modes.named("supported modes").if_present());
}

fn push_heartbeats(steps: &mut Vec<Step>, config: &AxisConfig, bus: &BusConfig) {
    let drive = &config.drive;
    let producer = object::PRODUCER_HEARTBEAT;
    if let Some(guarding) = &drive.guarding {
        steps.extend(guarding.steps());
    } else {
        steps.push(Step::write(producer, 0, drive.heartbeat_ms).named("heartbeat").if_present());
        steps.push(Step::read(producer, 0).named("heartbeat").if_present());
    }
    let host = bus.host.filter(|_| drive.host_heartbeat_ms > 0);
    if let Some(host) = host {
        let entry = HeartbeatConsumer { producer: host.node, time_ms: drive.host_heartbeat_ms };
        let step = Step::write(object::CONSUMER_HEARTBEAT, 1, entry.raw());
        steps.push(step.named("watch the host").if_present());
    }
}

fn push_host_loss(steps: &mut Vec<Step>, config: &AxisConfig, bus: &BusConfig) {
    let drive = &config.drive;
    let is_watched = bus.host.is_some() && drive.host_heartbeat_ms > 0 || drive.guarding.is_some();
    if let Some(reaction) = drive.host_loss
        && is_watched
    {
        let step = Step::write(object::ABORT_CONNECTION_OPTION, 0, reaction.raw());
        steps.push(step.named("reaction to a lost host").if_present());
    }
}

fn push_other_tpdos(steps: &mut Vec<Step>, axes: &[&AxisConfig]) -> Result<(), PdoMappingError> {
    if !axes.first().is_some_and(|node| node.drive.silence_other_tpdos) {
        return Ok(());
    }
    let is_used = |number: u16| {
        axes.iter().any(|axis| {
            (axis.pdos.number..).take(axis.layout().tpdo_count()).any(|used| used == number)
        })
    };
    for other in (1..=LAST_PDO).filter(|other| !is_used(*other)) {
        let off = PdoMapping::disabling_steps(PdoDirection::Transmit, other)?;
        steps.extend(off.into_iter().map(Step::if_present));
    }
    Ok(())
}

/// The drive may have a feed-forward of an earlier owner. The mask selects the outputs that are set.
fn push_outputs(steps: &mut Vec<Step>, config: &AxisConfig) {
    let layout = config.layout();
    if layout.has_output(OutputObject::VelocityOffset) {
        steps.push(Step::write(object::VELOCITY_OFFSET, 0, 0_i32).named("no velocity offset"));
    }
    if layout.has_output(OutputObject::TorqueOffset) {
        steps.push(Step::write(object::TORQUE_OFFSET, 0, 0_i16).named("no torque offset"));
    }
    if let Some(mask) = config.drive.output_mask {
        let step = Step::write(object::DIGITAL_OUTPUTS, 2, mask);
        steps.push(step.named("digital output mask"));
    }
}

fn push_sync(steps: &mut Vec<Step>, bus: &BusConfig) {
    if bus.sync.counter_overflow.is_some() {
        // The counter can only be set while the period is 0.
        let step = Step::write(object::COMMUNICATION_CYCLE, 0, 0_u32);
        steps.push(step.named("no SYNC period").if_accepted());
        steps.push(bus.sync.counter_step());
    }
    if let Ok(period_us) = u32::try_from(bus.sync_period_ns / NS_PER_US) {
        let step = Step::write(object::COMMUNICATION_CYCLE, 0, period_us);
        steps.push(step.named("SYNC period").if_accepted());
    }
}

/// In every mode, since [`can_switch_to`] allows a cyclic one later.
fn push_interpolation_time(steps: &mut Vec<Step>, config: &AxisConfig, bus: &BusConfig) {
    if let Some((value, power)) = interpolation_time(bus.target_period_ns) {
        let is_needed =
            config.mode.is_cyclic() || can_switch_to(config, OperatingMode::CyclicPosition);
        let push = |step: Step| {
            let step = step.named("interpolation time");
            steps.push(if is_needed { step.if_present() } else { step.if_accepted() });
        };
        let time = object::INTERPOLATION_TIME;
        [Step::write(time, 2, power), Step::write(time, 1, value)].into_iter().for_each(push);
    }
}

fn push_stop_options(steps: &mut Vec<Step>, config: &AxisConfig) {
    let DriveConfig { quick_stop, shutdown, disable_operation, halt, fault_reaction, .. } =
        &config.drive;
    let options = [
        (object::QUICK_STOP_OPTION, "quick stop option", quick_stop.map(|option| option.raw())),
        (object::SHUTDOWN_OPTION, "shutdown option", shutdown.map(|option| option.raw())),
        (
            object::DISABLE_OPERATION_OPTION,
            "disable operation option",
            disable_operation.map(|option| option.raw()),
        ),
        (object::HALT_OPTION, "halt option", halt.map(|option| option.raw())),
        (
            object::FAULT_REACTION_OPTION,
            "fault reaction",
            fault_reaction.map(|option| option.raw()),
        ),
    ];
    for (index, name, option) in options {
        let step = option.map(|raw| Step::write(index, 0, raw).named(name).if_present());
        steps.extend(step);
    }
}

fn push_limits(steps: &mut Vec<Step>, config: &AxisConfig) {
    let drive = &config.drive;
    if let Some((window, time_ms)) = drive.following_error {
        let step = Step::write(object::FOLLOWING_ERROR_WINDOW, 0, window);
        steps.push(step.named("following error window").if_present());
        let step = Step::write(object::FOLLOWING_ERROR_TIME, 0, time_ms);
        steps.push(step.named("following error time").if_present());
    }
    let max_torque = drive.max_torque.map(|torque| Step::write(object::MAX_TORQUE, 0, torque));
    steps.extend(max_torque.map(|step| step.named("largest torque")));
    let speed = drive.max_motor_speed.map(|speed| Step::write(object::MAX_MOTOR_SPEED, 0, speed));
    steps.extend(speed.map(|step| step.named("largest motor speed")));
    let is_position = matches!(
        TargetObject::of_mode(config.mode),
        TargetObject::Position | TargetObject::InterpolationData
    );
    if let Some((min, max)) = config.bounds
        && drive.write_position_limits
        && is_position
    {
        let limit = object::SOFTWARE_POSITION_LIMIT;
        steps.push(Step::write(limit, 1, min).named("lower position limit").if_present());
        steps.push(Step::write(limit, 2, max).named("upper position limit").if_present());
    }
}

/// Parameters of the modes IP, PT and VL.
fn push_mode_parameters(steps: &mut Vec<Step>, config: &AxisConfig) {
    let DriveConfig { interpolation_buffer, torque_slope, vl, .. } = &config.drive;
    if config.mode == OperatingMode::InterpolatedPosition {
        let buffer = object::INTERPOLATION_BUFFER;
        let mode = Step::write(object::INTERPOLATION_MODE, 0, 0_i16).named("linear interpolation");
        let size = interpolation_buffer.map(|size| Step::write(buffer, 2, u32::from(size)));
        steps.push(mode.if_present());
        steps.push(Step::write(buffer, 6, 0_u8).named("clear the buffer").if_present());
        steps.extend(size.map(|step| step.named("buffer size")));
        steps.push(Step::write(buffer, 6, 1_u8).named("enable the buffer").if_present());
    }
    let slope = torque_slope.map(|slope| Step::write(object::TORQUE_SLOPE, 0, slope));
    steps.extend(slope.map(|step| step.named("torque slope")));
    if let Some((least, most)) = vl.limits {
        let limits = object::VL_VELOCITY_LIMITS;
        steps.push(Step::write(limits, 1, least).named("smallest velocity"));
        steps.push(Step::write(limits, 2, most).named("largest velocity"));
    }
    for (index, name, ramp) in [
        (object::VL_ACCELERATION, "acceleration", vl.acceleration),
        (object::VL_DECELERATION, "deceleration", vl.deceleration),
    ] {
        if let Some((velocity, seconds)) = ramp {
            steps.push(Step::write(index, 1, velocity).named(name));
            steps.push(Step::write(index, 2, seconds).named(name));
        }
    }
}

/// Returns true if a mode can be chosen while the PDOs of `config` are mapped.
pub(crate) fn can_switch_to(config: &AxisConfig, mode: OperatingMode) -> bool {
    TargetObject::of_mode(config.mode).serves(mode)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_canopen::{NodeAddress, NodeId};
    use std::time::Duration;

    #[test]
    fn interpolation_time_is_the_target_period() {
        let node = NodeId::new(5).unwrap();
        let mut config = AxisConfig::new(NodeAddress { slave: 0, channel: 1, node });
        let bus = BusConfig {
            sync_period_ns: 2_000_000,
            target_period_ns: 6_000_000,
            host: None,
            sync: SyncConfig::default(),
        };
        for mode in [
            OperatingMode::CyclicPosition,
            OperatingMode::CyclicTorque,
            OperatingMode::ProfilePosition,
        ] {
            config.mode = mode;
            let steps = steps(&[&config], &bus).unwrap();
            let texts: Vec<_> = steps.iter().map(|step| step.action.to_string()).collect();
            for write in ["write 0x1006:00 = 0x000007D0", "write 0x60C2:01 = 0x06"] {
                assert!(texts.iter().any(|text| text.contains(write)), "{mode}: {texts:#?}");
            }
        }
    }

    #[test]
    fn setup_steps_keep_the_order_of_the_standard() {
        let node = NodeId::new(5).unwrap();
        let mut config = AxisConfig::new(NodeAddress { slave: 0, channel: 1, node });
        config.drive.silence_other_tpdos = false;
        let host =
            HostHeartbeat { node: NodeId::new(127).unwrap(), period: Duration::from_millis(50) };
        let bus = BusConfig {
            sync_period_ns: 1_000_000,
            target_period_ns: 1_000_000,
            host: Some(host),
            sync: SyncConfig::default(),
        };
        let texts: Vec<String> =
            steps(&[&config], &bus).unwrap().iter().map(|step| step.action.to_string()).collect();
        let position_of = |part: &str| {
            let at = texts.iter().position(|text| text.contains(part));
            at.unwrap_or_else(|| panic!("no {part} in {texts:#?}"))
        };
        let order = [
            "NMT enter pre-operational",
            "check 0x1000:00",
            "check 0x6502:00",
            "write 0x6040:00 = 0x0000",
            "write 0x1017:00 = 0x0064",
            "write 0x1016:01 = 0x007F00FA",
            "write 0x6007:00 = 0x0003",
            "change 0x1400:01",
            "write 0x1600:00 = 0x00",
            "write 0x1600:01 = 0x60400010",
            "write 0x1600:02 = 0x607A0020",
            "write 0x1600:00 = 0x02",
            "change 0x1800:01",
            "write 0x1A00:01 = 0x60410010",
            "write 0x1A00:02 = 0x60640020",
            "write 0x60C2:02 = 0xFD",
            "write 0x60C2:01 = 0x01",
            "read 0x1016:01",
            "read 0x6007:00",
            "read 0x605A:00",
            "read 0x605E:00",
            "NMT start",
        ];
        let positions: Vec<usize> = order.iter().map(|part| position_of(part)).collect();
        assert!(positions.is_sorted(), "{texts:#?}");
    }

    #[test]
    fn node_of_several_axes_is_configured_once() {
        let node = NodeId::new(5).unwrap();
        let first = AxisConfig::new(NodeAddress { slave: 0, channel: 1, node });
        let second = first.clone().with_node_axis(1, 2);
        let host =
            HostHeartbeat { node: NodeId::new(127).unwrap(), period: Duration::from_millis(50) };
        let bus = BusConfig {
            sync_period_ns: 1_000_000,
            target_period_ns: 1_000_000,
            host: Some(host),
            sync: SyncConfig::default(),
        };
        let steps = steps(&[&first, &second], &bus).unwrap();
        let texts: Vec<String> = steps.iter().map(|step| step.action.to_string()).collect();
        let count = |part: &str| texts.iter().filter(|text| text.contains(part)).count();
        for once in [
            "NMT enter",
            "NMT start",
            "check 0x1000:00",
            "write 0x1017:00",
            "write 0x1016:01",
            "write 0x1006:00",
            "read 0x1016:01",
            "check 0x6502:00",
            "check 0x6D02:00",
            "write 0x6040:00 = 0x0000",
            "write 0x6840:00 = 0x0000",
            "write 0x6807:00 = 0x0003",
            "write 0x1601:01 = 0x68400010",
            "write 0x1601:02 = 0x687A0020",
            "write 0x1A01:02 = 0x68640020",
            "write 0x68C2:01",
            "read 0x685A:00",
        ] {
            assert_eq!(count(once), 1, "{once}: {texts:#?}");
        }
        let off: Vec<_> = [1, 2, 3, 4]
            .into_iter()
            .filter(|nth| !texts.contains(&format!("write 0x{:04X}:00 = 0x02", 0x19FF + nth)))
            .collect();
        assert_eq!(off, [3, 4], "TPDOs that no axis has");
    }

    #[test]
    fn no_host_heartbeat_configures_no_consumer() {
        let node = NodeId::new(5).unwrap();
        let config = AxisConfig::new(NodeAddress { slave: 0, channel: 1, node });
        let bus = BusConfig {
            sync_period_ns: 1_000_000,
            target_period_ns: 1_000_000,
            host: None,
            sync: SyncConfig::default(),
        };
        let steps = steps(&[&config], &bus).unwrap();
        let text: String = steps.iter().map(|step| step.action.to_string()).collect();
        assert!(!text.contains("write 0x1016") && !text.contains("write 0x6007"), "{text}");
        assert!(text.contains("change 0x1802:01"), "the other TPDOs are off");
    }
}
