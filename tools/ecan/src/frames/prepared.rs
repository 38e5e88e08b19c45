//! Preparation of a frame command: the checked gateways before they are started.

use std::fmt::Display;

use ecan_protocol::config::McanChannelConfig;
use ecan_sim::ClockKind;
use ecan_tool_support::command_line::interrupt::Interrupt;

use super::capture::FrameCapture;
use super::link::FrameLink;
use super::options::FrameOptions;
use super::port_link::PortLink;
use super::service::{CACHE_DEPTH, ServedGateway, Service, without_fd};
use super::service_link::ServiceLink;
use super::settings::{GatewayRequirements, Planned, ServiceSetup, Settings, of_service};
use crate::context::{Bus, Context, Failure, Result, note};
use crate::frames::channels::{Channels, can_config};

/// Longest observed time until the gateways of a service are ready.
const READY_NS: u64 = 10_000_000_000;

/// Checked gateways on an unmodified bus. Create files and threads now, before the real-time
/// settings of the cycle thread are applied.
#[derive(Debug)]
pub struct Prepared<'a> {
    bus: Bus,
    planned: Planned,
    /// The gateways of a service; `None` for a cycle of this program.
    service: Option<ServiceSetup>,
    cache_depths: Vec<u32>,
    options: &'a FrameOptions,
    /// The command ends by itself, not with a service.
    has_end: bool,
    pub interrupt: Interrupt,
}

impl<'a> Prepared<'a> {
    /// Checks the selected or only gateway.
    pub fn new(
        options: &'a FrameOptions,
        requirements: GatewayRequirements,
        context: &Context,
    ) -> Result<Self> {
        Self::with(options, requirements, context, false)
    }

    /// Checks the selected gateway, or all of the file or bus.
    pub fn for_all(
        options: &'a FrameOptions,
        requirements: GatewayRequirements,
        context: &Context,
    ) -> Result<Self> {
        Self::with(options, requirements, context, true)
    }

    fn with(
        options: &'a FrameOptions,
        requirements: GatewayRequirements,
        context: &Context,
        is_for_all: bool,
    ) -> Result<Self> {
        let settings = Settings::of(&options.gateway)?;
        let interrupt = Interrupt::install()?;
        let kind = if requirements.has_end { ClockKind::Stepped } else { ClockKind::Real };
        let bus = settings.open_bus(context, kind)?;
        let (service, planned) = match bus.service() {
            Some(connection) => {
                let setup = &options.gateway.setup;
                let found = of_service(connection, &bus, requirements, setup, is_for_all)?;
                (Some(found.0), found.1)
            }
            None => {
                let planned = match is_for_all {
                    false => settings.for_one(&bus, requirements, context.global)?,
                    true => settings.for_all(&bus, requirements, context.global)?,
                };
                let faults = planned.config.check(&planned.adapter);
                faults.map_err(|faults| planned.failure(faults.into()))?;
                (None, planned)
            }
        };
        let depth = |position: &usize| bus.read(*position, 0xF000, 29).unwrap_or(CACHE_DEPTH);
        let cache_depths = planned.positions.iter().map(depth).collect();
        let has_end = requirements.has_end;
        Ok(Self { bus, planned, service, cache_depths, options, has_end, interrupt })
    }

    /// Rejects CAN FD frames for a classic channel of the only gateway.
    pub fn needs_fd(&self, what: impl Display, channel: u8) -> Result {
        match self.has_fd(channel) {
            true => Ok(()),
            false => Err(without_fd(what, channel, self.options.gateway.setup.config.as_deref())),
        }
    }

    /// Returns whether a channel of the only gateway is configured for CAN FD.
    pub fn has_fd(&self, channel: u8) -> bool {
        self.can(0, channel).is_some_and(|can| can.fd)
    }

    pub fn gateways(&self) -> usize {
        self.planned.positions.len()
    }

    /// Configuration of a channel; `None` if it is disabled.
    pub fn can(&self, gateway: usize, channel: u8) -> Option<&McanChannelConfig> {
        can_config(&self.planned.config, gateway, channel)
    }

    /// As [`enter`](Self::enter), and waits until the gateways are ready: a service may have begun to
    /// configure them just now.
    pub fn enter_ready(self) -> Result<Option<Service>> {
        let Some(mut service) = self.enter()? else { return Ok(None) };
        while let Some(gateway) = service.lost_gateway() {
            let cycle = service.begin();
            service.end(cycle)?;
            if service.is_interrupted() {
                return service.finish().map(|()| None);
            }
            if service.response_ns() > READY_NS {
                service.finish()?;
                let reason = format!("still {} after 10 s", service.condition(gateway).session);
                return Err(Failure::NotReady { position: service.position(gateway), reason });
            }
        }
        Ok(Some(service))
    }

    /// Starts the gateways, with a capture if requested; `None` if the user stops.
    pub fn enter(self) -> Result<Option<Service>> {
        let Self { bus, planned, service, cache_depths, options, has_end, interrupt } = self;
        let channels = planned.channels();
        let real_time = &options.gateway.real_time;
        let capture =
            FrameCapture::start(&options.capture, &planned.adapter, &channels, &interrupt)?;
        let config = (planned.adapter, planned.config);
        let started = match service {
            Some(ServiceSetup { connection, gateways }) => {
                let has_images = options.capture.has_images();
                let subscribed = (planned.requested, has_images);
                let link = ServiceLink::start(connection, config, &gateways, subscribed)
                    .map(|link| link.reconnecting(!has_end));
                link.map(box_link)
            }
            None => real_time.apply(|line| note(line)).map_err(Failure::from).and_then(|()| {
                let link = PortLink::start(bus.ecrt()?, config, real_time, &interrupt);
                let link = link.map_err(|error| planned.failure(error))?;
                Ok(link.and_then(box_link))
            }),
        };
        let Ok(Some(link)) = started else {
            capture.into_iter().for_each(FrameCapture::discard);
            return started.map(|_| None);
        };
        let of_gateway = |((position, channels), cache_depth): ((&usize, Channels), u32)| {
            ServedGateway { position: *position, channels, cache_depth }
        };
        let gateways = planned.positions.iter().zip(channels).zip(cache_depths).map(of_gateway);
        Ok(Some(Service::new(link, gateways.collect(), capture, interrupt)))
    }
}

fn box_link(link: impl FrameLink + 'static) -> Option<Box<dyn FrameLink>> {
    Some(Box::new(link))
}
