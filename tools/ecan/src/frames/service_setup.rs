//! Configuration of the gateways of a service, checked against the requirements of a command.

use ecan_host::{AdapterConfig, SlaveConfig};
use ecan_lite::config::{ResolvedGateway, find};
use ecan_mcan_port::PortConfig;
use ecan_protocol::config::{List, McanChannelConfig, NodeMode};
use ecan_protocol::mapping::Direction;
use ecan_service::protocol::Access;

use crate::config_file::resolve_failure;
use crate::context::{Bus, Failure, Result};
use crate::frames::channels::{Channels, can_config};
use crate::frames::options::SetupOptions;
use crate::frames::settings::{GatewayRequirements, Planned};
use crate::service_access::ServiceConnection;

/// The selected gateways of a service.
#[derive(Debug)]
pub struct ServiceSetup {
    pub connection: ServiceConnection,
    /// Index in the service and position of each gateway.
    pub gateways: Vec<(u16, u16)>,
}

/// Selects the gateways of a service for a command: the selected or only one, or all.
pub fn of_service(
    connection: &ServiceConnection,
    bus: &Bus,
    requirements: GatewayRequirements,
    options: &SetupOptions,
    is_for_all: bool,
) -> Result<(ServiceSetup, Planned)> {
    let (setup, mut planned) = gateways_of_service(connection, bus, is_for_all)?;
    planned.requested = requirements.channels;
    let program = connection.program();
    check(&program, &planned, requirements, options)?;
    let is_sending = requirements.directions == [Direction::RxPdo];
    if let (true, Access::Read) = (is_sending, connection.hello().access) {
        let reason = connection.read_only_reason();
        return Err(Failure::Master(format!("{program} does not accept frames: {reason}")));
    }
    Ok((setup, planned))
}

/// The selected or only gateway of a service, or all, with their configuration.
pub fn gateways_of_service(
    connection: &ServiceConnection,
    bus: &Bus,
    is_for_all: bool,
) -> Result<(ServiceSetup, Planned)> {
    let program = connection.program();
    let config = connection.client().config();
    let config = config.map_err(|error| Failure::Device(connection.error("config", &error)))?;
    let unreadable = |error: serde_json::Error| {
        Failure::Master(format!("{program}: configuration cannot be read: {error}"))
    };
    let adapter: AdapterConfig = serde_json::from_value(config.adapter).map_err(unreadable)?;
    let port: PortConfig = serde_json::from_value(config.port).map_err(unreadable)?;
    let resolved = find(bus.diagnostics(), &adapter.slaves);
    // A gateway that is lost does not prevent the commands for the others.
    let resolved = resolved.or_else(|error| by_position(&adapter.slaves).ok_or(error));
    let mut resolved = resolved.map_err(resolve_failure)?;
    if bus.is_chosen() || (!is_for_all && resolved.len() > 1) {
        let chosen = bus.slave()?;
        resolved.retain(|it| it.slave == chosen);
        if resolved.is_empty() {
            let message = format!("slave {chosen} is not a gateway of {program}");
            return Err(Failure::Slave(message));
        }
    }
    let mut planned = Planned {
        positions: resolved.iter().map(|it| it.slave).collect(),
        adapter: AdapterConfig { slaves: List::new(), startup: List::new(), ..adapter },
        config: PortConfig::default(),
        requested: Channels::ALL,
    };
    for ResolvedGateway { gateway, .. } in &resolved {
        let slave = adapter.slaves.get(*gateway).copied();
        slave.into_iter().try_for_each(|it| planned.adapter.slaves.push(it)).map_err(full)?;
        planned.config.add_gateway_of(&port, *gateway).map_err(full)?;
    }
    let small = |value: usize| u16::try_from(value).unwrap_or(u16::MAX);
    let gateways = resolved.iter().map(|it| (small(it.gateway), small(it.slave))).collect();
    Ok((ServiceSetup { connection: connection.clone(), gateways }, planned))
}

/// Gateways whose configuration names their position on the bus, also without a response.
fn by_position(slaves: &[SlaveConfig]) -> Option<Vec<ResolvedGateway>> {
    let resolved = |(gateway, slave): (usize, &SlaveConfig)| {
        let slave = (slave.alias == 0).then(|| usize::from(slave.position))?;
        Some(ResolvedGateway { gateway, slave })
    };
    slaves.iter().enumerate().map(resolved).collect()
}

fn full(error: impl std::fmt::Display) -> Failure {
    Failure::Master(error.to_string())
}

/// Rejects requirements and options that contradict the configuration of the service.
fn check(
    program: &str,
    planned: &Planned,
    requirements: GatewayRequirements,
    options: &SetupOptions,
) -> Result {
    let rejected = |option: &str, active: String| {
        Err(Failure::Usage(format!(
            "{option} contradicts the configuration of {program}: {active}; remove the option, or \
             change the configuration of the service"
        )))
    };
    if options.config.is_some() {
        return rejected("--config", "it has configured the gateways".to_owned());
    }
    if requirements.has_device_time {
        let message = format!("{program} does not carry the gateway's time stamps");
        return Err(Failure::Usage(message));
    }
    for (gateway, position) in planned.positions.iter().enumerate() {
        let config = planned.config.gateways.get(gateway).copied().unwrap_or_default();
        let enabled = Channels::of_mask(config.channel_mask());
        for channel in requirements.required.iter() {
            if !enabled.contains(channel) {
                return Err(Failure::Usage(format!(
                    "channel {channel} of slave {position} is not enabled by {program}; enabled: \
                     {enabled}"
                )));
            }
            let missing = requirements.directions.iter().find(|it| !config.carries(**it, channel));
            if let Some(direction) = missing {
                return Err(Failure::Usage(format!(
                    "channel {channel} of slave {position} is not among the channels of the \
                     {direction} of {program}"
                )));
            }
        }
        for channel in requirements.channels.iter() {
            let Some(can) = can_config(&planned.config, gateway, channel) else { continue };
            let McanChannelConfig { nominal_bitrate, data_bitrate, fd, node_mode, .. } = can;
            if options.bitrate.is_some_and(|it| it != *nominal_bitrate) {
                return rejected("--bitrate", format!("{nominal_bitrate} bit/s on can{channel}"));
            }
            if options.data_bitrate.is_some_and(|it| !fd || it != *data_bitrate) {
                let active = match fd {
                    true => format!("{data_bitrate} bit/s on can{channel}"),
                    false => format!("classic CAN on can{channel}"),
                };
                return rejected("--data-bitrate", active);
            }
            if requirements.is_listening && *node_mode != NodeMode::Listen {
                return rejected("--listen-only", format!("can{channel} acknowledges frames"));
            }
        }
    }
    Ok(())
}
