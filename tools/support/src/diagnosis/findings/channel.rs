//! Findings of a CAN bus and its channel (manual 5.4.6, 13.4, 13.5, 16.3).

use ecan_protocol::config::NodeMode;
use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;

use crate::diagnosis::finding::{Finding, Location};
use crate::diagnosis::registers::{
    ErrorCounters, EventFifoStatus, Interrupts, LastErrorCode, ProtocolStatus, ReceiveFifoStatus,
    TransmitQueueStatus,
};
use crate::diagnosis::snapshot::{ObjectKey, Snapshot};

pub(super) struct Channel<'a> {
    pub(super) snapshot: &'a Snapshot,
    pub(super) number: u8,
    location: Location,
}

pub(super) fn findings(snapshot: &Snapshot, number: u8) -> Vec<Finding> {
    let channel = Channel { snapshot, number, location: Location::Channel(number) };
    let checks = [
        Channel::error_state,
        Channel::bus_error,
        Channel::bus_off_history,
        Channel::apply_command,
        Channel::flash_command,
        Channel::masks,
        Channel::node_mode,
        Channel::rejects_all,
        Channel::short_elements,
        Channel::unpaired_compensation,
        Channel::sample_point_range,
        Channel::receive_losses,
        Channel::transmit_pressure,
        Channel::event_losses,
        Channel::message_ram,
    ];
    checks.into_iter().filter_map(|check| check(&channel)).collect()
}

