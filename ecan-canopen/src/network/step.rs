//! One step in bringing a node up.

use std::fmt;

use crate::{NmtCommand, NmtState};
use ecan_protocol::object::AbortCode;

/// A value of up to eight bytes as SDO carries it, little-endian. Made from the integer type that
/// the object has: `Step::write(0x6060, 0, 8i8)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SdoValue {
    bytes: [u8; 8],
    length: u8,
}

impl SdoValue {
    fn from_le(source: &[u8]) -> Self {
        let mut bytes = [0; 8];
        for (to, from) in bytes.iter_mut().zip(source) {
            *to = *from;
        }
        Self { bytes, length: source.len().min(8) as u8 }
    }

    /// The bytes to send.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.length)).unwrap_or_default()
    }

    /// The value without sign.
    pub fn raw(&self) -> u64 {
        u64::from_le_bytes(self.bytes)
    }
}

macro_rules! from_integer {
    ($($integer:ty),*) => {$(
        impl From<$integer> for SdoValue {
            fn from(value: $integer) -> Self {
                Self::from_le(&value.to_le_bytes())
            }
        }
    )*};
}

from_integer!(u8, u16, u32, u64, i8, i16, i32, i64);

/// A little-endian value of any length up to eight bytes, missing bytes as 0.
pub(super) fn raw_value(bytes: &[u8]) -> u64 {
    SdoValue::from_le(bytes.get(..8).unwrap_or(bytes)).raw()
}

/// Which refusals of the node let the configuration go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Tolerance {
    /// None: the step must succeed.
    #[default]
    None,
    /// The object or subindex does not exist: for what a node may have or not.
    Missing,
    /// Any abort by the node, or a value other than the expected one.
    TargetRejection,
}

impl Tolerance {
    pub(super) fn covers(self, code: AbortCode) -> bool {
        match self {
            Self::None => false,
            Self::Missing => matches!(code, AbortCode::NO_OBJECT | AbortCode::NO_SUBINDEX),
            Self::TargetRejection => true,
        }
    }
}

/// What a step does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// Downloads a value.
    Write {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// The value, with as many bytes as the object has.
        value: SdoValue,
    },
    /// Uploads a 32-bit value, changes bits of it and downloads the result.
    Modify {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// Bits that become 0.
        clear: u32,
        /// Bits that become 1.
        set: u32,
    },
    /// Uploads a value and keeps it, see [`Configurator::uploaded`](crate::Configurator::uploaded).
    Read {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
    },
    /// Uploads a value and compares it.
    Expect {
        /// Object index.
        index: u16,
        /// Object subindex.
        subindex: u8,
        /// The value.
        value: u64,
        /// Bits that count.
        mask: u64,
    },
    /// Sends an NMT command to the node.
    Nmt(NmtCommand),
    /// Waits for a boot-up message that came after the last NMT command of this list, or after its
    /// start where it has none.
    AwaitBootUp {
        /// How long, in milliseconds.
        timeout_ms: u32,
    },
    /// Waits until the node's heartbeat reports a state.
    AwaitState {
        /// The state.
        state: NmtState,
        /// How long, in milliseconds.
        timeout_ms: u32,
    },
    /// Waits.
    Pause {
        /// How long, in milliseconds.
        ms: u32,
    },
}

impl fmt::Display for Action {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Write { index, subindex, value } => {
                let width = 2 + value.as_bytes().len() * 2;
                write!(f, "write 0x{index:04X}:{subindex:02X} = {:#0width$X}", value.raw())
            }
            Self::Modify { index, subindex, .. } => {
                write!(f, "change 0x{index:04X}:{subindex:02X}")
            }
            Self::Read { index, subindex } => write!(f, "read 0x{index:04X}:{subindex:02X}"),
            Self::Expect { index, subindex, .. } => write!(f, "check 0x{index:04X}:{subindex:02X}"),
            Self::Nmt(command) => write!(f, "NMT {command}"),
            Self::AwaitBootUp { .. } => f.write_str("wait for the boot-up message"),
            Self::AwaitState { state, .. } => write!(f, "wait for NMT state {state}"),
            Self::Pause { ms } => write!(f, "wait {ms} ms"),
        }
    }
}

/// One step, and what it is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step {
    /// What it does.
    pub action: Action,
    /// What it is for, in a few words; may be empty.
    pub words: &'static str,
    /// Which refusals it forgives.
    pub tolerance: Tolerance,
}

impl From<Action> for Step {
    fn from(action: Action) -> Self {
        Self { action, words: "", tolerance: Tolerance::None }
    }
}

impl Step {
    /// Downloads a value.
    pub fn write(index: u16, subindex: u8, value: impl Into<SdoValue>) -> Self {
        Action::Write { index, subindex, value: value.into() }.into()
    }

    /// Uploads a 32-bit value, clears and sets bits, and downloads the result.
    pub fn modify(index: u16, subindex: u8, clear: u32, set: u32) -> Self {
        Action::Modify { index, subindex, clear, set }.into()
    }

    /// Uploads a value and keeps it.
    pub fn read(index: u16, subindex: u8) -> Self {
        Action::Read { index, subindex }.into()
    }

    /// Uploads a value and compares all its bits.
    pub fn expect(index: u16, subindex: u8, value: impl Into<SdoValue>) -> Self {
        Self::expect_masked(index, subindex, value.into().raw(), u64::MAX)
    }

    /// Uploads a value and compares those bits that `mask` has.
    pub fn expect_masked(index: u16, subindex: u8, value: u64, mask: u64) -> Self {
        Action::Expect { index, subindex, value, mask }.into()
    }

    /// Sends an NMT command to the node.
    pub fn nmt(command: NmtCommand) -> Self {
        Action::Nmt(command).into()
    }

    /// Waits for the boot-up message.
    pub fn await_boot_up(timeout_ms: u32) -> Self {
        Action::AwaitBootUp { timeout_ms }.into()
    }

    /// Waits until the heartbeat reports a state.
    pub fn await_state(state: NmtState, timeout_ms: u32) -> Self {
        Action::AwaitState { state, timeout_ms }.into()
    }

    /// Waits.
    pub fn pause(ms: u32) -> Self {
        Action::Pause { ms }.into()
    }

    /// Says what the step is for.
    #[must_use]
    pub fn named(mut self, words: &'static str) -> Self {
        self.words = words;
        self
    }

    /// Forgives an object that the node does not have.
    #[must_use]
    pub fn if_present(mut self) -> Self {
        self.tolerance = Tolerance::Missing;
        self
    }

    /// Forgives any refusal by the node.
    #[must_use]
    pub fn if_accepted(mut self) -> Self {
        self.tolerance = Tolerance::TargetRejection;
        self
    }
}

impl fmt::Display for Step {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.words.is_empty() {
            write!(f, "{}", self.action)
        } else {
            write!(f, "{} ({})", self.words, self.action)
        }
    }
}
