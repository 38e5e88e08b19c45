//! The bus that a step asks for, and its scenario file for simulated gateways.

use std::fmt::Write as _;

/// Number of CAN channels of a gateway.
const CHANNELS: u16 = 4;
/// Drives on each channel.
const DRIVES: u16 = 4;
/// Drift of the clocks against the host, fast and slow in turn.
const CLOCK_DRIFT_PPM: i32 = 60;

/// Nodes on each CAN channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Nodes {
    /// Any: the step sends no frames.
    Any,
    /// None: nothing acknowledges.
    None,
    /// A node that returns every frame.
    #[default]
    Echo,
    /// CiA 402 drives with node-IDs 1 to 4.
    Drives,
}

/// A bus with gateways, nodes and faults.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct BusSpec {
    pub gateways: u16,
    pub nodes: Nodes,
    /// Faults, as in a scenario file.
    pub faults: String,
}

impl BusSpec {
    pub fn any(gateways: u16) -> Self {
        Self { gateways, nodes: Nodes::Any, ..Self::default() }
    }

    pub fn echo(gateways: u16) -> Self {
        Self { gateways, ..Self::default() }
    }

    pub fn drives(gateways: u16) -> Self {
        Self { gateways, nodes: Nodes::Drives, ..Self::default() }
    }

    pub fn with_faults(mut self, faults: impl Into<String>) -> Self {
        self.faults = faults.into();
        self
    }

    /// Returns whether only a simulated gateway can do this.
    pub fn needs_simulation(&self) -> bool {
        !self.faults.is_empty()
    }

    /// The scenario file, with these keys before its tables and in each gateway.
    pub fn scenario(&self, head: &str, gateway_keys: &str) -> String {
        let mut text = format!("name = \"acceptance\"\n{head}");
        for gateway in 0..self.gateways {
            let drift_ppm = if gateway % 2 == 0 { CLOCK_DRIFT_PPM } else { -CLOCK_DRIFT_PPM };
            let _ = writeln!(text, "[[gateway]]\nclock_drift_ppm = {drift_ppm}\n{gateway_keys}");
        }
        for (gateway, channel) in (0..self.gateways)
            .flat_map(|gateway| (0..CHANNELS).map(move |channel| (gateway, channel)))
        {
            let bus = format!("bus = \"{gateway}.{channel}\"");
            match self.nodes {
                Nodes::None => {}
                Nodes::Any | Nodes::Echo => {
                    let _ = writeln!(text, "[[node]]\nkind = \"echo\"\n{bus}");
                }
                Nodes::Drives => {
                    for node in 1..=DRIVES {
                        let _ =
                            writeln!(text, "[[node]]\nkind = \"drive\"\n{bus}\nnode_id = {node}");
                    }
                }
            }
        }
        text.push_str(&self.faults);
        text
    }
}
