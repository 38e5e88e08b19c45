//! Assignment of the CAN controllers to the connectors, 0x8000:12 to :15.

use ecan_protocol::mapping::CHANNELS;

use super::variant::RotationDirection;

#[derive(Clone, Debug, Default)]
pub(super) struct PinRotation {
    active: u8,
    changes: u32,
    direction: RotationDirection,
}

impl PinRotation {
    pub(super) fn new(direction: RotationDirection) -> Self {
        Self { direction, ..Self::default() }
    }

    pub(super) fn reset(&mut self) {
        self.active = 0;
        self.changes = self.changes.wrapping_add(1);
    }

    /// Activates a rotation; returns whether it differs from the previous one.
    pub(super) fn set(&mut self, rotation: u8) -> bool {
        if rotation == self.active {
            return false;
        }
        self.active = rotation;
        self.changes = self.changes.wrapping_add(1);
        true
    }

    pub(super) fn changes(&self) -> u32 {
        self.changes
    }

    /// The channel at a connector; `None` for a connector that does not exist.
    pub(super) fn channel_at(&self, connector: usize) -> Option<usize> {
        let rotation = usize::from(self.active) % CHANNELS;
        let back = match self.direction {
            RotationDirection::Up => CHANNELS - rotation,
            RotationDirection::Down => rotation,
        };
        (connector < CHANNELS).then(|| (connector + back) % CHANNELS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotation_moves_each_channel_to_the_next_connector() {
        let mut pins = PinRotation::default();
        assert!(pins.set(1));
        let channels = [0, 1, 2, 3, 4].map(|connector| pins.channel_at(connector));
        assert_eq!(channels, [Some(3), Some(0), Some(1), Some(2), None]);
    }

    #[test]
    fn rotation_down_moves_each_channel_to_the_previous_connector() {
        let mut pins = PinRotation::new(RotationDirection::Down);
        assert!(pins.set(1));
        assert_eq!(
            [0, 1, 2, 3].map(|connector| pins.channel_at(connector)),
            [1, 2, 3, 0].map(Some)
        );
    }

    #[test]
    fn unchanged_rotation_is_not_counted() {
        let mut pins = PinRotation::default();
        assert!(!pins.set(0));
        assert!(pins.set(2));
        assert!(!pins.set(2));
        assert_eq!(pins.changes(), 1);
        pins.reset();
        assert_eq!((pins.changes(), pins.channel_at(0)), (2, Some(0)));
    }
}
