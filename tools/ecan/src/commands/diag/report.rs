//! Report of a gateway, and its text.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::io::Write;

use ecan_protocol::device::AlStatusCode;
use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;
use ecan_protocol::object::lookup;
use ecan_protocol::text::Printable;
use ecan_tool_support::diagnosis::registers::{
    ErrorCounters, EventFifoStatus, HighPriorityStatus, Interrupts, ProtocolStatus,
    ReceiveFifoStatus, TransmitQueueStatus,
};
use ecan_tool_support::diagnosis::{Finding, ObjectKey, Severity, Snapshot, findings, flag_names};
use serde::Serialize;

use crate::commands::bundle::Gateway;
use crate::context::{Output, Tone};
use crate::frames::ServiceEvents;
use crate::output;

/// DiagnosisReport of a gateway. A missing value is `None`, not zero.
#[derive(Debug, Serialize)]
pub(super) struct DiagnosisReport<'a> {
    pub(super) position: u16,
    pub(super) state: String,
    pub(super) has_error_flag: bool,
    pub(super) al_status: Option<String>,
    pub(super) directions: Vec<Direction>,
    pub(super) channels: Vec<Channel>,
    pub(super) performance: Vec<Measured>,
    pub(super) flags: Option<Vec<&'static str>>,
    pub(super) findings: Vec<Finding>,
    pub(super) gateway: &'a Gateway,
    /// Events of the service, of all gateways.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) service_events: Option<&'a ServiceEvents>,
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
            && self.error_counters.is_none_or(|counters| counters == ErrorCounters::from_raw(0))
    }
}

impl<'a> DiagnosisReport<'a> {
    pub(super) fn new(gateway: &'a Gateway) -> Self {
        let snapshot = &gateway.snapshot;
        Self {
            position: snapshot.position,
            state: snapshot.state().map_or_else(
                || format!("state 0x{:02X}", snapshot.al_state),
                |state| state.to_string(),
            ),
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
            gateway,
            service_events: None,
        }
    }
}

