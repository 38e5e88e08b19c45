//! Checks before a gateway is ready, and their faults.

use std::fmt;

use ecan_host::{CycleError, Expectation, contradicted_assumption};
use ecan_protocol::config::{NodeMode, SessionCommand, session_command_write};
use ecan_protocol::device::{CCCR, Capabilities, ControllerMode, TEST};
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::{ObjectType, SdoWrite, describe};
use thiserror::Error;

use crate::config::GatewayConfig;

const STATUS_OK: u32 = 0;
/// Register service of the first channel.
const REGISTER_SERVICE: u16 = 0xA000;
/// Status of 0x8010 and 0x8011: master mapping reload required.
const MAPPING_RELOAD_REQUIRED: u32 = 5;

/// An SDO transfer of the verification.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SdoTransfer {
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// True if the transfer writes.
    pub is_download: bool,
}

impl fmt::Display for SdoTransfer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let direction = if self.is_download { "download" } else { "upload" };
        write!(f, "SDO {direction} of {}", describe(self.index, self.subindex))
    }
}

/// Fault that a verification of a gateway found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum VerificationFault {
    /// An object has another value than the configuration.
    #[error(
        "{} reads {found}, expected {expected}{}",
        describe(*index, *subindex), assumption(*index, *subindex, *found)
    )]
    Readback {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Expected value.
        expected: Expectation,
        /// Value read.
        found: u32,
    },
    /// Another gateway is at the configured address.
    #[error(
        "another gateway is at this address: serial number half {} is 0x{found:08X}, it was \
         0x{expected:08X}; positions shift while a branch of the bus is away, aliases do not",
        subindex - 6
    )]
    OtherGateway {
        /// Subindex of 0xF000, 7 or 8.
        subindex: u8,
        /// Value when the Port was opened.
        expected: u32,
        /// Value now.
        found: u32,
    },
    /// The layout CRC differs from the first verification, with the same profile.
    #[error("{} changed from 0x{recorded:08X} to 0x{found:08X}", describe(*index, 11))]
    LayoutCrc {
        /// 0x8010 or 0x8011.
        index: u16,
        /// The value of the first verification.
        recorded: u32,
        /// The value now.
        found: u32,
    },
    /// The controller of a channel that must only listen is in another mode, by its registers.
    #[error("node mode 1 puts channel {channel} into {mode}, not into listen-only (assumption H9)")]
    NodeMode {
        /// CAN channel, 0 to 3.
        channel: u8,
        /// Mode of its controller.
        mode: ControllerMode,
    },
    /// The mode of a channel that must only listen was not read: the register service is busy, or
    /// another program used it at the same time.
    #[error(
        "the register service of channel {channel} (0x{:04X}) is busy or used by another program",
        REGISTER_SERVICE + u16::from(*channel)
    )]
    RegisterServiceInUse {
        /// CAN channel, 0 to 3.
        channel: u8,
    },
    /// A transfer failed.
    #[error("{0} failed")]
    Transfer(SdoTransfer),
    /// The slave is in OP, but exchanges other process data than its own: those of a slave whose
    /// position it had while a branch of the bus was away. It was taken out of OP, so that the master
    /// configures it again.
    #[error("its process data go to another gateway; the master configures it again")]
    ProcessData,
    /// The master keeps a request busy beyond its timeout. Until it ends the request, every attempt
    /// fails with this fault.
    #[error("the master has not ended the {transfer} for {waited_ms} ms")]
    Unended {
        /// Transfer of the request, begun by this attempt or an earlier one.
        transfer: SdoTransfer,
        /// Time since its start, in milliseconds.
        waited_ms: u64,
    },
    /// The master library rejected a request.
    #[error(transparent)]
    Library(CycleError),
}

impl VerificationFault {
    /// Returns whether the gateway answered with a value that is not the configured one.
    pub(crate) fn is_of_the_device(self) -> bool {
        matches!(
            self,
            Self::Readback { .. }
                | Self::OtherGateway { .. }
                | Self::LayoutCrc { .. }
                | Self::NodeMode { .. }
        )
    }
}

/// The assumption that a value contradicts, and the remedy.
fn assumption(index: u16, subindex: u8, found: u32) -> &'static str {
    let is_profile = Direction::ALL.iter().any(|direction| direction.profile_object() == index);
    if is_profile && subindex == 2 && found == MAPPING_RELOAD_REQUIRED {
        " (assumption H41: it requires another apply after the master rewrote the PDO assignment, which OP does not \
         permit; clear \"enable PDO assign\" in the SII, so that the master does not rewrite it)"
    } else {
        contradicted_assumption(index, subindex, found)
    }
}

