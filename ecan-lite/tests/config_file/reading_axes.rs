//! Reading of the axes of a file, and the locations of their faults.

use std::time::Duration;

use ecan_canopen::{
    FaultReaction, GuardingConfig, HaltOption, NodeAddress, NodeId, NodeLossReaction,
    OperatingMode, QuickStopOption, StopOption,
};
use ecan_cia402::{
    AxisConfig, DriveConfig, FeedForwardLimits, InputObject, MotionLimits, NodeReset, OutputObject,
    PathTolerances, PdoCobIds, PdoConfig, PositionRange, Scale, ScaleSource, VlConfig,
};
use ecan_lite::config::{EXAMPLE, parse, parse_axes};
use ecan_protocol::can::CanId;

const TWO_CHANNELS: &str = "[[gateway]]\nn = 3\ncan0 = { bitrate = 1_000_000 }\n\
                            can1 = { bitrate = 1_000_000 }\n";

#[test]
fn axes_have_their_limits_in_units_of_the_machine() {
    let text = format!(
        "{TWO_CHANNELS}
        [[axis]]
        gateway = 0
        channel = 1
        node = 7
        steps_per_turn = -204_800
        origin_step = -50
        max_velocity_rad_s = 2
        max_acceleration_rad_s2 = 10.5
        max_jerk_rad_s3 = 1e3
        target_step = -5
        min_target = -100
        max_target = 200
        [[axis]]
        gateway = 0
        channel = 0
        node = 7
        mode = \"csv\"
        velocity_units_per_turn_s = 60
        step_limit = 5000
        ramp = 7
        auto_resume = true
        enable_timeout_ms = 100"
    );
    let axes = parse_axes(text.as_bytes()).unwrap_or_else(|faults| panic!("{faults}"));
    let address = |channel| NodeAddress { slave: 0, channel, node: NodeId::new(7).unwrap() };
    let first = AxisConfig {
        scale: Scale::steps_per_turn(-204_800.0).with_origin(-50),
        limits: MotionLimits { velocity: Some(2.0), acceleration: Some(10.5), jerk: Some(1e3) },
        target_step: -5,
        bounds: Some((-100, 200)),
        ..AxisConfig::new(address(1))
    };
    let second = AxisConfig {
        mode: OperatingMode::CyclicVelocity,
        scale: Scale::default().with_velocity_units(60.0),
        ramp: 7,
        auto_resume: true,
        enable_timeout: Duration::from_millis(100),
        ..AxisConfig::new(address(0)).with_step_limit(5_000)
    };
    assert_eq!(axes, [first, second]);
    assert_eq!(
        parse(text.as_bytes()).unwrap(),
        parse(TWO_CHANNELS.as_bytes()).unwrap(),
        "no part of the configuration"
    );
    assert_eq!(parse_axes(TWO_CHANNELS.as_bytes()).unwrap(), []);
    assert_eq!(parse_axes(EXAMPLE.as_bytes()).unwrap().len(), 1);
}

#[test]
fn axes_have_the_stop_options_of_their_drives() {
    let axis = "[[axis]]\ngateway = 0\nchannel = 0\nnode = 7\n";
    let text = format!(
        "{TWO_CHANNELS}{axis}
        host_heartbeat_ms = 100
        host_loss = \"fault\"
        quick_stop = \"slow_down_and_stay\"
        shutdown = \"slow_down\"
        disable_operation = \"disable\"
        halt = \"quick_stop\"
        fault_reaction = \"current_limit\""
    );
    let drive = |text: &str| parse_axes(text.as_bytes()).unwrap().remove(0).drive;
    let expected = DriveConfig {
        host_heartbeat_ms: 100,
        host_loss: Some(NodeLossReaction::Fault),
        quick_stop: Some(QuickStopOption::SlowDownAndStay),
        shutdown: Some(StopOption::SlowDown),
        disable_operation: Some(StopOption::Disable),
        halt: Some(HaltOption::QuickStop),
        fault_reaction: Some(FaultReaction::CurrentLimit),
        ..DriveConfig::default()
    };
    assert_eq!(drive(&text), expected);
    assert_eq!(drive(EXAMPLE), DriveConfig::default(), "the example has the defaults");
    let unchanged = format!("{TWO_CHANNELS}{axis}host_loss = \"unchanged\"");
    assert_eq!(drive(&unchanged), DriveConfig { host_loss: None, ..DriveConfig::default() });
    let wrong = format!("{TWO_CHANNELS}{axis}halt = \"disable\"");
    let faults = parse_axes(wrong.as_bytes()).unwrap_err().to_string();
    assert!(faults.contains("`halt` = \"disable\" is invalid; allowed: \"unchanged\""), "{faults}");
}

