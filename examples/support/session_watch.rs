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
        Self { seen: (0..port.slave_count()).map(|slave| port.session(slave)).collect() }
    }

    /// One line for every gateway whose session changed since the last call.
    pub fn changes(&mut self, port: &Port) -> Vec<String> {
        let mut lines = Vec::new();
        for (slave, seen) in self.seen.iter_mut().enumerate() {
            let now = port.session(slave);
            if *seen != now {
                *seen = now;
                lines.push(format!("slave {slave}: {now}"));
            }
        }
        lines
    }
}
