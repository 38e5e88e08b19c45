//! Assumptions for which no experiment exists.

use crate::finding::Finding;
use crate::outcome::Verdict;

/// Assumption about the device that the probe cannot decide.
#[derive(Clone, Copy, Debug)]
pub struct Undecidable {
    /// Rows of docs/ASSUMPTIONS.md.
    pub rows: &'static [&'static str],
    /// Switch of the simulator; empty without one.
    pub key: &'static str,
    /// The assumption.
    pub assumption: &'static str,
    /// Reason.
    pub reason: &'static str,
}

impl Undecidable {
    pub(crate) fn finding(&self) -> Finding {
        let Self { rows, key, assumption, reason } = *self;
        let verdict = Verdict::Undecided;
        let detail = reason.to_owned();
        Finding { rows, key, stage: None, assumption, verdict, detail, alternative: None }
    }
}

const fn undecidable(
    rows: &'static [&'static str],
    key: &'static str,
    assumption: &'static str,
    reason: &'static str,
) -> Undecidable {
    Undecidable { rows, key, assumption, reason }
}

/// Every assumption without an experiment.
pub const UNDECIDABLE: &[Undecidable] = &[
    undecidable(
        &["S27"],
        "complete_access",
        "SDO Complete Access is not supported",
        "the SDK makes no SDO transfers with Complete Access",
    ),
    undecidable(
        &["S42"],
        "emergencies",
        "CoE emergencies report bus-off and AL errors",
        "the SDK does not read CoE emergencies",
    ),
    undecidable(
        &["S50"],
        "publishes_after_read",
        "a TxPDO image that finds SM3 full is published by the next service",
        "the master does not let a program choose the distance between LWR and LRD",
    ),
];
