//! Taking a gateway into service, and again after each return to OP.
//!
//! The master configures a slave that comes back, but it does not look at what the slave made of
//! it. So each time a gateway reaches OP the session resets its sequence memory and reads back
//! profiles and channels, with SDO requests that run in the cycle, before a frame goes out.

use std::fmt;

use ecan_host::{Adapter, CycleError, Delivery, Error, Expectation, RequestId, RequestState};
use ecan_protocol::{
    Capabilities, Direction, PdoProfile, SdoWrite, SessionCommand, describe, session_command_write,
};
use thiserror::Error;

use crate::config::GatewayConfig;

/// Cycles between looks at the slave's state while it is in service.
const WATCH_CYCLES: u64 = 64;
/// How long a request may take, in milliseconds.
const REQUEST_TIMEOUT_MS: u32 = 2_000;
/// Pause before a failed verification starts over, in nanoseconds.
const RETRY_NS: u64 = 1_000_000_000;

const STATUS_OK: u32 = 0;

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
    #[error("SDO {} of {} failed", if *is_download { "download" } else { "upload" }, describe(*index, *subindex))]
    Transfer {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Whether it was a download.
        is_download: bool,
    },
    /// The master library refused a request.
    #[error(transparent)]
    Library(CycleError),
}

/// Where a gateway's session stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Session {
    /// The slave is not in OP, or its process data do not arrive.
    #[default]
    Waiting,
    /// In OP, being verified; only empty images go out.
    Verifying,
    /// In service.
    Ready,
    /// Verification failed; it starts over every second.
    Failed(VerificationFault),
}

impl fmt::Display for Session {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Waiting => f.write_str("waiting for OP"),
            Self::Verifying => f.write_str("being verified"),
            Self::Ready => f.write_str("in service"),
            Self::Failed(fault) => write!(f, "not in service: {fault}"),
        }
    }
}

/// One step of the verification.
#[derive(Debug, Clone, Copy)]
enum Check {
    Command(SdoWrite),
    Serial { subindex: u8, expected: u32 },
    Expect { index: u16, subindex: u8, expected: Expectation },
    LayoutCrc { direction: usize, index: u16 },
}

/// What a step of the session changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Event {
    None,
    Started,
    Ready,
    Failed,
    Lost,
}

#[derive(Debug)]
pub(crate) struct SessionMachine {
    slave: usize,
    state: Session,
    checks: Vec<Check>,
    next: usize,
    is_running: bool,
    read: RequestId,
    command: RequestId,
    layout_crc: [Option<u32>; 2],
    retry_at_ns: u64,
    cycles: u64,
}

impl SessionMachine {
    /// Creates the requests; the Adapter must be configured and not yet active.
    pub(crate) fn new(
        adapter: &mut Adapter,
        slave: usize,
        config: &GatewayConfig,
    ) -> Result<Self, Error> {
        let read = adapter.create_sdo_request(slave, 4)?;
        let command = adapter.create_sdo_request(slave, 1)?;
        for request in [read, command] {
            adapter.sdo_request_timeout(request, REQUEST_TIMEOUT_MS)?;
        }
        let settings = &adapter.config().slaves[slave];
        let profiles = [
            config.profile(Direction::TxPdo, settings.tx_multiplier),
            config.profile(Direction::RxPdo, settings.rx_multiplier),
        ];
        let checks = checks(config, profiles, adapter.serial_number(slave)?);
        Ok(Self {
            slave,
            state: Session::Waiting,
            checks,
            next: 0,
            is_running: false,
            read,
            command,
            layout_crc: [None; 2],
            retry_at_ns: 0,
            cycles: 0,
        })
    }

    pub(crate) fn state(&self) -> Session {
        self.state
    }

    pub(crate) fn is_ready(&self) -> bool {
        self.state == Session::Ready
    }

    /// One step, once a cycle. `is_lost` tells that too many images in a row did not arrive.
    pub(crate) fn step(&mut self, adapter: &mut Adapter, is_lost: bool) -> Event {
        self.cycles += 1;
        match self.state {
            Session::Ready => {
                let look = self.cycles.is_multiple_of(WATCH_CYCLES);
                if is_lost || (look && self.has_left_op(adapter)) {
                    return self.lose();
                }
                Event::None
            }
            Session::Verifying => {
                if is_lost {
                    return self.lose();
                }
                match self.verify(adapter) {
                    Ok(true) => {
                        self.state = Session::Ready;
                        Event::Ready
                    }
                    Ok(false) => Event::None,
                    Err(fault) => {
                        self.state = Session::Failed(fault);
                        self.retry_at_ns = adapter.clock().now_ns() + RETRY_NS;
                        Event::Failed
                    }
                }
            }
            Session::Waiting => self.start_if_operational(adapter),
            Session::Failed(_) => {
                if is_lost {
                    self.lose()
                } else if adapter.clock().now_ns() >= self.retry_at_ns {
                    self.start_if_operational(adapter)
                } else {
                    Event::None
                }
            }
        }
    }

