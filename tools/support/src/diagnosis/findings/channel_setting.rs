//! Settings of a channel that lose frames without an error (manual 5.4.3, 5.4.6, 13.4, 16.3).

use ecan_protocol::can::tdc_active;
use ecan_protocol::config::{DataSize, NonMatch};

use super::channel::Channel;
use crate::diagnosis::finding::Finding;

/// Elements of the Message RAM that hold frames: entry of their data size, name, and number of the FIFO for
/// frames that no filter matches; without a number the channel always uses them.
const ELEMENTS: [(u8, &str, Option<NonMatch>); 3] = [
    (65, "RX FIFO0", Some(NonMatch::Fifo0)),
    (66, "RX FIFO1", Some(NonMatch::Fifo1)),
    (72, "the transmit FIFO", None),
];
const NON_MATCH: [u8; 2] = [36, 37];
const FILTER_COUNTS: [u8; 2] = [49, 55];

impl Channel<'_> {
    fn has_fd(&self) -> bool {
        self.config(15) == Some(1)
    }

    fn non_match(&self) -> [Option<NonMatch>; 2] {
        NON_MATCH.map(|entry| NonMatch::from_raw(u8::try_from(self.config(entry)?).ok()?))
    }

    /// CAN FD frames that are longer than the elements in which they are kept.
    pub(super) fn short_elements(&self) -> Option<Finding> {
        if !self.is_running() || !self.has_fd() {
            return None;
        }
        let non_match = self.non_match();
        let short = ELEMENTS.into_iter().filter_map(|(entry, name, fifo)| {
            let size = DataSize::from_raw(u8::try_from(self.config(entry)?).ok()?)?;
            let is_used = fifo.is_none() || non_match.contains(&fifo);
            let text = format!(
                "{name} {} bytes ({} = {})",
                size.bytes(),
                self.config_entry(entry),
                size.raw()
            );
            (is_used && size.bytes() < DataSize::B64.bytes()).then_some(text)
        });
        let short: Vec<_> = short.collect();
        if short.is_empty() {
            return None;
        }
        let what =
            format!("longer CAN FD frames are truncated: an element of {}", short.join(", of "));
        let apply = self.config_entry(1);
        self.warning("short-elements", what)
            .cause("the layout of the Message RAM is that of classic CAN")
            .next_step(
                format!("unless all frames are shorter, write data size 7 (64 bytes) and apply ({apply} = 1)"),
                "13.4, 5.4.3",
            )
    }

    /// Without a filter every frame is one that no filter matches.
    pub(super) fn rejects_all(&self) -> Option<Finding> {
        let rejects =
            |it: &Option<NonMatch>| matches!(it, Some(NonMatch::Reject | NonMatch::RejectToo));
        let has_filter = FILTER_COUNTS.iter().any(|entry| self.config(*entry) != Some(0));
        if !self.is_running() || has_filter || !self.non_match().iter().all(rejects) {
            return None;
        }
        let [standard, extended] = NON_MATCH.map(|entry| self.config_entry(entry));
        let apply = self.config_entry(1);
        self.warning(
            "rejects-all",
            "the channel receives nothing: it has no filter and rejects frames without a match",
        )
        .cause(format!(
            "{standard} and {extended} are 2 or 3 (reject), and no filter is configured"
        ))
        .cause("the filters were not saved, and are lost by a restart")
        .next_step(
            format!("add filters (`ecan filter`), or write 0 (FIFO0) and apply ({apply} = 1)"),
            "5.4.6, 13.4",
        )
    }

    /// Offset and filter of the delay compensation belong together.
    pub(super) fn unpaired_compensation(&self) -> Option<Finding> {
        let (offset, filter) = (self.config(33)?, self.config(34)?);
        let is_pair = (offset == 0) == (filter == 0);
        if !self.is_running() || !self.has_fd() || is_pair {
            return None;
        }
        let is_active = tdc_active(self.config(16)? != 0, self.config(20)?);
        // Errors of the data phase name it as their cause.
        let has_errors = self.bus_error().is_some_and(|finding| finding.id == "data-phase-error");
        if !is_active || has_errors {
            return None;
        }
        let (offset_entry, filter_entry) = (self.config_entry(33), self.config_entry(34));
        let what = format!(
            "TDC offset and filter are not a pair: {offset_entry} = {offset}, {filter_entry} = {filter}"
        );
        self.warning("tdc-unpaired", what)
            .cause("only one of the two was written; 0 is automatic")
            .next_step("write both, or 0 to both, and apply the channel", "13.4, 14.3, 16.3")
    }

    /// The firmware chooses a sample point of the range, which the peers may not have.
    pub(super) fn sample_point_range(&self) -> Option<Finding> {
        let range = |min: u8, max: u8| {
            let (low, high) = (self.config(min)?, self.config(max)?);
            (low != high).then_some((low, high))
        };
        let is_automatic = self.config(7).is_none_or(|mode| mode == 0);
        if !self.is_running() || !self.has_fd() || !is_automatic {
            return None;
        }
        let wide = [("nominal", range(21, 22)), ("data", range(23, 24))];
        let percent = |raw: u32| f64::from(raw) / 10.0;
        let text: Vec<_> = wide
            .into_iter()
            .filter_map(|(name, range)| {
                let (low, high) = range?;
                Some(format!("{name} {:.1} to {:.1} %", percent(low), percent(high)))
            })
            .collect();
        if text.is_empty() {
            return None;
        }
        let what = format!("the firmware chooses the sample point of CAN FD: {}", text.join(", "));
        self.warning("sample-point-range", what)
            .cause("the range of the defaults was kept; the timing may not match that of the peers")
            .next_step(
                format!(
                    "write the sample point of the peers as both bounds ({} to {}) and apply the channel",
                    self.config_entry(21),
                    self.config_entry(24)
                ),
                "5.4.3, 16.3",
            )
    }
}
