//! Configuration and counters of a bridge, and what its clients and the bus exchange.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use ecan_protocol::can::CanFrame;

/// Protocol between a bridge and its clients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BridgeProtocol {
    /// ASCII protocol of Lawicel's serial adapters with the CAN FD commands of CANable 2:
    /// python-can's interface `slcan` on the channel `socket://127.0.0.1:PORT`.
    #[default]
    Slcan,
    /// Raw mode of socketcand: python-can's interface `socketcand`. Classic CAN only.
    Socketcand,
}

impl BridgeProtocol {
    /// Name of the protocol.
    pub fn name(self) -> &'static str {
        match self {
            Self::Slcan => "slcan",
            Self::Socketcand => "socketcand",
        }
    }
}

/// Configuration of a bridge. Plain data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BridgeConfig {
    /// Protocol.
    pub protocol: BridgeProtocol,
    /// Address on which it listens. Port 0 takes any free one. Everyone who can reach this address
    /// can send on the bus.
    pub address: SocketAddr,
    /// Name of the bus, which clients of socketcand open; `None` accepts every name.
    pub bus: Option<String>,
    /// Maximum number of clients; more are rejected. A client that has not opened the bus loses its
    /// place if another one needs it.
    pub max_clients: usize,
    /// Capacity in frames of the queue from each client to the bus, and of the queue to each client.
    pub queue: usize,
    /// Time in which a client of socketcand opens the bus; then its connection is closed. A client of
    /// slcan may be silent for as long as no other one needs its place: a terminal program has the
    /// connection open while its user types.
    pub handshake: Duration,
}

impl Default for BridgeConfig {
    /// slcan on a free port of the loopback interface, 8 clients, 4096 frames, 10 s to open the bus.
    fn default() -> Self {
        Self {
            protocol: BridgeProtocol::Slcan,
            address: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 0),
            bus: None,
            max_clients: 8,
            queue: 4096,
            handshake: Duration::from_secs(10),
        }
    }
}

impl BridgeConfig {
    /// The default configuration with another protocol.
    #[must_use]
    pub fn with_protocol(protocol: BridgeProtocol) -> Self {
        Self { protocol, ..Self::default() }
    }
}

/// Bit rates of a bus. Plain data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusRates {
    /// Bit rate of the arbitration phase in bit/s.
    pub nominal_bitrate: u32,
    /// Bit rate of the data phase of CAN FD frames with bit rate switch in bit/s.
    pub data_bitrate: u32,
    /// True if CAN FD frames can be on the bus.
    pub fd: bool,
}

impl BusRates {
    /// A classic bus.
    #[must_use]
    pub const fn classic(bitrate: u32) -> Self {
        Self { nominal_bitrate: bitrate, data_bitrate: bitrate, fd: false }
    }

    /// A CAN FD bus.
    #[must_use]
    pub const fn fd(nominal_bitrate: u32, data_bitrate: u32) -> Self {
        Self { nominal_bitrate, data_bitrate, fd: true }
    }
}

macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// Counters of a bridge.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct BridgeStatistics {
            /// Number of connected clients.
            pub clients: usize,
            $($(#[$doc])* pub $name: u64,)*
        }

        /// Counters of a bridge, which several threads increase.
        #[derive(Debug, Default)]
        pub(crate) struct Counters {
            $(pub(crate) $name: AtomicU64,)*
        }

        impl Counters {
            pub(crate) fn read(&self, clients: usize) -> BridgeStatistics {
                BridgeStatistics { clients, $($name: self.$name.load(Ordering::Relaxed),)* }
            }
        }
    };
}

