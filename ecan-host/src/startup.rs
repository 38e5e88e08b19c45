//! The startup steps of a slave, in the order that the gateway needs.
//!
//! The master sends its registered startup SDOs before it writes the PDO assignment itself, but
//! applying a PDO profile needs the assignment in place (manual 5.4.2). So the list begins with
//! the assignment, and the steps of the configuration follow; only checks that come first in the
//! configuration stay first, since capabilities are read before anything is chosen (manual 14).

use std::fmt;

use ecan_protocol::config::assignment_writes;
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::SdoWrite;

use crate::config::SlaveConfig;
use crate::diagnostics::Diagnostics;
use crate::error::Error;

/// What an object must read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expectation {
    /// Exactly this value.
    Equals(u32),
    /// At least this value.
    AtLeast(u32),
    /// At most this value.
    AtMost(u32),
    /// All of these bits, whatever the others are.
    HasBits(u32),
    /// At least one of these bits.
    HasAny(u32),
    /// One of these values.
    OneOf(&'static [u32]),
}

impl Expectation {
    /// Whether `value` meets the expectation.
    pub fn is_met_by(self, value: u32) -> bool {
        match self {
            Self::Equals(wanted) => value == wanted,
            Self::AtLeast(least) => value >= least,
            Self::AtMost(most) => value <= most,
            Self::HasBits(bits) => value & bits == bits,
            Self::HasAny(bits) => value & bits != 0,
            Self::OneOf(values) => values.contains(&value),
        }
    }
}

impl fmt::Display for Expectation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Equals(wanted) => write!(f, "{wanted}"),
            Self::AtLeast(least) => write!(f, "at least {least}"),
            Self::AtMost(most) => write!(f, "at most {most}"),
            Self::HasBits(bits) => write!(f, "the bits 0x{bits:X}"),
            Self::HasAny(bits) => write!(f, "one of the bits 0x{bits:X}"),
            Self::OneOf(values) => write!(f, "one of {values:?}"),
        }
    }
}

/// One step of a slave's startup, run in PREOP.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StartupStep {
    /// Writes an object. Registered with the master too, so that it is sent again whenever the
    /// slave is configured anew.
    Download(SdoWrite),
    /// Reads an object and refuses to go on with another value: a capability, or the readback of
    /// an apply command. Runs when the Adapter configures the slave, not when the master does so
    /// by itself after a loss.
    Expect {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// What it must read.
        expected: Expectation,
    },
}

impl StartupStep {
    /// A step that expects an object to read `value`.
    pub fn expect(index: u16, subindex: u8, value: u32) -> Self {
        Self::Expect { index, subindex, expected: Expectation::Equals(value) }
    }

    /// Index and subindex of the object.
    pub fn object(&self) -> (u16, u8) {
        match self {
            Self::Download(sdo) => (sdo.index, sdo.subindex),
            Self::Expect { index, subindex, .. } => (*index, *subindex),
        }
    }

    /// Whether the step writes.
    pub fn is_download(&self) -> bool {
        matches!(self, Self::Download(_))
    }
}

impl SlaveConfig {
    /// The complete startup sequence of this slave, in the order in which the Adapter runs it: the
    /// checks that come first, the PDO assignment from N, what the layer above needs, what the
    /// application adds (manual 5.4.3).
    ///
    /// Allocates; not for the cycle.
    pub fn startup_steps(&self) -> Vec<StartupStep> {
        startup_list(self)
    }
}

/// The whole list for a slave: leading checks, RxPDO and TxPDO assignment, the other steps.
pub(crate) fn startup_list(slave: &SlaveConfig) -> Vec<StartupStep> {
    let base = &slave.base_startup;
    let leading = base.iter().take_while(|step| !step.is_download()).count();
    let (checks, others) = base.split_at(leading);
    let mut steps = Vec::with_capacity(base.len() + slave.startup.len() + 52);
    steps.extend_from_slice(checks);
    let rx = assignment_writes(Direction::RxPdo, slave.rx_multiplier);
    let tx = assignment_writes(Direction::TxPdo, slave.tx_multiplier);
    steps.extend(rx.chain(tx).map(StartupStep::Download));
    steps.extend_from_slice(others);
    steps.extend_from_slice(&slave.startup);
    steps
}

/// Number of downloads that the master sends to a slave at start-up.
pub(crate) fn download_count(slave: &SlaveConfig) -> usize {
    startup_list(slave).iter().filter(|step| step.is_download()).count()
}

/// Runs steps with blocking transfers.
pub(crate) fn run_steps(
    diagnostics: &Diagnostics,
    slave: usize,
    steps: &[StartupStep],
) -> Result<(), Error> {
    for step in steps {
        match *step {
            StartupStep::Download(sdo) => {
                let (bytes, length) = sdo.bytes();
                let data = bytes.get(..length).unwrap_or_default();
                diagnostics.sdo_download(slave, sdo.index, sdo.subindex, data)?;
            }
            StartupStep::Expect { index, subindex, expected } => {
                let found = diagnostics.sdo_upload_u32(slave, index, subindex)?;
                if !expected.is_met_by(found) {
                    return Err(Error::Readback { slave, index, subindex, expected, found });
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_protocol::object::ObjectType;

    #[test]
    fn leading_checks_then_the_assignment_of_the_manual_then_the_rest() {
        let mut slave = SlaveConfig::at(0, 3);
        slave.tx_multiplier = 1;
        let apply = SdoWrite { index: 0x8010, subindex: 1, value: 1, ty: ObjectType::U8 };
        slave.base_startup =
            vec![StartupStep::expect(0xF000, 17, 128), StartupStep::Download(apply)];
        slave.startup = vec![StartupStep::expect(0x8010, 2, 0)];
        let list: Vec<(u16, u8, Option<u32>)> = startup_list(&slave)
            .iter()
            .map(|step| {
                let (index, subindex) = step.object();
                let value = match step {
                    StartupStep::Download(sdo) => Some(sdo.value),
                    StartupStep::Expect { .. } => None,
                };
                (index, subindex, value)
            })
            .collect();
        assert_eq!(
            list,
            [
                (0xF000, 17, None),
                (0x1C12, 0, Some(0)),
                (0x1C12, 1, Some(0x1600)),
                (0x1C12, 2, Some(0x1601)),
                (0x1C12, 3, Some(0x1602)),
                (0x1C12, 0, Some(3)),
                (0x1C13, 0, Some(0)),
                (0x1C13, 1, Some(0x1A00)),
                (0x1C13, 0, Some(1)),
                (0x8010, 1, Some(1)),
                (0x8010, 2, None),
            ]
        );
    }

    #[test]
    fn expectations_judge_values() {
        assert!(Expectation::AtLeast(3).is_met_by(3) && !Expectation::AtLeast(3).is_met_by(2));
        assert!(Expectation::AtMost(3).is_met_by(3) && !Expectation::AtMost(3).is_met_by(4));
        assert!(
            Expectation::HasBits(0x12).is_met_by(0x1F) && !Expectation::HasBits(2).is_met_by(1)
        );
    }
}
