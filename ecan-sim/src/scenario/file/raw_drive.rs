//! Drives in a scenario file.

use ecan_protocol::object::AbortCode;
use serde::Deserialize;

use crate::drive::{DriveQuirks, MotorConfig, SdoDirection, SdoEffect, SdoRule};
use crate::scenario::file::set;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawMotor {
    increments_per_revolution: Option<u32>,
    max_velocity: Option<u32>,
    max_acceleration: Option<u32>,
    max_torque: Option<u16>,
    friction: Option<u32>,
    position_gain: Option<u16>,
    feed_forward: Option<u16>,
    period_us: Option<u32>,
    start_position: Option<i32>,
    absolute_encoder: Option<bool>,
    limit_switches: Option<(i32, i32)>,
    home_switch: Option<i32>,
}

impl RawMotor {
    pub(super) fn build(self) -> Result<MotorConfig, String> {
        let mut motor = MotorConfig::default();
        set(&mut motor.increments_per_revolution, self.increments_per_revolution);
        set(&mut motor.max_velocity, self.max_velocity);
        set(&mut motor.max_acceleration, self.max_acceleration);
        set(&mut motor.max_torque, self.max_torque);
        set(&mut motor.friction, self.friction);
        set(&mut motor.position_gain, self.position_gain);
        set(&mut motor.feed_forward, self.feed_forward);
        set(&mut motor.period_us, self.period_us);
        set(&mut motor.start_position, self.start_position);
        set(&mut motor.absolute_encoder, self.absolute_encoder);
        set(&mut motor.limit_switches, self.limit_switches);
        set(&mut motor.home_switch, self.home_switch);
        let above_zero = [
            ("increments_per_revolution", motor.increments_per_revolution),
            ("max_velocity", motor.max_velocity),
            ("max_acceleration", motor.max_acceleration),
            ("max_torque", u32::from(motor.max_torque)),
            ("period_us", motor.period_us),
        ];
        if let Some((key, _)) = above_zero.iter().find(|(_, value)| *value == 0) {
            return Err(format!("`{key}` = 0 is out of range; must be above 0"));
        }
        if motor.limit_switches.0 >= motor.limit_switches.1 {
            return Err("the negative limit switch must be below the positive one".to_owned());
        }
        Ok(motor)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawQuirks {
    refuses_mapping_while_valid: Option<bool>,
    fixed_mapping: Option<bool>,
    needs_mode: Option<bool>,
    ignored_modes: Option<Vec<i8>>,
    mode_delay_ms: Option<u32>,
    never_boots: Option<bool>,
    stuck_in_fault: Option<bool>,
    silent: Option<bool>,
    no_block_transfer: Option<bool>,
    block_upload_falls_back: Option<bool>,
    follows_old_target: Option<bool>,
    missing: Option<Vec<u16>>,
    #[serde(default)]
    sdo: Vec<RawSdoRule>,
}

impl RawQuirks {
    pub(super) fn build(self) -> Result<DriveQuirks, String> {
        let mut quirks = DriveQuirks::default();
        set(&mut quirks.refuses_mapping_while_valid, self.refuses_mapping_while_valid);
        set(&mut quirks.fixed_mapping, self.fixed_mapping);
        set(&mut quirks.needs_mode, self.needs_mode);
        set(&mut quirks.ignored_modes, self.ignored_modes);
        set(&mut quirks.mode_delay_ms, self.mode_delay_ms);
        set(&mut quirks.never_boots, self.never_boots);
        set(&mut quirks.stuck_in_fault, self.stuck_in_fault);
        set(&mut quirks.silent, self.silent);
        set(&mut quirks.no_block_transfer, self.no_block_transfer);
        set(&mut quirks.block_upload_falls_back, self.block_upload_falls_back);
        set(&mut quirks.follows_old_target, self.follows_old_target);
        set(&mut quirks.missing, self.missing);
        quirks.sdo_rules =
            self.sdo.into_iter().map(RawSdoRule::build).collect::<Result<_, String>>()?;
        Ok(quirks)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawSdoRule {
    index: u16,
    subindex: Option<u8>,
    direction: Option<RawDirection>,
    code: Option<u32>,
    #[serde(default)]
    silent: bool,
    times: Option<u32>,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "lowercase")]
enum RawDirection {
    Read,
    Write,
    Both,
}

impl RawSdoRule {
    fn build(self) -> Result<SdoRule, String> {
        let effect = match (self.code, self.silent) {
            (Some(code), false) => SdoEffect::Abort(AbortCode(code)),
            (None, true) => SdoEffect::Silence,
            _ => return Err("an `sdo` quirk needs either `code` or `silent = true`".to_owned()),
        };
        Ok(SdoRule {
            index: self.index,
            subindex: self.subindex,
            direction: match self.direction {
                Some(RawDirection::Read) => SdoDirection::Read,
                Some(RawDirection::Write) => SdoDirection::Write,
                Some(RawDirection::Both) | None => SdoDirection::Both,
            },
            effect,
            times: self.times,
        })
    }
}
