//! A client's whole conversation without a connection, for fuzzing.

use ecan_protocol::can::CanFrame;

use crate::rates::BusRates;
use crate::session::{Session, Uplink};
use crate::settings::BridgeProtocol;

/// What came of a conversation.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OfflineSession {
    /// What the client was told, the greeting included.
    pub answers: Vec<u8>,
    /// What it sent.
    pub sent: Vec<CanFrame>,
    /// The same as the client would hear it in the end from others.
    pub heard: Vec<u8>,
}

impl OfflineSession {
    /// A client that writes these pieces, on a bus that takes everything.
    pub fn hold<'a>(
        protocol: BridgeProtocol,
        rates: Option<BusRates>,
        pieces: impl IntoIterator<Item = &'a [u8]>,
    ) -> Self {
        let mut session = Session::new(protocol);
        let mut conversation = Self::default();
        let mut bus = Bus { rates, sent: Vec::new() };
        session.greet(&mut conversation.answers);
        for piece in pieces {
            session.feed(piece, &mut bus, &mut conversation.answers);
        }
        for frame in &bus.sent {
            session.hearing().encode(frame, 0, rates, &mut conversation.heard);
        }
        conversation.sent = bus.sent;
        conversation
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

    fn count_refused(&mut self) {}

    fn count_mismatched(&mut self) {}
}
