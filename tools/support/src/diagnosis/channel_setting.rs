//! Findings of the settings of a channel: failed commands, and values with which frames are lost without an
//! error (manual 5.4.3, 5.4.6, 13.4, 16.3).

use ecan_protocol::can::{MCAN_CLOCK_HZ, tdc_active};
use ecan_protocol::config::{
    ApplyStatus, BitTimingMode, ConfigObject, DataSize, MESSAGE_RAM_BYTES, McanChannelConfig,
    NodeMode, NonMatch,
};
use ecan_protocol::image::ChannelState;

use super::Finding;
use super::channel::{Channel, bus_error};

/// The manual gives no detail for status 1. Status 3: the values cannot be converted into a
/// controller configuration; 4: the driver or the restart of the controller failed. It is open
/// whether a layout that exceeds the Message RAM is 3 or 4.
const FAILED: &str = "not specified by the gateway: a busy channel, or a rejected value";
const RESTART_FAILED: &str = "the CAN controller did not restart, or its driver failed";

/// Elements of the Message RAM that hold frames: entry of their data size, name, and number of the FIFO for
/// frames that no filter matches; without a number the channel always uses them.
const ELEMENTS: [(u8, &str, Option<NonMatch>); 3] = [
    (65, "RX FIFO0", Some(NonMatch::Fifo0)),
    (66, "RX FIFO1", Some(NonMatch::Fifo1)),
    (72, "the transmit FIFO", None),
];
const NON_MATCH: [u8; 2] = [36, 37];
const FILTER_COUNTS: [u8; 2] = [49, 55];

pub(super) fn findings(channel: &Channel<'_>) -> Vec<Finding> {
    let checks = [
        apply_command,
        flash_command,
        masks,
        node_mode,
        rejects_all,
        short_elements,
        unpaired_compensation,
        sample_point_range,
    ];
    checks.into_iter().filter_map(|check| check(channel)).collect()
}

fn apply_command(channel: &Channel<'_>) -> Option<Finding> {
    let raw = channel.config(2).filter(|raw| *raw != 0)?;
    let status = ApplyStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
    let what = format!("configuration not applied, the previous one stays active: {status}");
    let finding = channel.fault("apply-failed", what);
    let known = configuration_faults(channel);
    let is_known = !known.is_empty();
    let finding = known.into_iter().fold(finding, Finding::cause);
    let out_of_range = format!("a value of 0x{:04X} is out of range", channel.config_object());
    let ram =
        format!("the elements exceed the Message RAM of the channel ({MESSAGE_RAM_BYTES} bytes)");
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
    let (apply, status) = (channel.config_entry(1), channel.config_entry(2));
    let next = format!("correct the configuration, apply it ({apply} = 1) and read {status} again");
    let finding = finding.cause(format!("this channel: {}", channel.rates()));
    finding.next_step(next, "13.4")
}

fn flash_command(channel: &Channel<'_>) -> Option<Finding> {
    let raw = channel.config(4).filter(|raw| *raw != 0)?;
    let status = ApplyStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
    let finding = channel.fault("flash-failed", format!("the last Flash command failed: {status}"));
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
    let (save, status) = (channel.config_entry(3), channel.config_entry(4));
    let next = format!("save the configuration again ({save} = 1) and read {status} again");
    finding.next_step(next, "13.4")
}

/// Problems of the channel's values. Values that were not read count as default.
fn configuration_faults(channel: &Channel<'_>) -> Vec<String> {
    let mut faults = Vec::new();
    let mut config = McanChannelConfig::DEVICE_DEFAULT;
    for subindex in McanChannelConfig::fields().map(|entry| entry.subindex) {
        if let Some(value) = channel.config(subindex)
            && config.set_value(subindex, value).is_err()
        {
            faults.push(format!("invalid value {value} of {}", channel.config_entry(subindex)));
        }
    }
    // A manual timing that was not read cannot be checked.
    if config.bit_timing_mode == BitTimingMode::Manual && channel.config(25).is_none() {
        return faults;
    }
    let clock_hz = channel.snapshot.get(0x8000, 6 + channel.number).unwrap_or(MCAN_CLOCK_HZ);
    config.check_at(clock_hz, &mut |fault| faults.push(fault.to_string()));
    faults
}

