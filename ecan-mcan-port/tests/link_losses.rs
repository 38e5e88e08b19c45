//! Link losses in quick succession during any phase: every gateway becomes ready again.

use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic, frames_of, id};
use ecan_host::{AdapterConfig, Clock as _, DcSync};
use ecan_mcan_port::{GatewayConfig, Port, PortConfig, Session};
use ecan_sim::variant::ServicePeriod;
use ecan_sim::{
    ClockKind, Fault, GatewayFault, MasterBehaviour, Scenario, ScriptedFault, SimOptions, Topology,
    When,
};
use proptest::prelude::*;

const MS: u64 = 1_000_000;
/// Longest scan of a gateway (the master uploads its mapping): cycles, besides a second.
const SCAN_CYCLES: u64 = 3_300;
/// SDO transfers of the verification of a gateway, at most, and cycles of one.
const TRANSFERS: u64 = 40;
const CYCLES_PER_TRANSFER: u64 = 6;
/// Time without interruption for which all gateways must be ready: the master's state lags.
const STEADY_NS: u64 = 1_000 * MS;

/// What the faults interrupt.
#[derive(Debug, Clone, Copy)]
enum Interrupted {
    /// The call that opens the Port, this time after its begin.
    Opening { after_ms: u64 },
    /// The startup, this time after activation.
    Startup { after_ms: u64 },
    /// A verification, this time after its begin.
    Verification { after_ms: u64 },
    /// The operation, this time after all gateways are ready.
    Operation { after_ms: u64 },
}

#[derive(Debug, Clone)]
struct Machine {
    gateways: usize,
    is_star: bool,
    multiplier: u8,
    cycle_us: u64,
    has_dc: bool,
    is_igh: bool,
    /// Period of a service loop that runs freely.
    service_us: Option<u16>,
    channels: usize,
}

#[derive(Debug, Clone)]
struct Case {
    machine: Machine,
    interrupted: Interrupted,
    /// The faults in the order of their starts, in milliseconds after the time of `interrupted`.
    faults: Vec<(u64, Fault)>,
}

fn machine() -> impl Strategy<Value = Machine> {
    (
        1..3usize,
        any::<bool>(),
        prop::sample::select(vec![1, 3, 5, 8]),
        prop::sample::select(vec![500, 1_000, 2_000, 4_000]),
        any::<bool>(),
        any::<bool>(),
        prop::option::of(50..=1_000u16),
        1..=4usize,
    )
        .prop_map(
            |(gateways, is_star, multiplier, cycle_us, has_dc, is_igh, service_us, channels)| {
                Machine {
                    gateways,
                    is_star: is_star && gateways > 1,
                    multiplier,
                    cycle_us,
                    has_dc,
                    is_igh,
                    service_us,
                    channels,
                }
            },
        )
}

fn interrupted() -> impl Strategy<Value = Interrupted> {
    prop_oneof![
        (0..4_000u64).prop_map(|after_ms| Interrupted::Opening { after_ms }),
        (0..8_000u64).prop_map(|after_ms| Interrupted::Startup { after_ms }),
        (0..400u64).prop_map(|after_ms| Interrupted::Verification { after_ms }),
        (0..4_000u64).prop_map(|after_ms| Interrupted::Operation { after_ms }),
    ]
}

/// Two or three link losses that start within 200 ms, perhaps with a power cycle.
fn faults(gateways: usize) -> impl Strategy<Value = Vec<(u64, Fault)>> {
    let length = || prop_oneof![2 => 1..20u32, 2 => 20..250u32, 1 => 250..2_500u32];
    let loss = (0..200u64, 0..gateways, length())
        .prop_map(|(at, gateway, for_ms)| (at, Fault::LinkLoss { gateway, for_ms }));
    let power = (0..200u64, 0..gateways, length())
        .prop_map(|(at, gateway, off_ms)| (at, Fault::PowerCycle { gateway, off_ms }));
    (prop::collection::vec(loss, 2..4), prop::option::weighted(0.3, power)).prop_map(
        |(mut faults, power)| {
            faults.extend(power);
            faults.sort_by_key(|(at, _)| *at);
            faults
        },
    )
}

