//! State of the bus, of its axes and of the service, and the greeting, as responses contain them.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Counters by name.
pub type Counters = Map<String, Value>;

/// Result of `state`: all of it belongs to one cycle, except the sampled times.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// The cycle.
    pub cycle: CycleState,
    /// Run time of the cycles that the service sampled.
    pub run_time: SampledTimes,
    /// Delay of the start of these cycles after their deadline.
    pub late: SampledTimes,
    /// The gateways.
    pub gateways: Vec<GatewayState>,
}

/// Times of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CycleState {
    /// Number of the cycle, from 1.
    pub cycle: u64,
    /// Start of the cycle, in nanoseconds, as in a frame record.
    pub time_ns: u64,
    /// Period in nanoseconds.
    pub cycle_ns: u64,
    /// Time from the start to the end of sending, in nanoseconds.
    pub run_time_ns: u64,
    /// Delay of the start after the deadline in nanoseconds; `None` without a wait for the cycle.
    pub late_ns: Option<u64>,
    /// Cycles that missed a deadline.
    pub overruns: u64,
    /// Deadlines that were skipped.
    pub skipped: u64,
    /// The application was requested to stop.
    pub is_stop_requested: bool,
    /// The application ended: this was the last cycle.
    pub is_closed: bool,
}

/// Distribution of a time over sampled cycles, in nanoseconds.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct SampledTimes {
    /// Number of samples.
    pub samples: u64,
    /// Shortest time.
    pub min_ns: u64,
    /// Median.
    pub p50_ns: u64,
    /// 99 % of the samples are not above it.
    pub p99_ns: u64,
    /// Longest time.
    pub max_ns: u64,
}

/// State of a gateway's session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SessionState {
    /// Not in OP, or process data not confirmed.
    Waiting,
    /// In OP, being verified.
    Verifying,
    /// Verified; frames can be sent.
    Ready,
    /// Verification failed.
    Failed,
}

/// A gateway in one cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GatewayState {
    /// State of the session.
    pub session: SessionState,
    /// Step that the gateway waits for until it is ready.
    pub waiting_for: Option<String>,
    /// Code of this step, `PendingStep::encode` of the crate `ecan-mcan-port`; 0 for none.
    #[serde(default)]
    pub waiting_code: u64,
    /// Working counter of the cycle, and the expected one.
    pub working_counter: u32,
    /// Expected working counter.
    pub expected_working_counter: u32,
    /// Status word of each enabled channel (manual 7); `None` for the others.
    pub channel_status: [Option<u16>; 4],
    /// Counters of gateway and channels: `SlaveStatistics` of the crate `ecan-mcan-port`.
    pub statistics: Counters,
}

/// Result of `config`: by serde of the crates `ecan-host` and `ecan-mcan-port`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ActiveConfig {
    /// An `AdapterConfig`.
    pub adapter: Value,
    /// A `PortConfig`.
    pub port: Value,
}

/// Result of `axes`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Axes {
    /// Number of the cycle.
    pub cycle: u64,
    /// Start of the cycle, in nanoseconds, as in a frame record.
    pub time_ns: u64,
    /// The axes; empty if the application has none.
    pub axes: Vec<AxisState>,
}

/// Result of `service.stats`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct ServiceStats {
    /// Clients that were accepted since the start.
    pub clients_accepted: u64,
    /// Clients that were rejected: too many in all or of one user, or no file descriptor.
    pub clients_rejected: u64,
    /// Clients that were disconnected because no `hello` came in time.
    #[serde(default)]
    pub clients_silent: u64,
    /// Requests that wait for a worker or are executed by one.
    #[serde(default)]
    pub requests_pending: u64,
    /// Requests that were rejected because a limit was reached.
    #[serde(default)]
    pub requests_rejected: u64,
    /// Requests that were not executed because their client left.
    #[serde(default)]
    pub requests_cancelled: u64,
    /// Requests that waited longer than their age limit and were not executed.
    #[serde(default)]
    pub requests_expired: u64,
    /// Frame events of the bus that the service read.
    pub frames: u64,
    /// Frames of images that found the ring of the cycle full: lost for every subscribed client.
    pub frames_lost_in_ring: u64,
    /// Images that found the ring of the cycle full.
    pub images_lost_in_ring: u64,
    /// The connected clients.
    pub clients: Vec<ClientStats>,
}

