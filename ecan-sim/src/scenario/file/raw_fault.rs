use serde::{Deserialize, Serialize};

use crate::fault::{DriveFault, Fault, LibraryCall, LossDirection, ScriptedFault, When};
use crate::gateway::GatewayFault;
use crate::scenario::{NodeKind, NodeSpec, Scenario};

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawFault {
    #[serde(skip_serializing)]
    kind: RawFaultKind,
    cycle: Option<u64>,
    at_ms: Option<u64>,
    gateway: Option<usize>,
    io: Option<usize>,
    channel: Option<usize>,
    node: Option<String>,
    way: Option<LossDirection>,
    cycles: Option<u32>,
    offset: Option<i32>,
    off_ms: Option<u32>,
    for_ms: Option<u32>,
    index: Option<u16>,
    subindex: Option<u8>,
    code: Option<u32>,
    register: Option<u8>,
    times: Option<u32>,
    call: Option<LibraryCall>,
    errno: Option<toml::Value>,
    ns: Option<i64>,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "snake_case")]
enum RawFaultKind {
    LostFrame,
    WorkingCounterOffset,
    PowerCycle,
    PowerOff,
    LinkLoss,
    IoPowerCycle,
    SdoAbort,
    SdoResponseLost,
    MailboxTimeout,
    TornImage,
    CrcError,
    AlError,
    ServiceStall,
    FlashFailure,
    ClockJump,
    BusOff,
    ErrorFrames,
    NodeSilent,
    DriveError,
    DriveEmcy,
    DrivePowerCycle,
    DriveBusOff,
    DriveBlocked,
    LibraryError,
    RequestsHeld,
}

/// A fault, the gateway or drive of which is still to be read.
enum Subject {
    Gateway(GatewayFault),
    Drive(DriveFault),
    Other(Fault),
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

impl RawFault {
    pub(super) fn build(mut self, scenario: &Scenario) -> Result<ScriptedFault, String> {
        let when = match (self.cycle.take(), self.at_ms.take()) {
            (Some(cycle), None) => When::Cycle(cycle),
            (None, Some(ms)) => When::At(ms.saturating_mul(1_000_000)),
            _ => return Err("a fault needs either `cycle` or `at_ms`".to_owned()),
        };
        let subject = self.subject(scenario)?;
        let fault = match subject {
            Subject::Gateway(fault) => Fault::Gateway { gateway: self.gateway(scenario)?, fault },
            Subject::Drive(fault) => Fault::Drive { node: self.drive(scenario)?, fault },
            Subject::Other(fault) => fault,
        };
        match self.left_over() {
            Some(key) => Err(format!("`{key}` does not belong to a fault of this kind")),
            None => Ok(ScriptedFault { when, fault }),
        }
    }

    fn subject(&mut self, scenario: &Scenario) -> Result<Subject, String> {
        use RawFaultKind as Kind;
        use Subject::{Drive, Gateway, Other};
        Ok(match self.kind {
            Kind::LostFrame => Other(Fault::LostFrame {
                direction: self.way.take().unwrap_or_default(),
                cycles: self.cycles.take().unwrap_or(1),
            }),
            Kind::WorkingCounterOffset => Other(Fault::WorkingCounterOffset {
                offset: need("offset", self.offset.take())?,
                cycles: self.cycles.take().unwrap_or(1),
            }),
            Kind::PowerCycle => {
                let gateway = self.gateway(scenario)?;
                Other(Fault::PowerCycle { gateway, off_ms: self.off_ms() })
            }
            Kind::PowerOff => Other(Fault::PowerOff { gateway: self.gateway(scenario)? }),
            Kind::LinkLoss => {
                let gateway = self.gateway(scenario)?;
                Other(Fault::LinkLoss { gateway, for_ms: self.for_ms()? })
            }
            Kind::IoPowerCycle => {
                let io = need("io", self.io.take())?;
                let count = scenario.ios.len();
                if io >= count {
                    return Err(format!("I/O {io} does not exist; there are {count}"));
                }
                Other(Fault::IoPowerCycle { io, off_ms: self.off_ms() })
            }
            Kind::SdoAbort => Gateway(GatewayFault::SdoAbort {
                index: need("index", self.index.take())?,
                subindex: self.subindex.take().unwrap_or(0),
                code: need("code", self.code.take())?,
                times: self.times(),
            }),
            Kind::SdoResponseLost => Gateway(GatewayFault::SdoResponseLost {
                index: need("index", self.index.take())?,
                subindex: self.subindex.take().unwrap_or(0),
                times: self.times(),
            }),
            Kind::MailboxTimeout => Gateway(GatewayFault::MailboxSilent { ms: self.for_ms()? }),
            Kind::TornImage => Gateway(GatewayFault::TornTxPdo { images: self.times() }),
            Kind::CrcError => Gateway(GatewayFault::CrcErrorTxPdo { images: self.times() }),
            Kind::AlError => {
                Gateway(GatewayFault::AlError { code: self.short_code("an AL status code")? })
            }
            Kind::ServiceStall => Gateway(GatewayFault::ServiceStall { ms: self.for_ms()? }),
            Kind::FlashFailure => Gateway(GatewayFault::FlashFailure { times: self.times() }),
            Kind::ClockJump => Gateway(GatewayFault::ClockJump { ns: need("ns", self.ns.take())? }),
            Kind::BusOff => {
                let gateway = self.gateway(scenario)?;
                Other(Fault::BusOff { gateway, channel: self.channel()? })
            }
            Kind::ErrorFrames => {
                let (gateway, channel) = (self.gateway(scenario)?, self.channel()?);
                Other(Fault::ErrorFrames { gateway, channel, frames: self.times() })
            }
            Kind::NodeSilent => {
                let node = self.node(scenario)?.name.clone();
                Other(Fault::NodeSilent { node, for_ms: self.for_ms()? })
            }
            Kind::DriveError => {
                Drive(DriveFault::Error { code: self.short_code("an error code")? })
            }
            Kind::DriveEmcy => Drive(DriveFault::Emcy {
                code: self.short_code("an error code")?,
                register: self.register.take().unwrap_or(1),
            }),
            Kind::DrivePowerCycle => Drive(DriveFault::PowerCycle { off_ms: self.off_ms() }),
            Kind::DriveBusOff => Drive(DriveFault::BusOff { for_ms: self.for_ms()? }),
            Kind::DriveBlocked => Drive(DriveFault::Blocked { for_ms: self.for_ms()? }),
            Kind::LibraryError => Other(Fault::LibraryError {
                call: need("call", self.call.take())?,
                errno: errno(&need("errno", self.errno.take())?)?,
                times: self.times(),
            }),
            Kind::RequestsHeld => Other(Fault::RequestsHeld { for_ms: self.for_ms()? }),
        })
    }

