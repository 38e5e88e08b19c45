//! Findings of a CAN channel in a snapshot. Of its bus: error states, and what PSR, IR and ECR show of bit rates,
//! sample points and TDC (manual 13.5, 16.3). Of frames that it lost, in the CAN controller and on the way to the
//! process data (manual 13.2.1, 13.2.2, 13.2.5, 13.5).
//!
//! The M_CAN core separates the data phase of CAN FD frames with bit rate switch (DLEC, IR.PED) from all
//! other bits (LEC, IR.PEA). An error of the data phase excludes nothing but a wrong nominal bit rate: the
//! switch to it takes place at the nominal sample point.

use ecan_protocol::can::tdc_active;
use ecan_protocol::config::ApplyStatus;
use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;

use super::registers::{
    ErrorCounters, EventFifoStatus, Interrupts, LastErrorCode, ProtocolStatus, ReceiveFifoStatus,
    TransmitQueueStatus,
};
use super::snapshot::{ObjectKey, Snapshot};
use super::{Finding, Location};

/// A channel of a snapshot.
#[derive(Clone, Copy)]
pub(super) struct Channel<'a> {
    pub(super) snapshot: &'a Snapshot,
    pub(super) number: u8,
}

impl<'a> Channel<'a> {
    pub(super) fn of(snapshot: &'a Snapshot, number: u8) -> Self {
        Self { snapshot, number }
    }

    pub(super) fn information(&self, subindex: u8) -> Option<u32> {
        self.snapshot.get(0x9000 + u16::from(self.number), subindex)
    }

    /// Object 0x8001 to 0x8004 of the channel.
    pub(super) fn config_object(&self) -> u16 {
        0x8001 + u16::from(self.number)
    }

    pub(super) fn config(&self, subindex: u8) -> Option<u32> {
        self.snapshot.get(self.config_object(), subindex)
    }

    pub(super) fn config_entry(&self, subindex: u8) -> ObjectKey {
        ObjectKey { index: self.config_object(), subindex }
    }

    pub(super) fn data_path_entry(&self, subindex: u8) -> ObjectKey {
        ObjectKey { index: 0x8021 + u16::from(self.number), subindex }
    }

    pub(super) fn fault(&self, id: &'static str, what: impl Into<String>) -> Finding {
        Finding::fault(id, Location::Channel(self.number), what)
    }

    pub(super) fn warning(&self, id: &'static str, what: impl Into<String>) -> Finding {
        Finding::warning(id, Location::Channel(self.number), what)
    }

    pub(super) fn status(&self) -> Option<ChannelStatus> {
        Some(ChannelStatus::from_raw(self.information(9)? as u16))
    }

    pub(super) fn is_running(&self) -> bool {
        self.status().is_some_and(|status| {
            !matches!(status.state(), ChannelState::Disabled | ChannelState::Init)
        })
    }

    pub(super) fn counters(&self) -> ErrorCounters {
        ErrorCounters::from_raw(self.information(1).unwrap_or(0))
    }

    pub(super) fn protocol(&self) -> ProtocolStatus {
        // Default without a value: no change since the last read.
        ProtocolStatus::from_raw(self.information(2).unwrap_or(0x0707))
    }

    /// "500 kbit/s, sample point 75.0 to 87.5 %"
    pub(super) fn rates(&self) -> String {
        let text_of = |subindex, text: fn(u32) -> String| {
            self.snapshot.text_of(self.config_object(), subindex, text)
        };
        let rate = |subindex| text_of(subindex, |rate| format!("{} kbit/s", rate / 1000));
        let percent = |subindex| text_of(subindex, |raw| format!("{:.1}", f64::from(raw) / 10.0));
        let mut text = format!("{}, sample point {} to {} %", rate(19), percent(21), percent(22));
        if self.config(15) == Some(1) {
            text.push_str(&format!(
                ", data phase {}, {} to {} %",
                rate(20),
                percent(23),
                percent(24)
            ));
        }
        text
    }
}

