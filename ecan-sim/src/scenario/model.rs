//! A scenario: gateways, I/O slaves, nodes, and the behaviour of the master; and the built-in scenarios.

use std::path::PathBuf;

use ecan_can_io::recording::ReadOptions;
use ecan_canopen::NodeId;
use ecan_protocol::mapping::MAX_PDO_BYTES;
use serde::Deserialize;

use crate::bus::PhysicalLayer;
use crate::drive::{DriveConfig, MotorConfig};
use crate::fault::ScriptedFault;
use crate::gateway::{GatewayModelConfig, SyncManagerConfig};
use crate::node::{BridgeSpec, FaultyConfig};
use crate::random::WakeUpDelay;

/// Clock of a simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ClockKind {
    /// The system's monotonic clock.
    Real,
    /// Stepped time: it advances only when a thread sleeps on the simulation's clock or waits in a
    /// blocking call. The same program gives the same result each time.
    Stepped,
}

/// Simulated release of libethercat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
pub enum EcrtVersion {
    /// 1.5.2: many functions return nothing, some do not exist.
    #[serde(rename = "1.5", alias = "1.5.2")]
    V1_5,
    /// 1.6.2.
    #[default]
    #[serde(rename = "1.6", alias = "1.6.2")]
    V1_6,
}

impl EcrtVersion {
    /// Value of `ecrt_version_magic()`.
    pub fn magic(self) -> u32 {
        match self {
            Self::V1_5 => 0x105,
            Self::V1_6 => 0x106,
        }
    }
}

/// Connection of the gateways to the master.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Topology {
    /// One after the other: a missing gateway cuts off all gateways downstream of it.
    #[default]
    Line,
    /// Each on a junction: without a missing gateway the others remain reachable, but their
    /// positions shift.
    Star,
}

/// One gateway.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GatewaySpec {
    /// Station alias; 0 is none.
    pub alias: u16,
    /// Identity and timing.
    pub config: GatewayModelConfig,
    /// True if the SII lets the master write 0x1C12 and 0x1C13.
    pub pdo_assign: bool,
    /// True if the SII lets the master write the mapping objects.
    pub pdo_configuration: bool,
    /// True if the SII lists all PDOs (categories 50 and 51), in 4 instead of 2 KiB. IgH uploads the
    /// assigned ones nevertheless.
    pub sii_pdos: bool,
    /// SM2 and SM3 in the SII: a master takes start and control byte from there (manual 15.7). A
    /// rebuilt EEPROM has those of the manual.
    pub sii_sync_managers: [SyncManagerConfig; 2],
    /// Names of the CAN buses of the four channels.
    pub buses: [String; ecan_protocol::mapping::CHANNELS],
}

impl GatewaySpec {
    /// SM2 and SM3 of manual 5.3 and 15.7.
    pub const SII_SYNC_MANAGERS: [SyncManagerConfig; 2] = [
        SyncManagerConfig { start: 0x1100, length: MAX_PDO_BYTES as u16, control: 0x66 },
        SyncManagerConfig { start: 0x1D00, length: MAX_PDO_BYTES as u16, control: 0x22 },
    ];

    /// The gateway at a position, with the default identity and a separate bus on each channel,
    /// named `<position>.<channel>`.
    pub fn at(position: usize) -> Self {
        let config = GatewayModelConfig::default();
        Self {
            alias: 0,
            config: GatewayModelConfig {
                serial: config.serial.wrapping_add(position as u64),
                ..config
            },
            pdo_assign: true,
            pdo_configuration: false,
            sii_pdos: false,
            sii_sync_managers: Self::SII_SYNC_MANAGERS,
            buses: std::array::from_fn(|channel| format!("{position}.{channel}")),
        }
    }
}

/// A simulated drive in a scenario.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveSpec {
    /// Configuration of the drive.
    pub config: DriveConfig,
    /// Path of its device file (EDS or DCF); `None` is the built-in object dictionary.
    pub eds: Option<PathBuf>,
}

/// Behaviour of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NodeKind {
    /// Sends every received frame back unchanged.
    Echo,
    /// Sends the frames of a recording at their recorded times, from the time it joins the bus.
    Replay {
        /// Path of the recording.
        file: PathBuf,
        /// Settings for text that does not state them.
        options: ReadOptions,
    },
    /// Acknowledges frames, sends none.
    Silent,
    /// Connects other programs to the bus.
    Bridge(BridgeSpec),
    /// Echoes with faults.
    Faulty(FaultyConfig),
    /// A CiA 402 drive.
    Drive(Box<DriveSpec>),
}

