//! What tests of scheduled transmission share: frames at a phase, and the account against the truth.
#![allow(dead_code, missing_docs)]

use std::time::Duration;

use ecan_mcan_port::{GatewayConfig, ScheduleAccount};
use ecan_protocol::image::{OptionFlags, Schedule};
use ecan_sim::{GatewayCounters, Scenario, echo};

use super::common::{Fixture, Handles, SendData, id, with_sync0};

/// Phases at which frames leave, 500 us behind the start of the cycle: the images come long before.
pub const SHIFT_NS: u32 = 500_000;
pub const OFFSET_NS: u32 = 100_000;

pub fn results(gateway: &mut GatewayConfig) {
    gateway.tx_options = OptionFlags::TX_RESULT;
}

pub fn counters(fixture: &Fixture) -> GatewayCounters {
    fixture.simulation.with_world(|world| world.counters(0).unwrap())
}

pub fn account(fixture: &Fixture) -> ScheduleAccount {
    fixture.port.schedule_account(fixture.port.ch(0, 0))
}

/// One cycle that schedules so many frames; gives how many were taken.
pub fn schedule(fixture: &mut Fixture, frames: u16, offset_ns: u32) -> u16 {
    let mut taken = 0;
    fixture.cycle(|cycle| {
        for tag in 0..frames {
            let at = Schedule { tag, offset_ns };
            taken += u16::from(cycle.schedule_can(0, 0, id(0x100 + tag), &[], at).is_ok());
        }
    });
    taken
}

/// Compares the account with the truth once nothing is open any more: each kind of outcome may
/// hide among the unknown ones, none may be claimed that did not happen.
pub fn check(fixture: &mut Fixture) -> (ScheduleAccount, GatewayCounters) {
    fixture.idle(500);
    let (frames, counters) = (account(fixture), counters(fixture));
    let results = frames.sent + frames.queue_full + frames.not_sent;
    let accounted = results + frames.withdrawn + frames.unknown + frames.open;
    assert_eq!(accounted, frames.scheduled, "{frames:?}");
    assert_eq!(frames.open, 0, "{frames:?}");
    let losses = counters.transmit_losses;
    // Code 2, bus busy, is not sent, too.
    let rejected = losses.bus_off + losses.invalid_channel;
    for (results, happened) in [
        (frames.sent, counters.frames_released),
        (frames.queue_full, losses.schedule_full),
        (frames.not_sent, rejected + losses.late),
    ] {
        assert!(results <= happened, "{frames:?} {counters:?}");
        assert!(happened <= results + frames.unknown, "{frames:?} {counters:?}");
    }
    // Stale are frames that still waited, and those that the controller had got already.
    let ended = counters.frames_released + losses.late + losses.schedule_full + rejected;
    let ended = ended + losses.schedule_failed;
    assert!(ended <= counters.frames_parsed, "{counters:?}");
    assert!(
        counters.frames_parsed <= ended + losses.stale,
        "every frame ended somehow: {counters:?}"
    );
    assert!(
        frames.scheduled - frames.withdrawn >= counters.frames_parsed,
        "{frames:?} {counters:?}"
    );
    (frames, counters)
}

/// A machine that now and then wakes up behind the pulse.
pub fn sluggish() -> Scenario {
    let mut scenario = ecan_sim::jitter(1);
    let wake_up =
        ecan_sim::WakeUpDelay { typical_ns: 20_000, p99_ns: 400_000, longest_ns: 900_000 };
    scenario.wake_up = Some(wake_up);
    scenario
}

/// Sync0 of 4 ms with cycles of 1 ms: one cycle in four has a pulse.
pub fn with_long_sync0(shift_ns: u32, change: fn(&mut GatewayConfig)) -> Fixture {
    let mut fixture = with_sync0(echo(1), SHIFT_NS, change);
    let mut adapter = *fixture.port.adapter().config();
    adapter.dc = Some(ecan_host::DcSync::new(
        Duration::from_millis(4),
        Duration::from_nanos(shift_ns.into()),
    ));
    let config = *fixture.port.config();
    fixture.port.reconfigure((adapter, config)).unwrap();
    fixture.port.wait_ready().unwrap();
    fixture
}
