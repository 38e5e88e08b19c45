//! What the cycle hands over: raw numbers, in memory that goes back and forth.

use ecan_host::{CycleStart, DomainReport};
use ecan_mcan_port::{Awaited, Port, Received, Session, SlaveStatistics};
use ecan_protocol::{CHANNELS, ChannelStatus, FrameBits};

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
    pub waiting_for: Option<Awaited>,
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
        for (slave, gateway) in self.gateways.iter_mut().enumerate() {
            *gateway = GatewayObservation {
                session: port.session(slave),
                waiting_for: port.waiting_for(slave),
                domain: port.adapter().domain_report(slave),
                statistics: port.statistics(slave),
                channels: std::array::from_fn(|channel| port.channel_status(slave, channel as u8)),
                busy_s: busy.of(slave),
                has_been_bus_off: gateway.has_been_bus_off,
            };
        }
    }

    /// Notes channels that are off the bus, once a cycle: a look may come too late for them.
    /// Allocates nothing.
    pub fn look_for_bus_off(&mut self, port: &Port) {
        for (slave, gateway) in self.gateways.iter_mut().enumerate() {
            for (channel, has_been) in (0..).zip(&mut gateway.has_been_bus_off) {
                *has_been |= port.channel_status(slave, channel).bus_off();
            }
        }
    }
}

/// Adds up how long the frames that arrive were on their bus, without stuff bits.
#[derive(Debug)]
pub struct BusTime {
    nominal_bitrate: u32,
    data_bitrate: u32,
    seconds: Vec<[f64; CHANNELS]>,
}

impl BusTime {
    pub fn new(gateways: usize, nominal_bitrate: u32, data_bitrate: Option<u32>) -> Self {
        let data_bitrate = data_bitrate.unwrap_or(nominal_bitrate);
        Self { nominal_bitrate, data_bitrate, seconds: vec![[0.0; CHANNELS]; gateways] }
    }

    /// Counts what came back, where it is a frame. Allocates nothing.
    pub fn count(&mut self, received: &Received) {
        let Received::Frame(received) = received else { return };
        let gateway = self.seconds.get_mut(received.slave);
        let channel = gateway.and_then(|it| it.get_mut(usize::from(received.channel)));
        if let Some(seconds) = channel {
            let bits = FrameBits::least(received.frame.as_ref());
            *seconds += bits.seconds(self.nominal_bitrate, self.data_bitrate);
        }
    }

    fn of(&self, slave: usize) -> [f64; CHANNELS] {
        self.seconds.get(slave).copied().unwrap_or_default()
    }
}