impl NodeKind {
    /// Name in scenario files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Echo => "echo",
            Self::Replay { .. } => "replay",
            Self::Silent => "silent",
            Self::Bridge(_) => "bridge",
            Self::Faulty(_) => "faulty",
            Self::Drive(_) => "drive",
        }
    }
}

/// One node on a bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeSpec {
    /// Name, for faults.
    pub name: String,
    /// Name of its bus.
    pub bus: String,
    /// Behaviour.
    pub kind: NodeKind,
    /// Nominal bit rate, bit/s; `None` uses that of the gateway channel on the bus.
    pub bitrate: Option<u32>,
    /// Data bit rate, bit/s; `None` is classic CAN if `bitrate` is given.
    pub data_bitrate: Option<u32>,
    /// Sample points and delays; `None` samples each bit correctly.
    pub physical_layer: Option<PhysicalLayer>,
}

/// Description of a simulation. Plain data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scenario {
    /// Name in the banner.
    pub name: String,
    /// Seed of all random values.
    pub seed: u64,
    /// Clock that the scenario requires; `None` leaves it to the program.
    pub clock: Option<ClockKind>,
    /// Delay of the application's sleeps in stepped time; `None` is no delay.
    pub wake_up: Option<WakeUpDelay>,
    /// Simulated release of the library.
    pub version: EcrtVersion,
    /// Pace and side activities of the master.
    pub master: MasterBehaviour,
    /// True if the master sends process data of more than 1486 bytes per direction.
    pub carries_large_pdos: bool,
    /// True if another program has reserved the master, so that requesting it fails with `EBUSY`.
    pub reserved: bool,
    /// Connection of the gateways.
    pub topology: Topology,
    /// The gateways in order of their positions.
    pub gateways: Vec<GatewaySpec>,
    /// Slaves of other vendors between them.
    pub ios: Vec<IoSpec>,
    /// The nodes.
    pub nodes: Vec<NodeSpec>,
    /// The scripted faults.
    pub faults: Vec<ScriptedFault>,
}

impl Default for Scenario {
    /// No gateways and no nodes.
    fn default() -> Self {
        Self {
            name: "empty".to_owned(),
            seed: 1,
            clock: None,
            wake_up: None,
            version: EcrtVersion::V1_6,
            master: MasterBehaviour::default(),
            carries_large_pdos: false,
            reserved: false,
            topology: Topology::Line,
            gateways: Vec::new(),
            ios: Vec::new(),
            nodes: Vec::new(),
            faults: Vec::new(),
        }
    }
}

/// Inputs of an I/O slave.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum IoBehaviour {
    /// The outputs; further input bytes are 0.
    #[default]
    Loopback,
    /// The number of reads by the master, little endian.
    Counter,
    /// These bytes; further input bytes are 0.
    Fixed(Vec<u8>),
}

/// Names of the behaviours in scenario files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum IoBehaviourName {
    #[default]
    Loopback,
    Counter,
    Fixed,
}

/// A digital I/O on the EtherCAT line, of another vendor: it has no mailbox and no distributed clock.
///
/// Its outputs are PDO 0x1600 in SM0, with the entries 0x7000:01 and so on of 8 bits; its inputs are PDO
/// 0x1A00 in SM1, with the entries 0x6000:01 and so on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IoSpec {
    /// Position on the line, from 0. The gateways have the other positions, in their order.
    pub position: usize,
    /// Name in the SII.
    pub name: String,
    /// Station alias; 0 is none.
    pub alias: u16,
    /// Vendor ID.
    pub vendor_id: u32,
    /// Product code.
    pub product_code: u32,
    /// Revision number.
    pub revision: u32,
    /// Serial number.
    pub serial: u32,
    /// Time from power-on until it responds, ms.
    pub boot_ms: u32,
    /// Number of output bytes.
    pub outputs: u8,
    /// Number of input bytes.
    pub inputs: u8,
    /// Values of the inputs.
    pub behaviour: IoBehaviour,
}

impl IoSpec {
    /// Largest number of bytes of one direction.
    pub const MAX_BYTES: u8 = 64;

    /// A digital I/O with two bytes in each direction, looped back.
    pub fn at(position: usize) -> Self {
        Self {
            position,
            name: "Digital I/O".to_owned(),
            alias: 0,
            vendor_id: 0x0000_0D10,
            product_code: 0x0000_1010,
            revision: 1,
            serial: 1,
            boot_ms: 50,
            outputs: 2,
            inputs: 2,
            behaviour: IoBehaviour::Loopback,
        }
    }
}

