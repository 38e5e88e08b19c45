use ecan_protocol::device::AlStatusCode;
use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;
use ecan_protocol::object::lookup;
use ecan_tool_support::diagnosis::registers::{
    ErrorCounters, EventFifoStatus, HighPriorityStatus, Interrupts, ProtocolStatus,
    ReceiveFifoStatus, TransmitQueueStatus,
};
use ecan_tool_support::diagnosis::{Finding, Snapshot, findings, flag_names};
use serde::Serialize;

use super::bundle::Bundle;

/// Report of a gateway. A missing value is `None`, not zero.
#[derive(Debug, Serialize)]
pub(super) struct Report<'a> {
    pub(super) position: u16,
    pub(super) state: String,
    pub(super) has_error_flag: bool,
    pub(super) al_status: Option<String>,
    pub(super) directions: Vec<Direction>,
    pub(super) channels: Vec<Channel>,
    pub(super) performance: Vec<Measured>,
    pub(super) flags: Option<Vec<&'static str>>,
    pub(super) findings: Vec<Finding>,
    pub(super) bundle: &'a Bundle,
}

#[derive(Debug, Serialize)]
pub(super) struct Direction {
    pub(super) name: &'static str,
    pub(super) active_bytes: Option<u32>,
    pub(super) assigned_chunks: Option<u32>,
    pub(super) status: Option<u32>,
    pub(super) status_words: Option<&'static str>,
    pub(super) last_error: Option<u32>,
    pub(super) last_error_words: Option<&'static str>,
    pub(super) errors: Option<u32>,
    pub(super) overflows: Option<u32>,
}

#[derive(Debug, Serialize)]
pub(super) struct Channel {
    pub(super) channel: u8,
    pub(super) status: Option<u16>,
    pub(super) status_words: Option<String>,
    pub(super) error_counters: Option<ErrorCounters>,
    pub(super) protocol: Option<ProtocolStatus>,
    pub(super) interrupts: Option<Vec<&'static str>>,
    pub(super) fifo0: Option<ReceiveFifoStatus>,
    pub(super) fifo1: Option<ReceiveFifoStatus>,
    pub(super) transmit: Option<TransmitQueueStatus>,
    pub(super) events: Option<EventFifoStatus>,
    pub(super) high_priority: Option<HighPriorityStatus>,
    pub(super) rx_dropped: Option<u32>,
    pub(super) tx_backpressure: Option<u32>,
    pub(super) bus_off_count: Option<u32>,
    pub(super) cache_dropped: Option<u32>,
    pub(super) cache_watermark: Option<u32>,
    pub(super) tx_fifo_full: Option<u32>,
    pub(super) tx_stale: Option<u32>,
    pub(super) degraded: Option<u32>,
    pub(super) last_error: Option<u32>,
    /// The gateway rejected the upload of an entry.
    #[serde(skip)]
    has_rejected: bool,
}

/// Entry of 0x9011.
#[derive(Debug, Serialize)]
pub(super) struct Measured {
    pub(super) subindex: u8,
    pub(super) name: &'static str,
    pub(super) value: i64,
    /// Value in microseconds, if it counts CPU cycles.
    pub(super) us: Option<f64>,
}

impl Channel {
    /// The channel is disabled and was never used, by the values that were read.
    pub(super) fn is_quiet(&self) -> bool {
        let counts = [
            self.rx_dropped,
            self.tx_backpressure,
            self.bus_off_count,
            self.cache_dropped,
            self.tx_fifo_full,
            self.tx_stale,
            self.degraded,
            self.last_error,
        ];
        let state = self.status.map(|status| ChannelStatus::from_raw(status).state());
        state == Some(ChannelState::Disabled)
            && !self.has_rejected
            && counts.into_iter().flatten().all(|count| count == 0)
            && self.error_counters.is_none_or(|it| it == ErrorCounters::from_raw(0))
    }
}

