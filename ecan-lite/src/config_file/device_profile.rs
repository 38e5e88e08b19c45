//! Values of a gateway that `ecan probe` measured, as a file that a configuration includes.

use std::fmt;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use ecan_host::AdapterConfig;
use ecan_mcan_port::{GatewayConfig, MeasuredOn, ScheduleConfig};
use ecan_protocol::config::NodeMode;
use ecan_protocol::text::Printable;
use serde::Serialize;

use super::document::{Document, Includes, Table};
use super::fault::{ConfigFileError, FileFaults};

/// Measured values; `None` for one that no experiment measured.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DeviceProfile {
    /// Serial number.
    pub serial: Option<u64>,
    /// Firmware version: 0xF000:05 and :06.
    pub firmware: Option<(u32, u32)>,
    /// Longest time from an SM2 write to the end of its service, in us.
    pub service_us: Option<u32>,
    /// Longest time of the gateway from an SDO request to its response in OP, in us.
    pub mailbox_us: Option<u32>,
    /// Time from the restart command to the first response, in ms.
    pub restart_ms: Option<u32>,
    /// Scheduled frames that the gateway holds.
    pub schedule_depth: Option<u32>,
    /// Times before and after a Sync0 pulse between which arriving outputs are missed, in us. They arrive the
    /// default time through the host ([`ImageTimes`](ecan_host::ImageTimes)) and their time on the wire
    /// after the send, which is what was measured.
    pub sync0_window_us: Option<(u32, u32)>,
    /// Number of node mode "internal loopback".
    pub internal_loopback: Option<u8>,
    /// Nominal sample point that the firmware chooses from 75 to 87.5 % at 500 kbit/s, in 0.1 %.
    pub sample_point_permille: Option<u32>,
    /// The same by the error counters of two wired channels, in 0.1 %.
    pub wired_sample_point_permille: Option<u32>,
    /// Delay of a CAN transceiver from transmit to receive pin, in ns.
    pub transceiver_ns: Option<u32>,
}

impl DeviceProfile {
    /// The values as a TOML file.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        for (key, value) in self.values() {
            let _ = writeln!(text, "{key} = {value}");
        }
        text
    }

    /// Reads the bytes of a file, which are UTF-8.
    ///
    /// # Errors
    /// Every fault, with line and column.
    pub fn parse(bytes: &[u8]) -> Result<Self, FileFaults> {
        Document::read(bytes, Includes::None, |document, root| {
            Self::read(Table::root(document, root))
        })
    }

    /// Keys and values of what was measured.
    pub(crate) fn values(&self) -> impl Iterator<Item = (&'static str, String)> {
        let number = |value: Option<u32>| value.map(|value| value.to_string());
        let pair =
            |pair: Option<(u32, u32)>| pair.map(|(first, last)| format!("[{first}, {last}]"));
        let values = [
            // TOML has no integer of 64 bits without sign.
            ("serial", self.serial.map(|serial| format!("\"{serial}\""))),
            ("firmware", pair(self.firmware)),
            ("service_us", number(self.service_us)),
            ("mailbox_us", number(self.mailbox_us)),
            ("restart_ms", number(self.restart_ms)),
            ("schedule_depth", number(self.schedule_depth)),
            ("sync0_window_us", pair(self.sync0_window_us)),
            ("internal_loopback", number(self.internal_loopback.map(u32::from))),
            ("sample_point_permille", number(self.sample_point_permille)),
            ("wired_sample_point_permille", number(self.wired_sample_point_permille)),
            ("transceiver_ns", number(self.transceiver_ns)),
        ];
        values.into_iter().filter_map(|(key, value)| Some((key, value?)))
    }

    fn read(mut table: Table<'_, '_>) -> Self {
        const US: (u32, u32) = (0, 1_000_000);
        const PERMILLE: (u32, u32) = (0, 1_000);
        Self {
            serial: read_serial(&mut table),
            firmware: table.pair("firmware", (0, 0xFFFF)),
            service_us: table.unsigned("service_us", US),
            mailbox_us: table.unsigned("mailbox_us", (0, 60_000_000)),
            restart_ms: table.unsigned("restart_ms", (0, 600_000)),
            schedule_depth: table.unsigned("schedule_depth", (1, 0xFFFF)),
            sync0_window_us: table.pair("sync0_window_us", US),
            internal_loopback: table.unsigned("internal_loopback", (1, 3)),
            sample_point_permille: table.unsigned("sample_point_permille", PERMILLE),
            wired_sample_point_permille: table.unsigned("wired_sample_point_permille", PERMILLE),
            transceiver_ns: table.unsigned("transceiver_ns", (0, 10_000)),
        }
    }
}

fn read_serial(table: &mut Table<'_, '_>) -> Option<u64> {
    let text = table.text("serial")?;
    let serial = text.parse().ok();
    if serial.is_none() {
        let allowed = "allowed: an unsigned number of 64 bits in quotation marks";
        table.fault("serial", format!("`serial` = \"{text}\" is invalid; {allowed}"));
    }
    serial
}

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
    super::document::load_by(path, DeviceProfile::parse)
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
