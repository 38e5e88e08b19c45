//! Mode of a CAN controller that must only listen, from the steps of the verification.

use ecan_protocol::device::{CCCR, ControllerMode};

use crate::session::verification::{ControllerStep, VerificationFault};

/// Registers of the channel whose steps are in progress.
#[derive(Debug, Default)]
pub(crate) struct ControllerReading {
    cccr: u32,
    /// The gateway rejected a step of the channel: its mode is not verified.
    is_unreadable: bool,
    /// Channels whose unverified mode is logged.
    logged: u8,
}

impl ControllerReading {
    /// Takes the value of a step; `None` if the gateway rejected it. Firmware may lack the register
    /// service or deny the access: a warning.
    pub(crate) fn take(
        &mut self,
        slave: usize,
        channel: u8,
        step: ControllerStep,
        value: Option<u32>,
    ) -> Result<(), VerificationFault> {
        if step == ControllerStep::Offset(CCCR) {
            self.is_unreadable = false;
        }
        let is_rejected = step == ControllerStep::Status && value.is_some_and(|status| status != 0);
        let Some(value) = value.filter(|_| !is_rejected) else {
            self.is_unreadable = true;
            if self.logged >> channel & 1 == 0 {
                self.logged |= 1 << channel;
                tracing::warn!(
                    slave,
                    channel,
                    "slave {slave} channel {channel}: the registers of the controller cannot be read; that node \
                     mode 1 is listen-only is not verified (assumption H9)"
                );
            }
            return Ok(());
        };
        match step {
            ControllerStep::Value(CCCR) => self.cccr = value,
            ControllerStep::Value(_) if !self.is_unreadable => {
                let mode = ControllerMode::of(self.cccr, value);
                if mode != ControllerMode::Listen {
                    return Err(VerificationFault::NodeMode { channel, mode });
                }
            }
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use ecan_protocol::device::TEST;

    use super::*;

    fn read(values: [Option<u32>; 8]) -> Result<(), VerificationFault> {
        let mut reading = ControllerReading::default();
        let of = |offset| {
            let (select, value) = (ControllerStep::Offset(offset), ControllerStep::Value(offset));
            [select, ControllerStep::Command, ControllerStep::Status, value]
        };
        let steps = of(CCCR).into_iter().chain(of(TEST));
        steps.zip(values).try_for_each(|(step, value)| reading.take(0, 2, step, value))
    }

    #[test]
    fn mode_is_read_from_both_registers() {
        let values = |cccr, test| [0, 0, 0, cccr, 0, 0, 0, test].map(Some);
        assert_eq!(read(values(0x20, 0x80)), Ok(()));
        for (cccr, test, mode) in [
            (0x00, 0x80, ControllerMode::Normal),
            (0xA0, 0x90, ControllerMode::InternalLoopback),
            (0x80, 0x90, ControllerMode::ExternalLoopback),
        ] {
            assert_eq!(
                read(values(cccr, test)),
                Err(VerificationFault::NodeMode { channel: 2, mode })
            );
        }
    }

    #[test]
    fn unreadable_registers_are_no_fault() {
        assert_eq!(read([None; 8]), Ok(()));
        let mut denied = [0, 0, 4, 0, 0, 0, 4, 0].map(Some);
        assert_eq!(read(denied), Ok(()));
        denied[6] = Some(0);
        assert_eq!(read(denied), Ok(()));
    }
}
