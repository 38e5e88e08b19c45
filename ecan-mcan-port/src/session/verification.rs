//! What is verified before a gateway is taken into service, and what can be wrong with it.

use std::fmt;

use ecan_host::{CycleError, Expectation};
use ecan_protocol::config::{SessionCommand, session_command_write};
use ecan_protocol::device::Capabilities;
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::{SdoWrite, describe};
use thiserror::Error;

use crate::port_config::GatewayConfig;

const STATUS_OK: u32 = 0;

/// An SDO transfer of the verification.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SdoTransfer {
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// Whether it writes.
    pub is_download: bool,
}

impl fmt::Display for SdoTransfer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let way = if self.is_download { "download" } else { "upload" };
        write!(f, "SDO {way} of {}", describe(self.index, self.subindex))
    }
}

/// Why a gateway is not taken into service.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum VerificationFault {
    /// An object reads something else than the configuration demands.
    #[error("{} reads {found}, expected {expected}", describe(*index, *subindex))]
    Readback {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// What was expected.
        expected: Expectation,
        /// What was read.
        found: u32,
    },
    /// Another gateway is in the place of the configured one.
    #[error(
        "another gateway is in its place: serial number half {} reads 0x{found:08X}, it was \
         0x{expected:08X}", subindex - 6
    )]
    OtherGateway {
        /// Subindex of 0xF000, 7 or 8.
        subindex: u8,
        /// What was read when the Port was opened.
        expected: u32,
        /// What is read now.
        found: u32,
    },
    /// The layout CRC is another one than at the first verification, with the same profile.
    #[error("{} changed from 0x{recorded:08X} to 0x{found:08X}", describe(*index, 11))]
    LayoutCrc {
        /// 0x8010 or 0x8011.
        index: u16,
        /// The value of the first verification.
        recorded: u32,
        /// The value now.
        found: u32,
    },
    /// A transfer failed.
    #[error("{0} failed")]
    Transfer(SdoTransfer),
    /// The master keeps a request busy beyond its timeout. Until it ends the request, every
    /// attempt ends like this.
    #[error("the master has not ended the {transfer} for {waited_ms} ms")]
    Unended {
        /// What the request was begun for, by this attempt or an earlier one.
        transfer: SdoTransfer,
        /// Since it was begun, in milliseconds.
        waited_ms: u64,
    },
    /// The master library refused a request.
    #[error(transparent)]
    Library(CycleError),
}

/// One step of the verification.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Check {
    Command(SdoWrite),
    Serial { subindex: u8, expected: u32 },
    Expect { index: u16, subindex: u8, expected: Expectation },
    LayoutCrc { direction: usize, index: u16 },
}

impl Check {
    /// The transfer that it takes.
    pub(crate) fn transfer(self) -> SdoTransfer {
        let (index, subindex, is_download) = match self {
            Self::Command(sdo) => (sdo.index, sdo.subindex, true),
            Self::Serial { subindex, .. } => (Capabilities::INDEX, subindex, false),
            Self::Expect { index, subindex, .. } => (index, subindex, false),
            Self::LayoutCrc { index, .. } => (index, 11, false),
        };
        SdoTransfer { index, subindex, is_download }
    }

    /// Judges what was read. Layout CRCs are recorded the first time, per direction.
    pub(crate) fn judge(
        self,
        found: u32,
        layout_crc: &mut [Option<u32>; 2],
    ) -> Result<(), VerificationFault> {
        match self {
            Self::Command(_) => Ok(()),
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

/// Status values of 0x8010 and 0x8011 that a profile in use may show (manual 13.2): a parsing error
/// or an overflow of the past says nothing against it.
const IN_USE: &[u64] = &[0, 7, 8];
/// The state bits of a channel status word (manual 7); all clear is disabled.
const STATE_BITS: u32 = 0b111;

/// The same device, session reset, profile readback (manual 5.4.3 phase D), channels and their
/// data paths (13.2.2, 13.4, 13.5).
pub(crate) fn checks(config: &GatewayConfig, [tx, rx]: [PdoProfile; 2], serial: u64) -> Vec<Check> {
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
    for (channel, settings) in (0..).zip(&config.channels) {
        let Some(settings) = settings else { continue };
        let expected = Expectation::Equals(STATUS_OK.into());
        checks.push(Check::Expect { index: 0x8001 + channel, subindex: 2, expected });
        let expected = Expectation::HasAny(STATE_BITS.into());
        checks.push(Check::Expect { index: 0x9000 + channel, subindex: 9, expected });
        let expected = Expectation::Equals(settings.data_path.active_word().into());
        checks.push(Check::Expect { index: 0x8021 + channel, subindex: 20, expected });
    }
    checks
}

/// What an active profile reads back: :09, :10, :12.
pub(crate) fn profile_readback(profile: &PdoProfile) -> [(u8, u32); 3] {
    [(9, profile.pdo_bytes() as u32), (10, profile.frame_area_bytes() as u32), (12, profile.word())]
}
