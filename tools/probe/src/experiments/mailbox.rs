//! Mailbox services.

use std::time::Duration;

use crate::experiment::Experiment;
use crate::interruption::Result;
use crate::outcome::Outcome;
use crate::probe::Probe;
use crate::setup::Setup;
use crate::stage::Stage;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["S41"],
        key: "sdo_information",
        stage: Stage::PreOp,
        assumption: "SDO information describes the object dictionary",
        run: sdo_information,
    },
    Experiment {
        rows: &["S23", "S38"],
        key: "mailbox_delay_us",
        stage: Stage::Op,
        assumption: "an SDO response is ready within 2 ms",
        run: delay,
    },
];

/// Time after PREOP in which a master has fetched the dictionary, in ns.
const FETCH_NS: u64 = 8_000_000_000;
const POLL_NS: u64 = 200_000_000;

fn sdo_information(probe: &mut Probe) -> Result<Outcome> {
    let end_ns = probe.clock().now_ns().saturating_add(FETCH_NS);
    loop {
        let count = probe.diagnostics.slave_info(probe.slave)?.sdo_count;
        if count > 0 {
            return Ok(Outcome::holds(format!("the master found {count} objects")));
        }
        if probe.clock().now_ns() >= end_ns {
            let detail = "the master found no object within 8 s after PREOP";
            return Ok(Outcome::differs(detail).like("none"));
        }
        probe.sleep_ns(POLL_NS);
    }
}

const CYCLE_NS: u64 = 1_000_000;
const GAP_NS: u64 = 200_000;
/// Cycles of a transfer without the delay of the gateway: request, check, fetch.
const TRANSFER_CYCLES: u64 = 3;
const LONGEST_NS: u64 = 2_500_000;

fn delay(probe: &mut Probe) -> Result<Outcome> {
    let setup = Setup { cycle: Duration::from_nanos(CYCLE_NS), ..Setup::plain() };
    let mut shortest = u64::MAX;
    let session = probe.session(&setup)?;
    // Some masters advance only if receive and send are apart.
    session.gap_ns = GAP_NS;
    for _ in 0..8 {
        let start = session.adapter.clock().now_ns();
        session.read(0x8010, 3)?;
        shortest = shortest.min(session.adapter.clock().now_ns() - start);
    }
    let delay_ns = shortest.saturating_sub(TRANSFER_CYCLES * CYCLE_NS);
    let us = delay_ns / 1_000;
    probe.profile.mailbox_us = u32::try_from(us).ok();
    let detail = format!(
        "the fastest of 8 SDO uploads in OP took {} us, of which {TRANSFER_CYCLES} cycles of 1 ms are the \
         master's",
        shortest / 1_000
    );
    Ok(Outcome::decided(delay_ns <= LONGEST_NS, detail).like(us))
}