    fn is_operational(&self, adapter: &Adapter) -> bool {
        adapter.slave_state(self.slave).is_ok_and(|state| state.operational)
    }

    /// Whether the master sees the slave in another state. While it scans the bus anew it sees no
    /// slave at all, though process data go on; that is no reason to stop.
    fn has_left_op(&self, adapter: &Adapter) -> bool {
        adapter.slave_state(self.slave).is_ok_and(|state| state.online && !state.operational)
    }

    fn start_if_operational(&mut self, adapter: &mut Adapter) -> Event {
        let arrives = adapter.domain_report(self.slave).outputs == Delivery::Confirmed;
        if !arrives || !self.is_operational(adapter) {
            return Event::None;
        }
        self.state = Session::Verifying;
        self.next = 0;
        // A request that an earlier attempt left behind says nothing about this one.
        self.is_running = false;
        Event::Started
    }

    fn lose(&mut self) -> Event {
        self.state = Session::Waiting;
        Event::Lost
    }

    /// Goes on with the checks; true once all are passed.
    fn verify(&mut self, adapter: &mut Adapter) -> Result<bool, VerificationFault> {
        let Some(check) = self.checks.get(self.next).copied() else { return Ok(true) };
        let (request, index, subindex, is_download) = match check {
            Check::Command(sdo) => (self.command, sdo.index, sdo.subindex, true),
            Check::Serial { subindex, .. } => (self.read, Capabilities::INDEX, subindex, false),
            Check::Expect { index, subindex, .. } => (self.read, index, subindex, false),
            Check::LayoutCrc { index, .. } => (self.read, index, 11, false),
        };
        let state = adapter.sdo_request_state(request).map_err(VerificationFault::Library)?;
        if state == RequestState::Busy {
            // Also a request of an earlier attempt that the master has not given up yet.
            return Ok(false);
        }
        if !self.is_running {
            self.is_running = true;
            return match check {
                Check::Command(sdo) => {
                    let (bytes, length) = sdo.bytes();
                    let data = bytes.get(..length).unwrap_or_default();
                    adapter.sdo_request_write(request, index, subindex, data)
                }
                _ => adapter.sdo_request_read(request, index, subindex),
            }
            .map(|()| false)
            .map_err(VerificationFault::Library);
        }
        self.is_running = false;
        if state != RequestState::Success {
            return Err(VerificationFault::Transfer { index, subindex, is_download });
        }
        let mut value = [0; 4];
        for (to, from) in value.iter_mut().zip(adapter.sdo_request_data(request)) {
            *to = *from;
        }
        self.judge(check, u32::from_le_bytes(value))?;
        self.next += 1;
        Ok(self.next == self.checks.len())
    }

    fn judge(&mut self, check: Check, found: u32) -> Result<(), VerificationFault> {
        match check {
            Check::Command(_) => Ok(()),
            Check::Serial { subindex, expected } => {
                if found == expected {
                    Ok(())
                } else {
                    Err(VerificationFault::OtherGateway { subindex, expected, found })
                }
            }
            Check::Expect { index, subindex, expected } => {
                if expected.is_met_by(found) {
                    Ok(())
                } else {
                    Err(VerificationFault::Readback { index, subindex, expected, found })
                }
            }
            Check::LayoutCrc { direction, index } => {
                let recorded = *self.layout_crc[direction].get_or_insert(found);
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
const IN_USE: &[u32] = &[0, 7, 8];
/// The state bits of a channel status word (manual 7); all clear is disabled.
const STATE_BITS: u32 = 0b111;

/// The same device, session reset, profile readback (manual 5.4.3 phase D), channels and their
/// data paths (13.2.2, 13.4, 13.5).
fn checks(config: &GatewayConfig, [tx, rx]: [PdoProfile; 2], serial: u64) -> Vec<Check> {
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
            let expected = Expectation::Equals(value);
            checks.push(Check::Expect { index, subindex, expected });
        }
        checks.push(Check::LayoutCrc { direction: nth, index });
    }
    for (channel, settings) in (0..).zip(&config.channels) {
        let Some(settings) = settings else { continue };
        let expected = Expectation::Equals(STATUS_OK);
        checks.push(Check::Expect { index: 0x8001 + channel, subindex: 2, expected });
        let expected = Expectation::HasAny(STATE_BITS);
        checks.push(Check::Expect { index: 0x9000 + channel, subindex: 9, expected });
        let expected = Expectation::Equals(settings.data_path.active_word());
        checks.push(Check::Expect { index: 0x8021 + channel, subindex: 20, expected });
    }
    checks
}

/// What an active profile reads back: :09, :10, :12.
pub(crate) fn profile_readback(profile: &PdoProfile) -> [(u8, u32); 3] {
    [(9, profile.pdo_bytes() as u32), (10, profile.frame_area_bytes() as u32), (12, profile.word())]
}
