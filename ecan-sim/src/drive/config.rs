//! Configuration of a simulated drive: motor, quirks, and rules for SDO transfers.

use ecan_canopen::NodeId;
use ecan_protocol::object::AbortCode;
use serde::Deserialize;

/// A simulated drive. Plain data; all defaults except the node-ID are those of a well-behaved servo
/// drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveConfig {
    /// Node-ID.
    pub node: NodeId,
    /// Number of axes, 1 to 8: the objects of axis n are at 0x6000 + 0x800 n, its PDOs begin at number
    /// 64 n + 1. A drive from a device file has as many as the file has controlwords and statuswords.
    pub axes: u8,
    /// Serial number (0x1018:04).
    pub serial: u32,
    /// Time from supply or NMT reset node to the boot-up message, ms.
    pub boot_ms: u32,
    /// Delay of an SDO response, us.
    pub sdo_delay_us: u32,
    /// Time from the enable command to Operation enabled, ms; a brake needs it.
    pub enable_ms: u32,
    /// Number of targets in the history.
    pub history: usize,
    /// Number of events in the trace; 0 records nothing.
    pub trace: usize,
    /// The motor and its load.
    pub motor: MotorConfig,
    /// Deviations from a well-behaved drive.
    pub quirks: DriveQuirks,
}

impl DriveConfig {
    /// A drive with this node-ID.
    #[must_use]
    pub fn new(node: NodeId) -> Self {
        Self {
            node,
            axes: 1,
            serial: 1,
            boot_ms: 40,
            sdo_delay_us: 200,
            enable_ms: 0,
            history: 1024,
            trace: 0,
            motor: MotorConfig::default(),
            quirks: DriveQuirks::default(),
        }
    }
}

/// The motor, its encoder and its load. Positions are increments of the encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MotorConfig {
    /// Increments per revolution (0x608F); there is one index pulse per revolution.
    pub increments_per_revolution: u32,
    /// Maximum velocity in increments per second.
    pub max_velocity: u32,
    /// Acceleration at maximum torque, in increments per second squared.
    pub max_acceleration: u32,
    /// Maximum torque in thousandths of the rated torque.
    pub max_torque: u16,
    /// Deceleration by friction in increments per second squared: stops a motor without current and
    /// must be overcome by torque.
    pub friction: u32,
    /// Gain of the position controller in 1/s.
    pub position_gain: u16,
    /// Velocity feed-forward in thousandths. The missing part causes a following error.
    pub feed_forward: u16,
    /// Controller period in microseconds, at least 1.
    pub period_us: u32,
    /// Motor position at the start of the simulation.
    pub start_position: i32,
    /// True if the encoder keeps its position after a loss of supply; otherwise it starts at 0.
    pub absolute_encoder: bool,
    /// Mechanical positions of the negative limit switch, active there and below, and of the
    /// positive one, active there and above. Only homing stops at them; otherwise they are only
    /// visible in 0x60FD.
    pub limit_switches: (i32, i32),
    /// Mechanical position at and above which the home switch is active.
    pub home_switch: i32,
    /// Mechanical positions at and above which the inputs of the touch probes are active.
    pub probes: [i32; 2],
}

impl Default for MotorConfig {
    /// 65536 increments per revolution, 6000 revolutions per minute.
    fn default() -> Self {
        Self {
            increments_per_revolution: 65_536,
            max_velocity: 6_553_600,
            max_acceleration: 200_000_000,
            max_torque: 3_000,
            friction: 5_000_000,
            position_gain: 200,
            feed_forward: 980,
            period_us: 1_000,
            start_position: 0,
            absolute_encoder: true,
            limit_switches: (-500_000, 500_000),
            home_switch: 100_000,
            probes: [50_000, 150_000],
        }
    }
}

impl MotorConfig {
    /// Checks the values of a file; the error is a text.
    pub(crate) fn check(&self) -> Result<(), String> {
        let above_zero = [
            ("increments_per_revolution", self.increments_per_revolution),
            ("max_velocity", self.max_velocity),
            ("max_acceleration", self.max_acceleration),
            ("max_torque", u32::from(self.max_torque)),
            ("period_us", self.period_us),
        ];
        if let Some((key, _)) = above_zero.iter().find(|(_, value)| *value == 0) {
            return Err(format!("`{key}` = 0 is out of range; must be above 0"));
        }
        if self.limit_switches.0 >= self.limit_switches.1 {
            return Err("the negative limit switch must be below the positive one".to_owned());
        }
        Ok(())
    }
}

