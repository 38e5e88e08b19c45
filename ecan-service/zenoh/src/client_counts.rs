//! What remote clients have requested, for the operator of the machine.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::time::Instant;

use serde::Serialize;

use crate::frame_batches::FrameBatches;

/// Requests of remote clients that the publisher rejected since its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RejectedRequests {
    /// Requests and frames that were late.
    pub late: u64,
    /// Requests that exceeded a limit of the publisher.
    pub full: u64,
}

/// Clients that are remembered; the one that is idle for the longest time is forgotten.
const MAX_CLIENTS: usize = 64;

/// Counters of the clients by their names.
#[derive(Debug, Default)]
pub(crate) struct ClientCounts {
    clients: BTreeMap<String, Counts>,
}

#[derive(Debug, Clone, Copy)]
struct Counts {
    requests: u64,
    frames: u64,
    rejected: u64,
    seen: Instant,
    is_reported: bool,
}

/// A client in the answer to `get PREFIX/clients`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct CountedClient {
    client: String,
    /// Requests, those included that were rejected.
    requests: u64,
    /// Frames that it was permitted to send.
    frames: u64,
    /// Requests beyond a limit.
    rejected: u64,
    subscriptions: usize,
    /// Time since its last request.
    idle_ms: u64,
}

impl ClientCounts {
    fn of(&mut self, client: &str) -> &mut Counts {
        if !self.clients.contains_key(client) && self.clients.len() == MAX_CLIENTS {
            let idle = self.clients.iter().min_by_key(|(_, counts)| counts.seen);
            let name = idle.map(|(name, _)| name.clone()).unwrap_or_default();
            self.clients.remove(&name);
        }
        let (seen, is_reported) = (Instant::now(), false);
        let new = Counts { requests: 0, frames: 0, rejected: 0, seen, is_reported };
        self.clients.entry(client.to_owned()).or_insert(new)
    }

    pub(crate) fn count_request(&mut self, client: &str) {
        let counts = self.of(client);
        (counts.requests, counts.seen) = (counts.requests + 1, Instant::now());
    }

    pub(crate) fn count_frames(&mut self, client: &str, frames: usize) {
        self.of(client).frames += frames as u64;
    }

    pub(crate) fn count_rejected(&mut self, client: &str) {
        self.of(client).rejected += 1;
    }

    /// A client that was not reported yet.
    pub(crate) fn take_new(&mut self) -> Option<String> {
        let (name, counts) = self.clients.iter_mut().find(|(_, counts)| !counts.is_reported)?;
        counts.is_reported = true;
        Some(name.clone())
    }

    pub(crate) fn list(&self, batches: &FrameBatches) -> Vec<CountedClient> {
        let client = |(client, counts): (&String, &Counts)| CountedClient {
            client: client.clone(),
            requests: counts.requests,
            frames: counts.frames,
            rejected: counts.rejected,
            subscriptions: batches.subscriptions_of(client),
            idle_ms: u64::try_from(counts.seen.elapsed().as_millis()).unwrap_or(u64::MAX),
        };
        self.clients.iter().map(client).collect()
    }

    /// The text form of Prometheus. Names of clients need no escape: they are letters, digits and `-_.@`.
    pub(crate) fn metrics(&self, batches: &FrameBatches, rejected: RejectedRequests) -> String {
        let clients = self.list(batches);
        let (published, lost, connections) = batches.totals();
        let mut text = String::new();
        let mut add = |name: &str, kind: &str, help: &str, values: &[(String, u64)]| {
            let name = format!("ecan_zenoh_{name}");
            let _ = write!(text, "# HELP {name} {help}\n# TYPE {name} {kind}\n");
            for (labels, value) in values {
                let _ = writeln!(text, "{name}{labels} {value}");
            }
        };
        let one = |value: u64| [(String::new(), value)];
        let labelled = |label: &str, of: &str, value: u64| (format!("{{{label}=\"{of}\"}}"), value);
        let of_clients = |value: fn(&CountedClient) -> u64| -> Vec<_> {
            clients.iter().map(|client| labelled("client", &client.client, value(client))).collect()
        };
        let help = "Frame records of all channels.";
        add("frames_published_total", "counter", help, &one(published));
        add("frames_lost_total", "counter", "Frames that the publisher lost.", &one(lost));
        add("connections_total", "counter", "Connections to the service.", &one(connections));
        let help = "Requests and frames that were late, and requests beyond a limit.";
        let reasons = [("late", rejected.late), ("limit", rejected.full)];
        let values = reasons.map(|(reason, count)| labelled("reason", reason, count));
        add("requests_rejected_total", "counter", help, &values);
        let values = of_clients(|client| client.requests);
        add("client_requests_total", "counter", "Requests of a remote client.", &values);
        let help = "Frames that a remote client was permitted to send.";
        add("client_frames_total", "counter", help, &of_clients(|client| client.frames));
        let values = of_clients(|client| client.subscriptions as u64);
        add("client_subscriptions", "gauge", "Subscriptions of a remote client.", &values);
        let help = "Time since the last request of a remote client.";
        add("client_idle_milliseconds", "gauge", help, &of_clients(|client| client.idle_ms));
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clients_are_counted_reported_once_and_bounded() {
        let mut counts = ClientCounts::default();
        counts.count_request("hmi");
        counts.count_request("hmi");
        counts.count_frames("hmi", 3);
        counts.count_rejected("scada");
        let batches = FrameBatches::default();
        let list = counts.list(&batches);
        let numbers: Vec<_> = list
            .iter()
            .map(|client| (&client.client[..], client.requests, client.frames, client.rejected))
            .collect();
        assert_eq!(numbers, [("hmi", 2, 3, 0), ("scada", 0, 0, 1)]);
        let reported: Vec<_> = std::iter::from_fn(|| counts.take_new()).collect();
        assert_eq!(reported, ["hmi", "scada"]);
        (0..2 * MAX_CLIENTS).for_each(|number| counts.count_request(&format!("c{number}")));
        assert_eq!(counts.clients.len(), MAX_CLIENTS);
        assert!(!counts.clients.contains_key("hmi"));
    }

    #[test]
    fn metrics_have_a_type_and_a_label_for_each_client() {
        let mut counts = ClientCounts::default();
        counts.count_request("operator");
        let rejected = RejectedRequests { late: 4, full: 1 };
        let text = counts.metrics(&FrameBatches::default(), rejected);
        for line in [
            "# TYPE ecan_zenoh_client_requests_total counter",
            "ecan_zenoh_client_requests_total{client=\"operator\"} 1",
            "ecan_zenoh_requests_rejected_total{reason=\"late\"} 4",
            "ecan_zenoh_frames_published_total 0",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
    }
}
