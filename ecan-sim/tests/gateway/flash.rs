//! The saved configuration: saving, loading and factory defaults, as a whole and by channel, and
//! power loss (manual 13.4, 13.7).

use super::fixture::{Fixture, MS, chunks, standard};
use ecan_protocol::config::{
    DataPathConfig, FilterAction, McanChannelConfig, StandardFilter, StandardMatch, filter_writes,
};
use ecan_protocol::object::{AbortCode, Access, objects};
use ecan_sim::{GatewayFault, StationConfig};

const SAVE: u8 = 1 << 0;
const LOAD: u8 = 1 << 1;
const FACTORY: u8 = 1 << 2;
const ENGINEERING: u8 = 1;
const FACTORY_MODE: u8 = 2;
/// Longer than any command.
const LONG: u64 = 100 * MS;

const OK: u32 = 0;
const BUSY: u32 = 1;
const DENIED: u32 = 2;
const CRC_ERROR: u32 = 3;
const IMAGE_INVALID: u32 = 4;
const FLASH_ERROR: u32 = 5;

fn in_mode(mode: u8) -> Fixture {
    let mut fixture = Fixture::preop();
    fixture.write_u8(0xB000, 1, mode);
    fixture
}

/// Executes a maintenance command; returns its status.
fn maintain(fixture: &mut Fixture, bits: u8) -> u32 {
    let sequence = fixture.upload(0xB000, 12);
    fixture.write_u8(0xB000, 4, bits);
    fixture.pass(LONG);
    assert_eq!(fixture.upload(0xB000, 12), sequence + 1);
    fixture.upload(0xB000, 5)
}

/// Executes a channel's flash command; returns its status.
fn flash(fixture: &mut Fixture, channel: u16, bits: u8) -> u32 {
    let sequence = fixture.upload(0x8001 + channel, 5);
    fixture.write_u8(0x8001 + channel, 3, bits);
    fixture.pass(LONG);
    assert_eq!(fixture.upload(0x8001 + channel, 5), sequence + 1);
    fixture.upload(0x8001 + channel, 4)
}

/// Channel 1 runs with a filter, and every other object has a changed value.
fn configure(fixture: &mut Fixture) {
    let filter = StandardFilter {
        matching: StandardMatch::Two,
        action: FilterAction::Reject,
        sync: false,
        id1: 0x101,
        id2: 0x102,
    };
    fixture.send(filter_writes(1, &[filter], &[]));
    fixture.apply_channel(1, McanChannelConfig::classic(250_000));
    // requested, never applied
    fixture.download(0x8004, 19, &125_000u32.to_le_bytes()).unwrap();
    fixture.apply_data_path(2, DataPathConfig::for_traffic(5, 6));
    fixture.write_u8(0x8000, 12, 3);
    fixture.download(0x8000, 10, &77u32.to_le_bytes()).unwrap();
    fixture.write_u8(0x8010, 3, 5);
    fixture.write_u8(0x8011, 7, 2);
    fixture.download(0x8020, 7, &500u16.to_le_bytes()).unwrap();
}

fn assert_configured(fixture: &mut Fixture) {
    assert_eq!(fixture.gateway.station_config(0), Some(StationConfig::classic(250_000)), "rotated");
    for connector in 1..4 {
        assert_eq!(fixture.gateway.station_config(connector), None);
    }
    let word = DataPathConfig::for_traffic(5, 6).active_word();
    for (index, subindex, expected) in [
        (0x8000, 10, 77),
        (0x8000, 13, 3),
        (0x8004, 19, 125_000),
        (0x8023, 20, word),
        (0x8022, 20, 0x5405_9201),
        (0x8010, 3, 5),
        (0x8011, 7, 2),
        (0x8020, 7, 500),
    ] {
        assert_eq!(fixture.upload(index, subindex), expected, "{index:04X}:{subindex}");
    }
    fixture.write_u8(0x8002, 43, 0);
    fixture.write_u8(0x8002, 45, 1);
    assert_eq!((fixture.upload(0x8002, 53), fixture.upload(0x8002, 54)), (0x101, 0x102));
}

