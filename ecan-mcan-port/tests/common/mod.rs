//! A Port on a simulated bus in stepped time.
#![allow(dead_code, missing_docs)]

use std::time::Duration;

use ecan_host::{AdapterConfig, CycleError};
use ecan_mcan_port::{
    ChannelConfig, ChannelHandle, Cycle, GatewayConfig, GatewayHandle, Port, PortConfig, PortError,
    Received, ReceivedFrame, SendError, SendTicket,
};
use ecan_protocol::can::{CanFrame, CanId, FrameRef};
use ecan_protocol::image::Schedule;
use ecan_sim::{ClockKind, Scenario, SimOptions, Simulation};

pub struct Fixture {
    pub port: Port,
    pub simulation: Simulation,
    /// Errors of the library in the cycles so far.
    pub cycle_errors: Vec<CycleError>,
}

impl Fixture {
    pub fn open(
        scenario: Scenario,
        adapter: AdapterConfig,
        config: PortConfig,
    ) -> Result<Self, PortError> {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(scenario, &options).expect("scenario");
        let simulation = backend.simulation.expect("simulated");
        let port = Port::open(&backend.ecrt, (adapter, config))?;
        Ok(Self { port, simulation, cycle_errors: Vec::new() })
    }

    /// Opened and ready.
    pub fn ready(scenario: Scenario, adapter: AdapterConfig, config: PortConfig) -> Self {
        let mut fixture = Self::open(scenario, adapter, config).unwrap_or_else(|e| panic!("{e}"));
        fixture.port.wait_ready().unwrap_or_else(|e| panic!("{e}"));
        fixture
    }

    /// One gateway with echo nodes, N = 3, 1 ms, `gateway` as configured.
    pub fn single(gateway: GatewayConfig) -> Self {
        let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
        Self::ready(ecan_sim::echo(1), adapter, PortConfig::uniform(1, gateway))
    }

    /// One cycle: waits until it is due, receives everything, then `send`.
    pub fn cycle(&mut self, send: impl FnOnce(&mut Cycle<'_>)) -> Vec<Received> {
        let mut cycle = self.port.next_cycle();
        let received = cycle.received().map(|item| item.to_owned()).collect();
        send(&mut cycle);
        let summary = cycle.finish();
        self.cycle_errors.extend([summary.receive_error, summary.send_error].into_iter().flatten());
        received
    }

    /// Cycles without sending.
    pub fn idle(&mut self, cycles: usize) -> Vec<Received> {
        (0..cycles).flat_map(|_| self.cycle(|_| ())).collect()
    }

    /// Cycles until `done`, at most `limit`; the number run, or none.
    pub fn until(&mut self, limit: usize, done: impl Fn(&Port) -> bool) -> Option<usize> {
        for cycle in 0..limit {
            if done(&self.port) {
                return Some(cycle);
            }
            self.cycle(|_| ());
        }
        None
    }

    /// Sends all frames as fast as they are taken, on slave 0, and collects what comes back.
    pub fn carry(&mut self, channel: u8, frames: &[CanFrame], limit: usize) -> Vec<ReceivedFrame> {
        let mut sent = 0;
        let mut back = Vec::new();
        for _ in 0..limit {
            let items = self.cycle(|cycle| {
                while let Some(frame) = frames.get(sent) {
                    if cycle.send(cycle.ch(0, channel), frame).is_err() {
                        break;
                    }
                    sent += 1;
                }
            });
            back.extend(frames_of(&items));
            if sent == frames.len() && back.len() >= sent {
                break;
            }
        }
        back
    }
}

impl Drop for Fixture {
    /// The simulator complains about what a real master would hang on.
    fn drop(&mut self) {
        let log = self.simulation.kernel_log();
        let complaint = log.iter().find(|line| line.starts_with("simulator:"));
        assert!(complaint.is_none() || std::thread::panicking(), "{complaint:?}");
    }
}

/// Handles by slave and channel, which must exist.
pub trait Handles {
    fn gw(&self, slave: usize) -> GatewayHandle;
    fn ch(&self, slave: usize, channel: u8) -> ChannelHandle;
}

impl Handles for Port {
    fn gw(&self, slave: usize) -> GatewayHandle {
        self.gateway(slave).unwrap()
    }

    fn ch(&self, slave: usize, channel: u8) -> ChannelHandle {
        self.channel(slave, channel).unwrap()
    }
}

/// Sending from an address and data, in one call.
pub trait SendData {
    fn send_can(&mut self, slave: usize, channel: u8, id: CanId, data: &[u8]) -> Sent;
    fn schedule_can(
        &mut self,
        slave: usize,
        channel: u8,
        id: CanId,
        data: &[u8],
        schedule: Schedule,
    ) -> Sent;
}

type Sent = Result<SendTicket, SendError>;

impl SendData for Cycle<'_> {
    fn send_can(&mut self, slave: usize, channel: u8, id: CanId, data: &[u8]) -> Sent {
        self.send(self.channel(slave, channel)?, FrameRef::classic(id, data)?)
    }

    fn schedule_can(
        &mut self,
        slave: usize,
        channel: u8,
        id: CanId,
        data: &[u8],
        schedule: Schedule,
    ) -> Sent {
        let to = self.channel(slave, channel)?;
        self.send_with(to, FrameRef::classic(id, data)?, schedule.into())
    }
}

pub fn frames_of(items: &[Received]) -> Vec<ReceivedFrame> {
    items.iter().filter_map(Received::frame).copied().collect()
}

pub fn id(raw: u16) -> CanId {
    CanId::standard(raw).unwrap()
}

pub fn frame(raw_id: u16, data: &[u8]) -> CanFrame {
    CanFrame::classic(id(raw_id), data).unwrap()
}

pub fn classic() -> ChannelConfig {
    ChannelConfig::classic(1_000_000)
}

/// Gateways that miss no outputs around Sync0, for tests of images that arrive late, around a pulse.
/// A missed image would be repeated in the next cycle, and ten of them end OP: that hides how the
/// host treats the frames of a late image that the firmware has read.
pub fn without_sync0_window(mut scenario: Scenario) -> Scenario {
    for gateway in &mut scenario.gateways {
        gateway.config.sync0_window = ecan_sim::Sync0Window::OFF;
    }
    scenario
}

/// N = 3, 1 ms, Sync0 with this shift, channel 0 classic; `gateway` changes the rest.
pub fn with_sync0(
    scenario: Scenario,
    shift_ns: u32,
    change: impl FnOnce(&mut GatewayConfig),
) -> Fixture {
    let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    adapter.dc = Some(ecan_host::DcSync::new(
        Duration::from_millis(1),
        Duration::from_nanos(shift_ns.into()),
    ));
    let mut gateway = GatewayConfig::on_channel(0, classic());
    change(&mut gateway);
    Fixture::ready(scenario, adapter, PortConfig::uniform(1, gateway))
}
