//! What is wrong on a CAN bus, or with the channel at it (manual 5.4.6, 13.4, 13.5, 16.3).

use ecan_protocol::config::NodeMode;
use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;

use crate::finding::{Finding, Location};
use crate::registers::{
    ErrorCounters, EventFifoStatus, Interrupts, LastErrorCode, ProtocolStatus, ReceiveFifoStatus,
    TransmitQueueStatus,
};
use crate::snapshot::{ObjectKey, Snapshot};

/// What was read of one channel.
pub(super) struct Channel<'a> {
    pub(super) snapshot: &'a Snapshot,
    pub(super) number: u8,
    place: Location,
}

pub(super) fn findings(snapshot: &Snapshot, number: u8) -> Vec<Finding> {
    let channel = Channel { snapshot, number, place: Location::Channel(number) };
    let mut found = Vec::new();
    found.extend(channel.error_state());
    found.extend(channel.bus_error());
    found.extend(channel.bus_off_history());
    found.extend(channel.apply_command());
    found.extend(channel.flash_command());
    found.extend(channel.masks());
    found.extend(channel.node_mode());
    found.extend(channel.receive_losses());
    found.extend(channel.transmit_pressure());
    found.extend(channel.event_losses());
    found.extend(channel.message_ram());
    found
}

impl Channel<'_> {
    fn information(&self, subindex: u8) -> Option<u32> {
        self.snapshot.get(0x9000 + u16::from(self.number), subindex)
    }

    /// The channel's 0x8001 to 0x8004.
    pub(super) fn config_object(&self) -> u16 {
        0x8001 + u16::from(self.number)
    }

    pub(super) fn config(&self, subindex: u8) -> Option<u32> {
        self.snapshot.get(self.config_object(), subindex)
    }

    /// An entry of the configuration, for what is to be done.
    pub(super) fn config_entry(&self, subindex: u8) -> ObjectKey {
        ObjectKey { index: self.config_object(), subindex }
    }

    /// An entry of the data path control.
    fn data_path_entry(&self, subindex: u8) -> ObjectKey {
        ObjectKey { index: 0x8021 + u16::from(self.number), subindex }
    }

    pub(super) fn fault(&self, id: &'static str, what: impl Into<String>) -> Finding {
        Finding::fault(id, self.place, what)
    }

    fn warning(&self, id: &'static str, what: impl Into<String>) -> Finding {
        Finding::warning(id, self.place, what)
    }

    fn status(&self) -> Option<ChannelStatus> {
        Some(ChannelStatus::from_raw(self.information(9)? as u16))
    }

    fn is_running(&self) -> bool {
        self.status().is_some_and(|status| {
            !matches!(status.state(), ChannelState::Disabled | ChannelState::Init)
        })
    }

    fn counters(&self) -> ErrorCounters {
        ErrorCounters::from_raw(self.information(1).unwrap_or(0))
    }

    fn protocol(&self) -> ProtocolStatus {
        // Without a value: no change since the last look.
        ProtocolStatus::from_raw(self.information(2).unwrap_or(0x0707))
    }

    /// "500 kbit/s, sample point 75.0 to 87.5 %"
    pub(super) fn rates(&self) -> String {
        let told = |subindex, words: fn(u32) -> String| {
            self.snapshot.told(self.config_object(), subindex, words)
        };
        let rate = |subindex| told(subindex, |rate| format!("{} kbit/s", rate / 1000));
        let percent = |subindex| told(subindex, |raw| format!("{:.1}", f64::from(raw) / 10.0));
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

    /// How the pins are rotated, where they are.
    fn rotation(&self) -> Option<String> {
        let rotation = self.snapshot.get(0x8000, 13).filter(|rotation| *rotation != 0)?;
        let channels = CHANNELS as u32;
        let group = (u32::from(self.number) + rotation % channels) % channels;
        Some(format!("the pins are rotated by {rotation}: this channel is at pin group {group}"))
    }

    fn compare_rates(&self) -> String {
        format!("bit rate or sample point differ from the other nodes; here {}", self.rates())
    }

    fn error_state(&self) -> Option<Finding> {
        let status = self.status().unwrap_or_default();
        if !self.is_running() {
            return None;
        }
        let (protocol, counters) = (self.protocol(), self.counters());
        if status.bus_off() || status.state() == ChannelState::BusOff || protocol.is_bus_off {
            return Some(self.bus_off());
        }
        if protocol.is_error_passive || counters.is_receive_passive || counters.transmit >= 128 {
            return Some(self.error_passive(counters));
        }
        if status.state() == ChannelState::Error {
            let finding =
                self.fault("channel-error", "the channel is in its error state").because(&[
                    "the last configuration was not applied",
                    "the controller did not start",
                ]);
            let (apply, status) = (self.config_entry(1), self.config_entry(2));
            let next = format!("look at its apply status ({status}), apply it again ({apply} = 1)");
            return Some(finding.so(next, "16.3"));
        }
        if protocol.is_warning || counters.transmit >= 96 || counters.receive >= 96 {
            let what = format!("error warning: {counters}");
            let finding = self
                .warning("error-warning", what)
                .because(&["termination, cable or a bad contact", "disturbance on the cable"])
                .or_because(self.compare_rates());
            return Some(
                finding.so("measure 60 ohms across the bus, then watch the counters", "16.3"),
            );
        }
        None
    }

    fn bus_off(&self) -> Finding {
        let (policy, apply) = (self.data_path_entry(14), self.config_entry(1));
        let recovery = match self.snapshot.get(policy.index, policy.subindex) {
            Some(0) => {
                format!("recovery is manual ({policy} = 0): apply the channel again ({apply} = 1)")
            }
            Some(3) => format!(
                "the policy keeps it off the bus ({policy} = 3): apply the channel again \
                 ({apply} = 1)"
            ),
            _ => "it recovers by itself once 128 times 11 recessive bits were seen".to_owned(),
        };
        self.fault("bus-off", "the channel is bus-off: it neither sends nor receives")
            .because(&["CAN_H and CAN_L are short-circuited or swapped", "termination is missing"])
            .or_because(self.compare_rates())
            .because(&["another node sends with another bit rate, or CAN FD to nodes without it"])
            .so(format!("mend the bus first: 60 ohms between CAN_H and CAN_L; {recovery}"), "16.3")
    }

    fn error_passive(&self, counters: ErrorCounters) -> Finding {
        let protocol = self.protocol();
        let is_alone = protocol.last_error == LastErrorCode::Acknowledge
            || (counters.transmit == 128 && counters.receive == 0 && !counters.is_receive_passive);
        if is_alone {
            let what = format!("nobody acknowledges what the channel sends: {counters}");
            return self
                .fault("no-acknowledge", what)
                .because(&["no other node is on this bus, switched on and not in listen mode"])
                .because_of(self.rotation())
                .or_because(self.compare_rates())
                .because(&["the cable is open, or plugged into another channel"])
                .so("connect a second node with the same rates; see `ecan pins`", "16.3");
        }
        self.fault("error-passive", format!("error passive: {counters}"))
            .or_because(self.compare_rates())
            .because(&[
                "termination is missing or there is too much of it",
                "disturbance on the cable",
            ])
            .so("measure 60 ohms across the bus, then compare the timing of all nodes", "16.3")
    }

    /// The last error of the protocol status, where the state does not tell it already.
    fn bus_error(&self) -> Option<Finding> {
        let protocol = self.protocol();
        if !self.is_running() {
            return None;
        }
        if protocol.last_data_error.is_error() {
            let what = format!("{} in the data phase of CAN FD frames", protocol.last_data_error);
            let finding = self
                .warning("data-phase-error", what)
                .because(&[
                    "the sample points of the data phase differ",
                    "the transmitter delay is not compensated (TDC), needed from 5 Mbit/s on",
                    "BRS is used towards nodes that have another data bit rate",
                    "stubs or cables too long for this data bit rate",
                ])
                .or_because(format!("here {}", self.rates()));
            return Some(finding.so("set the same data sample point on all nodes; TDC on", "16.3"));
        }
        let error = protocol.last_error;
        if !error.is_error() || protocol.is_bus_off || protocol.is_error_passive {
            return None;
        }
        let causes: &[&str] = match error {
            LastErrorCode::Acknowledge => {
                &["no other node is on this bus, switched on and not in listen mode"]
            }
            LastErrorCode::Bit1 | LastErrorCode::Bit0 => &[
                "two nodes send the same identifier",
                "CAN_H or CAN_L is short-circuited, or the transceiver is not supplied",
            ],
            LastErrorCode::Form => &["CAN FD frames reach a channel that is set to classic CAN"],
            _ => &["disturbance, termination or a bad contact"],
        };
        let finding = self
            .warning("bus-error", format!("the last error on the bus was a {error}"))
            .because(causes)
            .or_because(self.compare_rates());
        Some(finding.so("watch whether the error counters rise while frames are sent", "16.3"))
    }

    fn bus_off_history(&self) -> Option<Finding> {
        let count = self.information(15).filter(|count| *count != 0)?;
        let status = self.status().unwrap_or_default();
        if status.bus_off() {
            return None;
        }
        let finding = self
            .warning("bus-off-past", format!("the channel was bus-off {count} times and came back"))
            .because(&["a loose contact or a plug that was pulled", "termination is missing"])
            .or_because(self.compare_rates());
        Some(finding.so("clear with `ecan diag --clear` and look whether it comes again", "16.3"))
    }

    /// "CAN is not sent" and "CAN cannot be received" of 5.4.6.
    fn masks(&self) -> Option<Finding> {
        let bit = |mask: u32| mask >> self.number & 1 == 1;
        let tx = bit(self.snapshot.active_mask(0x8010)?);
        let rx = bit(self.snapshot.active_mask(0x8011)?);
        let status = self.status()?;
        if tx || rx {
            let is_off = status.state() == ChannelState::Disabled;
            return match (is_off, tx, rx) {
                (true, _, _) => Some(self.not_applied()),
                (false, true, false) => Some(self.left_out("cannot-send", "sent", 0x8011)),
                (false, false, true) => Some(self.left_out("cannot-receive", "received", 0x8010)),
                _ => None,
            };
        }
        None
    }

    fn not_applied(&self) -> Finding {
        self.fault("channel-off", "the channel is in the channel masks but switched off")
            .or_because(format!(
                "its parameters were not applied ({} = 1) after the start of the gateway",
                self.config_entry(1)
            ))
            .because(&["its last apply failed"])
            .so("write its parameters and apply them, in the startup list of the master", "5.4.6")
    }

    fn left_out(&self, id: &'static str, word: &str, object: u16) -> Finding {
        self.warning(id, format!("frames of this channel are not {word}: its mask leaves it out"))
            .or_because(format!("the mask of 0x{object:04X}:04 does not have bit {}", self.number))
            .so(format!("set the bit in 0x{object:04X}:04 and apply, in PREOP"), "5.4.6")
    }

    fn node_mode(&self) -> Option<Finding> {
        if !self.is_running() {
            return None;
        }
        let mode = NodeMode::from_raw(u8::try_from(self.config(8)?).ok()?)?;
        let what = match mode {
            NodeMode::Normal => return None,
            NodeMode::Listen => "the channel listens only: it neither sends nor acknowledges",
            NodeMode::InternalLoopback => {
                "internal loopback: no frame leaves or enters the channel"
            }
            NodeMode::ExternalLoopback => "external loopback: the channel hears only itself",
        };
        let finding =
            self.warning("node-mode", what).because(&["it was set for a test and left so"]);
        let (mode, apply) = (self.config_entry(8), self.config_entry(1));
        Some(finding.so(format!("write node mode 0 ({mode}) and apply ({apply} = 1)"), "13.4"))
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
        let finding = self
            .warning("receive-loss", what.join(", "))
            .or_because(format!(
                "the bus brings more frames per cycle than the drain budget takes ({budget})"
            ))
            .because(&[
                "the TxPDO is too small for them (0x8010:16)",
                "nobody reads the process data: the gateway is not in OP",
                "frames that nobody needs pass the filters",
            ]);
        let next =
            format!("plan the traffic with `ecan plan`; raise {budget} and N, or set filters");
        Some(finding.so(next, "16.3"))
    }

    fn transmit_pressure(&self) -> Option<Finding> {
        let count = self.information(14).unwrap_or(0);
        let queue = TransmitQueueStatus::from_raw(self.information(6).unwrap_or(0));
        if count == 0 && !(queue.is_full && self.is_running()) {
            return None;
        }
        let what = match count {
            0 => "the transmit FIFO is full".to_owned(),
            _ => format!("{count} times a frame found no room to be sent"),
        };
        let finding = self.warning("transmit-pressure", what).because(&[
            "the host sends more frames than the bus carries at this bit rate",
            "nobody acknowledges, so that the first frame is repeated for ever",
            "higher priorities on the bus leave no room",
        ]);
        Some(finding.so("look for bus errors first, then plan the load with `ecan plan`", "16.3"))
    }

    fn event_losses(&self) -> Option<Finding> {
        let events = EventFifoStatus::from_raw(self.information(7).unwrap_or(0));
        let flags = self.information(3).unwrap_or(0);
        (events.has_lost || flags >> 15 & 1 == 1).then(|| {
            self.warning("event-loss", "transmit events were lost: results of frames are missing")
                .because(&["the transmit event FIFO has fewer elements than the transmit FIFO"])
                .so(
                    format!(
                        "set {} to {} at least and apply ({} = 1)",
                        self.config_entry(73),
                        self.config_entry(70),
                        self.config_entry(1)
                    ),
                    "13.4",
                )
        })
    }

    fn message_ram(&self) -> Option<Finding> {
        let interrupts = Interrupts(self.information(3)?);
        interrupts.has_ram_failure().then(|| {
            self.fault("message-ram", format!("the Message RAM failed: {interrupts}"))
                .because(&["a fault of the hardware", "registers were written by hand"])
                .so("power-cycle; if it comes again, send a bundle to the support", "16.3")
        })
    }
}