/// Errors since ECR was last read from which frames count as disturbed again and again.
const REPEATED: u8 = 10;

const COMPARE: &str = "compare bit rates, sample points (nominal and data), TDC and bit rate switch (BRS) with \
                       each peer; then watch the error counters and check the termination";

/// Phases in which the controller has detected errors since its flags were cleared.
#[derive(Clone, Copy)]
struct ErrorPhases {
    arbitration: bool,
    data: bool,
}

pub(super) fn bus_findings(channel: &Channel<'_>) -> Vec<Finding> {
    let checks = [error_state, bus_error, bus_off_history];
    checks.into_iter().filter_map(|check| check(channel)).collect()
}

fn error_phases(channel: &Channel<'_>) -> ErrorPhases {
    let (protocol, interrupts) =
        (channel.protocol(), Interrupts(channel.information(3).unwrap_or(0)));
    let (arbitration, data) = interrupts.protocol_errors();
    ErrorPhases {
        arbitration: arbitration || protocol.last_error.is_error(),
        data: data || protocol.last_data_error.is_error(),
    }
}

/// Difference of the bit timing as a cause, as far as the phase of the errors shows it.
fn compare_rates(channel: &Channel<'_>) -> String {
    let what = match error_phases(channel) {
        ErrorPhases { data: true, .. } => {
            "sample points, data bit rate or TDC differ from the other nodes (errors in the data phase)"
        }
        _ => "bit rate or sample point differs from the other nodes",
    };
    format!("{what}; this channel: {}", channel.rates())
}

/// "TDC on, offset 16, filter 0"
fn compensation(channel: &Channel<'_>) -> Option<String> {
    let (enable, rate) = (channel.config(16)?, channel.config(20)?);
    if !tdc_active(enable != 0, rate) {
        return Some("TDC off".to_owned());
    }
    Some(match (channel.config(33)?, channel.config(34)?) {
        (0, 0) => "TDC on, automatic".to_owned(),
        (offset, filter) => format!("TDC on, offset {offset}, filter {filter}"),
    })
}

/// Cause in the own delay compensation.
fn own_compensation(channel: &Channel<'_>) -> Option<String> {
    let (offset, filter) = (channel.config(33)?, channel.config(34)?);
    if !tdc_active(channel.config(16)? != 0, channel.config(20)?) {
        let entry = channel.config_entry(16);
        return Some(format!("transmitter delay compensation (TDC) is off ({entry} = 0)"));
    }
    let (offset_entry, filter_entry) = (channel.config_entry(33), channel.config_entry(34));
    match (offset, filter) {
        (0, 0) => None,
        (0, _) | (_, 0) => Some(format!(
            "TDC offset and filter are not a pair ({offset_entry} = {offset}, {filter_entry} = {filter}): set \
             both, or both to 0"
        )),
        _ => Some(format!(
            "TDC offset or filter does not fit ({offset_entry} = {offset}, {filter_entry} = {filter}); 0 is \
             automatic"
        )),
    }
}

fn error_state(channel: &Channel<'_>) -> Option<Finding> {
    let status = channel.status().unwrap_or_default();
    if !channel.is_running() {
        return None;
    }
    let (protocol, counters) = (channel.protocol(), channel.counters());
    if status.bus_off() || status.state() == ChannelState::BusOff || protocol.is_bus_off {
        return bus_off(channel);
    }
    if protocol.is_error_passive || counters.is_receive_passive || counters.transmit >= 128 {
        return error_passive(channel, counters);
    }
    if status.state() == ChannelState::Error {
        let (apply, status) = (channel.config_entry(1), channel.config_entry(2));
        let next = format!("read the apply status ({status}) and apply again ({apply} = 1)");
        return channel
            .fault("channel-error", "the channel is in its error state")
            .causes(&["the last configuration was not applied", "the controller did not start"])
            .next_step(next, "16.3");
    }
    if protocol.is_warning || counters.transmit >= 96 || counters.receive >= 96 {
        let next = "check for 60 ohms between CAN_H and CAN_L, then watch the counters";
        return channel
            .warning("error-warning", format!("error warning: {counters}"))
            .causes(&["termination, cable or contact", "interference on the cable"])
            .cause(compare_rates(channel))
            .next_step(next, "16.3");
    }
    None
}

