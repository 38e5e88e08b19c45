//! What a protocol does for one client, without threads and sockets.

use ecan_protocol::CanFrame;

use crate::rates::BusRates;
use crate::settings::BridgeProtocol;
use crate::slcan::SlcanSession;
use crate::socketcand::SocketcandSession;

/// The bus, as a session uses it.
pub(crate) trait Uplink {
    /// Its bit rates; `None` before they are known.
    fn bus(&self) -> Option<BusRates>;

    /// Hands a frame over; false when there is no room.
    fn send(&mut self, frame: CanFrame) -> bool;

    /// A command was refused.
    fn count_refused(&mut self);

    /// A frame was refused because the bus cannot carry it as the client sees the bus.
    fn count_mismatched(&mut self);
}

/// The state of one client.
#[derive(Debug)]
pub(crate) enum Session {
    Slcan(SlcanSession),
    Socketcand(SocketcandSession),
}

impl Session {
    pub(crate) fn new(protocol: BridgeProtocol) -> Self {
        match protocol {
            BridgeProtocol::Slcan => Self::Slcan(SlcanSession::new()),
            BridgeProtocol::Socketcand => Self::Socketcand(SocketcandSession::new()),
        }
    }

    /// What the server says first.
    pub(crate) fn greet(&self, answer: &mut Vec<u8>) {
        match self {
            Self::Slcan(_) => {}
            Self::Socketcand(session) => session.greet(answer),
        }
    }

    /// Takes in what the client wrote, in pieces of any size, and appends the answers.
    pub(crate) fn feed(&mut self, bytes: &[u8], bus: &mut impl Uplink, answer: &mut Vec<u8>) {
        match self {
            Self::Slcan(session) => session.feed(bytes, bus, answer),
            Self::Socketcand(session) => session.feed(bytes, bus, answer),
        }
    }

    /// Appends a frame of the bus, if the client wants to hear it.
    pub(crate) fn encode(
        &self,
        frame: &CanFrame,
        time_ns: u64,
        bus: Option<BusRates>,
        text: &mut Vec<u8>,
    ) {
        match self {
            Self::Slcan(session) => session.encode(frame, time_ns, bus, text),
            Self::Socketcand(session) => session.encode(frame, time_ns, text),
        }
    }
}
