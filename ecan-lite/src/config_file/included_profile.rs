//! The device profile that a gateway of a file includes, and its effect on the settings.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use ecan_host::AdapterConfig;
use ecan_mcan_port::{GatewayConfig, MeasuredOn, ScheduleConfig};
use ecan_protocol::config::NodeMode;
use ecan_protocol::text::Printable;

use crate::config_file::device_profile::DeviceProfile;
use crate::config_file::document::{Includes, Table};
use crate::config_file::fault::ConfigFileError;

/// Key of the path in the table of a gateway.
const KEY: &str = "device_profile";

/// A device profile of a configuration file, and what each value sets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IncludedProfile {
    /// Index of the gateway in the file.
    pub gateway: usize,
    /// The file with the values.
    pub path: PathBuf,
    /// The values.
    pub profile: DeviceProfile,
    /// Effect of each value, in the order of the file.
    pub effects: Vec<ProfileEffect>,
}

/// Effect of a value of a device profile.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProfileEffect {
    /// Key of the profile.
    pub key: &'static str,
    /// Its value.
    pub value: String,
    /// The setting with its value, or the reason why there is none.
    pub effect: String,
}

impl fmt::Display for ProfileEffect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} = {}: {}", self.key, self.value, self.effect)
    }
}

/// Reads the path and the file. A fault of the file is one of the key.
pub(crate) fn read(table: &mut Table<'_, '_>, gateway: usize) -> Option<IncludedProfile> {
    let name = table.text(KEY)?;
    let (path, profile) = match table.includes() {
        Includes::None => {
            table.fault(
                KEY,
                "`device_profile` is relative to the configuration file: load the configuration from a \
                 file, or copy the values to `[gateway.schedule]`",
            );
            return None;
        }
        Includes::Directory(base) => (base.join(name), load(&base.join(name))),
        Includes::Texts(texts) => (name.into(), of_text(name, texts.get(name))),
    };
    match profile {
        Ok(profile) => Some(IncludedProfile { gateway, path, profile, effects: Vec::new() }),
        Err(ConfigFileError::Faults { path, faults }) => {
            for fault in faults.0 {
                table
                    .fault(KEY, format!("`device_profile` {}: {fault}", Printable(path.display())));
            }
            None
        }
        Err(error) => {
            table.fault(KEY, format!("`device_profile`: {error}"));
            None
        }
    }
}

fn load(path: &Path) -> Result<DeviceProfile, ConfigFileError> {
    crate::config_file::load_by(path, DeviceProfile::parse)
}

fn of_text(name: &str, text: Option<&String>) -> Result<DeviceProfile, ConfigFileError> {
    let reason = || std::io::Error::new(std::io::ErrorKind::NotFound, "it was not passed");
    let text = text.ok_or_else(|| ConfigFileError::Read { path: name.into(), reason: reason() })?;
    DeviceProfile::parse(text.as_bytes())
        .map_err(|faults| ConfigFileError::Faults { path: name.into(), faults })
}

impl IncludedProfile {
    /// Time of the firmware for an image, in ns: the longest that was measured. An assumed one is not
    /// shortened by one measurement alone, nor by a window in which no image was missed.
    pub(crate) fn processing_ns(&self, transport_ns: u32) -> Option<u32> {
        let DeviceProfile { service_us, sync0_window_us, .. } = self.profile;
        let assumed = ScheduleConfig::default();
        let service = service_us.map(|us| us.saturating_mul(1_000));
        // The window was measured from the send on, with the default time through the host.
        let window = sync0_window_us.filter(|(before, _)| *before > 0).map(|(before, _)| {
            let measured = before.saturating_mul(1_000).saturating_add(assumed.transport_ns);
            measured.saturating_sub(transport_ns)
        });
        match (service, window) {
            (Some(service), Some(window)) => Some(service.max(window)),
            (Some(one), None) | (None, Some(one)) => Some(one.max(assumed.processing_ns)),
            (None, None) => None,
        }
    }

    /// The settings by the measured values, to which the keys of the file are applied.
    pub(crate) fn apply(&self, gateway: &mut GatewayConfig) {
        let DeviceProfile { serial, firmware, schedule_depth, .. } = self.profile;
        if let Some(depth) = schedule_depth {
            gateway.schedule.depth = u16::try_from(depth).unwrap_or(u16::MAX);
        }
        gateway.measured_on = Some(MeasuredOn { serial, firmware });
    }

    /// Prolongs the wait for slaves to twice the measured restart.
    pub(crate) fn apply_restart(&self, adapter: &mut AdapterConfig) {
        let restart = self.profile.restart_ms.map(|ms| Duration::from_millis(ms.into()) * 2);
        adapter.preop_timeout = adapter.preop_timeout.max(restart.unwrap_or_default());
    }

    /// The channels that request a node mode whose number is another one on this gateway, and this mode.
    pub(crate) fn misnumbered(
        &self,
        gateway: &GatewayConfig,
    ) -> impl Iterator<Item = (usize, NodeMode)> {
        let expected = NodeMode::InternalLoopback as u8;
        let differs = self.profile.internal_loopback.is_some_and(|number| number != expected);
        let channels = gateway.channels.into_iter().enumerate();
        channels.filter_map(move |(channel, settings)| {
            let mode = settings?.can.node_mode;
            (differs && mode != NodeMode::Normal).then_some((channel, mode))
        })
    }

    /// Notes what each value sets, after the keys of the file were read.
    pub(crate) fn note_effects(
        &mut self,
        adapter: &AdapterConfig,
        gateway: &GatewayConfig,
        has: impl Fn(&str) -> bool,
    ) {
        let schedule = gateway.schedule;
        let set = |key: &str, value: f64| match has(key) {
            true => format!("overridden by {key} = {value}"),
            false => format!("{key} = {value}"),
        };
        let effect = |key| match key {
            "serial" | "firmware" => "a warning at start if the gateway has another".to_owned(),
            "service_us" | "sync0_window_us" => {
                set("schedule.processing_us", f64::from(schedule.processing_ns) / 1e3)
            }
            "restart_ms" => set("preop_timeout_ms", adapter.preop_timeout.as_millis() as f64),
            "schedule_depth" => set("schedule.depth", schedule.depth.into()),
            "internal_loopback" => "checked against node_mode".to_owned(),
            "mailbox_us" => "sets nothing: measured at each start".to_owned(),
            "sample_point_permille" | "wired_sample_point_permille" => {
                "sets nothing: one sample point is requested".to_owned()
            }
            _ => "sets nothing".to_owned(),
        };
        let values = self.profile.values();
        self.effects =
            values.map(|(key, value)| ProfileEffect { key, value, effect: effect(key) }).collect();
    }
}
