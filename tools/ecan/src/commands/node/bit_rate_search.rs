//! Search for the bit rate of each channel.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use ecan_canopen::{NodeId, object};

use super::node_client::requirements;
use super::node_link::{NodeLink, SdoRequest};
use super::node_target::NodeTarget;
use crate::context;
use crate::context::{Context, Failure, GlobalOptions, Result, note};
use crate::frames::{Channels, FrameOptions, GatewayRequirements, Prepared};
use crate::slave_choice::SlaveChoice;

/// The bit rates of CiA 301 (5.4) in bit/s, the most usual first.
const RATES: [u32; 9] =
    [1_000_000, 500_000, 250_000, 125_000, 800_000, 100_000, 50_000, 20_000, 10_000];
/// Time for the acknowledgement of a request.
const ACKNOWLEDGEMENT: Duration = Duration::from_millis(200);

/// Position of a gateway, and channel.
type Place = (usize, u8);

#[derive(Debug, Default)]
pub struct Searched {
    /// Channels by the position of their gateway and their bit rate.
    pub found: BTreeMap<(usize, u32), Vec<u8>>,
    /// Channels without a bit rate.
    pub silent: Vec<Place>,
}

/// Searches by listening, then by a request on channels without frames.
pub fn search(
    options: &FrameOptions,
    channels: Channels,
    listen: Duration,
    context: &Context,
) -> Result<Searched> {
    if let Some(connection) = context::connect(context.global, context.global.master())? {
        let program = connection.program();
        return Err(Failure::Usage(format!(
            "--bitrates needs the gateways alone, and {program} has configured their bit rates; \
             remove --bitrates, or end that program"
        )));
    }
    let mut search = Search { options, context, open: None, searched: Searched::default() };
    for is_listening in [true, false] {
        for rate in RATES {
            if search.open.as_ref().is_some_and(BTreeSet::is_empty) {
                break;
            }
            let what = if is_listening { "listening" } else { "sending a request" };
            context.output.progress(format_args!("# {what} at {rate} bit/s"));
            match is_listening {
                true => search.listen(rate, channels, listen)?,
                false => search.ask(rate)?,
            }
        }
    }
    let Search { open, mut searched, .. } = search;
    searched.silent = open.unwrap_or_default().into_iter().collect();
    Ok(searched)
}

struct Search<'a> {
    options: &'a FrameOptions,
    context: &'a Context<'a>,
    /// Channels without a bit rate yet; `None` before the first gateway was seen.
    open: Option<BTreeSet<Place>>,
    searched: Searched,
}

impl Search<'_> {
    /// Starts the gateways at a bit rate, all or the one at a position.
    fn enter(&mut self, rate: u32, channels: Channels, only: Option<usize>) -> Result<NodeLink> {
        let is_listening = only.is_none();
        let global = match only {
            Some(position) => of_slave(self.context.global, position),
            None => self.context.global.clone(),
        };
        let context = Context { global: &global, output: self.context.output };
        let options = self.options.at_bit_rate(rate);
        let requirements = GatewayRequirements {
            is_listening,
            has_results: !is_listening,
            ..requirements(channels, true)
        };
        let prepared = Prepared::for_all(&options, requirements, &context)?;
        let stopped = || Failure::Incomplete("stopped during the search for bit rates".to_owned());
        let link = NodeLink::new(prepared.enter_ready()?.ok_or_else(stopped)?);
        let service = &link.service;
        let places = (0..service.gateways()).flat_map(|gateway| {
            let position = service.position(gateway);
            service.channels(gateway).iter().map(move |channel| (position, channel))
        });
        if self.open.is_none() {
            self.open = Some(places.collect());
        }
        Ok(link)
    }

    fn take(&mut self, place: Place, rate: u32) {
        if self.open.as_mut().is_some_and(|open| open.remove(&place)) {
            note(format_args!("# slave {} can{}: {rate} bit/s", place.0, place.1));
            self.searched.found.entry((place.0, rate)).or_default().push(place.1);
        }
    }

    /// Takes the channels on which frames arrive.
    fn listen(&mut self, rate: u32, channels: Channels, time: Duration) -> Result {
        let mut link = self.enter(rate, channels, None)?;
        let end_ns = link.service.response_ns() + time.as_nanos() as u64;
        let mut active = BTreeSet::new();
        let listened = loop {
            let cycle = link.cycle(&mut [], |observed| {
                active.insert((observed.frame.gateway, observed.frame.channel));
            });
            match cycle {
                Ok(now_ns) if now_ns < end_ns => {}
                ended => break ended.map(drop),
            }
        };
        listened.and(link.service.finish())?;
        for (gateway, channel) in active {
            self.take((link.service.position(gateway), channel), rate);
        }
        Ok(())
    }

    /// Takes the channels on which a node acknowledges a request. Only channels without a bit rate
    /// are enabled: one with the wrong bit rate would disturb its bus.
    fn ask(&mut self, rate: u32) -> Result {
        let open = self.open.clone().unwrap_or_default();
        let positions: BTreeSet<_> = open.iter().map(|open_channel| open_channel.0).collect();
        for position in positions {
            let here = open.iter().filter(|open_channel| open_channel.0 == position);
            let mask = here.fold(0, |mask, (_, channel)| mask | 1 << channel);
            for channel in self.ask_gateway(rate, position, Channels::of_mask(mask))? {
                self.take((position, channel), rate);
            }
        }
        Ok(())
    }

    /// Returns the channels of a gateway on which a node acknowledges a request.
    fn ask_gateway(&mut self, rate: u32, position: usize, channels: Channels) -> Result<Vec<u8>> {
        let mut link = self.enter(rate, channels, Some(position))?;
        let request = |channel| {
            let target = NodeTarget { channel, node: NodeId::MIN };
            let mut request = SdoRequest::new(0, target, ACKNOWLEDGEMENT, 0);
            // A new client is idle.
            let _ = request.client.start_upload(object::DEVICE_TYPE, 0);
            request
        };
        let mut requests: Vec<_> = channels.iter().map(request).collect();
        let end_ns = link.service.response_ns() + ACKNOWLEDGEMENT.as_nanos() as u64;
        let asked = loop {
            match link.cycle(&mut requests, |_| ()) {
                Ok(now_ns) if now_ns < end_ns => {}
                ended => break ended.map(drop),
            }
        };
        let mut answering = Vec::new();
        for channel in channels.iter() {
            if asked.is_ok() && link.check_alive((0, channel)) {
                answering.push(channel);
            }
        }
        asked.and(link.service.finish())?;
        Ok(answering)
    }
}

/// The same options for the slave at a position.
pub fn of_slave(global: &GlobalOptions, position: usize) -> GlobalOptions {
    GlobalOptions { slave: Some(SlaveChoice::Position(position)), ..global.clone() }
}
