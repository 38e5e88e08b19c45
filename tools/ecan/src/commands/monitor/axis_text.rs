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
    axis.details(error(axis))
}

pub fn print(out: &mut dyn Write, view: &AxesView) -> std::io::Result<()> {
    if let Some(reason) = &view.without_axes {
        return writeln!(out, "{reason}");
    }
    table::print_with_titles(out, AXIS_TITLES, &view.axes, axis_cells)
}