#[test]
fn faults_of_axes_have_a_location() {
    let text = format!(
        "{TWO_CHANNELS}[[axis]]
gateway = 1
channel = 0
node = 128
[[axis]]
gateway = 1
channel = 0
node = 1
max_velocity_rad_s = -1
max_acceleration_rad_s2 = nan
max_jerk_rad_s3 = \"high\"
[[axis]]
gateway = 0
channel = 3
node = 1
mode = \"csv\"
max_velocity_rad_s = 1.5
min_target = 5
max_target = 10
[[axis]]
gateway = 0
channel = 1
node = 1
mode = \"pp\"
max_jerk_rad_s3 = 2.5
min_target = 5
[[axis]]
gateway = 0
channel = 1
node = 1
target_step = 3_000_000_000
[[axis]]
channel = 0
"
    );
    let faults = parse_axes(text.as_bytes()).unwrap_err().0;
    let found: Vec<_> =
        faults.iter().map(|fault| (fault.line, fault.column, fault.reason.as_str())).collect();
    let expected = [
        (8, 8, "`node` = 128 is out of range; allowed: 1 to 127"),
        (10, 11, "axis 1: gateway 1 is not in the file"),
        (13, 22, "axis 1: the velocity limit -1 rad/s is invalid; must be finite and above 0"),
        (
            14,
            27,
            "axis 1: the acceleration limit NaN rad/s^2 is invalid; must be finite and above 0",
        ),
        (15, 19, "`max_jerk_rad_s3` must be a number, not a string"),
        (18, 11, "axis 2: channel 3 of gateway 0 is not enabled; add its table can3"),
        (
            21,
            22,
            "axis 2: the velocity limit cannot be kept in mode CSV: the unit of the drive's velocity \
             is unknown; set the velocity units of its scale",
        ),
        (
            22,
            14,
            "axis 2: the bounds 5..10 exclude 0, so that the axis could not stop; must include 0",
        ),
        (
            29,
            19,
            "axis 3: the jerk limit cannot be kept in mode PP; set it by the objects of the drive",
        ),
        (30, 14, "`min_target` needs `max_target`"),
        (
            34,
            8,
            "axis 4: node 1 (slave 0, channel 1) is the drive of axis 3 already; set another node_axis",
        ),
        (35, 15, "`target_step` = 3000000000 is out of range; allowed: -2147483648 to 2147483647"),
        (36, 1, "`gateway` is missing: the index of its gateway in the file"),
        (36, 1, "`node` is missing: the node-ID of the drive, 1 to 127"),
    ];
    assert_eq!(found, expected, "{found:#?}");
}

