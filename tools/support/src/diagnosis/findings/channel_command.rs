//! Findings of failed channel commands (manual 13.4, "Channel commands and status").

use ecan_protocol::can::MCAN_CLOCK_HZ;
use ecan_protocol::config::{
    ApplyStatus, BitTimingMode, ConfigObject, MESSAGE_RAM_BYTES, McanChannelConfig,
};

use super::channel::Channel;
use crate::diagnosis::finding::Finding;

/// The manual gives no detail for status 1. Status 3: the values cannot be converted into a
/// controller configuration; 4: the driver or the restart of the controller failed. It is open
/// whether a layout that exceeds the Message RAM is 3 or 4.
const FAILED: &str = "not specified by the gateway: a busy channel, or a rejected value";
const RESTART_FAILED: &str = "the CAN controller did not restart, or its driver failed";

impl Channel<'_> {
    pub(super) fn apply_command(&self) -> Option<Finding> {
        let raw = self.config(2).filter(|raw| *raw != 0)?;
        let status = ApplyStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
        let what = format!("configuration not applied, the previous one stays active: {status}");
        let finding = self.fault("apply-failed", what);
        let known = self.configuration_faults();
        let is_known = !known.is_empty();
        let finding = known.into_iter().fold(finding, Finding::cause);
        let out_of_range = format!("a value of 0x{:04X} is out of range", self.config_object());
        let ram = format!(
            "the elements exceed the Message RAM of the channel ({MESSAGE_RAM_BYTES} bytes)"
        );
        let finding = match status {
            // Causes found in the values come first.
            ApplyStatus::BuildFail if is_known => finding,
            ApplyStatus::RuntimeFail if is_known => finding.cause(RESTART_FAILED),
            ApplyStatus::BuildFail => finding
                .cause("no bit timing matches the bit rate and sample point window at the clock of the channel")
                .cause(out_of_range)
                .cause(ram),
            ApplyStatus::RuntimeFail => finding.cause(RESTART_FAILED).cause(ram),
            _ => finding.cause(FAILED).cause(out_of_range).cause(ram),
        };
        let (apply, status) = (self.config_entry(1), self.config_entry(2));
        let next =
            format!("correct the configuration, apply it ({apply} = 1) and read {status} again");
        let finding = finding.cause(format!("this channel: {}", self.rates()));
        finding.next_step(next, "13.4")
    }

    pub(super) fn flash_command(&self) -> Option<Finding> {
        let raw = self.config(4).filter(|raw| *raw != 0)?;
        let status = ApplyStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
        let finding =
            self.fault("flash-failed", format!("the last Flash command failed: {status}"));
        let finding = match status {
            ApplyStatus::BuildFail => finding.causes(&[
                "the saved configuration is damaged, or from another firmware",
                "no saved configuration",
            ]),
            ApplyStatus::RuntimeFail => finding.cause(RESTART_FAILED),
            _ => finding.causes(&[
                "no saved configuration, or it is damaged",
                "the Flash is busy or cannot be written",
            ]),
        };
        let (save, status) = (self.config_entry(3), self.config_entry(4));
        let next = format!("save the configuration again ({save} = 1) and read {status} again");
        finding.next_step(next, "13.4")
    }

    /// Problems of the channel's values. Values that were not read count as default.
    fn configuration_faults(&self) -> Vec<String> {
        let mut faults = Vec::new();
        let mut config = McanChannelConfig::DEVICE_DEFAULT;
        for subindex in McanChannelConfig::fields().map(|entry| entry.subindex) {
            if let Some(value) = self.config(subindex)
                && config.set_value(subindex, value).is_err()
            {
                faults.push(format!("invalid value {value} of {}", self.config_entry(subindex)));
            }
        }
        // A manual timing that was not read cannot be checked.
        if config.bit_timing_mode == BitTimingMode::Manual && self.config(25).is_none() {
            return faults;
        }
        let clock_hz = self.snapshot.get(0x8000, 6 + self.number).unwrap_or(MCAN_CLOCK_HZ);
        config.check_at(clock_hz, &mut |fault| faults.push(fault.to_string()));
        faults
    }
}
