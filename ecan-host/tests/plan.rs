//! The preflight plan: figures worked out by hand, and against the simulated master.

use std::time::Duration;

use crate::common::{add_profile, run, simulated};
use ecan_host::{
    Adapter, AdapterConfig, BYTE_NS, ClockSource, DatagramUse, DcSync, FRAME_OVERHEAD_BYTES,
    LogicalCommand, Plan, PlanError, PlanWarning, StartupPlan,
};
use ecan_sim::EcrtVersion;
use proptest::prelude::*;

fn config(slaves: u16, multiplier: u8, cycle_us: u32) -> AdapterConfig {
    AdapterConfig::new(slaves)
        .with_multiplier(multiplier)
        .with_cycle(Duration::from_micros(cycle_us.into()))
}

fn plan(slaves: u16, multiplier: u8, cycle_us: u32) -> Plan {
    Plan::of(&config(slaves, multiplier, cycle_us))
}

fn frame_bytes(plan: &Plan) -> Vec<usize> {
    plan.frames.iter().map(|frame| frame.wire_bytes()).collect()
}

// Golden figures

/// One LRW of 2 * 384 = 768 bytes: datagram 768 + 12 = 780, frame 780 + 40 = 820 bytes, times
/// 80 ns = 65.6 us. Of 11250 bytes a millisecond 10430 are left, 33 mailbox transfers of 308.
/// The last 12 bytes are gap: the image is there after 808 bytes, 64.64 us.
#[test]
fn one_slave_of_three_chunks_at_a_millisecond() {
    let plan = plan(1, 3, 1_000);
    assert_eq!(frame_bytes(&plan), [820]);
    let datagrams: Vec<_> = plan.datagrams().map(|d| (d.purpose, d.bytes())).collect();
    let lrw = DatagramUse::ProcessData { slave: 0, command: LogicalCommand::ReadWrite };
    assert_eq!(datagrams, [(lrw, 780)]);
    assert_eq!((plan.process_data_bytes(), plan.wire_bytes(), plan.wire_ns()), (768, 820, 65_600));
    assert!((plan.wire_share() - 0.0656).abs() < 1e-9);
    assert_eq!(plan.expected_working_counter((1, 6)), 3);
    assert_eq!(plan.expected_working_counter((1, 5)), 3);
    let mailbox = plan.mailbox;
    assert_eq!((mailbox.available_bytes, mailbox.headroom_bytes()), (11_250, 10_430));
    assert_eq!(mailbox.transfers(), 33);
    assert_eq!(plan.slaves[0].outputs_arrive_ns, 64_640);
    assert_eq!((plan.rejections, plan.warnings), (vec![], vec![]));
}

/// An LRW of 1280 bytes each, 1292 in a frame of its own: 1332 bytes, three of them 3996 bytes and
/// 319.68 us. Slave 1 has its image after 1332 + 1320 bytes, 212.16 us.
#[test]
fn three_slaves_of_five_chunks_have_a_frame_each() {
    let plan = plan(3, 5, 1_000);
    assert_eq!(frame_bytes(&plan), [1332, 1332, 1332]);
    assert_eq!((plan.process_data_bytes(), plan.wire_ns()), (3_840, 319_680));
    assert_eq!(plan.expected_working_counter((1, 6)), 9);
    assert_eq!(plan.expected_working_counter((1, 5)), 9);
    assert_eq!(plan.slaves[1].outputs_arrive_ns, 212_160);
    assert_eq!(plan.mailbox.headroom_bytes(), 11_250 - 3_996);
    assert_eq!((plan.rejections, plan.warnings), (vec![], vec![]));
}

/// LWR and LRD of 768 bytes, 780 each: two of them are 1560 and do not fit the 1498 bytes that a
/// frame has for datagrams, so six frames of 820 bytes: 4920 bytes, 393.6 us.
#[test]
fn three_slaves_of_six_chunks_have_two_frames_each() {
    let plan = plan(3, 6, 1_000);
    assert_eq!(frame_bytes(&plan), [820; 6]);
    let commands: Vec<_> = plan.datagrams().map(|d| d.purpose.to_string()).collect();
    assert_eq!(commands[..3], ["slave 0 LWR", "slave 0 LRD", "slave 1 LWR"]);
    assert_eq!((plan.wire_bytes(), plan.wire_ns()), (4_920, 393_600));
    assert_eq!(plan.expected_working_counter((1, 6)), 6);
    assert_eq!(plan.expected_working_counter((1, 5)), 9);
    // What slave 2 is sent stands in the fifth frame: 4 * 820 + 808 bytes.
    assert_eq!(plan.slaves[2].outputs_arrive_ns, 327_040);
}

