//! OP, its report, the cycle, requests in the cycle, distributed clocks and attaching.

use std::time::Duration;

use crate::common::{add_profile, open, raw_config, run, simulated};
use ecan_host::{
    Adapter, AdapterConfig, DcSync, Delivery, Diagnostics, Error, Master, Phase, RequestState,
    StartupPlan, StartupStep, WcState,
};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::McanChannelConfig;
use ecan_protocol::device::AlState;
use ecan_protocol::image::{
    BudgetPolicy, CommitFields, ImageReader, ImageWriter, OptionFlags, PdoProfile, Timestamp,
};
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::{ObjectType, SdoWrite};
use ecan_sim::{Fault, GatewayFault, IoSpec, Scenario};

#[test]
fn raw_images_carry_frames() {
    let (mut config, profile) = raw_config();
    let channel = McanChannelConfig::classic(500_000);
    for write in channel.writes(2).chain([McanChannelConfig::apply_write(2)]) {
        config.add_startup(0, write).unwrap();
    }
    let (ecrt, simulation) = simulated(ecan_sim::echo(1));
    let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    let frame = CanFrame::classic(CanId::standard(0x123).unwrap(), &[1, 2, 3]).unwrap();
    let mut writer = ImageWriter::new(Direction::RxPdo, profile);
    adapter.wait_next_cycle();
    adapter.receive().unwrap();
    let image = adapter.rx_pdo_mut(0);
    writer.push(image, 2, 0, frame.as_ref(), Timestamp::None).unwrap();
    writer.commit(image, CommitFields::default());
    adapter.send().unwrap();
    run(&mut adapter, 10);
    let counters = simulation.with_world(|world| world.counters(0).unwrap());
    assert_eq!((counters.frames_on_bus, counters.frames_from_bus), (1, 1));
    assert!(counters.images_repeated > 5, "the image stayed and was a no-op");
    assert_eq!(counters.images_faulty, 0, "the image before OP is a valid one");
    let cycle = |adapter: &mut Adapter| adapter.receive().and_then(|()| adapter.send());
    let read = |diagnostics: &Diagnostics| {
        [2, 14, 15].map(|subindex| diagnostics.sdo_upload_u32(0, 0x8011, subindex).unwrap())
    };
    assert_eq!(adapter.diagnose(cycle, read).unwrap(), [0; 3], "status, last error, counter");
}

#[test]
fn image_before_op_has_the_profile_of_the_startup_or_the_slave() {
    let profile = PdoProfile {
        multiplier: 3,
        channel_mask: 0x05,
        budget: BudgetPolicy::Deterministic,
        options: OptionFlags::NO_CRC16.with(OptionFlags::ALIGN4),
        ..PdoProfile::default()
    };
    let (ecrt, simulation) = simulated(ecan_sim::echo(1));
    let mut first = AdapterConfig::new(1);
    for direction in [Direction::TxPdo, Direction::RxPdo] {
        add_profile(&mut first, 0, direction, &profile);
    }
    // The second application writes no profile: the slave keeps that of the first one.
    for config in [first, AdapterConfig::new(1)] {
        let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
        adapter.wait_op(Duration::from_secs(20)).unwrap();
        run(&mut adapter, 10);
        let image = ImageReader::new(Direction::RxPdo, profile).read(adapter.rx_pdo(0)).unwrap();
        assert!(!image.layout_changed() && image.payload().is_empty());
        assert_eq!(image.sequence(), u16::MAX);
        let counters = simulation.with_world(|world| world.counters(0).unwrap());
        assert_eq!(counters.images_faulty, 0);
        assert!(counters.images_parsed > 0);
    }
}

#[test]
fn application_may_cancel_a_wait_and_wait_again() {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};

    let (config, _) = raw_config();
    let (ecrt, _simulation) = simulated(ecan_sim::echo(1));
    let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
    let asked = Arc::new(AtomicU32::new(0));
    let counter = asked.clone();
    adapter.stop_waiting_when(Some(Box::new(move || counter.fetch_add(1, Ordering::Relaxed) == 9)));
    let error = adapter.wait_op(Duration::from_secs(20)).unwrap_err();
    assert!(matches!(error, Error::Stopped), "{error}");
    assert_eq!(asked.load(Ordering::Relaxed), 10, "once in every cycle");
    adapter.stop_waiting_when(None);
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    assert_eq!(asked.load(Ordering::Relaxed), 10);
}

