use std::path::PathBuf;

use ecan_can_io::recording::ReadOptions;
use ecan_protocol::mapping::MAX_PDO_BYTES;
use serde::Deserialize;

use crate::bus::PhysicalLayer;
use crate::drive::DriveConfig;
use crate::fault::ScriptedFault;
use crate::gateway::{GatewayModelConfig, SyncManagerConfig};
use crate::node::{BridgeSpec, FaultyConfig};
use crate::scenario::{IoSpec, MasterBehaviour};
use crate::wake_up::WakeUpDelay;

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