    fn times(&mut self) -> u32 {
        self.times.take().unwrap_or(1)
    }

    fn off_ms(&mut self) -> u32 {
        self.off_ms.take().unwrap_or(1000)
    }

    fn for_ms(&mut self) -> Result<u32, String> {
        need("for_ms", self.for_ms.take())
    }

    fn short_code(&mut self, name: &str) -> Result<u16, String> {
        let code = need("code", self.code.take())?;
        u16::try_from(code).map_err(|_| format!("{name} has 16 bits"))
    }

    fn node<'a>(&mut self, scenario: &'a Scenario) -> Result<&'a NodeSpec, String> {
        let name = need("node", self.node.take())?;
        let node = scenario.nodes.iter().find(|known| known.name == name);
        node.ok_or_else(|| format!("node \"{name}\" does not exist"))
    }

    fn drive(&mut self, scenario: &Scenario) -> Result<String, String> {
        let node = self.node(scenario)?;
        match node.kind {
            NodeKind::Drive(_) => Ok(node.name.clone()),
            _ => Err(format!("node \"{}\" is not a drive", node.name)),
        }
    }

    fn gateway(&mut self, scenario: &Scenario) -> Result<usize, String> {
        let gateway = need("gateway", self.gateway.take())?;
        if gateway < scenario.gateways.len() {
            Ok(gateway)
        } else {
            Err(format!("gateway {gateway} does not exist; there are {}", scenario.gateways.len()))
        }
    }

    fn channel(&mut self) -> Result<usize, String> {
        let channel = need("channel", self.channel.take())?;
        if channel < ecan_protocol::mapping::CHANNELS {
            Ok(channel)
        } else {
            Err(format!(
                "channel {channel} does not exist; there are {}",
                ecan_protocol::mapping::CHANNELS
            ))
        }
    }

    /// A key that was not used.
    fn left_over(&self) -> Option<String> {
        let keys = toml::Table::try_from(self).unwrap_or_default();
        keys.into_iter().next().map(|(key, _)| key)
    }
}

fn need<T>(key: &str, value: Option<T>) -> Result<T, String> {
    value.ok_or_else(|| format!("this kind of fault needs `{key}`"))
}

/// Reads an error number, given as number or name.
fn errno(value: &toml::Value) -> Result<i32, String> {
    let number = match value {
        toml::Value::Integer(number @ 1..=ERRNO_MAX) => i32::try_from(*number).ok(),
        toml::Value::String(name) => {
            ERRNO_NAMES.iter().find(|(known, _)| known == name).map(|(_, number)| *number)
        }
        _ => None,
    };
    number.ok_or_else(|| {
        let names: Vec<_> = ERRNO_NAMES.iter().map(|(name, _)| *name).collect();
        format!(
            "invalid `errno`; allowed: a number from 1 to {ERRNO_MAX}, or one of: {}",
            names.join(", ")
        )
    })
}
