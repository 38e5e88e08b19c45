//! States of the gateway on the way to OP.

use crate::probe::experiment::Experiment;
use crate::probe::interruption::{Interruption, Result};
use crate::probe::outcome::Outcome;
use crate::probe::run::Probe;
use crate::probe::setup::Setup;
use crate::probe::stage::Stage;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["S4"],
        key: "apply_at_safeop",
        stage: Stage::Op,
        assumption: "SAFEOP applies a requested profile that was never applied",
        run: apply_at_safeop,
    },
    Experiment {
        rows: &["H41"],
        key: "assignment_rewritten",
        stage: Stage::Op,
        assumption: "a profile stays valid when the master writes its PDO assignment again",
        run: assignment_rewritten,
    },
    Experiment {
        rows: &["S7"],
        key: "safeop_inputs",
        stage: Stage::Op,
        assumption: "the gateway publishes TxPDO images in SAFEOP",
        run: safeop_inputs,
    },
    Experiment {
        rows: &["H8", "S7"],
        key: "safeop_outputs",
        stage: Stage::Op,
        assumption: "the gateway empties SM2 in SAFEOP",
        run: safeop_outputs,
    },
];

fn assignment_rewritten(probe: &mut Probe) -> Result<Outcome> {
    let statuses = match probe.session(&Setup::plain()) {
        Ok(session) => [session.read(0x8010, 2)?, session.read(0x8011, 2)?],
        Err(Interruption::NotInOp { reason, .. }) => return not_in_op(probe, &reason),
        Err(other) => return Err(other),
    };
    let [tx, rx] = statuses;
    let detail = format!("OP reached; 0x8010:02 is {tx}, 0x8011:02 is {rx}");
    Ok(match statuses {
        [0, 0] => Outcome::holds(detail),
        [5, 5] => Outcome::differs(detail).like("status_5"),
        _ => Outcome::differs(detail),
    })
}

/// The profile was applied before the master wrote the assignment again, and rejected then.
fn not_in_op(probe: &mut Probe, reason: &str) -> Result<Outcome> {
    probe.wait_preop()?;
    let detail = |status| format!("OP not reached, 0x8010:02 is {status} then: {reason}");
    Ok(match probe.sdo().read(0x8010, 2)? {
        5 => Outcome::differs(detail(5)).like("dropped_at_safeop"),
        status => Outcome::undecided(detail(status)),
    })
}

/// The first session after the restart, so that no profile is active.
fn apply_at_safeop(probe: &mut Probe) -> Result<Outcome> {
    let active = [probe.sdo().read(0x8010, 9)?, probe.sdo().read(0x8011, 9)?];
    if active != [0, 0] {
        return Ok(Outcome::undecided("a profile is active after a restart (Flash)"));
    }
    let setup = Setup { is_applied: false, ..Setup::plain() };
    match probe.session(&setup) {
        Ok(session) => {
            let bytes = [session.read(0x8010, 9)?, session.read(0x8011, 9)?];
            let detail =
                format!("OP reached without an apply command, with images of {bytes:?} bytes");
            Ok(Outcome::decided(bytes == [128, 128], detail))
        }
        Err(Interruption::NotInOp { reason, .. }) => {
            // The same with an apply command shows whether that is the cause.
            probe.session(&Setup::plain())?;
            let detail = format!("OP reached only after an apply command; without: {reason}");
            Ok(Outcome::differs(detail).like("required"))
        }
        Err(other) => Err(other),
    }
}

fn safeop_inputs(probe: &mut Probe) -> Result<Outcome> {
    let startup = probe.session(&Setup::plain())?.startup;
    if startup.cycles == 0 {
        return Ok(Outcome::undecided("no process data were exchanged before OP"));
    }
    let (missed, cycles) = (startup.inputs_missed, startup.cycles);
    let detail = format!("before OP {missed} of {cycles} cycles had no new TxPDO image");
    Ok(match missed * 2 > cycles {
        false => Outcome::holds(detail),
        true => Outcome::differs(detail).like("none"),
    })
}

fn safeop_outputs(probe: &mut Probe) -> Result<Outcome> {
    let startup = probe.session(&Setup::plain())?.startup;
    if startup.cycles == 0 {
        return Ok(Outcome::undecided("no process data were exchanged before OP"));
    }
    let (missed, cycles) = (startup.outputs_missed, startup.cycles);
    let detail = format!("before OP the gateway did not take {missed} of {cycles} RxPDO images");
    Ok(match missed * 2 > cycles {
        false => Outcome::holds(detail),
        true => Outcome::differs(detail).like("kept"),
    })
}