counters! {
    /// Number of connections, without rejected clients.
    connections,
    /// Number of clients rejected because too many were connected.
    rejected_clients,
    /// Number of connections closed because their client did not open the bus: within the time for
    /// it, or before another client needed the place.
    silent_clients,
    /// Client frames that were sent on the bus.
    sent,
    /// Client frames that were passed to the bus and not sent, or without result.
    failed,
    /// Client frames dropped because a queue to the bus was full: of a CAN interface, or of connections that ended.
    /// The clients of other protocols wait.
    dropped_to_bus,
    /// Client frames rejected or discarded because the bus accepted none, for example while the
    /// gateway was not ready.
    discarded,
    /// Frames put into the queue of a client, including those outside its receive settings.
    delivered,
    /// Frames dropped because the queue of a client was full.
    dropped_to_clients,
    /// Commands and frames of clients that were rejected: malformed, unknown, at the wrong time, or
    /// for one of the reasons counted separately.
    rejected,
    /// Client frames rejected because of the client's bit rate, or because a CAN FD frame was for a
    /// classic bus.
    mismatched,
    /// Frames of the bus that the client cannot represent: CAN FD on a classic CAN interface.
    unsupported,
}

pub(crate) fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// Event of a bus. CAN interfaces receive it as an error frame (`candump -e`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusEvent {
    /// The controller is off the bus after too many errors.
    BusOff,
    /// The controller takes part again after bus-off.
    Restarted,
    /// Error active again.
    ErrorActive,
    /// Error warning: an error counter has reached 96, or the gateway reports many errors.
    ErrorWarning,
    /// Error passive: an error counter has reached 128.
    ErrorPassive,
    /// No node acknowledges the pending frames.
    NotAcknowledged,
    /// The frame lost arbitration and was not sent.
    LostArbitration,
    /// A frame was dropped: a queue to the bus was full.
    TransmitOverflow,
    /// Frames from the bus were dropped: a queue was full.
    ReceiveOverflow,
    /// The frame was not sent for another reason, or its result is unknown.
    TransmitFailed,
}

impl BusEvent {
    /// Returns whether the event is the loss of one frame.
    pub(crate) fn is_of_one_frame(self) -> bool {
        matches!(self, Self::LostArbitration | Self::TransmitOverflow | Self::TransmitFailed)
    }
}

/// Error counters of a CAN controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ErrorCounters {
    /// Transmit error counter.
    pub transmit: u8,
    /// Receive error counter.
    pub receive: u8,
}

const TX_TIMEOUT: u32 = 0x001;
const LOST_ARBITRATION: u32 = 0x002;
const CONTROLLER: u32 = 0x004;
const NOT_ACKNOWLEDGED: u32 = 0x020;
const BUS_OFF: u32 = 0x040;
const RESTARTED: u32 = 0x100;
const COUNTERS: u32 = 0x200;

const RX_OVERFLOW: u8 = 0x01;
const TX_OVERFLOW: u8 = 0x02;
const RX_WARNING: u8 = 0x04;
const TX_WARNING: u8 = 0x08;
const RX_PASSIVE: u8 = 0x10;
const TX_PASSIVE: u8 = 0x20;
const ACTIVE: u8 = 0x40;

/// An error frame: the error classes of its CAN ID, and 8 data bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ErrorFrame {
    pub(crate) class: u32,
    pub(crate) data: [u8; 8],
}

impl ErrorFrame {
    pub(crate) fn of(event: BusEvent, counters: Option<ErrorCounters>) -> Self {
        let controller = |problem| (CONTROLLER, problem);
        // The direction whose counter has reached the limit; both if the counters are unknown.
        let level = |limit: u8, tx: u8, rx: u8| match counters {
            Some(it) if it.transmit >= limit && it.receive < limit => controller(tx),
            Some(it) if it.receive >= limit && it.transmit < limit => controller(rx),
            _ => controller(tx | rx),
        };
        let (mut class, problem) = match event {
            BusEvent::BusOff => (BUS_OFF, 0),
            BusEvent::Restarted => (RESTARTED, 0),
            BusEvent::ErrorActive => controller(ACTIVE),
            BusEvent::ErrorWarning => level(96, TX_WARNING, RX_WARNING),
            BusEvent::ErrorPassive => level(128, TX_PASSIVE, RX_PASSIVE),
            BusEvent::NotAcknowledged => (NOT_ACKNOWLEDGED, 0),
            BusEvent::LostArbitration => (LOST_ARBITRATION, 0),
            BusEvent::TransmitOverflow => controller(TX_OVERFLOW),
            BusEvent::ReceiveOverflow => controller(RX_OVERFLOW),
            BusEvent::TransmitFailed => (TX_TIMEOUT, 0),
        };
        let mut data = [0, problem, 0, 0, 0, 0, 0, 0];
        if let Some(ErrorCounters { transmit, receive }) = counters {
            class |= COUNTERS;
            (data[6], data[7]) = (transmit, receive);
        }
        Self { class, data }
    }
}

