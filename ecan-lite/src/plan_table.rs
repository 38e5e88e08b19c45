//! The plan of a Port's configuration as a text table.

use std::fmt::Write;

use ecan_host::{AdapterConfig, SlavePlan};
use ecan_mcan_port::{
    CpuCost, FrameRoute, FrameStream, ImageFill, ImagePlan, PortPlan, RECOMMENDED_OFFSET_NS,
};
use ecan_protocol::can::{CanFrame, FrameKind};
use ecan_protocol::mapping::MAX_PACKETS;

/// Formats a plan with its warnings; `adapter` and `traffic` are those of the plan. The rejections
/// are not part of it: they are errors.
pub fn plan_table(plan: &PortPlan, adapter: &AdapterConfig, traffic: &[FrameStream]) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = ethercat(&mut text, plan, adapter);
    let _ = channels(&mut text, plan);
    let _ = images(&mut text, plan);
    let _ = frames(&mut text, plan, traffic);
    let _ = schedules(&mut text, plan, traffic);
    let _ = writeln!(text);
    for warning in &plan.warnings {
        let _ = writeln!(text, "warning: {warning}");
    }
    if plan.warnings.is_empty() && plan.rejections.is_empty() {
        let _ = writeln!(text, "no problems found");
    }
    text
}

fn us(ns: u64) -> String {
    format!("{:.1} us", ns as f64 / 1e3)
}

fn percent(share: f64) -> String {
    format!("{:.1} %", share * 100.0)
}

fn ethercat(text: &mut String, plan: &PortPlan, adapter: &AdapterConfig) -> std::fmt::Result {
    let wire = &plan.ethercat;
    let gateways = wire.slaves.len();
    writeln!(text, "plan for {gateways} gateway(s), cycle {}", us(wire.cycle_ns.into()))?;
    writeln!(text, "\n{:<14}{:>8}{:>12}   datagrams", "EtherCAT", "bytes", "time")?;
    for (number, frame) in wire.frames.iter().enumerate() {
        let datagrams: Vec<_> =
            frame.datagrams.iter().map(|d| format!("{} {}", d.purpose, d.data_bytes)).collect();
        writeln!(
            text,
            "{:<14}{:>8}{:>12}   {}",
            format!("frame {number}"),
            frame.wire_bytes(),
            us(frame.wire_ns()),
            datagrams.join(", ")
        )?;
    }
    writeln!(
        text,
        "{:<14}{:>8}{:>12}   {} of the cycle, {} datagrams",
        "in all",
        wire.wire_bytes(),
        us(wire.wire_ns()),
        percent(wire.wire_share()),
        wire.datagrams().count()
    )?;
    let each = |version| -> Vec<String> {
        let counter = |s: &SlavePlan| s.layout.expected_working_counter(version);
        wire.slaves.iter().map(|slave| counter(slave).to_string()).collect()
    };
    writeln!(
        text,
        "\nworking counter   {} ({}) with IgH 1.6, {} ({}) with 1.5",
        wire.expected_working_counter((1, 6)),
        each((1, 6)).join(" + "),
        wire.expected_working_counter((1, 5)),
        each((1, 5)).join(" + ")
    )?;
    let mailbox = wire.mailbox;
    writeln!(
        text,
        "mailboxes         {} of {} bytes left, {} transfers a cycle",
        mailbox.headroom_bytes(),
        mailbox.available_bytes,
        mailbox.transfers()
    )?;
    let cost = CpuCost::MEASURED;
    writeln!(
        text,
        "processor         {:.2} us, {:.3} % of the cycle: an estimate, for the images alone",
        plan.cpu_ns(cost) / 1e3,
        plan.cpu_share(cost) * 100.0
    )?;
    let last = wire.slaves.iter().map(|slave| slave.outputs_arrive_ns).max().unwrap_or(0);
    writeln!(text, "images arrive     {} after they are sent, the last one", us(last))?;
    if let Some(dc) = adapter.dc {
        let (period, shift) = (us(dc.cycle_ns().into()), us(dc.shift_ns().into()));
        write!(text, "Sync0             every {period}, shifted by {shift}")?;
        let Some(arrivals) = wire.output_arrivals() else { return writeln!(text) };
        let margin = arrivals.margin_ns(dc.shift_ns()) as f64 / 1e3;
        match arrivals.usable_shifts_ns() {
            Some((first, last)) => {
                let (first, last) = (us(first.into()), us(last.into()));
                writeln!(text, ", margin {margin:.1} us (usable: {first} to {last})")?;
            }
            None => writeln!(text, ", margin {margin:.1} us (no shift is usable)")?,
        }
    }
    Ok(())
}

