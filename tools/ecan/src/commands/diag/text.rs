//! The report for people.

use std::io::Write;

use ecan_diagnosis::{Finding, Severity};

use crate::output::{Output, Tone};
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
    if !is_brief {
        directions(report, out)?;
        // Quiet channels are a line each, without gaps.
        let mut follows_quiet = false;
        for channel in &report.channels {
            if !(follows_quiet && channel.is_quiet()) {
                writeln!(out)?;
            }
            follows_quiet = channel.is_quiet();
            print_channel(channel, out)?;
        }
        performance(report, out)?;
        refused(report, out)?;
        writeln!(out)?;
    }
    if report.findings.is_empty() {
        return writeln!(out, "{}", output.toned(Tone::Good, "no finding"));
    }
    report.findings.iter().try_for_each(|finding| print_finding(finding, output, out))
}

fn heading(report: &Report, out: &mut dyn Write) -> Written {
    let gateway = &report.bundle.gateway;
    write!(out, "slave {}, {}", report.position, report.state)?;
    if report.has_error_flag {
        write!(out, " with error flag")?;
    }
    write!(out, ", {}", gateway.name)?;
    if !gateway.firmware.is_empty() {
        write!(out, ", firmware {}", gateway.firmware)?;
    }
    if let Some(serial) = gateway.serial {
        write!(out, ", serial {serial}")?;
    }
    writeln!(out)?;
    let status = report.al_status.as_deref().unwrap_or("not read");
    writeln!(out, "AL status code: {status}")?;
    let flags = match report.flags[..] {
        [] => "none".to_owned(),
        ref flags => flags.join(", "),
    };
    writeln!(out, "diagnostic flags: {flags}")
}

fn directions(report: &Report, out: &mut dyn Write) -> Written {
    let heads = ["", "BYTES", "ASSIGNED", "STATUS", "LAST ERROR", "ERRORS", "OVERFLOWS"];
    let mut rows = vec![heads.map(str::to_owned)];
    for it in &report.directions {
        rows.push([
            it.name.to_owned(),
            if it.active_bytes == 0 { "not active".into() } else { it.active_bytes.to_string() },
            it.assigned_chunks.map_or_else(|| "-".into(), |chunks| format!("{chunks} chunks")),
            format!("{} {}", it.status, it.status_words),
            format!("{} {}", it.last_error, it.last_error_words),
            it.errors.to_string(),
            it.overflows.to_string(),
        ]);
    }
    writeln!(out)?;
    table::print(out, &rows)
}

fn print_channel(channel: &Channel, out: &mut dyn Write) -> Written {
    writeln!(out, "CAN{}  {}", channel.channel, channel.status_words)?;
    if channel.is_quiet() {
        return Ok(());
    }
    let interrupts = match channel.interrupts[..] {
        [] => "none".to_owned(),
        ref words => words.join(", "),
    };
    let counters = format!(
        "{} received dropped, {} times no room to send, {} times bus-off",
        channel.rx_dropped, channel.tx_backpressure, channel.bus_off_count
    );
    let path = format!(
        "RX cache dropped {}, held {} at most; TX FIFO full {} times, {} stale; degraded 0x{:X}, \
         last error {}",
        channel.cache_dropped,
        channel.cache_watermark,
        channel.tx_fifo_full,
        channel.tx_stale,
        channel.degraded,
        channel.last_error
    );
    let rows = [
        ["  ECR", &channel.error_counters.to_string()],
        ["  PSR", &channel.protocol.to_string()],
        ["  IR", &interrupts],
        ["  RXF0S", &channel.fifo0.to_string()],
        ["  RXF1S", &channel.fifo1.to_string()],
        ["  TXFQS", &channel.transmit.to_string()],
        ["  TXEFS", &channel.events.to_string()],
        ["  HPMS", &channel.high_priority.to_string()],
        ["  counters", &counters],
        ["  data path", &path],
    ];
    table::print(out, &rows.map(|row| row.map(str::to_owned)))
}

fn performance(report: &Report, out: &mut dyn Write) -> Written {
    if report.performance.is_empty() {
        return Ok(());
    }
    writeln!(out, "\ncycle performance (0x9011)")?;
    let rows: Vec<_> = report
        .performance
        .iter()
        .map(|it| {
            let us = it.us.map_or_else(String::new, |us| format!("{us:.1} us"));
            [format!("  {}", it.name), it.value.to_string(), us]
        })
        .collect();
    table::print(out, &rows)
}

/// Entries that this firmware does not have.
fn refused(report: &Report, out: &mut dyn Write) -> Written {
    let refused = &report.bundle.snapshot.refused;
    if refused.is_empty() {
        return Ok(());
    }
    writeln!(out, "\nnot read")?;
    refused.iter().try_for_each(|(key, why)| writeln!(out, "  {key}  {why}"))
}

fn print_finding(finding: &Finding, output: &Output, out: &mut dyn Write) -> Written {
    let (tone, word) = match finding.severity {
        Severity::Fault => (Tone::Bad, "fault"),
        Severity::Warning => (Tone::Warning, "warning"),
    };
    let word = output.toned(tone, word);
    writeln!(out, "{word} [{}] {}: {}", finding.id, finding.place, finding.what)?;
    for (number, cause) in (1..).zip(&finding.causes) {
        let label = if number == 1 { "may be" } else { "      " };
        writeln!(out, "  {label} {number}. {cause}")?;
    }
    writeln!(out, "  next   {}", finding.next)?;
    writeln!(out, "  {}", output.toned(Tone::Faint, format!("manual {}", finding.chapter)))
}