#[test]
fn new_gateway_has_no_saved_configuration() {
    let mut fixture = Fixture::preop();
    assert_eq!(fixture.upload(0xB000, 8), 0);
    assert_ne!(fixture.upload(0xB000, 7), 0);
    let before = fixture.upload(0xB000, 7);
    configure(&mut fixture);
    assert_ne!(fixture.upload(0xB000, 7), before);
    fixture.power_cycle();
    assert_eq!(fixture.upload(0xB000, 7), before, "nothing was saved");
    fixture.write_u8(0xB000, 1, ENGINEERING);
    assert_eq!(maintain(&mut fixture, LOAD), IMAGE_INVALID);
    assert_eq!(flash(&mut fixture, 0, LOAD), 1);
}

#[test]
fn saved_configuration_survives_power_loss_and_reboot() {
    let mut fixture = in_mode(ENGINEERING);
    configure(&mut fixture);
    fixture.download(0x8030, 1, &0x4543_414Eu32.to_le_bytes()).unwrap();
    fixture.write_u8(0x8030, 4, 2);
    let active = fixture.upload(0xB000, 7);
    fixture.write_u8(0xB000, 4, SAVE);
    let sequence = fixture.upload(0xB000, 12);
    fixture.pass(20 * MS - 1);
    assert_eq!((fixture.upload(0xB000, 5), fixture.upload(0xB000, 12)), (BUSY, sequence));
    fixture.pass(1);
    assert_eq!((fixture.upload(0xB000, 5), fixture.upload(0xB000, 12)), (OK, sequence + 1));
    assert_eq!(fixture.upload(0xB000, 8), active);
    for restart in 0..2 {
        // not saved
        fixture.download(0x8000, 10, &1u32.to_le_bytes()).unwrap();
        if restart == 0 {
            fixture.power_cycle();
        } else {
            fixture.write_u8(0x8000, 1, 1);
            fixture.pass(100 * MS);
            fixture.boot();
        }
        assert_configured(&mut fixture);
        assert_eq!((fixture.upload(0xB000, 7), fixture.upload(0xB000, 8)), (active, active));
        assert_eq!((fixture.upload(0x8030, 1), fixture.upload(0x8030, 4)), (0, 0));
        assert_eq!((fixture.upload(0xB000, 2), fixture.upload(0xB000, 12)), (0, 0));
    }
    // the filter works again
    fixture.apply_profiles(chunks(3), chunks(3));
    fixture.start();
    fixture.deliver_ids(0, [0x101, 0x103]);
    fixture.cycle();
    assert_eq!(fixture.received(), [(1, standard(0x103, &[]))]);
}

#[test]
fn load_activates_the_saved_configuration() {
    let mut fixture = in_mode(ENGINEERING);
    configure(&mut fixture);
    assert_eq!(maintain(&mut fixture, SAVE), OK);
    fixture.apply_channel(1, McanChannelConfig::classic(1_000_000));
    fixture.apply_data_path(2, DataPathConfig::default());
    fixture.write_u8(0x8000, 12, 0);
    for (index, subindex, value) in [(0x8010, 3, 9), (0x8011, 7, 0)] {
        fixture.write_u8(index, subindex, value);
    }
    assert_eq!(maintain(&mut fixture, LOAD), OK);
    assert_configured(&mut fixture);
    assert_eq!(fixture.upload(0x8010, 2), 9, "a requested profile waits to be applied");
    assert_eq!(fixture.upload(0xB000, 7), fixture.upload(0xB000, 8));
}

#[test]
fn factory_defaults_erase_what_was_saved() {
    let mut fixture = in_mode(FACTORY_MODE);
    let fresh = fixture.upload(0xB000, 7);
    configure(&mut fixture);
    assert_eq!(maintain(&mut fixture, SAVE), OK);
    assert_eq!(maintain(&mut fixture, FACTORY), OK);
    assert_eq!(fixture.upload(0xB000, 8), 0);
    assert_eq!(fixture.gateway.station_config(1), Some(StationConfig::fd(500_000, 5_000_000)));
    assert_eq!((fixture.upload(0x8000, 13), fixture.upload(0x8004, 19)), (0, 500_000));
    fixture.power_cycle();
    assert_eq!(fixture.upload(0xB000, 7), fresh);
    assert_eq!(fixture.gateway.station_config(1), None);
}

