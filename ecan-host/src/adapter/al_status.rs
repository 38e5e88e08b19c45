//! Watching the AL status codes of slaves on their way to OP.

use ecan_protocol::device::AlStatusCode;

use crate::master::{Master, RegRequestId, RequestState};

const AL_STATUS_CODE_REGISTER: u16 = 0x0134;

/// Watches a slave's AL status code while OP is waited for.
///
/// The master acknowledges errors, which clears the code, so the last one seen counts.
#[derive(Debug)]
pub(crate) struct AlStatusWatch {
    request: RegRequestId,
    last: Option<AlStatusCode>,
}

impl AlStatusWatch {
    pub(crate) fn new(request: RegRequestId) -> Self {
        Self { request, last: None }
    }

    pub(crate) fn last(&self) -> Option<AlStatusCode> {
        self.last
    }

    pub(crate) fn clear(&mut self) {
        self.last = None;
    }

    /// Takes the code that a read has brought and starts the next read.
    pub(crate) fn step(&mut self, master: &mut Master) {
        let Ok(state) = master.reg_request_state(self.request) else { return };
        if state == RequestState::Busy {
            return;
        }
        if state == RequestState::Success
            && let [low, high, ..] = master.reg_request_data(self.request)
        {
            let code = u16::from_le_bytes([*low, *high]);
            self.last = (code != 0).then_some(AlStatusCode(code)).or(self.last);
        }
        // A slave that is gone rejects; the next step tries again.
        let _ = master.reg_request_read(self.request, AL_STATUS_CODE_REGISTER, 2);
    }
}
