//! Gateways with a cycle of this program.

use std::time::SystemTime;

use ecan_host::{AdapterConfig, Clock, Ecrt};
use ecan_mcan_port::{
    Cycle, GatewayCondition, Port, PortConfig, PortError, Received, ReceivedView, SendError,
};
use ecan_protocol::can::CanFrame;
use ecan_protocol::mapping::Direction;
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::options::RealTimeArguments;

use crate::context::{Failure, Result, note};
use crate::frames::link::{Arrival, BusFrame, Event, FrameLink, Outcome, Ticket};
use crate::frames::service::without_fd;

const ARRIVALS: usize = 512;

#[derive(Debug)]
pub struct PortLink {
    port: Port,
    /// Items received during startup, until the first cycle.
    startup: Vec<Arrival>,
    since_1970_ns: u64,
}

impl PortLink {
    /// Starts the gateways; `None` if the user stops.
    pub fn start(
        ecrt: &Ecrt,
        (adapter, config): (AdapterConfig, PortConfig),
        real_time: &RealTimeArguments,
        interrupt: &Interrupt,
    ) -> Result<Option<Self>, PortError> {
        if let Some(warning) = config.sync0_warning(&adapter) {
            note(format_args!("warning: {warning}"));
        }
        let mut port = Port::open(ecrt, (adapter, config))?;
        port.profile_warnings().iter().for_each(|warning| note(format_args!("warning: {warning}")));
        let clock = port.adapter().ecrt().clock().clone();
        let mut startup = Vec::with_capacity(ARRIVALS);
        let is_ready = wait_ready(
            &mut port,
            || interrupt.is_set(),
            |cycle| {
                let time_ns = clock.now_ns();
                startup.extend(cycle.received().map(|item| arrival(time_ns, item)));
            },
        )?;
        if !is_ready {
            return Ok(None);
        }
        real_time.set_timing(port.adapter_mut());
        let since_1970_ns = since_1970_ns(port.adapter().clock());
        Ok(Some(Self { port, startup, since_1970_ns }))
    }
}

/// Runs cycles until the gateways are ready. Returns whether they are; `false` if the user stops first.
pub fn wait_ready(
    port: &mut Port,
    is_stopped: impl Fn() -> bool,
    mut observe: impl FnMut(&mut Cycle<'_>),
) -> Result<bool, PortError> {
    let ready: Result<(), Option<PortError>> =
        port.wait_ready_with(port.startup_timeout(), |port| {
            // Single cycles may fail; the timeout ends the startup.
            observe(&mut port.begin_cycle());
            if is_stopped() { Err(None) } else { Ok(()) }
        });
    match ready {
        Ok(()) => Ok(true),
        Err(None) => Ok(false),
        Err(Some(error)) => Err(error),
    }
}

impl FrameLink for PortLink {
    fn adapter_config(&self) -> &AdapterConfig {
        self.port.adapter().config()
    }

    fn port_config(&self) -> &PortConfig {
        self.port.config()
    }

    fn now_ns(&self) -> u64 {
        self.port.adapter().clock().now_ns()
    }

    fn since_1970_ns(&self) -> u64 {
        self.since_1970_ns
    }

    fn is_real_time(&self) -> bool {
        self.port.adapter().clock().is_free_running()
    }

    fn begin(&mut self, arrivals: &mut Vec<Arrival>) -> u64 {
        let mut cycle = self.port.next_cycle();
        let now_ns = cycle.adapter().clock().now_ns();
        arrivals.append(&mut self.startup);
        arrivals.extend(cycle.received().map(|item| arrival(now_ns, item)));
        cycle.keep_open();
        now_ns
    }

    fn send(&mut self, gateway: usize, channel: u8, frame: &CanFrame) -> Result<Option<Ticket>> {
        let Some(mut cycle) = self.port.open_cycle() else { return Ok(None) };
        let usage = |error: &dyn std::fmt::Display| Failure::Usage(error.to_string());
        let to = cycle.channel(gateway, channel).map_err(|error| usage(&error))?;
        match cycle.send(to, frame) {
            Ok(ticket) => Ok(Some(ticket.into())),
            Err(error) if error.is_temporary() => Ok(None),
            Err(SendError::NotFd { .. }) => Err(without_fd("a CAN FD frame", channel, None)),
            Err(error) => Err(usage(&error)),
        }
    }

    fn end(&mut self) -> Result {
        let ended = self.port.open_cycle().map_or(Ok(()), |open| open.end().map(drop));
        ended.map_err(Failure::master)
    }

    fn condition(&self, gateway: usize) -> GatewayCondition {
        let gateway = self.port.gateway(gateway);
        gateway.map(|gateway| GatewayCondition::of(&self.port, gateway)).unwrap_or_default()
    }

    fn images(&self, direction: Direction, visit: &mut dyn FnMut(usize, u64, &[u8])) {
        let (adapter, now_ns) = (self.port.adapter(), self.now_ns());
        for gateway in 0..adapter.config().slaves.len() {
            let image = match direction {
                Direction::RxPdo => adapter.rx_pdo(gateway),
                Direction::TxPdo => adapter.tx_pdo(gateway),
            };
            visit(gateway, now_ns, image);
        }
    }

    fn upload(&mut self, gateway: usize, index: u16, subindex: u8) -> Result<u32> {
        let value = self
            .port
            .diagnose(move |diagnostics| diagnostics.sdo_upload_u32(gateway, index, subindex));
        value.map_err(Failure::of_diagnosis)?.map_err(Failure::Device)
    }
}

fn arrival(time_ns: u64, item: ReceivedView<'_>) -> Arrival {
    let event = match item.to_owned() {
        Received::Frame(received) => Event::Frame(BusFrame {
            gateway: received.slave,
            channel: received.channel,
            frame: received.frame,
            timestamp: received.timestamp,
            is_sent: false,
        }),
        Received::TransmitReport(report) => Event::Result {
            ticket: report.ticket.map(Ticket::from),
            outcome: Outcome::Result(report.code),
        },
    };
    Arrival { time_ns, event }
}

fn since_1970_ns(clock: &dyn Clock) -> u64 {
    if !clock.is_free_running() {
        return 0;
    }
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(0).wrapping_sub(clock.now_ns())
}
