//! The simulated master with the pace and the side activities of IgH 1.6.2.

use crate::ecrt_support::{CYCLE_NS, Program, stepped};
use ecan_host::{Errno, Master, RequestState, SdoRequestId};
use ecan_sim::variant::SdoInformation;
use ecan_sim::{Backend, Fault, GatewayFault, MasterBehaviour, Scenario, Simulation, echo};

const MS: u64 = 1_000_000;

fn like_igh(gateways: usize, change: impl Fn(&mut MasterBehaviour)) -> Backend {
    let mut master = MasterBehaviour::IGH;
    change(&mut master);
    stepped(Scenario { master, ..echo(gateways) })
}

fn simulation(backend: &Backend) -> &Simulation {
    backend.simulation.as_ref().unwrap()
}

fn reads_vendor(master: &Master) -> Result<(), (Errno, Option<u32>)> {
    let mut data = [0; 4];
    let result = master.sdo_upload(0, 0x1018, 1, &mut data);
    result.map(|_| ()).map_err(|error| (error.errno, error.abort_code))
}

/// Loses the supply of gateway 0 and waits until the master has it in PREOP again.
fn power_cycle(backend: &Backend, master: &Master) {
    simulation(backend).inject(Fault::PowerCycle { gateway: 0, off_ms: 200 });
    simulation(backend).pass_ns(300 * MS);
    let is_in_preop = || master.slave_info(0).is_ok_and(|slave| slave.al_state == 2);
    pass_until(simulation(backend), "in PREOP", is_in_preop);
}

/// Lets simulated time pass until the condition holds, at most a minute.
fn pass_until(simulation: &Simulation, what: &str, condition: impl Fn() -> bool) {
    for _ in 0..60_000 {
        if condition() {
            return;
        }
        simulation.pass_ns(MS);
    }
    panic!("not {what}: {:#?}", simulation.kernel_log());
}

/// Runs cycles until the condition holds, at most this number.
fn cycle_until(program: &mut Program, most: usize, condition: impl Fn(&Program) -> bool) {
    let is_met = (0..most).any(|_| {
        program.cycle();
        condition(program)
    });
    assert!(is_met, "{:#?}", program.simulation().kernel_log());
}

/// Waits until the fetch of the dictionary has begun.
fn wait_for_fetch(simulation: &Simulation, master: &Master) {
    pass_until(simulation, "fetching", || master.slave_info(0).unwrap().sdo_count > 0);
}

#[test]
fn transfer_before_activation_takes_four_rounds_of_the_thread() {
    let backend = like_igh(1, |_| {});
    let master = Master::request(&backend.ecrt, 0).unwrap();
    let before = backend.ecrt.clock().now_ns();
    reads_vendor(&master).unwrap();
    assert_eq!(backend.ecrt.clock().now_ns() - before, 32 * MS);
}

#[test]
fn transfers_fail_while_the_dictionary_is_fetched() {
    let backend = like_igh(1, |_| {});
    let master = Master::open(&backend.ecrt, 0).unwrap();
    assert_eq!(master.slave_info(0).unwrap().sdo_count, 468, "fetched before the program began");
    power_cycle(&backend, &master);
    let clock = backend.ecrt.clock();
    let since = clock.now_ns();
    let mut failed = Vec::new();
    while clock.now_ns() - since < 6_000 * MS {
        let at = (clock.now_ns() - since) / MS;
        let has_dictionary = master.slave_info(0).unwrap().sdo_count > 0;
        match reads_vendor(&master) {
            Ok(()) if failed.is_empty() => assert!(!has_dictionary, "at {at} ms"),
            Ok(()) => assert!(has_dictionary, "at {at} ms"),
            Err(error) => {
                assert_eq!(error, (Errno::EIO, None), "at {at} ms");
                failed.push(at);
            }
        }
    }
    let (first, last) = (failed[0], failed[failed.len() - 1]);
    assert!((2_900..3_200).contains(&first), "{first} ms after PREOP");
    assert!((600..1_800).contains(&(last - first)), "for {} ms", last - first);
    assert_eq!(
        u64::try_from(failed.len()).unwrap(),
        (last - first) / 32 + 1,
        "one after the other"
    );
}

