//! What was read, decoded, with its findings.

use ecan_diagnosis::registers::{
    ErrorCounters, EventFifoStatus, HighPriorityStatus, Interrupts, ProtocolStatus,
    ReceiveFifoStatus, TransmitQueueStatus,
};
use ecan_diagnosis::{Finding, Snapshot, findings, flag_words};
use ecan_protocol::{AlStatusCode, CHANNELS, ChannelState, ChannelStatus, lookup};
use serde::Serialize;

use super::bundle::Bundle;

/// The report on one gateway.
#[derive(Debug, Serialize)]
pub(super) struct Report<'a> {
    pub(super) position: u16,
    pub(super) state: String,
    pub(super) has_error_flag: bool,
    pub(super) al_status: Option<String>,
    pub(super) directions: Vec<Direction>,
    pub(super) channels: Vec<Channel>,
    pub(super) performance: Vec<Measured>,
    pub(super) flags: Vec<&'static str>,
    pub(super) findings: Vec<Finding>,
    pub(super) bundle: &'a Bundle,
}

/// A direction of process data.
#[derive(Debug, Serialize)]
pub(super) struct Direction {
    pub(super) name: &'static str,
    pub(super) active_bytes: u32,
    pub(super) assigned_chunks: Option<u32>,
    pub(super) status: u32,
    pub(super) status_words: &'static str,
    pub(super) last_error: u32,
    pub(super) last_error_words: &'static str,
    pub(super) errors: u32,
    pub(super) overflows: u32,
}

/// A CAN channel.
#[derive(Debug, Serialize)]
pub(super) struct Channel {
    pub(super) channel: u8,
    pub(super) status: u16,
    pub(super) status_words: String,
    pub(super) error_counters: ErrorCounters,
    pub(super) protocol: ProtocolStatus,
    pub(super) interrupts: Vec<&'static str>,
    pub(super) fifo0: ReceiveFifoStatus,
    pub(super) fifo1: ReceiveFifoStatus,
    pub(super) transmit: TransmitQueueStatus,
    pub(super) events: EventFifoStatus,
    pub(super) high_priority: HighPriorityStatus,
    pub(super) rx_dropped: u32,
    pub(super) tx_backpressure: u32,
    pub(super) bus_off_count: u32,
    pub(super) cache_dropped: u32,
    pub(super) cache_watermark: u32,
    pub(super) tx_fifo_full: u32,
    pub(super) tx_stale: u32,
    pub(super) degraded: u32,
    pub(super) last_error: u32,
}

/// An entry of 0x9011.
#[derive(Debug, Serialize)]
pub(super) struct Measured {
    pub(super) subindex: u8,
    pub(super) name: &'static str,
    pub(super) value: i64,
    /// The value in microseconds, for one that counts CPU cycles.
    pub(super) us: Option<f64>,
}

impl Channel {
    /// Switched off, and nothing has ever happened on it.
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
        let is_off = ChannelStatus::from_raw(self.status).state() == ChannelState::Disabled;
        is_off && counts == [0; 8] && self.error_counters == ErrorCounters::from_raw(0)
    }
}

impl<'a> Report<'a> {
    pub(super) fn new(bundle: &'a Bundle) -> Self {
        let snapshot = &bundle.snapshot;
        let has_channels = snapshot.get(0x9000, 9).is_some();
        Self {
            position: snapshot.position,
            state: snapshot
                .state()
                .map_or_else(|| format!("state 0x{:02X}", snapshot.al_state), |it| it.to_string()),
            has_error_flag: snapshot.has_error_flag,
            al_status: snapshot.al_status_code.map(|code| AlStatusCode(code).to_string()),
            directions: [("TxPDO", 0x8010, 0x1C13), ("RxPDO", 0x8011, 0x1C12)]
                .into_iter()
                .filter_map(|(name, object, assigned)| direction(snapshot, name, object, assigned))
                .collect(),
            channels: (0..CHANNELS as u8)
                .filter(|_| has_channels)
                .map(|number| channel(snapshot, number))
                .collect(),
            performance: performance(snapshot),
            flags: flag_words(snapshot.get(0xB000, 6).unwrap_or(0)),
            findings: findings(snapshot),
            bundle,
        }
    }
}

fn meaning(index: u16, subindex: u8, value: u32) -> &'static str {
    let entry = lookup(index, subindex).map(|(_, entry)| entry);
    entry.and_then(|entry| entry.meaning(value)).unwrap_or("not in the manual")
}

fn direction(
    snapshot: &Snapshot,
    name: &'static str,
    object: u16,
    assignment: u16,
) -> Option<Direction> {
    let value = |subindex| snapshot.get(object, subindex);
    let (status, last_error) = (value(2)?, value(14)?);
    Some(Direction {
        name,
        active_bytes: value(9)?,
        assigned_chunks: snapshot.get(assignment, 0),
        status,
        status_words: meaning(object, 2, status),
        last_error,
        last_error_words: meaning(object, 14, last_error),
        errors: value(15)?,
        overflows: value(16)?,
    })
}

fn channel(snapshot: &Snapshot, number: u8) -> Channel {
    let value = |object: u16, subindex| {
        snapshot.get(object + u16::from(number), subindex).unwrap_or_default()
    };
    let information = |subindex| value(0x9000, subindex);
    let path = |subindex| value(0x9020, subindex);
    let status = ChannelStatus::from_raw(information(9) as u16);
    Channel {
        channel: number,
        status: status.raw(),
        status_words: status.to_string(),
        error_counters: ErrorCounters::from_raw(information(1)),
        protocol: ProtocolStatus::from_raw(information(2)),
        interrupts: Interrupts(information(3)).words(),
        fifo0: ReceiveFifoStatus::from_raw(information(4)),
        fifo1: ReceiveFifoStatus::from_raw(information(5)),
        transmit: TransmitQueueStatus::from_raw(information(6)),
        events: EventFifoStatus::from_raw(information(7)),
        high_priority: HighPriorityStatus::from_raw(information(8)),
        rx_dropped: information(13),
        tx_backpressure: information(14),
        bus_off_count: information(15),
        cache_dropped: path(5),
        cache_watermark: path(2),
        tx_fifo_full: path(11),
        tx_stale: path(12),
        degraded: path(15),
        last_error: path(16),
    }
}

fn performance(snapshot: &Snapshot) -> Vec<Measured> {
    let clock_hz = snapshot.get(0x8000, 4).filter(|hz| *hz != 0);
    let measured = |subindex| {
        let raw = snapshot.get(0x9011, subindex)?;
        let (_, entry) = lookup(0x9011, subindex)?;
        let value = match entry.ty {
            ecan_protocol::ObjectType::I32 => i64::from(raw as i32),
            _ => i64::from(raw),
        };
        let is_cycles = entry.unit == Some("CPU cycles");
        let us = clock_hz.filter(|_| is_cycles).map(|hz| value as f64 * 1e6 / f64::from(hz));
        Some(Measured { subindex, name: entry.name, value, us })
    };
    (1..=13).filter_map(measured).collect()
}
