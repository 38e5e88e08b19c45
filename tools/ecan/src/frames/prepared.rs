use std::fmt::Display;

use ecan_command_line::interrupt::Interrupt;
use ecan_protocol::config::McanChannelConfig;
use ecan_sim::ClockKind;

use super::capture::FrameCapture;
use super::options::FrameOptions;
use super::service::{CACHE_DEPTH, GatewaySetup, Service, failure, without_fd};
use super::settings::{GatewayRequirements, Planned, Settings};
use crate::context::{Bus, Context, Failure, Result, note};

/// A checked gateway on an unmodified bus. Create files and threads now, before the real-time
/// settings of the cycle thread are applied.
#[derive(Debug)]
pub struct Prepared<'a> {
    bus: Bus,
    setup: GatewaySetup,
    cache_depth: u32,
    options: &'a FrameOptions,
    pub interrupt: Interrupt,
}

impl<'a> Prepared<'a> {
    pub fn new(
        options: &'a FrameOptions,
        requirements: GatewayRequirements,
        context: &Context,
    ) -> Result<Self> {
        let settings = Settings::of(&options.gateway)?;
        let interrupt = Interrupt::install()?;
        let kind = if requirements.has_end { ClockKind::Stepped } else { ClockKind::Real };
        let bus = settings.open_bus(context, kind)?;
        let Planned { positions, adapter, config, channels } =
            settings.for_one(&bus, requirements, context.global)?;
        let position = positions.first().copied().unwrap_or_default();
        config.check(&adapter).map_err(|faults| failure(position, faults.into()))?;
        let setup = GatewaySetup { position, adapter, config, channels };
        let cache_depth = bus.read(position, 0xF000, 29).unwrap_or(CACHE_DEPTH);
        Ok(Self { bus, setup, cache_depth, options, interrupt })
    }

    pub fn needs_fd(&self, what: impl Display, channel: u8) -> Result {
        match self.has_fd(channel) {
            true => Ok(()),
            false => Err(without_fd(what, channel, self.options.gateway.setup.config.as_deref())),
        }
    }

    pub fn has_fd(&self, channel: u8) -> bool {
        self.can(channel).is_some_and(|can| can.fd)
    }

    /// Configuration of a channel; `None` if it is disabled.
    pub fn can(&self, channel: u8) -> Option<&McanChannelConfig> {
        let gateway = self.setup.config.gateways.first()?;
        gateway.channels.get(usize::from(channel))?.as_ref().map(|it| &it.can)
    }

    /// Starts the gateway, with a capture if requested; `None` if the user stops.
    pub fn enter(self) -> Result<Option<Service>> {
        let Self { bus, setup, cache_depth, options, interrupt } = self;
        let (channels, real_time) = (setup.channels, &options.gateway.real_time);
        let capture = FrameCapture::start(&options.capture, &setup.adapter, channels, &interrupt)?;
        let started = real_time
            .apply(|line| note(line))
            .map_err(Failure::from)
            .and_then(|()| Service::start(bus.ecrt(), setup, real_time, &interrupt));
        let Ok(Some(mut service)) = started else {
            capture.into_iter().for_each(FrameCapture::discard);
            return started;
        };
        service.equip(channels, cache_depth, capture);
        Ok(Some(service))
    }
}