/// LWR and LRD of 1408 bytes, 1420 each, in frames of 1460: 8760 bytes, 700.8 us. 2490 bytes are
/// left for mailboxes, four transfers.
#[test]
fn three_slaves_of_eleven_chunks_fill_two_thirds_of_a_millisecond() {
    let plan = plan(3, 11, 1_000);
    assert_eq!(frame_bytes(&plan), [1460; 6]);
    assert_eq!((plan.process_data_bytes(), plan.wire_ns()), (8_448, 700_800));
    assert_eq!(plan.expected_working_counter((1, 6)), 6);
    assert_eq!(plan.expected_working_counter((1, 5)), 9);
    assert_eq!((plan.mailbox.headroom_bytes(), plan.mailbox.transfers()), (2_490, 8));
    assert_eq!((plan.rejections, plan.warnings), (vec![], vec![]));
}

/// LRWs of 256 bytes, 268 each: five fit a frame (1340 + 2 of 1500), the sixth does not. The two
/// clock datagrams of 4 + 12 bytes go into the last frame: 268 + 32 + 40 = 340.
#[test]
fn small_images_and_clocks_share_frames() {
    let mut config = config(6, 1, 1_000);
    let dc = DcSync { monitor_every: 0, ..DcSync::new(Duration::from_millis(1), Duration::ZERO) };
    config.dc = Some(dc);
    let plan = Plan::of(&config);
    assert_eq!(frame_bytes(&plan), [1_380, 340]);
    let clocks = |dc| {
        let plan = Plan::of(&AdapterConfig { dc: Some(dc), ..config });
        plan.datagrams().filter(|d| d.purpose == DatagramUse::Clock).count()
    };
    assert_eq!(clocks(dc), 2);
    assert_eq!(clocks(DcSync { monitor_every: 100, ..dc }), 3, "in every hundredth cycle");
    assert_eq!(clocks(DcSync { source: ClockSource::Reference, ..dc }), 1);
    // The one frame brings all five images at its end: 1368 bytes.
    assert_eq!(plan.slaves[0].outputs_arrive_ns, plan.slaves[4].outputs_arrive_ns);
    assert_eq!(plan.slaves[4].outputs_arrive_ns, 109_440);
}

/// RxPDO 11 and TxPDO 4: 1408 + 512 bytes are more than 1486.
#[test]
fn directions_of_different_size() {
    let mut config = config(1, 4, 1_000);
    config.slaves[0].rx_multiplier = 11;
    let plan = Plan::of(&config);
    assert_eq!(frame_bytes(&plan), [1_460, 564]);
    assert_eq!(plan.expected_working_counter((1, 6)), 2);
}

// Findings

#[test]
fn plan_errors_have_figures_and_remedy() {
    let rejected = |config: AdapterConfig| {
        let rejections = Plan::of(&config).rejections;
        let all: Vec<_> = rejections.iter().map(ToString::to_string).collect();
        assert!(config.check().is_err(), "{all:?}");
        all
    };
    // 12 * 128 = 1536 bytes each way.
    let [rx, tx] = &rejected(config(1, 12, 1_000))[..] else { panic!() };
    assert!(rx.starts_with("slave 0: RxPDO size N = 12 needs 1536 bytes"), "{rx}");
    assert!(tx.contains("TxPDO") && tx.contains("N is at most 11"), "{tx}");
    let [time] = &rejected(config(3, 11, 500))[..] else { panic!() };
    assert!(time.contains("700.8 us on the wire") && time.contains("500.0 us"), "{time}");
    assert!(time.contains("smaller N or a longer cycle"), "{time}");
    let [mailbox] = &rejected(config(3, 11, 800))[..] else { panic!() };
    assert!(mailbox.contains("9068 bytes") && mailbox.contains("9000 bytes"), "{mailbox}");
}

