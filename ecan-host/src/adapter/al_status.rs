//! Watching the AL status codes and the sync managers of slaves while OP is waited for.

use ecan_protocol::device::AlStatusCode;
use ecan_protocol::mapping::SyncManagerLayout;

use crate::master::{Master, RegRequestId, RequestState};

const AL_STATUS_CODE_REGISTER: u16 = 0x0134;
/// Registers of SM2 and SM3.
const SYNC_MANAGER_REGISTERS: u16 = 0x0810;
const SYNC_MANAGER_BYTES: usize = 2 * SyncManagerLayout::BYTES;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Registers {
    AlStatusCode,
    SyncManagers,
}

impl Registers {
    fn address(self) -> u16 {
        match self {
            Self::AlStatusCode => AL_STATUS_CODE_REGISTER,
            Self::SyncManagers => SYNC_MANAGER_REGISTERS,
        }
    }
}

/// Watches a slave's AL status code, and SM2 and SM3, while OP is waited for.
#[derive(Debug)]
pub(crate) struct AlStatusWatch {
    request: RegRequestId,
    found: FoundRegisters,
    /// The master kept the slave in PREOP.
    was_held: bool,
}

impl AlStatusWatch {
    /// Bytes of every read.
    pub(crate) const BYTES: usize = SYNC_MANAGER_BYTES;

    pub(crate) fn new(request: RegRequestId) -> Self {
        Self { request, found: FoundRegisters::default(), was_held: false }
    }

    pub(crate) fn last(&self) -> Option<AlStatusCode> {
        self.found.code
    }

    pub(crate) fn clear(&mut self) {
        self.found = FoundRegisters::default();
        self.was_held = false;
    }

    /// The master holds the slave in PREOP, in this attempt of its startup.
    pub(crate) fn note_held(&mut self) {
        self.was_held = true;
    }

    pub(crate) fn was_held(&self) -> bool {
        self.was_held
    }

    /// SM2 and SM3 when they were last read with a length, that is configured.
    pub(crate) fn sync_managers(&self) -> Option<[SyncManagerLayout; 2]> {
        self.found.sync_managers
    }

    /// Stores the data of a read that has ended, and starts the next read.
    pub(crate) fn step(&mut self, master: &mut Master) {
        let Ok(state) = master.requests().register_result(self.request) else { return };
        if state == RequestState::Busy {
            return;
        }
        let is_read = state == RequestState::Success;
        let next = self.found.take(is_read.then(|| master.requests().register_data(self.request)));
        // A slave that is gone rejects; the next step tries again. Every read has the same size, since an
        // abandoned one may still be executed with the address of its successor.
        let started = master.requests().register_read(self.request, next.address(), Self::BYTES);
        self.found.pending = started.is_ok().then_some(next);
    }
}

/// The values found, and the order of the reads.
///
/// The master acknowledges errors, which clears the code, so the last one seen counts, and the code is
/// read as often as possible.
#[derive(Debug, Default)]
struct FoundRegisters {
    code: Option<AlStatusCode>,
    /// SM2 and SM3 as the master configured them.
    sync_managers: Option<[SyncManagerLayout; 2]>,
    /// True if the sync managers were read after the last code.
    is_current: bool,
    /// Registers that the running request reads.
    pending: Option<Registers>,
}

impl FoundRegisters {
    /// Stores the data of the pending read, `None` if it failed, and returns what to read next: the
    /// code, and in turn with it the sync managers while they are not known or may have changed.
    fn take(&mut self, data: Option<&[u8]>) -> Registers {
        let read = self.pending.take();
        match (read, data) {
            (Some(Registers::AlStatusCode), Some([low, high, ..])) => {
                let code = u16::from_le_bytes([*low, *high]);
                if code != 0 {
                    self.code = Some(AlStatusCode(code));
                    self.is_current = false;
                }
            }
            (Some(Registers::SyncManagers), Some(data)) => {
                if let Some(found) = sync_managers(data) {
                    self.sync_managers = Some(found);
                    self.is_current = true;
                }
            }
            _ => {}
        }
        match read {
            Some(Registers::AlStatusCode) if !self.is_current => Registers::SyncManagers,
            _ => Registers::AlStatusCode,
        }
    }
}

/// SM2 and SM3 of their registers; `None` if one is not configured.
fn sync_managers(registers: &[u8]) -> Option<[SyncManagerLayout; 2]> {
    let (sm2, rest) = registers.split_first_chunk()?;
    let (sm3, _) = rest.split_first_chunk()?;
    let found = [*sm2, *sm3].map(SyncManagerLayout::from_bytes);
    found.iter().all(|manager| manager.length != 0).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SM2 and SM3 with a length each.
    fn configured() -> [u8; SYNC_MANAGER_BYTES] {
        let mut registers = [0; SYNC_MANAGER_BYTES];
        registers[2] = 128;
        registers[SyncManagerLayout::BYTES + 2] = 128;
        registers
    }

    /// Takes the data of an accepted read; returns what is read next.
    fn read(found: &mut FoundRegisters, registers: Registers, data: &[u8]) -> Registers {
        found.pending = Some(registers);
        found.take(Some(data))
    }

    #[test]
    fn rejected_read_takes_no_data() {
        let mut found = FoundRegisters::default();
        // The request still has the data of an earlier read.
        assert_eq!(found.take(Some(&[0x1D; SYNC_MANAGER_BYTES])), Registers::AlStatusCode);
        assert!(found.code.is_none() && found.sync_managers.is_none());
    }

    #[test]
    fn failed_read_takes_no_data() {
        let mut found =
            FoundRegisters { pending: Some(Registers::AlStatusCode), ..Default::default() };
        assert_eq!(found.take(None), Registers::SyncManagers);
        assert!(found.code.is_none());
    }

    #[test]
    fn known_sync_managers_are_read_again_after_a_code() {
        use Registers::{AlStatusCode as Code, SyncManagers};

        let mut found = FoundRegisters::default();
        assert_eq!(found.take(None), Code);
        assert_eq!(read(&mut found, Code, &[0, 0]), SyncManagers);
        assert_eq!(read(&mut found, SyncManagers, &[0; SYNC_MANAGER_BYTES]), Code);
        assert_eq!(read(&mut found, Code, &[0, 0]), SyncManagers);
        assert_eq!(read(&mut found, SyncManagers, &configured()), Code);
        assert_eq!(read(&mut found, Code, &[0, 0]), Code);
        assert_eq!(read(&mut found, Code, &[0x1E, 0]), SyncManagers);
        assert_eq!(read(&mut found, SyncManagers, &configured()), Code);
        assert_eq!(read(&mut found, Code, &[0, 0]), Code);
        assert_eq!(found.code, Some(AlStatusCode(0x1E)));
        assert!(found.sync_managers.is_some());
    }
}
