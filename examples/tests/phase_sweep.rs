//! A sweep finds the shifts and offsets that work, and recommends one (manual 15.6.1).

use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic, id, with_sync0};
use ecan_example_support::phase_sweep::{PhaseSweep, PhaseSweepError, sweep_phase};
use ecan_host::AdapterConfig;
use ecan_mcan_port::{GatewayConfig, Port, PortConfig, PortError};
use ecan_protocol::image::{OptionFlags, Schedule};

/// One cycle with one scheduled frame.
fn cycle(port: &mut Port, offset_ns: u32) -> Result<(), PhaseSweepError> {
    let mut cycle = port.begin_cycle();
    cycle.received().for_each(drop);
    let at = Schedule { tag: 0, offset_ns };
    // The account contains rejected frames.
    let _ = cycle.schedule_can(0, 0, id(1), &[], at);
    cycle.end().map_err(PortError::from)?;
    Ok(())
}

fn results(gateway: &mut GatewayConfig) {
    gateway.tx_options = OptionFlags::TX_RESULT;
}

#[test]
fn recommended_point_holds_in_a_longer_run() {
    let mut fixture = with_sync0(ecan_sim::jitter(1), 250_000, results);
    let sweep = PhaseSweep {
        shifts_ns: (0..10).map(|nth| nth * 100_000).collect(),
        offsets_ns: vec![0, 50_000, 100_000, 150_000],
        cycles: 400,
    };
    let mut seen = 0;
    let table = sweep_phase(&mut fixture.port, &sweep, cycle, |_| seen += 1).unwrap();
    assert_eq!((seen, table.points.len()), (40, 40));
    assert!(fixture.port.is_ready());
    assert_eq!(fixture.port.adapter().config().dc.unwrap().shift_ns(), 250_000, "as it was");
    for point in &table.points {
        assert!(point.failure.is_none(), "{table}");
        // Half of the images come within 15 us and arrive 70 us later, so these pulses miss some.
        if [100_000, 200_000].contains(&point.shift_ns) {
            assert!(!table.is_good(point), "{table}");
        }
    }
    let best = table.recommended().expect("some point is good").clone();
    let margins = table.margins(&best).unwrap();
    assert!(margins.shift_below_ns >= 100_000 && margins.shift_above_ns >= 100_000, "{table}");

    let mut adapter = *fixture.port.adapter().config();
    adapter.dc = Some(ecan_host::DcSync::new(
        Duration::from_millis(1),
        Duration::from_nanos(best.shift_ns.into()),
    ));
    let config = *fixture.port.config();
    fixture.port.reconfigure((adapter, config)).unwrap();
    fixture.port.wait_ready().unwrap();
    let before = fixture.simulation.with_world(|world| world.counters(0).unwrap());
    for _ in 0..5_000 {
        fixture.port.wait_next_cycle();
        cycle(&mut fixture.port, best.offset_ns).unwrap();
    }
    fixture.idle(500);
    let counters = fixture.simulation.with_world(|world| world.counters(0).unwrap());
    let account = fixture.port.schedule_account(fixture.port.ch(0, 0));
    assert_eq!((account.scheduled, account.rejected_late), (5_000, 0), "{table}");
    assert_eq!((account.sent, counters.frames_released - before.frames_released), (5_000, 5_000));
}

#[test]
fn slow_firmware_needs_an_offset() {
    let mut scenario = ecan_sim::echo(1);
    scenario.gateways[0].config.service_delay_ns = 250_000;
    let mut fixture = with_sync0(scenario, 100_000, results);
    let sweep = PhaseSweep {
        shifts_ns: vec![200_000],
        offsets_ns: vec![0, 30_000, 100_000, 200_000],
        cycles: 50,
    };
    let table = sweep_phase(&mut fixture.port, &sweep, cycle, |_| ()).unwrap();
    let good: Vec<_> = table.points.iter().map(|point| table.is_good(point)).collect();
    assert_eq!(good, [false, false, true, true], "{table}");
    assert_eq!((table.points[0].accepted, table.points[0].flags), (0, 1 << 6), "{table}");
    assert_ne!(table.points[0].flags, 0);
    assert_eq!(table.recommended().unwrap().offset_ns, 100_000);
    // 74 us on the wire with the clocks.
    assert_eq!(table.points[0].arrival_before_pulse_ns.unwrap() / 1_000, 126);
}