/// Counters of a client. For each subscribed client, every selected frame is either in
/// `frames_delivered` or in `frames_lost`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClientStats {
    /// Number of the client, from 1.
    pub id: u64,
    /// Name in `hello`.
    pub name: String,
    /// Process of the client.
    pub pid: u32,
    /// User of the client.
    pub uid: u32,
    /// Access.
    pub access: Access,
    /// Time since the connection, in milliseconds.
    pub connected_ms: u64,
    /// Requests.
    pub requests: u64,
    /// Requests that were rejected because a limit was reached.
    #[serde(default)]
    pub requests_rejected: u64,
    /// Requests that waited longer than their age limit and were not executed.
    #[serde(default)]
    pub requests_expired: u64,
    /// Frames put into the output queue of the client.
    pub frames_delivered: u64,
    /// Frames that the client lost.
    pub frames_lost: u64,
    /// Images put into the output queue.
    pub images_delivered: u64,
    /// Images that the client lost.
    pub images_lost: u64,
    /// Frames of the client that the service accepted.
    pub frames_accepted: u64,
    /// Frames of the client that the service rejected.
    pub frames_rejected: u64,
    /// Frames of the client without result.
    pub frames_pending: u64,
    /// Bytes in the output queue.
    pub queued_bytes: u64,
}

/// Result of `bus.state`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct BusState {
    /// Slaves found by the last scan.
    pub slave_count: u32,
    /// Slaves that answer, over all links.
    pub slaves_responding: u32,
    /// AL states that occur: bit 0 INIT, 1 PREOP, 2 SAFEOP, 3 OP.
    pub al_states: u8,
    /// At least one link is up.
    pub link_up: bool,
    /// The main link is up.
    pub main_link_up: bool,
    /// A scan is running: slave information may be outdated.
    pub scan_busy: bool,
    /// Application time last given to the master, in nanoseconds since 2000-01-01.
    pub app_time_ns: u64,
}

/// Parameters of `bus.link`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkParams {
    /// 0 for the main link, 1 for the redundant one.
    pub device: u32,
}

/// Result of `bus.link`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Link {
    /// Slaves that answer on this link.
    pub slaves_responding: u32,
    /// AL states that occur on this link, bits as in [`BusState`].
    pub al_states: u8,
    /// This link is up.
    pub link_up: bool,
}

/// Parameters of `bus.slave`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlaveParams {
    /// Position on the bus, from 0.
    pub slave: u16,
}

/// A slave on the bus.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Slave {
    /// Position on the bus, from 0.
    pub position: u16,
    /// Vendor ID.
    pub vendor_id: u32,
    /// Product code.
    pub product_code: u32,
    /// Revision.
    pub revision_number: u32,
    /// Serial number.
    pub serial_number: u32,
    /// Station alias; 0 for none.
    pub alias: u16,
    /// Current from the E-bus in mA.
    pub current_on_ebus_ma: i16,
    /// AL state: 1 INIT, 2 PREOP, 4 SAFEOP, 8 OP; bit 4 marks an error.
    pub al_state: u8,
    /// The master met an error and keeps the slave in its state.
    pub error_flag: bool,
    /// Sync managers in the EEPROM.
    pub sync_count: u8,
    /// Objects in the dictionary, if the master fetched it.
    pub sdo_count: u16,
    /// Device name.
    pub name: String,
    /// The four ports.
    pub ports: [SlavePort; 4],
}

/// A port of a slave.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlavePort {
    /// Kind of port.
    pub kind: PortKind,
    /// A link is established.
    pub link_up: bool,
    /// The port returns frames.
    pub loop_closed: bool,
    /// A signal arrives.
    pub signal_detected: bool,
    /// Local time at which the delay measurement frame arrived, in nanoseconds.
    pub receive_time_ns: u32,
    /// Position of the neighbour.
    pub next_slave: Option<u16>,
    /// Delay to the next slave with distributed clocks, in nanoseconds.
    pub delay_to_next_dc_ns: u32,
}

/// Kind of a slave port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PortKind {
    /// The slave controller does not have it.
    NotImplemented,
    /// Not configured.
    NotConfigured,
    /// Backplane.
    Ebus,
    /// Ethernet.
    Mii,
}

/// Parameters of `pdo.assigned`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AssignedParams {
    /// Position of the slave.
    pub slave: u16,
    /// Sync manager.
    pub sync: u8,
}

/// An assigned PDO.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AssignedPdo {
    /// Mapping object.
    pub index: u16,
    /// Mapped objects.
    pub entries: Vec<PdoEntry>,
}

/// A mapped object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PdoEntry {
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// Length in bits.
    pub bits: u8,
}

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
    let kept = name.char_indices().take_while(|(at, text)| at + text.len_utf8() <= MAX_NAME_BYTES);
    kept.map(|(_, text)| if is_hidden(text) { '?' } else { text }).collect()
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

/// Parameters of the notification `channel`: bus-off or the error warning of a CAN channel began or ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChannelChanged {
    /// Time of the cycle, as in a frame record.
    pub time_ns: u64,
    /// Index of the gateway.
    pub gateway: u16,
    /// Channel, 0 to 3.
    pub channel: u8,
    /// The controller is off the bus.
    pub is_bus_off: bool,
    /// The controller is error warning or error passive.
    pub has_warning: bool,
}

