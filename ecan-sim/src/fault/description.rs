//! The textual form of a fault: the table `[[fault]]` of scenario files, the parameters of the
//! service's `sim.fault`, and the options of `ecan sim fault`.

use ecan_protocol::mapping::CHANNELS;
use serde::{Deserialize, Serialize};

use crate::fault::{DriveFault, Fault, LibraryCall, LossDirection, When};
use crate::gateway::GatewayFault;
use crate::scenario::{NodeKind, NodeSpec, Scenario};

/// A key of a [`FaultDescription`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultKey {
    /// Name. A name that ends in `_ms` is a duration in milliseconds.
    pub name: &'static str,
    /// Type of its value.
    pub value: FaultValue,
    /// Meaning, in one line; with the default of an optional key.
    pub help: &'static str,
}

impl FaultKey {
    /// Returns whether the kinds with this key need it.
    pub fn is_required(&self) -> bool {
        !self.help.contains("[default: ")
    }
}

/// Type of the value of a [`FaultKey`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultValue {
    /// An integer.
    Number,
    /// A text.
    Text,
    /// A number or a name.
    NumberOrText,
}

trait KeyType {
    const VALUE: FaultValue;
}

macro_rules! key_types {
    ($($type:ty => $value:ident,)+) => {
        $( impl KeyType for $type { const VALUE: FaultValue = FaultValue::$value; } )+
    };
}

key_types! {
    u8 => Number, u16 => Number, u32 => Number, u64 => Number, usize => Number,
    i32 => Number, i64 => Number,
    String => Text, LossDirection => Text, LibraryCall => Text,
    toml::Value => NumberOrText,
}

