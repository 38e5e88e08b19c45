//! Writing, comparing, saving and losing a configuration, on simulated gateways.

use std::sync::atomic::{AtomicU64, Ordering};

use super::common::{MS, fixture, two, with};
use ecan_host::{AdapterConfig, Clock, Error, MaintenanceError, StartupStep};
use ecan_lite::config::{
    Difference, Expected, FlashCommand, ResolveError, ResolvedGateway, apply, differences, find,
    missing_entries, parse, schema, startup,
};
use ecan_mcan_port::{ChannelConfig, GatewayConfig, Port, PortConfig};
use ecan_protocol::device::{AlState, MaintenanceStatus};
use ecan_protocol::object::{Entry, ObjectType, SdoWrite, objects};
use ecan_sim::{Fault, GatewayFault};

fn entries(differences: &[Difference]) -> Vec<(u16, u8, Option<u8>)> {
    differences
        .iter()
        .map(|difference| (difference.index, difference.subindex, difference.filter))
        .collect()
}

/// Writable entries without a setter of their own, with the reason.
const NOT_SET: &[(u16, &[u8], &str)] = &[
    (0x1C12, &[], "PDO assignment: follows from N"),
    (0x1C13, &[], "PDO assignment: follows from N"),
    (0x7000, &[], "process data"),
    (0x8000, &[1], "command: restart"),
    (0x8001, &[1, 3], "commands: apply, Flash"),
    (
        0x8001,
        &[43, 44, 45, 46, 50, 51, 52, 53, 54, 56, 57, 58, 59, 60],
        "editing window of filters",
    ),
    (0x8001, &[49, 55], "number of the configured filters"),
    (0x8010, &[1, 8], "commands: apply, session"),
    (0x8010, &[3], "N, a setting of the slave"),
    (0x8011, &[1, 8], "commands: apply, session"),
    (0x8011, &[3], "N, a setting of the slave"),
    (0x8020, &[2], "command: apply"),
    (0x8021, &[2], "command: apply"),
    (0x9011, &[14], "command: clear"),
    (0xA000, &[1, 2, 4], "register service of a diagnosis"),
    (0xB000, &[1, 4], "commands: access mode, maintenance"),
];

/// Another value than the default, if the entry has one.
fn other_value(entry: &Entry) -> u32 {
    let default = entry.default.unwrap_or(0);
    let candidates = [default + 1, default.saturating_sub(1), entry.bit_mask(), entry.max];
    let other = |value: &u32| *value != default && entry.accepts(*value);
    candidates.into_iter().find(other).unwrap_or(default)
}

#[test]
fn every_writable_entry_is_configured_or_a_command() {
    // Every entry that others need is on.
    let mut channel = ChannelConfig::fd(500_000, 5_000_000);
    let can = &mut channel.can;
    can.bit_timing_mode = ecan_protocol::config::BitTimingMode::Manual;
    (can.tsu, can.timeout) = (true, true);
    let full = GatewayConfig::on_all_channels(channel);
    let adapter = AdapterConfig::new(1);
    let schema = schema();
    for object in objects() {
        for entry in object.entries.iter().filter(|entry| entry.access.can_write()) {
            let subindex = entry.subindex;
            let is_listed = NOT_SET.iter().any(|(first, listed, _)| {
                *first == object.first && (listed.is_empty() || listed.contains(&subindex))
            });
            let place = format!("0x{:04X}:{subindex}", object.first);
            let value = other_value(entry);
            let mut gateway = full;
            let set = gateway.set_object(object.first, subindex, value);
            assert_eq!(set.is_ok(), !is_listed, "{place}");
            if is_listed {
                continue;
            }
            // `data_bitrate` enables CAN FD.
            let key = if place == "0x8001:15" { "data_bitrate" } else { entry.key.expect(&place) };
            let key = key.rsplit('.').next().unwrap();
            assert!(schema.contains(&format!("\"{key}\": {{")), "{place}: {key}");
            assert_eq!(gateway.object(object.first, subindex), Some(value), "{place}");
            let config = (adapter, PortConfig::from([gateway])).into();
            let write = SdoWrite::new(object.first, subindex, entry.ty, value);
            let steps = startup(&config, 0);
            assert!(steps.contains(&StartupStep::Download(write)), "{place}");
        }
    }
}

