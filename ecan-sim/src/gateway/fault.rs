use ecan_protocol::object::AbortCode;

/// A fault of a gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GatewayFault {
    /// The next `times` transfers of this object, upload or download, are aborted.
    SdoAbort {
        /// Object index.
        index: u16,
        /// Subindex.
        subindex: u8,
        /// Abort code that the master receives.
        code: u32,
        /// Number of transfers.
        times: u32,
    },
    /// The next `images` TxPDO images are published with `seq_end` one less than
    /// `seq_begin`, as if read during an update.
    TornTxPdo {
        /// Number of images.
        images: u32,
    },
    /// The next `images` TxPDO images carry a wrong payload CRC.
    CrcErrorTxPdo {
        /// Number of images.
        images: u32,
    },
    /// The slave falls back from OP to SAFEOP (a lower state is kept) and reports this AL status
    /// code with the error indication.
    AlError {
        /// AL status code.
        code: u16,
    },
    /// The distributed clock of the slave jumps.
    ClockJump {
        /// Size of the jump in nanoseconds.
        ns: i64,
    },
    /// The mailbox does not respond for this time.
    MailboxSilent {
        /// Duration in milliseconds from now.
        ms: u32,
    },
    /// The firmware runs no data-path service for this time, as when its main loop is blocked:
    /// images are neither parsed nor published.
    ServiceStall {
        /// Duration in milliseconds from now.
        ms: u32,
    },
    /// The next erasures or writes of the flash fail, of the saved configuration or of firmware.
    FlashFailure {
        /// Number of operations.
        times: u32,
    },
}

#[derive(Clone, Copy, Debug)]
struct SdoAbort {
    index: u16,
    subindex: u8,
    code: u32,
    times: u32,
}

#[derive(Debug, Default)]
pub(super) struct PendingFaults {
    sdo_aborts: Vec<SdoAbort>,
    torn_images: u32,
    crc_errors: u32,
    flash_failures: u32,
    pub(super) mailbox_silent_until: u64,
}

impl PendingFaults {
    pub(super) fn add_sdo_abort(&mut self, index: u16, subindex: u8, code: u32, times: u32) {
        self.sdo_aborts.push(SdoAbort { index, subindex, code, times });
    }

    pub(super) fn add_torn_images(&mut self, images: u32) {
        self.torn_images = self.torn_images.saturating_add(images);
    }

    pub(super) fn add_crc_errors(&mut self, images: u32) {
        self.crc_errors = self.crc_errors.saturating_add(images);
    }

    pub(super) fn add_flash_failures(&mut self, times: u32) {
        self.flash_failures = self.flash_failures.saturating_add(times);
    }

    pub(super) fn take_sdo_abort(&mut self, index: u16, subindex: u8) -> Option<AbortCode> {
        let matches = |abort: &SdoAbort| (abort.index, abort.subindex) == (index, subindex);
        let at = self.sdo_aborts.iter().position(matches)?;
        let abort = self.sdo_aborts.get_mut(at)?;
        let code = AbortCode(abort.code);
        abort.times = abort.times.saturating_sub(1);
        if abort.times == 0 {
            self.sdo_aborts.remove(at);
        }
        Some(code)
    }

    pub(super) fn take_torn_image(&mut self) -> bool {
        take_one(&mut self.torn_images)
    }

    pub(super) fn take_crc_error(&mut self) -> bool {
        take_one(&mut self.crc_errors)
    }

    pub(super) fn take_flash_failure(&mut self) -> bool {
        take_one(&mut self.flash_failures)
    }
}

fn take_one(count: &mut u32) -> bool {
    let any = *count > 0;
    *count = count.saturating_sub(1);
    any
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sdo_abort_concerns_its_object_and_number_of_transfers() {
        let mut faults = PendingFaults::default();
        faults.add_sdo_abort(0x8010, 1, 0x0800_0022, 2);
        assert_eq!(faults.take_sdo_abort(0x8010, 2), None);
        let aborts = [0; 3].map(|_| faults.take_sdo_abort(0x8010, 1));
        assert_eq!(aborts, [Some(AbortCode(0x0800_0022)), Some(AbortCode(0x0800_0022)), None]);
    }

    #[test]
    fn counted_faults_end_after_their_count() {
        let mut faults = PendingFaults::default();
        faults.add_flash_failures(1);
        faults.add_torn_images(2);
        assert_eq!([0; 2].map(|_| faults.take_flash_failure()), [true, false]);
        assert_eq!([0; 3].map(|_| faults.take_torn_image()), [true, true, false]);
        assert!(!faults.take_crc_error());
    }
}