macro_rules! keys {
    ($( $(#[doc = $help:literal])+ $key:ident: $type:ty, )+) => {
        /// A fault as text describes it: its kind, its keys and perhaps its time.
        ///
        /// Made by deserialisation, and checked against a scenario when it is used.
        #[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
        #[serde(deny_unknown_fields)]
        pub struct FaultDescription {
            kind: FaultKind,
            $( #[serde(skip_serializing_if = "Option::is_none")] $key: Option<$type>, )+
        }

        impl FaultDescription {
            /// The keys of the time. A description has at most one of them.
            pub const TIMES: [&str; 5] =
                ["cycle", "at_ms", "after_ms", "after_op_ms", "after_ready_ms"];
            /// The keys besides `kind`, those of the time first.
            pub const KEYS: &[FaultKey] =
                &[$( FaultKey {
                    name: stringify!($key),
                    value: <$type as KeyType>::VALUE,
                    help: concat!($($help),+).trim_ascii(),
                }, )+];
        }
    };
}

keys! {
    /// Time: the n-th send with process data since the start of the simulation, from 1
    cycle: u64,
    /// Time since the start of the simulation
    at_ms: u64,
    /// Time from now; in a scenario file from the start of the simulation
    after_ms: u64,
    /// Time since all gateways are in OP for the first time
    after_op_ms: u64,
    /// Time since the program has all gateways ready for the first time
    after_ready_ms: u64,
    /// Index of the gateway [default: the only one]
    gateway: usize,
    /// Index of the I/O slave [default: the only one]
    io: usize,
    /// Channel, 0 to 3
    channel: usize,
    /// Name of the node
    node: String,
    /// Lost before the first slave (outward) or after the last one (return) [default: outward]
    way: LossDirection,
    /// Number of sends with process data [default: 1]
    cycles: u32,
    /// Difference of the working counter
    offset: i32,
    /// Time without supply [default: 1000 ms]
    off_ms: u32,
    /// Duration
    for_ms: u32,
    /// Index of the object
    index: u16,
    /// Subindex of the object [default: 0]
    subindex: u8,
    /// SDO abort code, AL status code or CiA 402 error code
    code: u32,
    /// Error register of the emergency message [default: 1]
    register: u8,
    /// Number of times [default: 1]
    times: u32,
    /// Function: receive, send, domain_process, domain_queue or domain_state
    call: LibraryCall,
    /// Error number, or its name such as EINTR
    errno: toml::Value,
    /// Jump, in ns
    ns: i64,
    /// Value of the object; excess bits are cut off
    value: i64,
}

macro_rules! kinds {
    ($( $(#[doc = $help:literal])+ $kind:ident $name:literal ($($key:literal),*), )+) => {
        /// Kind of a fault in its textual form.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
        pub enum FaultKind {
            $( $(#[doc = $help])+ #[serde(rename = $name)] $kind, )+
        }

        impl FaultKind {
            /// All kinds.
            pub const ALL: &[Self] = &[$( Self::$kind ),+];

            /// Name in scenario files.
            pub fn name(self) -> &'static str {
                match self { $( Self::$kind => $name ),+ }
            }

            /// The keys of this kind, besides those of the time.
            pub fn keys(self) -> &'static [&'static str] {
                match self { $( Self::$kind => &[$($key),*] ),+ }
            }

            /// Effect, in one line.
            pub fn help(self) -> &'static str {
                match self { $( Self::$kind => concat!($($help),+).trim_ascii() ),+ }
            }
        }
    };
}

kinds! {
    /// The frames of some cycles are lost
    LostFrame "lost_frame" ("way", "cycles"),
    /// The working counters of some cycles are changed
    WorkingCounterOffset "working_counter_offset" ("offset", "cycles"),
    /// The gateway loses its supply, then boots
    PowerCycle "power_cycle" ("gateway", "off_ms"),
    /// The gateway loses its supply
    PowerOff "power_off" ("gateway"),
    /// The gateway gets its supply back and boots
    PowerOn "power_on" ("gateway"),
    /// The cable before the gateway is open
    LinkLoss "link_loss" ("gateway", "for_ms"),
    /// An I/O slave loses its supply, then boots
    IoPowerCycle "io_power_cycle" ("io", "off_ms"),
    /// Transfers of an object are aborted
    SdoAbort "sdo_abort" ("gateway", "index", "subindex", "code", "times"),
    /// Transfers of an object are executed, but their response is lost
    SdoResponseLost "sdo_response_lost" ("gateway", "index", "subindex", "times"),
    /// The mailbox does not respond
    MailboxTimeout "mailbox_timeout" ("gateway", "for_ms"),
    /// TxPDO images are torn: read during an update
    TornImage "torn_image" ("gateway", "times"),
    /// TxPDO images carry a wrong CRC
    CrcError "crc_error" ("gateway", "times"),
    /// The gateway leaves OP with an AL status code
    AlError "al_error" ("gateway", "code"),
    /// The data path of the firmware is blocked
    ServiceStall "service_stall" ("gateway", "for_ms"),
    /// Erasures or writes of the flash fail
    FlashFailure "flash_failure" ("gateway", "times"),
    /// The distributed clock of the gateway jumps
    ClockJump "clock_jump" ("gateway", "ns"),
    /// The CAN controller of a channel becomes bus-off
    BusOff "bus_off" ("gateway", "channel"),
    /// Transmissions of a channel end in error frames
    ErrorFrames "error_frames" ("gateway", "channel", "times"),
    /// A node sends nothing, but acknowledges
    NodeSilent "node_silent" ("node", "for_ms"),
    /// A drive detects a fault
    DriveError "drive_error" ("node", "code"),
    /// A drive sends an emergency message without a change of state
    DriveEmcy "drive_emcy" ("node", "code", "register"),
    /// A drive loses its supply, then boots
    DrivePowerCycle "drive_power_cycle" ("node", "off_ms"),
    /// The CAN controller of a drive is bus-off
    DriveBusOff "drive_bus_off" ("node", "for_ms"),
    /// The motor of a drive is blocked
    DriveBlocked "drive_blocked" ("node", "for_ms"),
    /// An object of a drive or an I/O node gets a value, as an input
    DriveValue "drive_value" ("node", "index", "subindex", "value"),
    /// Calls of a function of the library fail without effect
    LibraryError "library_error" ("call", "errno", "times"),
    /// The master starts no SDO and register requests of the program
    RequestsHeld "requests_held" ("for_ms"),
}

/// Reason why a [`FaultDescription`] does not describe a fault of a scenario.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FaultError {
    /// A scheduled fault has no time.
    #[error("a fault needs one of `{}`", FaultDescription::TIMES.join("`, `"))]
    NoTime,
    /// There are several times.
    #[error("a fault has only one of `{}`", FaultDescription::TIMES.join("`, `"))]
    SeveralTimes,
    /// A necessary key is missing.
    #[error("`{}` needs `{key}`", kind.name())]
    Missing {
        /// Kind.
        kind: FaultKind,
        /// Key.
        key: &'static str,
    },
    /// A key that selects one of several is missing.
    #[error("`{}` needs `{key}`; there are {count}", kind.name())]
    NotSelected {
        /// Kind.
        kind: FaultKind,
        /// Key.
        key: &'static str,
        /// Number of those that exist.
        count: usize,
    },
    /// A key belongs to other kinds.
    #[error("`{key}` does not belong to `{}`; allowed: {}", kind.name(), kind.keys().join(", "))]
    Foreign {
        /// Kind.
        kind: FaultKind,
        /// Key.
        key: String,
    },
    /// The scenario has no such gateway, I/O slave or channel.
    #[error("{what} {number} does not exist; there are {count}")]
    NoSuch {
        /// Noun.
        what: &'static str,
        /// Requested number.
        number: usize,
        /// Number of those that exist, from 0.
        count: usize,
    },
    /// The scenario has no node of this name.
    #[error("node \"{name}\" does not exist; there are: {known}")]
    NoSuchNode {
        /// The name.
        name: String,
        /// Names of those that exist.
        known: String,
    },
    /// The node is no drive.
    #[error("node \"{0}\" is not a drive")]
    NotADrive(String),
    /// The code is too large.
    #[error("`code` of `{}` is out of range; allowed: 0 to 0xFFFF", .0.name())]
    LongCode(FaultKind),
    /// The error number is invalid.
    #[error(
        "invalid `errno`; allowed: a number from 1 to {ERRNO_MAX}, or one of: {}",
        ERRNO_NAMES.map(|(name, _)| name).join(", ")
    )]
    Errno,
}

/// Error numbers that can be given by name.
const ERRNO_NAMES: [(&str, i32); 12] = [
    ("EPERM", libc::EPERM),
    ("ENOENT", libc::ENOENT),
    ("EINTR", libc::EINTR),
    ("EIO", libc::EIO),
    ("ENXIO", libc::ENXIO),
    ("EBADF", libc::EBADF),
    ("EAGAIN", libc::EAGAIN),
    ("ENOMEM", libc::ENOMEM),
    ("EBUSY", libc::EBUSY),
    ("ENODEV", libc::ENODEV),
    ("EINVAL", libc::EINVAL),
    ("ETIMEDOUT", libc::ETIMEDOUT),
];
/// Largest error number of Linux.
const ERRNO_MAX: i64 = 4095;

impl FaultDescription {
    /// The time, if one is given, `now_ns` after the start of the simulation.
    pub(crate) fn when(&self, now_ns: u64) -> Result<Option<When>, FaultError> {
        let ns = |ms: u64| ms.saturating_mul(1_000_000);
        let times = [
            self.cycle.map(When::Cycle),
            self.at_ms.map(|ms| When::At(ns(ms))),
            self.after_ms.map(|ms| When::At(now_ns.saturating_add(ns(ms)))),
            self.after_op_ms.map(|ms| When::AfterOp(ns(ms))),
            self.after_ready_ms.map(|ms| When::AfterReady(ns(ms))),
        ];
        let mut given = times.into_iter().flatten();
        match (given.next(), given.next()) {
            (_, Some(_)) => Err(FaultError::SeveralTimes),
            (when, None) => Ok(when),
        }
    }

    /// The fault, in a scenario that has its gateway or node.
    pub(crate) fn fault(&self, scenario: &Scenario) -> Result<Fault, FaultError> {
        self.check_keys()?;
        Resolver { raw: self, scenario }.fault()
    }

    /// Rejects keys that do not belong to the kind.
    fn check_keys(&self) -> Result<(), FaultError> {
        let kind = self.kind;
        let keys = toml::Table::try_from(self).unwrap_or_default();
        let is_own =
            |key: &str| key == "kind" || Self::TIMES.contains(&key) || kind.keys().contains(&key);
        match keys.into_iter().find(|(key, _)| !is_own(key)) {
            Some((key, _)) => Err(FaultError::Foreign { kind, key }),
            None => Ok(()),
        }
    }
}

struct Resolver<'a> {
    raw: &'a FaultDescription,
    scenario: &'a Scenario,
}