#[test]
fn commands_need_their_mode_and_are_denied_in_op() {
    // command, lowest mode in which it is executed, whether also in OP
    let commands = [
        (SAVE, 1, false),
        (LOAD, 1, false),
        (FACTORY, 2, false),
        (1 << 3, 1, true),
        (1 << 4, 1, false),
        (1 << 5, 0, true),
        (SAVE | LOAD | 1 << 3, 1, false),
        (SAVE | FACTORY, 2, false),
        (SAVE | 1 << 5, 3, false),
        (SAVE | 1 << 6, 3, false),
        (1 << 5 | 1 << 6, 3, false),
    ];
    for mode in 0..=2 {
        for op in [false, true] {
            for (bits, needed, in_op) in commands {
                let mut fixture =
                    if op { Fixture::op(chunks(1), chunks(1)) } else { Fixture::preop() };
                fixture.gateway.set_watchdog_ns(0);
                fixture.write_u8(0xB000, 1, mode);
                let allowed = mode >= needed && (!op || in_op);
                let status = maintain(&mut fixture, bits);
                assert_eq!(status != DENIED, allowed, "{bits:#04x} in mode {mode}, OP {op}");
                if !allowed {
                    assert_eq!(fixture.upload(0xB000, 8), 0, "nothing of it is done");
                }
            }
        }
    }
}

#[test]
fn expired_access_mode_denies_commands() {
    let mut fixture = Fixture::preop();
    fixture.download(0xB000, 3, &1u16.to_le_bytes()).unwrap();
    fixture.write_u8(0xB000, 1, ENGINEERING);
    assert_eq!(maintain(&mut fixture, SAVE), OK);
    fixture.pass(1_000 * MS);
    assert_eq!(maintain(&mut fixture, SAVE), DENIED);
}

#[test]
fn combined_commands_stop_at_the_first_failure() {
    let mut fixture = in_mode(FACTORY_MODE);
    configure(&mut fixture);
    assert_eq!(maintain(&mut fixture, SAVE | FACTORY), OK);
    assert_eq!((fixture.upload(0xB000, 8), fixture.upload(0x8000, 10)), (0, 0));
    configure(&mut fixture);
    // the free partition is empty; earlier commands are executed
    assert_eq!(maintain(&mut fixture, SAVE | 1 << 3), IMAGE_INVALID);
    assert_eq!(fixture.upload(0xB000, 8), fixture.upload(0xB000, 7));
    fixture.download(0x8000, 10, &5u32.to_le_bytes()).unwrap();
    fixture.gateway.inject(fixture.now, GatewayFault::FlashFailure { times: 1 });
    assert_eq!(maintain(&mut fixture, SAVE | LOAD), FLASH_ERROR);
    assert_eq!(fixture.upload(0x8000, 10), 5, "nothing was loaded");
}

#[test]
fn command_in_progress_rejects_the_next() {
    let mut fixture = in_mode(ENGINEERING);
    fixture.write_u8(0xB000, 4, SAVE);
    assert_eq!(fixture.download(0xB000, 4, &[LOAD]), Err(AbortCode::DEVICE_STATE));
    fixture.write_u8(0x8001, 3, SAVE);
    assert_eq!((fixture.upload(0x8001, 4), fixture.upload(0x8001, 5)), (1, 1));
    fixture.pass(LONG);
    assert_eq!((fixture.upload(0xB000, 5), fixture.upload(0xB000, 12)), (OK, 1));
}

#[test]
fn interrupted_save_is_detected() {
    let mut fixture = in_mode(ENGINEERING);
    configure(&mut fixture);
    assert_eq!(maintain(&mut fixture, SAVE), OK);
    fixture.write_u8(0xB000, 4, SAVE);
    fixture.pass(10 * MS);
    fixture.power_cycle();
    assert_eq!((fixture.upload(0xB000, 8), fixture.upload(0x8000, 10)), (0, 0));
    fixture.write_u8(0xB000, 1, ENGINEERING);
    assert_eq!(maintain(&mut fixture, LOAD), CRC_ERROR);
    assert_eq!(maintain(&mut fixture, SAVE), OK);
    assert_eq!(maintain(&mut fixture, LOAD), OK);
}

#[test]
fn failing_flash_is_reported() {
    let mut fixture = in_mode(FACTORY_MODE);
    for bits in [SAVE, FACTORY] {
        fixture.gateway.inject(fixture.now, GatewayFault::FlashFailure { times: 2 });
        assert_eq!(maintain(&mut fixture, bits), FLASH_ERROR);
        assert_eq!(flash(&mut fixture, 0, bits), 1);
    }
    assert_eq!(maintain(&mut fixture, SAVE), OK);
}

