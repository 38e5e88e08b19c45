//! Commands about a channel's configuration that failed (manual 13.4, "Channel commands and
//! status").

use ecan_protocol::can::MCAN_CLOCK_HZ;
use ecan_protocol::config::{
    ApplyStatus, BitTimingMode, ConfigObject, MESSAGE_RAM_BYTES, McanChannelConfig,
};

use super::channel::Channel;
use crate::finding::Finding;

/// What the manual's status numbers say, and what may be behind each: 1 says nothing, 3 that the
/// values could not be made into a configuration of the controller, 4 that the driver or the restart
/// of the controller failed. It leaves open whether a layout that exceeds the Message RAM is 3 or 4.
const FAILED: &[&str] =
    &["the gateway gives no reason: a busy channel, or a value that it refuses"];
const RESTART_FAILED: &str = "the CAN controller did not restart, or its driver failed";

impl Channel<'_> {
    /// The last apply command.
    pub(super) fn apply_command(&self) -> Option<Finding> {
        let raw = self.config(2).filter(|raw| *raw != 0)?;
        let status = ApplyStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
        let what =
            format!("the configuration was not applied, the channel runs as before: {status}");
        let finding = self.fault("apply-failed", what);
        let known = self.configuration_faults();
        let is_known = !known.is_empty();
        let finding = known.into_iter().fold(finding, Finding::or_because);
        let out_of_range = format!("a value of 0x{:04X} is out of its range", self.config_object());
        let ram = format!(
            "the elements exceed the Message RAM of the channel ({MESSAGE_RAM_BYTES} bytes)"
        );
        let finding = match status {
            // What the values themselves show needs no guess.
            ApplyStatus::BuildFail if is_known => finding,
            ApplyStatus::RuntimeFail if is_known => finding.because(&[RESTART_FAILED]),
            ApplyStatus::BuildFail => finding
                .because(&[
                    "no bit timing fits bit rate and sample point window at the channel's clock",
                ])
                .or_because(out_of_range)
                .or_because(ram),
            ApplyStatus::RuntimeFail => finding.because(&[RESTART_FAILED]).or_because(ram),
            _ => finding.because(FAILED).or_because(out_of_range).or_because(ram),
        };
        let finding = finding.or_because(format!("here {}", self.rates()));
        let next = format!(
            "correct the configuration, apply it ({} = 1) and read {} again",
            self.config_entry(1),
            self.config_entry(2)
        );
        Some(finding.so(next, "13.4"))
    }

    /// The last Flash command.
    pub(super) fn flash_command(&self) -> Option<Finding> {
        let raw = self.config(4).filter(|raw| *raw != 0)?;
        let status = ApplyStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
        let finding =
            self.fault("flash-failed", format!("the last Flash command failed: {status}"));
        let finding = match status {
            ApplyStatus::BuildFail => finding.because(&[
                "what is stored is damaged, or another firmware stored it",
                "nothing is stored",
            ]),
            ApplyStatus::RuntimeFail => finding.because(&[RESTART_FAILED]),
            _ => finding.because(&[
                "nothing is stored, or what is stored is damaged",
                "the Flash is busy or could not be written",
            ]),
        };
        let next = format!(
            "save the configuration anew ({} = 1) and read {} again",
            self.config_entry(3),
            self.config_entry(4)
        );
        Some(finding.so(next, "13.4"))
    }

    /// What is wrong with the values that the channel has. Those that were not read count as the
    /// device's default, with which nothing is wrong.
    fn configuration_faults(&self) -> Vec<String> {
        let mut faults = Vec::new();
        let mut config = McanChannelConfig::DEVICE_DEFAULT;
        for subindex in McanChannelConfig::fields().map(|entry| entry.subindex) {
            if let Some(value) = self.config(subindex)
                && config.set_value(subindex, value).is_err()
            {
                faults.push(format!(
                    "{} is {value}, which means nothing",
                    self.config_entry(subindex)
                ));
            }
        }
        // A manual timing that was not read cannot be judged.
        if config.bit_timing_mode == BitTimingMode::Manual && self.config(25).is_none() {
            return faults;
        }
        let clock_hz = self.snapshot.get(0x8000, 6 + self.number).unwrap_or(MCAN_CLOCK_HZ);
        config.check_at(clock_hz, &mut |fault| faults.push(fault.to_string()));
        faults
    }
}
