//! Steps that a gateway waits for until it is ready.

use std::fmt;

use crate::session::verification::SdoTransfer;

/// Step that a gateway waits for until it is ready.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PendingStep {
    /// A configuration of the Port that has the gateway.
    Configuration,
    /// The slave does not answer at its address.
    Answer,
    /// The master does not see the slave in OP.
    Operational,
    /// The slave stays in one state below OP. The master stops a startup when one of its SDOs or a
    /// change of state fails. The Port requests another one at increasing intervals; on an attached
    /// Adapter the owner of the master does, and before version 1.6 of the library, where the request
    /// may block, the application with [`Port::retry_startup`](crate::Port::retry_startup) while
    /// other gateways are ready. If requests do not help, [`Port::reconfigure`](crate::Port::reconfigure) also sets its
    /// distributed clock again.
    StartupRetry,
    /// The slave is in OP, but the delivery of its outputs is not confirmed.
    ProcessData,
    /// Another slave exchanges the same process data: it had this position while a branch of the bus
    /// was away, until the master configures it again.
    ExclusiveProcessData,
    /// A transfer of the verification.
    Transfer(SdoTransfer),
    /// A transfer of an earlier attempt that the master has not ended.
    EarlierTransfer(SdoTransfer),
    /// The next attempt, after a failed one.
    NextAttempt,
}

impl PendingStep {
    /// Number of the step and its transfer in 40 bits, 0 for none.
    pub(crate) fn encode(step: Option<Self>) -> u64 {
        let transfer = |code: u64, it: SdoTransfer| {
            let direction = u64::from(it.is_download) << 32;
            code | u64::from(it.index) << 8 | u64::from(it.subindex) << 24 | direction
        };
        match step {
            None => 0,
            Some(Self::Configuration) => 1,
            Some(Self::Answer) => 2,
            Some(Self::Operational) => 3,
            Some(Self::StartupRetry) => 4,
            Some(Self::ProcessData) => 5,
            Some(Self::ExclusiveProcessData) => 6,
            Some(Self::NextAttempt) => 7,
            Some(Self::Transfer(it)) => transfer(8, it),
            Some(Self::EarlierTransfer(it)) => transfer(9, it),
        }
    }

    /// The step of [`encode`](Self::encode).
    pub(crate) fn decode(code: u64) -> Option<Self> {
        let transfer = SdoTransfer {
            index: (code >> 8) as u16,
            subindex: (code >> 24) as u8,
            is_download: code >> 32 & 1 == 1,
        };
        match code as u8 {
            1 => Some(Self::Configuration),
            2 => Some(Self::Answer),
            3 => Some(Self::Operational),
            4 => Some(Self::StartupRetry),
            5 => Some(Self::ProcessData),
            6 => Some(Self::ExclusiveProcessData),
            7 => Some(Self::NextAttempt),
            8 => Some(Self::Transfer(transfer)),
            9 => Some(Self::EarlierTransfer(transfer)),
            _ => None,
        }
    }
}

impl fmt::Display for PendingStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Configuration => f.write_str("a reconfiguration of the Port that includes it"),
            Self::Answer => {
                f.write_str("the slave to answer at its address; check its power and the cables")
            }
            Self::Operational => f.write_str("OP"),
            Self::StartupRetry => f.write_str(
                "another attempt of its startup: it stays in one state below OP; see the kernel log",
            ),
            Self::ProcessData => f.write_str("its process data to arrive"),
            Self::ExclusiveProcessData => {
                f.write_str("another slave to leave its process data (working counter too high)")
            }
            Self::Transfer(transfer) => write!(f, "the {transfer}"),
            Self::EarlierTransfer(transfer) => {
                write!(f, "the master to end the {transfer} of an earlier attempt")
            }
            Self::NextAttempt => f.write_str("the next attempt"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn step_is_decoded_as_encoded() {
        let download = SdoTransfer { index: 0x8010, subindex: 8, is_download: true };
        let upload = SdoTransfer { index: 0xFFFF, subindex: 255, is_download: false };
        let steps = [
            None,
            Some(PendingStep::Configuration),
            Some(PendingStep::Answer),
            Some(PendingStep::Operational),
            Some(PendingStep::StartupRetry),
            Some(PendingStep::ProcessData),
            Some(PendingStep::ExclusiveProcessData),
            Some(PendingStep::NextAttempt),
            Some(PendingStep::Transfer(download)),
            Some(PendingStep::EarlierTransfer(upload)),
        ];
        for step in steps {
            assert_eq!(PendingStep::decode(PendingStep::encode(step)), step);
        }
    }
}
