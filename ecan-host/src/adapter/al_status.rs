//! Watching the AL status codes and the sync managers of slaves while OP is waited for.

use ecan_protocol::device::AlStatusCode;
use ecan_protocol::mapping::SyncManagerLayout;

use crate::master::{Master, RegRequestId, RequestState};

const AL_STATUS_CODE_REGISTER: u16 = 0x0134;
/// Registers of SM2 and SM3.
const SYNC_MANAGER_REGISTERS: u16 = 0x0810;
const SYNC_MANAGER_BYTES: usize = 2 * SyncManagerLayout::BYTES;

/// Watches a slave's AL status code, and SM2 and SM3, while OP is waited for.
///
/// The master acknowledges errors, which clears the code, so the last one seen counts.
#[derive(Debug)]
pub(crate) struct AlStatusWatch {
    request: RegRequestId,
    last: Option<AlStatusCode>,
    /// SM2 and SM3 as the master configured them.
    sync_managers: Option<[SyncManagerLayout; 2]>,
    /// True if the request reads the sync managers.
    reads_sync_managers: bool,
}

impl AlStatusWatch {
    /// Bytes that the request must have room for.
    pub(crate) const BYTES: usize = SYNC_MANAGER_BYTES;

    pub(crate) fn new(request: RegRequestId) -> Self {
        Self { request, last: None, sync_managers: None, reads_sync_managers: false }
    }

    pub(crate) fn last(&self) -> Option<AlStatusCode> {
        self.last
    }

    pub(crate) fn clear(&mut self) {
        self.last = None;
        self.sync_managers = None;
    }

    /// SM2 and SM3 when they were last read with a length, that is configured.
    pub(crate) fn sync_managers(&self) -> Option<[SyncManagerLayout; 2]> {
        self.sync_managers
    }

    /// Takes what a read has brought and starts the next read: the code and the sync managers in
    /// turn.
    pub(crate) fn step(&mut self, master: &mut Master) {
        let Ok(state) = master.reg_request_state(self.request) else { return };
        if state == RequestState::Busy {
            return;
        }
        if state == RequestState::Success {
            let data = master.reg_request_data(self.request);
            if self.reads_sync_managers {
                self.sync_managers = sync_managers(data).or(self.sync_managers);
            } else if let [low, high, ..] = data {
                let code = u16::from_le_bytes([*low, *high]);
                self.last = (code != 0).then_some(AlStatusCode(code)).or(self.last);
            }
        }
        self.reads_sync_managers = !self.reads_sync_managers;
        let (address, size) = if self.reads_sync_managers {
            (SYNC_MANAGER_REGISTERS, SYNC_MANAGER_BYTES)
        } else {
            (AL_STATUS_CODE_REGISTER, 2)
        };
        // A slave that is gone rejects; the next step tries again.
        let _ = master.reg_request_read(self.request, address, size);
    }
}

/// SM2 and SM3 of their registers; `None` if one is not configured.
fn sync_managers(registers: &[u8]) -> Option<[SyncManagerLayout; 2]> {
    let (sm2, rest) = registers.split_first_chunk()?;
    let (sm3, _) = rest.split_first_chunk()?;
    let found = [*sm2, *sm3].map(SyncManagerLayout::from_bytes);
    found.iter().all(|manager| manager.length != 0).then_some(found)
}