/// The first checks, which identify the gateway.
pub(crate) const SERIAL_CHECKS: usize = 2;

#[derive(Debug, Clone, Copy)]
pub(crate) enum Check {
    Command(SdoWrite),
    Serial {
        subindex: u8,
        expected: u32,
    },
    Expect {
        index: u16,
        subindex: u8,
        expected: Expectation,
    },
    LayoutCrc {
        direction: usize,
        index: u16,
    },
    /// Step of reading the mode of a controller that must only listen.
    Controller {
        channel: u8,
        step: ControllerStep,
    },
    /// The gateway reports the sequence of the image that the Port publishes to it.
    Sequence,
}

/// Step of reading a register by the register service (manual 13.6).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ControllerStep {
    Offset(u16),
    Command,
    Status,
    /// Value of the register with this offset.
    Value(u16),
    /// The offset again: another program may have used the service in between.
    OffsetReadback(u16),
}

impl ControllerStep {
    /// The steps of reading the register with this offset.
    pub(crate) fn of_register(offset: u16) -> [Self; 5] {
        [
            Self::Offset(offset),
            Self::Command,
            Self::Status,
            Self::Value(offset),
            Self::OffsetReadback(offset),
        ]
    }

    pub(crate) fn subindex(self) -> u8 {
        match self {
            Self::Offset(_) | Self::OffsetReadback(_) => 1,
            Self::Command => 2,
            Self::Status => 3,
            Self::Value(_) => 5,
        }
    }

    /// The download of this step of a channel; `None` for an upload.
    fn download(self, channel: u8) -> Option<SdoWrite> {
        let object = REGISTER_SERVICE + u16::from(channel);
        match self {
            Self::Offset(offset) => Some(SdoWrite::new(object, 1, ObjectType::U32, offset.into())),
            Self::Command => Some(SdoWrite::new(object, 2, ObjectType::U8, 1)),
            Self::Status | Self::Value(_) | Self::OffsetReadback(_) => None,
        }
    }
}

impl Check {
    pub(crate) fn transfer(self) -> SdoTransfer {
        let (index, subindex, is_download) = match self {
            Self::Command(sdo) => (sdo.index, sdo.subindex, true),
            Self::Serial { subindex, .. } => (Capabilities::INDEX, subindex, false),
            Self::Expect { index, subindex, .. } => (index, subindex, false),
            Self::LayoutCrc { index, .. } => (index, 11, false),
            Self::Controller { channel, step } => (
                REGISTER_SERVICE + u16::from(channel),
                step.subindex(),
                step.download(channel).is_some(),
            ),
            Self::Sequence => (Direction::RxPdo.profile_object(), 13, false),
        };
        SdoTransfer { index, subindex, is_download }
    }

    /// The download of a check that writes.
    pub(crate) fn download(self) -> Option<SdoWrite> {
        match self {
            Self::Command(sdo) => Some(sdo),
            Self::Controller { channel, step } => step.download(channel),
            _ => None,
        }
    }

    /// Verifies the value read. Records the layout CRC of each direction the first time.
    pub(crate) fn verify(
        self,
        found: u32,
        layout_crc: &mut [Option<u32>; 2],
    ) -> Result<(), VerificationFault> {
        match self {
            Self::Command(_) | Self::Controller { .. } | Self::Sequence => Ok(()),
            Self::Serial { subindex, expected } => {
                if found == expected {
                    Ok(())
                } else {
                    Err(VerificationFault::OtherGateway { subindex, expected, found })
                }
            }
            Self::Expect { index, subindex, expected } => {
                if expected.is_met_by(found.into()) {
                    Ok(())
                } else {
                    Err(VerificationFault::Readback { index, subindex, expected, found })
                }
            }
            Self::LayoutCrc { direction, index } => {
                let recorded = *layout_crc[direction].get_or_insert(found);
                if recorded == found {
                    Ok(())
                } else {
                    Err(VerificationFault::LayoutCrc { index, recorded, found })
                }
            }
        }
    }
}

/// Status values of 0x8010 and 0x8011 that are valid for a profile in use (manual 13.2): a past
/// parsing error or overflow is no fault.
pub(super) const IN_USE: &[u64] = &[0, 7, 8];
/// The state bits of a channel status word (manual 7); all clear is disabled.
const STATE_BITS: u32 = 0b111;

