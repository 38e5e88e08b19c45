//! Reports of gateways that were lost or became ready.

use ecan_mcan_port::{Port, Session};

/// Last reported session of each gateway.
#[derive(Debug)]
pub struct SessionWatch {
    reported: Vec<Session>,
}

impl SessionWatch {
    /// Starts with the present sessions.
    pub fn new(port: &Port) -> Self {
        Self { reported: port.gateways().map(|gateway| port.session(gateway)).collect() }
    }

    /// Returns a line for every gateway whose session changed since the last call.
    pub fn changes(&mut self, port: &Port) -> Vec<String> {
        let mut lines = Vec::new();
        for (gateway, reported) in port.gateways().zip(&mut self.reported) {
            let session = port.session(gateway);
            if *reported != session {
                *reported = session;
                lines.push(format!("{gateway}: {session}"));
            }
        }
        lines
    }
}
