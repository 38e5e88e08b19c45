//! Gateway configuration from options, from a configuration file, or from a service whose gateways it must match.

use std::path::{Path, PathBuf};

use ecan_host::{AdapterConfig, SlaveConfig};
use ecan_lite::config::{ResolvedGateway, find};
use ecan_mcan_port::{Config, GatewayConfig, MAX_GATEWAYS, PortConfig, PortError};
use ecan_protocol::config::{List, McanChannelConfig, NodeMode};
use ecan_protocol::image::{EncapsulationProfile, OptionFlags};
use ecan_protocol::mapping::Direction;
use ecan_protocol::text::Printable;
use ecan_service::protocol::Access;
use ecan_sim::ClockKind;

use super::channels::{Channels, bit_rates_of, can_config};
use super::options::{GatewayOptions, SetupOptions};
use super::service::failure;
use crate::config_file::{self, resolve_failure};
use crate::context::{Bus, Context, Failure, GlobalOptions, Result};
use crate::service_access::ServiceConnection;

#[derive(Clone, Copy, Debug)]
pub struct GatewayRequirements {
    pub channels: Channels,
    /// Channels that must exist.
    pub required: Channels,
    /// Directions in which the required channels must carry frames.
    pub directions: &'static [Direction],
    pub is_listening: bool,
    /// Received frames need time stamps of the gateway.
    pub has_device_time: bool,
    pub has_results: bool,
    /// The command ends, so a simulation need not run in real time.
    pub has_end: bool,
}

impl GatewayRequirements {
    /// Requirements for channels; listed ones must exist.
    pub fn on(channels: Channels) -> Self {
        Self {
            channels,
            required: if channels.is_all() { Channels::NONE } else { channels },
            directions: &[],
            is_listening: false,
            has_device_time: false,
            has_results: false,
            has_end: true,
        }
    }

    /// Requirements of `ecan serve`.
    pub fn of_service() -> Self {
        Self { has_results: true, has_end: false, ..Self::on(Channels::ALL) }
    }

    pub fn apply(self, gateway: &mut GatewayConfig) {
        if self.has_results {
            gateway.tx_options = gateway.tx_options.with(OptionFlags::TX_RESULT);
        }
        if self.has_device_time {
            use EncapsulationProfile::{
                Compact, CompactTimestamped, Window64, Window64Timestamped,
            };
            gateway.tx_encapsulation = match gateway.tx_encapsulation {
                Compact | CompactTimestamped => CompactTimestamped,
                Window64 | Window64Timestamped => Window64Timestamped,
            };
        }
        if self.is_listening {
            for channel in gateway.channels.iter_mut().flatten() {
                channel.can.node_mode = NodeMode::Listen;
            }
        }
    }
}

#[derive(Clone, Debug)]
pub struct Planned {
    pub positions: Vec<usize>,
    pub adapter: AdapterConfig,
    pub config: PortConfig,
    /// Requested channels.
    pub requested: Channels,
}

impl Planned {
    /// Channels of the command on each gateway.
    pub fn channels(&self) -> Vec<Channels> {
        let enabled = |gateway: &GatewayConfig| Channels::of_mask(gateway.channel_mask());
        self.config
            .gateways
            .iter()
            .map(|gateway| enabled(gateway).intersection(self.requested))
            .collect()
    }

    /// Error of the gateways, with the position of the only one, or of the one that it names.
    pub fn failure(&self, error: PortError) -> Failure {
        let index = match &error {
            PortError::NotReady { slave, .. } => *slave,
            _ => 0,
        };
        match failure(self.positions.get(index).copied().unwrap_or_default(), error) {
            Failure::NotReady { reason, .. } if self.positions.len() > 1 => {
                Failure::Rejected(reason)
            }
            other => other,
        }
    }
}

#[derive(Debug)]
pub struct Settings<'a> {
    options: &'a GatewayOptions,
    file: Option<(PathBuf, Config)>,
}

impl<'a> Settings<'a> {
    pub fn of(options: &'a GatewayOptions) -> Result<Self> {
        let file = match &options.setup.config {
            Some(path) => Some((path.clone(), config_file::read(path)?)),
            None => None,
        };
        Ok(Self { options, file })
    }

    /// Master of the file, unless the user selects another.
    pub fn master(&self, global: &GlobalOptions) -> u32 {
        self.file.as_ref().map_or(global.master(), |(_, file)| config_file::master(file, global))
    }

    /// Replaces the file.
    pub fn set_file(&mut self, path: PathBuf, file: Config) {
        self.file = Some((path, file));
    }

