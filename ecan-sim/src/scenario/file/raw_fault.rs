//! Faults in a scenario file.

use serde::Deserialize;

use crate::fault::{DriveFault, Fault, LibraryCall, LossDirection, ScriptedFault, When};
use crate::gateway::GatewayFault;
use crate::scenario::{NodeKind, NodeSpec, Scenario};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawFault {
    kind: RawFaultKind,
    cycle: Option<u64>,
    at_ms: Option<u64>,
    gateway: Option<usize>,
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
    SdoAbort,
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
    DriveBlocked,
    LibraryError,
    RequestsHeld,
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
        let fault = match self.kind {
            RawFaultKind::LostFrame => Fault::LostFrame {
                direction: self.way.take().unwrap_or_default(),
                cycles: self.cycles.take().unwrap_or(1),
            },
            RawFaultKind::WorkingCounterOffset => Fault::WorkingCounterOffset {
                offset: need("offset", self.offset.take())?,
                cycles: self.cycles.take().unwrap_or(1),
            },
            RawFaultKind::PowerCycle => Fault::PowerCycle {
                gateway: self.gateway(scenario)?,
                off_ms: self.off_ms.take().unwrap_or(1000),
            },
            RawFaultKind::PowerOff => Fault::PowerOff { gateway: self.gateway(scenario)? },
            RawFaultKind::LinkLoss => Fault::LinkLoss {
                gateway: self.gateway(scenario)?,
                for_ms: need("for_ms", self.for_ms.take())?,
            },
            RawFaultKind::SdoAbort => {
                let fault = GatewayFault::SdoAbort {
                    index: need("index", self.index.take())?,
                    subindex: self.subindex.take().unwrap_or(0),
                    code: need("code", self.code.take())?,
                    times: self.times.take().unwrap_or(1),
                };
                Fault::Gateway { gateway: self.gateway(scenario)?, fault }
            }
            RawFaultKind::MailboxTimeout => {
                let fault = GatewayFault::MailboxSilent { ms: need("for_ms", self.for_ms.take())? };
                Fault::Gateway { gateway: self.gateway(scenario)?, fault }
            }
            RawFaultKind::TornImage => {
                let fault = GatewayFault::TornTxPdo { images: self.times.take().unwrap_or(1) };
                Fault::Gateway { gateway: self.gateway(scenario)?, fault }
            }
            RawFaultKind::CrcError => {
                let fault = GatewayFault::CrcErrorTxPdo { images: self.times.take().unwrap_or(1) };
                Fault::Gateway { gateway: self.gateway(scenario)?, fault }
            }
            RawFaultKind::AlError => {
                let code = need("code", self.code.take())?;
                let code = u16::try_from(code).map_err(|_| "an AL status code has 16 bits")?;
                let fault = GatewayFault::AlError { code };
                Fault::Gateway { gateway: self.gateway(scenario)?, fault }
            }
            RawFaultKind::ClockJump => {
                let fault = GatewayFault::ClockJump { ns: need("ns", self.ns.take())? };
                Fault::Gateway { gateway: self.gateway(scenario)?, fault }
            }
            RawFaultKind::ServiceStall => {
                let fault = GatewayFault::ServiceStall { ms: need("for_ms", self.for_ms.take())? };
                Fault::Gateway { gateway: self.gateway(scenario)?, fault }
            }
            RawFaultKind::FlashFailure => {
                let fault = GatewayFault::FlashFailure { times: self.times.take().unwrap_or(1) };
                Fault::Gateway { gateway: self.gateway(scenario)?, fault }
            }
            RawFaultKind::BusOff => {
                Fault::BusOff { gateway: self.gateway(scenario)?, channel: self.channel()? }
            }
            RawFaultKind::ErrorFrames => Fault::ErrorFrames {
                gateway: self.gateway(scenario)?,
                channel: self.channel()?,
                frames: self.times.take().unwrap_or(1),
            },
            RawFaultKind::NodeSilent => {
                let node = self.node(scenario)?.name.clone();
                Fault::NodeSilent { node, for_ms: need("for_ms", self.for_ms.take())? }
            }
            RawFaultKind::DriveError => {
                let fault = DriveFault::Error { code: self.error_code()? };
                Fault::Drive { node: self.drive(scenario)?, fault }
            }
            RawFaultKind::DriveEmcy => {
                let register = self.register.take().unwrap_or(1);
                let fault = DriveFault::Emcy { code: self.error_code()?, register };
                Fault::Drive { node: self.drive(scenario)?, fault }
            }
            RawFaultKind::DrivePowerCycle => {
                let fault = DriveFault::PowerCycle { off_ms: self.off_ms.take().unwrap_or(1000) };
                Fault::Drive { node: self.drive(scenario)?, fault }
            }
            RawFaultKind::DriveBlocked => {
                let fault = DriveFault::Blocked { for_ms: need("for_ms", self.for_ms.take())? };
                Fault::Drive { node: self.drive(scenario)?, fault }
            }
            RawFaultKind::LibraryError => Fault::LibraryError {
                call: need("call", self.call.take())?,
                errno: errno(&need("errno", self.errno.take())?)?,
                times: self.times.take().unwrap_or(1),
            },
            RawFaultKind::RequestsHeld => {
                Fault::RequestsHeld { for_ms: need("for_ms", self.for_ms.take())? }
            }
        };
        match self.left_over() {
            Some(key) => Err(format!("`{key}` does not belong to a fault of this kind")),
            None => Ok(ScriptedFault { when, fault }),
        }
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

    fn error_code(&mut self) -> Result<u16, String> {
        let code = need("code", self.code.take())?;
        u16::try_from(code).map_err(|_| "an error code has 16 bits".to_owned())
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

    fn left_over(&self) -> Option<&'static str> {
        let keys = [
            ("gateway", self.gateway.is_some()),
            ("channel", self.channel.is_some()),
            ("node", self.node.is_some()),
            ("way", self.way.is_some()),
            ("cycles", self.cycles.is_some()),
            ("offset", self.offset.is_some()),
            ("off_ms", self.off_ms.is_some()),
            ("for_ms", self.for_ms.is_some()),
            ("index", self.index.is_some()),
            ("subindex", self.subindex.is_some()),
            ("code", self.code.is_some()),
            ("register", self.register.is_some()),
            ("times", self.times.is_some()),
            ("call", self.call.is_some()),
            ("errno", self.errno.is_some()),
            ("ns", self.ns.is_some()),
        ];
        keys.iter().find(|(_, given)| *given).map(|(key, _)| *key)
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
