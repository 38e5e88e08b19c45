//! A snapshot as lines of text.

use std::io::Write;

use crate::table;

use super::snapshot::{CLASS_NAMES, ChannelView, CycleView, GatewayView, Snapshot, Times};

/// Prints everything.
pub fn print(out: &mut dyn Write, snapshot: &Snapshot) -> std::io::Result<()> {
    let mut rows = vec![
        ["gateway", "state", "WC", "incomplete", "lost images", "faulty images", "lost", "reason"]
            .map(str::to_owned),
    ];
    rows.extend(snapshot.gateways.iter().map(gateway_cells));
    table::print(out, &rows)?;
    for gateway in &snapshot.gateways {
        writeln!(out, "\ngateway {}", gateway.position)?;
        let mut rows = vec![CHANNEL_TITLES.map(str::to_owned)];
        rows.extend((0..).zip(&gateway.channels).map(|(at, it)| channel_cells(at, it)));
        table::print(out, &rows)?;
    }
    writeln!(out)?;
    for line in cycle_lines(&snapshot.cycle) {
        writeln!(out, "{line}")?;
    }
    for (name, count) in CLASS_NAMES.iter().zip(snapshot.cycle.histogram) {
        if count > 0 {
            writeln!(out, "  {name:>10} us  {count}")?;
        }
    }
    if !snapshot.events.is_empty() {
        writeln!(out)?;
    }
    for event in &snapshot.events {
        writeln!(out, "{:8.1} s  {}", event.seconds, event.words)?;
    }
    Ok(())
}

/// What a gateway's row says.
pub fn gateway_cells(gateway: &GatewayView) -> [String; 8] {
    let GatewayView { working_counter, expected_working_counter, .. } = gateway;
    [
        gateway.position.to_string(),
        gateway.standing.words().to_owned(),
        format!("{working_counter}/{expected_working_counter}"),
        gateway.incomplete_cycles.to_string(),
        gateway.lost_images.to_string(),
        gateway.faulty_images.to_string(),
        gateway.times_lost.to_string(),
        gateway.reason.clone(),
    ]
}

/// Over the cells of a channel.
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

/// What a channel's row says.
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

/// State, with a mark where the channel warns.
fn state(channel: &ChannelView) -> String {
    let state = channel.state.clone().unwrap_or_else(|| "-".to_owned());
    if channel.has_warning && !channel.is_bus_off { format!("{state}, warning") } else { state }
}

/// The status counts no further than 7.
fn waiting(frames: u8) -> String {
    if frames >= 7 { "7+".to_owned() } else { frames.to_string() }
}

/// How the cycle is kept, without the histogram.
pub fn cycle_lines(cycle: &CycleView) -> [String; 3] {
    let unmeasured = match cycle.unmeasured {
        0 => String::new(),
        more => format!(", {more} not measured"),
    };
    [
        format!(
            "cycle {} us: {} cycles, {} overruns, {} skipped{unmeasured}",
            cycle.cycle_us, cycle.cycles, cycle.overruns, cycle.skipped
        ),
        format!("  period us    {}", times(&cycle.period)),
        format!("  run time us  {}", times(&cycle.run_time)),
    ]
}

fn times(times: &Times) -> String {
    let Times { min_us, p50_us, p95_us, p99_us, p99_9_us, max_us } = times;
    format!(
        "min {min_us:.1}  p50 {p50_us:.1}  p95 {p95_us:.1}  p99 {p99_us:.1}  \
         p99.9 {p99_9_us:.1}  max {max_us:.1}"
    )
}
