//! PDO profiles, data path and diagnostic tests as SDO downloads (manual 5.4.3, 13.2).

use crate::common::{all_sent, in_table, sent};
use ecan_protocol::config::{
    BusOffRecovery, CacheDepth, ConfigObject, CrcTest, CriticalFrames, DIAGNOSTIC_TEST_KEY,
    DataPathConfig, DataPathFault, DataPathGlobal, DeviceConfig, DeviceFault, DiagnosticFault,
    DiagnosticTest, RangeFault, RxBudget, RxBypass, RxOverflow, SessionCommand, Sides, TxOverflow,
    assignment_writes, session_command_write,
};
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::lookup;

#[test]
fn phase_b_assigns_the_first_chunks() {
    let n3: Vec<_> = assignment_writes(Direction::RxPdo, 3).collect();
    assert_eq!(
        all_sent(&n3),
        [
            (0x1C12, 0, 1, 0),
            (0x1C12, 1, 2, 0x1600),
            (0x1C12, 2, 2, 0x1601),
            (0x1C12, 3, 2, 0x1602),
            (0x1C12, 0, 1, 3),
        ]
    );
    let n8: Vec<_> = assignment_writes(Direction::TxPdo, 8).collect();
    assert_eq!(n8.len(), 10);
    assert_eq!(sent(&n8[8]), (0x1C13, 8, 2, 0x1A07));
    in_table(&n8);
    let beyond = assignment_writes(Direction::TxPdo, 255);
    assert_eq!(beyond.len(), 26);
    in_table(&beyond.collect::<Vec<_>>());
}

#[test]
fn phase_c_golden() {
    let profile = PdoProfile::default();
    let mut writes = profile.writes(Direction::TxPdo).collect::<Vec<_>>();
    writes.push(PdoProfile::apply_write(Direction::TxPdo));
    writes.extend(profile.writes(Direction::RxPdo));
    writes.push(PdoProfile::apply_write(Direction::RxPdo));
    assert_eq!(
        all_sent(&writes),
        [
            (0x8010, 3, 1, 8),
            (0x8010, 4, 1, 0x0F),
            (0x8010, 5, 1, 0),
            (0x8010, 6, 1, 0),
            (0x8010, 7, 1, 0),
            (0x8010, 1, 1, 1),
            (0x8011, 3, 1, 8),
            (0x8011, 4, 1, 0x0F),
            (0x8011, 5, 1, 0),
            (0x8011, 6, 1, 0),
            (0x8011, 7, 1, 0),
            (0x8011, 1, 1, 1),
        ]
    );
    in_table(&writes);
    assert_eq!(writes[0].to_string(), "0x8010:03 TxPDO Profile Control / PDO size multiplier = 8");
}

#[test]
fn session_commands() {
    assert_eq!(
        sent(&session_command_write(Direction::RxPdo, SessionCommand::ResetAndClear)),
        (0x8011, 8, 1, 3)
    );
    assert_eq!(
        sent(&session_command_write(Direction::TxPdo, SessionCommand::ResetSession)),
        (0x8010, 8, 1, 1)
    );
}

#[test]
fn data_path_default_is_the_device_default() {
    let config = DataPathConfig::default();
    assert_eq!(config.active_word(), 0x5405_9201);
    let writes: Vec<_> = config.writes(3).collect();
    let expected: Vec<u8> = std::iter::once(1).chain(4..=19).collect();
    assert_eq!(writes.iter().map(|w| w.subindex).collect::<Vec<_>>(), expected);
    for write in &writes {
        let (_, entry) = lookup(write.index, write.subindex).unwrap();
        assert_eq!(entry.default, Some(write.value), "{write}");
    }
    in_table(&writes);
    assert_eq!(sent(&DataPathConfig::apply_write(3)), (0x8024, 2, 1, 1));
    let mut found = Vec::new();
    config.check(&mut |fault| found.push(fault));
    DataPathGlobal::default().check(&mut |fault| found.push(fault));
    assert!(found.is_empty());
    let values = |subindex| config.value(subindex).unwrap();
    assert_eq!(DataPathConfig::from_values(values), Ok(config));
}

#[test]
fn active_word_has_the_bits_of_the_manual() {
    let config = DataPathConfig {
        enable: false,
        rx_drain_min: 1,
        rx_drain_max: 8,
        rx_budget: RxBudget::Performance,
        rx_cache_depth: CacheDepth::D8,
        rx_overflow: RxOverflow::Degraded,
        critical_frames: CriticalFrames::CanopenAll,
        tx_budget_min: 2,
        tx_budget_max: 7,
        tx_overflow: TxOverflow::Backoff,
        bus_off_recovery: BusOffRecovery::Manual,
        ..DataPathConfig::default()
    };
    // From the top: 00 10 0111 0010 10 11 01 10 1000 0001 0000.
    assert_eq!(config.active_word(), 0b0010_0111_0010_1011_0110_1000_0001_0000);
}

#[test]
fn data_path_for_traffic() {
    let quiet = DataPathConfig::for_traffic(0, 0);
    assert_eq!(quiet, DataPathConfig::default());
    let busy = DataPathConfig::for_traffic(5, 6);
    assert_eq!((busy.rx_drain_max, busy.tx_budget_max), (6, 7));
    assert_eq!(busy.rx_cache_depth, CacheDepth::D24);
    let most = DataPathConfig::for_traffic(255, 255);
    assert_eq!((most.rx_drain_max, most.tx_budget_max), (8, 8));
    assert_eq!(most.rx_cache_depth, CacheDepth::D32);
    assert!(most.carries(8, 8));
    assert!(!most.carries(9, 8) && !most.carries(8, 9));
    in_table(&most.writes(0).collect::<Vec<_>>());
}

