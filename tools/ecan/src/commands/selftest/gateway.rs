//! Test of one gateway, from identity to wiring.

use std::time::Duration;

use ecan_command_line::interrupt::Interrupt;
use ecan_host::AdapterConfig;
use ecan_mcan_port::{GatewayConfig, PortConfig};
use ecan_protocol::config::NodeMode;
use ecan_protocol::mapping::CHANNELS;

use crate::context::{Bus, Failure, Result, note};
use crate::frames::{Channels, GatewaySetup, Service, WATCHDOG, statistics};

use super::exchange::{ChannelState, Counts, Route, exchange, states};
use super::rates::Rate;
use super::report::{Check, Figures, Report};
use super::saved::{Saved, read_patiently, wait_present};
use super::{SelftestArguments, identity};

/// Cycle time in ns that may trigger the watchdog of a gateway.
const PAUSE_NS: u64 = WATCHDOG.as_nanos() as u64 / 2;

pub(super) struct Test<'a> {
    pub(super) arguments: &'a SelftestArguments,
    pub(super) rates: &'a [Rate],
    pub(super) master: u32,
    pub(super) is_watched: bool,
}

struct TestedSlave<'a> {
    bus: &'a Bus,
    slave: usize,
    interrupt: &'a Interrupt,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TestPath {
    Loopback,
    Wire,
}

impl TestPath {
    fn name(self, Route { from, to }: Route, rate: &Rate) -> String {
        match self {
            Self::Loopback => format!("loopback of channel {from}, {}", rate.name()),
            Self::Wire => format!("wire from channel {from} to {to}, {}", rate.name()),
        }
    }
}

struct Run<'a> {
    path: TestPath,
    rate: &'a Rate,
    routes: Vec<Route>,
    adapter: AdapterConfig,
    config: PortConfig,
}