#[test]
fn working_counters_show_the_delivery() {
    let (config, _) = raw_config();
    let (ecrt, simulation) = simulated(ecan_sim::echo(1));
    let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
    assert_eq!(adapter.domain_report(0).outputs, Delivery::None);
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    run(&mut adapter, 3);
    let report = adapter.domain_report(0);
    assert_eq!((report.working_counter, report.wc_state), (3, WcState::Complete));
    assert_eq!(report.outputs, Delivery::Confirmed);
    for (offset, delivery) in
        [(-3, Delivery::Missed), (-2, Delivery::Missed), (-1, Delivery::Confirmed)]
    {
        simulation.inject(Fault::WorkingCounterOffset { offset, cycles: 1 });
        run(&mut adapter, 1);
        adapter.wait_next_cycle();
        adapter.receive().unwrap();
        assert_eq!(adapter.domain_report(0).outputs, delivery, "offset {offset}");
        assert!(!adapter.domain_is_complete());
        adapter.send().unwrap();
        run(&mut adapter, 2);
    }
}

#[test]
fn profile_mismatch_is_reported_with_the_object() {
    // Nothing applies a profile for N = 3.
    let mut adapter = open(ecan_sim::echo(1), AdapterConfig::new(1)).unwrap();
    let error = adapter.wait_op(Duration::from_secs(5)).unwrap_err();
    let Error::NotOperational(report) = &error else { panic!("{error}") };
    let slave = &report.slaves[0];
    assert!(slave.online && slave.error_flag, "{error}");
    let Some(Error::Readback { index: 0x8011, subindex: 9, found: 0, .. }) = slave.cause.as_deref()
    else {
        panic!("{error}")
    };
    assert!(error.to_string().contains("expected 384"), "{error}");
}

#[test]
fn al_status_code_is_read_before_the_master_acknowledges_it() {
    let (ecrt, simulation) = simulated(ecan_sim::echo(1));
    let mut adapter = Adapter::open(&ecrt, raw_config().0, StartupPlan::default()).unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    let watchdog = GatewayFault::AlError { code: 0x001B };
    simulation.inject(Fault::Gateway { gateway: 0, fault: watchdog });
    simulation.inject(Fault::WorkingCounterOffset { offset: -3, cycles: 1_000 });
    run(&mut adapter, 2);
    let error = adapter.wait_op(Duration::from_millis(100)).unwrap_err();
    assert!(error.to_string().contains("AL status code 0x001B"), "{error}");
}

#[test]
fn wrong_sync_managers_of_the_sii_are_named() {
    let fixed = "ecan_sii_sm_layout.sh fix --position 0, then power-cycle the gateway";
    for (sm, change, text) in [
        (
            0,
            (0x1180, 0x66),
            "SM2 has start 0x1180, 384 bytes, control byte 0x66 instead of start 0x1100",
        ),
        (
            1,
            (0x1D00, 0x20),
            "SM3 has start 0x1D00, 384 bytes, control byte 0x20 instead of start 0x1D00",
        ),
    ] {
        let mut scenario = ecan_sim::echo(1);
        let layout = &mut scenario.gateways[0].sii_sync_managers[sm];
        (layout.start, layout.control) = change;
        let (ecrt, simulation) = simulated(scenario);
        let mut adapter = Adapter::open(&ecrt, raw_config().0, StartupPlan::default()).unwrap();
        let error = adapter.wait_op(Duration::from_secs(5)).unwrap_err();
        let Error::NotOperational(report) = &error else { panic!("{error}") };
        assert!(report.slaves[0].error_flag && report.slaves[0].cause.is_none(), "{error}");
        let message = error.to_string();
        assert!(message.contains(text) && message.contains(fixed), "{message}");
        let code = format!("AL status code 0x{:04X}", 0x1D + sm);
        let log = simulation.kernel_log();
        assert!(log.iter().any(|line| line.contains(&code)), "{log:#?}");
    }
}

