//! The saved configuration: saving, loading and factory defaults, as a whole and by channel, and
//! what survives a power loss (manual 13.4, 13.7).

mod gateway_support;

use ecan_protocol::config::{
    DataPathConfig, FilterAction, McanChannelConfig, StandardFilter, StandardMatch, filter_writes,
};
use ecan_protocol::object::{AbortCode, Access, objects};
use ecan_sim::{GatewayFault, StationConfig};
use gateway_support::{Fixture, MS, chunks, standard};

const SAVE: u8 = 1 << 0;
const LOAD: u8 = 1 << 1;
const FACTORY: u8 = 1 << 2;
const ENGINEERING: u8 = 1;
const FACTORY_MODE: u8 = 2;
/// More than any command takes.
const LONG: u64 = 100 * MS;

const OK: u32 = 0;
const BUSY: u32 = 1;
const DENIED: u32 = 2;
const CRC_ERROR: u32 = 3;
const IMAGE_INVALID: u32 = 4;
const FLASH_ERROR: u32 = 5;

fn in_mode(mode: u8) -> Fixture {
    let mut bench = Fixture::preop();
    bench.write_u8(0xB000, 1, mode);
    bench
}

/// Executes a maintenance command; its status.
fn maintain(bench: &mut Fixture, bits: u8) -> u32 {
    let sequence = bench.upload(0xB000, 12);
    bench.write_u8(0xB000, 4, bits);
    bench.pass(LONG);
    assert_eq!(bench.upload(0xB000, 12), sequence + 1);
    bench.upload(0xB000, 5)
}

/// Executes a channel's flash command; its status.
fn flash(bench: &mut Fixture, channel: u16, bits: u8) -> u32 {
    let sequence = bench.upload(0x8001 + channel, 5);
    bench.write_u8(0x8001 + channel, 3, bits);
    bench.pass(LONG);
    assert_eq!(bench.upload(0x8001 + channel, 5), sequence + 1);
    bench.upload(0x8001 + channel, 4)
}

fn power_cycle(bench: &mut Fixture) {
    bench.gateway.power(bench.now, false);
    bench.pass(MS);
    bench.gateway.power(bench.now, true);
    boot(bench);
}

/// Waits for the end of a start and goes to PREOP.
fn boot(bench: &mut Fixture) {
    assert!(!bench.gateway.is_responding());
    bench.pass(1_000 * MS);
    bench.set_up_mailboxes();
    bench.gateway.request_al_state(bench.now, ecan_protocol::device::AlState::PreOp);
}

/// Channel 1 runs with a filter, and something of every other object is set.
fn configure(bench: &mut Fixture) {
    let filter = StandardFilter {
        matching: StandardMatch::Two,
        action: FilterAction::Reject,
        sync: false,
        id1: 0x101,
        id2: 0x102,
    };
    for write in filter_writes(1, &[filter], &[]) {
        bench.send(write);
    }
    bench.apply_channel(1, McanChannelConfig::classic(250_000));
    // asked for, never applied
    bench.download(0x8004, 19, &125_000u32.to_le_bytes()).unwrap();
    bench.apply_data_path(2, DataPathConfig::for_traffic(5, 6));
    bench.write_u8(0x8000, 12, 3);
    bench.download(0x8000, 10, &77u32.to_le_bytes()).unwrap();
    bench.write_u8(0x8010, 3, 5);
    bench.write_u8(0x8011, 7, 2);
    bench.download(0x8020, 7, &500u16.to_le_bytes()).unwrap();
}

fn assert_configured(bench: &mut Fixture) {
    assert_eq!(bench.gateway.station_config(0), Some(StationConfig::classic(250_000)), "rotated");
    for connector in 1..4 {
        assert_eq!(bench.gateway.station_config(connector), None);
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
        assert_eq!(bench.upload(index, subindex), expected, "{index:04X}:{subindex}");
    }
    bench.write_u8(0x8002, 43, 0);
    bench.write_u8(0x8002, 45, 1);
    assert_eq!((bench.upload(0x8002, 53), bench.upload(0x8002, 54)), (0x101, 0x102));
}