/// Pace and side activities of the simulated master.
///
/// [`IDEAL`](Self::IDEAL) answers as fast as a master can; [`IGH`](Self::IGH) has what was measured
/// on IgH 1.6.2 (Debian 6.1, `ec_generic`, 250 ticks per second).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(from = "RawBehaviour")]
pub struct MasterBehaviour {
    /// Microseconds of one step of an SDO transfer before activation; a transfer takes four.
    pub idle_step_us: u32,
    /// After activation the master's thread needs time between a receive and the next send to
    /// advance its state machines with that send. If both follow each other, only every second send
    /// advances them. False: each send does.
    pub needs_gap: bool,
    /// Internal SDO requests are served one after the other over all slaves, after a round of state
    /// polling, and not while a slave is configured. False: at once, slaves in parallel.
    pub serves_in_turn: bool,
    /// A scan in the operation phase takes its steps: SII, and the mapping of each assigned PDO.
    /// False: 200 ms per slave.
    pub scans_in_steps: bool,
    /// The object dictionary of each slave is fetched once after a scan, from 3 s after PREOP on.
    /// Transfers of other programs and blocking calls to that slave get no response during it.
    pub fetches_dictionary: bool,
    /// The bus is scanned again when the master is released.
    pub scans_after_release: bool,
    /// A register request whose configuration has lost its slave stays busy, also when it is started
    /// again. False: as in IgH, the start queues it again.
    pub keeps_lost_requests: bool,
}

impl MasterBehaviour {
    /// As fast as a master can be, without side activities.
    pub const IDEAL: Self = Self {
        idle_step_us: 500,
        needs_gap: false,
        serves_in_turn: false,
        scans_in_steps: false,
        fetches_dictionary: false,
        scans_after_release: false,
        keeps_lost_requests: false,
    };

    /// As IgH 1.6.2. It scans after a release only if a datagram gets lost at the change of its
    /// threads, so `scans_after_release` is false.
    pub const IGH: Self = Self {
        idle_step_us: 8_000,
        needs_gap: true,
        serves_in_turn: true,
        scans_in_steps: true,
        fetches_dictionary: true,
        scans_after_release: false,
        keeps_lost_requests: false,
    };
}

impl Default for MasterBehaviour {
    fn default() -> Self {
        Self::IDEAL
    }
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Model {
    #[default]
    Ideal,
    Igh,
}

/// The table `[master]` of a scenario file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawBehaviour {
    #[serde(default)]
    like: Model,
    idle_step_us: Option<u32>,
    needs_gap: Option<bool>,
    serves_in_turn: Option<bool>,
    scans_in_steps: Option<bool>,
    fetches_dictionary: Option<bool>,
    scans_after_release: Option<bool>,
    keeps_lost_requests: Option<bool>,
}

impl From<RawBehaviour> for MasterBehaviour {
    fn from(raw: RawBehaviour) -> Self {
        let base = match raw.like {
            Model::Ideal => Self::IDEAL,
            Model::Igh => Self::IGH,
        };
        let choose = |given: Option<bool>, default| given.unwrap_or(default);
        Self {
            idle_step_us: raw.idle_step_us.unwrap_or(base.idle_step_us),
            needs_gap: choose(raw.needs_gap, base.needs_gap),
            serves_in_turn: choose(raw.serves_in_turn, base.serves_in_turn),
            scans_in_steps: choose(raw.scans_in_steps, base.scans_in_steps),
            fetches_dictionary: choose(raw.fetches_dictionary, base.fetches_dictionary),
            scans_after_release: choose(raw.scans_after_release, base.scans_after_release),
            keeps_lost_requests: choose(raw.keeps_lost_requests, base.keeps_lost_requests),
        }
    }
}

/// Names of the built-in scenarios.
pub const BUILTIN_SCENARIOS: &[&str] = &["echo", "drives", "jitter"];

/// Gateways with an echo node on each of their channels. The nodes use the bit rates of their
/// channel, so they work with every configuration.
pub fn echo(gateways: usize) -> Scenario {
    let gateways: Vec<_> = (0..gateways).map(GatewaySpec::at).collect();
    let nodes = gateways
        .iter()
        .flat_map(|gateway| &gateway.buses)
        .map(|bus| NodeSpec {
            name: format!("echo {bus}"),
            bus: bus.clone(),
            kind: NodeKind::Echo,
            bitrate: None,
            data_bitrate: None,
            physical_layer: None,
        })
        .collect();
    Scenario { name: "echo".to_owned(), gateways, nodes, ..Scenario::default() }
}

