//! Errors: register 0x1001, history 0x1003 and emergency messages.

use std::collections::VecDeque;

use ecan_canopen::{Emcy, EmcyClass, ErrorRegister, object};

use super::dictionary::Dictionary;

/// Errors that 0x1003 remembers.
pub(super) const HISTORY: usize = 8;
/// Messages that may wait for their inhibit time.
const WAITING: usize = 8;

/// What is wrong, and what has not been told yet.
#[derive(Clone, Debug)]
pub(super) struct Emergency {
    register: u8,
    /// Last error code; 0 after a reset.
    code: u16,
    waiting: VecDeque<Emcy>,
    /// When the next message may go out.
    free_at: u64,
    sent: u64,
}

/// The bits of the error register for a code.
pub(super) fn register_of(code: u16) -> ErrorRegister {
    let class = match EmcyClass::of(code) {
        EmcyClass::Current => ErrorRegister::CURRENT,
        EmcyClass::Voltage => ErrorRegister::VOLTAGE,
        EmcyClass::Temperature => ErrorRegister::TEMPERATURE,
        // Among the codes of monitoring, 0x81 and 0x82 are about communication, the others about
        // control.
        EmcyClass::Monitoring if matches!(code >> 8, 0x81 | 0x82) => ErrorRegister::COMMUNICATION,
        EmcyClass::Monitoring => ErrorRegister::PROFILE,
        EmcyClass::DeviceSpecific => ErrorRegister::MANUFACTURER,
        _ => ErrorRegister::default(),
    };
    ErrorRegister(ErrorRegister::GENERIC.0 | class.0)
}

impl Emergency {
    pub(super) fn new() -> Self {
        Self {
            register: 0,
            code: 0,
            waiting: VecDeque::with_capacity(WAITING),
            free_at: 0,
            sent: 0,
        }
    }

    /// After a loss of supply or a reset of the device.
    pub(super) fn restart(&mut self) {
        self.register = 0;
        self.code = 0;
        self.waiting.clear();
        self.free_at = 0;
    }

    pub(super) const fn register(&self) -> ErrorRegister {
        ErrorRegister(self.register)
    }

    pub(super) const fn code(&self) -> u16 {
        self.code
    }

    pub(super) const fn sent(&self) -> u64 {
        self.sent
    }

    /// An error has come and gone: it is remembered and told, but does not stay in the register.
    pub(super) fn mention(&mut self, code: u16, register: ErrorRegister, objects: &mut Dictionary) {
        remember(objects, code);
        self.tell(code, ErrorRegister(self.register | register.0));
    }

    /// An error has come, and stays.
    pub(super) fn raise(&mut self, code: u16, register: ErrorRegister, objects: &mut Dictionary) {
        self.register |= register.0;
        self.code = code;
        remember(objects, code);
        self.tell(code, ErrorRegister(self.register));
    }

    /// Every error has gone.
    pub(super) fn clear_all(&mut self) {
        self.clear(ErrorRegister(u8::MAX));
    }

    /// Errors of these register bits have gone.
    pub(super) fn clear(&mut self, register: ErrorRegister) {
        if self.register & register.0 == 0 {
            return;
        }
        self.register &= !register.0;
        // The generic bit goes with the last of the others.
        if self.register == ErrorRegister::GENERIC.0 {
            self.register = 0;
        }
        if self.register == 0 {
            self.code = 0;
            self.tell(0, ErrorRegister::default());
        }
    }

    fn tell(&mut self, code: u16, register: ErrorRegister) {
        if self.waiting.len() >= WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back(Emcy { code, register, manufacturer: [0; 5] });
    }

    /// When a waiting message may go out.
    pub(super) fn next_event(&self) -> Option<u64> {
        (!self.waiting.is_empty()).then_some(self.free_at)
    }

    /// A message that may go out now.
    pub(super) fn due(&mut self, now: u64, inhibit_ns: u64) -> Option<Emcy> {
        if self.free_at > now {
            return None;
        }
        let emcy = self.waiting.pop_front()?;
        self.free_at = now.saturating_add(inhibit_ns);
        self.sent += 1;
        Some(emcy)
    }

    /// Where no message may go out, none waits.
    pub(super) fn drop_waiting(&mut self) {
        self.waiting.clear();
    }
}

/// Puts an error in front of those in 0x1003.
fn remember(objects: &mut Dictionary, code: u16) {
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

/// Empties 0x1003.
pub(super) fn forget(objects: &mut Dictionary) {
    for subindex in 0..=HISTORY as u8 {
        objects.set(object::ERROR_HISTORY, subindex, 0);
    }
}