#[test]
fn a_new_gateway_has_nothing_stored() {
    let mut bench = Fixture::preop();
    assert_eq!(bench.upload(0xB000, 8), 0);
    assert_ne!(bench.upload(0xB000, 7), 0);
    let before = bench.upload(0xB000, 7);
    configure(&mut bench);
    assert_ne!(bench.upload(0xB000, 7), before);
    power_cycle(&mut bench);
    assert_eq!(bench.upload(0xB000, 7), before, "nothing was saved");
    bench.write_u8(0xB000, 1, ENGINEERING);
    assert_eq!(maintain(&mut bench, LOAD), IMAGE_INVALID);
    assert_eq!(flash(&mut bench, 0, LOAD), 1);
}

#[test]
fn a_saved_configuration_survives_power_loss_and_reboot() {
    let mut bench = in_mode(ENGINEERING);
    configure(&mut bench);
    bench.download(0x8030, 1, &0x4543_414Eu32.to_le_bytes()).unwrap();
    bench.write_u8(0x8030, 4, 2);
    let active = bench.upload(0xB000, 7);
    bench.write_u8(0xB000, 4, SAVE);
    let sequence = bench.upload(0xB000, 12);
    bench.pass(20 * MS - 1);
    assert_eq!((bench.upload(0xB000, 5), bench.upload(0xB000, 12)), (BUSY, sequence));
    bench.pass(1);
    assert_eq!((bench.upload(0xB000, 5), bench.upload(0xB000, 12)), (OK, sequence + 1));
    assert_eq!(bench.upload(0xB000, 8), active);
    for restart in 0..2 {
        // not saved
        bench.download(0x8000, 10, &1u32.to_le_bytes()).unwrap();
        if restart == 0 {
            power_cycle(&mut bench);
        } else {
            bench.write_u8(0x8000, 1, 1);
            bench.pass(20 * MS);
            boot(&mut bench);
        }
        assert_configured(&mut bench);
        assert_eq!((bench.upload(0xB000, 7), bench.upload(0xB000, 8)), (active, active));
        assert_eq!((bench.upload(0x8030, 1), bench.upload(0x8030, 4)), (0, 0));
        assert_eq!((bench.upload(0xB000, 2), bench.upload(0xB000, 12)), (0, 0));
    }
    // the filter works again
    bench.apply_profiles(chunks(3), chunks(3));
    bench.start();
    for id in [0x101, 0x103] {
        bench.deliver(0, standard(id, &[]));
    }
    bench.cycle();
    assert_eq!(bench.received(), [(1, standard(0x103, &[]))]);
}

#[test]
fn loading_puts_the_saved_configuration_in_force() {
    let mut bench = in_mode(ENGINEERING);
    configure(&mut bench);
    assert_eq!(maintain(&mut bench, SAVE), OK);
    bench.apply_channel(1, McanChannelConfig::classic(1_000_000));
    bench.apply_data_path(2, DataPathConfig::default());
    bench.write_u8(0x8000, 12, 0);
    for (index, subindex, value) in [(0x8010, 3, 9), (0x8011, 7, 0)] {
        bench.write_u8(index, subindex, value);
    }
    assert_eq!(maintain(&mut bench, LOAD), OK);
    assert_configured(&mut bench);
    assert_eq!(bench.upload(0x8010, 2), 9, "a requested profile waits to be applied");
    assert_eq!(bench.upload(0xB000, 7), bench.upload(0xB000, 8));
}

#[test]
fn factory_defaults_erase_what_was_saved() {
    let mut bench = in_mode(FACTORY_MODE);
    let fresh = bench.upload(0xB000, 7);
    configure(&mut bench);
    assert_eq!(maintain(&mut bench, SAVE), OK);
    assert_eq!(maintain(&mut bench, FACTORY), OK);
    assert_eq!(bench.upload(0xB000, 8), 0);
    assert_eq!(bench.gateway.station_config(1), Some(StationConfig::fd(500_000, 5_000_000)));
    assert_eq!((bench.upload(0x8000, 13), bench.upload(0x8004, 19)), (0, 500_000));
    power_cycle(&mut bench);
    assert_eq!(bench.upload(0xB000, 7), fresh);
    assert_eq!(bench.gateway.station_config(1), None);
}