fn bus_off(channel: &Channel<'_>) -> Option<Finding> {
    let (policy, apply) = (channel.data_path_entry(14), channel.config_entry(1));
    let recovery = match channel.snapshot.get(policy.index, policy.subindex) {
        Some(0) => {
            format!("recovery is manual ({policy} = 0): apply the channel again ({apply} = 1)")
        }
        Some(3) => format!(
            "the policy keeps the channel off the bus ({policy} = 3): apply the channel again \
             ({apply} = 1)"
        ),
        _ => "recovery is automatic after 128 sequences of 11 recessive bits".to_owned(),
    };
    channel
        .fault("bus-off", "the channel is bus-off and does not send or receive")
        .causes(&["CAN_H and CAN_L are short-circuited or swapped", "termination is missing"])
        .cause(compare_rates(channel))
        .cause("another node uses another bit rate, or sends CAN FD frames to classic nodes")
        .next_step(
            format!("repair the bus wiring first: 60 ohms between CAN_H and CAN_L; {recovery}"),
            "16.3",
        )
}

fn error_passive(channel: &Channel<'_>, counters: ErrorCounters) -> Option<Finding> {
    let protocol = channel.protocol();
    let is_alone = protocol.last_error == LastErrorCode::Acknowledge
        || (counters.transmit == 128 && counters.receive == 0 && !counters.is_receive_passive);
    if is_alone {
        let what = format!("no node acknowledges frames from this channel: {counters}");
        // The frames of a node that is alone are not disturbed, and never lead to bus-off.
        let is_disturbed = error_phases(channel).data
            || counters.receive > 0
            || channel.information(15).is_some_and(|count| count > 0);
        let rates = || format!("a node receives the frames wrongly: {}", compare_rates(channel));
        return channel
            .fault("no-acknowledge", what)
            .cause_if(is_disturbed.then(rates))
            .cause(format!(
                "no other active node on this bus with this bit rate (off, in listen mode, or with another rate); \
                 this channel: {}",
                channel.rates()
            ))
            .cause_if(rotation(channel))
            .cause("the cable is open or connected to another channel")
            .next_step("connect a second node with the same bit rates; see `ecan pins`", "16.3");
    }
    let has_form_error = protocol.last_error == LastErrorCode::Form || is_non_iso(channel);
    channel.fault("error-passive", format!("error passive: {counters}"))
        .cause_if(iso_format(channel).filter(|_| has_form_error))
        .cause(compare_rates(channel))
        .causes(&[
            "termination is missing, or too many terminations",
            "interference on the cable",
        ])
        .next_step("check for 60 ohms between CAN_H and CAN_L, then compare bit rates, sample points, TDC and BRS with each peer", "16.3")
}

fn rotation(channel: &Channel<'_>) -> Option<String> {
    let rotation = channel.snapshot.get(0x8000, 13).filter(|rotation| *rotation != 0)?;
    let channels = CHANNELS as u32;
    let group = (u32::from(channel.number) + rotation % channels) % channels;
    Some(format!("the pins are rotated by {rotation}: this channel uses pin group {group}"))
}

