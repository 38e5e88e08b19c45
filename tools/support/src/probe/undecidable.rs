//! Assumptions for which no experiment exists.

use crate::probe::finding::Finding;
use crate::probe::outcome::Verdict;

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
        &["S50"],
        "publishes_after_read",
        "a TxPDO image that finds SM3 full is published by the next service",
        "the master does not let a program choose the distance between LWR and LRD",
    ),
    undecidable(
        &["H27", "S43"],
        "",
        "which other maintenance commands need engineering or factory mode",
        "a command that is accepted against the assumption would write the Flash",
    ),
    undecidable(
        &["H28", "S47", "S48"],
        "",
        "format of firmware packages, FoE error numbers and texts",
        "needs a firmware file and writes the Flash",
    ),
    undecidable(
        &["H31"],
        "rotation_direction",
        "the connector of a channel is (channel + rotation) mod 4",
        "shows only at the connectors",
    ),
    undecidable(
        &["H32"],
        "",
        "only a restart takes a channel off its bus or deactivates a profile",
        "the manual names no command that could be tried",
    ),
    undecidable(
        &["H45"],
        "",
        "no TX_RESULT of a channel that the TxPDO does not carry",
        "the experiments use the same channels in both directions",
    ),
    undecidable(
        &["S13"],
        "",
        "the balanced budget reserves 16 bytes per channel and lends what is unused",
        "no experiment fills an image from several channels",
    ),
    undecidable(
        &["S16"],
        "bus_off_wait",
        "automatic bus-off recovery waits for the backoff base cycles",
        "needs a bus-off, which the probe does not cause",
    ),
    undecidable(
        &["S18"],
        "",
        "bits of 0x9000:12, 0x902x:15 and :16, 0x8030:09",
        "the events are not caused by the probe",
    ),
    undecidable(
        &["S21"],
        "",
        "AL status 0x2D after 2 s without a Sync0 pulse",
        "the master does not let a program stop Sync0",
    ),
    undecidable(
        &["S31"],
        "",
        "control of the slave's clock",
        "the master corrects the clock in each cycle",
    ),
    undecidable(
        &["S35"],
        "",
        "contents of the SII",
        "the library does not return them; `ecan doctor` reads them with IgH's tool",
    ),
    undecidable(
        &["S36"],
        "",
        "a frame needs 600 ns from one slave to the next",
        "needs a second slave with distributed clocks",
    ),
    undecidable(
        &["S39", "S54"],
        "",
        "mailbox errors, and eight waiting responses",
        "the library sends no faulty mailbox requests",
    ),
    undecidable(
        &["S40"],
        "",
        "blocks of Complete Access",
        "no experiment compares blocks of an object with its entries",
    ),
    undecidable(&["S45", "S46"], "", "Flash times, saved values", "would write the Flash"),
    undecidable(
        &["S51"],
        "",
        "AL status 0x16 for wrong mailboxes",
        "the master writes the sync managers of the mailboxes",
    ),
    undecidable(
        &["S56"],
        "",
        "AL status 0x1D or 0x1E for wrong sync managers of the process data",
        "the master writes the sync managers from the SII, which the probe does not change",
    ),
    undecidable(
        &["S53"],
        "",
        "SDO information of missing subindices",
        "the library returns only the number of objects",
    ),
];
