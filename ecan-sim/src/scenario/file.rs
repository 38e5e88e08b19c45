//! Scenario files in TOML; every error has its line.
//!
//! The tables are read flat and then checked key by key, so that a key that does not belong to the
//! kind of a node or fault is rejected as clearly as an unknown one.

mod raw_fault;
mod raw_node;

use std::ops::Range;
use std::path::Path;

use serde::Deserialize;
use toml::Spanned;

use crate::scenario::file::raw_fault::RawFault;
use crate::scenario::file::raw_node::RawNode;
use crate::scenario::{ClockKind, EcrtVersion, GatewaySpec, Scenario, Topology};
use crate::wake_up::WakeUpDelay;

/// Error in a scenario file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}{reason}", line.map_or_else(String::new, |line| format!("line {line}: ")))]
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
    carries_large_pdos: bool,
    #[serde(default)]
    reserved: bool,
    topology: Option<Topology>,
    #[serde(default)]
    gateway: Vec<Spanned<RawGateway>>,
    #[serde(default)]
    node: Vec<Spanned<RawNode>>,
    #[serde(default)]
    fault: Vec<Spanned<RawFault>>,
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
    service_delay_us: Option<u32>,
    service_jitter_us: Option<u32>,
    clock_drift_ppm: Option<f64>,
    release_jitter_us: Option<u32>,
    mailbox_delay_us: Option<u32>,
    pdo_assign: Option<bool>,
    pdo_configuration: Option<bool>,
    tx_pressure_percent: Option<u8>,
    buses: Option<Vec<String>>,
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

/// Replaces fields by those of a raw table that are given.
macro_rules! set {
    ($target:ident from $raw:ident: $($field:ident),+) => {
        $( if let Some(value) = $raw.$field { $target.$field = value; } )+
    };
}
use set;

impl Scenario {
    /// Reads a scenario from the text of a file. `name` is the default of the scenario's name;
    /// paths are relative to `directory`.
    ///
    /// Every key below is optional, except `kind` and `bus` of a node, `kind` of a fault and what
    /// that kind needs. The defaults are those of [`Scenario::default`] and [`GatewaySpec::at`].
    ///
    /// ```
    /// # let text = r#"
    /// name = "cell"
    /// seed = 42
    /// clock = "stepped"              # or "real"; otherwise the program selects
    /// wake_up_us = { typical = 10, p99 = 80, longest = 500 }  # delays of sleeps, if stepped
    /// version = "1.6"                # or "1.5"
    /// carries_large_pdos = false     # process data above 1486 bytes a direction
    /// reserved = false               # by another program
    /// topology = "line"              # or "star"
    ///
    /// [[gateway]]                    # in the order of their positions
    /// alias = 0
    /// serial = 4294967297
    /// hardware_revision = 1
    /// firmware = [514, 1]
    /// vendor_id = 0x4543
    /// product_code = 0x4C495445
    /// revision = 0x20002
    /// boot_ms = 200
    /// service_delay_us = 30
    /// service_jitter_us = 0
    /// release_jitter_us = 0          # of scheduled frames after their phase
    /// mailbox_delay_us = 200         # of responses on the wire
    /// pdo_assign = true              # the SII lets the master write 0x1C12 and 0x1C13
    /// pdo_configuration = false      # and the mapping
    /// tx_pressure_percent = 50       # of the TX ring; 100: only when it is full
    /// buses = ["0.0", "0.1", "0.2", "0.3"]
    ///
    /// [[node]]
    /// kind = "faulty"                # echo, silent, faulty, bridge, drive, replay with `file`
    /// bus = "0.0"
    /// name = "drive"
    /// bitrate = 500000               # otherwise that of the gateway's channel
    /// data_bitrate = 2000000         # CAN FD
    /// drop_permille = 5
    /// corrupt_permille = 5
    /// repeat_permille = 0
    /// babble_us = 0
    ///
    /// [[node]]
    /// kind = "bridge"                # connects other programs by TCP
    /// bus = "0.1"
    /// protocol = "slcan"             # or "socketcand"
    /// address = "127.0.0.1"
    /// port = 0                       # any free one; the banner names it
    /// max_clients = 8
    /// queue = 4096                   # frames for the bus, and for each client
    ///
    /// [[node]]
    /// kind = "drive"                 # a CiA 402 drive
    /// bus = "0.2"
    /// name = "shoulder"
    /// node_id = 5
    /// # eds = "drive.eds"            # otherwise the built-in object dictionary
    /// serial = 77
    /// boot_ms = 40
    /// sdo_delay_us = 200
    /// enable_ms = 0
    /// motor = { start_position = 1000, absolute_encoder = false, friction = 5000000 }
    ///
    /// [node.quirks]                  # names as in `DriveQuirks`
    /// refuses_mapping_while_valid = true
    /// needs_mode = true
    /// missing = [0x1016, 0x6007]
    /// sdo = [{ index = 0x60C2, direction = "write", code = 0x06010000, times = 2 }]
    ///
    /// [[fault]]
    /// cycle = 1000                   # n-th send with process data; or at_ms
    /// kind = "lost_frame"            # way = "outward" or "return", cycles
    /// cycles = 2
    ///
    /// [[fault]]
    /// at_ms = 2500
    /// kind = "power_cycle"           # gateway, off_ms; also power_off; link_loss with for_ms
    /// gateway = 0
    /// off_ms = 300
    ///
    /// [[fault]]
    /// at_ms = 5000
    /// kind = "sdo_abort"             # index, subindex, code, times
    /// gateway = 0
    /// index = 0x8010
    /// subindex = 1
    /// code = 0x06090030
    ///
    /// [[fault]]
    /// at_ms = 6000
    /// kind = "drive_error"           # node, code
    /// node = "shoulder"
    /// code = 0x2310
    /// # "#;
    /// let scenario = ecan_sim::Scenario::from_toml(text, "cell", std::path::Path::new("."))?;
    /// # assert_eq!((scenario.gateways.len(), scenario.faults.len()), (1, 4));
    /// # Ok::<(), ecan_sim::ScenarioError>(())
    /// ```
    ///
    /// All kinds of faults, with their keys, are in docs/SIMULATION.md.
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
            carries_large_pdos: raw.carries_large_pdos,
            reserved: raw.reserved,
            topology: raw.topology.unwrap_or(Topology::Line),
            ..Self::default()
        };
        for (position, raw) in raw.gateway.into_iter().enumerate() {
            scenario.gateways.push(source.build(raw, |raw| raw.build(position))?);
        }
        for raw in raw.node {
            let node = source.build(raw, |raw: RawNode| raw.build(&scenario, directory))?;
            scenario.nodes.push(node);
        }
        for raw in raw.fault {
            let fault = source.build(raw, |raw: RawFault| raw.build(&scenario))?;
            scenario.faults.push(fault);
        }
        Ok(scenario)
    }
}

impl RawGateway {
    fn build(self, position: usize) -> Result<GatewaySpec, String> {
        let mut spec = GatewaySpec::at(position);
        set!(spec from self: alias, pdo_assign, pdo_configuration);
        let config = &mut spec.config;
        set!(config from self: serial, hardware_revision, firmware, vendor_id, product_code);
        set!(config from self: revision, boot_ms, tx_pressure_percent);
        for (target, us) in [
            (&mut config.service_delay_ns, self.service_delay_us),
            (&mut config.service_jitter_ns, self.service_jitter_us),
            (&mut config.release_jitter_ns, self.release_jitter_us),
            (&mut config.mailbox_delay_ns, self.mailbox_delay_us),
        ] {
            *target = us.map_or(*target, |us| u64::from(us) * 1_000);
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