impl Test<'_> {
    /// Checks the options before the bus is accessed.
    pub(super) fn check(&self) -> Result {
        for run in self.runs(0)? {
            let checked = run.config.check(&run.adapter);
            checked.map_err(|faults| Failure::Usage(faults.to_string()))?;
        }
        Ok(())
    }

    pub(super) fn run(&self, bus: &Bus, slave: usize, interrupt: &Interrupt) -> Result<Report> {
        let time = jiff::Timestamp::now().to_string();
        let mut report = Report { position: slave, time, ..Report::default() };
        let expected = self.arguments.expect_version.as_deref();
        if identity::check(bus, slave, expected, &mut report) {
            self.run_channels(&TestedSlave { bus, slave, interrupt }, &mut report)?;
        }
        report.is_good = report.is_good_so_far();
        Ok(report)
    }

    fn run_channels(&self, at: &TestedSlave<'_>, report: &mut Report) -> Result {
        let TestedSlave { bus, slave, .. } = *at;
        let runs = self.runs(slave)?;
        let mut is_tested = [false; CHANNELS];
        for route in runs.iter().flat_map(|run| &run.routes) {
            if let Some(is_tested) = is_tested.get_mut(usize::from(route.from)) {
                *is_tested = true;
            }
        }
        let saved = match Saved::read(bus, slave) {
            Ok(saved) => saved,
            Err(error) => {
                report.add("configuration", Err(format!("not read: {error}")));
                return Ok(());
            }
        };
        let tested = self.run_all(at, runs, report);
        // Without a master, nothing was changed.
        if let Err(failure @ Failure::Master(_)) = tested {
            return Err(failure);
        }
        let restored = match saved.restore(bus, is_tested) {
            Ok(false) => Ok("as before the test".to_owned()),
            Ok(true) => Ok("as before the test, by a restart".to_owned()),
            Err(error) => Err(format!("not restored: {error}")),
        };
        report.add("configuration", restored);
        if !tested? {
            report.stop();
        }
        Ok(())
    }

    /// Returns whether the test ended without stop by the user.
    fn run_all(
        &self,
        at: &TestedSlave<'_>,
        runs: Vec<Run<'_>>,
        report: &mut Report,
    ) -> Result<bool> {
        let TestedSlave { bus, slave, .. } = *at;
        let mut is_first = true;
        for run in runs {
            let name = match run.path {
                TestPath::Loopback => format!("loopback, {}", run.rate.name()),
                TestPath::Wire => format!("wires, {}", run.rate.name()),
            };
            if self.is_watched {
                note(format_args!("testing slave {slave}: {name}"));
            }
            if !is_first && has_restarted(bus, slave) {
                let detail = "the gateway restarted since the previous test";
                report.add(format!("ready, {}", run.rate.name()), Err(detail.to_owned()));
            }
            match self.run_one(at, run, report) {
                Ok(true) => {}
                Ok(false) => return Ok(false),
                // Another program has reserved the master, or there is none.
                Err(failure @ Failure::Master(_)) if is_first => return Err(failure),
                Err(failure) => {
                    // A gateway that does not become ready will not at the next bit rate either.
                    report.add(name, Err(failure.to_string()));
                    return Ok(true);
                }
            }
            is_first = false;
        }
        Ok(true)
    }

    fn run_one(&self, at: &TestedSlave<'_>, run: Run<'_>, report: &mut Report) -> Result<bool> {
        let TestedSlave { bus, slave, interrupt } = *at;
        let Run { adapter, config, .. } = run;
        let setup = GatewaySetup { position: slave, adapter, config, channels: Channels::NONE };
        wait_present(bus, slave)?;
        let real_time = &self.arguments.real_time;
        let started = Service::start(bus.ecrt(), setup, real_time, interrupt)?;
        let Some(service) = started else { return Ok(false) };
        // From here on, an error is one of the gateway or its link.
        self.exchange(service, run, report).map_err(|error| Failure::Rejected(error.to_string()))
    }

    fn exchange(&self, mut service: Service, run: Run<'_>, report: &mut Report) -> Result<bool> {
        let Run { path, rate, routes, .. } = run;
        let count = self.arguments.frames;
        let channels: Vec<_> = routes.iter().map(|route| route.from).collect();
        service.port_mut().adapter_mut().measure_cycles();
        let before = states(&mut service, &channels)?;
        let exchanged = exchange(&mut service, &routes, count, rate.is_fd())?;
        let Some(counts) = exchanged else { return Ok(false) };
        let after = states(&mut service, &channels)?;
        let pause = pause(&service);
        if let Some(detail) = losses(&service) {
            report.add(format!("ready, {}", rate.name()), Err(detail + &pause));
        }
        for (route, counts) in routes.into_iter().zip(counts) {
            let is_concerned = |channel| channel == route.from || channel == route.to;
            let concerned: Vec<_> =
                before.iter().zip(&after).filter(|(_, it)| is_concerned(it.channel)).collect();
            let found = check_counts(path, route, &counts, count, &concerned);
            let is_good = found.is_ok();
            let detail = found.unwrap_or_else(|faults| faults + &pause);
            let (bitrate, data_bitrate) = rate.bit_rates();
            let channels = concerned.into_iter().map(|(_, after)| *after).collect();
            let Route { from, to } = route;
            let frames = Figures { from, to, bitrate, data_bitrate, counts, channels };
            let name = path.name(route, rate);
            report.checks.push(Check { name, is_good, detail, frames: Some(frames) });
        }
        Ok(true)
    }

    /// Runs everything with a gateway: at each bit rate the loopbacks, then the wires.
    fn runs(&self, slave: usize) -> Result<Vec<Run<'_>>> {
        let loops: Vec<_> =
            self.arguments.channels.iter().map(|it| Route { from: it, to: it }).collect();
        let pairs = self.arguments.wired.iter().flat_map(|wiring| wiring.pairs());
        let both = |&(a, b): &(u8, u8)| [Route { from: a, to: b }, Route { from: b, to: a }];
        let wires: Vec<_> = pairs.flat_map(both).collect();
        let position = u16::try_from(slave)
            .map_err(|_| Failure::Slave(format!("slave {slave} does not exist")))?;
        let mut runs = Vec::new();
        for rate in self.rates {
            let paths = [
                (TestPath::Loopback, NodeMode::InternalLoopback, &loops),
                (TestPath::Wire, NodeMode::Normal, &wires),
            ];
            for (path, mode, routes) in paths.into_iter().filter(|(.., routes)| !routes.is_empty())
            {
                let mut gateway = GatewayConfig::default();
                for route in routes {
                    gateway.channels[usize::from(route.from)] = Some(rate.channel(mode));
                }
                let adapter = self.adapter(position);
                let config = PortConfig::uniform(1, gateway);
                runs.push(Run { path, rate, routes: routes.clone(), adapter, config });
            }
        }
        Ok(runs)
    }

    fn adapter(&self, position: u16) -> AdapterConfig {
        let SelftestArguments { pdo_n, cycle_us, large_pdos, .. } = *self.arguments;
        let mut adapter = AdapterConfig::new(1)
            .with_multiplier(pdo_n)
            .with_cycle(Duration::from_micros(cycle_us.into()))
            .with_watchdog(WATCHDOG);
        adapter.master_index = self.master;
        adapter.allow_large_pdos = large_pdos;
        for slave in &mut adapter.slaves {
            slave.position = position;
        }
        adapter
    }
}