fn channels(text: &mut String, plan: &PortPlan) -> std::fmt::Result {
    writeln!(
        text,
        "\n{:<16}{:>10}{:>10}{:>12}{:>12}{:>22}",
        "channel", "sent", "received", "TX budget", "RX budget", "bus load"
    )?;
    for channel in &plan.channels {
        let load = channel.load;
        writeln!(
            text,
            "{:<16}{:>10}{:>10}{:>12}{:>12}{:>22}",
            format!("slave {} can{}", channel.slave, channel.channel),
            number(load.mean_sent),
            number(load.mean_received),
            channel.serve,
            channel.drain,
            format!("{:.1} to {:.1} %", load.least * 100.0, load.most * 100.0)
        )?;
    }
    writeln!(text, "frames per cycle; bus load without stuff bits, and with all possible ones")
}

fn number(value: f64) -> String {
    if value.fract() == 0.0 { format!("{value}") } else { format!("{value:.2}") }
}

fn images(text: &mut String, plan: &PortPlan) -> std::fmt::Result {
    writeln!(
        text,
        "\n{:<16}{:>8}{:>22}{:>26}",
        "image", "bytes", "packets (fullest)", "bytes in use (fullest)"
    )?;
    for (slave, gateway) in plan.gateways.iter().enumerate() {
        for image in [&gateway.rx, &gateway.tx] {
            let ImagePlan { direction, mean, peak, .. } = image;
            let both =
                |of: fn(&ImageFill) -> f64| format!("{} ({})", number(of(mean)), number(of(peak)));
            writeln!(
                text,
                "{:<16}{:>8}{:>22}{:>26}",
                format!("slave {slave} {direction}"),
                image.area_bytes(),
                both(|fill| fill.packets),
                both(|fill| fill.bytes)
            )?;
        }
    }
    Ok(())
}

/// Every kind of frame, with the packets of it that an image of its gateway could hold.
fn frames(text: &mut String, plan: &PortPlan, traffic: &[FrameStream]) -> std::fmt::Result {
    writeln!(text, "\n{:<16}{:<34}{:>12}{:>16}", "frame", "kind", "packet bytes", "per image")?;
    let mut printed = Vec::new();
    for stream in traffic {
        let Some(gateway) = plan.gateways.get(stream.slave) else { continue };
        let (image, direction) = match stream.way {
            FrameRoute::ToBus => (&gateway.rx, "out"),
            FrameRoute::FromBus => (&gateway.tx, "in"),
            FrameRoute::OnBusOnly => continue,
        };
        let is_scheduled = stream.schedule_offset_ns.is_some();
        let frame = stream.frame.as_ref();
        let line = format!(
            "{:<16}{:<34}{:>12}{:>16}",
            format!("slave {} {direction}", stream.slave),
            kind(&stream.frame),
            image.packet_bytes(frame, is_scheduled),
            image.frames_per_image(frame, is_scheduled)
        );
        if !printed.contains(&line) {
            writeln!(text, "{line}")?;
            printed.push(line);
        }
    }
    writeln!(text, "an image holds {MAX_PACKETS} packets at most")
}

fn kind(frame: &CanFrame) -> String {
    let id = if frame.id().is_extended() { "29 bit" } else { "11 bit" };
    let format = match frame.kind() {
        FrameKind::Data => "classic",
        FrameKind::Remote => "remote",
        FrameKind::Fd { brs: true, .. } => "FD with BRS",
        FrameKind::Fd { brs: false, .. } => "FD",
    };
    format!("{format}, {id}, {} bytes", frame.len())
}

/// When scheduled frames leave: those of the traffic, or what the manual begins with. Times count
/// from the point of the cycle grid, by the configuration of each gateway.
fn schedules(text: &mut String, plan: &PortPlan, traffic: &[FrameStream]) -> std::fmt::Result {
    let mut offsets: Vec<(usize, u32)> =
        traffic.iter().filter_map(|s| Some((s.slave, s.schedule_offset_ns?))).collect();
    if offsets.is_empty() {
        let all = 0..plan.ethercat.slaves.len();
        offsets = all.map(|slave| (slave, RECOMMENDED_OFFSET_NS)).collect();
    }
    offsets.sort_unstable();
    offsets.dedup();
    let margins = offsets.into_iter().filter_map(|(slave, offset_ns)| {
        Some((slave, offset_ns, plan.schedule_margin(slave, offset_ns).ok()?))
    });
    let mut margins = margins.peekable();
    if margins.peek().is_none() {
        return Ok(());
    }
    writeln!(
        text,
        "\n{:<16}{:>14}{:>12}{:>12}{:>12}{:>12}{:>12}",
        "scheduled", "after Sync0", "image from", "to", "Sync0 at", "leaves at", "margin"
    )?;
    for (slave, offset_ns, margin) in margins {
        writeln!(
            text,
            "{:<16}{:>14}{:>12}{:>12}{:>12}{:>12}{:>12}",
            format!("slave {slave}"),
            us(offset_ns.into()),
            us(margin.earliest_arrival_ns),
            us(margin.latest_arrival_ns),
            us(margin.pulse_ns),
            us(margin.release_ns),
            format!("{:.1} us", margin.least_ns() as f64 / 1e3)
        )?;
    }
    writeln!(
        text,
        "after the start of a cycle; images until then with what is allowed for waking up and work"
    )
}
