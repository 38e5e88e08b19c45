//! Several values of one slave, of which some may be missing: another firmware version has other
//! entries, and that is no reason to tell nothing.

use ecan_host::Error;

use crate::failure::Failure;

/// What came of the readings so far.
#[derive(Debug, Default)]
pub struct Readings {
    read: usize,
    unanswered: usize,
    first: Option<Failure>,
}

impl Readings {
    /// The value, or why there is none.
    pub fn note<T>(&mut self, reading: Result<T, Failure>) -> Result<T, String> {
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

    /// Whether it makes sense to ask on: each question to a slave that is silent takes as long as
    /// the master waits for a mailbox.
    ///
    /// # Errors
    /// It has not answered yet: the reason.
    pub fn answers(&mut self) -> Result<(), Failure> {
        match self.first.take_if(|_| self.read == 0 && self.unanswered > 0) {
            Some(first) => Err(first),
            None => Ok(()),
        }
    }

    /// Whether there is anything to print.
    ///
    /// # Errors
    /// Nothing was read: the first reason.
    pub fn any(&mut self) -> Result<(), Failure> {
        match self.first.take() {
            Some(first) if self.read == 0 => Err(first),
            _ => Ok(()),
        }
    }

    /// Whether the slave answered, if only to refuse.
    ///
    /// # Errors
    /// [`Failure::Refused`] where it did not.
    pub fn end(&self) -> Result<(), Failure> {
        match self.unanswered {
            0 => Ok(()),
            1 => Err(Failure::Refused("1 value was not read, see above".to_owned())),
            more => Err(Failure::Refused(format!("{more} values were not read, see above"))),
        }
    }
}

/// The words in the place of a value.
pub fn not_read(reason: &str) -> String {
    format!("not read: {reason}")
}
