//! The part of the Port that service frames need.

use ecan_mcan_port::{Cycle, SendError, SendOptions, SendTicket};
use ecan_protocol::can::FrameRef;

pub(super) trait FrameSink {
    fn send(
        &mut self,
        slave: usize,
        channel: u8,
        frame: FrameRef<'_>,
        options: SendOptions,
    ) -> Result<SendTicket, SendError>;

    /// Frames that the gateway has not sent yet on a channel, by its status.
    fn pending(&self, slave: usize, channel: u8) -> u8;

    /// Bytes left in the image of this cycle.
    fn room(&self, slave: usize) -> usize;

    fn is_ready(&self, slave: usize) -> bool;

    /// Returns whether the last image is unconfirmed, so that frames wait for the next one.
    fn is_unconfirmed(&self, slave: usize) -> bool;
}

impl FrameSink for Cycle<'_> {
    fn send(
        &mut self,
        slave: usize,
        channel: u8,
        frame: FrameRef<'_>,
        options: SendOptions,
    ) -> Result<SendTicket, SendError> {
        let to = self.channel(slave, channel)?;
        self.send_with(to, frame, options)
    }

    fn pending(&self, slave: usize, channel: u8) -> u8 {
        let channel = self.channel(slave, channel);
        channel.map_or(0, |channel| self.channel_status(channel).tx_pending())
    }

    fn room(&self, slave: usize) -> usize {
        self.gateway(slave).map_or(0, |gateway| self.image_room(gateway))
    }

    fn is_ready(&self, slave: usize) -> bool {
        self.gateway(slave).is_ok_and(|gateway| self.gateway_is_ready(gateway))
    }

    fn is_unconfirmed(&self, slave: usize) -> bool {
        let gateway = self.gateway(slave);
        gateway.is_ok_and(|gateway| self.cycle_report(gateway).is_unconfirmed)
    }
}