    /// Takes over the limits of another configuration of the same gateways.
    pub fn set_limits(&mut self, config: &PortConfig) {
        let gateways = self.file.iter_mut().flat_map(|(_, file)| &mut *file.port.gateways);
        gateways.zip(&config.gateways).for_each(|(active, new)| active.set_limits(new));
    }

    pub fn open_bus(&self, context: &Context, clock: ClockKind) -> Result<Bus> {
        let options =
            config_file::ecrt_options(self.file.as_ref().map(|(path, _)| path.as_path()))?;
        context.bus_of_master(self.master(context.global), clock, options)
    }

    /// Configuration for the selected or only gateway.
    pub fn for_one(
        &self,
        bus: &Bus,
        requirements: GatewayRequirements,
        global: &GlobalOptions,
    ) -> Result<Planned> {
        let Some((path, file)) = &self.file else {
            return self.of_options(bus, vec![bus.slave()?], requirements, global.master());
        };
        let resolved = config_file::resolve(file, bus)?;
        match resolved[..] {
            [only] => of_file(path, file, &[only], requirements, global),
            [] => Err(no_gateway(path)),
            [..] => {
                let slaves: Vec<_> =
                    resolved.iter().map(|gateway| gateway.slave.to_string()).collect();
                Err(Failure::Slave(format!(
                    "{} describes several gateways; select one with --slave: {}",
                    Printable(path.display()),
                    slaves.join(", ")
                )))
            }
        }
    }

    /// Configuration for the selected gateway, or for all of the file or bus.
    pub fn for_all(
        &self,
        bus: &Bus,
        requirements: GatewayRequirements,
        global: &GlobalOptions,
    ) -> Result<Planned> {
        if let Some((path, file)) = &self.file {
            return of_whole_file(path, file, bus, requirements, global);
        }
        let positions = bus.chosen_or_every_gateway()?;
        self.of_options(bus, positions, requirements, global.master())
    }

    /// Configuration from the options; default bit rates are those of each gateway.
    fn of_options(
        &self,
        bus: &Bus,
        positions: Vec<usize>,
        requirements: GatewayRequirements,
        master: u32,
    ) -> Result<Planned> {
        let setup = &self.options.setup;
        let mut config = PortConfig::default();
        for position in &positions {
            let mut gateway = GatewayConfig::default();
            for (channel, slot) in (0..).zip(&mut gateway.channels) {
                if requirements.channels.contains(channel) {
                    let own = || bit_rates_of(bus, *position, channel);
                    *slot = Some(setup.channel(own)?);
                }
            }
            requirements.apply(&mut gateway);
            config.gateways.push(gateway).map_err(|_| too_many(positions.len()))?;
        }
        let mut adapter = setup.adapter(&config);
        adapter.master_index = master;
        for (slave, position) in adapter.slaves.iter_mut().zip(&positions) {
            slave.position = u16::try_from(*position)
                .map_err(|_| Failure::Slave(format!("slave {position} does not exist")))?;
        }
        Ok(Planned { positions, adapter, config, requested: requirements.channels })
    }
}

/// Configuration for the selected gateway of a file, or for all.
pub fn of_whole_file(
    path: &Path,
    file: &Config,
    bus: &Bus,
    requirements: GatewayRequirements,
    global: &GlobalOptions,
) -> Result<Planned> {
    of_file(path, file, &config_file::resolve(file, bus)?, requirements, global)
}

/// As [`of_whole_file`], without a bus: the positions are those of the file.
pub fn of_file_offline(
    path: &Path,
    file: &Config,
    requirements: GatewayRequirements,
    global: &GlobalOptions,
) -> Result<Planned> {
    let slaves = file.adapter.slaves.iter().enumerate();
    let resolved = slaves
        .map(|(gateway, it)| ResolvedGateway { gateway, slave: usize::from(it.position) })
        .collect::<Vec<_>>();
    of_file(path, file, &resolved, requirements, global)
}