fn case() -> impl Strategy<Value = Case> {
    machine().prop_flat_map(|machine| {
        let faults = faults(machine.gateways);
        (Just(machine), interrupted(), faults).prop_map(|(machine, interrupted, faults)| Case {
            machine,
            interrupted,
            faults,
        })
    })
}

fn scenario(machine: &Machine) -> Scenario {
    let mut scenario = ecan_sim::echo(machine.gateways);
    scenario.master = if machine.is_igh { MasterBehaviour::IGH } else { MasterBehaviour::IDEAL };
    scenario.topology = if machine.is_star { Topology::Star } else { Topology::Line };
    for gateway in &mut scenario.gateways {
        if let Some(period) = machine.service_us.and_then(ServicePeriod::free_running) {
            gateway.config.variant.service_period_us = period;
        }
    }
    scenario
}

fn config(machine: &Machine) -> (AdapterConfig, PortConfig) {
    let cycle = Duration::from_micros(machine.cycle_us);
    let mut adapter = AdapterConfig::new(machine.gateways as u16)
        .with_multiplier(machine.multiplier)
        .with_cycle(cycle);
    if machine.has_dc {
        adapter.dc = Some(DcSync::planned(cycle, &adapter));
    }
    let mut gateway = GatewayConfig::on_channel(0, classic());
    for channel in &mut gateway.channels[..machine.channels] {
        *channel = Some(classic());
    }
    (adapter, PortConfig::uniform(machine.gateways, gateway))
}

/// Time in which all gateways become ready after the last fault.
///
/// A return consists of a scan, a startup that is requested again after 4 s at most (2 s, and
/// 4 s after a first request), 3 s in which a gateway without process data is identified, and a
/// verification (4 s and its transfers) that is repeated after 1 s. The faults can spoil the return
/// that is in progress when they end, and shift the positions that it uses: two returns.
fn bound_ns(machine: &Machine, startup_timeout: Duration) -> u64 {
    let gateways = machine.gateways as u64;
    let cycles = gateways * (SCAN_CYCLES + TRANSFERS * CYCLES_PER_TRANSFER);
    let of_cycles = cycles * machine.cycle_us * 1_000;
    let startup_ns = u64::try_from(startup_timeout.as_nanos()).unwrap();
    2 * (of_cycles + startup_ns + (gateways + 4 + 3 + 4 + 1) * 1_000 * MS)
}

/// Opens the Port, again if the faults of the script prevent it until `end_ms`.
fn open(case: &Case, faults: Vec<ScriptedFault>, end_ms: u64) -> Fixture {
    let mut scenario = scenario(&case.machine);
    scenario.faults = faults;
    let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
    let backend = ecan_sim::open_scenario(scenario, &options).unwrap();
    let simulation = backend.simulation.unwrap();
    let begin = simulation.clock().now_ns();
    loop {
        let is_over = simulation.clock().now_ns() - begin >= (end_ms + 2_000) * MS;
        match Port::open(&backend.ecrt, config(&case.machine)) {
            Ok(port) => return Fixture { port, simulation, cycle_errors: Vec::new() },
            Err(error) => assert!(!is_over, "{error}"),
        }
        simulation.pass_ns(500 * MS);
    }
}

struct Run {
    fixture: Fixture,
    cycle_ns: u64,
}

impl Run {
    fn now(&self) -> u64 {
        self.fixture.port.adapter().clock().now_ns()
    }

    fn until(&mut self, time_ns: u64) {
        while self.now() < time_ns {
            self.fixture.idle(1);
        }
    }

    fn pass_ms(&mut self, ms: u64) {
        self.until(self.now() + ms * MS);
    }

    fn status(&self) -> String {
        let port = &self.fixture.port;
        let of = |gateway| {
            let (session, waits_for) = (port.session(gateway), port.waiting_for(gateway));
            format!("{session}, waits for {waits_for:?}\n")
        };
        let log = self.fixture.simulation.kernel_log();
        port.gateways().map(of).chain(log.into_iter().map(|line| line + "\n")).collect()
    }