#[test]
fn commands_need_their_mode_and_stay_out_of_op() {
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
                let mut bench =
                    if op { Fixture::op(chunks(1), chunks(1)) } else { Fixture::preop() };
                bench.gateway.set_watchdog_ns(0);
                bench.write_u8(0xB000, 1, mode);
                let allowed = mode >= needed && (!op || in_op);
                let status = maintain(&mut bench, bits);
                assert_eq!(status != DENIED, allowed, "{bits:#04x} in mode {mode}, OP {op}");
                if !allowed {
                    assert_eq!(bench.upload(0xB000, 8), 0, "nothing of it is done");
                }
            }
        }
    }
}

#[test]
fn a_mode_that_timed_out_denies() {
    let mut bench = Fixture::preop();
    bench.download(0xB000, 3, &1u16.to_le_bytes()).unwrap();
    bench.write_u8(0xB000, 1, ENGINEERING);
    assert_eq!(maintain(&mut bench, SAVE), OK);
    bench.pass(1_000 * MS);
    assert_eq!(maintain(&mut bench, SAVE), DENIED);
}

#[test]
fn combined_commands_go_by_their_bits_and_stop_at_the_first_failure() {
    let mut bench = in_mode(FACTORY_MODE);
    configure(&mut bench);
    assert_eq!(maintain(&mut bench, SAVE | FACTORY), OK);
    assert_eq!((bench.upload(0xB000, 8), bench.upload(0x8000, 10)), (0, 0));
    configure(&mut bench);
    // no image lies in the free partition; what comes before is done
    assert_eq!(maintain(&mut bench, SAVE | 1 << 3), IMAGE_INVALID);
    assert_eq!(bench.upload(0xB000, 8), bench.upload(0xB000, 7));
    bench.download(0x8000, 10, &5u32.to_le_bytes()).unwrap();
    bench.gateway.inject(bench.now, GatewayFault::FlashFailure { times: 1 });
    assert_eq!(maintain(&mut bench, SAVE | LOAD), FLASH_ERROR);
    assert_eq!(bench.upload(0x8000, 10), 5, "nothing was loaded");
}

#[test]
fn a_command_under_way_refuses_the_next() {
    let mut bench = in_mode(ENGINEERING);
    bench.write_u8(0xB000, 4, SAVE);
    assert_eq!(bench.download(0xB000, 4, &[LOAD]), Err(AbortCode::DEVICE_STATE));
    bench.write_u8(0x8001, 3, SAVE);
    assert_eq!((bench.upload(0x8001, 4), bench.upload(0x8001, 5)), (1, 1));
    bench.pass(LONG);
    assert_eq!((bench.upload(0xB000, 5), bench.upload(0xB000, 12)), (OK, 1));
}

#[test]
fn a_save_that_was_cut_off_is_found_out() {
    let mut bench = in_mode(ENGINEERING);
    configure(&mut bench);
    assert_eq!(maintain(&mut bench, SAVE), OK);
    bench.write_u8(0xB000, 4, SAVE);
    bench.pass(10 * MS);
    power_cycle(&mut bench);
    assert_eq!((bench.upload(0xB000, 8), bench.upload(0x8000, 10)), (0, 0));
    bench.write_u8(0xB000, 1, ENGINEERING);
    assert_eq!(maintain(&mut bench, LOAD), CRC_ERROR);
    assert_eq!(maintain(&mut bench, SAVE), OK);
    assert_eq!(maintain(&mut bench, LOAD), OK);
}

