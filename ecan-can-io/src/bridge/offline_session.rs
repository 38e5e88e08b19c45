//! A client session without a connection, for fuzzing.

use ecan_protocol::can::CanFrame;

use crate::bridge::config::BridgeProtocol;
use crate::bridge::rates::BusRates;
use crate::bridge::session::Session;
use crate::bridge::uplink::Uplink;

/// Result of a session.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OfflineSession {
    /// Bytes sent to the client, including the greeting.
    pub answers: Vec<u8>,
    /// Frames that the client sent.
    pub sent: Vec<CanFrame>,
    /// The same frames, encoded as the client would receive them at the end.
    pub received: Vec<u8>,
}

impl OfflineSession {
    /// Feeds a client's input in pieces, on a bus that accepts everything.
    pub fn hold<'a>(
        protocol: BridgeProtocol,
        rates: Option<BusRates>,
        pieces: impl IntoIterator<Item = &'a [u8]>,
    ) -> Self {
        let mut session = Session::new(protocol);
        let mut session_result = Self::default();
        let mut bus = Bus { rates, sent: Vec::new() };
        session.greet(&mut session_result.answers);
        for chunk in pieces {
            session.feed(chunk, &mut bus, &mut session_result.answers);
        }
        for frame in &bus.sent {
            session.receive_settings().encode(frame, 0, rates, &mut session_result.received);
        }
        session_result.sent = bus.sent;
        session_result
    }
}

struct Bus {
    rates: Option<BusRates>,
    sent: Vec<CanFrame>,
}

impl Uplink for Bus {
    fn bus(&self) -> Option<BusRates> {
        self.rates
    }

    fn send(&mut self, frame: CanFrame) -> bool {
        self.sent.push(frame);
        true
    }

    fn send_when_possible(&mut self, frame: CanFrame) {
        self.sent.push(frame);
    }

    fn take_lost(&mut self) -> bool {
        false
    }

    fn count_rejected(&mut self) {}

    fn count_mismatched(&mut self) {}
}
