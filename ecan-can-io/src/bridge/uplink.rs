//! Access of a session to the bus.

use ecan_protocol::can::CanFrame;

use crate::bridge::rates::BusRates;

pub(crate) trait Uplink {
    /// Bit rates; `None` before they are known.
    fn bus(&self) -> Option<BusRates>;

    /// Sends a frame; returns false if the queue is full.
    fn send(&mut self, frame: CanFrame) -> bool;

    /// Sends a frame and waits for space; no effect if the bus accepts none.
    fn send_when_possible(&mut self, frame: CanFrame);

    /// Returns whether accepted frames of the client were lost since the last call.
    fn take_lost(&mut self) -> bool;

    fn count_rejected(&mut self);

    /// Counts a frame that does not fit the bit rates or formats of the bus.
    fn count_mismatched(&mut self);
}