#[test]
fn repair_of_the_sii_has_the_ring_position_of_an_alias() {
    let mut scenario = ecan_sim::echo(2);
    scenario.gateways[1].alias = 77;
    scenario.gateways[1].sii_sync_managers[0].start = 0x1180;
    let mut config = raw_config().0;
    config.slaves[0].alias = 77;
    let (ecrt, _simulation) = simulated(scenario);
    let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
    let message = adapter.wait_op(Duration::from_secs(5)).unwrap_err().to_string();
    assert!(message.contains("slave 0 (alias 77, position 0)"), "{message}");
    assert!(message.contains("ecan_sii_sm_layout.sh fix --position 1, "), "{message}");
}

#[test]
fn sync_manager_length_of_the_sii_has_no_effect_on_the_master() {
    let mut scenario = ecan_sim::echo(1);
    scenario.gateways[0].sii_sync_managers[0].length = 128;
    let (ecrt, _simulation) = simulated(scenario);
    let mut adapter = Adapter::open(&ecrt, raw_config().0, StartupPlan::default()).unwrap();
    adapter.wait_op(Duration::from_secs(5)).unwrap();
}

#[test]
fn watchdog_ends_operation_after_its_time() {
    for (watchdog_us, pause_us, holds) in [
        (100_000, 97_000, true),
        (100_000, 101_000, false),
        (5_000, 4_500, true),
        (5_000, 5_500, false),
        (6_553_500, 6_500_000, true),
    ] {
        let config = raw_config().0.with_watchdog(Duration::from_micros(watchdog_us));
        let (ecrt, simulation) = simulated(ecan_sim::echo(1));
        let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
        let is_in_op =
            || simulation.with_world(|world| world.gateway(0).unwrap().al_state()) == AlState::Op;
        adapter.wait_op(Duration::from_secs(20)).unwrap();
        // Also after the slave was configured anew, without the application.
        for _ in 0..2 {
            run(&mut adapter, 10);
            assert!(is_in_op());
            simulation.pass_ns(pause_us * 1_000);
            assert_eq!(is_in_op(), holds, "{watchdog_us} {pause_us}");
            simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 300 });
            run(&mut adapter, 200);
            adapter.wait_op(Duration::from_secs(30)).unwrap();
        }
    }
}

#[test]
fn watchdog_ends_with_its_configuration() {
    let (config, _) = raw_config();
    let (ecrt, simulation) = simulated(ecan_sim::echo(1));
    let mut adapter = Adapter::open(
        &ecrt,
        config.with_watchdog(Duration::from_millis(5)),
        StartupPlan::default(),
    )
    .unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    adapter.reconfigure(config, StartupPlan::default()).unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    simulation.pass_ns(50_000_000);
    run(&mut adapter, 2);
    assert!(adapter.domain_is_complete());
}

#[test]
fn slave_without_power_is_reported() {
    let (config, _) = raw_config();
    let (ecrt, simulation) = simulated(ecan_sim::echo(1));
    let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
    simulation.inject(Fault::PowerOff { gateway: 0 });
    let error = adapter.wait_op(Duration::from_secs(3)).unwrap_err();
    assert!(error.to_string().contains("does not answer"), "{error}");
}

#[test]
fn sdo_requests_run_in_parallel_with_the_cycle() {
    let (config, _) = raw_config();
    let (ecrt, simulation) = simulated(ecan_sim::echo(1));
    let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
    let read = adapter.requests().create_sdo(0, 4).unwrap();
    let write = adapter.requests().create_sdo(0, 4).unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    let settle = |adapter: &mut Adapter, id| {
        for _ in 0..2_000 {
            run(adapter, 1);
            let state = adapter.requests().sdo_state(id).unwrap();
            if state != RequestState::Busy {
                return state;
            }
        }
        panic!("never done")
    };
    adapter.requests().sdo_write(write, 0x8000, 10, &0xCAFE_u32.to_le_bytes()).unwrap();
    assert_eq!(settle(&mut adapter, write), RequestState::Success);
    adapter.requests().sdo_read(read, 0x8000, 10).unwrap();
    assert_eq!(settle(&mut adapter, read), RequestState::Success);
    assert_eq!(adapter.requests().sdo_data(read), 0xCAFE_u32.to_le_bytes());
    adapter.requests().sdo_read(read, 0x4711, 0).unwrap();
    assert_eq!(settle(&mut adapter, read), RequestState::Error);
    let silent = GatewayFault::MailboxSilent { ms: 60_000 };
    simulation.inject(Fault::Gateway { gateway: 0, fault: silent });
    adapter.requests().sdo_timeout(read, 500).unwrap();
    adapter.requests().sdo_read(read, 0x8000, 10).unwrap();
    assert_eq!(settle(&mut adapter, read), RequestState::Error);
}