/// Returns whether a gateway has lost the profile of the previous test. A gateway that does not
/// respond fails the next test.
fn has_restarted(bus: &Bus, slave: usize) -> bool {
    read_patiently(bus, slave, 0x8010, 9).is_ok_and(|bytes| bytes == 0)
}

fn losses(service: &Service) -> Option<String> {
    match statistics(service.port()).sessions_lost {
        0 => None,
        1 => Some("the gateway was lost".to_owned()),
        more => Some(format!("the gateway was lost {more} times")),
    }
}

/// Remark for an error that this computer may have caused.
fn pause(service: &Service) -> String {
    let measured = service.port().adapter().cycle_statistics();
    match measured.map_or(0, |it| it.period().max_ns) {
        ..PAUSE_NS => String::new(),
        longest_ns => {
            let ms = longest_ns / 1_000_000;
            format!("; a cycle of this computer took {ms} ms, see the real-time options")
        }
    }
}

/// Result of a route; `states` are those of its channels before and after.
fn check_counts(
    path: TestPath,
    route: Route,
    counts: &Counts,
    expected: u16,
    states: &[(&ChannelState, &ChannelState)],
) -> Result<String, String> {
    let mut faults = Vec::new();
    let came = counts.received + counts.wrong;
    if came < u32::from(expected) {
        let why = missing(path, route, states).map_or_else(String::new, |why| format!(" ({why})"));
        faults.push(format!("{came} of {expected} frames received{why}"));
    }
    if let Some(first) = &counts.first_wrong {
        faults.push(format!("{} frames received with errors, the first: {first}", counts.wrong));
    }
    if counts.repeated > 0 {
        faults.push(format!("{} frames received twice", counts.repeated));
    }
    if counts.strange > 0 {
        let (to, strange) = (route.to, counts.strange);
        let detail = "from another sender; check for other nodes on its bus";
        faults.push(format!("channel {to} received {strange} frames {detail}"));
    }
    faults.extend(states.iter().flat_map(|(before, after)| after.faults(before)));
    match faults.is_empty() {
        true if came == 1 => Ok("1 frame, no errors".to_owned()),
        true => Ok(format!("{came} frames, no errors")),
        false => Err(faults.join("; ")),
    }
}