/// "CAN is not sent" and "CAN cannot be received" of manual 5.4.6.
fn masks(channel: &Channel<'_>) -> Option<Finding> {
    let bit = |mask: u32| mask >> channel.number & 1 == 1;
    let tx = bit(channel.snapshot.active_mask(0x8010)?);
    let rx = bit(channel.snapshot.active_mask(0x8011)?);
    let is_off = channel.status()?.state() == ChannelState::Disabled;
    match (tx, rx) {
        (false, false) => None,
        _ if is_off => not_applied(channel),
        (true, true) => None,
        (true, false) => masked_out(channel, "cannot-send", "sent", 0x8011),
        (false, true) => masked_out(channel, "cannot-receive", "received", 0x8010),
    }
}

fn not_applied(channel: &Channel<'_>) -> Option<Finding> {
    channel
        .fault("channel-off", "the channel is in the channel masks but disabled")
        .cause(format!(
            "its configuration was not applied ({} = 1) after the start of the gateway",
            channel.config_entry(1)
        ))
        .cause("the last apply failed")
        .next_step("write and apply its configuration in the startup list of the master", "5.4.6")
}

fn masked_out(channel: &Channel<'_>, id: &'static str, word: &str, object: u16) -> Option<Finding> {
    let what = format!("frames of this channel are not {word}: the channel mask excludes it");
    channel
        .warning(id, what)
        .cause(format!("bit {} is not set in 0x{object:04X}:04", channel.number))
        .next_step(
            format!(
                "unless that is intended, set the bit in 0x{object:04X}:04 and apply, in PREOP"
            ),
            "5.4.6",
        )
}

fn node_mode(channel: &Channel<'_>) -> Option<Finding> {
    if !channel.is_running() {
        return None;
    }
    let mode = NodeMode::from_raw(u8::try_from(channel.config(8)?).ok()?)?;
    let what = match mode {
        NodeMode::Normal => return None,
        NodeMode::Listen => "listen mode: the channel does not send or acknowledge",
        NodeMode::InternalLoopback => "internal loopback: the channel is disconnected from the bus",
        NodeMode::ExternalLoopback => "external loopback: the channel receives only its own frames",
    };
    let (mode, apply) = (channel.config_entry(8), channel.config_entry(1));
    channel
        .warning("node-mode", what)
        .cause("the mode was not reset after a test")
        .next_step(format!("write node mode 0 ({mode}) and apply ({apply} = 1)"), "13.4")
}

fn has_fd(channel: &Channel<'_>) -> bool {
    channel.config(15) == Some(1)
}

fn non_match(channel: &Channel<'_>) -> [Option<NonMatch>; 2] {
    NON_MATCH.map(|entry| NonMatch::from_raw(u8::try_from(channel.config(entry)?).ok()?))
}

/// CAN FD frames that are longer than the elements in which they are kept.
fn short_elements(channel: &Channel<'_>) -> Option<Finding> {
    if !channel.is_running() || !has_fd(channel) {
        return None;
    }
    let non_match = non_match(channel);
    let short = ELEMENTS.into_iter().filter_map(|(entry, name, fifo)| {
        let size = DataSize::from_raw(u8::try_from(channel.config(entry)?).ok()?)?;
        let is_used = fifo.is_none() || non_match.contains(&fifo);
        let text = format!(
            "{name} {} bytes ({} = {})",
            size.bytes(),
            channel.config_entry(entry),
            size.raw()
        );
        (is_used && size.bytes() < DataSize::B64.bytes()).then_some(text)
    });
    let short: Vec<_> = short.collect();
    if short.is_empty() {
        return None;
    }
    let what = format!("longer CAN FD frames are truncated: an element of {}", short.join(", of "));
    let apply = channel.config_entry(1);
    channel.warning("short-elements", what)
        .cause("the layout of the Message RAM is that of classic CAN")
        .next_step(
            format!("unless all frames are shorter, write data size 7 (64 bytes) and apply ({apply} = 1)"),
            "13.4, 5.4.3",
        )
}