/// Errors that the registers show in addition to the state of the channel.
pub(super) fn bus_error(channel: &Channel<'_>) -> Option<Finding> {
    if !channel.is_running() {
        return None;
    }
    let (protocol, counters) = (channel.protocol(), channel.counters());
    let is_repeated = counters.logged >= REPEATED;
    let has_state = protocol.is_warning || protocol.is_error_passive || protocol.is_bus_off;
    let phases = error_phases(channel);
    // The flags stay set after an error of the past.
    if protocol.last_data_error.is_error() || (phases.data && (is_repeated || has_state)) {
        return data_phase_error(channel, phases);
    }
    if protocol.is_bus_off || protocol.is_error_passive {
        return None;
    }
    let error = protocol.last_error;
    let is_fd = channel.config(15) == Some(1);
    let format = iso_format(channel);
    let causes: &[&str] = match error {
        LastErrorCode::None | LastErrorCode::NoChange if !is_repeated => return None,
        LastErrorCode::Acknowledge => {
            &["no other active node on this bus (off, or in listen mode)"]
        }
        LastErrorCode::Bit1 | LastErrorCode::Bit0 => &[
            "two nodes send the same CAN ID",
            "CAN_H or CAN_L is short-circuited, or the transceiver has no supply",
        ],
        LastErrorCode::Form if is_fd => {
            &["a node that is configured for classic CAN rejects CAN FD frames"]
        }
        LastErrorCode::Form => {
            &["the channel is configured for classic CAN and receives CAN FD frames"]
        }
        _ => &["interference, termination or contact"],
    };
    let (first, last) = match error {
        LastErrorCode::Form => (format, None),
        LastErrorCode::Crc if is_non_iso(channel) => (format, None),
        LastErrorCode::Crc => (None, format),
        _ => (None, None),
    };
    let what = if error.is_error() {
        format!("the last error on the bus was a {error}")
    } else {
        format!("{} since its last read", errors(counters.logged))
    };
    channel
        .warning("bus-error", what)
        .cause_if(first)
        .causes(causes)
        .cause(compare_rates(channel))
        .cause_if(last)
        .next_step("watch the error counters while frames are sent", "16.3")
}

/// Returns whether the channel has CAN FD in the format before ISO 11898-1:2015.
fn is_non_iso(channel: &Channel<'_>) -> bool {
    channel.config(15) == Some(1) && channel.config(9).is_some_and(|mode| mode != 0)
}

/// The format of CAN FD frames as a cause of form and CRC errors: ISO 11898-1 has a stuff count before the CRC.
fn iso_format(channel: &Channel<'_>) -> Option<String> {
    let entry = channel.config_entry(9);
    if is_non_iso(channel) {
        return Some(format!(
            "this channel is in Non-ISO mode ({entry} = 1); nodes with ISO format reject its frames"
        ));
    }
    let is_iso = channel.config(15) == Some(1) && channel.config(9) == Some(0);
    is_iso.then(|| {
        format!("a node sends CAN FD frames in Non-ISO format; this channel has ISO format ({entry} = 0)")
    })
}

fn data_phase_error(channel: &Channel<'_>, phases: ErrorPhases) -> Option<Finding> {
    let (code, logged) = (channel.protocol().last_data_error, channel.counters().logged);
    let mut what = match code.is_error() {
        true => format!("{code} in the data phase of CAN FD frames"),
        false => "errors in the data phase of CAN FD frames".to_owned(),
    };
    if !phases.arbitration {
        what.push_str(", none in the arbitration phase");
    }
    if logged >= REPEATED {
        what.push_str(&format!("; {}", errors(logged)));
    }
    let own = own_compensation(channel);
    let finding = channel.warning("data-phase-error", what);
    let is_format = matches!(code, LastErrorCode::Form | LastErrorCode::Crc);
    let is_non_iso = is_non_iso(channel);
    let finding = finding.cause_if(iso_format(channel).filter(|_| is_non_iso));
    // A bit 0 error is the own echo; the other codes also come from the error flag of another node.
    let finding = match code {
        LastErrorCode::Bit0 => finding
            .cause("the channel reads its own data bits back wrongly: its transmitter delay compensation (TDC)")
            .cause_if(own)
            .cause("the sample points of the data phase differ"),
        _ => finding
            .cause("the sample points of the data phase differ, or the nominal ones, at which it begins")
            .cause_if(own)
            .cause_if(iso_format(channel).filter(|_| is_format && !is_non_iso))
            .cause("transmitter delay compensation (TDC) of a peer is off, but needed from 5 Mbit/s"),
    };
    let settings = compensation(channel).map_or_else(String::new, |text| format!(", {text}"));
    finding
        .cause("frames with BRS are sent to nodes with another data bit rate")
        .cause("stubs or cables are too long for this data bit rate")
        .cause(format!("this channel: {}{settings}", channel.rates()))
        .next_step(COMPARE, "16.3")
}

