//! The slaves that IgH's tool lists.

use std::time::Duration;

use super::execution::PROGRAM_LIMIT;
use super::{Bench, Kind};
use crate::child::Running;
use crate::stop::Stop;

/// Time limit for the master to find the slaves.
const SCAN_LIMIT: Duration = Duration::from_secs(60);

/// A slave in the list of IgH's tool.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ListedSlave {
    pub state: String,
    pub has_error: bool,
    pub name: String,
}

impl Bench {
    /// The slaves that IgH's tool lists.
    pub fn listed_slaves(&mut self) -> Result<Vec<ListedSlave>, Stop> {
        let command = self.ethercat(["slaves"]);
        let running = Running::start(command, &self.interrupt)?;
        let finished = running.finish(self.limit(PROGRAM_LIMIT))?.expect(0)?;
        Ok(finished.output().lines().filter_map(ListedSlave::parse).collect())
    }

    /// Waits until the master lists these slaves, all in PREOP or above.
    pub fn wait_for_slaves(&mut self, count: u16) -> Result<(), Stop> {
        let mut last = Vec::new();
        let found = self.poll("the master lists the slaves", SCAN_LIMIT, |bench| {
            last = bench.listed_slaves()?;
            let is_up = |slave: &ListedSlave| slave.is_up();
            let is_expected = last.len() == usize::from(count)
                // Other slaves may be connected too.
                || bench.kind == Kind::Device && last.len() > usize::from(count);
            let is_complete = is_expected && last.iter().all(is_up);
            Ok(is_complete.then_some(()))
        });
        match found {
            Err(Stop::Failed(message)) => {
                Err(Stop::Failed(format!("{message}: expected {count}, listed {last:?}")))
            }
            other => other,
        }
    }
}

impl ListedSlave {
    /// Returns whether it is in PREOP or above, without an error.
    fn is_up(&self) -> bool {
        !self.has_error && ["PREOP", "SAFEOP", "OP"].contains(&self.state.as_str())
    }

    /// A line of `ethercat slaves`: `0  0:0  PREOP  +  ECAN-Lite`.
    fn parse(line: &str) -> Option<Self> {
        let mut words = line.split_whitespace();
        let _position: u16 = words.next()?.parse().ok()?;
        let _address = words.next()?;
        let (state, flag) = (words.next()?.to_owned(), words.next()?);
        let name = words.collect::<Vec<_>>().join(" ");
        Some(Self { state, has_error: flag == "E", name })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_the_tool_are_parsed() {
        let slave = ListedSlave::parse("1  5555:1  SAFEOP+ERROR  E  ECAN Lite").unwrap();
        assert_eq!(
            slave,
            ListedSlave { state: "SAFEOP+ERROR".into(), has_error: true, name: "ECAN Lite".into() }
        );
        assert_eq!(ListedSlave::parse("no slaves"), None);
    }
}