#[test]
fn channel_is_saved_loaded_and_restored_alone() {
    let mut fixture = Fixture::preop();
    fixture.apply_channel(0, McanChannelConfig::classic(125_000));
    fixture.apply_channel(3, McanChannelConfig::classic(250_000));
    fixture.write_u8(0x8004, 3, SAVE);
    fixture.pass(20 * MS - 1);
    assert_eq!(fixture.upload(0x8004, 5), 1, "the apply before");
    fixture.pass(1);
    assert_eq!((fixture.upload(0x8004, 4), fixture.upload(0x8004, 5)), (0, 2));
    fixture.power_cycle();
    assert_eq!(fixture.gateway.station_config(0), None);
    assert_eq!(fixture.upload(0x8001, 19), 500_000);
    assert_eq!(fixture.gateway.station_config(3), Some(StationConfig::classic(250_000)));
    fixture.apply_channel(3, McanChannelConfig::classic(1_000_000));
    assert_eq!(flash(&mut fixture, 3, LOAD), 0);
    assert_eq!(fixture.gateway.station_config(3), Some(StationConfig::classic(250_000)));
    // another one is added, the first stays
    fixture.apply_channel(0, McanChannelConfig::classic(125_000));
    assert_eq!(flash(&mut fixture, 0, SAVE), 0);
    assert_eq!(flash(&mut fixture, 3, FACTORY), 0);
    assert_eq!(fixture.upload(0x8004, 19), 500_000);
    fixture.power_cycle();
    assert_eq!(fixture.gateway.station_config(0), Some(StationConfig::classic(125_000)));
    assert_eq!(fixture.gateway.station_config(3), None);
}

#[test]
fn invalid_channel_is_not_saved() {
    let mut fixture = Fixture::preop();
    fixture.download(0x8001, 19, &0u32.to_le_bytes()).unwrap();
    assert_eq!(flash(&mut fixture, 0, SAVE), 3);
    fixture.download(0x8001, 19, &500_000u32.to_le_bytes()).unwrap();
    fixture.write_u8(0x8001, 62, 64);
    fixture.write_u8(0x8001, 64, 64);
    fixture.write_u8(0x8001, 67, 64);
    assert_eq!(flash(&mut fixture, 0, SAVE), 4);
    assert_eq!(fixture.upload(0xB000, 8), 0);
}

#[test]
fn channel_flash_commands_fail_in_op() {
    let mut fixture = Fixture::op(chunks(1), chunks(1));
    fixture.gateway.set_watchdog_ns(0);
    for bits in [SAVE, LOAD, FACTORY] {
        assert_eq!(flash(&mut fixture, 0, bits), 1);
    }
}

#[test]
fn crc_covers_what_is_saved_and_nothing_else() {
    let mut checked = 0;
    for object in objects() {
        for index in object.indices() {
            let saved_object = matches!(index, 0x8000..=0x8004 | 0x8010..=0x8011 | 0x8020..=0x8024);
            for entry in object.entries {
                let window = (0x8001..=0x8004).contains(&index)
                    && matches!(entry.subindex, 43..=46 | 50..=54 | 56..=60);
                let command = matches!(
                    (index, entry.subindex),
                    (0x8010..=0x8011, 1 | 8) | (0x8020..=0x8024, 2)
                );
                if entry.access != Access::Rw || !entry.ty.is_integer() || index >= 0x9000 {
                    continue;
                }
                let mut fixture = Fixture::preop();
                let before = fixture.upload(0xB000, 7);
                let candidates = [entry.max, entry.max.saturating_sub(1), entry.min, entry.min + 1];
                let other = candidates
                    .into_iter()
                    .find(|&value| entry.default != Some(value) && entry.accepts(value));
                // reserved, except its default
                let Some(value) = other else { continue };
                let bytes = value.to_le_bytes();
                let size = entry.ty.size_bytes().unwrap();
                if fixture.download(index, entry.subindex, &bytes[..size]).is_err() {
                    continue;
                }
                checked += 1;
                let changed = fixture.upload(0xB000, 7) != before;
                let name = format!("{index:04X}:{} = {value}", entry.subindex);
                assert_eq!(changed, saved_object && !window && !command, "{name}");
            }
        }
    }
    assert!(checked > 300, "{checked}");
}
