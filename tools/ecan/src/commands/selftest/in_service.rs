//! Self-test through a service: what does not disturb the program that holds the bus.

use ecan_host::{Diagnostics, Error};
use ecan_protocol::config::{McanChannelConfig, NodeMode};
use ecan_protocol::device::AlState;
use ecan_protocol::image::{ChannelState as BusState, ChannelStatus};
use ecan_protocol::mapping::{CHANNELS, Direction};
use ecan_service::client::Access;
use ecan_tool_support::command_line::interrupt::Interrupt;

use super::exchange::{
    ChannelCounters, ChannelState, Counts, GatewayTraffic, Received, Waits, check_counts,
};
use super::gateways::FramesReceived;
use super::group::GroupEnd;
use super::plan::{Rate, Route, TestPath, TestPlan, TestStep};
use super::report::{Check, GatewayReport};
use crate::context::{Bus, Result};
use crate::frames::{
    Channels, Event, FrameLink, Planned, ServiceLink, ServiceSetup, can_config, gateways_of_service,
};
use crate::service_access::ServiceConnection;

/// The frames pass another program, which may be busy.
const WAITS: Waits = Waits { quiet_ns: 100_000_000, standstill_ns: 3_000_000_000 };

/// Gateways with the cycle of the service.
struct Running {
    link: ServiceLink,
    planned: Planned,
}

/// A pair of wired channels of a gateway.
struct WiredPair {
    /// Index in the service link, and in the reports.
    gateway: usize,
    report: usize,
    routes: [Route; 2],
    rate: Rate,
    before: Vec<ChannelCounters>,
}

/// Tests slaves; the inner result is that of the exchange of frames.
pub(super) fn test(
    bus: &Bus,
    connection: &ServiceConnection,
    plan: &TestPlan<'_>,
    slaves: &[usize],
    interrupt: &Interrupt,
) -> Result<(Result<GroupEnd>, Vec<GatewayReport>)> {
    let program = connection.program();
    let running = Running::of(connection, bus)?;
    let read = super::gateways::read_with(bus, slaves, plan.arguments(), |bus, slave, report| {
        report.add("state", state(bus, slave, running.as_ref()));
        for channel in plan.arguments().channels.iter() {
            report.add(format!("channel {channel}"), channel_state(bus, slave, channel));
        }
    });
    let mut reports: Vec<_> =
        read.into_iter().map(|(report, found)| (report, found.is_some())).collect();
    let run = match running {
        Some(running) => running.test_wires(bus, plan, &mut reports, interrupt),
        None => {
            leave_out_wires(plan, &mut reports, &format!("{program} runs no cycle"));
            Ok(GroupEnd::Complete)
        }
    };
    for (report, _) in reports.iter_mut().filter(|entry| entry.1) {
        let reason = format!("it takes the channels off their bus, which {program} holds");
        report.leave_out("loopback", reason);
        report.leave_out("bit rates", format!("the configuration belongs to {program}"));
        if matches!(run, Ok(GroupEnd::Stopped)) {
            report.stop();
        }
    }
    Ok((run, reports.into_iter().map(|entry| entry.0).collect()))
}

/// AL state, and the session of a gateway of the cycle.
fn state(bus: &Bus, slave: usize, running: Option<&Running>) -> Result<String, String> {
    let info = bus.diagnostics().slave_info(slave).map_err(|error| error.to_string())?;
    let state = AlState::from_status(info.al_state.into());
    let state = state.map_or_else(|| format!("{:#04x}", info.al_state), |state| state.to_string());
    if info.error_flag {
        return Err(format!("{state} with error flag; see `ecan diag`"));
    }
    let Some((running, gateway)) =
        running.and_then(|running| Some((running, running.index(slave)?)))
    else {
        return Ok(state);
    };
    let condition = running.link.condition(gateway);
    let text = format!("{state}, {}", condition.session);
    if condition.is_ready() { Ok(text) } else { Err(text) }
}

/// Status and error counters of a channel.
fn channel_state(bus: &Bus, slave: usize, channel: u8) -> Result<String, String> {
    let read = || -> Result<_, Error> {
        let bus = bus.diagnostics();
        let raw = bus.sdo_upload_u32(slave, 0x9000 + u16::from(channel), 9)?;
        let counters = ChannelCounters::read(bus, slave, channel)?;
        Ok((
            ChannelStatus::from_raw(raw as u16).state(),
            counters,
            ChannelState::read(bus, slave, channel)?,
        ))
    };
    let (status, counters, state) = read().map_err(|error| error.to_string())?;
    if status == BusState::Disabled {
        return Ok(status.to_string());
    }
    let faults = state.faults(&counters);
    match faults.is_empty() {
        true => Ok(format!("{status}, no errors")),
        false => Err(format!("{status}; {}", faults.join("; "))),
    }
}