#[test]
fn pin_rotation_is_written_compared_and_verified() {
    let fixture = fixture(1);
    let bus = &fixture.bus;
    let channel = "[gateway.can0]\nbitrate = 250_000\n";
    let unstated = parse(format!("[[gateway]]\n{channel}").as_bytes()).unwrap();
    let rotated = format!("[[gateway]]\nsystem = {{ pin_rotation = 2 }}\n{channel}");
    let rotated = parse(rotated.as_bytes()).unwrap();
    let steps = startup(&rotated, 0);
    let at = |(index, subindex)| steps.iter().position(|step| step.object() == (index, subindex));
    let places = [at((0x8000, 14)), at((0x8000, 12)), at((0x8001, 7)), at((0x8000, 13))];
    assert!(places[0].is_some() && places.is_sorted(), "{places:?}");
    apply(bus, 0, &steps, &mut |_| {}).unwrap();
    assert_eq!(bus.sdo_upload_u32(0, 0x8000, 13).unwrap(), 2);
    assert_eq!(differences(bus, 0, &steps).unwrap(), []);
    let without = differences(bus, 0, &startup(&unstated, 0)).unwrap();
    assert_eq!(entries(&without), [(0x8000, 13, None)]);
    assert!(without[0].to_string().contains("the file no `pin_rotation`"), "{}", without[0]);
    bus.sdo_download(0, 0x8000, 12, &[0]).unwrap();
    let differing = entries(&differences(bus, 0, &steps).unwrap());
    assert_eq!(differing, [(0x8000, 12, None), (0x8000, 13, None)]);
    let mut port = Port::open(&fixture.ecrt, (rotated.adapter, rotated.port)).unwrap();
    port.wait_ready().unwrap();
    let active = port.diagnose(|bus| bus.sdo_upload_u32(0, 0x8000, 13)).unwrap();
    assert_eq!(active.unwrap(), 2);
}

#[test]
fn active_diagnostic_test_is_ended_by_apply() {
    let (fixture, file) = (fixture(2), two());
    let bus = &fixture.bus;
    bus.sdo_download(0, 0x8030, 1, &0x4543_414E_u32.to_le_bytes()).unwrap();
    bus.sdo_download(0, 0x8030, 6, &[3]).unwrap();
    let steps = startup(&file, 0);
    let tests = differences(bus, 0, &steps).unwrap();
    assert!(entries(&tests).contains(&(0x8030, 6, None)), "{tests:?}");
    apply(bus, 0, &steps, &mut |_| {}).unwrap();
    assert_eq!(differences(bus, 0, &steps).unwrap(), []);
    for subindex in 1..=6 {
        assert_eq!(bus.sdo_upload_u32(0, 0x8030, subindex).unwrap(), 0);
    }
    // A test of the file needs a permission.
    let test = |head: &str| {
        let text = format!(
            "[[gateway]]\n{head}\ncan0 = {{ bitrate = 250_000 }}\n[gateway.diagnostic_test]\n\
             enable_key = 0x4543_414E\nrx_bypass = ['parse']\ncrc = 'force_crc16'\n"
        );
        parse(text.as_bytes())
    };
    let faults = test("").unwrap_err().to_string();
    assert!(faults.contains("allow diagnostic tests"), "{faults}");
    let steps = startup(&test("allow_diagnostic_tests = true").unwrap(), 0);
    apply(bus, 0, &steps, &mut |_| {}).unwrap();
    assert_eq!(differences(bus, 0, &steps).unwrap(), []);
    assert_eq!(bus.sdo_upload_u32(0, 0x8030, 3).unwrap(), 1 << 3);
}

#[test]
fn raw_startup_sdo_writes_reads_back_or_both() {
    let read = |tables: &str| {
        parse(format!("[[gateway]]\ncan0 = {{ bitrate = 250_000 }}\n{tables}").as_bytes())
    };
    let sdo = |keys: &str| read(&format!("[[gateway.startup_sdo]]\n{keys}\n"));
    let both = read(
        "[[gateway.startup_sdo]]\nindex = 0x8000\nsubindex = 10\nvalue = 7\nexpect = 7\n\
         [[gateway.startup_sdo]]\nindex = 0xF000\nsubindex = 2\nexpect = 4\n\
         [[gateway.startup_sdo]]\nindex = 0x2000\nsubindex = 1\ntype = 'u16'\nvalue = 9\n",
    );
    let steps = startup(&both.unwrap(), 0);
    let expected = [
        SdoWrite::new(0x8000, 10, ObjectType::U32, 7).into(),
        StartupStep::expect(0x8000, 10, 7),
        StartupStep::expect(0xF000, 2, 4),
        SdoWrite::new(0x2000, 1, ObjectType::U16, 9).into(),
    ];
    assert_eq!(steps[steps.len() - 4..], expected);
    for (keys, fault) in [
        ("subindex = 1", "`index` is missing"),
        ("index = 0x8000\nsubindex = 10", "`value` and `expect` are missing"),
        ("index = 0x2000\nvalue = 1", "`type` is missing"),
        ("index = 0x8000\nsubindex = 12\nvalue = 256", "allowed: 0 to 255"),
        ("index = 0x1C12\nvalue = 1", "PDO assignment"),
    ] {
        let faults = sdo(keys).unwrap_err().to_string();
        assert!(faults.contains(fault), "{keys}: {faults}");
    }
    let (fixture, refused) = (fixture(1), sdo("index = 0xF000\nsubindex = 2\nexpect = 3").unwrap());
    let error = apply(&fixture.bus, 0, &startup(&refused, 0), &mut |_| {}).unwrap_err();
    assert!(matches!(error, ResolveError::Device(Error::Readback { found: 4, .. })), "{error}");
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
