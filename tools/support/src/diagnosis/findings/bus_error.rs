//! Errors of frames: what PSR, IR and ECR show of bit rates, sample points and TDC (manual 13.5, 16.3).
//!
//! The M_CAN core separates the data phase of CAN FD frames with bit rate switch (DLEC, IR.PED) from all
//! other bits (LEC, IR.PEA). An error of the data phase excludes nothing but a wrong nominal bit rate: the
//! switch to it takes place at the nominal sample point.

use ecan_protocol::can::tdc_active;

use super::channel::Channel;
use crate::diagnosis::finding::Finding;
use crate::diagnosis::registers::{Interrupts, LastErrorCode};

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

impl Channel<'_> {
    fn error_phases(&self) -> ErrorPhases {
        let (protocol, interrupts) =
            (self.protocol(), Interrupts(self.information(3).unwrap_or(0)));
        let (arbitration, data) = interrupts.protocol_errors();
        ErrorPhases {
            arbitration: arbitration || protocol.last_error.is_error(),
            data: data || protocol.last_data_error.is_error(),
        }
    }

    /// Difference of the bit timing as a cause, as far as the phase of the errors shows it.
    pub(super) fn compare_rates(&self) -> String {
        let what = match self.error_phases() {
            ErrorPhases { data: true, .. } => {
                "sample points, data bit rate or TDC differ from the other nodes (errors in the data phase)"
            }
            _ => "bit rate or sample point differs from the other nodes",
        };
        format!("{what}; this channel: {}", self.rates())
    }

    /// "TDC on, offset 16, filter 0"
    fn compensation(&self) -> Option<String> {
        let (enable, rate) = (self.config(16)?, self.config(20)?);
        if !tdc_active(enable != 0, rate) {
            return Some("TDC off".to_owned());
        }
        Some(match (self.config(33)?, self.config(34)?) {
            (0, 0) => "TDC on, automatic".to_owned(),
            (offset, filter) => format!("TDC on, offset {offset}, filter {filter}"),
        })
    }

    /// Cause in the own delay compensation.
    fn own_compensation(&self) -> Option<String> {
        let (offset, filter) = (self.config(33)?, self.config(34)?);
        if !tdc_active(self.config(16)? != 0, self.config(20)?) {
            let entry = self.config_entry(16);
            return Some(format!("transmitter delay compensation (TDC) is off ({entry} = 0)"));
        }
        let (offset_entry, filter_entry) = (self.config_entry(33), self.config_entry(34));
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

    /// Errors that the registers show in addition to the state of the channel.
    pub(super) fn bus_error(&self) -> Option<Finding> {
        if !self.is_running() {
            return None;
        }
        let (protocol, counters) = (self.protocol(), self.counters());
        let is_repeated = counters.logged >= REPEATED;
        let has_state = protocol.is_warning || protocol.is_error_passive || protocol.is_bus_off;
        let phases = self.error_phases();
        // The flags stay set after an error of the past.
        if protocol.last_data_error.is_error() || (phases.data && (is_repeated || has_state)) {
            return self.data_phase_error(phases);
        }
        if protocol.is_bus_off || protocol.is_error_passive {
            return None;
        }
        let error = protocol.last_error;
        let causes: &[&str] = match error {
            LastErrorCode::None | LastErrorCode::NoChange if !is_repeated => return None,
            LastErrorCode::Acknowledge => {
                &["no other active node on this bus (off, or in listen mode)"]
            }
            LastErrorCode::Bit1 | LastErrorCode::Bit0 => &[
                "two nodes send the same CAN ID",
                "CAN_H or CAN_L is short-circuited, or the transceiver has no supply",
            ],
            LastErrorCode::Form => {
                &["the channel is configured for classic CAN and receives CAN FD frames"]
            }
            _ => &["interference, termination or contact"],
        };
        let what = if error.is_error() {
            format!("the last error on the bus was a {error}")
        } else {
            format!("{} since its last read", errors(counters.logged))
        };
        self.warning("bus-error", what)
            .causes(causes)
            .cause(self.compare_rates())
            .next_step("watch the error counters while frames are sent", "16.3")
    }

    fn data_phase_error(&self, phases: ErrorPhases) -> Option<Finding> {
        let (code, logged) = (self.protocol().last_data_error, self.counters().logged);
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
        let own = self.own_compensation();
        let finding = self.warning("data-phase-error", what);
        // A bit 0 error is the own echo; the other codes also come from the error flag of another node.
        let finding = match code {
            LastErrorCode::Bit0 => finding
                .cause("the channel reads its own data bits back wrongly: its transmitter delay compensation (TDC)")
                .cause_if(own)
                .cause("the sample points of the data phase differ"),
            _ => finding
                .cause("the sample points of the data phase differ, or the nominal ones, at which it begins")
                .cause_if(own)
                .cause("transmitter delay compensation (TDC) of a peer is off, but needed from 5 Mbit/s"),
        };
        let settings = self.compensation().map_or_else(String::new, |text| format!(", {text}"));
        finding
            .cause("frames with BRS are sent to nodes with another data bit rate")
            .cause("stubs or cables are too long for this data bit rate")
            .cause(format!("this channel: {}{settings}", self.rates()))
            .next_step(COMPARE, "16.3")
    }
}

fn errors(logged: u8) -> String {
    match logged {
        u8::MAX => "255 or more errors are logged (ECR)".to_owned(),
        _ => format!("{logged} errors are logged (ECR)"),
    }
}
