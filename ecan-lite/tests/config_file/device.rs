//! Writing, comparing, saving and losing a configuration, on simulated gateways.

use std::sync::atomic::{AtomicU64, Ordering};

use super::common::{MS, fixture, two, with};
use ecan_host::{Clock, Error, MaintenanceError, StartupStep};
use ecan_lite::config::{
    Difference, Expected, FlashCommand, ResolveError, ResolvedGateway, apply, differences, find,
    missing_entries, startup,
};
use ecan_mcan_port::Port;
use ecan_protocol::device::{AlState, MaintenanceStatus};
use ecan_sim::{Fault, GatewayFault};

fn entries(differences: &[Difference]) -> Vec<(u16, u8, Option<u8>)> {
    differences
        .iter()
        .map(|difference| (difference.index, difference.subindex, difference.filter))
        .collect()
}

#[test]
fn saved_configuration_survives_power_cycle() {
    let (fixture, file) = (fixture(2), two());
    let bus = &fixture.bus;
    let clock = fixture.ecrt.clock().as_ref();
    let gateways = find(bus, &file.adapter.slaves).unwrap();
    assert_eq!(gateways, [0, 1].map(|at| ResolvedGateway { gateway: at, slave: at }));
    for ResolvedGateway { gateway, slave } in gateways {
        let steps = startup(&file, gateway);
        assert!(!differences(bus, slave, &steps).unwrap().is_empty());
        let mut done = 0;
        apply(bus, slave, &steps, &mut |_| done += 1).unwrap();
        assert_eq!(done, steps.len());
        assert_eq!(differences(bus, slave, &steps).unwrap(), []);
        let saved = FlashCommand::Save.run(bus, slave, clock).unwrap();
        assert_eq!(saved.active_crc, saved.stored_crc);
        assert_eq!(bus.sdo_upload_u32(slave, 0xB000, 2).unwrap(), 0, "the mode is given back");

        fixture.simulation.inject(Fault::PowerCycle { gateway: slave, off_ms: 300 });
        fixture.simulation.pass_ns(3_000 * MS);
        let left = differences(bus, slave, &steps).unwrap();
        assert!(!left.is_empty(), "the assignment is not set yet");
        let kept: Vec<_> = left.iter().filter(|difference| !difference.is_set_at_start).collect();
        assert!(kept.is_empty(), "{kept:?}");
    }
    // The entries that the master writes at each start differ too.
    let steps = [0, 1].map(|gateway| startup(&file, gateway));
    let mut port = Port::open(&fixture.ecrt, (file.adapter, file.port)).unwrap();
    port.wait_ready().unwrap();
    for (slave, steps) in steps.iter().enumerate() {
        let left = port.diagnose(|bus| differences(bus, slave, steps).unwrap()).unwrap();
        assert_eq!(left, []);
    }
}

#[test]
fn entries_that_the_device_lacks_are_differences() {
    let (fixture, file) = (fixture(2), two());
    let steps = startup(&file, 0);
    let lacking = |index, subindex| {
        let fault = GatewayFault::SdoAbort { index, subindex, code: 0x0609_0011, times: u32::MAX };
        fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
    };
    let before = differences(&fixture.bus, 0, &steps).unwrap();
    assert_eq!(missing_entries(&fixture.bus, 0, &steps).unwrap(), []);
    lacking(0x8001, 19);
    lacking(0x8021, 4);
    let found = differences(&fixture.bus, 0, &steps).unwrap();
    let missing: Vec<_> = found.iter().filter(|difference| difference.found.is_none()).collect();
    let entries: Vec<_> =
        missing.iter().map(|difference| (difference.index, difference.subindex)).collect();
    assert_eq!(entries, [(0x8001, 19), (0x8021, 4)]);
    assert!(
        missing[0].to_string().ends_with("the device lacks it (assumption H42: older firmware)")
    );
    let others = |all: &[Difference]| {
        all.iter()
            .filter(|entry| !entries.contains(&(entry.index, entry.subindex)))
            .cloned()
            .collect::<Vec<_>>()
    };
    assert_eq!(others(&found), others(&before), "the other entries are compared");
    assert_eq!(missing_entries(&fixture.bus, 0, &steps).unwrap(), entries);
}

