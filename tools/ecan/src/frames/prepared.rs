//! Preparation of a gateway for the frame commands.

use std::fmt::Display;
use std::path::PathBuf;

use ecan_command_line::interrupt::Interrupt;
use ecan_command_line::real_time::RealTimeArguments;
use ecan_sim::ClockKind;

use crate::bus::Bus;
use crate::failure::Failure;
use crate::frames::capture::{CaptureOptions, FrameCapture};
use crate::frames::service::{CACHE_DEPTH, GatewaySetup, Service, failure, without_fd};
use crate::frames::settings::{GatewayRequirements, Planned, Settings};
use crate::global::GlobalOptions;
use crate::output::Output;

/// A checked gateway on an unmodified bus. Create files and threads now, before the real-time
/// settings of the cycle thread are applied.
#[derive(Debug)]
pub struct Prepared<'a> {
    bus: Bus,
    place: GatewaySetup,
    cache_depth: u32,
    /// Path of the configuration file.
    config_path: Option<PathBuf>,
    real_time: &'a RealTimeArguments,
}

impl<'a> Prepared<'a> {
    /// Finds the library, the master and the selected gateway, and checks its configuration.
    pub fn new(
        settings: &Settings<'a>,
        requirements: GatewayRequirements,
        global: &GlobalOptions,
        output: &Output,
    ) -> Result<Self, Failure> {
        let kind = if requirements.has_end { ClockKind::Stepped } else { ClockKind::Real };
        let bus = settings.open_bus(global, output, kind)?;
        let Planned { positions, adapter, config, channels } =
            settings.for_one(&bus, requirements, global)?;
        let position = positions.first().copied().unwrap_or_default();
        config.check(&adapter).map_err(|faults| failure(position, faults.into()))?;
        let place = GatewaySetup { position, adapter, config, channels };
        let cache_depth = bus.read(position, 0xF000, 29).unwrap_or(CACHE_DEPTH);
        let (config_path, real_time) = (settings.config_path(), settings.real_time());
        Ok(Self { bus, place, cache_depth, config_path, real_time })
    }

    /// Rejects a request for CAN FD on a classic channel.
    pub fn needs_fd(&self, what: impl Display, channel: u8) -> Result<(), Failure> {
        match self.has_fd(channel) {
            true => Ok(()),
            false => Err(without_fd(what, channel, self.config_path.as_deref())),
        }
    }

    /// Returns whether a channel has CAN FD.
    pub fn has_fd(&self, channel: u8) -> bool {
        let gateway = self.place.config.gateways.first();
        let channel = gateway.and_then(|it| it.channels.get(usize::from(channel)));
        channel.is_some_and(|it| it.as_ref().is_some_and(|it| it.can.fd))
    }

    /// Starts the gateway, with a capture if requested; `None` if the user stops.
    pub fn enter(
        self,
        capture: &CaptureOptions,
        interrupt: &Interrupt,
        output: &Output,
    ) -> Result<Option<Service>, Failure> {
        let Self { bus, place, cache_depth, real_time, .. } = self;
        let channels = place.channels;
        let capture = FrameCapture::start(capture, &place.adapter, channels, interrupt)?;
        let started = real_time
            .apply(|line| output.note(line))
            .map_err(|error| Failure::Host(error.to_string()))
            .and_then(|()| Service::start(bus.ecrt(), place, real_time, interrupt, output));
        let Ok(Some(mut service)) = started else {
            capture.into_iter().for_each(FrameCapture::discard);
            return started;
        };
        service.equip(channels, cache_depth, capture);
        Ok(Some(service))
    }
}
