//! Events of a bus, as error frames of SocketCAN (`linux/can/error.h`).

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