/// The checks of a verification: same device, session reset, profile readback (manual 5.4.3 phase D), channels and their
/// data paths (13.2.2, 13.4, 13.5), objects of the whole gateway (13.2.1, 13.2.3, 13.3, 13.7), and that process data and SDOs go to the same gateway if there
/// are several.
pub(crate) fn checks(
    config: &GatewayConfig,
    [tx, rx]: [PdoProfile; 2],
    serial: u64,
    is_single: bool,
) -> Vec<Check> {
    let mut checks = Vec::with_capacity(40);
    checks.push(Check::Serial { subindex: 7, expected: serial as u32 });
    checks.push(Check::Serial { subindex: 8, expected: (serial >> 32) as u32 });
    let directions = [(Direction::TxPdo, tx), (Direction::RxPdo, rx)];
    for (direction, _) in directions {
        let reset = session_command_write(direction, SessionCommand::ResetSession);
        checks.push(Check::Command(reset));
    }
    for (nth, (direction, profile)) in directions.into_iter().enumerate() {
        let index = direction.profile_object();
        let expected = Expectation::OneOf(IN_USE);
        checks.push(Check::Expect { index, subindex: 2, expected });
        for (subindex, value) in profile_readback(&profile) {
            let expected = Expectation::Equals(value.into());
            checks.push(Check::Expect { index, subindex, expected });
        }
        checks.push(Check::LayoutCrc { direction: nth, index });
    }
    let device = config.device;
    let configured = device.first_writes().chain(device.data_path_writes());
    let written = configured.chain(device.test_writes());
    let written = written.map(|write| (write.index, write.subindex, write.value));
    for (index, subindex, value) in written.chain(device.readbacks()) {
        let expected = Expectation::Equals(value.into());
        checks.push(Check::Expect { index, subindex, expected });
    }
    for (channel, settings) in (0..).zip(&config.channels) {
        let Some(settings) = settings else { continue };
        let expected = Expectation::Equals(STATUS_OK.into());
        checks.push(Check::Expect { index: 0x8001 + channel, subindex: 2, expected });
        let expected = Expectation::HasAny(STATE_BITS.into());
        checks.push(Check::Expect { index: 0x9000 + channel, subindex: 9, expected });
        let expected = Expectation::Equals(STATUS_OK.into());
        checks.push(Check::Expect { index: 0x8021 + channel, subindex: 3, expected });
        let expected = Expectation::Equals(settings.data_path.active_word().into());
        checks.push(Check::Expect { index: 0x8021 + channel, subindex: 20, expected });
        if settings.can.node_mode == NodeMode::Listen {
            let channel = channel as u8;
            for offset in [CCCR, TEST] {
                let steps = ControllerStep::of_register(offset);
                checks.extend(steps.map(|step| Check::Controller { channel, step }));
            }
        }
    }
    if !is_single {
        checks.push(Check::Sequence);
    }
    checks
}

/// Readback values of an active profile: :09, :10, :12.
pub(crate) fn profile_readback(profile: &PdoProfile) -> [(u8, u32); 3] {
    [(9, profile.pdo_bytes() as u32), (10, profile.frame_area_bytes() as u32), (12, profile.word())]
}

/// Step that a gateway waits for until it is ready.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PendingStep {
    /// A configuration of the Port that has the gateway.
    Configuration,
    /// A network link of the master.
    Link,
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
    /// Returns whether the step is the cause of an outage, as far as it is known, and no step of the master or of
    /// the verification that follows every outage.
    pub fn is_cause(&self) -> bool {
        match self {
            Self::Operational
            | Self::Transfer(_)
            | Self::EarlierTransfer(_)
            | Self::NextAttempt => false,
            Self::Configuration
            | Self::Link
            | Self::Answer
            | Self::StartupRetry
            | Self::ProcessData
            | Self::ExclusiveProcessData => true,
        }
    }

    /// Code of the step and its transfer for other programs, in 40 bits: 0 for none.
    pub fn encode(step: Option<Self>) -> u64 {
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
            Some(Self::Link) => 10,
        }
    }

    /// The step of a code of [`encode`](Self::encode); `None` also for one of a later version.
    pub fn decode(code: u64) -> Option<Self> {
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
            10 => Some(Self::Link),
            _ => None,
        }
    }
}

impl fmt::Display for PendingStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Configuration => f.write_str("a reconfiguration of the Port that includes it"),
            Self::Link => f.write_str(
                "the network link of the master; check the cable and the power of the first slave",
            ),
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
            Some(PendingStep::Link),
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

    #[test]
    fn only_a_required_reload_names_its_assumption() {
        for (index, subindex, found, expected) in [
            (0x8010, 2, 5, true),
            (0x8011, 2, 5, true),
            (0x8010, 2, 4, false),
            (0x8010, 3, 5, false),
            (0x8001, 2, 5, false),
        ] {
            let good = Expectation::Equals(0);
            let fault = VerificationFault::Readback { index, subindex, expected: good, found };
            assert_eq!(fault.to_string().contains("H41"), expected, "{fault}");
        }
    }
}