fn leave_out_wires(plan: &TestPlan<'_>, reports: &mut [(GatewayReport, bool)], reason: &str) {
    for (report, _) in reports.iter_mut().filter(|entry| entry.1) {
        for (first, second) in plan.pairs() {
            report.leave_out(wire(*first, *second), reason);
        }
    }
}

fn wire(first: u8, second: u8) -> String {
    format!("wire between channels {first} and {second}")
}

impl Running {
    /// `None` if the service runs no cycle.
    fn of(connection: &ServiceConnection, bus: &Bus) -> Result<Option<Self>> {
        if connection.hello().cycle_ns.is_none() {
            return Ok(None);
        }
        let (setup, planned) = gateways_of_service(connection, bus, true)?;
        let ServiceSetup { connection, gateways } = setup;
        let config = (planned.adapter, planned.config);
        let link = ServiceLink::start(connection, config, &gateways, (Channels::ALL, false))?;
        Ok(Some(Self { link, planned }))
    }

    fn index(&self, slave: usize) -> Option<usize> {
        self.planned.positions.iter().position(|position| *position == slave)
    }

    /// Exchanges frames on the wired pairs of all gateways in parallel.
    fn test_wires(
        mut self,
        bus: &Bus,
        plan: &TestPlan<'_>,
        reports: &mut [(GatewayReport, bool)],
        interrupt: &Interrupt,
    ) -> Result<GroupEnd> {
        let mut pairs = Vec::new();
        for (number, (report, _)) in reports.iter_mut().enumerate().filter(|(_, entry)| entry.1) {
            for (first, second) in plan.pairs() {
                let routes = [(first, second), (second, first)];
                let routes = routes.map(|(from, to)| Route { from: *from, to: *to });
                match self.prepare(bus, report.position, routes) {
                    Ok((gateway, rate, before)) => {
                        pairs.push(WiredPair { gateway, report: number, routes, rate, before })
                    }
                    Err(reason) => report.leave_out(wire(*first, *second), reason),
                }
            }
        }
        let arguments = plan.arguments();
        if !arguments.force {
            let Some(busy) = self.observe(bus, &pairs, arguments.observe, interrupt)? else {
                return Ok(GroupEnd::Stopped);
            };
            let mut busy = busy.into_iter();
            pairs.retain(|pair| {
                let Some(seen) = busy.next().flatten() else { return true };
                let [Route { from, to }, _] = pair.routes;
                let reason = format!(
                    "traffic within {} ms: {seen}; stop it, or use --force",
                    arguments.observe
                );
                reports[pair.report].0.leave_out(wire(from, to), reason);
                false
            });
        }
        let Some(counts) = self.exchange(&pairs, arguments.frames, interrupt)? else {
            return Ok(GroupEnd::Stopped);
        };
        for (pair, counts) in pairs.into_iter().zip(counts) {
            let report = &mut reports[pair.report].0;
            pair.report(bus.diagnostics(), counts, arguments.frames, report);
        }
        Ok(GroupEnd::Complete)
    }

    /// Index, bit rate and counters of two channels, or the reason why they cannot be tested.
    fn prepare(
        &self,
        bus: &Bus,
        slave: usize,
        routes: [Route; 2],
    ) -> Result<(usize, Rate, Vec<ChannelCounters>), String> {
        let connection = self.link.connection();
        let program = connection.program();
        if connection.hello().access == Access::Read {
            return Err(format!("{program}: {}", connection.read_only_reason()));
        }
        let gateway = self.index(slave).ok_or(format!("not a gateway of {program}"))?;
        let config = self.planned.config.gateways.get(gateway).copied().unwrap_or_default();
        let mut found: Option<McanChannelConfig> = None;
        for Route { from: channel, .. } in routes {
            let can = can_config(&self.planned.config, gateway, channel)
                .ok_or(format!("channel {channel} is not enabled by {program}"))?;
            let is_both = [Direction::TxPdo, Direction::RxPdo]
                .into_iter()
                .all(|direction| config.carries(direction, channel));
            if !is_both || can.node_mode != NodeMode::Normal {
                return Err(format!("channel {channel} does not send and receive in {program}"));
            }
            let rates =
                |can: &McanChannelConfig| (can.nominal_bitrate, can.fd.then_some(can.data_bitrate));
            if found.is_some_and(|found| rates(&found) != rates(can)) {
                return Err(format!("the channels have different bit rates in {program}"));
            }
            found = Some(*can);
        }
        let read = |route: &Route| ChannelCounters::read(bus.diagnostics(), slave, route.from);
        let before = routes.iter().map(read);
        let before = before.collect::<Result<_, _>>().map_err(|error| error.to_string())?;
        Ok((gateway, Rate::of_channel(&found.unwrap_or_default()), before))
    }

