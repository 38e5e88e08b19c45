//! The stable points of manual 15.6.1 and the usable shifts of the simulator: the table of
//! docs/PERFORMANCE.md, which `scripts/regenerate-sync0.sh` writes.

use std::fmt;
use std::time::Duration;

use crate::common::{Fixture, Handles, SendData, classic, id};
use ecan_example_support::phase_sweep::{PhaseSweep, PhaseSweepError, sweep_phase};
use ecan_example_support::shift_windows::ShiftWindows;
use ecan_host::{AdapterConfig, DcSync, OutputArrivals, Plan};
use ecan_mcan_port::{GatewayConfig, Port, PortConfig, PortError};
use ecan_protocol::image::{OptionFlags, Schedule};
use ecan_protocol::mapping::CHUNK_BYTES;

const DOCUMENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/PERFORMANCE.md");
const BEGIN: &str = "<!-- begin of the generated table -->\n";
const END: &str = "<!-- end of the generated table -->\n";
/// The test writes the table if this environment variable is set.
const WRITE: &str = "WRITE_SYNC0_TABLE";
const GATEWAYS: usize = 3;
/// Distance of the tested shifts, in microseconds; the points of the manual come in addition.
const STEP_US: u32 = 50;

fn adapter(cycle_ms: u32, multiplier: u8) -> AdapterConfig {
    AdapterConfig::new(GATEWAYS as u16)
        .with_multiplier(multiplier)
        .with_cycle(Duration::from_millis(cycle_ms.into()))
}

fn ready(adapter: AdapterConfig) -> Fixture {
    let mut gateway = GatewayConfig::on_channel(0, classic());
    gateway.tx_options = OptionFlags::TX_RESULT;
    let config = PortConfig::uniform(GATEWAYS, gateway);
    let mut scenario = ecan_sim::echo(GATEWAYS);
    for gateway in &mut scenario.gateways {
        // Missed outputs show in the working counter; the loss of OP would only take longer.
        gateway.config.sync0_window.missed_limit = 0;
    }
    Fixture::ready(scenario, adapter, config)
}

/// One cycle with a scheduled frame for each gateway.
fn cycle(port: &mut Port, offset_ns: u32) -> Result<(), PhaseSweepError> {
    let mut cycle = port.begin_cycle();
    cycle.received().for_each(drop);
    for slave in 0..GATEWAYS {
        // The account contains rejected frames.
        let _ = cycle.schedule_can(slave, 0, id(1), &[], Schedule { tag: 0, offset_ns });
    }
    cycle.end().map_err(PortError::from)?;
    Ok(())
}

/// Points of the manual for one configuration with Sync0, and the result of a sweep and of the plan.
struct Row {
    cycle_ms: u32,
    multiplier: u8,
    manual_us: &'static [u32],
    windows: ShiftWindows,
    arrivals: OutputArrivals,
}

impl Row {
    fn sweep(cycle_ms: u32, multiplier: u8, manual_us: &'static [u32]) -> Self {
        let mut adapter = adapter(cycle_ms, multiplier);
        adapter.dc = Some(DcSync::planned(adapter.cycle, &adapter));
        let arrivals = Plan::of(&adapter).output_arrivals().unwrap();
        let mut fixture = ready(adapter);
        let mut shifts_us: Vec<u32> = (0..cycle_ms * 1_000).step_by(STEP_US as usize).collect();
        shifts_us.extend(manual_us);
        shifts_us.sort_unstable();
        shifts_us.dedup();
        let sweep = PhaseSweep {
            shifts_ns: shifts_us.iter().map(|us| us * 1_000).collect(),
            offsets_ns: vec![100_000],
            cycles: 60,
        };
        let table = sweep_phase(&mut fixture.port, &sweep, cycle, |_| ()).unwrap();
        let pdo_bytes = usize::from(multiplier) * CHUNK_BYTES;
        let windows = ShiftWindows::new(&table, pdo_bytes, arrivals.usable_shifts_ns());
        Self { cycle_ms, multiplier, manual_us, windows, arrivals }
    }