/// Transfer direction of a rule.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SdoDirection {
    /// Uploads.
    Read,
    /// Downloads.
    Write,
    /// Both.
    #[default]
    Both,
}

/// Effect of an [`SdoRule`] on a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SdoEffect {
    /// The transfer is aborted with this code.
    Abort(AbortCode),
    /// The request gets no response.
    Silence,
}

/// An object whose transfers fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "RawSdoRule")]
pub struct SdoRule {
    /// Index.
    pub index: u16,
    /// Subindex; `None` is any.
    pub subindex: Option<u8>,
    /// Affected transfers.
    pub direction: SdoDirection,
    /// Effect.
    pub effect: SdoEffect,
    /// Number of affected transfers; `None` is all.
    pub times: Option<u32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawSdoRule {
    index: u16,
    subindex: Option<u8>,
    #[serde(default)]
    direction: SdoDirection,
    code: Option<u32>,
    #[serde(default)]
    silent: bool,
    times: Option<u32>,
}

impl TryFrom<RawSdoRule> for SdoRule {
    type Error = &'static str;

    fn try_from(raw: RawSdoRule) -> Result<Self, Self::Error> {
        let effect = match (raw.code, raw.silent) {
            (Some(code), false) => SdoEffect::Abort(AbortCode(code)),
            (None, true) => SdoEffect::Silence,
            _ => return Err("an `sdo` quirk needs either `code` or `silent = true`"),
        };
        Ok(Self {
            index: raw.index,
            subindex: raw.subindex,
            direction: raw.direction,
            effect,
            times: raw.times,
        })
    }
}

/// Deviations of a drive from a well-behaved one.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DriveQuirks {
    /// Mapping objects are locked while the PDO is valid, as CiA 301 specifies. Some drives allow a
    /// change when the number of entries is 0. Default `true`.
    pub rejects_mapping_while_valid: bool,
    /// The mapping is fixed: every write to a mapping object is aborted.
    pub fixed_mapping: bool,
    /// Operation enabled is not entered while no mode is selected.
    pub needs_mode: bool,
    /// Modes (0x6060) that are accepted but never become active: 0x6061 does not follow.
    pub ignored_modes: Vec<i8>,
    /// Delay from a new mode in 0x6060 to 0x6061, ms.
    pub mode_delay_ms: u32,
    /// The boot-up message is never sent.
    pub never_boots: bool,
    /// Faults cannot be reset.
    pub stuck_in_fault: bool,
    /// The quick stop command has no effect.
    pub ignores_quick_stop: bool,
    /// Acknowledges frames, but sends none.
    pub silent: bool,
    /// Block transfers are aborted.
    pub no_block_transfer: bool,
    /// A block upload is answered as a segmented one, as the protocol allows.
    pub block_upload_falls_back: bool,
    /// When enabled, the drive moves to the value of 0x607A instead of waiting for a target.
    pub follows_old_target: bool,
    /// The drive has no node-ID until LSS configures one (CiA 305).
    pub without_node_id: bool,
    /// LSS is not supported.
    pub no_lss: bool,
    /// LSS cannot store node-ID and bit rate: they are lost at a reset.
    pub no_lss_store: bool,
    /// Objects that the drive lacks, for example 0x1016; without 0x1016 and 0x1017 it supports guarding only,
    /// without 0x100C no guarding.
    pub missing: Vec<u16>,
    /// Objects whose transfers fail.
    #[serde(rename = "sdo")]
    pub sdo_rules: Vec<SdoRule>,
}

impl Default for DriveQuirks {
    fn default() -> Self {
        Self {
            rejects_mapping_while_valid: true,
            fixed_mapping: false,
            needs_mode: false,
            ignored_modes: Vec::new(),
            mode_delay_ms: 0,
            never_boots: false,
            stuck_in_fault: false,
            ignores_quick_stop: false,
            silent: false,
            no_block_transfer: false,
            block_upload_falls_back: false,
            follows_old_target: false,
            without_node_id: false,
            no_lss: false,
            no_lss_store: false,
            missing: Vec::new(),
            sdo_rules: Vec::new(),
        }
    }
}