impl Resolver<'_> {
    fn fault(&self) -> Result<Fault, FaultError> {
        use FaultKind as Kind;
        let raw = self.raw;
        let times = raw.times.unwrap_or(1);
        let cycles = raw.cycles.unwrap_or(1);
        let off_ms = raw.off_ms.unwrap_or(1000);
        Ok(match raw.kind {
            Kind::LostFrame => Fault::LostFrame { direction: raw.way.unwrap_or_default(), cycles },
            Kind::WorkingCounterOffset => {
                Fault::WorkingCounterOffset { offset: self.need("offset", raw.offset)?, cycles }
            }
            Kind::PowerCycle => Fault::PowerCycle { gateway: self.gateway()?, off_ms },
            Kind::PowerOff => Fault::PowerOff { gateway: self.gateway()? },
            Kind::PowerOn => Fault::PowerOn { gateway: self.gateway()? },
            Kind::LinkLoss => Fault::LinkLoss { gateway: self.gateway()?, for_ms: self.for_ms()? },
            Kind::IoPowerCycle => {
                let io = self.one_of("I/O", "io", raw.io, self.scenario.ios.len())?;
                Fault::IoPowerCycle { io, off_ms }
            }
            Kind::SdoAbort => self.in_gateway(GatewayFault::SdoAbort {
                index: self.need("index", raw.index)?,
                subindex: raw.subindex.unwrap_or(0),
                code: self.need("code", raw.code)?,
                times,
            })?,
            Kind::SdoResponseLost => self.in_gateway(GatewayFault::SdoResponseLost {
                index: self.need("index", raw.index)?,
                subindex: raw.subindex.unwrap_or(0),
                times,
            })?,
            Kind::MailboxTimeout => {
                self.in_gateway(GatewayFault::MailboxSilent { ms: self.for_ms()? })?
            }
            Kind::TornImage => self.in_gateway(GatewayFault::TornTxPdo { images: times })?,
            Kind::CrcError => self.in_gateway(GatewayFault::CrcErrorTxPdo { images: times })?,
            Kind::AlError => self.in_gateway(GatewayFault::AlError { code: self.short_code()? })?,
            Kind::ServiceStall => {
                self.in_gateway(GatewayFault::ServiceStall { ms: self.for_ms()? })?
            }
            Kind::FlashFailure => self.in_gateway(GatewayFault::FlashFailure { times })?,
            Kind::ClockJump => {
                self.in_gateway(GatewayFault::ClockJump { ns: self.need("ns", raw.ns)? })?
            }
            Kind::BusOff => Fault::BusOff { gateway: self.gateway()?, channel: self.channel()? },
            Kind::ErrorFrames => Fault::ErrorFrames {
                gateway: self.gateway()?,
                channel: self.channel()?,
                frames: times,
            },
            Kind::NodeSilent => {
                Fault::NodeSilent { node: self.node()?.name.clone(), for_ms: self.for_ms()? }
            }
            Kind::DriveError => self.in_drive(DriveFault::Error { code: self.short_code()? })?,
            Kind::DriveEmcy => self.in_drive(DriveFault::Emcy {
                code: self.short_code()?,
                register: raw.register.unwrap_or(1),
            })?,
            Kind::DrivePowerCycle => self.in_drive(DriveFault::PowerCycle { off_ms })?,
            Kind::DriveBusOff => self.in_drive(DriveFault::BusOff { for_ms: self.for_ms()? })?,
            Kind::DriveBlocked => self.in_drive(DriveFault::Blocked { for_ms: self.for_ms()? })?,
            Kind::DriveValue => self.in_drive(DriveFault::Value {
                index: self.need("index", raw.index)?,
                subindex: raw.subindex.unwrap_or(0),
                value: self.need("value", raw.value)?,
            })?,
            Kind::LibraryError => Fault::LibraryError {
                call: self.need("call", raw.call)?,
                errno: errno(&self.need("errno", raw.errno.clone())?)?,
                times,
            },
            Kind::RequestsHeld => Fault::RequestsHeld { for_ms: self.for_ms()? },
        })
    }

    fn in_gateway(&self, fault: GatewayFault) -> Result<Fault, FaultError> {
        Ok(Fault::Gateway { gateway: self.gateway()?, fault })
    }

    fn in_drive(&self, fault: DriveFault) -> Result<Fault, FaultError> {
        let node = self.node()?;
        match node.kind {
            NodeKind::Drive(_) => Ok(Fault::Drive { node: node.name.clone(), fault }),
            _ => Err(FaultError::NotADrive(node.name.clone())),
        }
    }

    fn need<T>(&self, key: &'static str, value: Option<T>) -> Result<T, FaultError> {
        value.ok_or(FaultError::Missing { kind: self.raw.kind, key })
    }

    fn for_ms(&self) -> Result<u32, FaultError> {
        self.need("for_ms", self.raw.for_ms)
    }

    fn short_code(&self) -> Result<u16, FaultError> {
        let code = self.need("code", self.raw.code)?;
        u16::try_from(code).map_err(|_| FaultError::LongCode(self.raw.kind))
    }

    fn node(&self) -> Result<&NodeSpec, FaultError> {
        let name = self.need("node", self.raw.node.as_ref())?;
        let node = self.scenario.nodes.iter().find(|known| known.name == *name);
        node.ok_or_else(|| {
            let known = self.scenario.nodes.iter().map(|node| node.name.as_str());
            FaultError::NoSuchNode {
                name: name.clone(),
                known: known.collect::<Vec<_>>().join(", "),
            }
        })
    }

    fn gateway(&self) -> Result<usize, FaultError> {
        self.one_of("gateway", "gateway", self.raw.gateway, self.scenario.gateways.len())
    }

    /// The given one, or the only one.
    fn one_of(
        &self,
        what: &'static str,
        key: &'static str,
        given: Option<usize>,
        count: usize,
    ) -> Result<usize, FaultError> {
        match (given, count) {
            (Some(number), _) => existing(what, number, count),
            (None, 1) => Ok(0),
            (None, _) => Err(FaultError::NotSelected { kind: self.raw.kind, key, count }),
        }
    }

    fn channel(&self) -> Result<usize, FaultError> {
        existing("channel", self.need("channel", self.raw.channel)?, CHANNELS)
    }
}

fn existing(what: &'static str, number: usize, count: usize) -> Result<usize, FaultError> {
    if number < count { Ok(number) } else { Err(FaultError::NoSuch { what, number, count }) }
}

/// Reads an error number, given as number or name.
fn errno(value: &toml::Value) -> Result<i32, FaultError> {
    let number = match value {
        toml::Value::Integer(number @ 1..=ERRNO_MAX) => i32::try_from(*number).ok(),
        toml::Value::String(name) => {
            ERRNO_NAMES.iter().find(|(known, _)| known == name).map(|(_, number)| *number)
        }
        _ => None,
    };
    number.ok_or(FaultError::Errno)
}
