//! Gateways whose results or objects differ from what the account of scheduled frames assumes: frames stay
//! unknown for a stated reason, and what the reason proposes helps.

use crate::common::{Fixture, Handles, with_sync0};
use crate::schedule_support::{OFFSET_NS, SHIFT_NS, check, results, schedule};
use ecan_mcan_port::{GatewayConfig, ScheduleFault};
use ecan_protocol::image::OptionFlags;
use ecan_sim::variant::{GatewayVariant, TxResultCodes};
use ecan_sim::{Fault, GatewayFault, Scenario, echo};

fn gateway(variant: GatewayVariant) -> Scenario {
    let mut scenario = echo(1);
    scenario.gateways[0].config.variant = variant;
    scenario
}

fn stall(fixture: &mut Fixture) {
    let fault = GatewayFault::ServiceStall { ms: 2 };
    fixture.simulation.inject(Fault::Gateway { gateway: 0, fault });
}

/// 200 cycles with three frames each; in one of them the firmware is too late.
fn run_stalled(scenario: Scenario, change: fn(&mut GatewayConfig)) -> Fixture {
    let mut fixture = with_sync0(scenario, SHIFT_NS, change);
    for nth in 0..200 {
        if nth == 120 {
            stall(&mut fixture);
        }
        schedule(&mut fixture, 3, OFFSET_NS);
    }
    fixture
}

fn fault(fixture: &Fixture) -> Option<ScheduleFault> {
    fixture.port.schedule_fault(fixture.port.gw(0))
}

#[test]
fn other_result_codes_leave_frames_unknown_and_are_named() {
    for tx_result_codes in
        [TxResultCodes::Swapped, TxResultCodes::BothQueued, TxResultCodes::BothLate]
    {
        let variant = GatewayVariant { tx_result_codes, ..GatewayVariant::default() };
        let mut fixture = run_stalled(gateway(variant.clone()), results);
        let (frames, counters) = check(&mut fixture);
        assert!(counters.transmit_losses.late > 0 && frames.late_dropped == 0, "{frames:?}");
        // The late frames of code 1 are also explained by the frame whose image the stall rejected.
        let expected = match tx_result_codes {
            TxResultCodes::BothQueued => ScheduleFault::CodesUnverified,
            _ => ScheduleFault::CodesContradicted,
        };
        assert_eq!(fault(&fixture), Some(expected), "{tx_result_codes:?}");

        let mut fixture = run_stalled(gateway(variant), |_| ());
        let (frames, _) = check(&mut fixture);
        assert!(frames.sent > 300, "the flags alone decide: {frames:?}");
        assert_eq!(fault(&fixture), None);
    }
}

#[test]
fn late_flag_of_an_earlier_run_is_named_until_it_is_cleared() {
    let mut fixture = run_stalled(echo(1), |_| ());
    let adapter = *fixture.port.adapter().config();
    let mut config = *fixture.port.config();
    config.gateways[0].tx_options = OptionFlags::TX_RESULT;
    fixture.port.reconfigure((adapter, config)).unwrap();
    fixture.port.wait_ready().unwrap();
    for _ in 0..50 {
        schedule(&mut fixture, 1, OFFSET_NS);
    }
    fixture.idle(300);
    let account = crate::schedule_support::account(&fixture);
    assert_eq!((account.unknown, account.open), (50, 0), "{account:?}");
    assert_eq!(fault(&fixture), Some(ScheduleFault::CodesUnverified));

    fixture.port.clear_schedule_flags(fixture.port.gw(0));
    fixture.idle(300);
    for nth in 0..200 {
        if nth == 150 {
            stall(&mut fixture);
        }
        schedule(&mut fixture, 1, OFFSET_NS);
    }
    fixture.idle(300);
    let account = crate::schedule_support::account(&fixture);
    assert!(account.late_dropped > 0 && account.sent > 190 && account.open == 0, "{account:?}");
    assert_eq!(fault(&fixture), None);
}

#[test]
fn missing_diagnostics_end_frames_as_unknown() {
    let missing = Scenario::from_toml(
        "[[gateway]]\n[gateway.variant]\nmissing_entries = [\"0x9020\"]\n",
        "missing",
        std::path::Path::new("."),
    )
    .unwrap();
    for change in [results as fn(&mut GatewayConfig), |_| ()] {
        let mut fixture = run_stalled(missing.clone(), change);
        let (frames, _) = check(&mut fixture);
        assert_eq!((frames.sent, frames.open), (0, 0));
        assert_eq!(
            fault(&fixture),
            Some(ScheduleFault::Unreadable { index: 0x9020, subindex: 12 })
        );
    }
}
