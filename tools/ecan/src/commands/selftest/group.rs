//! Frame tests of several gateways in parallel.

use ecan_host::{CanController, Diagnostics, Error};
use ecan_mcan_port::PortConfig;
use ecan_protocol::config::McanChannelConfig;
use ecan_protocol::device::ControllerMode;
use ecan_protocol::mapping::CHANNELS;
use ecan_tool_support::command_line::interrupt::Interrupt;

use super::exchange::{ChannelCounters, ChannelState, check_counts, exchange};
use super::gateways::{FramesReceived, Traffic, require_no_traffic};
use super::plan::{ChannelSetup, TestPath, TestPlan, TestStep};
use super::report::{Check, GatewayReport};
use super::test_bus::{StartFailure, TestBus, start_failures};
use crate::commands::saved_config::wait_present;
use crate::context::{Bus, Failure, Result};
use crate::frames::{WATCHDOG, failure};

/// Cycle time in ns that may trigger the watchdog of a gateway.
const PAUSE_NS: u64 = WATCHDOG.as_nanos() as u64 / 2;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GroupEnd {
    Complete,
    /// By the user.
    Stopped,
}

/// A gateway in a test.
pub(super) struct Member<'r> {
    pub(super) position: usize,
    pub(super) report: &'r mut GatewayReport,
    /// Set if the test configures the gateway.
    pub(super) is_changed: &'r mut bool,
    /// Set if the gateway was lost, so that it may have restarted.
    pub(super) was_lost: &'r mut bool,
    /// This is not the first attempt to start it.
    pub(super) is_repeated: bool,
}

enum Start {
    Ready(Box<TestBus>),
    Failed(Vec<StartFailure>),
    /// By the user.
    Stopped,
}

/// Counters of the tested channels of each gateway.
type Counters = Vec<Vec<ChannelCounters>>;

/// State of a member while the bus is in operation.
struct Active<'m, 'r> {
    gateway: usize,
    member: &'m mut Member<'r>,
    setup: ChannelSetup,
    /// The registers have shown the internal loopback of the tested channels.
    is_loopback_verified: bool,
    losses: u64,
    is_out: bool,
}

/// Reports the progress: positions, text, number of the step, and number of steps.
pub(super) type ReportProgress<'a> = dyn Fn(&[usize], &str, usize, usize) + 'a;

pub(super) struct GroupTest<'a> {
    pub(super) plan: &'a TestPlan<'a>,
    pub(super) interrupt: &'a Interrupt,
    pub(super) progress: &'a ReportProgress<'a>,
}

