//! Mode of a CAN controller that must only listen, from the steps of the verification.

use ecan_protocol::device::{CCCR, ControllerMode, TEST};
use ecan_protocol::mapping::CHANNELS;

use crate::session::verification::{Check, ControllerStep, VerificationFault};

/// Status of the register service: busy (manual 13.6).
const BUSY: u32 = 3;
/// Failed attempts in a row from which the mode of a channel counts as not readable.
const MAX_ATTEMPTS: u8 = 3;

/// Registers of the channel whose steps are in progress, and the attempts of all channels.
#[derive(Debug, Default)]
pub(crate) struct ControllerReading {
    cccr: u32,
    test: u32,
    /// The service rejected an access to the channel.
    is_rejected: bool,
    /// First fault of the channel that may pass.
    channel_fault: Option<VerificationFault>,
    /// First fault of the attempt that may pass. The channels after it are read nevertheless, so
    /// that their attempts count, too.
    fault: Option<VerificationFault>,
    /// Attempts in a row that did not read the mode, by channel.
    failed_attempts: [u8; CHANNELS],
    /// Channels whose unverified mode is logged.
    logged: u8,
}

impl ControllerReading {
    /// Begins another attempt.
    pub(crate) fn restart(&mut self) {
        self.fault = None;
    }

    /// Fault of the attempt that may pass, after the steps of all channels.
    pub(crate) fn take_fault(&mut self) -> Option<VerificationFault> {
        self.fault.take()
    }

    /// Takes the value of a step; `None` if the transfer failed. Decides after the last step of a
    /// channel: an access that the service rejects, and one that fails in several attempts in a row, is
    /// a warning, because firmware may lack the service or deny the access.
    pub(crate) fn take(
        &mut self,
        slave: usize,
        channel: u8,
        step: ControllerStep,
        value: Option<u32>,
    ) -> Result<(), VerificationFault> {
        if step == ControllerStep::Offset(CCCR) {
            (self.is_rejected, self.channel_fault) = (false, None);
        }
        let in_use = VerificationFault::RegisterServiceInUse { channel };
        let fault = match (step, value) {
            (_, None) => {
                Some(VerificationFault::Transfer(Check::Controller { channel, step }.transfer()))
            }
            (ControllerStep::Status, Some(BUSY)) => Some(in_use),
            (ControllerStep::Status, Some(status)) => {
                self.is_rejected |= status != 0;
                None
            }
            (ControllerStep::Value(CCCR), Some(value)) => {
                self.cccr = value;
                None
            }
            (ControllerStep::Value(_), Some(value)) => {
                self.test = value;
                None
            }
            // The result belongs to the access of another program.
            (ControllerStep::OffsetReadback(offset), Some(value)) => {
                (value != u32::from(offset)).then_some(in_use)
            }
            (ControllerStep::Offset(_) | ControllerStep::Command, Some(_)) => None,
        };
        self.channel_fault = self.channel_fault.or(fault);
        match step {
            ControllerStep::OffsetReadback(TEST) => self.decide(slave, channel),
            _ => Ok(()),
        }
    }

    fn decide(&mut self, slave: usize, channel: u8) -> Result<(), VerificationFault> {
        let attempts = &mut self.failed_attempts[usize::from(channel) % CHANNELS];
        if let Some(fault) = self.channel_fault {
            *attempts = attempts.saturating_add(1);
            if *attempts < MAX_ATTEMPTS {
                self.fault = self.fault.or(Some(fault));
                return Ok(());
            }
        }
        if self.channel_fault.is_some() || self.is_rejected {
            if self.logged >> channel & 1 == 0 {
                self.logged |= 1 << channel;
                warn_unverified(slave, channel);
            }
            return Ok(());
        }
        *attempts = 0;
        self.logged &= !(1 << channel);
        match ControllerMode::of(self.cccr, self.test) {
            ControllerMode::Listen => Ok(()),
            mode => Err(VerificationFault::NodeMode { channel, mode }),
        }
    }
}

