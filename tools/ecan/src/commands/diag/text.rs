use std::collections::BTreeMap;
use std::fmt::Display;
use std::io::Write;

use ecan_protocol::text::Printable;
use ecan_tool_support::diagnosis::{Finding, ObjectKey, Severity};

use crate::context::{Output, Tone};
use crate::table;

use super::report::{Channel, Report};

type Written = std::io::Result<()>;

pub(super) fn print(
    report: &Report,
    is_brief: bool,
    output: &Output,
    out: &mut dyn Write,
) -> Written {
    heading(report, out)?;
    let rejected = &report.bundle.snapshot.rejected;
    if !is_brief {
        directions(report, out)?;
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
        performance(report, out)?;
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

fn heading(report: &Report, out: &mut dyn Write) -> Written {
    let gateway = &report.bundle.gateway;
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

fn directions(report: &Report, out: &mut dyn Write) -> Written {
    if report.directions.is_empty() {
        return writeln!(out, "\nprocess data: {NOT_READ}");
    }
    let titles = ["", "BYTES", "ASSIGNED", "STATUS", "LAST ERROR", "ERRORS", "OVERFLOWS"];
    let status = |raw: Option<u32>, name: Option<&str>| {
        or_not_read(raw.zip(name).map(|(raw, name)| format!("{raw} {name}")))
    };
    writeln!(out)?;
    table::print_with_titles(out, titles, &report.directions, |it| {
        [
            it.name.to_owned(),
            match it.active_bytes {
                Some(0) => "not active".to_owned(),
                bytes => or_not_read(bytes),
            },
            or_not_read(it.assigned_chunks.map(|chunks| format!("{chunks} chunks"))),
            status(it.status, it.status_words),
            status(it.last_error, it.last_error_words),
            or_not_read(it.errors),
            or_not_read(it.overflows),
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
    table::print(out, rows, |row| row.map(str::to_owned))
}

fn performance(report: &Report, out: &mut dyn Write) -> Written {
    if report.performance.is_empty() && report.has_no_profile() {
        return writeln!(out, "\ncycle performance (0x9011): no profile is active");
    }
    if report.performance.is_empty() {
        return writeln!(out, "\ncycle performance (0x9011): {NOT_READ}");
    }
    writeln!(out, "\ncycle performance (0x9011)")?;
    table::print(out, &report.performance, |it| {
        let us = it.us.map_or_else(String::new, |us| format!("{us:.1} us"));
        [format!("  {}", it.name), it.value.to_string(), us]
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
