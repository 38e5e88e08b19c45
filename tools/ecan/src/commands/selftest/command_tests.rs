//! Tests with the gateway's memory in view.

use clap::Parser;
use ecan_sim::{ClockKind, SimOptions};

use super::super::report::Check;
use super::*;
use crate::commands::filter::{ChannelFilters, FilterKind};
use crate::commands::saved_config::wait_present;

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    arguments: SelftestArguments,
}

fn bus() -> Bus {
    bus_of(ecan_sim::echo(1)).0
}

fn bus_of(scenario: ecan_sim::Scenario) -> (Bus, ecan_sim::Simulation) {
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
    (Bus::over(&backend.ecrt), backend.simulation.unwrap())
}

/// Runs a part of the test for a command line.
fn with_plan<T>(line: &[&str], run: impl FnOnce(&TestPlan<'_>) -> T) -> T {
    let Line { arguments } = Line::parse_from(line);
    let rates = Rate::usual();
    run(&TestPlan::new(&arguments, &rates, 0).unwrap())
}

fn tested(bus: &Bus) -> GatewayReport {
    let line = ["selftest", "--wired", "0-1", "--frames", "2"];
    let (run, tested) =
        with_plan(&line, |plan| test_and_restore(bus, plan, &[0], &Interrupt::default()).unwrap());
    assert_eq!(run.unwrap(), GroupEnd::Complete);
    tested.into_iter().next().unwrap()
}

fn configuration_check(report: &GatewayReport) -> &Check {
    report.checks.iter().find(|check| check.name == "configuration").unwrap()
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
    let good: Vec<_> =
        report.checks.iter().filter(|check| check.name.starts_with("loop")).collect();
    assert!(good.len() == 24 && good.iter().all(|check| check.is_good == Some(true)), "{good:?}");
    assert!(!report.is_good_so_far());
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
    assert_eq!(check.is_good, Some(true), "{check:?}");
    assert_eq!((everything(&bus), filter()), before);
}

#[test]
fn gateway_is_restarted_only_if_needed() {
    let bus = bus();
    // For example by an earlier test.
    with_plan(&["selftest"], |plan| {
        let mut gateways = read(&bus, &[0], plan.arguments());
        test(&bus, plan, &Interrupt::default(), &mut gateways).unwrap();
    });
    wait_present(&bus, 0).unwrap();
    let before = everything(&bus);
    let report = tested(&bus);
    assert_eq!(configuration_check(&report).detail, "as before the test");
    assert_eq!(everything(&bus), before);
}

/// Node that sends a frame in each 100 ms, and acknowledges others.
#[derive(Default)]
struct Sender {
    due_ns: Option<u64>,
}

impl ecan_sim::Node for Sender {
    fn next_event(&self) -> Option<u64> {
        self.due_ns.or(Some(0))
    }

    fn advance(&mut self, now: u64, out: &mut ecan_sim::NodeOutput) {
        let id = ecan_protocol::can::CanId::standard(0x81).unwrap();
        out.send(ecan_protocol::can::CanFrame::classic(id, &[1]).unwrap());
        self.due_ns = Some(now + 100_000_000);
    }
}

#[test]
fn traffic_of_an_active_channel_is_seen_without_a_change() {
    let (bus, simulation) = bus_of(ecan_sim::echo(1));
    let observe = || of_active_channels(&bus, &[0], [true; 4], 500);
    // Channel 1 is active, the others are not.
    for (subindex, value) in [(15, 0), (1, 1)] {
        bus.write(0, 0x8002, subindex, value).unwrap();
    }
    assert_eq!(observe(), []);
    let settings = || -> Vec<_> {
        everything(&bus).into_iter().filter(|(index, ..)| *index < 0x9000).collect()
    };
    let before = settings();
    let node = simulation.attach_node("0.1", "sender", Box::new(Sender::default())).unwrap();
    let traffic = observe();
    assert_eq!(traffic.len(), 1, "{traffic:?}");
    assert_eq!((traffic[0].position, traffic[0].channel), (0, 1));
    assert_eq!(traffic[0].seen, "it is active and has received frames");
    // The FIFO is not read: it is full and shows no change.
    bus.sleep_ns(60_000_000_000);
    assert_eq!(observe()[0].seen, "it is active, and RX FIFO0 is full of frames");
    drop(node);
    assert!(settings() == before);
    assert_eq!(of_active_channels(&bus, &[0], [true, false, true, true], 1), []);
}
