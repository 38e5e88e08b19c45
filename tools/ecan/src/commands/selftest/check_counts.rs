//! Result of the frames of one route.

use super::exchange::{ChannelCounters, ChannelState, Counts, Route};
use super::steps::TestPath;

/// Result of a route; `states` are those of its channels before and after.
pub(super) fn check_counts(
    path: TestPath,
    route: Route,
    counts: &Counts,
    expected: u16,
    states: &[&(ChannelCounters, ChannelState)],
) -> Result<String, String> {
    let mut faults = Vec::new();
    let came = counts.received + counts.wrong;
    if came < u32::from(expected) {
        let why = missing(path, route, states).map_or_else(String::new, |why| format!(" ({why})"));
        faults.push(format!("{came} of {expected} frames received{why}"));
    }
    if let Some(first) = &counts.first_wrong {
        faults.push(format!("{} frames received with errors, the first: {first}", counts.wrong));
    }
    if counts.repeated > 0 {
        faults.push(format!("{} frames received twice", counts.repeated));
    }
    if counts.strange > 0 {
        let (to, strange) = (route.to, counts.strange);
        let detail = "from another sender; check for other nodes on its bus";
        faults.push(format!("channel {to} received {strange} frames {detail}"));
    }
    faults.extend(states.iter().flat_map(|(before, after)| after.faults(before)));
    match faults.is_empty() {
        true if came == 1 => Ok("1 frame, no errors".to_owned()),
        true => Ok(format!("{came} frames, no errors")),
        false => Err(faults.join("; ")),
    }
}

fn missing(
    path: TestPath,
    Route { from, to }: Route,
    states: &[&(ChannelCounters, ChannelState)],
) -> Option<String> {
    let (_, sender) = states.iter().find(|(_, state)| state.channel == from)?;
    (path == TestPath::Wire && sender.is_unheard()).then(|| {
        format!("no acknowledgement; check the wiring from channel {from} to channel {to} and its termination")
    })
}