#[test]
fn data_path_faults() {
    let mut found = Vec::new();
    let config = DataPathConfig { rx_drain_min: 9, tx_budget_min: 5, ..DataPathConfig::default() };
    config.check(&mut |fault| found.push(fault));
    assert_eq!(
        found,
        [
            DataPathFault::Range(RangeFault {
                index: 0x8021,
                subindex: 4,
                value: 9,
                min: 0,
                max: 8
            }),
            DataPathFault::RxBudget { min: 9, max: 2 },
            DataPathFault::TxBudget { min: 5, max: 4 },
        ]
    );
    found.clear();
    let global = DataPathGlobal {
        runtime_options: 1,
        max_service_budget_us: 1001,
        ..DataPathGlobal::default()
    };
    global.check(&mut |fault| found.push(fault));
    assert_eq!(found.len(), 2);
    assert_eq!(
        found[1].to_string(),
        "Max service budget us (subindex 7) = 1001 is out of range; allowed: 0 to 1000"
    );
}

#[test]
fn global_data_path_writes() {
    let writes: Vec<_> = DataPathGlobal::default().writes().collect();
    assert_eq!(
        all_sent(&writes),
        [(0x8020, 4, 2, 3), (0x8020, 5, 4, 0), (0x8020, 6, 4, 0), (0x8020, 7, 2, 1000)]
    );
    in_table(&writes);
    assert_eq!(sent(&DataPathGlobal::apply_write()), (0x8020, 2, 1, 1));
}

#[test]
fn diagnostic_tests_need_the_key() {
    let mut found = Vec::new();
    let locked = DiagnosticTest { crc: CrcTest::Suppress, ..DiagnosticTest::OFF };
    locked.check(&mut |fault| found.push(fault));
    assert_eq!(found, [DiagnosticFault::Locked]);
    let wrong = DiagnosticTest { key: 1, rx_bypass: RxBypass(1), ..DiagnosticTest::OFF };
    found.clear();
    wrong.check(&mut |fault| found.push(fault));
    assert_eq!(found, [DiagnosticFault::Key(1), DiagnosticFault::RxBits(1)]);
    let test = DiagnosticTest {
        key: DIAGNOSTIC_TEST_KEY,
        app_link_bypass: Sides::Rx,
        ..DiagnosticTest::OFF
    };
    found.clear();
    test.check(&mut |fault| found.push(fault));
    assert!(found.is_empty());
    // The key is set before the tests and cleared after them.
    let writes: Vec<_> = test.writes().collect();
    assert_eq!(sent(&writes[0]), (0x8030, 1, 4, 0x4543_414E));
    assert_eq!(sent(&writes[5]), (0x8030, 6, 1, 2));
    assert_eq!(sent(&DiagnosticTest::OFF.writes().nth(5).unwrap()), (0x8030, 1, 4, 0));
    in_table(&writes);
    let device = |subindex: u8| -> Result<u32, ()> {
        Ok(test.writes().find(|w| w.subindex == subindex).unwrap().value)
    };
    assert_eq!(DiagnosticTest::read(device), Ok(test));
}

#[test]
fn device_objects_are_written_as_far_as_they_are_set() {
    let none = DeviceConfig::default();
    assert_eq!(none.first_writes().chain(none.data_path_writes()).count(), 0);
    assert_eq!((none.readbacks().count(), none.needed_rotation()), (0, None));
    let mut device = DeviceConfig { cpu_voltage_mv: Some(1275), ..none };
    device.set_value(0x8000, 12, 3).unwrap();
    device.set_value(0xB000, 3, 60).unwrap();
    let writes: Vec<_> = device.first_writes().collect();
    assert_eq!(all_sent(&writes), [(0x8000, 12, 1, 3), (0x8000, 3, 2, 1275), (0xB000, 3, 2, 60)]);
    in_table(&writes);
    assert_eq!(device.needed_rotation(), Some((0x8000, 14, 1 << 3)));
    device.set_value(0x8020, 7, 500).unwrap();
    assert_eq!(device.value(0x8020, 4), Some(3));
    let readbacks: Vec<_> = device.readbacks().collect();
    assert_eq!(readbacks, [(0x8000, 15, 0), (0x8000, 13, 3), (0x8020, 3, 0)]);
    // The key is set before the tests.
    device.set_value(0x8030, 4, 2).unwrap();
    device.set_value(0x8030, 1, DIAGNOSTIC_TEST_KEY).unwrap();
    assert_eq!(sent(&device.test_writes().next().unwrap()), (0x8030, 1, 4, DIAGNOSTIC_TEST_KEY));
    for (index, subindex, value) in
        [(0x8000, 12, 256), (0x8000, 3, 65_536), (0x8000, 4, 0), (0x8030, 4, 3), (0xB000, 1, 1)]
    {
        let before = device;
        device.set_value(index, subindex, value).unwrap_err();
        assert_eq!(device, before, "0x{index:04X}:{subindex}");
    }
    let mut found = Vec::new();
    device.pin_rotation = Some(4);
    device.diagnostic_test.as_mut().unwrap().key = 0;
    device.check(&mut |fault| found.push(fault));
    let range = RangeFault { index: 0x8000, subindex: 12, value: 4, min: 0, max: 3 };
    assert_eq!(found, [DeviceFault::Range(range), DeviceFault::Test(DiagnosticFault::Locked)]);
}