fn bus_off_history(channel: &Channel<'_>) -> Option<Finding> {
    let count = channel.information(15).filter(|count| *count != 0)?;
    let status = channel.status().unwrap_or_default();
    if status.bus_off() {
        return None;
    }
    channel
        .warning("bus-off-past", format!("the channel was bus-off {count} times and recovered"))
        .causes(&["a loose contact or unplugged connector", "termination is missing"])
        .cause(compare_rates(channel))
        .next_step("clear with `ecan diag --clear` and check whether it recurs", "16.3")
}

fn errors(logged: u8) -> String {
    match logged {
        u8::MAX => "255 or more errors are logged (ECR)".to_owned(),
        _ => format!("{logged} errors are logged (ECR)"),
    }
}

pub(super) fn loss_findings(channel: &Channel<'_>) -> Vec<Finding> {
    let checks = [receive_losses, transmit_pressure, event_losses, message_ram];
    let mut found: Vec<_> = checks.into_iter().filter_map(|check| check(channel)).collect();
    found.extend(data_path(channel));
    found
}

fn receive_losses(channel: &Channel<'_>) -> Option<Finding> {
    let interrupts = Interrupts(channel.information(3).unwrap_or(0));
    let (fifo0, fifo1) = interrupts.lost();
    let lost = |subindex| ReceiveFifoStatus::from_raw(channel.information(subindex).unwrap_or(0));
    let fifos = [fifo0 || lost(4).has_lost, fifo1 || lost(5).has_lost];
    let dropped = channel.information(13).unwrap_or(0);
    if dropped == 0 && fifos == [false, false] {
        return None;
    }
    let mut what = Vec::new();
    if dropped != 0 {
        what.push(format!("{dropped} received frames were dropped before the TxPDO"));
    }
    for (number, _) in fifos.iter().enumerate().filter(|(_, has_lost)| **has_lost) {
        what.push(format!("RX FIFO{number} lost a frame"));
    }
    let budget = channel.data_path_entry(5);
    let next = format!("plan the traffic with `ecan plan`; raise {budget} and N, or set filters");
    channel
        .warning("receive-loss", what.join(", "))
        .cause(format!("more frames per cycle on the bus than the drain budget ({budget})"))
        .causes(&[
            "the TxPDO is too small (0x8010:16)",
            "the gateway is not in OP: no process data exchange",
            "the filters pass unneeded frames",
        ])
        .next_step(next, "16.3")
}

fn transmit_pressure(channel: &Channel<'_>) -> Option<Finding> {
    let count = channel.information(14).unwrap_or(0);
    let queue = TransmitQueueStatus::from_raw(channel.information(6).unwrap_or(0));
    if count == 0 && !(queue.is_full && channel.is_running()) {
        return None;
    }
    let what = match count {
        0 => "the transmit FIFO is full".to_owned(),
        _ => format!("the transmit queue was full {count} times"),
    };
    channel
        .warning("transmit-pressure", what)
        .causes(&[
            "the host sends more frames than the bit rate allows",
            "no acknowledgement: the first frame is repeated forever",
            "frames with higher priority occupy the bus",
        ])
        .next_step("check for bus errors first, then plan the load with `ecan plan`", "16.3")
}

fn event_losses(channel: &Channel<'_>) -> Option<Finding> {
    let events = EventFifoStatus::from_raw(channel.information(7).unwrap_or(0));
    let flags = channel.information(3).unwrap_or(0);
    if !events.has_lost && flags >> 15 & 1 == 0 {
        return None;
    }
    let [events, queue, apply] = [73, 70, 1].map(|subindex| channel.config_entry(subindex));
    channel
        .warning("event-loss", "transmit events were lost: transmit results are missing")
        .cause("the transmit event FIFO has fewer elements than the transmit FIFO")
        .next_step(format!("set {events} to at least {queue} and apply ({apply} = 1)"), "13.4")
}

