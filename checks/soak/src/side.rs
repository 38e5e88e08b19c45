//! A channel of the machine in a trial.

use ecan_mcan_port::ChannelHandle;
use ecan_protocol::can::CanFrame;

use crate::account::Account;

/// A channel, with its place in the machine.
pub struct Side {
    pub slave: usize,
    pub channel: u8,
    pub bus: String,
    /// Frames in 1000 cycles.
    pub frames: u32,
    pub sends: bool,
    /// Extended CAN IDs that its filter rejects.
    pub rejects: Option<[u32; 2]>,
    pub has_partner: bool,
    /// Images of the gateway that this Port discarded because the gateway was not ready.
    pub discarded_images: u64,
    pub account: Account,
    pub handle: Option<ChannelHandle>,
}

impl Side {
    /// The application got a frame.
    pub fn received(&mut self, frame: &CanFrame) -> Result<(), String> {
        self.check_filter(frame)?;
        self.account.received(frame)
    }

    /// A frame that arrives passes the filter.
    pub fn check_filter(&self, frame: &CanFrame) -> Result<(), String> {
        let id = frame.id();
        if let Some([first, last]) = self.rejects
            && id.is_extended()
            && (first..=last).contains(&id.raw())
        {
            return Err(format!("a frame that the filter rejects: {frame:?}"));
        }
        Ok(())
    }

    /// A text with the name of the channel.
    pub fn named(&self, text: &str) -> String {
        format!("slave {} channel {}: {text}", self.slave, self.channel)
    }
}