/// Configuration from a file. All its channels are enabled; the command uses the requested ones.
fn of_file(
    path: &Path,
    file: &Config,
    resolved: &[ResolvedGateway],
    requirements: GatewayRequirements,
    global: &GlobalOptions,
) -> Result<Planned> {
    let mut adapter = AdapterConfig { slaves: List::new(), startup: List::new(), ..file.adapter };
    adapter.master_index = config_file::master(file, global);
    if let Some(dc) = &mut adapter.dc {
        // If the reference clock is not among these gateways, the master selects one.
        let index = |gateway| resolved.iter().position(|found| found.gateway == gateway);
        dc.reference = dc.reference.and_then(index);
    }
    let mut config = PortConfig::default();
    for found in resolved {
        let slave = file.adapter.slaves.get(found.gateway);
        let gateway = file.port.gateways.get(found.gateway);
        let (Some(slave), Some(gateway)) = (slave, gateway) else { return Err(no_gateway(path)) };
        let enabled = Channels::of_mask(gateway.channel_mask());
        if let Some(missing) =
            requirements.required.iter().find(|channel| !enabled.contains(*channel))
        {
            return Err(Failure::Usage(format!(
                "channel {missing} is not in {}; gateway {} has {enabled}",
                Printable(path.display()),
                found.gateway
            )));
        }
        for direction in requirements.directions {
            let is_missing = |channel: &u8| !gateway.carries(*direction, *channel);
            if let Some(missing) = requirements.required.iter().find(is_missing) {
                let only = match direction {
                    Direction::TxPdo => "only sends",
                    Direction::RxPdo => "only receives",
                };
                return Err(Failure::Usage(format!(
                    "channel {missing} of gateway {} {only} in {}: it is not among the `channels` \
                     of the {direction}",
                    found.gateway,
                    Printable(path.display())
                )));
            }
        }
        config.add_gateway_of(&file.port, found.gateway).map_err(|_| too_many(resolved.len()))?;
        if let Some(gateway) = config.gateways.last_mut() {
            requirements.apply(gateway);
        }
        let full =
            |_| Failure::Usage(format!("{} has too many gateways", Printable(path.display())));
        for step in file.adapter.startup_of(found.gateway) {
            adapter.add_startup(adapter.slaves.len(), step).map_err(full)?;
        }
        adapter.slaves.push(*slave).map_err(full)?;
    }
    if resolved.is_empty() {
        return Err(no_gateway(path));
    }
    let positions = resolved.iter().map(|gateway| gateway.slave).collect();
    Ok(Planned { positions, adapter, config, requested: requirements.channels })
}

fn too_many(count: usize) -> Failure {
    Failure::Slave(format!("{count} gateways are too many; allowed: at most {MAX_GATEWAYS}"))
}

fn no_gateway(path: &Path) -> Failure {
    Failure::file("use", path, "the file describes no gateway")
}

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
        resolved.retain(|gateway| gateway.slave == chosen);
        if resolved.is_empty() {
            let message = format!("slave {chosen} is not a gateway of {program}");
            return Err(Failure::Slave(message));
        }
    }
    let mut planned = Planned {
        positions: resolved.iter().map(|gateway| gateway.slave).collect(),
        adapter: AdapterConfig { slaves: List::new(), startup: List::new(), ..adapter },
        config: PortConfig::default(),
        requested: Channels::ALL,
    };
    for ResolvedGateway { gateway, .. } in &resolved {
        let slave = adapter.slaves.get(*gateway).copied();
        slave.into_iter().try_for_each(|slave| planned.adapter.slaves.push(slave)).map_err(full)?;
        planned.config.add_gateway_of(&port, *gateway).map_err(full)?;
    }
    let small = |value: usize| u16::try_from(value).unwrap_or(u16::MAX);
    let gateways =
        resolved.iter().map(|gateway| (small(gateway.gateway), small(gateway.slave))).collect();
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
    let rejection = |option: &str, active: String| {
        Err(Failure::Usage(format!(
            "{option} contradicts the configuration of {program}: {active}; remove the option, or \
             change the configuration of the service"
        )))
    };
    if options.config.is_some() {
        return rejection("--config", "it has configured the gateways".to_owned());
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
            let missing = requirements
                .directions
                .iter()
                .find(|direction| !config.carries(**direction, channel));
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
            if options.bitrate.is_some_and(|bitrate| bitrate != *nominal_bitrate) {
                return rejection("--bitrate", format!("{nominal_bitrate} bit/s on can{channel}"));
            }
            if options.data_bitrate.is_some_and(|rate| !fd || rate != *data_bitrate) {
                let active = match fd {
                    true => format!("{data_bitrate} bit/s on can{channel}"),
                    false => format!("classic CAN on can{channel}"),
                };
                return rejection("--data-bitrate", active);
            }
            if requirements.is_listening && *node_mode != NodeMode::Listen {
                return rejection("--listen-only", format!("can{channel} acknowledges frames"));
            }
        }
    }
    Ok(())
}
