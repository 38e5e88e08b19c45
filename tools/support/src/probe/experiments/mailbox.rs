//! Mailbox services.

use std::time::Duration;

use ecan_host::Error;
use ecan_protocol::mapping::{Direction, MAX_MULTIPLIER, assignment_index};
use ecan_protocol::object::AbortCode;

use crate::probe::experiment::Experiment;
use crate::probe::interruption::Result;
use crate::probe::outcome::Outcome;
use crate::probe::run::Probe;
use crate::probe::setup::Setup;
use crate::probe::stage::Stage;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["S41"],
        key: "sdo_information",
        stage: Stage::PreOp,
        assumption: "SDO information describes the object dictionary",
        run: sdo_information,
    },
    Experiment {
        rows: &["S27"],
        key: "complete_access",
        stage: Stage::PreOp,
        assumption: "SDO Complete Access is not supported",
        run: complete_access,
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

/// Writes the PDO assignment as it is; each session writes it again.
fn complete_access(probe: &mut Probe) -> Result<Outcome> {
    let index = assignment_index(Direction::RxPdo);
    let count = probe.sdo().read(index, 0)?;
    let mut block = count.to_le_bytes()[..2].to_vec();
    for nth in 1..=count.min(u32::from(MAX_MULTIPLIER)) {
        let pdo = probe.sdo().read(index, nth as u8)?;
        block.extend(&pdo.to_le_bytes()[..2]);
    }
    let written = probe.diagnostics.sdo_download_complete(probe.slave, index, &block);
    Ok(match written {
        Ok(()) => Outcome::differs("a download of 0x1C12 succeeded").like("true"),
        Err(Error::Sdo { abort_code: Some(AbortCode::UNSUPPORTED_ACCESS), .. }) => {
            Outcome::holds("a download of 0x1C12 aborts with 0x06010000")
        }
        Err(Error::Sdo { abort_code: Some(code), .. }) => {
            Outcome::undecided(format!("a download of 0x1C12 aborts with {code}"))
        }
        Err(error) => return Err(error.into()),
    })
}

/// Cycles with which the transfers are measured, in ms.
const CYCLES_MS: [u64; 2] = [1, 3];
const GAP_NS: u64 = 200_000;
const LONGEST_US: u64 = 2_500;
/// Time of a transfer that a master in the kernel may spend on waiting for timer ticks: three, of 10 ms at
/// most. IgH 1.6.2 needs three of 4 ms on a usual kernel.
const TICKS_US: u64 = 30_000;

/// A transfer has steps of the master, one or more cycles each, and the time of the gateway.
fn delay(probe: &mut Probe) -> Result<Outcome> {
    let [short_ms, long_ms] = CYCLES_MS;
    let short_us = shortest_upload_us(probe, short_ms)?;
    let long_us = shortest_upload_us(probe, long_ms)?;
    let cycles_us = long_us.saturating_sub(short_us) * short_ms / (long_ms - short_ms);
    let ticks_us = if probe.ecrt.is_simulated() { 0 } else { TICKS_US };
    let most_us = short_us.saturating_sub(cycles_us);
    let least_us = most_us.saturating_sub(ticks_us);
    probe.profile.mailbox_us = u32::try_from(most_us).ok();
    let detail = format!(
        "the fastest of 8 SDO uploads took {short_us} us with a cycle of {short_ms} ms and {long_us} us with \
         {long_ms} ms; {least_us} to {most_us} us of it are the gateway's"
    );
    Ok(if most_us <= LONGEST_US {
        Outcome::holds(detail).like(most_us)
    } else if least_us > LONGEST_US {
        Outcome::differs(detail).like(least_us)
    } else {
        Outcome::undecided(detail)
    })
}

fn shortest_upload_us(probe: &mut Probe, cycle_ms: u64) -> Result<u64> {
    let session =
        probe.session(&Setup { cycle: Duration::from_millis(cycle_ms), ..Setup::plain() })?;
    // Some masters advance only if receive and send are apart.
    session.gap_ns = GAP_NS;
    let mut shortest_ns = u64::MAX;
    for _ in 0..8 {
        let start_ns = session.adapter.clock().now_ns();
        session.read(0x8010, 3)?;
        shortest_ns = shortest_ns.min(session.adapter.clock().now_ns() - start_ns);
    }
    Ok(shortest_ns / 1_000)
}