impl DiagnosisReport<'_> {
    /// Returns whether no profile is active in either direction.
    pub(super) fn has_no_profile(&self) -> bool {
        let is_inactive = |direction: &Direction| direction.active_bytes == Some(0);
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

type Written = std::io::Result<()>;

pub(super) fn print(
    report: &DiagnosisReport,
    is_brief: bool,
    output: &Output,
    out: &mut dyn Write,
) -> Written {
    heading(report, out)?;
    let rejected = &report.gateway.snapshot.rejected;
    if !is_brief {
        print_directions(report, out)?;
        if report.channels.is_empty() {
            writeln!(out, "\nchannels: {NOT_READ}")?;
        }
        // Unused channels take one line each, without gaps.
        let mut follows_quiet = false;
        for channel in &report.channels {
            if !(follows_quiet && channel.is_quiet()) {
                writeln!(out)?;
            }
            follows_quiet = channel.is_quiet();
            print_channel(channel, out)?;
        }
        print_performance(report, out)?;
        print_rejected(rejected, out)?;
        writeln!(out)?;
    }
    if report.findings.is_empty() {
        write!(out, "{}", output.toned(Tone::Good, "no findings"))?;
        return match rejected.len() {
            0 => writeln!(out),
            1 => writeln!(out, "; 1 entry was not read"),
            more => writeln!(out, "; {more} entries were not read"),
        };
    }
    report.findings.iter().try_for_each(|finding| print_finding(finding, output, out))
}

fn heading(report: &DiagnosisReport, out: &mut dyn Write) -> Written {
    let gateway = report.gateway;
    write!(out, "slave {}, {}", report.position, report.state)?;
    if report.has_error_flag {
        write!(out, " with error flag")?;
    }
    let firmware = gateway.firmware.as_deref().filter(|text| !text.is_empty());
    let (firmware, serial) = (or_not_read(firmware.map(Printable)), or_not_read(gateway.serial));
    writeln!(out, ", {}, firmware {firmware}, serial {serial}", Printable(&gateway.name))?;
    writeln!(out, "AL status code: {}", or_not_read(report.al_status.as_deref()))?;
    writeln!(out, "diagnostic flags: {}", listed(report.flags.as_deref()))
}

const NOT_READ: &str = "not read";

fn or_not_read(value: Option<impl Display>) -> String {
    value.map_or_else(|| NOT_READ.to_owned(), |value| value.to_string())
}

fn listed(names: Option<&[&str]>) -> String {
    match names {
        None => NOT_READ.to_owned(),
        Some([]) => "none".to_owned(),
        Some(names) => names.join(", "),
    }
}

fn print_directions(report: &DiagnosisReport, out: &mut dyn Write) -> Written {
    if report.directions.is_empty() {
        return writeln!(out, "\nprocess data: {NOT_READ}");
    }
    let titles = ["", "BYTES", "ASSIGNED", "STATUS", "LAST ERROR", "ERRORS", "OVERFLOWS"];
    let status = |raw: Option<u32>, name: Option<&str>| {
        or_not_read(raw.zip(name).map(|(raw, name)| format!("{raw} {name}")))
    };
    writeln!(out)?;
    output::print_with_titles(out, titles, &report.directions, |direction| {
        [
            direction.name.to_owned(),
            match direction.active_bytes {
                Some(0) => "not active".to_owned(),
                bytes => or_not_read(bytes),
            },
            or_not_read(direction.assigned_chunks.map(|chunks| format!("{chunks} chunks"))),
            status(direction.status, direction.status_words),
            status(direction.last_error, direction.last_error_words),
            or_not_read(direction.errors),
            or_not_read(direction.overflows),
        ]
    })
}

/// A count, its text, and its name for a missing value.
type Count<'a> = (Option<u32>, &'a dyn Fn(u32) -> String, &'a str);

fn counts<const N: usize>(counts: [Count<'_>; N]) -> String {
    let texts =
        counts.map(|(count, text, name)| count.map_or_else(|| format!("{name} {NOT_READ}"), text));
    texts.join(", ")
}

fn print_channel(channel: &Channel, out: &mut dyn Write) -> Written {
    let status = match &channel.status_words {
        Some(text) => text.clone(),
        None => format!("status {NOT_READ}"),
    };
    writeln!(out, "CAN{}  {status}", channel.channel)?;
    if channel.is_quiet() {
        return Ok(());
    }
    let interrupts = listed(channel.interrupts.as_deref());
    let counters = counts([
        (channel.rx_dropped, &|n| format!("{n} received dropped"), "received dropped"),
        (channel.tx_backpressure, &|n| format!("{n} TX backpressure"), "TX backpressure"),
        (channel.bus_off_count, &|n| format!("{n} bus-off"), "bus-off"),
    ]);
    let path = [
        counts([
            (channel.cache_dropped, &|n| format!("RX cache dropped {n}"), "RX cache dropped"),
            (channel.cache_watermark, &|n| format!("peak {n}"), "peak"),
        ]),
        counts([
            (channel.tx_fifo_full, &|n| format!("TX FIFO full {n} times"), "TX FIFO full"),
            (channel.tx_stale, &|n| format!("{n} stale"), "stale"),
        ]),
        counts([
            (channel.degraded, &|n| format!("degraded 0x{n:X}"), "degraded"),
            (channel.last_error, &|n| format!("last error {n}"), "last error"),
        ]),
    ];
    let rows = [
        ["  ECR", &or_not_read(channel.error_counters)],
        ["  PSR", &or_not_read(channel.protocol)],
        ["  IR", &interrupts],
        ["  RXF0S", &or_not_read(channel.fifo0)],
        ["  RXF1S", &or_not_read(channel.fifo1)],
        ["  TXFQS", &or_not_read(channel.transmit)],
        ["  TXEFS", &or_not_read(channel.events)],
        ["  HPMS", &or_not_read(channel.high_priority)],
        ["  counters", &counters],
        ["  data path", &path.join("; ")],
    ];
    output::print(out, rows, |row| row.map(str::to_owned))
}

fn print_performance(report: &DiagnosisReport, out: &mut dyn Write) -> Written {
    if report.performance.is_empty() && report.has_no_profile() {
        return writeln!(out, "\ncycle performance (0x9011): no profile is active");
    }
    if report.performance.is_empty() {
        return writeln!(out, "\ncycle performance (0x9011): {NOT_READ}");
    }
    writeln!(out, "\ncycle performance (0x9011)")?;
    output::print(out, &report.performance, |measured| {
        let us = measured.us.map_or_else(String::new, |us| format!("{us:.1} us"));
        [format!("  {}", measured.name), measured.value.to_string(), us]
    })
}

/// Entries that this firmware does not have.
fn print_rejected(rejected: &BTreeMap<ObjectKey, String>, out: &mut dyn Write) -> Written {
    if rejected.is_empty() {
        return Ok(());
    }
    writeln!(out, "\n{NOT_READ}")?;
    rejected.iter().try_for_each(|(key, why)| writeln!(out, "  {key}  {why}"))
}

fn print_finding(finding: &Finding, output: &Output, out: &mut dyn Write) -> Written {
    let (tone, word) = match finding.severity {
        Severity::Fault => (Tone::Bad, "fault"),
        Severity::Warning => (Tone::Warning, "warning"),
    };
    let word = output.toned(tone, word);
    writeln!(out, "{word} [{}] {}: {}", finding.id, finding.location, finding.what)?;
    for (number, cause) in (1..).zip(&finding.causes) {
        let label = if number == 1 { "causes" } else { "      " };
        writeln!(out, "  {label} {number}. {cause}")?;
    }
    writeln!(out, "  next   {}", finding.next)?;
    writeln!(out, "  {}", output.toned(Tone::Faint, format!("manual {}", finding.chapter)))
}