/// Without a filter every frame is one that no filter matches.
fn rejects_all(channel: &Channel<'_>) -> Option<Finding> {
    let rejects = |non_match: &Option<NonMatch>| {
        matches!(non_match, Some(NonMatch::Reject | NonMatch::RejectToo))
    };
    let has_filter = FILTER_COUNTS.iter().any(|entry| channel.config(*entry) != Some(0));
    if !channel.is_running() || has_filter || !non_match(channel).iter().all(rejects) {
        return None;
    }
    let [standard, extended] = NON_MATCH.map(|entry| channel.config_entry(entry));
    let apply = channel.config_entry(1);
    channel
        .warning(
            "rejects-all",
            "the channel receives nothing: it has no filter and rejects frames without a match",
        )
        .cause(format!(
            "{standard} and {extended} are 2 or 3 (reject), and no filter is configured"
        ))
        .cause("the filters were not saved, and are lost by a restart")
        .next_step(
            format!("add filters (`ecan filter`), or write 0 (FIFO0) and apply ({apply} = 1)"),
            "5.4.6, 13.4",
        )
}

/// Offset and filter of the delay compensation belong together.
fn unpaired_compensation(channel: &Channel<'_>) -> Option<Finding> {
    let (offset, filter) = (channel.config(33)?, channel.config(34)?);
    let is_pair = (offset == 0) == (filter == 0);
    if !channel.is_running() || !has_fd(channel) || is_pair {
        return None;
    }
    let is_active = tdc_active(channel.config(16)? != 0, channel.config(20)?);
    // Errors of the data phase name it as their cause.
    let has_errors = bus_error(channel).is_some_and(|finding| finding.id == "data-phase-error");
    if !is_active || has_errors {
        return None;
    }
    let (offset_entry, filter_entry) = (channel.config_entry(33), channel.config_entry(34));
    let what = format!(
        "TDC offset and filter are not a pair: {offset_entry} = {offset}, {filter_entry} = {filter}"
    );
    channel
        .warning("tdc-unpaired", what)
        .cause("only one of the two was written; 0 is automatic")
        .next_step("write both, or 0 to both, and apply the channel", "13.4, 14.3, 16.3")
}

/// The firmware chooses a sample point of the range, which the peers may not have.
fn sample_point_range(channel: &Channel<'_>) -> Option<Finding> {
    let range = |min: u8, max: u8| {
        let (low, high) = (channel.config(min)?, channel.config(max)?);
        (low != high).then_some((low, high))
    };
    let is_automatic = channel.config(7).is_none_or(|mode| mode == 0);
    if !channel.is_running() || !has_fd(channel) || !is_automatic {
        return None;
    }
    let wide = [("nominal", range(21, 22)), ("data", range(23, 24))];
    let percent = |raw: u32| f64::from(raw) / 10.0;
    let text: Vec<_> = wide
        .into_iter()
        .filter_map(|(name, range)| {
            let (low, high) = range?;
            Some(format!("{name} {:.1} to {:.1} %", percent(low), percent(high)))
        })
        .collect();
    if text.is_empty() {
        return None;
    }
    let what = format!("the firmware chooses the sample point of CAN FD: {}", text.join(", "));
    channel.warning("sample-point-range", what)
        .cause("the range of the defaults was kept; the timing may not match that of the peers")
        .next_step(
            format!(
                "write the sample point of the peers as both bounds ({} to {}) and apply the channel",
                channel.config_entry(21),
                channel.config_entry(24)
            ),
            "5.4.3, 16.3",
        )
}