#[test]
fn dictionary_without_sdo_information_is_not_fetched() {
    let mut scenario = Scenario { master: MasterBehaviour::IGH, ..echo(1) };
    scenario.gateways[0].config.variant.sdo_information = SdoInformation::Absent;
    let backend = stepped(scenario);
    let master = Master::open(&backend.ecrt, 0).unwrap();
    assert_eq!(master.slave_info(0).unwrap().sdo_count, 0);
    power_cycle(&backend, &master);
    for _ in 0..10 {
        simulation(&backend).pass_ns(500 * MS);
        assert_eq!(master.slave_info(0).unwrap().sdo_count, 0);
        assert_eq!(reads_vendor(&master), Ok(()));
    }
}

#[test]
fn write_that_collides_is_executed() {
    let backend = like_igh(1, |_| {});
    let master = Master::request(&backend.ecrt, 0).unwrap();
    drop(master);
    let master = Master::open(&backend.ecrt, 0).unwrap();
    power_cycle(&backend, &master);
    wait_for_fetch(simulation(&backend), &master);
    let error = master.sdo_download(0, 0x8010, 3, &[5]).unwrap_err();
    assert_eq!((error.errno, error.abort_code), (Errno::EIO, None));
    simulation(&backend).pass_ns(2_000 * MS);
    let mut data = [0];
    master.sdo_upload(0, 0x8010, 3, &mut data).unwrap();
    assert_eq!(data, [5]);
}

/// Cycles of 1 ms until OP, with this time between receive and send.
fn cycles_until_op(program: &mut Program, gap_ns: u64) -> usize {
    for cycle in 0..20_000 {
        program.master.receive().unwrap();
        let domains: Vec<_> = program.slaves.iter().map(|slave| slave.domain).collect();
        program.simulation().pass_ns(gap_ns);
        for domain in domains {
            program.master.domain_process(domain).unwrap();
            program.master.domain_queue(domain).unwrap();
        }
        program.master.send().unwrap();
        program.simulation().pass_ns(CYCLE_NS - gap_ns);
        if (0..program.slaves.len()).all(|slave| program.state(slave).operational) {
            program.next = program.backend.ecrt.clock().now_ns();
            return cycle;
        }
    }
    panic!("not in OP: {:#?}", program.simulation().kernel_log());
}

#[test]
fn send_directly_after_receive_halves_the_pace() {
    let cycles = [0, CYCLE_NS / 2].map(|gap_ns| {
        let mut program = Program::new(like_igh(1, |_| {}), &[1]);
        program.activate();
        cycles_until_op(&mut program, gap_ns)
    });
    let [plain, split] = cycles;
    assert!((split * 18..=split * 21).contains(&(plain * 10)), "{plain} and {split} cycles");
}

#[test]
fn written_system_time_is_an_interval_ahead_without_a_gap() {
    for (gap_ns, ahead_ns) in [(0, CYCLE_NS), (CYCLE_NS / 2, 0)] {
        let mut program = Program::new(like_igh(1, |_| {}), &[1]);
        program.activate();
        for _ in 0..40 {
            program.master.receive().unwrap();
            program.simulation().pass_ns(gap_ns);
            let now = program.backend.ecrt.clock().now_ns();
            program.master.application_time(now).unwrap();
            program.master.send().unwrap();
            program.simulation().pass_ns(CYCLE_NS - gap_ns);
        }
        let error = program.simulation().with_world(|world| {
            let now = world.now_ns();
            world.gateway(0).unwrap().dc_system_time(now).unwrap() - now
        });
        assert_eq!(error, ahead_ns, "a gap of {gap_ns} ns");
    }
}

#[test]
fn power_cycle_in_op_costs_the_upload_of_all_mappings() {
    let mut program = Program::new(like_igh(1, |_| {}), &[1]);
    program.activate();
    cycles_until_op(&mut program, 0);
    program.simulation().inject(Fault::PowerCycle { gateway: 0, off_ms: 100 });
    program.cycles(400);
    let cycles = cycles_until_op(&mut program, 0);
    // 48 PDOs of 10 uploads of 3 steps of 2 cycles
    assert!((2_880..6_000).contains(&cycles), "{cycles} cycles");
}