fn message_ram(channel: &Channel<'_>) -> Option<Finding> {
    let interrupts = Interrupts(channel.information(3)?);
    if !interrupts.has_ram_failure() {
        return None;
    }
    channel
        .fault("message-ram", format!("the Message RAM failed: {interrupts}"))
        .causes(&["a hardware fault", "registers were written manually"])
        .next_step("power-cycle; if it recurs, send a bundle to support", "16.3")
}

/// Losses between the CAN controller and the process data.
fn data_path(channel: &Channel<'_>) -> Vec<Finding> {
    let (snapshot, number) = (channel.snapshot, u16::from(channel.number));
    let (object, config, diagnosis) = (0x8021 + number, channel.config_object(), 0x9020 + number);
    let control = |subindex| snapshot.get(object, subindex);
    let [enable, apply, status, budget, cache, policy, overflow] =
        [1, 2, 3, 5, 7, 14, 16].map(|subindex| channel.data_path_entry(subindex));
    let count = |subindex| snapshot.get(diagnosis, subindex).unwrap_or(0);
    let text_of = |subindex| snapshot.number(diagnosis, subindex);
    let mut found = Vec::new();

    if let Some(raw) = control(3).filter(|raw| *raw != 0) {
        let result = ApplyStatus::from_raw(u8::try_from(raw).unwrap_or(u8::MAX));
        let next = format!("correct it, write {apply} = 1 and read {status} again");
        let finding = channel
            .fault("data-path-apply", format!("data path policy not applied: {result}"))
            .cause(format!("a value of 0x{object:04X} is out of range, or min is above max"));
        found.extend(finding.next_step(next, "13.2.2"));
    }
    if control(1) == Some(0) {
        let next = format!("write {enable} = 1 and apply ({apply} = 1)");
        let finding = channel
            .warning("data-path-off", "the data path policy is disabled")
            .cause(format!("{enable} is 0: the firmware uses its own budgets and policies"));
        found.extend(finding.next_step(next, "13.2.2"));
    }
    let dropped = count(5);
    if dropped != 0 {
        let (old, new, critical, depth) = (text_of(6), text_of(7), text_of(8), text_of(2));
        let what = format!(
            "the RX cache dropped {dropped} frames ({old} old, {new} new, {critical} critical), \
             {depth} waited at most"
        );
        let next = format!("plan the traffic with `ecan plan`; raise {budget}, :07 and N");
        let finding = channel
            .warning("rx-cache-drop", what)
            .cause("more frames per cycle on the bus than fit into the TxPDO: check N and cycle")
            .cause(format!("the drain budget {budget} is too small"))
            .cause(format!("the RX cache {cache} is too small for bursts"));
        found.extend(finding.next_step(next, "13.2.5"));
    }
    if count(11) != 0 || count(12) != 0 {
        let (full, stale) = (text_of(11), text_of(12));
        let what =
            format!("the transmit FIFO was full {full} times, {stale} stale frames were dropped");
        let next = "check for bus errors first, then plan the load with `ecan plan`";
        let finding = channel
            .warning("tx-fifo-full", what)
            .cause("the host sends more frames than the bit rate allows")
            .cause("the channel was bus-off or got no acknowledgement")
            .cause(format!("the transmit FIFO is small (0x{config:04X}:70)"));
        found.extend(finding.next_step(next, "13.2.5"));
    }
    let degraded = count(15);
    if degraded != 0 {
        let what = format!("the data path is degraded or protected (0x{degraded:X})");
        let next =
            format!("remove the cause, then apply the channel again (0x{config:04X}:01 = 1)");
        let finding = channel
            .fault("data-path-degraded", what)
            .cause(format!("the receive path overflowed for a long time ({overflow})"))
            .cause("the transmit path was congested for a long time")
            .cause(format!("the channel was bus-off and its policy keeps it off ({policy})"));
        found.extend(finding.next_step(next, "13.2.5"));
    }
    found
}
