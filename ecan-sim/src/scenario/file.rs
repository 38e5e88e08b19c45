//! Scenario files in TOML; every error has its line.
//!
//! The tables are read flat and then checked key by key, so that a key that does not belong to the
//! kind of a node or fault is rejected as clearly as an unknown one.

mod raw_node;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use ecan_protocol::device::AlStatusCode;
use ecan_protocol::text::Printable;
use serde::Deserialize;
use toml::Spanned;

use crate::fault::{FaultDescription, FaultError, ScriptedFault};
use crate::gateway::Sync0Window;
use crate::random::WakeUpDelay;
use crate::scenario::file::raw_node::{RawNode, set};
use crate::scenario::{ClockKind, EcrtVersion, GatewaySpec, MasterBehaviour, Scenario, Topology};
use raw_node::RawIo;
use raw_node::check_transceiver;

/// Error in a scenario file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}{}", line.map_or_else(String::new, |line| format!("line {line}: ")), Printable(reason))]
pub struct ScenarioError {
    /// Line, from 1; `None` if the error concerns the whole file.
    pub line: Option<usize>,
    /// Error text.
    pub reason: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawScenario {
    name: Option<String>,
    seed: Option<u64>,
    clock: Option<ClockKind>,
    wake_up_us: Option<Spanned<RawWakeUp>>,
    version: Option<EcrtVersion>,
    #[serde(default)]
    master: MasterBehaviour,
    #[serde(default)]
    carries_large_pdos: bool,
    #[serde(default)]
    reserved: bool,
    topology: Option<Topology>,
    #[serde(default)]
    gateway: Vec<Spanned<RawGateway>>,
    #[serde(default)]
    io: Vec<Spanned<RawIo>>,
    #[serde(default)]
    node: Vec<Spanned<RawNode>>,
    #[serde(default)]
    fault: Vec<Spanned<FaultDescription>>,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(deny_unknown_fields)]
struct RawWakeUp {
    typical: u32,
    p99: u32,
    longest: u32,
}

impl RawWakeUp {
    fn build(self) -> Result<WakeUpDelay, String> {
        if self.typical > self.p99 || self.p99 > self.longest {
            return Err("`wake_up_us` needs typical <= p99 <= longest".to_owned());
        }
        let ns = |us: u32| u64::from(us) * 1_000;
        Ok(WakeUpDelay {
            typical_ns: ns(self.typical),
            p99_ns: ns(self.p99),
            longest_ns: ns(self.longest),
        })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawGateway {
    alias: Option<u16>,
    serial: Option<u64>,
    hardware_revision: Option<u32>,
    firmware: Option<(u16, u16)>,
    vendor_id: Option<u32>,
    product_code: Option<u32>,
    revision: Option<u32>,
    boot_ms: Option<u32>,
    reboot_delay_ms: Option<u32>,
    service_delay_us: Option<u32>,
    service_jitter_us: Option<u32>,
    clock_drift_ppm: Option<f64>,
    release_jitter_us: Option<u32>,
    mailbox_delay_us: Option<u32>,
    transceiver_ns: Option<u32>,
    pdo_assign: Option<bool>,
    pdo_configuration: Option<bool>,
    sii_pdos: Option<bool>,
    sii_sm2: Option<RawSyncManager>,
    sii_sm3: Option<RawSyncManager>,
    tx_pressure_percent: Option<u8>,
    complete_access: Option<bool>,
    publishes_after_read: Option<bool>,
    sync0_window: Option<RawSync0Window>,
    buses: Option<Vec<String>>,
    #[serde(default)]
    variant: BTreeMap<Spanned<String>, toml::Value>,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(deny_unknown_fields)]
struct RawSyncManager {
    start: Option<u16>,
    size: Option<u16>,
    control: Option<u8>,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(deny_unknown_fields)]
struct RawSync0Window {
    before_us: Option<u32>,
    after_us: Option<u32>,
    missed_limit: Option<u32>,
    al_status: Option<u16>,
}

impl RawSync0Window {
    fn build(self) -> Result<Sync0Window, String> {
        let mut window = Sync0Window::default();
        for (target, name, us) in [
            (&mut window.before_ns, "before_us", self.before_us),
            (&mut window.after_ns, "after_us", self.after_us),
        ] {
            let Some(us) = us else { continue };
            *target = us.checked_mul(1_000).ok_or_else(|| {
                format!("`{name}` is out of range; allowed: 0 to {}", u32::MAX / 1_000)
            })?;
        }
        set!(window from self: missed_limit);
        if let Some(code) = self.al_status {
            window.al_status = AlStatusCode(code);
            if ![AlStatusCode::SYNC_ERROR, AlStatusCode::FATAL_SYNC].contains(&window.al_status) {
                return Err("`al_status` is out of range; allowed: 0x1A, 0x2C".to_owned());
            }
        }
        Ok(window)
    }
}

/// Text of the file, to find the lines of errors.
struct Source<'a> {
    text: &'a str,
}

impl Source<'_> {
    fn error(&self, span: Option<Range<usize>>, reason: impl Into<String>) -> ScenarioError {
        let line = span.map(|span| {
            let before = self.text.as_bytes().iter().take(span.start);
            1 + before.filter(|byte| **byte == b'\n').count()
        });
        ScenarioError { line, reason: reason.into() }
    }

