//! What the cycle hands over: raw numbers, in memory that goes back and forth.

use ecan_host::{CycleStart, DomainReport};
use ecan_mcan_port::{
    ChannelConfig, PendingStep, Port, PortConfig, Received, Session, SlaveStatistics,
};
use ecan_protocol::can::FrameBits;
use ecan_protocol::image::ChannelStatus;
use ecan_protocol::mapping::CHANNELS;

/// Cycles that an observation has room for.
const MARKS: usize = 4096;

/// When a cycle began, and when its work was done.
#[derive(Clone, Copy, Debug)]
pub struct Mark {
    pub start: CycleStart,
    pub end_ns: u64,
}

/// One gateway as the cycle sees it.
#[derive(Clone, Copy, Debug, Default)]
pub struct GatewayObservation {
    pub session: Session,
    pub waiting_for: Option<PendingStep>,
    pub domain: DomainReport,
    pub statistics: SlaveStatistics,
    pub channels: [ChannelStatus; CHANNELS],
    /// Whether a cycle since the look before found the channel off the bus.
    pub has_been_bus_off: [bool; CHANNELS],
    /// Bus time of the frames that arrived, since the start, in seconds.
    pub busy_s: [f64; CHANNELS],
}

/// Everything since the observation before.
#[derive(Debug, Default)]
pub struct Observation {
    pub now_ns: u64,
    pub marks: Vec<Mark>,
    /// Cycles for which there was no room.
    pub unmeasured: u64,
    pub gateways: Vec<GatewayObservation>,
}

impl Observation {
    /// With room for so many gateways.
    pub fn new(gateways: usize) -> Self {
        Self {
            now_ns: 0,
            marks: Vec::with_capacity(MARKS),
            unmeasured: 0,
            gateways: vec![GatewayObservation::default(); gateways],
        }
    }

    /// Whether so many more cycles may have no room.
    pub fn is_nearly_full(&self) -> bool {
        self.marks.len() >= MARKS / 2
    }

    /// Begins anew; keeps the memory.
    pub fn clear(&mut self) {
        self.marks.clear();
        self.unmeasured = 0;
        for gateway in &mut self.gateways {
            gateway.has_been_bus_off = [false; CHANNELS];
        }
    }

    /// Notes a cycle. Allocates nothing.
    pub fn mark(&mut self, mark: Mark) {
        if self.marks.len() < self.marks.capacity() {
            self.marks.push(mark);
        } else {
            self.unmeasured += 1;
        }
    }

    /// Notes how everything stands. Allocates nothing.
    pub fn look(&mut self, port: &Port, busy: &BusTime, now_ns: u64) {
        self.now_ns = now_ns;
        self.look_for_bus_off(port);
        for (handle, gateway) in port.gateways().zip(&mut self.gateways) {
            let slave = handle.slave();
            *gateway = GatewayObservation {
                session: port.session(handle),
                waiting_for: port.waiting_for(handle),
                domain: port.adapter().domain_report(slave),
                statistics: port.statistics(handle),
                channels: std::array::from_fn(|channel| {
                    let channel = port.channel(slave, channel as u8);
                    channel.map(|channel| port.channel_status(channel)).unwrap_or_default()
                }),
                busy_s: busy.of(slave),
                has_been_bus_off: gateway.has_been_bus_off,
            };
        }
    }

    /// Notes channels that are off the bus, once a cycle: a look may come too late for them.
    /// Allocates nothing.
    pub fn look_for_bus_off(&mut self, port: &Port) {
        for channel in port.channels() {
            let Some(gateway) = self.gateways.get_mut(channel.slave()) else { continue };
            if let Some(has_been) = gateway.has_been_bus_off.get_mut(usize::from(channel.channel()))
            {
                *has_been |= port.channel_status(channel).bus_off();
            }
        }
    }
}

/// Adds up how long the frames that arrive were on their bus, without stuff bits.
#[derive(Debug)]
pub struct BusTime {
    gateways: Vec<[ChannelTime; CHANNELS]>,
}

/// Bit rates of a channel in bit/s, and the time its frames took.
#[derive(Clone, Copy, Debug, Default)]
struct ChannelTime {
    nominal_bitrate: u32,
    data_bitrate: u32,
    seconds: f64,
}

impl BusTime {
    /// For gateways of this configuration.
    pub fn new(config: &PortConfig) -> Self {
        let channel = |channel: &Option<ChannelConfig>| {
            let Some(ChannelConfig { can, .. }) = channel else { return ChannelTime::default() };
            let nominal_bitrate = can.nominal_bitrate;
            let data_bitrate = if can.fd { can.data_bitrate } else { nominal_bitrate };
            ChannelTime { nominal_bitrate, data_bitrate, seconds: 0.0 }
        };
        let gateways = config.gateways.iter().map(|it| it.channels.each_ref().map(channel));
        Self { gateways: gateways.collect() }
    }

    /// Counts what came back, where it is a frame. Allocates nothing.
    pub fn count(&mut self, received: &Received) {
        let Received::Frame(received) = received else { return };
        let gateway = self.gateways.get_mut(received.slave);
        let channel = gateway.and_then(|it| it.get_mut(usize::from(received.channel)));
        if let Some(channel) = channel {
            let bits = FrameBits::least(received.frame.as_ref());
            channel.seconds += bits.seconds(channel.nominal_bitrate, channel.data_bitrate);
        }
    }

    fn of(&self, slave: usize) -> [f64; CHANNELS] {
        let gateway = self.gateways.get(slave).copied().unwrap_or_default();
        gateway.map(|channel| channel.seconds)
    }
}
