//! Values of a CAN channel in a snapshot, as its findings need them.

use ecan_protocol::image::{ChannelState, ChannelStatus};

use crate::diagnosis::finding::{Finding, Location};
use crate::diagnosis::registers::{ErrorCounters, ProtocolStatus};
use crate::diagnosis::snapshot::{ObjectKey, Snapshot};

/// A channel of a snapshot.
#[derive(Clone, Copy)]
pub(super) struct Channel<'a> {
    pub(super) snapshot: &'a Snapshot,
    pub(super) number: u8,
}

impl<'a> Channel<'a> {
    pub(super) fn of(snapshot: &'a Snapshot, number: u8) -> Self {
        Self { snapshot, number }
    }

    pub(super) fn information(&self, subindex: u8) -> Option<u32> {
        self.snapshot.get(0x9000 + u16::from(self.number), subindex)
    }

    /// Object 0x8001 to 0x8004 of the channel.
    pub(super) fn config_object(&self) -> u16 {
        0x8001 + u16::from(self.number)
    }

    pub(super) fn config(&self, subindex: u8) -> Option<u32> {
        self.snapshot.get(self.config_object(), subindex)
    }

    pub(super) fn config_entry(&self, subindex: u8) -> ObjectKey {
        ObjectKey { index: self.config_object(), subindex }
    }

    pub(super) fn data_path_entry(&self, subindex: u8) -> ObjectKey {
        ObjectKey { index: 0x8021 + u16::from(self.number), subindex }
    }

    pub(super) fn fault(&self, id: &'static str, what: impl Into<String>) -> Finding {
        Finding::fault(id, Location::Channel(self.number), what)
    }

    pub(super) fn warning(&self, id: &'static str, what: impl Into<String>) -> Finding {
        Finding::warning(id, Location::Channel(self.number), what)
    }

    pub(super) fn status(&self) -> Option<ChannelStatus> {
        Some(ChannelStatus::from_raw(self.information(9)? as u16))
    }

    pub(super) fn is_running(&self) -> bool {
        self.status().is_some_and(|status| {
            !matches!(status.state(), ChannelState::Disabled | ChannelState::Init)
        })
    }

    pub(super) fn counters(&self) -> ErrorCounters {
        ErrorCounters::from_raw(self.information(1).unwrap_or(0))
    }

    pub(super) fn protocol(&self) -> ProtocolStatus {
        // Default without a value: no change since the last read.
        ProtocolStatus::from_raw(self.information(2).unwrap_or(0x0707))
    }

    /// "500 kbit/s, sample point 75.0 to 87.5 %"
    pub(super) fn rates(&self) -> String {
        let text_of = |subindex, text: fn(u32) -> String| {
            self.snapshot.text_of(self.config_object(), subindex, text)
        };
        let rate = |subindex| text_of(subindex, |rate| format!("{} kbit/s", rate / 1000));
        let percent = |subindex| text_of(subindex, |raw| format!("{:.1}", f64::from(raw) / 10.0));
        let mut text = format!("{}, sample point {} to {} %", rate(19), percent(21), percent(22));
        if self.config(15) == Some(1) {
            text.push_str(&format!(
                ", data phase {}, {} to {} %",
                rate(20),
                percent(23),
                percent(24)
            ));
        }
        text
    }
}