#[test]
fn allowed_large_pdos_are_planned() {
    let mut config = config(1, 12, 1_000);
    config.allow_large_pdos = true;
    let plan = Plan::of(&config);
    assert_eq!(plan.rejections, []);
    // 1486 + 12 + 40, then 50 + 12 and 1486 + 12 do not share a frame, nor do they and the rest.
    assert_eq!(frame_bytes(&plan), [1_538, 102, 1_538, 102]);
}

/// 700.8 us are 82 % of 850 us, and of 9562 bytes 802 are left, two transfers for three slaves; of
/// 877 us they are 79.9 %, and 1106 bytes are three.
#[test]
fn small_margin_is_a_warning() {
    let of = |cycle_us| {
        let plan = plan(3, 11, cycle_us);
        assert_eq!((plan.rejections.len(), config(3, 11, cycle_us).check()), (0, Ok(())));
        plan.warnings
    };
    assert_eq!(
        of(850),
        [
            PlanWarning::MailboxTight { transfers: 2, slaves: 3 },
            PlanWarning::WireTime { wire_ns: 700_800, cycle_ns: 850_000 }
        ]
    );
    assert!(of(850)[1].to_string().contains("82 % of the cycle"), "{}", of(850)[1]);
    assert_eq!(of(877), []);
}

#[test]
fn watchdog_shorter_than_two_cycles_is_a_warning() {
    let of = |watchdog_us| {
        Plan::of(&config(1, 3, 1_000).with_watchdog(Duration::from_micros(watchdog_us)))
    };
    let tight = PlanWarning::WatchdogTight { watchdog_us: 2_000, cycle_ns: 1_000_000 };
    assert_eq!((of(2_000).warnings, of(2_000).rejections), (vec![tight], vec![]));
    assert_eq!(of(2_100).warnings, []);
    let rejected = PlanError::Watchdog { watchdog_us: 1_000, cycle_ns: 1_000_000 };
    assert_eq!((of(1_000).warnings, of(1_000).rejections), (vec![], vec![rejected]));
}

/// The image of one slave of N = 3 is there 64.64 us after the send. Two clock datagrams make the
/// frame 32 bytes longer, and the image waits for its end: 67.2 us; a third one 1.28 us more.
#[test]
fn clocks_in_the_frame_delay_its_image() {
    let mut config = config(1, 3, 1_000);
    let arrives_ns = |config: &AdapterConfig| Plan::of(config).slaves[0].outputs_arrive_ns;
    assert_eq!(arrives_ns(&config), 64_640);
    config.dc = Some(DcSync {
        monitor_every: 0,
        ..DcSync::new(Duration::from_millis(1), Duration::from_micros(700))
    });
    assert_eq!(arrives_ns(&config), 67_200);
    config.dc = Some(DcSync::new(Duration::from_millis(1), Duration::from_micros(700)));
    assert_eq!(arrives_ns(&config), 68_480);
}

proptest! {
    /// Every configuration has a plan; frames hold all datagrams in their order, and no more than
    /// Ethernet lets.
    #[test]
    fn every_configuration_has_a_plan(
        sizes in prop::collection::vec((any::<u8>(), any::<u8>()), 0..8),
        cycle_ns: u32,
        dc: Option<(u32, u32)>,
        allow_large_pdos: bool,
    ) {
        let mut config = AdapterConfig::new(sizes.len() as u16);
        for (slave, (rx, tx)) in config.slaves.iter_mut().zip(&sizes) {
            (slave.rx_multiplier, slave.tx_multiplier) = (*rx, *tx);
        }
        config.cycle = Duration::from_nanos(cycle_ns.into());
        config.allow_large_pdos = allow_large_pdos;
        config.dc = dc.map(|(cycle, shift)| DcSync::new(Duration::from_nanos(cycle.into()), Duration::from_nanos(shift.into())));
        let plan = Plan::of(&config);
        let bytes: usize = sizes.iter().map(|(rx, tx)| 128 * (*rx as usize + *tx as usize)).sum();
        let is_clock = |purpose| purpose == DatagramUse::Clock;
        let carried = plan.datagrams().filter(|d| !is_clock(d.purpose));
        prop_assert_eq!(carried.map(|d| d.data_bytes).sum::<usize>(), bytes);
        prop_assert!(plan.frames.iter().all(|f| (84..=1538).contains(&f.wire_bytes())));
        let slaves: Vec<_> = plan
            .datagrams()
            .filter_map(|d| match d.purpose {
                DatagramUse::ProcessData { slave, .. } => Some(slave),
                DatagramUse::Clock => None,
            })
            .collect();
        prop_assert!(slaves.is_sorted());
        let arrivals = plan.slaves.iter().map(|slave| slave.outputs_arrive_ns);
        prop_assert!(arrivals.clone().all(|ns| ns < plan.wire_ns().max(1)));
        // What the plan rejects the check rejects, unless a plainer fault is the cause.
        prop_assert!(plan.rejections.is_empty() || config.check().is_err());
    }
}

