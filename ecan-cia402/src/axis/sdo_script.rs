//! A few SDO transfers in a row, without allocation: what an axis does while the bus runs.

use ecan_canopen::{
    Network, NodeHandle, OperatingMode, Sdo, SdoFailure, SdoFault, SdoStartError, SdoValue, object,
};
use ecan_protocol::object::AbortCode;
use thiserror::Error;

/// Transfers that a script can hold.
const CAPACITY: usize = 10;
const NS_PER_MS: u64 = 1_000_000;

/// How long a drive may take to show the mode that it was told.
const MODE_TIMEOUT_MS: u32 = 1_000;

/// One entry of a script.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ScriptStep {
    /// Writes an object; one that is not there is skipped where it is optional.
    Write { index: u16, subindex: u8, value: SdoValue, optional: bool },
    /// Reads the mode display until it shows the mode.
    AwaitMode { mode: OperatingMode, timeout_ms: u32 },
    /// Reads an object, which must have this value.
    Expect { index: u16, subindex: u8, value: u32 },
}

/// Why a script ended without success.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ScriptFault {
    /// A transfer failed.
    #[error(transparent)]
    Transfer(#[from] SdoFailure),
    /// A transfer could not start.
    #[error(transparent)]
    Start(#[from] SdoStartError),
    /// The drive does not show the mode that it was told.
    #[error("the drive does not take mode {mode}: 0x6061 shows {shown} after {waited_ms} ms")]
    Mode {
        /// The mode that was written to 0x6060.
        mode: OperatingMode,
        /// What 0x6061 showed last.
        shown: i8,
        /// How long was waited, in milliseconds.
        waited_ms: u64,
    },
    /// An object has another value than it was configured with.
    #[error("0x{index:04X}:{subindex:02X} reads 0x{found:X}, it was configured as 0x{expected:X}")]
    Changed {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// What was read.
        found: u32,
        /// What it was configured as.
        expected: u32,
    },
}

/// How a turn of a script ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ScriptTurn {
    Busy,
    Done,
    Failed(ScriptFault),
}

/// Transfers in a row with one node. While it runs, the node's SDO client belongs to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct SdoScript {
    steps: [Option<ScriptStep>; CAPACITY],
    length: usize,
    at: usize,
    is_transferring: bool,
    /// When the step under way began.
    since_ns: Option<u64>,
}

impl SdoScript {
    /// Appends a step; one beyond the capacity is left out, which the callers' lists never reach.
    fn push(&mut self, step: ScriptStep) {
        if let Some(place) = self.steps.get_mut(self.length) {
            *place = Some(step);
            self.length += 1;
        }
    }

    /// The same with a value that must be taken.
    pub(super) fn write(mut self, index: u16, subindex: u8, value: impl Into<SdoValue>) -> Self {
        self.push(ScriptStep::Write { index, subindex, value: value.into(), optional: false });
        self
    }

    /// The same with a value for an object that need not be there.
    pub(super) fn write_if_present(
        mut self,
        index: u16,
        subindex: u8,
        value: impl Into<SdoValue>,
    ) -> Self {
        self.push(ScriptStep::Write { index, subindex, value: value.into(), optional: true });
        self
    }

    /// The same with a value that an object must have.
    pub(super) fn expect(mut self, index: u16, subindex: u8, value: u32) -> Self {
        self.push(ScriptStep::Expect { index, subindex, value });
        self
    }

    /// The same with a mode and its confirmation.
    pub(super) fn mode(self, mode: OperatingMode) -> Self {
        let mut script = self.write(object::MODE_OF_OPERATION, 0, mode.raw());
        script.push(ScriptStep::AwaitMode { mode, timeout_ms: MODE_TIMEOUT_MS });
        script
    }

    /// The step under way.
    fn step(&self) -> Option<ScriptStep> {
        self.steps.get(self.at).copied().flatten()
    }

    /// One cycle. Real-time safe.
    pub(super) fn turn(
        &mut self,
        network: &mut Network,
        handle: NodeHandle,
        now_ns: u64,
    ) -> ScriptTurn {
        let Some(step) = self.step() else { return ScriptTurn::Done };
        let since_ns = *self.since_ns.get_or_insert(now_ns);
        if !self.is_transferring {
            return self.begin(step, network, handle);
        }
        let sdo = network.sdo_state(handle);
        if sdo == Sdo::Busy {
            return ScriptTurn::Busy;
        }
        self.is_transferring = false;
        match (step, sdo) {
            (ScriptStep::Expect { index, subindex, value: expected }, Sdo::Done { .. }) => {
                let found = low_word(network.sdo_data(handle));
                if found == expected {
                    self.next()
                } else {
                    let changed = ScriptFault::Changed { index, subindex, found, expected };
                    ScriptTurn::Failed(changed)
                }
            }
            (ScriptStep::AwaitMode { mode, timeout_ms }, Sdo::Done { .. }) => {
                let [shown, ..] = low_word(network.sdo_data(handle)).to_le_bytes();
                let shown = shown.cast_signed();
                let waited_ms = now_ns.saturating_sub(since_ns) / NS_PER_MS;
                if shown == mode.raw() {
                    self.next()
                } else if waited_ms > u64::from(timeout_ms) {
                    ScriptTurn::Failed(ScriptFault::Mode { mode, shown, waited_ms })
                } else {
                    self.begin(step, network, handle)
                }
            }
            (ScriptStep::Write { .. }, Sdo::Done { .. }) => self.next(),
            (
                ScriptStep::Write { optional: true, .. },
                Sdo::Failed(SdoFault::Aborted(AbortCode::NO_OBJECT | AbortCode::NO_SUBINDEX)),
            ) => self.next(),
            // Someone else has used the client since, and so taken the result away.
            _ => match network.sdo_failure(handle) {
                Some(failure) => ScriptTurn::Failed(failure.into()),
                None => self.begin(step, network, handle),
            },
        }
    }

    fn next(&mut self) -> ScriptTurn {
        self.at += 1;
        self.since_ns = None;
        if self.step().is_some() { ScriptTurn::Busy } else { ScriptTurn::Done }
    }

    fn begin(&mut self, step: ScriptStep, network: &mut Network, handle: NodeHandle) -> ScriptTurn {
        let started = match step {
            ScriptStep::Write { index, subindex, value, .. } => {
                network.start_download(handle, index, subindex, value.as_bytes())
            }
            ScriptStep::AwaitMode { .. } => network.start_upload(handle, object::MODE_DISPLAY, 0),
            ScriptStep::Expect { index, subindex, .. } => {
                network.start_upload(handle, index, subindex)
            }
        };
        match started {
            Ok(()) => self.is_transferring = true,
            Err(SdoStartError::Busy) => {}
            Err(error) => return ScriptTurn::Failed(error.into()),
        }
        ScriptTurn::Busy
    }

    /// Gives the transfer under way up.
    pub(super) fn cancel(&mut self, network: &mut Network, handle: NodeHandle) {
        if std::mem::take(&mut self.is_transferring) {
            network.cancel_sdo(handle);
        }
        *self = Self::default();
    }
}

/// The first four bytes of a value, missing ones as 0.
fn low_word(data: &[u8]) -> u32 {
    let mut bytes = [0; 4];
    for (to, from) in bytes.iter_mut().zip(data) {
        *to = *from;
    }
    u32::from_le_bytes(bytes)
}