fn missing(
    path: TestPath,
    Route { from, to }: Route,
    states: &[(&ChannelState, &ChannelState)],
) -> Option<String> {
    let (_, sender) = states.iter().find(|(_, state)| state.channel == from)?;
    (path == TestPath::Wire && sender.is_unheard()).then(|| {
        format!("no acknowledgement; check the wiring from channel {from} to channel {to} and its termination")
    })
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use ecan_sim::{ClockKind, SimOptions};

    use super::*;
    use crate::commands::filter::{ChannelFilters, FilterKind};

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: SelftestArguments,
    }

    fn bus() -> Bus {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(ecan_sim::echo(1), &options).unwrap();
        Bus::over(&backend.ecrt)
    }

    /// Runs a part of the test for a command line.
    fn with_test<T>(line: &[&str], run: impl FnOnce(&Test<'_>) -> T) -> T {
        let Line { arguments } = Line::parse_from(line);
        let rates = Rate::usual();
        run(&Test { arguments: &arguments, rates: &rates, master: 0, is_watched: false })
    }

    fn tested(bus: &Bus) -> Report {
        with_test(&["selftest", "--wired", "0-1", "--frames", "2"], |test| {
            test.run(bus, 0, &Interrupt::default()).unwrap()
        })
    }

    fn configuration_check(report: &Report) -> &Check {
        report.checks.iter().find(|it| it.name == "configuration").unwrap()
    }

    /// All writable values and the active configuration: profiles, data paths, channels.
    fn everything(bus: &Bus) -> Vec<(u16, u8, u32)> {
        let objects = [
            0x1C12, 0x1C13, 0x8000, 0x8001, 0x8002, 0x8003, 0x8004, 0x8010, 0x8011, 0x8020, 0x8021,
            0x8022, 0x8023, 0x8024,
        ];
        let is_window = |index: u16, subindex: u8| {
            (0x8001..=0x8004).contains(&index) && (43..=60).contains(&subindex)
        };
        let entries = objects.into_iter().flat_map(|index| {
            let object = ecan_protocol::object::object(index).unwrap();
            object.entries.iter().map(move |entry| (index, entry))
        });
        let written = entries
            .filter(|(_, entry)| entry.access.can_read() && entry.access.can_write())
            .map(|(index, entry)| (index, entry.subindex))
            .filter(|(index, subindex)| !is_window(*index, *subindex));
        let active_config = [(0x8010, 9), (0x8010, 12), (0x8011, 9), (0x8011, 12), (0x8021, 20)];
        let channels = (0x9000..=0x9003).map(|index| (index, 9));
        let counts = (0x8001..=0x8004).flat_map(|index| [(index, 49), (index, 55)]);
        let read = |(index, subindex)| (index, subindex, bus.read(0, index, subindex).unwrap());
        written.chain(active_config).chain(channels).chain(counts).map(read).collect()
    }

    #[test]
    fn fresh_gateway_is_restored() {
        let bus = bus();
        // Values that were not applied.
        for (index, subindex, value) in [(0x8002, 19, 800_000), (0x8003, 36, 2), (0x8023, 4, 1)] {
            bus.write(0, index, subindex, value).unwrap();
        }
        let before = everything(&bus);
        assert!(before.contains(&(0x8010, 9, 0)) && before.contains(&(0x9000, 9, 0)));
        let report = tested(&bus);
        // Echo nodes on the buses: the loopbacks pass, the wires fail.
        let good: Vec<_> = report.checks.iter().filter(|it| it.name.starts_with("loop")).collect();
        assert!(good.len() == 24 && good.iter().all(|it| it.is_good), "{good:?}");
        assert!(!report.is_good);
        assert_eq!(configuration_check(&report).detail, "as before the test, by a restart");
        assert_eq!(everything(&bus), before);
    }

    #[test]
    fn gateway_in_use_is_restored() {
        let bus = bus();
        let write = |index, subindex, value| bus.write(0, index, subindex, value).unwrap();
        for direction in ecan_protocol::mapping::Direction::ALL {
            for write in ecan_protocol::config::assignment_writes(direction, 3) {
                bus.write(0, write.index, write.subindex, write.value).unwrap();
            }
            write(direction.profile_object(), 3, 3);
            write(direction.profile_object(), 1, 1);
        }
        // Channel 1 is active, with a filter; the others are not.
        for (subindex, value) in [(19, 800_000), (43, 0), (50, 1), (51, 1), (53, 5), (54, 6)] {
            write(0x8002, subindex, value);
        }
        let save = ecan_protocol::config::FilterCommand::Save.raw().into();
        for (subindex, value) in [(45, save), (49, 1), (1, 1)] {
            write(0x8002, subindex, value);
        }
        write(0x8020, 7, 500);
        write(0x8020, 2, 1);
        let filter = || {
            let filters = ChannelFilters { bus: &bus, slave: 0, channel: 1 };
            filters.read(FilterKind::Standard).unwrap()
        };
        let before = (everything(&bus), filter());
        assert!(before.0.contains(&(0x8010, 9, 3 * 128)));
        assert_eq!(bus.read(0, 0x9001, 9).unwrap() & 7, 2, "on the bus");
        assert_eq!((before.1[0].id1, before.1[0].id2), (5, 6));
        let report = tested(&bus);
        let check = configuration_check(&report);
        assert!(check.is_good, "{check:?}");
        assert_eq!((everything(&bus), filter()), before);
    }

    #[test]
    fn gateway_is_restarted_only_if_needed() {
        let bus = bus();
        // For example from an earlier test.
        with_test(&["selftest"], |test| {
            let run = test.runs(0).unwrap().into_iter().next().unwrap();
            let at = TestedSlave { bus: &bus, slave: 0, interrupt: &Interrupt::default() };
            test.run_one(&at, run, &mut Report::default()).unwrap();
        });
        wait_present(&bus, 0).unwrap();
        let before = everything(&bus);
        let report = tested(&bus);
        assert_eq!(configuration_check(&report).detail, "as before the test");
        assert_eq!(everything(&bus), before);
    }
}
