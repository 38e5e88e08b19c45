//! Telling the user when a gateway goes out of service or comes back.

use ecan_mcan_port::{Port, Session};

/// Remembers the sessions as last seen.
#[derive(Debug)]
pub struct SessionWatch {
    seen: Vec<Session>,
}

impl SessionWatch {
    /// Starts with the sessions as they are.
    pub fn new(port: &Port) -> Self {
        Self { seen: port.gateways().map(|gateway| port.session(gateway)).collect() }
    }

    /// One line for every gateway whose session changed since the last call.
    pub fn changes(&mut self, port: &Port) -> Vec<String> {
        let mut lines = Vec::new();
        for (gateway, seen) in port.gateways().zip(&mut self.seen) {
            let now = port.session(gateway);
            if *seen != now {
                *seen = now;
                lines.push(format!("{gateway}: {now}"));
            }
        }
        lines
    }
}
