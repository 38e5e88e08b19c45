//! The views as text: gateways, channels and cycle; CAN IDs; axes.

use std::io::Write;

use ecan_protocol::can::{CanFrame, FrameKind};
use ecan_service::protocol::{Access, AxisState, ClientStats, ServiceStats};

use super::keys::Choice;
use super::snapshot::{
    AxesView, CLASS_NAMES, ChannelView, CycleView, GatewayView, IdView, Snapshot, Times,
};
use crate::frames::signals::missing;
use crate::output;
use crate::output::or_dash;

pub fn print_overview(out: &mut dyn Write, snapshot: &Snapshot) -> std::io::Result<()> {
    let titles = [
        "gateway",
        "state",
        "WC",
        "incomplete",
        "lost images",
        "unknown",
        "faulty images",
        "lost",
        "reason",
    ];
    output::print_with_titles(out, titles, &snapshot.gateways, gateway_cells)?;
    for gateway in &snapshot.gateways {
        writeln!(out, "\ngateway {}", gateway.position)?;
        let channels = gateway.channels.iter().enumerate();
        output::print_with_titles(out, CHANNEL_TITLES, channels, |(at, channel)| {
            channel_cells(at, channel)
        })?;
    }
    writeln!(out)?;
    writeln!(out, "cycle {}: {}", cycle_title(&snapshot.cycle), cycle_counts(&snapshot.cycle))?;
    for line in cycle_times(&snapshot.cycle) {
        writeln!(out, "  {line}")?;
    }
    for (name, count) in CLASS_NAMES.iter().zip(snapshot.cycle.histogram.unwrap_or_default()) {
        if count > 0 {
            writeln!(out, "  {name:>10} us  {count}")?;
        }
    }
    if let Some(stats) = &snapshot.service {
        let program = snapshot.head.program.as_deref().unwrap_or_default();
        writeln!(out, "\nclients of {program}{}", ring_losses(stats))?;
        output::print_with_titles(out, CLIENT_TITLES, &stats.clients, client_cells)?;
    }
    if !snapshot.events.is_empty() {
        writeln!(out)?;
    }
    for event in &snapshot.events {
        writeln!(out, "{:8.1} s  {}", event.seconds, event.words)?;
    }
    snapshot.service_events.iter().try_for_each(|events| events.print(out))
}

pub fn gateway_cells(gateway: &GatewayView) -> [String; 9] {
    let GatewayView { working_counter, expected_working_counter, .. } = gateway;
    [
        gateway.position.to_string(),
        gateway.state.text().to_owned(),
        format!("{working_counter}/{expected_working_counter}"),
        gateway.incomplete_cycles.to_string(),
        gateway.lost_images.to_string(),
        gateway.unknown_images.to_string(),
        gateway.faulty_images.to_string(),
        gateway.times_lost.to_string(),
        gateway.reason.clone(),
    ]
}

pub const CHANNEL_TITLES: [&str; 10] = [
    "channel",
    "state",
    "load",
    "frames/s",
    "TEC",
    "REC",
    "rx/tx wait",
    "dropped",
    "bus-offs",
    "received",
];

pub fn channel_cells(at: usize, channel: &ChannelView) -> [String; 10] {
    let errors = channel.errors;
    let is_known = channel.state.is_some();
    let known = |text: String| if is_known { text } else { "-".to_owned() };
    [
        format!("can{at}"),
        state(channel),
        known(format!("{:.1} %", channel.load * 100.0)),
        known(format!("{:.1}", channel.rx_per_second)),
        or_dash(errors.map(|errors| errors.transmit)),
        or_dash(errors.map(|errors| errors.receive)),
        known(format!("{}/{}", waiting(channel.rx_pending), waiting(channel.tx_pending))),
        or_dash(errors.map(|errors| errors.dropped)),
        or_dash(errors.map(|errors| errors.bus_offs)),
        channel.received.to_string(),
    ]
}

fn state(channel: &ChannelView) -> String {
    let state = or_dash(channel.state.as_ref());
    if channel.has_warning && !channel.is_bus_off { format!("{state}, warning") } else { state }
}

/// The status word counts to 7.
fn waiting(frames: u8) -> String {
    if frames >= 7 { "7+".to_owned() } else { frames.to_string() }
}

pub const CLIENT_TITLES: [&str; 8] =
    ["client", "pid", "access", "delivered", "lost", "accepted", "rejected", "pending"];

pub fn client_cells(client: &ClientStats) -> [String; 8] {
    let access = match client.access {
        Access::Read => "read",
        Access::Control => "control",
    };
    [
        client.name.clone(),
        client.pid.to_string(),
        access.to_owned(),
        client.frames_delivered.to_string(),
        client.frames_lost.to_string(),
        client.frames_accepted.to_string(),
        client.frames_rejected.to_string(),
        client.frames_pending.to_string(),
    ]
}

/// Losses that all clients share.
pub fn ring_losses(stats: &ServiceStats) -> String {
    match stats.images_lost_in_ring {
        0 => String::new(),
        images => format!(
            "; lost for all: {images} images, {} frames and results",
            stats.frames_lost_in_ring
        ),
    }
}