/// Declares each field once: with its type and its value in the status of an axis.
macro_rules! axis_state {
    ($status:ident; $($(#[$meta:meta])* $field:ident: $type:ty = $value:expr;)*) => {
        /// Status of an axis. Positions in steps.
        #[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
        pub struct AxisState {
            $($(#[$meta])* pub $field: $type,)*
        }

        #[cfg(feature = "server")]
        impl From<&ecan_cia402::AxisStatus> for AxisState {
            fn from($status: &ecan_cia402::AxisStatus) -> Self {
                Self { $($field: $value,)* }
            }
        }
    };
}

axis_state! { status;
    /// Index of the gateway.
    gateway: u16 = status.address.slave as u16;
    /// Channel, 0 to 3.
    channel: u8 = status.address.channel;
    /// Node-ID of the drive.
    node_id: u8 = status.address.node.get();
    /// Phase of the axis.
    phase: String = status.phase.to_string();
    /// Time since the phase began, in nanoseconds.
    elapsed_ns: u64 = u64::try_from(status.elapsed.as_nanos()).unwrap_or(u64::MAX);
    /// Failure of the last command.
    error: Option<String> = text(status.error);
    /// Mode of operation.
    mode: String = status.mode.to_string();
    /// The last statusword.
    statusword: Option<u16> = status.statusword.map(|word| word.0);
    /// State in the statusword.
    drive_state: Option<String> = text(status.drive_state());
    /// Error code of the last emergency message; 0 for none.
    error_code: u16 = status.error_code;
    /// Last NMT state of the node.
    nmt_state: Option<String> = text(status.nmt_state);
    /// State of the heartbeat.
    heartbeat: String = status.heartbeat.to_string();
    /// The last usable actual position.
    actual: Option<i32> = status.actual;
    /// Age of the actual position in cycles; 65535 is more or never.
    actual_age: u16 = status.actual_age;
    /// The actual position in degrees.
    actual_degrees: Option<f64> = status.actual_degrees();
    /// The last target sent.
    target: Option<i32> = status.target;
    /// Target minus actual position.
    following_error: Option<i64> = status.following_error();
    /// Reason of a hold.
    hold_reason: Option<String> = text(status.hold_reason);
    /// Cause of a stop.
    stop_cause: Option<String> = text(status.stop_cause);
    /// The drive is configured.
    is_configured: bool = status.is_configured;
    /// The axis follows targets.
    is_running: bool = status.is_running;
    /// A halted axis is at rest.
    is_at_rest: bool = status.is_at_rest;
    /// The drive has reached its target.
    is_target_reached: bool = status.is_target_reached;
    /// The axis has stopped.
    is_stopped: bool = status.is_stopped;
    /// A recovery continues.
    is_recovering: bool = status.is_recovering;
}

#[cfg(feature = "server")]
fn text(value: Option<impl ToString>) -> Option<String> {
    value.map(|value| value.to_string())
}

fn optional(value: Option<impl ToString>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| value.to_string())
}

impl AxisState {
    /// Lines for people, with a text of the errors of the axis and of its drive.
    pub fn details(&self, error: Option<String>) -> Vec<String> {
        let Self { gateway, channel, node_id, phase, elapsed_ns, .. } = self;
        let drive = match (self.statusword, &self.drive_state) {
            (Some(word), Some(state)) => format!("drive {state} (statusword 0x{word:04X})"),
            (Some(word), None) => format!("drive in an unknown state (statusword 0x{word:04X})"),
            (None, _) => "no statusword received".to_owned(),
        };
        let actual = match (self.actual, self.actual_degrees, self.actual_age) {
            (None, ..) => "no actual position received".to_owned(),
            (Some(actual), degrees, age) => {
                let degrees =
                    degrees.map_or_else(String::new, |degrees| format!(" ({degrees:.3} degrees)"));
                let age = match age {
                    0 => String::new(),
                    u16::MAX => ", age above 65534 cycles".to_owned(),
                    age => format!(", age {age} cycles"),
                };
                format!("actual {actual} steps{degrees}{age}")
            }
        };
        // The phase usually has them.
        let reason = |name: &str, text: &Option<String>| {
            let text = text.as_ref().filter(|text| !phase.contains(text.as_str()))?;
            Some(format!("{name}: {text}"))
        };
        let nmt = self.nmt_state.as_deref().unwrap_or("unknown");
        let elapsed_s = *elapsed_ns as f64 / 1e9;
        let (target, following) = (optional(self.target), optional(self.following_error));
        let lines = [
            Some(format!(
                "gateway {gateway} can{channel} node {node_id}, for {elapsed_s:.1} s: {phase}"
            )),
            error.map(|text| format!("error: {text}")),
            Some(format!("{drive}, NMT {nmt}, heartbeat {}", self.heartbeat)),
            Some(actual),
            Some(format!("target {target}, following error {following}")),
            reason("hold", &self.hold_reason),
            reason("stop", &self.stop_cause),
        ];
        lines.into_iter().flatten().collect()
    }
}