    fn is_usable(&self, us: u32) -> bool {
        self.windows.shifts.contains(&(us * 1_000, true))
    }

    fn differences(&self) -> String {
        let mut found = Vec::new();
        for &us in self.manual_us {
            let margin_ns = self.arrivals.margin_ns(us * 1_000);
            if !self.is_usable(us) {
                found.push(format!("{us} us is not usable in the simulator"));
            }
            if margin_ns < 0 {
                found.push(format!(
                    "the plan warns of {us} us, by {:.1} us",
                    -margin_ns as f64 / 1e3
                ));
            }
        }
        let listed = |ns: u32| self.manual_us.contains(&(ns / 1_000));
        let others = self.windows.shifts.iter().filter(|(ns, usable)| *usable && !listed(*ns));
        let tested = self.windows.shifts.len();
        found.push(format!(
            "{} more of {tested} tested shifts are usable in the simulator",
            others.count()
        ));
        found.join("; ")
    }
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let manual: Vec<String> = self.manual_us.iter().map(|us| format!("{us} us")).collect();
        let (first, last) = self.arrivals.usable_shifts_ns().unwrap();
        writeln!(
            f,
            "| DC Sync0 | {} ms | {}B | {} | {} | {} to {} us | {} |",
            self.cycle_ms,
            usize::from(self.multiplier) * CHUNK_BYTES,
            manual.join(", "),
            self.windows.text(),
            first / 1_000,
            last / 1_000,
            self.differences()
        )
    }
}

/// Row of configurations without Sync0, which the manual lists as stable.
fn free_row(cycle_ms: u32, multipliers: &[u8]) -> String {
    let mut bytes = Vec::new();
    for &multiplier in multipliers {
        let mut fixture = ready(adapter(cycle_ms, multiplier));
        let incomplete = |fixture: &Fixture| -> u64 {
            let of = |slave| fixture.port.statistics(fixture.port.gw(slave)).incomplete_cycles;
            (0..GATEWAYS).map(of).sum()
        };
        let before = incomplete(&fixture);
        fixture.idle(500);
        assert_eq!(incomplete(&fixture), before, "N = {multiplier}");
        bytes.push(format!("{}B", usize::from(multiplier) * CHUNK_BYTES));
    }
    let bytes = bytes.join(" / ");
    format!("| SM/free | {cycle_ms} ms | {bytes} | without shift | runs | - | nothing |\n")
}

/// The table with the rows of the manual in their order.
fn table() -> String {
    let mut text =
        "| mode | cycle | PDO | stable points of the manual | usable in the simulator | usable by \
                    the plan | what differs |\n| --- | --- | --- | --- | --- | --- | --- |\n"
            .to_owned();
    text += &free_row(1, &[3, 4, 5]);
    text += &free_row(2, &[6, 10]);
    for (cycle_ms, multiplier, manual_us) in [
        (1, 3, &[700, 800][..]),
        (1, 4, &[0]),
        (1, 5, &[450, 650, 800]),
        (2, 6, &[600]),
        (2, 10, &[1600]),
    ] {
        let row = Row::sweep(cycle_ms, multiplier, manual_us);
        for &us in manual_us {
            assert!(row.is_usable(us), "N = {multiplier}, {us} us: {}", row.windows.text());
        }
        text += &row.to_string();
    }
    text
}

#[test]
fn stable_points_of_the_manual_are_usable_and_documented() {
    let table = table();
    let document = std::fs::read_to_string(DOCUMENT).unwrap();
    let (before, rest) = document.split_once(BEGIN).unwrap();
    let (written, after) = rest.split_once(END).unwrap();
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(DOCUMENT, format!("{before}{BEGIN}{table}{END}{after}")).unwrap();
        return;
    }
    assert_eq!(written, table, "run scripts/regenerate-sync0.sh");
}