/// What has happened on the way of frames since a client last asked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Conditions {
    /// Accepted frames of the client were lost, or the channel is off the bus.
    pub(crate) bus_error: bool,
    /// Frames for the client were dropped: it reads too slowly.
    pub(crate) overrun: bool,
    /// An error counter has reached its warning limit.
    pub(crate) warning: bool,
    /// A frame lost arbitration and was not sent.
    pub(crate) lost_arbitration: bool,
}

impl Conditions {
    pub(crate) fn note(&mut self, event: BusEvent) {
        match event {
            BusEvent::BusOff
            | BusEvent::NotAcknowledged
            | BusEvent::TransmitOverflow
            | BusEvent::TransmitFailed => self.bus_error = true,
            BusEvent::ErrorWarning | BusEvent::ErrorPassive => self.warning = true,
            BusEvent::LostArbitration => self.lost_arbitration = true,
            BusEvent::ReceiveOverflow => self.overrun = true,
            BusEvent::Restarted | BusEvent::ErrorActive => {}
        }
    }
}

pub(crate) trait Uplink {
    /// Bit rates; `None` before they are known.
    fn bus(&self) -> Option<BusRates>;

    /// Sends a frame and waits for space; returns false if the bus accepts none.
    fn send(&mut self, frame: CanFrame) -> bool;

    /// What the client has not read in the flags of its protocol yet.
    fn take_conditions(&mut self) -> Conditions;

    fn count_rejected(&mut self);

    /// Tells the client in the order of the frames that one of its frames is not sent.
    fn report_lost(&mut self);

    /// Counts a frame that does not fit the bit rates or formats of the bus.
    fn count_mismatched(&mut self);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Classes and data as the drivers of Linux report them (`linux/can/error.h`).
    #[test]
    fn events_have_the_codes_of_linux() {
        let frame = |event, counters: Option<[u8; 2]>| {
            let counters = counters.map(|[transmit, receive]| ErrorCounters { transmit, receive });
            let ErrorFrame { class, data } = ErrorFrame::of(event, counters);
            (class, data)
        };
        assert_eq!(frame(BusEvent::BusOff, None), (0x40, [0; 8]));
        assert_eq!(frame(BusEvent::Restarted, None), (0x100, [0; 8]));
        assert_eq!(frame(BusEvent::LostArbitration, None), (2, [0; 8]));
        assert_eq!(frame(BusEvent::NotAcknowledged, None), (0x20, [0; 8]));
        assert_eq!(frame(BusEvent::TransmitFailed, None), (1, [0; 8]));
        assert_eq!(frame(BusEvent::ErrorActive, None), (4, [0, 0x40, 0, 0, 0, 0, 0, 0]));
        assert_eq!(frame(BusEvent::ErrorWarning, None), (4, [0, 0x0C, 0, 0, 0, 0, 0, 0]));
        let warning = (0x204, [0, 0x08, 0, 0, 0, 0, 100, 3]);
        assert_eq!(frame(BusEvent::ErrorWarning, Some([100, 3])), warning);
        let passive = (0x204, [0, 0x10, 0, 0, 0, 0, 3, 130]);
        assert_eq!(frame(BusEvent::ErrorPassive, Some([3, 130])), passive);
        assert_eq!(frame(BusEvent::TransmitOverflow, None), (4, [0, 2, 0, 0, 0, 0, 0, 0]));
        assert_eq!(frame(BusEvent::ReceiveOverflow, None), (4, [0, 1, 0, 0, 0, 0, 0, 0]));
    }
}
