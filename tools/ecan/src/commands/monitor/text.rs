use std::io::Write;

use ecan_service::protocol::{Access, ClientStats, ServiceStats};

use super::snapshot::{CLASS_NAMES, ChannelView, CycleView, GatewayView, Snapshot, Times};
use crate::table;

pub fn print(out: &mut dyn Write, snapshot: &Snapshot) -> std::io::Result<()> {
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
    table::print_with_titles(out, titles, &snapshot.gateways, gateway_cells)?;
    for gateway in &snapshot.gateways {
        writeln!(out, "\ngateway {}", gateway.position)?;
        let channels = gateway.channels.iter().enumerate();
        table::print_with_titles(out, CHANNEL_TITLES, channels, |(at, it)| channel_cells(at, it))?;
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
        table::print_with_titles(out, CLIENT_TITLES, &stats.clients, client_cells)?;
    }
    if !snapshot.events.is_empty() {
        writeln!(out)?;
    }
    for event in &snapshot.events {
        writeln!(out, "{:8.1} s  {}", event.seconds, event.words)?;
    }
    Ok(())
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
    let count = |value: Option<u64>| value.map_or_else(|| "-".to_owned(), |it| it.to_string());
    let errors = channel.errors;
    let is_known = channel.state.is_some();
    let known = |text: String| if is_known { text } else { "-".to_owned() };
    [
        format!("can{at}"),
        state(channel),
        known(format!("{:.1} %", channel.load * 100.0)),
        known(format!("{:.1}", channel.rx_per_second)),
        count(errors.map(|it| it.transmit.into())),
        count(errors.map(|it| it.receive.into())),
        known(format!("{}/{}", waiting(channel.rx_pending), waiting(channel.tx_pending))),
        count(errors.map(|it| it.dropped)),
        count(errors.map(|it| it.bus_offs)),
        channel.received.to_string(),
    ]
}

fn state(channel: &ChannelView) -> String {
    let state = channel.state.clone().unwrap_or_else(|| "-".to_owned());
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
    let short = |us: Option<f64>| match us {
        None => "-".to_owned(),
        Some(us) if us < 10_000.0 => format!("{us:.1}"),
        Some(us) => format!("{us:.0}"),
    };
    [Some(min_us), Some(p50_us), p95_us, Some(p99_us), p99_9_us, Some(max_us)].map(short)
}