    /// Builds a table of the file; an error has the line at which it begins.
    fn build<T, R>(
        &self,
        raw: Spanned<T>,
        build: impl FnOnce(T) -> Result<R, String>,
    ) -> Result<R, ScenarioError> {
        let span = raw.span();
        build(raw.into_inner()).map_err(|reason| self.error(Some(span), reason))
    }
}

impl Scenario {
    /// Reads a scenario from the text of a file. `name` is the default of the scenario's name;
    /// paths are relative to `directory`.
    ///
    /// docs/SIMULATION.md of the repository lists the keys and the kinds of faults. The defaults are
    /// those of [`Scenario::default`] and [`GatewaySpec::at`].
    ///
    /// ```
    /// let text = r#"
    ///     [[gateway]]
    ///     alias = 3
    ///
    ///     [[node]]
    ///     kind = "drive"
    ///     bus = "0.2"
    ///     node_id = 5
    ///
    ///     [[fault]]
    ///     at_ms = 2500
    ///     kind = "power_cycle"
    ///     gateway = 0
    /// "#;
    /// let scenario = ecan_sim::Scenario::from_toml(text, "cell", std::path::Path::new("."))?;
    /// assert_eq!(scenario.gateways[0].alias, 3);
    /// # Ok::<(), ecan_sim::ScenarioError>(())
    /// ```
    ///
    /// # Errors
    /// The first error in the text, with its line.
    pub fn from_toml(text: &str, name: &str, directory: &Path) -> Result<Self, ScenarioError> {
        let source = Source { text };
        let raw: RawScenario = toml::from_str(text)
            .map_err(|error| source.error(error.span(), error.message().trim()))?;
        let wake_up = raw.wake_up_us.map(|raw| source.build(raw, RawWakeUp::build));
        let mut scenario = Self {
            name: raw.name.unwrap_or_else(|| name.to_owned()),
            seed: raw.seed.unwrap_or(1),
            clock: raw.clock,
            wake_up: wake_up.transpose()?,
            version: raw.version.unwrap_or(EcrtVersion::V1_6),
            master: raw.master,
            carries_large_pdos: raw.carries_large_pdos,
            reserved: raw.reserved,
            topology: raw.topology.unwrap_or(Topology::Line),
            ..Self::default()
        };
        for (position, raw) in raw.gateway.into_iter().enumerate() {
            let mut raw = raw;
            let switches = std::mem::take(&mut raw.as_mut().variant);
            let mut spec = source.build(raw, |raw| raw.build(position))?;
            for (key, value) in switches {
                source.build(key, |key| spec.config.variant.set(&key, &value))?;
            }
            scenario.gateways.push(spec);
        }
        let slaves = scenario.gateways.len() + raw.io.len();
        for raw in raw.io {
            let io = source.build(raw, |raw: RawIo| raw.build(&scenario, slaves))?;
            scenario.ios.push(io);
        }
        for raw in raw.node {
            let node = source.build(raw, |raw: RawNode| raw.build(&scenario, directory))?;
            scenario.nodes.push(node);
        }
        for raw in raw.fault {
            let fault = source.build(raw, |raw| scripted(&raw, &scenario))?;
            scenario.faults.push(fault);
        }
        Ok(scenario)
    }
}

fn scripted(raw: &FaultDescription, scenario: &Scenario) -> Result<ScriptedFault, String> {
    let when = raw.when(0).and_then(|when| when.ok_or(FaultError::NoTime));
    let both = when.and_then(|when| Ok(ScriptedFault { when, fault: raw.fault(scenario)? }));
    both.map_err(|error| error.to_string())
}

impl RawGateway {
    fn build(self, position: usize) -> Result<GatewaySpec, String> {
        let mut spec = GatewaySpec::at(position);
        set!(spec from self: alias, pdo_assign, pdo_configuration, sii_pdos);
        for (target, raw) in spec.sii_sync_managers.iter_mut().zip([self.sii_sm2, self.sii_sm3]) {
            let Some(raw) = raw else { continue };
            target.length = raw.size.unwrap_or(target.length);
            set!(target from raw: start, control);
        }
        let config = &mut spec.config;
        set!(config from self: serial, hardware_revision, firmware, vendor_id, product_code);
        set!(config from self: revision, boot_ms, reboot_delay_ms, tx_pressure_percent, complete_access);
        set!(config from self: publishes_after_read, transceiver_ns);
        check_transceiver(config.transceiver_ns)?;
        for (target, us) in [
            (&mut config.service_delay_ns, self.service_delay_us),
            (&mut config.service_jitter_ns, self.service_jitter_us),
            (&mut config.release_jitter_ns, self.release_jitter_us),
            (&mut config.mailbox_delay_ns, self.mailbox_delay_us),
        ] {
            *target = us.map_or(*target, |us| u64::from(us) * 1_000);
        }
        if let Some(window) = self.sync0_window {
            config.sync0_window = window.build()?;
        }
        if let Some(ppm) = self.clock_drift_ppm {
            if !(-1000.0..=1000.0).contains(&ppm) {
                return Err("`clock_drift_ppm` is out of range; allowed: -1000 to 1000".to_owned());
            }
            config.clock_drift_ppb = (ppm * 1000.0).round() as i32;
        }
        if !(1..=100).contains(&config.tx_pressure_percent) {
            return Err("`tx_pressure_percent` is out of range; allowed: 1 to 100".to_owned());
        }
        if let Some(buses) = self.buses {
            spec.buses = buses.try_into().map_err(|buses: Vec<String>| {
                format!(
                    "gateway {position} has {} buses; needed: {}, one per channel",
                    buses.len(),
                    ecan_protocol::mapping::CHANNELS
                )
            })?;
            if spec.buses.iter().any(|bus| bus.trim().is_empty()) {
                return Err(format!("gateway {position} has a bus without a name"));
            }
        }
        Ok(spec)
    }
}