#[test]
fn a_failing_flash_is_told() {
    let mut bench = in_mode(FACTORY_MODE);
    for bits in [SAVE, FACTORY] {
        bench.gateway.inject(bench.now, GatewayFault::FlashFailure { times: 2 });
        assert_eq!(maintain(&mut bench, bits), FLASH_ERROR);
        assert_eq!(flash(&mut bench, 0, bits), 1);
    }
    assert_eq!(maintain(&mut bench, SAVE), OK);
}

#[test]
fn a_channel_is_saved_loaded_and_restored_alone() {
    let mut bench = Fixture::preop();
    bench.apply_channel(0, McanChannelConfig::classic(125_000));
    bench.apply_channel(3, McanChannelConfig::classic(250_000));
    bench.write_u8(0x8004, 3, SAVE);
    bench.pass(20 * MS - 1);
    assert_eq!(bench.upload(0x8004, 5), 1, "the apply before");
    bench.pass(1);
    assert_eq!((bench.upload(0x8004, 4), bench.upload(0x8004, 5)), (0, 2));
    power_cycle(&mut bench);
    assert_eq!(bench.gateway.station_config(0), None);
    assert_eq!(bench.upload(0x8001, 19), 500_000);
    assert_eq!(bench.gateway.station_config(3), Some(StationConfig::classic(250_000)));
    bench.apply_channel(3, McanChannelConfig::classic(1_000_000));
    assert_eq!(flash(&mut bench, 3, LOAD), 0);
    assert_eq!(bench.gateway.station_config(3), Some(StationConfig::classic(250_000)));
    // another one is added, the first stays
    bench.apply_channel(0, McanChannelConfig::classic(125_000));
    assert_eq!(flash(&mut bench, 0, SAVE), 0);
    assert_eq!(flash(&mut bench, 3, FACTORY), 0);
    assert_eq!(bench.upload(0x8004, 19), 500_000);
    power_cycle(&mut bench);
    assert_eq!(bench.gateway.station_config(0), Some(StationConfig::classic(125_000)));
    assert_eq!(bench.gateway.station_config(3), None);
}

#[test]
fn a_channel_that_cannot_be_built_is_not_saved() {
    let mut bench = Fixture::preop();
    bench.download(0x8001, 19, &0u32.to_le_bytes()).unwrap();
    assert_eq!(flash(&mut bench, 0, SAVE), 3);
    bench.download(0x8001, 19, &500_000u32.to_le_bytes()).unwrap();
    bench.write_u8(0x8001, 62, 64);
    bench.write_u8(0x8001, 64, 64);
    bench.write_u8(0x8001, 67, 64);
    assert_eq!(flash(&mut bench, 0, SAVE), 4);
    assert_eq!(bench.upload(0xB000, 8), 0);
}

#[test]
fn channel_flash_commands_fail_in_op() {
    let mut bench = Fixture::op(chunks(1), chunks(1));
    bench.gateway.set_watchdog_ns(0);
    for bits in [SAVE, LOAD, FACTORY] {
        assert_eq!(flash(&mut bench, 0, bits), 1);
    }
}

#[test]
fn the_crc_covers_what_is_saved_and_nothing_else() {
    let mut judged = 0;
    for object in objects() {
        for instance in 0..object.count {
            let index = object.first + instance * object.stride;
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
                let mut bench = Fixture::preop();
                let before = bench.upload(0xB000, 7);
                let candidates = [entry.max, entry.max.saturating_sub(1), entry.min, entry.min + 1];
                let other = candidates
                    .into_iter()
                    .find(|&value| entry.default != Some(value) && entry.accepts(value));
                // reserved, but for its default
                let Some(value) = other else { continue };
                let bytes = value.to_le_bytes();
                let size = entry.ty.size_bytes().unwrap();
                if bench.download(index, entry.subindex, &bytes[..size]).is_err() {
                    continue;
                }
                judged += 1;
                let changed = bench.upload(0xB000, 7) != before;
                let name = format!("{index:04X}:{} = {value}", entry.subindex);
                assert_eq!(changed, saved_object && !window && !command, "{name}");
            }
        }
    }
    assert!(judged > 300, "{judged}");
}