#[test]
fn blocking_transfer_errors_name_object_and_abort_code() {
    let adapter = open(ecan_sim::echo(1), AdapterConfig::new(1)).unwrap();
    let diagnostics = adapter.diagnostics();
    assert_eq!(diagnostics.sdo_upload_u32(0, 0xF000, 2).unwrap(), 4);
    let error = diagnostics.sdo_download(0, 0xF000, 2, &[1]).unwrap_err();
    let Error::Sdo { slave: 0, index: 0xF000, subindex: 2, abort_code: Some(code), .. } = error
    else {
        panic!("{error}")
    };
    assert_eq!(code.0, 0x0601_0002);
    let text = error.to_string();
    assert!(text.contains("0xF000:02") && text.contains("read-only"), "{text}");
}

#[test]
fn second_handle_works_from_another_thread() {
    let (config, _) = raw_config();
    let mut adapter = open(ecan_sim::echo(1), config).unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    let diagnostics = adapter.open_diagnostics().unwrap();
    let name = std::thread::spawn(move || diagnostics.slave_info(0).map(|info| info.name));
    assert!(!name.join().unwrap().unwrap().is_empty());
    assert_eq!(adapter.diagnostics().master_state().unwrap().slaves_responding, 1);
    assert!(adapter.diagnostics().link_state(0).unwrap().link_up);
}

#[test]
fn op_is_reached_with_sync0() {
    let (mut config, _) = raw_config();
    config.dc = Some(DcSync::new(Duration::from_millis(1), Duration::from_micros(300)));
    let mut adapter = open(ecan_sim::echo(1), config).unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    run(&mut adapter, 100);
    assert!(adapter.domain_is_complete());
    assert!(adapter.slave_state(0).unwrap().operational);
}

#[test]
fn attached_adapter_leaves_the_master_to_its_owner() {
    let (ecrt, _simulation) = simulated(ecan_sim::echo(2));
    let mut owner = Master::request(&ecrt, 0).unwrap();
    // SAFETY: the owner outlives the Adapter below and is used from this thread only.
    let shared = unsafe { Master::from_raw(ecrt.clone(), owner.as_raw()) }.unwrap();
    let (config, _) = raw_config();
    let mut adapter = Adapter::attach(&ecrt, shared, config, StartupPlan::default()).unwrap();
    assert!(matches!(adapter.activate(), Err(Error::Attached { .. })));
    owner.set_send_interval(1_000).unwrap();
    owner.activate().unwrap();
    adapter.owner_activated().unwrap();
    assert_eq!(adapter.phase(), Phase::Active);
    for _ in 0..20_000 {
        adapter.wait_next_cycle();
        owner.receive().unwrap();
        adapter.receive().unwrap();
        if adapter.all_operational().unwrap() {
            break;
        }
        adapter.send().unwrap();
        owner.send().unwrap();
    }
    assert!(adapter.all_operational().unwrap());
    assert!(matches!(
        adapter.reconfigure(raw_config().0, StartupPlan::default()),
        Err(Error::Attached { .. })
    ));
    drop(adapter);
    assert!(owner.state().is_ok(), "the owner's handle is still his");
}

