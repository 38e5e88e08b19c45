//! CAN IDs as text.

use std::io::Write;

use ecan_protocol::can::{CanFrame, FrameKind};

use super::keys::Choice;
use super::snapshot::{IdView, Snapshot};
use crate::frames::signals::missing;
use crate::table;

pub const ID_TITLES: [&str; 9] =
    ["bus", "dir", "CAN ID", "count", "last ms", "mean ms", "DLC", "age s", "data"];

/// Cells without the data.
pub fn id_cells(row: &IdView) -> [String; 8] {
    [
        format!("{}.{}", row.gateway, row.channel),
        row.direction.text().to_owned(),
        can_id(&row.frame),
        row.count.to_string(),
        milliseconds(row.period_ns),
        milliseconds(row.mean_period_ns),
        format!("{}{}", row.frame.dlc().value(), kind_mark(&row.frame)),
        seconds(row.age_ns),
    ]
}

/// The CAN ID in the form of candump.
fn can_id(frame: &CanFrame) -> String {
    let id = frame.id();
    if id.is_extended() { format!("{:08X}", id.raw()) } else { format!("{:03X}", id.raw()) }
}

fn kind_mark(frame: &CanFrame) -> &'static str {
    match frame.kind() {
        FrameKind::Data => "",
        FrameKind::Remote => "R",
        FrameKind::Fd { .. } => "F",
    }
}

fn milliseconds(ns: Option<u64>) -> String {
    match ns.map(|ns| ns as f64 / 1e6) {
        None => "-".to_owned(),
        Some(ms) if ms < 10_000.0 => format!("{ms:.2}"),
        Some(ms) => format!("{ms:.0}"),
    }
}

fn seconds(ns: u64) -> String {
    let s = ns as f64 / 1e9;
    if s < 1000.0 { format!("{s:.1}") } else { format!("{s:.0}") }
}

/// Line of the selected row, with the name of its message.
pub fn id_summary(row: &IdView, message: Option<&str>) -> String {
    let IdView { gateway, channel, frame, .. } = row;
    let kind = match frame.kind() {
        FrameKind::Data => "classic",
        FrameKind::Remote => "remote",
        FrameKind::Fd { brs: false, .. } => "CAN FD",
        FrameKind::Fd { brs: true, .. } => "CAN FD BRS",
    };
    let direction = row.direction.text();
    let changed = match changed(row) {
        none if none.is_empty() => String::new(),
        bytes => format!(", changed bytes {bytes}"),
    };
    let message = message.map_or_else(String::new, |name| format!(" {name}"));
    format!(
        "gateway {gateway} can{channel} {direction} {}{message}, {kind}, {} bytes{changed}",
        can_id(frame),
        frame.data().len()
    )
}

/// Numbers of the changed bytes, as "0,2-4".
fn changed(row: &IdView) -> String {
    let mut ranges: Vec<(usize, usize)> = Vec::new();
    for byte in row.changed_bytes() {
        match ranges.last_mut() {
            Some((_, end)) if *end + 1 == byte => *end = byte,
            _ => ranges.push((byte, byte)),
        }
    }
    let range = |(begin, end): &(usize, usize)| match begin == end {
        true => begin.to_string(),
        false => format!("{begin}-{end}"),
    };
    ranges.iter().map(range).collect::<Vec<_>>().join(",")
}

pub fn ids_title(snapshot: &Snapshot, choice: Choice, shown: usize) -> String {
    let filter = match choice.filter.is_all() {
        true => "all channels".to_owned(),
        false => choice.filter.to_string(),
    };
    let more = match snapshot.ids.not_listed {
        0 => String::new(),
        frames => format!("; {frames} frames of further CAN IDs"),
    };
    format!("CAN IDs, {filter}: {shown} rows by {}{more}", choice.sort.text())
}

pub fn print(out: &mut dyn Write, snapshot: &Snapshot, choice: Choice) -> std::io::Result<()> {
    let rows = choice.ids(snapshot);
    writeln!(out, "{}", ids_title(snapshot, choice, rows.len()))?;
    let [bus, direction, id, count, period, mean, dlc, age, data] = ID_TITLES;
    let titles = [bus, direction, id, count, period, mean, dlc, age, "changed", data];
    table::print_with_titles(out, titles, &rows, |row| {
        let [bus, direction, id, count, period, mean, dlc, age] = id_cells(row);
        let bytes = row.frame.data().iter().map(|byte| format!("{byte:02X}"));
        let data = bytes.collect::<Vec<_>>().join(" ");
        [bus, direction, id, count, period, mean, dlc, age, changed(row), data]
    })?;
    print_signals(out, snapshot, &rows)
}

/// Prints a line for each signal of the rows.
fn print_signals(
    out: &mut dyn Write,
    snapshot: &Snapshot,
    rows: &[&IdView],
) -> std::io::Result<()> {
    let decode = |row: &IdView| snapshot.signals.decode(row.channel, &row.frame);
    let decoded: Vec<_> = rows.iter().filter_map(|row| Some((row, decode(row)?))).collect();
    if decoded.is_empty() {
        return Ok(());
    }
    writeln!(out)?;
    let cells = decoded.iter().flat_map(|(row, decoded)| {
        let [bus, direction, id, ..] = id_cells(row);
        let message = format!("{}{}", decoded.message.name, missing(decoded));
        decoded.signals.iter().map(move |it| {
            let names = [&bus, &direction, &id, &message, &it.signal.name].map(String::clone);
            let [bus, direction, id, message, name] = names;
            [bus, direction, id, message, name, it.value_text()]
        })
    });
    let titles = ["bus", "dir", "CAN ID", "message", "signal", "value"];
    table::print_with_titles(out, titles, cells, |row| row)
}
