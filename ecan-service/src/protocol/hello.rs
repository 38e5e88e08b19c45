//! Method `hello`: versions, access and channels.

use serde::{Deserialize, Serialize};

/// Version of this protocol.
pub const PROTOCOL_VERSION: u32 = 1;

/// Parameters of `hello`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct HelloParams {
    /// [`PROTOCOL_VERSION`]. Further members are allowed, so that each version can read it.
    pub version: u32,
    /// Name of the client, for statistics and the log, as [`clean_name`] keeps it.
    pub client: String,
}

/// Bytes of a name that are kept.
pub const MAX_NAME_BYTES: usize = 64;

/// Returns at most [`MAX_NAME_BYTES`] bytes of a name of another program. Control characters and those
/// that change the direction of text, which a terminal would execute, become `?`.
pub fn clean_name(name: &str) -> String {
    let is_hidden = |at: char| {
        at.is_control()
            || matches!(at, '\u{200B}'..='\u{200F}' | '\u{2028}'..='\u{202E}' | '\u{2066}'..='\u{2069}' | '\u{FEFF}')
    };
    let kept = name.get(..name.floor_char_boundary(MAX_NAME_BYTES)).unwrap_or_default();
    kept.chars().map(|at| if is_hidden(at) { '?' } else { at }).collect()
}

/// Access of a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Access {
    /// Reads only.
    #[default]
    Read,
    /// Also sends frames, downloads SDOs, configures.
    Control,
}

/// Result of `hello`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Hello {
    /// Version of the protocol.
    pub version: u32,
    /// Program that serves, for example `ecan serve`.
    pub server: String,
    /// Version of the program.
    pub server_version: String,
    /// Its process.
    pub pid: u32,
    /// Index of the EtherCAT master.
    pub master: u32,
    /// True if the bus is simulated.
    pub is_simulated: bool,
    /// True if time passes without the cycle; false for stepped simulated time.
    pub is_free_running: bool,
    /// Access of this client.
    pub access: Access,
    /// Reason without control.
    pub access_reason: Option<String>,
    /// Period of the cycle in nanoseconds; `None` if the service has no cycle.
    pub cycle_ns: Option<u64>,
    /// Frames of one client and channel that may be without result.
    pub window: u32,
    /// Age limit of a request that may act and of a frame to send without an own one, in milliseconds;
    /// 0 if the service checks none.
    #[serde(default)]
    pub max_age_ms: u32,
    /// The gateways; empty without a cycle. Notification `gateways` reports a change.
    pub gateways: Vec<Gateway>,
}

impl Hello {
    /// The channel with this address, if it is enabled.
    pub fn channel(&self, gateway: u16, channel: u8) -> Option<&Channel> {
        let gateway = self.gateways.get(usize::from(gateway))?;
        gateway.channels.iter().find(|found| found.channel == channel)
    }
}

/// A gateway of the cycle. Its index in the list is the `gateway` of records.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Gateway {
    /// Configured alias; 0 for none.
    pub alias: u16,
    /// Configured position, counted from the alias.
    pub position: u16,
    /// The gateway reports a result for each frame sent.
    pub has_results: bool,
    /// The enabled channels.
    pub channels: Vec<Channel>,
}

/// An enabled channel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Channel {
    /// Channel, 0 to 3.
    pub channel: u8,
    /// Nominal bit rate in bit/s.
    pub bitrate: u32,
    /// Bit rate of the data phase in bit/s; `None` on a channel for classic CAN.
    pub data_bitrate: Option<u32>,
    /// Frames of the channel reach the host.
    pub receives: bool,
    /// Frames can be sent on the channel.
    pub sends: bool,
}

/// Parameters of the notification `gateways`: the bus was configured again.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct GatewaysChanged {
    /// As in [`Hello`].
    pub cycle_ns: Option<u64>,
    /// As in [`Hello`].
    pub gateways: Vec<Gateway>,
}