#[test]
fn unsaved_configuration_is_lost_by_power_cycle() {
    let (fixture, file) = (fixture(2), two());
    let (bus, clock) = (&fixture.bus, fixture.ecrt.clock().as_ref());
    let steps = startup(&file, 1);
    let unsaved = FlashCommand::Load.run(bus, 1, clock).unwrap_err();
    assert!(
        matches!(unsaved, MaintenanceError::Status(MaintenanceStatus::ImageInvalid)),
        "{unsaved}"
    );
    assert!(unsaved.to_string().contains("image invalid: nothing is stored"), "{unsaved}");
    apply(bus, 1, &steps, &mut |_| {}).unwrap();
    FlashCommand::Save.run(bus, 1, clock).unwrap();
    bus.sdo_download(1, 0x8002, 19, &125_000_u32.to_le_bytes()).unwrap();
    assert_eq!(entries(&differences(bus, 1, &steps).unwrap()), [(0x8002, 19, None)]);
    FlashCommand::Load.run(bus, 1, clock).unwrap();
    assert_eq!(differences(bus, 1, &steps).unwrap(), []);
    let factory = FlashCommand::Factory.run(bus, 1, clock).unwrap();
    assert_eq!(factory.stored_crc, 0);
    let lost = differences(bus, 1, &steps).unwrap();
    for entry in [(0x8010, 3, None), (0x8020, 7, None), (0x8002, 20, None), (0x8002, 49, None)] {
        assert!(entries(&lost).contains(&entry), "{entry:?} of {lost:?}");
    }
}

#[test]
fn difference_names_entry_and_filter() {
    let (fixture, file) = (fixture(2), two());
    let bus = &fixture.bus;
    let steps = startup(&file, 1);
    apply(bus, 1, &steps, &mut |_| {}).unwrap();
    // The second standard filter has another end, in the editing window.
    for (subindex, value) in [(43, 1), (45, 1)] {
        bus.sdo_download(1, 0x8002, subindex, &[value]).unwrap();
    }
    bus.sdo_download(1, 0x8002, 54, &0x310_u32.to_le_bytes()).unwrap();
    bus.sdo_download(1, 0x8002, 45, &[2]).unwrap();
    bus.sdo_download(1, 0x8022, 16, &30_u16.to_le_bytes()).unwrap();
    // The same depth as its other number.
    bus.sdo_download(1, 0x8022, 7, &[16]).unwrap();
    let found = differences(bus, 1, &steps).unwrap();
    assert_eq!(entries(&found), [(0x8022, 16, None), (0x8002, 54, Some(1))]);
    assert_eq!((found[1].expected, found[1].found), (Expected::Value(0x301), Some(0x310)));
    let text = found[1].to_string();
    assert!(text.contains("of filter 1: the file has 769, the device 784"), "{text}");
}

#[test]
fn failed_step_is_reported_and_ends_the_sequence() {
    let (fixture, mut file) = (fixture(2), two());
    let bus = &fixture.bus;
    file.adapter.add_startup(0, StartupStep::expect(0xF000, 2, 5)).unwrap();
    let steps = startup(&file, 0);
    let mut done = 0;
    let error = apply(bus, 0, &steps, &mut |_| done += 1).unwrap_err();
    assert_eq!(done, steps.len() - 1);
    assert!(matches!(error, ResolveError::Device(Error::Readback { found: 4, .. })), "{error}");

    let abort = Fault::Gateway {
        gateway: 0,
        fault: GatewayFault::SdoAbort { index: 0x8001, subindex: 19, code: 0x0609_0030, times: 1 },
    };
    fixture.simulation.inject(abort);
    let mut last = None;
    let error = apply(bus, 0, &steps, &mut |step| last = Some(step.object())).unwrap_err();
    assert!(error.to_string().contains("0x8001:19"), "{error}");
    assert_eq!(last, Some((0x8001, 18)));
}

#[test]
fn flash_failure_returns_status_text() {
    let fixture = fixture(1);
    let (bus, clock) = (&fixture.bus, fixture.ecrt.clock().as_ref());
    fixture
        .simulation
        .inject(Fault::Gateway { gateway: 0, fault: GatewayFault::FlashFailure { times: 1 } });
    let error = FlashCommand::Save.run(bus, 0, clock).unwrap_err();
    assert!(error.to_string().contains("5 (Flash error"), "{error}");
    assert_eq!(bus.sdo_upload_u32(0, 0xB000, 2).unwrap(), 0, "the mode is given back");
    FlashCommand::Save.run(bus, 0, clock).unwrap();
}

