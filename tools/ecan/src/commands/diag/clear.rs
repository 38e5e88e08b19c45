//! Clearing of counters and flags after they were read.

use crate::bus::Bus;
use crate::failure::Failure;

const MAINTENANCE: u16 = 0xB000;
const COMMAND: u8 = 4;
const STATUS: u8 = 5;
const SEQUENCE: u8 = 12;
const CLEAR_DIAGNOSTICS: u32 = 1 << 5;
/// Looks until the maintenance command has ended.
const LOOKS: u32 = 100;
/// Between two looks, ns.
const PAUSE_NS: u64 = 10_000_000;

/// Clears PDO errors both ways, cycle statistics, and the runtime diagnostics with their flags.
pub(super) fn clear(bus: &Bus, slave: usize) -> Result<(), Failure> {
    for profile in [0x8010, 0x8011] {
        bus.write(slave, profile, 8, 0b10)?;
    }
    bus.write(slave, 0x9011, 14, 1)?;
    let before = bus.read(slave, MAINTENANCE, SEQUENCE)?;
    bus.write(slave, MAINTENANCE, COMMAND, CLEAR_DIAGNOSTICS)?;
    let clock = bus.ecrt().clock();
    for _ in 0..LOOKS {
        if bus.read(slave, MAINTENANCE, SEQUENCE)? != before {
            return match bus.read(slave, MAINTENANCE, STATUS)? {
                0 => Ok(()),
                status => Err(Failure::Refused(format!(
                    "the gateway did not clear its diagnostics, maintenance status {status}"
                ))),
            };
        }
        clock.sleep_until_ns(clock.now_ns().saturating_add(PAUSE_NS));
    }
    Err(Failure::Refused("the gateway did not end the command to clear its diagnostics".to_owned()))
}