#[test]
fn axes_have_their_process_data_and_drives() {
    let text = format!(
        "{TWO_CHANNELS}[[axis]]
        gateway = 0
        channel = 1
        node = 7
        scale_source = \"checked\"
        position_range = \"modulo\"
        position_min = -100
        position_max = 99
        tpdo_timeout = 7
        wc_misses = 2
        drain_images = 4
        pdo_number = 2
        inputs = [\"velocity\", \"probe_status\", \"digital_inputs\"]
        outputs = [\"torque_offset\", \"probe_function\", \"mode\"]
        feed_forward = {{ torque = 300, torque_change = 50, velocity = 9, velocity_change = 2 }}
        reset = \"node\"
        boot_timeout_ms = 900
        heartbeat_ms = 0
        guard_time_ms = 80
        life_time_factor = 4
        check_profile = false
        following_error = [20_000, 50]
        output_mask = 0x0003_0000
        interpolation_buffer = 8
        torque_slope = 1000
        vl = {{ limits = [10, 3000], acceleration = [1000, 1], deceleration = [2000, 3] }}
        write_position_limits = true
        max_torque = 900
        max_motor_speed = 2800
        use_limits = true
        silence_other_tpdos = false"
    );
    let axes = parse_axes(text.as_bytes()).unwrap_or_else(|faults| panic!("{faults}"));
    let node = NodeId::new(7).unwrap();
    let guarding = GuardingConfig { guard_time: Duration::from_millis(80), life_time_factor: 4 };
    let expected = AxisConfig {
        scale_source: ScaleSource::Checked,
        range: PositionRange::Modulo { min: -100, max: 99 },
        tolerances: PathTolerances { tpdo_timeout: 7, wc_misses: 2, drain_images: 4 },
        pdos: PdoConfig {
            number: 2,
            inputs: vec![
                InputObject::Velocity,
                InputObject::ProbeStatus,
                InputObject::DigitalInputs,
            ],
            outputs: vec![
                OutputObject::TorqueOffset,
                OutputObject::ProbeFunction,
                OutputObject::Mode,
            ],
            ..PdoConfig::default()
        },
        feed_forward: FeedForwardLimits {
            velocity: 9,
            velocity_change: 2,
            torque: 300,
            torque_change: 50,
        },
        drive: DriveConfig {
            reset: NodeReset::Node,
            boot_timeout: Duration::from_millis(900),
            heartbeat_ms: 0,
            guarding: Some(guarding),
            expect_profile_402: false,
            following_error: Some((20_000, 50)),
            output_mask: Some(0x0003_0000),
            interpolation_buffer: Some(8),
            torque_slope: Some(1000),
            vl: VlConfig {
                limits: Some((10, 3000)),
                acceleration: Some((1000, 1)),
                deceleration: Some((2000, 3)),
            },
            write_position_limits: true,
            max_torque: Some(900),
            max_motor_speed: Some(2800),
            use_limits: true,
            silence_other_tpdos: false,
            ..DriveConfig::default()
        },
        ..AxisConfig::new(NodeAddress { slave: 0, channel: 1, node })
    };
    assert_eq!(axes, [expected]);
}

#[test]
fn faults_of_process_data_and_drives_have_a_location() {
    let text = format!(
        "{TWO_CHANNELS}[[axis]]
gateway = 0
channel = 1
node = 7
position_range = \"modulo\"
inputs = [\"velocity\", \"torque\", \"velocity\"]
outputs = [\"velocity_offset\"]
following_error = [1, 70_000]
guard_time_ms = 50
heartbeat_ms = 50
[[axis]]
gateway = 0
channel = 1
node = 8
mode = \"pv\"
position_max = 5
outputs = [\"torque_offset\", \"colour\"]
[[axis]]
gateway = 0
channel = 1
node = 9
scale_source = \"drive\"
max_velocity_rad_s = 1
outputs = [\"probe_function\"]
[[node]]
gateway = 0
channel = 0
node = 9
[node.axis]
heartbeat_ms = 10
"
    );
    let faults = parse_axes(text.as_bytes()).unwrap_err().0;
    let found: Vec<_> = faults.iter().map(|fault| (fault.line, fault.reason.as_str())).collect();
    let has = |line: usize, part: &str| {
        assert!(
            found.iter().any(|(at, reason)| *at == line && reason.contains(part)),
            "line {line}: {part}: {found:#?}"
        );
    };
    has(9, "needs `position_min` and `position_max`");
    has(10, "`inputs` has \"velocity\" twice");
    has(11, "the limits of velocity offset 0x60B1 are 0");
    has(12, "the time is out of range; allowed: 0 to 65535 ms");
    has(13, "exclude each other");
    has(20, "`position_max` needs `position_range` = \"modulo\"");
    has(21, "\"colour\" is invalid; allowed: \"velocity_offset\", \"torque_offset\"");
    has(26, "need a configured scale");
    has(28, "touch probe function 0x60B8 is mapped without the status");
    has(34, "unknown key `heartbeat_ms`");
}

#[test]
fn axes_of_a_drive_have_their_own_pdos() {
    let axis = "[[axis]]\ngateway = 0\nchannel = 1\nnode = 7\n";
    let text = format!(
        "{TWO_CHANNELS}{axis}{axis}node_axis = 1\npdo_number = 65\ninputs = [\"velocity\", \"torque\"]\n\
         rpdo_cob_ids = [0x301]\ntpdo_cob_ids = [0x281, 0x381]\n"
    );
    let axes = parse_axes(text.as_bytes()).unwrap_or_else(|faults| panic!("{faults}"));
    let first =
        AxisConfig::new(NodeAddress { slave: 0, channel: 1, node: NodeId::new(7).unwrap() });
    let id = |raw| CanId::standard(raw).unwrap();
    let mut second = first.clone().with_node_axis(1, 65);
    second.pdos.inputs = vec![InputObject::Velocity, InputObject::Torque];
    second.pdos.cob_ids = PdoCobIds { rpdos: vec![id(0x301)], tpdos: vec![id(0x281), id(0x381)] };
    assert_eq!(axes, [first, second]);
}

#[test]
fn axes_of_a_drive_that_do_not_fit_together_are_reported() {
    let axis = "[[axis]]\ngateway = 0\nchannel = 1\nnode = 7\n";
    let fault = |keys: &str| {
        let text = format!("{TWO_CHANNELS}{axis}{axis}{keys}");
        let faults = parse_axes(text.as_bytes()).unwrap_err().0;
        assert_eq!(faults.len(), 1, "{keys}: {faults:?}");
        (faults[0].line - 12, faults[0].reason.clone())
    };
    let has = |keys: &str, line: usize, part: &str| {
        let (at, reason) = fault(keys);
        assert!(at == line && reason.contains(part), "line {at}: {reason}");
    };
    has("node_axis = 8", 1, "`node_axis` = 8 is out of range; allowed: 0 to 7");
    has("node_axis = 0", 1, "is the drive of axis 0 already; set another node_axis");
    has("node_axis = 1", 0, "axis 1: COB-ID 0x207 is that of a PDO of axis 0 already");
    has("node_axis = 1\npdo_number = 5", 2, "PDO number 5 is out of range; allowed: 1 to 4");
    let ids = "rpdo_cob_ids = [0x301]\ntpdo_cob_ids = [0x281]\n";
    let second = format!("node_axis = 1\n{ids}");
    has(&format!("{second}pdo_number = 1"), 4, "PDO 1 is one of axis 0 of the same node already");
    has(&format!("{second}pdo_number = 513"), 4, "out of range; allowed: 1 to 512");
    let second = format!("pdo_number = 65\n{second}");
    has(&second.replace("0x301", "0x581"), 3, "COB-ID 0x581 is out of range for a PDO");
    has(&second.replace("0x281", "0x281, 0x282"), 4, "2 COB-IDs are given for 1 PDOs");
    has(&second.replace("0x281", "0x187"), 4, "COB-ID 0x187 is that of a PDO of axis 0 already");
    has(&second.replace("0x281", "-1"), 4, "`tpdo_cob_ids` must be an array of integers");
    has(&format!("{second}heartbeat_ms = 20"), 0, "differ from those of axis 0");
}