#[test]
fn gateways_are_found_by_alias_and_position() {
    let mut scenario = ecan_sim::echo(3);
    scenario.gateways[1].alias = 7;
    let fixture = with(scenario);
    let mut file = two();
    let [first, second] = &mut file.adapter.slaves[..] else { panic!("two") };
    (first.alias, first.position) = (7, 1);
    (second.alias, second.position) = (7, 0);
    let slaves: Vec<_> =
        find(&fixture.bus, &file.adapter.slaves).unwrap().iter().map(|place| place.slave).collect();
    assert_eq!(slaves, [2, 1]);
    file.adapter.slaves[0].position = 2;
    let error = find(&fixture.bus, &file.adapter.slaves).unwrap_err().to_string();
    assert!(error.contains("no slave at alias 7, position 2; the bus has 3 slaves"), "{error}");
    file.adapter.slaves[0].alias = 8;
    let error = find(&fixture.bus, &file.adapter.slaves).unwrap_err().to_string();
    assert!(error.contains("no slave has the alias 8"), "{error}");
}

#[test]
fn two_gateways_on_one_slave_return_error() {
    let mut scenario = ecan_sim::echo(2);
    scenario.gateways[1].alias = 7;
    let fixture = with(scenario);
    let mut file = two();
    let [first, second] = &mut file.adapter.slaves[..] else { panic!("two") };
    (first.alias, first.position) = (0, 1);
    (second.alias, second.position) = (7, 0);
    let error = find(&fixture.bus, &file.adapter.slaves).unwrap_err();
    assert!(matches!(error, ResolveError::Same { first: 0, second: 1, slave: 1 }), "{error}");
    assert!(error.to_string().contains("gateways 0 and 1 of the file are the same slave 1"));
    file.adapter.slaves[0].position = 0;
    assert!(find(&fixture.bus, &file.adapter.slaves).is_ok());
}

#[test]
fn gateway_in_op_is_not_changed() {
    let (fixture, file) = (fixture(2), two());
    let mut port = Port::open(&fixture.ecrt, (file.adapter, file.port)).unwrap();
    let adapter = port.adapter_mut();
    adapter.activate().unwrap();
    for _ in 0..3_000 {
        adapter.wait_next_cycle();
        adapter.receive().unwrap();
        adapter.send().unwrap();
    }
    let error = apply(&fixture.bus, 1, &startup(&file, 1), &mut |_| panic!("a step")).unwrap_err();
    assert!(matches!(error, ResolveError::State { slave: 1, state: AlState::Op }), "{error}");
    assert!(error.to_string().contains("slave 1 is in OP"), "{error}");
}

/// A clock on which ten seconds pass between two reads, while the gateway still writes.
struct Impatient(AtomicU64);

impl Clock for Impatient {
    fn now_ns(&self) -> u64 {
        self.0.fetch_add(10_000 * MS, Ordering::Relaxed)
    }

    fn sleep_until_ns(&self, _deadline_ns: u64) {}
}

#[test]
fn command_timeout_restores_the_mode() {
    let fixture = fixture(1);
    let bus = &fixture.bus;
    let error = FlashCommand::Save.run(bus, 0, &Impatient(AtomicU64::new(0))).unwrap_err();
    assert!(matches!(error, MaintenanceError::Unended), "{error}");
    assert_eq!(bus.sdo_upload_u32(0, 0xB000, 2).unwrap(), 0);
    // A rejected mode.
    let fault = GatewayFault::SdoAbort { index: 0xB000, subindex: 1, code: 0x0800_0022, times: 1 };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
    let error = FlashCommand::Factory.run(bus, 0, fixture.ecrt.clock().as_ref()).unwrap_err();
    assert!(error.to_string().contains("0xB000:01"), "{error}");
}

#[test]
fn requested_engineering_mode_is_kept() {
    let fixture = fixture(1);
    let bus = &fixture.bus;
    let clock = fixture.ecrt.clock().as_ref();
    bus.sdo_download(0, 0xB000, 1, &[1]).unwrap();
    for command in [FlashCommand::Save, FlashCommand::Load, FlashCommand::Factory] {
        command.run(bus, 0, clock).unwrap();
        assert_eq!(bus.sdo_upload_u32(0, 0xB000, 2).unwrap(), 1, "{command:?}");
    }
}
