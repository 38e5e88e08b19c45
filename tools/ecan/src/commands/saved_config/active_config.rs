//! Active configuration of a gateway, as opposed to stored objects.

use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::{CHANNELS, Direction};

use crate::context::{Bus, Result};

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct ActiveConfig {
    /// Per direction: image size in bytes, 0 without a profile, and the profile word (0x8010,
    /// 0x8011:09, :12).
    profiles: [(u32, u32); 2],
    /// Which channels are active on their bus (0x9000:09).
    on_bus: [bool; CHANNELS],
    /// Active control words (0x8021:20).
    data_paths: [u32; CHANNELS],
}

impl ActiveConfig {
    pub(super) fn read(bus: &Bus, slave: usize) -> Result<Self> {
        let mut profiles = [(0, 0); 2];
        for (direction, profile) in Direction::ALL.into_iter().zip(&mut profiles) {
            let read = |subindex| bus.read(slave, direction.profile_object(), subindex);
            *profile = (read(9)?, read(12)?);
        }
        let (mut on_bus, mut data_paths) = ([false; CHANNELS], [0; CHANNELS]);
        for (index, is_on_bus) in (0x9000..).zip(&mut on_bus) {
            let status = ChannelStatus::from_raw(bus.read(slave, index, 9)? as u16);
            let is_off = matches!(status.state(), ChannelState::Disabled | ChannelState::Init);
            *is_on_bus = !is_off || status.bus_off();
        }
        for (index, word) in (0x8021..).zip(&mut data_paths) {
            *word = bus.read(slave, index, 20)?;
        }
        Ok(Self { profiles, on_bus, data_paths })
    }

    /// Returns whether a profile or channel is active that was not active `before`.
    pub(super) fn has_more_than(&self, before: &Self) -> bool {
        let profiles = before.profiles.iter().zip(&self.profiles);
        let channels = before.on_bus.iter().zip(&self.on_bus);
        profiles.into_iter().any(|(before, now)| before.0 == 0 && now.0 != 0)
            || channels.into_iter().any(|(before, now)| !before && *now)
    }

    pub(super) fn is_on_bus(&self, channel: u8) -> bool {
        self.on_bus.get(usize::from(channel)).is_some_and(|it| *it)
    }

    pub(super) fn has_data_path_of(&self, other: &Self, channel: u8) -> bool {
        let of = |it: &Self| it.data_paths.get(usize::from(channel)).copied();
        of(self) == of(other)
    }

    pub(super) fn has_profile_of(&self, other: &Self, direction: Direction) -> bool {
        let at = Direction::ALL.iter().position(|it| *it == direction);
        let of = |it: &Self| at.and_then(|at| it.profiles.get(at).copied());
        of(self) == of(other)
    }

    pub(super) fn difference(&self, before: &Self) -> Option<String> {
        for direction in Direction::ALL {
            if !self.has_profile_of(before, direction) {
                let object = direction.profile_object();
                return Some(format!("0x{object:04X}: another profile is active"));
            }
        }
        for channel in (0..).take(CHANNELS) {
            let message = match (before.is_on_bus(channel), self.is_on_bus(channel)) {
                (false, true) => "is active and was not before",
                (true, false) => "is not active any more",
                _ if !self.has_data_path_of(before, channel) => {
                    "has another data path configuration"
                }
                _ => continue,
            };
            return Some(format!("channel {channel} {message}"));
        }
        None
    }
}
