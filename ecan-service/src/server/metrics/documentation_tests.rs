//! docs/SERVICE.md and the dashboard of Grafana against the declared metrics.

use std::collections::BTreeSet;
use std::fs;

use serde_json::Value;

use super::declared::{Metric, MetricKind, Source, metrics};
use super::sample::BOUNDS_NS;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Series of a metric: their number, and per slave, channel or axis, or nothing.
fn series(metric: &Metric) -> (usize, &'static str) {
    match metric.source {
        Source::Build | Source::Service(_) | Source::Bus(_) | Source::Cycle(_) => (1, ""),
        Source::AlState(states) => (states.len(), ""),
        // The bucket +Inf, the sum and the count.
        Source::Times(_) => (BOUNDS_NS.len() + 3, ""),
        Source::Address | Source::Slave(_) | Source::SlaveCount(_) => (1, "slave"),
        Source::Session(states) => (states.len(), "slave"),
        Source::Channel(_)
        | Source::ChannelPending(_)
        | Source::ChannelCount(_)
        | Source::Object { .. } => (1, "channel"),
        Source::ChannelState(states) => (states.len(), "channel"),
        Source::Axis(_) => (1, "axis"),
    }
}

fn total() -> String {
    let of = |owner: &str| -> usize {
        metrics().map(series).filter(|found| found.1 == owner).map(|found| found.0).sum()
    };
    let (service, slave, channel, axis) = (of(""), of("slave"), of("channel"), of("axis"));
    format!("{service} + {slave} * slaves + {channel} * channels + {axis} * axes")
}

#[test]
fn document_states_the_number_of_series() {
    let path = format!("{ROOT}/docs/SERVICE.md");
    let document = fs::read_to_string(&path).unwrap();
    assert!(document.contains(&total()), "{path} needs this text: {}", total());
}

/// Names that begin with `ecan_` in a text.
fn names(text: &str) -> BTreeSet<&str> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    text.split(|c| !is_part(c)).filter(|name| name.starts_with("ecan_")).collect()
}

/// Queries of a dashboard: every member `expr`, `query` and `definition`.
fn queries<'a>(value: &'a Value, found: &mut Vec<&'a str>) {
    match value {
        Value::Array(items) => items.iter().for_each(|item| queries(item, found)),
        Value::Object(members) => {
            for (key, member) in members {
                match member {
                    Value::String(text) if ["expr", "query", "definition"].contains(&&**key) => {
                        found.push(text);
                    }
                    member => queries(member, found),
                }
            }
        }
        _ => {}
    }
}

#[test]
fn queries_of_the_dashboard_use_declared_metrics_and_labels() {
    let text = fs::read_to_string(format!("{ROOT}/examples/grafana/ecan-lite.json")).unwrap();
    let dashboard: Value = serde_json::from_str(&text).unwrap();
    let mut expressions = Vec::new();
    queries(&dashboard, &mut expressions);
    assert!(expressions.len() > 10, "{expressions:?}");
    let mut labels: BTreeSet<_> = metrics().flat_map(Metric::labels).copied().collect();
    labels.extend(["le", "instance", "job"]);
    let mut used = BTreeSet::new();
    for expression in expressions {
        for name in names(expression) {
            let metric = metrics().find(|metric| match metric.kind() {
                MetricKind::Histogram => ["_bucket", "_sum", "_count"]
                    .iter()
                    .any(|end| name.strip_suffix(end) == Some(metric.name)),
                _ => name == metric.name,
            });
            used.insert(metric.unwrap_or_else(|| panic!("{name} in {expression}")).name);
        }
        // Matchers and groupings: `label=`, `label=~`, `by (a, b)`.
        let matched = expression.match_indices('=').filter_map(|(at, _)| {
            expression[..at].trim_end_matches(['!', '=']).rsplit(['{', ',', ' ']).next()
        });
        let grouped = expression.split("by (").skip(1).filter_map(|rest| rest.split(')').next());
        let grouped = grouped.flat_map(|list| list.split(", "));
        for label in matched.chain(grouped).filter(|label| !label.is_empty()) {
            assert!(labels.contains(label), "label {label} in {expression}");
        }
    }
    assert!(used.len() > 15, "{used:?}");
}

#[test]
fn names_are_unique_and_have_a_text() {
    let mut seen = BTreeSet::new();
    for metric in metrics() {
        assert!(seen.insert(metric.name), "{}", metric.name);
        assert!(metric.help.ends_with('.'), "{}: {}", metric.name, metric.help);
    }
}