fn with_requests(backend: Backend, count: usize) -> (Program, Vec<SdoRequestId>) {
    let mut program = Program::new(backend, &[1]);
    let config = program.slaves[0].config;
    let requests = (0..count)
        .map(|_| program.master.create_sdo_request(config, 0x1018, 1, 4).unwrap())
        .collect();
    program.activate();
    cycles_until_op(&mut program, 0);
    (program, requests)
}

/// Cycles until all requests, queued together, have ended.
fn cycles_of(program: &mut Program, requests: &[SdoRequestId]) -> usize {
    for request in requests {
        program.master.requests().sdo_read(*request).unwrap();
    }
    for cycle in 0..30_000 {
        let ended = |request: &SdoRequestId, program: &mut Program| {
            program.master.requests().sdo_state(*request).unwrap() == RequestState::Success
        };
        if requests.iter().all(|request| ended(request, program)) {
            return cycle;
        }
        program.cycle();
    }
    panic!("the requests do not end");
}

#[test]
fn queued_requests_follow_each_other_after_one_polling_round() {
    let (mut program, requests) = with_requests(like_igh(1, |_| {}), 10);
    let one = cycles_of(&mut program, &requests[..1]);
    program.cycles(10);
    let ten = cycles_of(&mut program, &requests);
    assert!((16..30).contains(&one), "{one} cycles: a round of 16 ms, then 3 steps");
    assert!(
        (9 * 6..9 * 7).contains(&(ten - one)),
        "{one} and {ten} cycles: 6 for each further one"
    );
}

#[test]
fn dictionary_fetch_in_op_delays_requests() {
    let backend = like_igh(1, |_| {});
    let (mut program, requests) = with_requests(backend, 1);
    program.simulation().inject(Fault::PowerCycle { gateway: 0, off_ms: 100 });
    program.cycles(400);
    cycles_until_op(&mut program, 0);
    let is_fetching = |program: &Program| program.master.slave_info(0).unwrap().sdo_count > 0;
    cycle_until(&mut program, 20_000, is_fetching);
    let cycles = cycles_of(&mut program, &requests);
    assert!((10_000..16_000).contains(&cycles), "{cycles} cycles");
    assert!(cycles_of(&mut program, &requests) < 30);
}

#[test]
fn activation_waits_for_the_dictionary_fetch() {
    let backend = like_igh(1, |_| {});
    let observer = Master::open(&backend.ecrt, 0).unwrap();
    power_cycle(&backend, &observer);
    let mut program = Program::new(backend, &[1]);
    wait_for_fetch(program.simulation(), &observer);
    program.simulation().pass_ns(300 * MS);
    program.activate();
    let late = cycles_until_op(&mut program, 0);
    let mut program = Program::new(like_igh(1, |_| {}), &[1]);
    program.activate();
    let usual = cycles_until_op(&mut program, 0);
    assert!(late > usual + 5_000, "{late} and {usual} cycles");
}

#[test]
fn release_causes_a_scan_only_if_the_scenario_has_it() {
    for scans in [false, true] {
        let backend = like_igh(1, |master| master.scans_after_release = scans);
        let observer = Master::open(&backend.ecrt, 0).unwrap();
        drop(Master::request(&backend.ecrt, 0).unwrap());
        simulation(&backend).pass_ns(20 * MS);
        assert_eq!(observer.info().unwrap().scan_busy, scans);
        simulation(&backend).pass_ns(1_000 * MS);
        let objects = observer.slave_info(0).unwrap().sdo_count;
        assert_eq!(objects, if scans { 0 } else { 468 }, "a scan forgets the dictionary");
        // a program that requests it at once prevents the scan
        drop(Master::request(&backend.ecrt, 0).unwrap());
        let master = Master::request(&backend.ecrt, 0).unwrap();
        simulation(&backend).pass_ns(100 * MS);
        assert!(!master.info().unwrap().scan_busy);
    }
}

/// Lines of the kernel log after the release of a master whose slaves are in OP.
fn log_after_the_end(program: Program) -> Vec<String> {
    let simulation = program.simulation().clone();
    drop(program);
    simulation.pass_ns(2_000 * MS);
    let log = simulation.kernel_log();
    log.into_iter().filter(|line| line.contains("0x001B")).collect()
}