#[test]
fn attaching_ends_early_on_request() {
    let (ecrt, _simulation) = simulated(ecan_sim::echo(1));
    let owner = Master::request(&ecrt, 0).unwrap();
    // SAFETY: the owner outlives the attempt below and is used from this thread only.
    let shared = unsafe { Master::from_raw(ecrt.clone(), owner.as_raw()) }.unwrap();
    let (mut config, _) = raw_config();
    // No slave is there, for a minute.
    config.slaves[0].position = 1;
    config.preop_timeout = Duration::from_secs(60);
    let start_ns = ecrt.clock().now_ns();
    let stop = Some(Box::new(|| true) as Box<dyn Fn() -> bool + Send>);
    let attached = Adapter::attach_with_stop(&ecrt, shared, config, StartupPlan::default(), stop);
    assert!(matches!(attached, Err(Error::Stopped)));
    assert!(ecrt.clock().now_ns() - start_ns < 10_000_000_000);
}

#[test]
fn slave_without_coe_is_rejected_at_once() {
    let scenario = Scenario { ios: vec![IoSpec::at(0)], ..ecan_sim::echo(1) };
    let (ecrt, _simulation) = simulated(scenario);
    let start_ns = ecrt.clock().now_ns();
    let (mut config, _) = raw_config();
    let error = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap_err();
    assert!(!error.is_temporary());
    let text = error.to_string();
    let expected = "it has no mailbox with CoE: configure the alias and the position";
    assert!(text.starts_with("slave 0 cannot be identified") && text.contains(expected), "{text}");
    assert!(ecrt.clock().now_ns() - start_ns < 1_000_000_000, "not searched again");
    config.slaves[0].position = 1;
    assert!(Adapter::open(&ecrt, config, StartupPlan::default()).is_ok());
}

#[test]
fn startup_list_is_sent_again_after_a_power_cycle() {
    let (mut config, _) = raw_config();
    let mark = SdoWrite { index: 0x8000, subindex: 10, value: 4711, ty: ObjectType::U32 };
    config.add_startup(0, StartupStep::Download(mark)).unwrap();
    let (ecrt, simulation) = simulated(ecan_sim::echo(1));
    let mut adapter = Adapter::open(&ecrt, config, StartupPlan::default()).unwrap();
    adapter.wait_op(Duration::from_secs(20)).unwrap();
    simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 300 });
    run(&mut adapter, 200);
    assert!(!adapter.domain_is_complete());
    adapter.wait_op(Duration::from_secs(30)).unwrap();
    let read = |diagnostics: &Diagnostics| diagnostics.sdo_upload_u32(0, 0x8000, 10).unwrap();
    let cycle = |adapter: &mut Adapter| adapter.receive().and_then(|()| adapter.send());
    assert_eq!(adapter.diagnose(cycle, read).unwrap(), 4711);
    let complaints = simulation.kernel_log();
    assert!(!complaints.iter().any(|line| line.starts_with("simulator:")), "{complaints:?}");
}

/// Whatever the system's scheduler does with the thread beside the cycle.
#[test]
fn parallel_work_takes_the_same_cycles_in_every_run() {
    let run = || {
        let (config, _) = raw_config();
        let mut adapter = open(ecan_sim::echo(1), config).unwrap();
        adapter.wait_op(Duration::from_secs(10)).unwrap();
        let clock = adapter.ecrt().clock().clone();
        let mut cycles = Vec::new();
        for transfers in [0, 1, 20] {
            let mut count = 0_u64;
            let cycle = |adapter: &mut Adapter| {
                count += 1;
                let received = adapter.receive();
                adapter.send().and(received)
            };
            let work = |diagnostics: &Diagnostics| {
                for _ in 0..transfers {
                    // As long as a thread may compute, or wait for its turn.
                    std::thread::yield_now();
                    diagnostics.sdo_upload_u32(0, 0x1018, 1).unwrap();
                    clock.sleep_until_ns(clock.now_ns() + 10_000_000);
                }
            };
            let start_ns = clock.now_ns();
            adapter.diagnose(cycle, work).unwrap();
            cycles.push(count);
            assert_eq!(clock.now_ns() - start_ns, count * 1_000_000, "none was skipped");
        }
        cycles
    };
    let first = run();
    assert!(first[0] == 1 && first[1] > 1 && first[2] > 10 * first[1], "{first:?}");
    for _ in 0..20 {
        assert_eq!(run(), first);
    }
}