pub fn cycle_title(cycle: &CycleView) -> String {
    let CycleView { cycle_us, sampled, .. } = cycle;
    match sampled {
        None => format!("{cycle_us} us"),
        Some(_) => {
            format!("{cycle_us} us, sampled since the start of the service, no periods")
        }
    }
}

pub fn cycle_counts(cycle: &CycleView) -> String {
    let unmeasured = match cycle.unmeasured {
        0 => String::new(),
        more => format!(", {more} not measured"),
    };
    let sampled = match cycle.sampled {
        None => String::new(),
        Some(samples) => format!(", {samples} sampled"),
    };
    let CycleView { cycles, overruns, skipped, .. } = cycle;
    format!("{cycles} cycles, {overruns} overruns, {skipped} skipped{unmeasured}{sampled}")
}

/// Titles and rows of the times that are known.
pub fn cycle_times(cycle: &CycleView) -> Vec<String> {
    let row = |name: &str, cells: [String; 6]| {
        let cells = cells.map(|cell| format!("{cell:>7}"));
        format!("{name:<8}{}", cells.concat())
    };
    let titles = ["min", "p50", "p95", "p99", "p99.9", "max"].map(str::to_owned);
    let rows = [("period", cycle.period), ("run time", Some(cycle.run_time)), ("late", cycle.late)];
    let rows = rows.into_iter().filter_map(|(name, of)| Some(row(name, times(&of?))));
    std::iter::once(row("us", titles)).chain(rows).collect()
}

fn times(times: &Times) -> [String; 6] {
    let Times { min_us, p50_us, p95_us, p99_us, p99_9_us, max_us } = *times;
    let short = |us: f64| if us < 10_000.0 { format!("{us:.1}") } else { format!("{us:.0}") };
    [Some(min_us), Some(p50_us), p95_us, Some(p99_us), p99_9_us, Some(max_us)]
        .map(|us| or_dash(us.map(short)))
}

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
    let short = |ms: f64| if ms < 10_000.0 { format!("{ms:.2}") } else { format!("{ms:.0}") };
    or_dash(ns.map(|ns| short(ns as f64 / 1e6)))
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

pub fn print_ids(out: &mut dyn Write, snapshot: &Snapshot, choice: Choice) -> std::io::Result<()> {
    let rows = choice.ids(snapshot);
    writeln!(out, "{}", ids_title(snapshot, choice, rows.len()))?;
    let [bus, direction, id, count, period, mean, dlc, age, data] = ID_TITLES;
    let titles = [bus, direction, id, count, period, mean, dlc, age, "changed", data];
    output::print_with_titles(out, titles, &rows, |row| {
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
        decoded.signals.iter().map(move |signal| {
            let names = [&bus, &direction, &id, &message, &signal.signal.name].map(String::clone);
            let [bus, direction, id, message, name] = names;
            [bus, direction, id, message, name, signal.value_text()]
        })
    });
    let titles = ["bus", "dir", "CAN ID", "message", "signal", "value"];
    output::print_with_titles(out, titles, cells, |row| row)
}

pub const AXIS_TITLES: [&str; 10] =
    ["bus", "node", "phase", "mode", "target", "actual", "following", "heartbeat", "SW", "error"];

pub fn axis_cells(axis: &AxisState) -> [String; 10] {
    [
        format!("{}.{}", axis.gateway, axis.channel),
        axis.node_id.to_string(),
        axis.phase.clone(),
        axis.mode.clone(),
        or_dash(axis.target),
        or_dash(axis.actual),
        or_dash(axis.following_error),
        heartbeat(axis).to_owned(),
        or_dash(axis.statusword.map(|word| format!("0x{word:04X}"))),
        error(axis).unwrap_or_default(),
    ]
}

/// Short form of the texts of the service.
fn heartbeat(axis: &AxisState) -> &str {
    match axis.heartbeat.as_str() {
        "none received yet" => "none yet",
        "not watched" => "-",
        other => other,
    }
}

pub fn is_heartbeat_lost(axis: &AxisState) -> bool {
    axis.heartbeat == "timed out"
}

/// Failure of the last command, and the error code of the drive.
fn error(axis: &AxisState) -> Option<String> {
    let code = match axis.error_code {
        0 => None,
        code => {
            let text = ecan_canopen::error_code_text(code);
            Some(text.map_or_else(
                || format!("error code 0x{code:04X}"),
                |text| format!("error code 0x{code:04X} ({text})"),
            ))
        }
    };
    let parts: Vec<_> = axis.error.clone().into_iter().chain(code).collect();
    (!parts.is_empty()).then(|| parts.join(", "))
}

/// Lines of the selected axis.
pub fn axis_details(axis: &AxisState) -> Vec<String> {
    axis.details(error(axis))
}

pub fn print_axes(out: &mut dyn Write, view: &AxesView) -> std::io::Result<()> {
    if let Some(reason) = &view.without_axes {
        return writeln!(out, "{reason}");
    }
    output::print_with_titles(out, AXIS_TITLES, &view.axes, axis_cells)
}