impl GroupTest<'_> {
    /// Tests gateways in parallel. A gateway that prevents the start fails, and the others start without
    /// it; if its cause may pass, it is tested alone afterwards.
    ///
    /// # Errors
    /// [`Failure::Master`] if the master cannot be used, [`Failure::Rejected`] if there is traffic on
    /// a bus.
    pub(super) fn run(&self, bus: &Bus, mut members: Vec<Member<'_>>) -> Result<GroupEnd> {
        let mut postponed = Vec::new();
        while !members.is_empty() {
            let failures = match self.start(bus, &mut members)? {
                Start::Stopped => return Ok(GroupEnd::Stopped),
                Start::Ready(started) => {
                    if self.run_steps(*started, &mut members)? == GroupEnd::Stopped {
                        return Ok(GroupEnd::Stopped);
                    }
                    break;
                }
                Start::Failed(failures) => failures,
            };
            // From the last one, so that the indices stay valid.
            for StartFailure { gateway, reason, is_temporary } in failures.into_iter().rev() {
                let mut member = members.remove(gateway);
                tracing::info!(slave = member.position, reason, "not started");
                if is_temporary && !member.is_repeated {
                    member.is_repeated = true;
                    postponed.push(member);
                } else {
                    let steps = self.plan.steps();
                    let name = steps.first().map_or_else(String::new, TestStep::name);
                    member.report.add(name, Err(reason));
                }
            }
        }
        for member in postponed {
            if self.run(bus, vec![member])? == GroupEnd::Stopped {
                return Ok(GroupEnd::Stopped);
            }
        }
        Ok(GroupEnd::Complete)
    }

    fn start(&self, bus: &Bus, members: &mut [Member<'_>]) -> Result<Start> {
        let positions: Vec<_> = members.iter().map(|member| member.position).collect();
        let config = self.plan.configs(&positions)?;
        tracing::info!(slaves = ?positions, "starting");
        for (gateway, position) in positions.iter().enumerate() {
            if let Err(failure) = wait_present(bus, *position) {
                let reason = failure.to_string();
                return Ok(Start::Failed(vec![StartFailure {
                    gateway,
                    reason,
                    is_temporary: false,
                }]));
            }
        }
        let real_time = &self.plan.arguments().real_time;
        let started = match TestBus::start(bus.ecrt()?, config, real_time, self.interrupt) {
            Ok(Some(started)) => Start::Ready(Box::new(started)),
            Ok(None) => Start::Stopped,
            Err(error) => {
                let failures = start_failures(&error, members.len());
                match failure(0, error) {
                    // Another program has reserved the master, or there is none: nothing was
                    // changed.
                    failure @ Failure::Master(_) => return Err(failure),
                    _ => Start::Failed(failures),
                }
            }
        };
        members.iter_mut().for_each(|member| *member.is_changed = true);
        Ok(started)
    }

    fn run_steps(&self, mut bus: TestBus, members: &mut [Member<'_>]) -> Result<GroupEnd> {
        let channels = started_channels(bus.port().config());
        let activate = |(gateway, member)| {
            let setup = ChannelSetup::started(channels);
            Active { gateway, member, setup, is_loopback_verified: false, losses: 0, is_out: false }
        };
        let mut active: Vec<_> = members.iter_mut().enumerate().map(activate).collect();
        if !self.plan.arguments().force && self.observe(&mut bus, &active)? == GroupEnd::Stopped {
            return Ok(GroupEnd::Stopped);
        }
        let steps = self.plan.steps();
        for (number, step) in (1..).zip(&steps) {
            let present: Vec<_> = active.iter_mut().filter(|active| !active.is_out).collect();
            if present.is_empty() {
                break;
            }
            let positions: Vec<_> = present.iter().map(|gateway| gateway.member.position).collect();
            (self.progress)(&positions, &step.name(), number, steps.len());
            match self.run_step(&mut bus, present, step) {
                Ok(GroupEnd::Complete) => {}
                Ok(GroupEnd::Stopped) => return Ok(GroupEnd::Stopped),
                // An error of the link or of the master concerns all.
                Err(error) => {
                    for member in active.iter_mut().filter(|active| !active.is_out) {
                        member.fail(step.name(), error.to_string());
                    }
                }
            }
        }
        Ok(GroupEnd::Complete)
    }

    /// Listens on the tested channels. The Port has verified that they do not take part in their buses.
    ///
    /// # Errors
    /// [`Failure::Rejected`] if there is traffic on a bus.
    fn observe(&self, bus: &mut TestBus, active: &[Active<'_, '_>]) -> Result<GroupEnd> {
        let gateways: Vec<_> = active.iter().map(|active| active.gateway).collect();
        let tested = self.plan.tested();
        let channels: Vec<u8> =
            (0..).zip(tested).filter(|numbered| numbered.1).map(|numbered| numbered.0).collect();
        let observe_ms = self.plan.arguments().observe;
        let mut received = vec![[FramesReceived::default(); CHANNELS]; active.len()];
        let end_ns = bus.now_ns().saturating_add(u64::from(observe_ms) * 1_000_000);
        while bus.now_ns() < end_ns {
            if bus.is_interrupted() {
                return Ok(GroupEnd::Stopped);
            }
            bus.cycle(|cycle| {
                for item in cycle.received() {
                    let item = item.to_owned();
                    let Some(frame) = item.frame() else { continue };
                    let of_gateway = received.get_mut(frame.slave);
                    let of_channel = of_gateway
                        .and_then(|channels| channels.get_mut(usize::from(frame.channel)));
                    if let Some(received) = of_channel {
                        received.add(frame.frame.id());
                    }
                }
            })?;
        }
        let read =
            |diagnostics: &Diagnostics, gateway: usize| -> Result<Vec<ChannelState>, Error> {
                channels
                    .iter()
                    .map(|channel| ChannelState::read(diagnostics, gateway, *channel))
                    .collect()
            };
        let mut traffic = Vec::new();
        for (member, states) in active.iter().zip(bus.on_each(&gateways, read)?) {
            let Some(received) = received.get(member.gateway) else { continue };
            for state in states.iter().flatten() {
                let received = received.get(usize::from(state.channel));
                if let Some(seen) = received.and_then(|received| received.traffic(state)) {
                    let (position, channel) = (member.member.position, state.channel);
                    traffic.push(Traffic { position, channel, seen });
                }
            }
        }
        require_no_traffic(&traffic, observe_ms).map(|()| GroupEnd::Complete)
    }

    fn run_step(
        &self,
        bus: &mut TestBus,
        mut active: Vec<&mut Active<'_, '_>>,
        step: &TestStep<'_>,
    ) -> Result<GroupEnd> {
        let gateways = |active: &[&mut Active<'_, '_>]| -> Vec<_> {
            active.iter().map(|active| active.gateway).collect()
        };
        if !bus.wait_ready(&gateways(&active))? {
            return Ok(GroupEnd::Stopped);
        }
        active.retain_mut(|active| {
            let is_ready = bus.is_ready(active.gateway);
            if !is_ready {
                active.fail(step.name(), bus.reason(active.gateway));
            }
            is_ready
        });
        for member in &mut active {
            // The master has configured a gateway that returned as at the start.
            if bus.losses(member.gateway) != member.losses {
                member.setup = ChannelSetup::started(started_channels(bus.port().config()));
                member.is_loopback_verified = false;
            }
        }
        let changes: Vec<_> =
            active.iter().map(|active| (active.gateway, active.setup.changes(step))).collect();
        let channels = step.channels();
        let configure = |diagnostics: &Diagnostics, gateway: usize| {
            let steps = changes
                .iter()
                .find(|change| change.0 == gateway)
                .map_or(&[][..], |change| &change.1);
            diagnostics.run_startup(gateway, steps, |_| ())?;
            channels
                .iter()
                .map(|channel| ChannelCounters::read(diagnostics, gateway, *channel))
                .collect()
        };
        let configured = bus.on_each(&gateways(&active), configure)?;
        let before: Counters = keep(&mut active, configured, step);
        active.iter_mut().for_each(|active| active.setup.set(step));
        let before = match step.path {
            TestPath::Loopback => verify_loopback(bus, &mut active, before, step)?,
            TestPath::Wire => before,
        };

        bus.measure_cycles();
        let count = self.plan.arguments().frames;
        let is_fd = step.rate.is_fd();
        let exchanged = exchange(bus, &gateways(&active), step.routes, count, is_fd)?;
        let Some(counts) = exchanged else { return Ok(GroupEnd::Stopped) };
        let mut results: Vec<_> = counts.into_iter().zip(before).collect();
        let read = |diagnostics: &Diagnostics, gateway: usize| {
            channels
                .iter()
                .map(|channel| ChannelState::read(diagnostics, gateway, *channel))
                .collect()
        };
        let read = bus.on_each(&gateways(&active), read)?;
        let is_read: Vec<_> = read.iter().map(Result::is_ok).collect();
        let mut flags = is_read.into_iter();
        results.retain(|_| flags.next().unwrap_or_default());
        let after: Vec<Vec<ChannelState>> = keep(&mut active, read, step);
        let pause = pause(bus);
        for ((member, after), (counts, before)) in active.iter_mut().zip(after).zip(results) {
            member.note_losses(bus, step, &pause);
            let states: Vec<_> = before.into_iter().zip(after).collect();
            for (route, counts) in step.routes.iter().zip(counts) {
                let is_concerned = |channel| channel == route.from || channel == route.to;
                let concerned: Vec<_> =
                    states.iter().filter(|(_, state)| is_concerned(state.channel)).collect();
                let found = check_counts(step.path, *route, &counts, count, &concerned);
                let found = found.map_err(|faults| faults + &pause);
                let check = Check::of_route(step, *route, counts, &concerned, found);
                member.member.report.checks.push(check);
            }
        }
        Ok(GroupEnd::Complete)
    }
}

/// Fails gateways whose channels are not in the internal loopback, before a frame could reach a bus. The
/// number of a node mode is an assumption (H9); the registers of the controller show the mode itself.
fn verify_loopback(
    bus: &mut TestBus,
    active: &mut Vec<&mut Active<'_, '_>>,
    mut before: Counters,
    step: &TestStep<'_>,
) -> Result<Counters> {
    let unverified = active.iter().filter(|active| !active.is_loopback_verified);
    let gateways: Vec<_> = unverified.map(|member| member.gateway).collect();
    let channels = step.channels();
    let read = |diagnostics: &Diagnostics, gateway: usize| {
        Ok(channels.iter().find_map(|channel| wrong_mode(diagnostics, gateway, *channel)))
    };
    let read = bus.on_each(&gateways, read)?;
    for (gateway, fault) in gateways.into_iter().zip(read) {
        let Some(at) = active.iter().position(|active| active.gateway == gateway) else { continue };
        match fault.unwrap_or_else(|error| Some(error.to_string())) {
            None => active[at].is_loopback_verified = true,
            Some(fault) => {
                active.remove(at).fail(step.name(), fault);
                before.remove(at);
            }
        }
    }
    Ok(before)
}

/// Reason why a channel must not send test frames.
fn wrong_mode(diagnostics: &Diagnostics, gateway: usize, channel: u8) -> Option<String> {
    match CanController::new(diagnostics, gateway, channel).mode() {
        Ok(ControllerMode::InternalLoopback) => None,
        Ok(mode) => Some(format!(
            "node mode 2 puts channel {channel} into {mode}, not into internal loopback (assumption H9: \
             the numbers of the manual); no frame was sent"
        )),
        Err(error) => Some(format!(
            "the mode of the controller of channel {channel} cannot be read: {error}; no frame was sent"
        )),
    }
}

/// Channels of the gateways at the start, which are alike.
fn started_channels(config: &PortConfig) -> [Option<McanChannelConfig>; CHANNELS] {
    let gateway = config.gateways.first().copied().unwrap_or_default();
    gateway.channels.map(|channel| channel.map(|channel| channel.can))
}

impl Active<'_, '_> {
    /// A gateway that fails in one step is not tested in the next ones.
    fn fail(&mut self, name: String, reason: String) {
        self.member.report.add(name, Err(reason));
        *self.member.was_lost = true;
        self.is_out = true;
    }

    /// Reports losses since the previous step.
    fn note_losses(&mut self, bus: &TestBus, step: &TestStep<'_>, pause: &str) {
        let losses = bus.losses(self.gateway);
        let detail = match losses.saturating_sub(self.losses) {
            0 => return,
            1 => "the gateway was lost".to_owned(),
            more => format!("the gateway was lost {more} times"),
        };
        self.losses = losses;
        *self.member.was_lost = true;
        let name = format!("ready, {}", step.rate.name());
        self.member.report.add(name, Err(detail + pause));
    }
}

/// Keeps the gateways whose transfers succeeded, and returns the results in their order.
fn keep<T>(
    active: &mut Vec<&mut Active<'_, '_>>,
    results: Vec<Result<T, Error>>,
    step: &TestStep<'_>,
) -> Vec<T> {
    let (mut kept, mut results) = (Vec::new(), results.into_iter());
    active.retain_mut(|active| match results.next() {
        Some(Ok(value)) => {
            kept.push(value);
            true
        }
        Some(Err(error)) => {
            active.fail(step.name(), error.to_string());
            false
        }
        None => false,
    });
    kept
}

/// Remark for an error that this computer may have caused.
fn pause(bus: &TestBus) -> String {
    match bus.longest_period_ns() {
        ..PAUSE_NS => String::new(),
        longest_ns => {
            let ms = longest_ns / 1_000_000;
            format!("; a cycle of this computer took {ms} ms, see the real-time options")
        }
    }
}