/// Logs that the mode of a channel that must only listen is not verified.
pub(crate) fn warn_unverified(slave: usize, channel: u8) {
    tracing::warn!(
        slave,
        channel,
        "slave {slave} channel {channel}: the registers of the controller cannot be read; that node \
         mode 1 is listen-only is not verified (assumption H9)"
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHANNEL: u8 = 2;
    /// Values of the steps of a channel that listens.
    const LISTENING: [Option<u32>; 10] = values(0x20, 0x80);
    const IN_USE: VerificationFault = VerificationFault::RegisterServiceInUse { channel: CHANNEL };

    const fn values(cccr: u32, test: u32) -> [Option<u32>; 10] {
        let (cccr, test) = (Some(cccr), Some(test));
        let (zero, cccr_offset, test_offset) = (Some(0), Some(CCCR as u32), Some(TEST as u32));
        [zero, zero, zero, cccr, cccr_offset, zero, zero, zero, test, test_offset]
    }

    /// Result of one attempt.
    fn attempt(
        reading: &mut ControllerReading,
        values: [Option<u32>; 10],
    ) -> Result<(), VerificationFault> {
        reading.restart();
        let steps = [CCCR, TEST].into_iter().flat_map(ControllerStep::of_register);
        steps.zip(values).try_for_each(|(step, value)| reading.take(0, CHANNEL, step, value))?;
        reading.take_fault().map_or(Ok(()), Err)
    }

    fn with(nth: usize, value: Option<u32>) -> [Option<u32>; 10] {
        let mut values = LISTENING;
        values[nth] = value;
        values
    }

    fn failed(step: ControllerStep) -> Result<(), VerificationFault> {
        let check = Check::Controller { channel: CHANNEL, step };
        Err(VerificationFault::Transfer(check.transfer()))
    }

    #[test]
    fn mode_is_read_from_both_registers() {
        let mut reading = ControllerReading::default();
        assert_eq!(attempt(&mut reading, LISTENING), Ok(()));
        for (cccr, test, mode) in [
            (0x00, 0x80, ControllerMode::Normal),
            (0xA0, 0x90, ControllerMode::InternalLoopback),
            (0x80, 0x90, ControllerMode::ExternalLoopback),
        ] {
            let fault = VerificationFault::NodeMode { channel: CHANNEL, mode };
            assert_eq!(attempt(&mut reading, values(cccr, test)), Err(fault));
        }
    }

    #[test]
    fn rejected_access_is_no_fault() {
        for status in [1, 4] {
            for nth in [2, 7] {
                let mut reading = ControllerReading::default();
                assert_eq!(attempt(&mut reading, with(nth, Some(status))), Ok(()));
                assert_eq!(reading.logged, 1 << CHANNEL);
            }
        }
    }

    #[test]
    fn failed_transfers_are_repeated_twice() {
        let mut reading = ControllerReading::default();
        let offset = failed(ControllerStep::Offset(CCCR));
        assert_eq!(attempt(&mut reading, [None; 10]), offset);
        assert_eq!(attempt(&mut reading, [None; 10]), offset);
        for _ in 0..300 {
            assert_eq!(attempt(&mut reading, [None; 10]), Ok(()));
        }
        assert_eq!(reading.logged, 1 << CHANNEL);
        assert_eq!(attempt(&mut reading, LISTENING), Ok(()));
        assert_eq!(reading.logged, 0);
        assert_eq!(attempt(&mut reading, [None; 10]), offset);
    }

    #[test]
    fn any_failed_transfer_prevents_a_decision() {
        for nth in 0..10 {
            let mut normal = values(0, 0);
            normal[nth] = None;
            let result = attempt(&mut ControllerReading::default(), normal);
            assert!(matches!(result, Err(VerificationFault::Transfer(_))), "{nth}: {result:?}");
        }
    }

    #[test]
    fn busy_or_shared_service_is_read_again() {
        for (nth, value) in [(2, BUSY), (7, BUSY), (4, TEST.into()), (9, 0x1C)] {
            let mut reading = ControllerReading::default();
            assert_eq!(attempt(&mut reading, with(nth, Some(value))), Err(IN_USE));
            assert_eq!(attempt(&mut reading, LISTENING), Ok(()));
        }
    }
}
