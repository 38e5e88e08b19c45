//! The parts of a scenario.

use std::path::PathBuf;

use crate::drive::DriveConfig;
use crate::fault::ScriptedFault;
use crate::gateway::GatewayModelConfig;
use crate::node::BridgeSpec;
use crate::wake_up::WakeUpDelay;

/// How simulated time passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClockKind {
    /// With the system's monotonic clock.
    Real,
    /// As fast as the machine goes: time moves when someone sleeps on the simulation's clock or
    /// waits in a blocking call, and only then. The same program gives the same result each time.
    Stepped,
}

/// The release of libethercat that is simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EcrtVersion {
    /// 1.5.2: many functions return nothing, some do not exist.
    V1_5,
    /// 1.6.2.
    V1_6,
}

impl EcrtVersion {
    /// What `ecrt_version_magic()` returns.
    pub fn magic(self) -> u32 {
        match self {
            Self::V1_5 => 0x105,
            Self::V1_6 => 0x106,
        }
    }
}

/// How the gateways hang on the master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topology {
    /// One behind the other: without one of them the master does not reach those behind it.
    Line,
    /// On a junction each: a missing one leaves the others reachable, but their positions move up.
    Star,
}

/// One gateway.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GatewaySpec {
    /// Station alias; 0 is none.
    pub alias: u16,
    /// Identity and timing.
    pub settings: GatewayModelConfig,
    /// Whether the SII lets the master write 0x1C12 and 0x1C13.
    pub pdo_assign: bool,
    /// Whether the SII lets the master write the mapping objects.
    pub pdo_configuration: bool,
    /// Names of the buses of the four channels.
    pub buses: [String; ecan_protocol::mapping::CHANNELS],
}

impl GatewaySpec {
    /// The gateway at a position, with the default identity and a bus of its own on each channel,
    /// named `<position>.<channel>`.
    pub fn at(position: usize) -> Self {
        let settings = GatewayModelConfig::default();
        Self {
            alias: 0,
            settings: GatewayModelConfig {
                serial: settings.serial.wrapping_add(position as u64),
                ..settings
            },
            pdo_assign: true,
            pdo_configuration: false,
            buses: std::array::from_fn(|channel| format!("{position}.{channel}")),
        }
    }
}

/// What a faulty node does; shares are thousandths of the frames it receives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultyBehaviour {
    /// Answers left out.
    pub drop_permille: u16,
    /// Answers with a wrong byte.
    pub corrupt_permille: u16,
    /// Answers sent twice.
    pub repeat_permille: u16,
    /// Interval in microseconds at which it babbles frames of the highest priority; 0 is never.
    pub babble_us: u32,
}

/// A simulated drive in a scenario.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveSpec {
    /// What it is like.
    pub settings: DriveConfig,
    /// Its EDS; without one it has the built-in object dictionary.
    pub eds: Option<PathBuf>,
}

/// What a node does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NodeKind {
    /// Sends every frame back as it came.
    Echo,
    /// Sends the frames of a candump log at their times, from the moment it is on the bus.
    Replay {
        /// The log.
        file: PathBuf,
    },
    /// Acknowledges, nothing else.
    Silent,
    /// Connects other programs to the bus.
    Bridge(BridgeSpec),
    /// Echoes, badly.
    Faulty(FaultyBehaviour),
    /// A CiA 402 drive.
    Drive(Box<DriveSpec>),
}

/// One node on a bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeSpec {
    /// Its name, for faults.
    pub name: String,
    /// The bus it is on.
    pub bus: String,
    /// What it does.
    pub kind: NodeKind,
    /// Bit rate of arbitration, bit/s; `None` follows the gateway channel on the bus.
    pub bitrate: Option<u32>,
    /// Bit rate of the data phase, bit/s; `None` is classic CAN with a given `bitrate`.
    pub data_bitrate: Option<u32>,
}

/// Everything a simulation is made of. Plain data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scenario {
    /// What the banner calls it.
    pub name: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Clock that the scenario demands; `None` leaves it to the program.
    pub clock: Option<ClockKind>,
    /// How late the application's sleeps end in stepped time; `None` ends them on time.
    pub wake_up: Option<WakeUpDelay>,
    /// Simulated release of the library.
    pub version: EcrtVersion,
    /// Whether the master sends process data of more than 1486 bytes a direction.
    pub carries_large_pdos: bool,
    /// Whether another program holds the master, so that requesting it gives `EBUSY`.
    pub reserved: bool,
    /// How the gateways are connected.
    pub topology: Topology,
    /// The gateways in the order of their positions.
    pub gateways: Vec<GatewaySpec>,
    /// The nodes.
    pub nodes: Vec<NodeSpec>,
    /// The scripted faults.
    pub faults: Vec<ScriptedFault>,
}

impl Default for Scenario {
    /// No gateway, no node: a master with nothing on its link.
    fn default() -> Self {
        Self {
            name: "empty".to_owned(),
            seed: 1,
            clock: None,
            wake_up: None,
            version: EcrtVersion::V1_6,
            carries_large_pdos: false,
            reserved: false,
            topology: Topology::Line,
            gateways: Vec::new(),
            nodes: Vec::new(),
            faults: Vec::new(),
        }
    }
}
