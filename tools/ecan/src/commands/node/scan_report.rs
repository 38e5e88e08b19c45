//! Result of a scan.

use std::io::{self, Write};

use ecan_canopen::NmtState;
use serde::Serialize;

use crate::context::{Output, Tone};
use crate::table;

use super::device_type::DeviceType;

/// State of a channel of a gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ChannelResult {
    /// Nodes acknowledge frames.
    Scanned,
    /// No node acknowledges frames.
    NotAcknowledged,
    /// No bit rate was found.
    NoBitRate,
}

#[derive(Clone, Debug, Serialize)]
pub struct ScannedChannel {
    pub slave: usize,
    pub channel: u8,
    pub bitrate: Option<u32>,
    pub result: ChannelResult,
}

#[derive(Clone, Debug, Serialize)]
pub struct FoundNode {
    pub slave: usize,
    pub channel: u8,
    pub node: u8,
    /// State by heartbeat or boot-up message.
    pub state: Option<&'static str>,
    /// The node answers SDO requests.
    pub has_sdo: bool,
    pub device_type: Option<u32>,
    pub name: Option<String>,
    pub vendor_id: Option<u32>,
    pub product_code: Option<u32>,
    pub revision: Option<u32>,
    pub serial: Option<u32>,
}

impl FoundNode {
    pub fn new(slave: usize, channel: u8, node: u8) -> Self {
        Self {
            slave,
            channel,
            node,
            state: None,
            has_sdo: false,
            device_type: None,
            name: None,
            vendor_id: None,
            product_code: None,
            revision: None,
            serial: None,
        }
    }
}

#[derive(Clone, Debug, Default, Serialize)]
pub struct ScanReport {
    pub channels: Vec<ScannedChannel>,
    pub nodes: Vec<FoundNode>,
}

/// Name of a state, for JSON and text.
pub fn state_name(state: NmtState) -> &'static str {
    match state {
        NmtState::Initialising => "initialising",
        NmtState::Stopped => "stopped",
        NmtState::Operational => "operational",
        NmtState::PreOperational => "pre-operational",
    }
}

impl ScanReport {
    pub fn add(&mut self, other: Self) {
        self.channels.extend(other.channels);
        self.nodes.extend(other.nodes);
    }

    pub fn sort(&mut self) {
        self.channels.sort_by_key(|it| (it.slave, it.channel));
        self.nodes.sort_by_key(|it| (it.slave, it.channel, it.node));
    }

    pub fn print(&self, output: &Output, out: &mut dyn Write) -> io::Result<()> {
        let titles = [
            "SLAVE", "CHANNEL", "NODE", "STATE", "VENDOR", "PRODUCT", "REVISION", "SERIAL",
            "DEVICE",
        ];
        if !self.nodes.is_empty() {
            table::print_with_titles(out, titles, &self.nodes, row)?;
            writeln!(out)?;
        }
        for it in &self.channels {
            let nodes = self
                .nodes
                .iter()
                .filter(|node| (node.slave, node.channel) == (it.slave, it.channel));
            let rate =
                it.bitrate.map_or_else(String::new, |rate| format!(" at {} kbit/s", kbit(rate)));
            let text = match it.result {
                ChannelResult::Scanned => format!("{} node(s){rate}", nodes.count()),
                ChannelResult::NotAcknowledged => output.toned(
                    Tone::Warning,
                    format!("no node acknowledges frames{rate}; check bit rate, wiring and supply"),
                ),
                ChannelResult::NoBitRate => {
                    output.toned(Tone::Warning, "no frame and no acknowledgement at any bit rate")
                }
            };
            writeln!(out, "slave {} can{}: {text}", it.slave, it.channel)?;
        }
        Ok(())
    }
}

fn kbit(rate: u32) -> f64 {
    f64::from(rate) / 1e3
}

fn row(it: &FoundNode) -> [String; 9] {
    let hexadecimal = |value: Option<u32>| value.map_or("-".to_owned(), |it| format!("0x{it:08X}"));
    let device = match (&it.name, it.device_type) {
        (_, _) if !it.has_sdo => "no answer to SDO requests".to_owned(),
        (Some(name), Some(ty)) => format!("{name}, {}", DeviceType(ty)),
        (Some(name), None) => name.clone(),
        (None, Some(ty)) => DeviceType(ty).to_string(),
        (None, None) => "-".to_owned(),
    };
    [
        it.slave.to_string(),
        format!("can{}", it.channel),
        it.node.to_string(),
        it.state.unwrap_or("-").to_owned(),
        hexadecimal(it.vendor_id),
        hexadecimal(it.product_code),
        hexadecimal(it.revision),
        it.serial.map_or("-".to_owned(), |it| it.to_string()),
        device,
    ]
}