    /// Observes the channels; the result has the traffic of each pair. `None` if the user stops.
    fn observe(
        &mut self,
        bus: &Bus,
        pairs: &[WiredPair],
        observe_ms: u32,
        interrupt: &Interrupt,
    ) -> Result<Option<Vec<Option<String>>>> {
        if pairs.is_empty() {
            return Ok(Some(Vec::new()));
        }
        let mut seen = vec![[FramesReceived::default(); CHANNELS]; self.planned.positions.len()];
        let end_ns = self.link.now_ns().saturating_add(u64::from(observe_ms) * 1_000_000);
        while self.link.now_ns() < end_ns {
            if interrupt.is_set() {
                return Ok(None);
            }
            self.cycle(|_, received, _| {
                for (gateway, channel, frame) in received {
                    let of_gateway = seen.get_mut(*gateway);
                    let of_channel =
                        of_gateway.and_then(|channels| channels.get_mut(usize::from(*channel)));
                    of_channel.into_iter().for_each(|received| received.add(frame.id()));
                }
                Ok(())
            })?;
        }
        let traffic = |pair: &WiredPair| {
            let slave = self.planned.positions.get(pair.gateway).copied()?;
            pair.routes.iter().find_map(|Route { from: channel, .. }| {
                let state = ChannelState::read(bus.diagnostics(), slave, *channel).ok()?;
                seen.get(pair.gateway)?.get(usize::from(*channel))?.traffic(&state)
            })
        };
        Ok(Some(pairs.iter().map(traffic).collect()))
    }

    /// Runs one cycle: time, received frames, link.
    fn cycle(&mut self, run: impl FnOnce(u64, &[Received], &mut ServiceLink) -> Result) -> Result {
        let mut arrivals = Vec::new();
        let now_ns = self.link.begin(&mut arrivals);
        let frames = arrivals.iter().filter_map(|arrival| match &arrival.event {
            Event::Frame(arrived) if !arrived.is_sent => {
                Some((arrived.gateway, arrived.channel, arrived.frame))
            }
            _ => None,
        });
        let received: Vec<Received> = frames.collect();
        run(now_ns, &received, &mut self.link)?;
        self.link.end()
    }

    /// The counts of the routes of each pair; `None` if the user stops.
    fn exchange(
        &mut self,
        pairs: &[WiredPair],
        count: u16,
        interrupt: &Interrupt,
    ) -> Result<Option<Vec<Vec<Counts>>>> {
        let now_ns = self.link.now_ns();
        let start = |pair: &WiredPair| {
            let is_fd = pair.rate.is_fd();
            GatewayTraffic::new(pair.gateway, &pair.routes, count, is_fd, now_ns, WAITS)
        };
        let mut traffics = pairs.iter().map(start).collect::<Result<Vec<_>>>()?;
        while traffics.iter().any(|traffic| !traffic.is_over()) {
            if interrupt.is_set() {
                return Ok(None);
            }
            self.cycle(|now_ns, received, link| {
                let mut send =
                    |gateway, channel, frame: &_| Ok(link.send(gateway, channel, frame)?.is_some());
                let mut open = traffics.iter_mut().filter(|traffic| !traffic.is_over());
                open.try_for_each(|traffic| traffic.step(received, now_ns, &mut send))
            })?;
        }
        Ok(Some(traffics.into_iter().map(GatewayTraffic::into_counts).collect()))
    }
}

impl WiredPair {
    fn report(
        self,
        bus: &Diagnostics,
        counts: Vec<Counts>,
        count: u16,
        report: &mut GatewayReport,
    ) {
        let slave = report.position;
        let step = TestStep { path: TestPath::Wire, rate: &self.rate, routes: &self.routes };
        let after = self.routes.iter().map(|route| ChannelState::read(bus, slave, route.from));
        let after: Vec<_> = match after.collect::<Result<_, _>>() {
            Ok(after) => after,
            Err(error) => return report.add(step.name(), Err(error.to_string())),
        };
        let states: Vec<_> = self.before.into_iter().zip(after).collect();
        for (route, counts) in self.routes.iter().zip(counts) {
            let states: Vec<_> = states.iter().collect();
            let found = check_counts(TestPath::Wire, *route, &counts, count, &states);
            report.checks.push(Check::of_route(&step, *route, counts, &states, found));
        }
    }
}
