//! Faults of a gateway that are injected and still to take effect.

use ecan_protocol::object::AbortCode;

#[derive(Clone, Copy, Debug)]
struct SdoFault {
    index: u16,
    subindex: u8,
    /// Abort code; 0 if none.
    code: u32,
    times: u32,
}

/// The fault of a transfer, if it has one.
fn take(faults: &mut Vec<SdoFault>, index: u16, subindex: u8) -> Option<u32> {
    let at = faults.iter().position(|fault| (fault.index, fault.subindex) == (index, subindex))?;
    let fault = &mut faults[at];
    let code = fault.code;
    fault.times = fault.times.saturating_sub(1);
    if fault.times == 0 {
        faults.remove(at);
    }
    Some(code)
}

/// Number of operations that still fail.
#[derive(Clone, Debug, Default)]
pub(super) struct Count(u32);

impl Count {
    pub(super) fn add(&mut self, count: u32) {
        self.0 = self.0.saturating_add(count);
    }

    /// Returns whether the next operation fails.
    pub(super) fn take(&mut self) -> bool {
        let any = self.0 > 0;
        self.0 = self.0.saturating_sub(1);
        any
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct PendingFaults {
    sdo_aborts: Vec<SdoFault>,
    lost_responses: Vec<SdoFault>,
    /// The response of the last transfer gets lost.
    is_response_lost: bool,
    pub(super) torn_images: Count,
    pub(super) crc_errors: Count,
    /// Operations of the flash.
    pub(super) flash_failures: Count,
    mailbox_silent_until: u64,
}

impl PendingFaults {
    /// Aborts transfers of an object.
    pub(super) fn abort_transfers(&mut self, index: u16, subindex: u8, code: u32, times: u32) {
        self.sdo_aborts.push(SdoFault { index, subindex, code, times });
    }

    /// Loses the responses of transfers of an object.
    pub(super) fn lose_responses(&mut self, index: u16, subindex: u8, times: u32) {
        self.lost_responses.push(SdoFault { index, subindex, code: 0, times });
    }

    pub(super) fn silence_mailbox(&mut self, until: u64) {
        self.mailbox_silent_until = until;
    }

    pub(super) fn is_mailbox_silent(&self, now: u64) -> bool {
        now < self.mailbox_silent_until
    }

    /// A transfer begins: the abort code that it ends with.
    pub(super) fn begin_transfer(&mut self, index: u16, subindex: u8) -> Option<AbortCode> {
        self.is_response_lost = take(&mut self.lost_responses, index, subindex).is_some();
        take(&mut self.sdo_aborts, index, subindex).map(AbortCode)
    }

    /// Returns whether the response of the last transfer gets lost.
    pub(super) fn take_lost_response(&mut self) -> bool {
        std::mem::take(&mut self.is_response_lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sdo_abort_concerns_its_object_and_number_of_transfers() {
        let mut faults = PendingFaults::default();
        let fault = SdoFault { index: 0x8010, subindex: 1, code: 0x0800_0022, times: 2 };
        faults.sdo_aborts.push(fault);
        assert_eq!(faults.begin_transfer(0x8010, 2), None);
        let aborts = [0; 3].map(|_| faults.begin_transfer(0x8010, 1));
        assert_eq!(aborts, [Some(AbortCode(0x0800_0022)), Some(AbortCode(0x0800_0022)), None]);
    }

    #[test]
    fn counted_faults_end_after_their_count() {
        let mut faults = PendingFaults::default();
        faults.flash_failures.add(1);
        faults.torn_images.add(2);
        assert_eq!([0; 2].map(|_| faults.flash_failures.take()), [true, false]);
        assert_eq!([0; 3].map(|_| faults.torn_images.take()), [true, true, false]);
        assert!(!faults.crc_errors.take());
    }
}
