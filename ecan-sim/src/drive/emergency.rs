//! Errors: register 0x1001, history 0x1003 and emergency messages.

use std::collections::VecDeque;

use ecan_canopen::{Emcy, EmcyClass, ErrorRegister, object};

use super::dictionary::Dictionary;

/// Length of the error history 0x1003.
pub(super) const HISTORY: usize = 8;
/// Maximum number of messages that wait for the inhibit time.
const WAITING: usize = 8;

#[derive(Clone, Debug, Default)]
pub(super) struct Emergency {
    pub(super) register: u8,
    /// Last error code; 0 after a reset.
    pub(super) code: u16,
    pub(super) waiting: VecDeque<Emcy>,
    /// End of the inhibit time.
    free_at: u64,
    pub(super) sent: u64,
}

/// Error register bits for an error code.
pub(super) fn register_of(code: u16) -> ErrorRegister {
    let class = match EmcyClass::of(code) {
        EmcyClass::Current => ErrorRegister::CURRENT,
        EmcyClass::Voltage => ErrorRegister::VOLTAGE,
        EmcyClass::Temperature => ErrorRegister::TEMPERATURE,
        // 0x81 and 0x82 are communication errors, other monitoring codes are control errors.
        EmcyClass::Monitoring if matches!(code >> 8, 0x81 | 0x82) => ErrorRegister::COMMUNICATION,
        EmcyClass::Monitoring => ErrorRegister::PROFILE,
        EmcyClass::DeviceSpecific => ErrorRegister::MANUFACTURER,
        _ => ErrorRegister::default(),
    };
    ErrorRegister(ErrorRegister::GENERIC.0 | class.0)
}

impl Emergency {
    pub(super) fn new() -> Self {
        Self { waiting: VecDeque::with_capacity(WAITING), ..Self::default() }
    }

    pub(super) fn restart(&mut self) {
        self.register = 0;
        self.code = 0;
        self.waiting.clear();
        self.free_at = 0;
    }

    /// Reports an error that has already gone: it enters the history, not the register.
    pub(super) fn report(&mut self, code: u16, register: ErrorRegister, objects: &mut Dictionary) {
        add_to_history(objects, code);
        self.queue(code, ErrorRegister(self.register | register.0));
    }

    /// Reports a present error.
    pub(super) fn raise(&mut self, code: u16, objects: &mut Dictionary) {
        self.register |= register_of(code).0;
        self.code = code;
        add_to_history(objects, code);
        self.queue(code, ErrorRegister(self.register));
    }

    pub(super) fn clear(&mut self, register: ErrorRegister) {
        if self.register & register.0 == 0 {
            return;
        }
        self.register &= !register.0;
        // The generic bit is cleared with the last of the others.
        if self.register == ErrorRegister::GENERIC.0 {
            self.register = 0;
        }
        if self.register == 0 {
            self.code = 0;
            self.queue(0, ErrorRegister::default());
        }
    }

    fn queue(&mut self, code: u16, register: ErrorRegister) {
        if self.waiting.len() >= WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back(Emcy { code, register, manufacturer: [0; 5] });
    }

    pub(super) fn next_event(&self) -> Option<u64> {
        (!self.waiting.is_empty()).then_some(self.free_at)
    }

    /// Takes a message that may be sent now.
    pub(super) fn due(&mut self, now: u64, inhibit_ns: u64) -> Option<Emcy> {
        if self.free_at > now {
            return None;
        }
        let emcy = self.waiting.pop_front()?;
        self.free_at = now.saturating_add(inhibit_ns);
        self.sent += 1;
        Some(emcy)
    }
}

fn add_to_history(objects: &mut Dictionary, code: u16) {
    let Some(count) = objects.number(object::ERROR_HISTORY, 0) else { return };
    let mut raw = i64::from(code);
    let mut kept = 0;
    for subindex in 1..=HISTORY as u8 {
        let Some(before) = objects.number(object::ERROR_HISTORY, subindex) else { break };
        objects.set(object::ERROR_HISTORY, subindex, raw);
        raw = before;
        kept += 1;
    }
    objects.set(object::ERROR_HISTORY, 0, (count + 1).min(kept));
}

pub(super) fn clear_history(objects: &mut Dictionary) {
    for subindex in 0..=HISTORY as u8 {
        objects.set(object::ERROR_HISTORY, subindex, 0);
    }
}