/// The master configures one slave after the other; those at the end wait in OP.
#[test]
fn watchdog_runs_out_when_a_program_ends_in_op() {
    let mut program = Program::new(like_igh(4, |_| {}), &[1; 4]);
    program.activate();
    let is_in_op = |program: &Program| (0..4).all(|slave| program.state(slave).operational);
    cycle_until(&mut program, 60_000, is_in_op);
    let log = log_after_the_end(program);
    assert!(log.iter().any(|line| line.contains("0-3: ")), "{log:?}");
    assert!(!log.iter().any(|line| line.contains("0-0: ")), "{log:?}");
}

#[test]
fn watchdog_runs_out_while_the_master_reads_a_dictionary() {
    let backend = like_igh(1, |_| {});
    let observer = Master::open(&backend.ecrt, 0).unwrap();
    power_cycle(&backend, &observer);
    let mut program = Program::new(backend, &[1]);
    program.activate();
    cycles_until_op(&mut program, 0);
    cycle_until(&mut program, 10_000, |_| observer.slave_info(0).unwrap().sdo_count > 0);
    assert_eq!(log_after_the_end(program).len(), 1);
}

#[test]
fn assignment_of_a_program_replaces_that_of_the_scan() {
    let mut program = Program::new(like_igh(1, |_| {}), &[3]);
    assert_eq!(chunks(&program), 24);
    program.activate();
    cycles_until_op(&mut program, 0);
    assert_eq!(chunks(&program), 3);
}

fn chunks(program: &Program) -> u32 {
    // SAFETY: zero is valid for this plain structure.
    let mut sync: ecrt_sys::ec_sync_info_t = unsafe { std::mem::zeroed() };
    // SAFETY: the master is the library's, and the target is writable.
    let result = unsafe {
        ecan_sim::libethercat::master_get_sync_manager(program.master.as_raw(), 0, 2, &mut sync)
    };
    assert_eq!(result, 0);
    sync.n_pdos
}

#[test]
fn scenario_file_selects_the_behaviour() {
    let read = |text: &str| {
        Scenario::from_toml(text, "test", std::path::Path::new(".")).map(|scenario| scenario.master)
    };
    assert_eq!(read(""), Ok(MasterBehaviour::IDEAL));
    assert_eq!(read("[master]\nlike = \"igh\""), Ok(MasterBehaviour::IGH));
    let changed = read("[master]\nlike = \"igh\"\nidle_step_us = 4000\nscans_after_release = true");
    let expected =
        MasterBehaviour { idle_step_us: 4_000, scans_after_release: true, ..MasterBehaviour::IGH };
    assert_eq!(changed, Ok(expected));
    assert!(read("[master]\nlike = \"soem\"").is_err());
    assert!(read("[master]\nspeed = 1").is_err());
}

/// A configuration that is due while a request is served begins when the request has ended.
#[test]
fn reset_restarts_a_slave_that_serves_a_request() {
    for delay in 0..8 {
        let (mut program, requests) = with_requests(like_igh(1, |_| {}), 1);
        let fault =
            GatewayFault::SdoAbort { index: 0x8011, subindex: 1, code: 0x0800_0022, times: 1 };
        program.simulation().inject(Fault::Gateway { gateway: 0, fault });
        program.simulation().inject(Fault::PowerCycle { gateway: 0, off_ms: 50 });
        cycle_until(&mut program, 20_000, |program| {
            program.simulation().kernel_log().iter().any(|line| line.contains("aborted"))
        });
        // In a slow cycle the master looks at the slave while it serves the last request.
        let slow_cycle = |program: &mut Program| {
            program.cycle();
            program.simulation().pass_ns(9 * MS);
        };
        for _ in 0..delay + 50 {
            let mut all = program.master.requests();
            if all.sdo_state(requests[0]).unwrap() != RequestState::Busy {
                all.sdo_read(requests[0]).unwrap();
            }
            slow_cycle(&mut program);
        }
        program.master.reset().unwrap();
        (0..50).for_each(|_| slow_cycle(&mut program));
        assert!(program.reaches_op(), "delay {delay}: {:#?}", program.simulation().kernel_log());
    }
}