impl Channel<'_> {
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

    fn data_path_entry(&self, subindex: u8) -> ObjectKey {
        ObjectKey { index: 0x8021 + u16::from(self.number), subindex }
    }

    pub(super) fn fault(&self, id: &'static str, what: impl Into<String>) -> Finding {
        Finding::fault(id, self.location, what)
    }

    pub(super) fn warning(&self, id: &'static str, what: impl Into<String>) -> Finding {
        Finding::warning(id, self.location, what)
    }

    fn status(&self) -> Option<ChannelStatus> {
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

    fn rotation(&self) -> Option<String> {
        let rotation = self.snapshot.get(0x8000, 13).filter(|rotation| *rotation != 0)?;
        let channels = CHANNELS as u32;
        let group = (u32::from(self.number) + rotation % channels) % channels;
        Some(format!("the pins are rotated by {rotation}: this channel uses pin group {group}"))
    }

    fn error_state(&self) -> Option<Finding> {
        let status = self.status().unwrap_or_default();
        if !self.is_running() {
            return None;
        }
        let (protocol, counters) = (self.protocol(), self.counters());
        if status.bus_off() || status.state() == ChannelState::BusOff || protocol.is_bus_off {
            return self.bus_off();
        }
        if protocol.is_error_passive || counters.is_receive_passive || counters.transmit >= 128 {
            return self.error_passive(counters);
        }
        if status.state() == ChannelState::Error {
            let (apply, status) = (self.config_entry(1), self.config_entry(2));
            let next = format!("read the apply status ({status}) and apply again ({apply} = 1)");
            return self
                .fault("channel-error", "the channel is in its error state")
                .causes(&["the last configuration was not applied", "the controller did not start"])
                .next_step(next, "16.3");
        }
        if protocol.is_warning || counters.transmit >= 96 || counters.receive >= 96 {
            let next = "check for 60 ohms between CAN_H and CAN_L, then watch the counters";
            return self
                .warning("error-warning", format!("error warning: {counters}"))
                .causes(&["termination, cable or contact", "interference on the cable"])
                .cause(self.compare_rates())
                .next_step(next, "16.3");
        }
        None
    }

    fn bus_off(&self) -> Option<Finding> {
        let (policy, apply) = (self.data_path_entry(14), self.config_entry(1));
        let recovery = match self.snapshot.get(policy.index, policy.subindex) {
            Some(0) => {
                format!("recovery is manual ({policy} = 0): apply the channel again ({apply} = 1)")
            }
            Some(3) => format!(
                "the policy keeps the channel off the bus ({policy} = 3): apply the channel again \
                 ({apply} = 1)"
            ),
            _ => "recovery is automatic after 128 sequences of 11 recessive bits".to_owned(),
        };
        self.fault("bus-off", "the channel is bus-off and does not send or receive")
            .causes(&["CAN_H and CAN_L are short-circuited or swapped", "termination is missing"])
            .cause(self.compare_rates())
            .cause("another node uses another bit rate, or sends CAN FD frames to classic nodes")
            .next_step(
                format!("repair the bus wiring first: 60 ohms between CAN_H and CAN_L; {recovery}"),
                "16.3",
            )
    }

    fn error_passive(&self, counters: ErrorCounters) -> Option<Finding> {
        let protocol = self.protocol();
        let is_alone = protocol.last_error == LastErrorCode::Acknowledge
            || (counters.transmit == 128 && counters.receive == 0 && !counters.is_receive_passive);
        if is_alone {
            let what = format!("no node acknowledges frames from this channel: {counters}");
            return self
                .fault("no-acknowledge", what)
                .cause("no other active node on this bus (off, or in listen mode)")
                .cause_if(self.rotation())
                .cause(self.compare_rates())
                .cause("the cable is open or connected to another channel")
                .next_step(
                    "connect a second node with the same bit rates; see `ecan pins`",
                    "16.3",
                );
        }
        self.fault("error-passive", format!("error passive: {counters}"))
            .cause(self.compare_rates())
            .causes(&[
                "termination is missing, or too many terminations",
                "interference on the cable",
            ])
            .next_step("check for 60 ohms between CAN_H and CAN_L, then compare bit rates, sample points, TDC and BRS with each peer", "16.3")
    }

    fn bus_off_history(&self) -> Option<Finding> {
        let count = self.information(15).filter(|count| *count != 0)?;
        let status = self.status().unwrap_or_default();
        if status.bus_off() {
            return None;
        }
        self.warning("bus-off-past", format!("the channel was bus-off {count} times and recovered"))
            .causes(&["a loose contact or unplugged connector", "termination is missing"])
            .cause(self.compare_rates())
            .next_step("clear with `ecan diag --clear` and check whether it recurs", "16.3")
    }

    /// "CAN is not sent" and "CAN cannot be received" of manual 5.4.6.
    fn masks(&self) -> Option<Finding> {
        let bit = |mask: u32| mask >> self.number & 1 == 1;
        let tx = bit(self.snapshot.active_mask(0x8010)?);
        let rx = bit(self.snapshot.active_mask(0x8011)?);
        let is_off = self.status()?.state() == ChannelState::Disabled;
        match (tx, rx) {
            (false, false) => None,
            _ if is_off => self.not_applied(),
            (true, true) => None,
            (true, false) => self.masked_out("cannot-send", "sent", 0x8011),
            (false, true) => self.masked_out("cannot-receive", "received", 0x8010),
        }
    }

    fn not_applied(&self) -> Option<Finding> {
        self.fault("channel-off", "the channel is in the channel masks but disabled")
            .cause(format!(
                "its configuration was not applied ({} = 1) after the start of the gateway",
                self.config_entry(1)
            ))
            .cause("the last apply failed")
            .next_step(
                "write and apply its configuration in the startup list of the master",
                "5.4.6",
            )
    }

    fn masked_out(&self, id: &'static str, word: &str, object: u16) -> Option<Finding> {
        let what = format!("frames of this channel are not {word}: the channel mask excludes it");
        self.warning(id, what)
            .cause(format!("bit {} is not set in 0x{object:04X}:04", self.number))
            .next_step(
                format!(
                    "unless that is intended, set the bit in 0x{object:04X}:04 and apply, in PREOP"
                ),
                "5.4.6",
            )
    }

    fn node_mode(&self) -> Option<Finding> {
        if !self.is_running() {
            return None;
        }
        let mode = NodeMode::from_raw(u8::try_from(self.config(8)?).ok()?)?;
        let what = match mode {
            NodeMode::Normal => return None,
            NodeMode::Listen => "listen mode: the channel does not send or acknowledge",
            NodeMode::InternalLoopback => {
                "internal loopback: the channel is disconnected from the bus"
            }
            NodeMode::ExternalLoopback => {
                "external loopback: the channel receives only its own frames"
            }
        };
        let (mode, apply) = (self.config_entry(8), self.config_entry(1));
        self.warning("node-mode", what)
            .cause("the mode was not reset after a test")
            .next_step(format!("write node mode 0 ({mode}) and apply ({apply} = 1)"), "13.4")
    }

    fn receive_losses(&self) -> Option<Finding> {
        let interrupts = Interrupts(self.information(3).unwrap_or(0));
        let (fifo0, fifo1) = interrupts.lost();
        let lost = |subindex| ReceiveFifoStatus::from_raw(self.information(subindex).unwrap_or(0));
        let fifos = [fifo0 || lost(4).has_lost, fifo1 || lost(5).has_lost];
        let dropped = self.information(13).unwrap_or(0);
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
        let budget = self.data_path_entry(5);
        let next =
            format!("plan the traffic with `ecan plan`; raise {budget} and N, or set filters");
        self.warning("receive-loss", what.join(", "))
            .cause(format!("more frames per cycle on the bus than the drain budget ({budget})"))
            .causes(&[
                "the TxPDO is too small (0x8010:16)",
                "the gateway is not in OP: no process data exchange",
                "the filters pass unneeded frames",
            ])
            .next_step(next, "16.3")
    }

    fn transmit_pressure(&self) -> Option<Finding> {
        let count = self.information(14).unwrap_or(0);
        let queue = TransmitQueueStatus::from_raw(self.information(6).unwrap_or(0));
        if count == 0 && !(queue.is_full && self.is_running()) {
            return None;
        }
        let what = match count {
            0 => "the transmit FIFO is full".to_owned(),
            _ => format!("the transmit queue was full {count} times"),
        };
        self.warning("transmit-pressure", what)
            .causes(&[
                "the host sends more frames than the bit rate allows",
                "no acknowledgement: the first frame is repeated forever",
                "frames with higher priority occupy the bus",
            ])
            .next_step("check for bus errors first, then plan the load with `ecan plan`", "16.3")
    }

    fn event_losses(&self) -> Option<Finding> {
        let events = EventFifoStatus::from_raw(self.information(7).unwrap_or(0));
        let flags = self.information(3).unwrap_or(0);
        if !events.has_lost && flags >> 15 & 1 == 0 {
            return None;
        }
        let [events, queue, apply] = [73, 70, 1].map(|subindex| self.config_entry(subindex));
        self.warning("event-loss", "transmit events were lost: transmit results are missing")
            .cause("the transmit event FIFO has fewer elements than the transmit FIFO")
            .next_step(format!("set {events} to at least {queue} and apply ({apply} = 1)"), "13.4")
    }

    fn message_ram(&self) -> Option<Finding> {
        let interrupts = Interrupts(self.information(3)?);
        if !interrupts.has_ram_failure() {
            return None;
        }
        self.fault("message-ram", format!("the Message RAM failed: {interrupts}"))
            .causes(&["a hardware fault", "registers were written manually"])
            .next_step("power-cycle; if it recurs, send a bundle to support", "16.3")
    }
}