/// The built-in scenario `jitter`: as [`echo`], with the delays of a loaded machine and firmware,
/// to compare the two ways of sending of manual 13.9 in stepped time.
///
/// Half of the application's sleeps end up to 15 us late, one of 100 between 150 and 600 us. A
/// data-path service is late by up to 40 us. Scheduled frames are sent up to 13 us after their
/// phase, which fits the table of 13.9 (the difference of two such delays is below 12 us in 99 of
/// 100 cases).
pub fn jitter(gateways: usize) -> Scenario {
    let mut scenario = echo(gateways);
    "jitter".clone_into(&mut scenario.name);
    scenario.wake_up =
        Some(WakeUpDelay { typical_ns: 15_000, p99_ns: 150_000, longest_ns: 600_000 });
    for gateway in &mut scenario.gateways {
        gateway.config.service_jitter_ns = 40_000;
        gateway.config.release_jitter_ns = 13_000;
    }
    scenario
}

/// Number of drives on each channel of the built-in scenario `drives`.
const DRIVES_PER_CHANNEL: u8 = 4;

/// Gateways with drives on each of their channels: node-IDs 1 to `per_channel` (at most 127), named
/// `drive <gateway>.<channel>/<node-ID>`.
///
/// The built-in scenario `drives` has four per channel: 16 axes with one gateway, 48 with three.
/// The drives use the bit rates of their channel. Their start positions all differ and none is 0:
/// 100000 * gateway + 10000 * channel + 1000 * node-ID + 7 increments.
pub fn drives(gateways: usize, per_channel: u8) -> Scenario {
    let gateways: Vec<_> = (0..gateways).map(GatewaySpec::at).collect();
    let mut nodes = Vec::new();
    for (position, gateway) in gateways.iter().enumerate() {
        for (channel, bus) in gateway.buses.iter().enumerate() {
            let ids = (1..=per_channel.min(NodeId::MAX.get())).filter_map(NodeId::from_raw);
            nodes.extend(ids.map(|node| built_in_drive(position, channel, bus, node)));
        }
    }
    Scenario { name: "drives".to_owned(), gateways, nodes, ..Scenario::default() }
}

fn built_in_drive(gateway: usize, channel: usize, bus: &str, node: NodeId) -> NodeSpec {
    let start_position = 100_000 * gateway + 10_000 * channel + 1_000 * usize::from(node.get()) + 7;
    let config = DriveConfig {
        serial: 1 + start_position as u32,
        motor: MotorConfig {
            start_position: i32::try_from(start_position).unwrap_or(i32::MAX),
            ..MotorConfig::default()
        },
        ..DriveConfig::new(node)
    };
    NodeSpec {
        name: format!("drive {bus}/{node}"),
        bus: bus.to_owned(),
        kind: NodeKind::Drive(Box::new(DriveSpec { config, eds: None })),
        bitrate: None,
        data_bitrate: None,
        physical_layer: None,
    }
}

/// Most gateways of `sim:COUNT`.
pub(crate) const MAX_GATEWAYS: usize = 100;

/// A built-in scenario by its name, or the number of its gateways, which have echo nodes then.
pub(crate) fn by_name(name: &str, gateways: usize) -> Option<Scenario> {
    match name {
        "echo" => Some(echo(gateways)),
        "jitter" => Some(jitter(gateways)),
        "drives" => Some(drives(gateways, DRIVES_PER_CHANNEL)),
        count => {
            let count = count.parse().ok().filter(|count| (1..=MAX_GATEWAYS).contains(count));
            count.map(echo)
        }
    }
}

/// A drive that a program configures.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfiguredDrive {
    /// Gateway of the drive, counted from 0.
    pub gateway: usize,
    /// Channel of the gateway, 0 to 3.
    pub channel: u8,
    /// Node-ID of the drive.
    pub node: NodeId,
    /// Number of axes of the drive, 1 to 8.
    pub axes: u8,
    /// Device file of the drive; `None` is the built-in object dictionary.
    pub eds: Option<PathBuf>,
}

/// Gateways with the drives that a program configures. A channel without any has an echo node.
pub(crate) fn configured(gateways: usize, configured: &[ConfiguredDrive]) -> Scenario {
    let last = configured.iter().map(|drive| drive.gateway + 1).max();
    let mut scenario = echo(gateways.max(last.unwrap_or(0)));
    "drives".clone_into(&mut scenario.name);
    let bus = |drive: &ConfiguredDrive| format!("{}.{}", drive.gateway, drive.channel);
    scenario.nodes.retain(|echo| !configured.iter().any(|drive| bus(drive) == echo.bus));
    scenario.nodes.extend(configured.iter().map(|drive| {
        let ConfiguredDrive { gateway, channel, node, axes, ref eds } = *drive;
        let mut node = built_in_drive(gateway, channel.into(), &bus(drive), node);
        if let NodeKind::Drive(spec) = &mut node.kind {
            spec.config.axes = axes;
            spec.eds.clone_from(eds);
        }
        node
    }));
    scenario
}