impl<'a> Report<'a> {
    pub(super) fn new(bundle: &'a Bundle) -> Self {
        let snapshot = &bundle.snapshot;
        Self {
            position: snapshot.position,
            state: snapshot
                .state()
                .map_or_else(|| format!("state 0x{:02X}", snapshot.al_state), |it| it.to_string()),
            has_error_flag: snapshot.has_error_flag,
            al_status: snapshot.al_status_code.map(|code| AlStatusCode(code).to_string()),
            directions: [("TxPDO", 0x8010, 0x1C13), ("RxPDO", 0x8011, 0x1C12)]
                .into_iter()
                .filter(|(_, object, _)| is_read(snapshot, *object))
                .map(|(name, object, assigned)| direction(snapshot, name, object, assigned))
                .collect(),
            channels: (0..CHANNELS as u8)
                .filter(|number| is_read(snapshot, 0x9000 + u16::from(*number)))
                .map(|number| channel(snapshot, number))
                .collect(),
            performance: performance(snapshot),
            flags: snapshot.get(0xB000, 6).map(flag_names),
            findings: findings(snapshot),
            bundle,
        }
    }
}

impl Report<'_> {
    /// Returns whether no profile is active in either direction.
    pub(super) fn has_no_profile(&self) -> bool {
        let is_inactive = |it: &Direction| it.active_bytes == Some(0);
        !self.directions.is_empty() && self.directions.iter().all(is_inactive)
    }
}

/// Returns whether anything of an object was read.
fn is_read(snapshot: &Snapshot, index: u16) -> bool {
    snapshot.values.keys().any(|key| key.index == index)
}

fn meaning(index: u16, subindex: u8, value: u32) -> &'static str {
    let entry = lookup(index, subindex).map(|(_, entry)| entry);
    entry.and_then(|entry| entry.meaning(value)).unwrap_or("unknown")
}

fn direction(snapshot: &Snapshot, name: &'static str, object: u16, assignment: u16) -> Direction {
    let value = |subindex| snapshot.get(object, subindex);
    let name_of = |subindex| value(subindex).map(|raw| meaning(object, subindex, raw));
    Direction {
        name,
        active_bytes: value(9),
        assigned_chunks: snapshot.get(assignment, 0),
        status: value(2),
        status_words: name_of(2),
        last_error: value(14),
        last_error_words: name_of(14),
        errors: value(15),
        overflows: value(16),
    }
}

fn channel(snapshot: &Snapshot, number: u8) -> Channel {
    let value = |object: u16, subindex| snapshot.get(object + u16::from(number), subindex);
    let information = |subindex| value(0x9000, subindex);
    let path = |subindex| value(0x9020, subindex);
    let status = information(9).map(|raw| ChannelStatus::from_raw(raw as u16));
    Channel {
        channel: number,
        status: status.map(ChannelStatus::raw),
        status_words: status.map(|status| status.to_string()),
        error_counters: information(1).map(ErrorCounters::from_raw),
        protocol: information(2).map(ProtocolStatus::from_raw),
        interrupts: information(3).map(|raw| Interrupts(raw).names()),
        fifo0: information(4).map(ReceiveFifoStatus::from_raw),
        fifo1: information(5).map(ReceiveFifoStatus::from_raw),
        transmit: information(6).map(TransmitQueueStatus::from_raw),
        events: information(7).map(EventFifoStatus::from_raw),
        high_priority: information(8).map(HighPriorityStatus::from_raw),
        rx_dropped: information(13),
        tx_backpressure: information(14),
        bus_off_count: information(15),
        cache_dropped: path(5),
        cache_watermark: path(2),
        tx_fifo_full: path(11),
        tx_stale: path(12),
        degraded: path(15),
        last_error: path(16),
        has_rejected: snapshot.rejected.keys().any(|key| {
            [0x9000, 0x9020].map(|object| object + u16::from(number)).contains(&key.index)
        }),
    }
}

fn performance(snapshot: &Snapshot) -> Vec<Measured> {
    let clock_hz = snapshot.get(0x8000, 4).filter(|hz| *hz != 0);
    let measured = |subindex| {
        let raw = snapshot.get(0x9011, subindex)?;
        let (_, entry) = lookup(0x9011, subindex)?;
        let value = match entry.ty {
            ecan_protocol::object::ObjectType::I32 => i64::from(raw as i32),
            _ => i64::from(raw),
        };
        let is_cycles = entry.unit == Some("CPU cycles");
        let us = clock_hz.filter(|_| is_cycles).map(|hz| value as f64 * 1e6 / f64::from(hz));
        Some(Measured { subindex, name: entry.name, value, us })
    };
    (1..=13).filter_map(measured).collect()
}
