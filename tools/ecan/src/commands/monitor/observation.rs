//! Raw values of the cycle, in preallocated memory that is passed back and forth.

use ecan_host::{CycleStart, DomainReport};
use ecan_mcan_port::{
    ChannelConfig, PendingStep, Port, PortConfig, Received, Session, SlaveStatistics,
};
use ecan_protocol::can::FrameBits;
use ecan_protocol::image::ChannelStatus;
use ecan_protocol::mapping::CHANNELS;

const MARKS: usize = 4096;

#[derive(Clone, Copy, Debug)]
pub struct Mark {
    pub start: CycleStart,
    pub end_ns: u64,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct GatewayObservation {
    pub session: Session,
    pub waiting_for: Option<PendingStep>,
    pub domain: DomainReport,
    pub statistics: SlaveStatistics,
    pub channels: [ChannelStatus; CHANNELS],
    /// Whether the channel was bus-off in a cycle since the last observation.
    pub has_been_bus_off: [bool; CHANNELS],
    /// Bus time of the received frames since the start, in seconds.
    pub busy_s: [f64; CHANNELS],
}

/// Values since the last observation.
#[derive(Debug, Default)]
pub struct Observation {
    pub now_ns: u64,
    pub marks: Vec<Mark>,
    /// Cycles that did not fit.
    pub unmeasured: u64,
    pub gateways: Vec<GatewayObservation>,
}

impl Observation {
    pub fn new(gateways: usize) -> Self {
        Self {
            now_ns: 0,
            marks: Vec::with_capacity(MARKS),
            unmeasured: 0,
            gateways: vec![GatewayObservation::default(); gateways],
        }
    }

    pub fn is_nearly_full(&self) -> bool {
        self.marks.len() >= MARKS / 2
    }

    /// Clears the values and keeps the memory.
    pub fn clear(&mut self) {
        self.marks.clear();
        self.unmeasured = 0;
        for gateway in &mut self.gateways {
            gateway.has_been_bus_off = [false; CHANNELS];
        }
    }

    /// Records a cycle. Does not allocate.
    pub fn mark(&mut self, mark: Mark) {
        if self.marks.len() < self.marks.capacity() {
            self.marks.push(mark);
        } else {
            self.unmeasured += 1;
        }
    }

    /// Records the state of the gateways. Does not allocate.
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

    /// Records channels in bus-off, once per cycle: an observation may miss a short one. Does not
    /// allocate.
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

/// Sums the bus time of received frames, without stuff bits.
#[derive(Debug)]
pub struct BusTime {
    gateways: Vec<[ChannelTime; CHANNELS]>,
}

/// Bit rates of a channel in bit/s, and the bus time of its frames.
#[derive(Clone, Copy, Debug, Default)]
struct ChannelTime {
    nominal_bitrate: u32,
    data_bitrate: u32,
    seconds: f64,
}

impl BusTime {
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

    /// Counts a received frame. Does not allocate.
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
