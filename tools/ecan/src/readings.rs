//! Values of one slave, some of which may be missing: other firmware versions have other entries.

use ecan_host::Error;

use crate::context::{Failure, Result};

#[derive(Debug, Default)]
pub struct Readings {
    read: usize,
    unanswered: usize,
    first: Option<Failure>,
}

impl Readings {
    /// Counts a result; returns the value or the reason why it is missing.
    pub fn note<T>(&mut self, reading: Result<T>) -> Result<T, String> {
        let failure = match reading {
            Ok(value) => {
                self.read += 1;
                return Ok(value);
            }
            Err(failure) => failure,
        };
        let reason = match &failure {
            Failure::Device(Error::Sdo { abort_code: Some(code), .. }) => code.to_string(),
            Failure::Device(Error::Sdo { errno, .. }) => {
                self.unanswered += 1;
                errno.to_string()
            }
            other => {
                self.unanswered += 1;
                other.to_string()
            }
        };
        self.first.get_or_insert(failure);
        Err(reason)
    }

    /// Checks whether to continue: each request to a slave that does not respond takes as long as
    /// the mailbox timeout of the master.
    pub fn answers(&mut self) -> Result {
        match self.first.take_if(|_| self.read == 0 && self.unanswered > 0) {
            Some(first) => Err(first),
            None => Ok(()),
        }
    }

    /// Checks whether there is anything to print.
    pub fn any(&mut self) -> Result {
        match self.first.take() {
            Some(first) if self.read == 0 => Err(first),
            _ => Ok(()),
        }
    }

    /// Checks whether the slave responded to every request, at least with an abort code.
    pub fn end(&self) -> Result {
        match self.unanswered {
            0 => Ok(()),
            1 => Err(Failure::Rejected("1 value was not read; see above".to_owned())),
            more => Err(Failure::Rejected(format!("{more} values were not read; see above"))),
        }
    }
}

pub fn not_read(reason: &str) -> String {
    format!("not read: {reason}")
}
