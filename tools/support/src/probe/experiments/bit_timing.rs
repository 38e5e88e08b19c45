//! Bit timing that the firmware chooses.

use ecan_protocol::can::BitTiming;
use ecan_protocol::config::{BitTimingMode, McanChannelConfig, SamplePointWindow};

use crate::probe::experiment::Experiment;
use crate::probe::interruption::Result;
use crate::probe::outcome::Outcome;
use crate::probe::registers::{self, DBTP, NBTP, sample_point};
use crate::probe::run::Probe;
use crate::probe::stage::Stage;

use super::statuses::apply;

pub(super) const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        rows: &["H43"],
        key: "bit_timing",
        stage: Stage::PreOp,
        assumption: "the firmware chooses the sample point closest to the middle of the window",
        run: choice,
    },
    Experiment {
        rows: &["H10"],
        key: "manual_timing",
        stage: Stage::PreOp,
        assumption: "manual bit timing values are physical values, not register values",
        run: manual_values,
    },
];

/// Nominal and data sample point in 0.1 %.
fn points(probe: &Probe) -> Result<(u32, u32)> {
    let nominal = sample_point(registers::read(probe.sdo(), 0, NBTP)?, false);
    let data = sample_point(registers::read(probe.sdo(), 0, DBTP)?, true);
    Ok((nominal, data))
}

pub(super) fn percent(permille: u32) -> String {
    format!("{}.{} %", permille / 10, permille % 10)
}

fn choice(probe: &mut Probe) -> Result<Outcome> {
    let rates = McanChannelConfig { tdc: false, ..McanChannelConfig::fd(500_000, 2_000_000) };
    let window = SamplePointWindow::DEFAULT;
    let wide =
        McanChannelConfig { nominal_sample_point: window, data_sample_point: window, ..rates };
    match apply(probe, wide)? {
        0 => {}
        // no timing was found
        3 => return Ok(Outcome::differs("window 75 to 87.5 %: apply status 3")),
        status => return Ok(Outcome::undecided(format!("apply status {status}"))),
    }
    let (nominal, data) = points(probe)?;
    probe.profile.sample_point_permille = Some(nominal);
    let exact = apply(probe, rates.sample_point(875, 875))?;
    let detail = format!(
        "500 kbit/s and 2 Mbit/s, 75 to 87.5 %: sample points {} and {}; exactly 87.5 %: apply status {exact}",
        percent(nominal),
        percent(data)
    );
    let is_near = |found: u32, expected: u32| found.abs_diff(expected) <= 15;
    let outcome = Outcome::decided(is_near(nominal, 812) && exact == 0, detail);
    Ok(match exact {
        0 => like_choice(outcome, nominal),
        _ => outcome.like("driver"),
    })
}

/// Names the choice of a nominal sample point from 75 to 87.5 %, in 0.1 %.
pub(super) fn like_choice(outcome: Outcome, nominal: u32) -> Outcome {
    match nominal {
        ..765 => outcome.like("lowest"),
        860.. => outcome.like("highest"),
        _ => outcome,
    }
}

fn manual_values(probe: &mut Probe) -> Result<Outcome> {
    let timing = BitTiming { brp: 10, tseg1: 12, tseg2: 3, sjw: 2 };
    let config = McanChannelConfig {
        bit_timing_mode: BitTimingMode::Manual,
        manual_nominal: timing,
        ..McanChannelConfig::classic(500_000)
    };
    match apply(probe, config)? {
        0 => {}
        status => return Ok(Outcome::undecided(format!("apply status {status}"))),
    }
    let value = registers::read(probe.sdo(), 0, NBTP)?;
    let (brp, tseg1, tseg2) = (value >> 16 & 0x1FF, value >> 8 & 0xFF, value & 0x7F);
    let detail = format!(
        "written: prescaler 10, segments 12 and 3; register NBTP holds {brp}, {tseg1} and {tseg2}"
    );
    let found = (brp, tseg1, tseg2);
    let outcome = Outcome::decided(found == (9, 11, 2), detail);
    Ok(if found == (10, 12, 3) { outcome.like("register_values") } else { outcome })
}
