//! Axes as text.

use std::io::Write;

use ecan_service::protocol::AxisState;

use super::snapshot::AxesView;
use crate::table;

pub const AXIS_TITLES: [&str; 10] =
    ["bus", "node", "phase", "mode", "target", "actual", "following", "heartbeat", "SW", "error"];

pub fn axis_cells(axis: &AxisState) -> [String; 10] {
    [
        format!("{}.{}", axis.gateway, axis.channel),
        axis.node_id.to_string(),
        axis.phase.clone(),
        axis.mode.clone(),
        optional(axis.target),
        optional(axis.actual),
        optional(axis.following_error),
        heartbeat(axis).to_owned(),
        axis.statusword.map_or_else(none, |word| format!("0x{word:04X}")),
        error(axis).unwrap_or_default(),
    ]
}

fn none() -> String {
    "-".to_owned()
}

fn optional<T: ToString>(value: Option<T>) -> String {
    value.map_or_else(none, |value| value.to_string())
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
    let AxisState { gateway, channel, node_id, phase, elapsed_ns, .. } = axis;
    let drive = match (axis.statusword, &axis.drive_state) {
        (Some(word), Some(state)) => format!("drive {state} (statusword 0x{word:04X})"),
        (Some(word), None) => format!("drive in an unknown state (statusword 0x{word:04X})"),
        (None, _) => "no statusword received".to_owned(),
    };
    let actual = match (axis.actual, axis.actual_degrees, axis.actual_age) {
        (None, ..) => "no actual position received".to_owned(),
        (Some(actual), degrees, age) => {
            let degrees = degrees.map_or_else(String::new, |it| format!(" ({it:.3} degrees)"));
            let age = match age {
                0 => String::new(),
                u16::MAX => ", age above 65534 cycles".to_owned(),
                age => format!(", age {age} cycles"),
            };
            format!("actual {actual} steps{degrees}{age}")
        }
    };
    // The phase usually has them.
    let reason = |name: &str, text: &Option<String>| {
        let text = text.as_ref().filter(|text| !phase.contains(text.as_str()))?;
        Some(format!("{name}: {text}"))
    };
    let nmt = axis.nmt_state.as_deref().unwrap_or("unknown");
    let elapsed_s = *elapsed_ns as f64 / 1e9;
    let (target, following) = (optional(axis.target), optional(axis.following_error));
    let lines = [
        Some(format!(
            "gateway {gateway} can{channel} node {node_id}, for {elapsed_s:.1} s: {phase}"
        )),
        error(axis).map(|text| format!("error: {text}")),
        Some(format!("{drive}, NMT {nmt}, heartbeat {}", axis.heartbeat)),
        Some(actual),
        Some(format!("target {target}, following error {following}")),
        reason("hold", &axis.hold_reason),
        reason("stop", &axis.stop_cause),
    ];
    lines.into_iter().flatten().collect()
}

pub fn print(out: &mut dyn Write, view: &AxesView) -> std::io::Result<()> {
    if let Some(reason) = &view.without_axes {
        return writeln!(out, "{reason}");
    }
    table::print_with_titles(out, AXIS_TITLES, &view.axes, axis_cells)
}