// Against the simulated master

/// In OP, both directions exchanged.
fn running(config: AdapterConfig, version: EcrtVersion) -> (Adapter, ecan_sim::Simulation) {
    let mut scenario = ecan_sim::echo(config.slaves.len());
    scenario.version = version;
    let (ecrt, simulation) = simulated(scenario);
    let mut adapter = Adapter::open(&ecrt, with_profiles(config), StartupPlan::default()).unwrap();
    adapter.wait_op(Duration::from_secs(60)).unwrap();
    run(&mut adapter, 5);
    (adapter, simulation)
}

/// The gateways take images of the configured sizes.
fn with_profiles(mut config: AdapterConfig) -> AdapterConfig {
    use ecan_protocol::image::PdoProfile;
    use ecan_protocol::mapping::Direction;
    for (index, slave) in config.slaves.into_iter().enumerate() {
        let sizes =
            [(Direction::TxPdo, slave.tx_multiplier), (Direction::RxPdo, slave.rx_multiplier)];
        for (direction, multiplier) in sizes {
            let profile = PdoProfile { multiplier, ..PdoProfile::default() };
            add_profile(&mut config, index, direction, &profile);
        }
    }
    config
}

/// Nanoseconds from the send to the last slave's answer, counted in bytes on the line.
fn response_ns(config: AdapterConfig) -> u64 {
    let (mut adapter, simulation) = running(config, EcrtVersion::V1_6);
    adapter.wait_next_cycle();
    adapter.receive().unwrap();
    adapter.send().unwrap();
    for byte in 1..20_000 {
        simulation.pass_ns(BYTE_NS);
        adapter.receive().unwrap();
        if adapter.domain_is_complete() {
            return byte * BYTE_NS;
        }
    }
    panic!("no answer");
}

/// The simulator counts a datagram's bytes like the plan, and leaves out what is around them in a
/// frame; the way through host and slaves, which the plan leaves out, is the same for one slave.
#[test]
fn simulated_wire_takes_the_planned_time() {
    let datagrams_ns = |config: &AdapterConfig| {
        let plan = Plan::of(config);
        plan.wire_ns() - (plan.frames.len() * FRAME_OVERHEAD_BYTES) as u64 * BYTE_NS
    };
    let smallest = config(1, 1, 1_000);
    let (base, base_plan) = (response_ns(smallest), datagrams_ns(&smallest));
    for (slaves, multiplier) in [(1, 3), (1, 5), (1, 6), (1, 11), (3, 3), (3, 5)] {
        let config = config(slaves, multiplier, 1_000);
        let measured = response_ns(config) - base;
        let planned = datagrams_ns(&config) - base_plan;
        // Every slave more delays the frame by 1 us there.
        let on_the_way = u64::from(slaves - 1) * 1_000;
        let difference = (measured).abs_diff(planned + on_the_way);
        assert!(difference < BYTE_NS, "{slaves} of N = {multiplier}: {measured} {planned}");
    }
}

#[test]
fn simulated_master_expects_the_planned_working_counter() {
    for (name, version) in [(EcrtVersion::V1_5, (1, 5)), (EcrtVersion::V1_6, (1, 6))] {
        for (slaves, multiplier) in [(1, 3), (2, 5), (2, 6), (1, 11)] {
            let config = config(slaves, multiplier, 1_000);
            let plan = Plan::of(&config);
            let (adapter, _simulation) = running(config, name);
            assert!(adapter.domain_is_complete());
            let mut sum = 0;
            for slave in 0..usize::from(slaves) {
                let counted = adapter.domain_report(slave).working_counter;
                let layout = plan.slaves[slave].layout;
                assert_eq!(counted, layout.expected_working_counter(version), "{multiplier}");
                sum += counted;
            }
            assert_eq!(sum, plan.expected_working_counter(version));
        }
    }
}