#[test]
fn sweep_without_sync0_returns_error() {
    let adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
    let config = PortConfig::uniform(1, GatewayConfig::on_channel(0, classic()));
    let mut fixture = Fixture::ready(ecan_sim::echo(1), adapter, config);
    let rejected = sweep_phase(&mut fixture.port, &PhaseSweep::over(1_000_000), cycle, |_| ());
    assert!(matches!(rejected, Err(PhaseSweepError::NoSync0)));
    assert!(fixture.port.is_ready(), "nothing was touched");
}

#[test]
fn candidates_beyond_the_period_return_error() {
    let mut fixture = with_sync0(ecan_sim::echo(1), 250_000, results);
    let over = PhaseSweep::over(1_000_000);
    let sync0_ns = 1_000_000;
    for (sweep, fault) in [
        (
            PhaseSweep { offsets_ns: vec![0, 2_000_000], ..over.clone() },
            PhaseSweepError::Beyond { value: "offset", ns: 2_000_000, sync0_ns },
        ),
        (
            PhaseSweep { shifts_ns: vec![1_000_000], ..over.clone() },
            PhaseSweepError::Beyond { value: "shift", ns: 1_000_000, sync0_ns },
        ),
        (PhaseSweep { cycles: 0, ..over }, PhaseSweepError::NoCycles),
    ] {
        match sweep_phase(&mut fixture.port, &sweep, cycle, |_| ()) {
            Err(error) => assert_eq!(error.to_string(), fault.to_string()),
            other => panic!("{other:?}"),
        }
        assert!(fixture.port.is_ready(), "nothing was touched");
    }
}

/// A channel that is bus-off, or an application that schedules nothing, proves no phase good.
#[test]
fn point_without_frames_is_not_good() {
    let sweep = PhaseSweep { shifts_ns: vec![500_000], offsets_ns: vec![100_000], cycles: 50 };
    for is_silent in [true, false] {
        let mut fixture = with_sync0(ecan_sim::echo(1), 250_000, results);
        let simulation = fixture.simulation.clone();
        let table = sweep_phase(
            &mut fixture.port,
            &sweep,
            |port, offset_ns| {
                let fault = ecan_sim::Fault::BusOff { gateway: 0, channel: 0 };
                simulation.inject(fault);
                if !is_silent {
                    return cycle(port, offset_ns);
                }
                port.begin_cycle().end().map_err(PortError::from)?;
                Ok(())
            },
            |_| (),
        );
        let table = table.unwrap();
        assert!(table.recommended().is_none(), "{table}");
    }
    let mut fixture = with_sync0(ecan_sim::echo(1), 250_000, results);
    let table = sweep_phase(&mut fixture.port, &sweep, cycle, |_| ()).unwrap();
    let point = table.recommended().expect("good");
    assert_eq!((point.scheduled, point.accepted, point.short_gateways), (50, 50, 0), "{table}");
}

#[test]
fn error_of_the_application_restores_the_port() {
    let mut fixture = with_sync0(ecan_sim::echo(1), 250_000, results);
    let mut cycles = 0;
    let ended = sweep_phase(
        &mut fixture.port,
        &PhaseSweep::over(1_000_000),
        |port, offset_ns| {
            cycles += 1;
            cycle(port, offset_ns)?;
            if cycles < 100 { Ok(()) } else { Err(PhaseSweepError::NoSync0) }
        },
        |_| (),
    );
    assert!(ended.is_err());
    assert!(fixture.port.is_ready());
    assert_eq!(fixture.port.adapter().config().dc.unwrap().shift_ns(), 250_000);
}