    fn until_ready(&mut self, limit_ns: u64) {
        let cycles = usize::try_from(limit_ns / self.cycle_ns).unwrap() + 1;
        assert!(self.fixture.until(cycles, Port::is_ready).is_some(), "{}", self.status());
    }

    /// Until all gateways have been ready for some time, which begins within the limit.
    fn until_steady(&mut self, limit_ns: u64) {
        let begin = self.now();
        loop {
            let passed_ns = self.now() - begin;
            self.until_ready(limit_ns.saturating_sub(passed_ns));
            let since = self.now();
            while self.fixture.port.is_ready() {
                if self.now() - since >= STEADY_NS {
                    return;
                }
                self.fixture.idle(1);
            }
        }
    }

    /// A frame on every channel crosses and its echo returns.
    fn carry(&mut self, channels: usize) {
        let port = &self.fixture.port;
        let ports: Vec<(usize, u8)> = (0..port.slave_count())
            .flat_map(|slave| (0..channels).map(move |channel| (slave, channel as u8)))
            .collect();
        let mut missing = ports.clone();
        for cycle in 0..100 {
            let items = self.fixture.cycle(|open| {
                for &(slave, channel) in ports.iter().filter(|_| cycle == 0) {
                    let data = [slave as u8, channel];
                    open.send_can(slave, channel, id(0x77), &data).unwrap();
                }
            });
            for received in frames_of(&items) {
                let data = received.frame.data();
                missing.retain(|(slave, channel)| data != [*slave as u8, *channel]);
            }
        }
        assert!(missing.is_empty(), "without echo: {missing:?}\n{}", self.status());
        assert!(self.fixture.port.is_ready(), "{}", self.status());
    }
}

fn length_ms(fault: &Fault) -> u64 {
    match fault {
        Fault::LinkLoss { for_ms: ms, .. } | Fault::PowerCycle { off_ms: ms, .. } => (*ms).into(),
        other => panic!("a fault without length: {other:?}"),
    }
}

fn run(case: &Case) {
    let Case { machine, interrupted, faults } = case;
    let end_ms = faults.iter().map(|(at, fault)| at + length_ms(fault)).max().unwrap_or_default();
    let (script, after_ms) = match *interrupted {
        Interrupted::Opening { after_ms } => (faults.as_slice(), after_ms),
        _ => (&[][..], 0),
    };
    let scripted = |(at_ms, fault): &(u64, Fault)| ScriptedFault {
        when: When::At((after_ms + at_ms) * MS),
        fault: fault.clone(),
    };
    let fixture = open(case, script.iter().map(scripted).collect(), after_ms + end_ms);
    let mut run = Run { fixture, cycle_ns: machine.cycle_us * 1_000 };
    let bound_ns = bound_ns(machine, run.fixture.port.startup_timeout());
    run.fixture.port.adapter_mut().activate().unwrap();
    match *interrupted {
        Interrupted::Opening { after_ms } => {
            let start = run.fixture.simulation.with_world(|world| world.start_ns());
            run.until(start + (after_ms + end_ms) * MS);
        }
        Interrupted::Startup { after_ms } => run.pass_ms(after_ms),
        Interrupted::Verification { after_ms } => {
            run.until_ready(bound_ns);
            run.pass_ms(500);
            let fault = GatewayFault::AlError { code: 0x001A };
            run.fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
            let is_verifying = |port: &Port| port.session(port.gw(0)) == Session::Verifying;
            let cycles = usize::try_from(bound_ns / run.cycle_ns).unwrap();
            assert!(run.fixture.until(cycles, is_verifying).is_some(), "{}", run.status());
            run.pass_ms(after_ms);
        }
        Interrupted::Operation { after_ms } => {
            run.until_ready(bound_ns);
            run.pass_ms(after_ms);
        }
    }
    if script.is_empty() {
        let begin = run.now();
        for (at_ms, fault) in faults {
            run.until(begin + at_ms * MS);
            run.fixture.simulation.inject(fault.clone());
        }
        run.until(begin + end_ms * MS + run.cycle_ns);
    }
    run.until_steady(bound_ns);
    run.carry(machine.channels);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn gateways_return_after_link_losses(case in case()) {
        run(&case);
    }
}
