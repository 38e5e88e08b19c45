use ecan_protocol::config::{CrcTest, DiagnosticTest, RxBypass, Sides, TxBypass};
use ecan_protocol::image::OptionFlags;
use ecan_protocol::mapping::Direction;

use super::profile_control::ProfileControl;
use super::variant::GatewayVariant;

/// Profiles of 0x8010 and 0x8011 and test policies of 0x8030.
#[derive(Clone, Debug)]
pub(super) struct ActiveOptions {
    pub(super) tx: ProfileControl,
    pub(super) rx: ProfileControl,
    pub(super) test: DiagnosticTest,
}

impl ActiveOptions {
    pub(super) fn new(variant: &GatewayVariant) -> Self {
        let [tx, rx] = [Direction::TxPdo, Direction::RxPdo]
            .map(|direction| ProfileControl::new(direction, variant));
        Self { tx, rx, test: DiagnosticTest::OFF }
    }

    pub(super) fn of(&self, direction: Direction) -> &ProfileControl {
        match direction {
            Direction::TxPdo => &self.tx,
            Direction::RxPdo => &self.rx,
        }
    }

    pub(super) fn of_mut(&mut self, direction: Direction) -> &mut ProfileControl {
        match direction {
            Direction::TxPdo => &mut self.tx,
            Direction::RxPdo => &mut self.rx,
        }
    }

    pub(super) fn has(&self, direction: Direction, option: OptionFlags) -> bool {
        self.of(direction).active.is_some_and(|profile| profile.options.contains(option))
    }

    pub(super) fn uses_crc(&self, direction: Direction) -> bool {
        match self.test.crc {
            CrcTest::Follow => !self.has(direction, OptionFlags::NO_CRC16),
            CrcTest::Force => true,
            CrcTest::Suppress => false,
        }
    }

    pub(super) fn is_payload_only(&self, direction: Direction) -> bool {
        self.has(direction, OptionFlags::PAYLOAD_ONLY)
            || includes(self.test.payload_only, direction)
    }

    /// Returns whether the CAN side of a direction is disconnected.
    pub(super) fn is_app_bypassed(&self, direction: Direction) -> bool {
        self.has(direction, OptionFlags::APP_BYPASS)
            || includes(self.test.app_link_bypass, direction)
    }

    pub(super) fn bypasses_rx(&self, bypass: RxBypass) -> bool {
        self.test.rx_bypass.0 & bypass.0 != 0
    }

    pub(super) fn bypasses_tx(&self, bypass: TxBypass) -> bool {
        self.test.tx_bypass.0 & bypass.0 != 0
    }
}

fn includes(sides: Sides, direction: Direction) -> bool {
    match sides {
        Sides::Off => false,
        Sides::Tx => direction == Direction::TxPdo,
        Sides::Rx => direction == Direction::RxPdo,
        Sides::Both => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn test_policies_override_the_profile() {
        let mut options = ActiveOptions::new(&GatewayVariant::default());
        assert!(options.uses_crc(Direction::TxPdo));
        options.test.crc = CrcTest::Suppress;
        assert!(!options.uses_crc(Direction::TxPdo));
        options.test.payload_only = Sides::Tx;
        let payload_only = Direction::ALL.map(|direction| options.is_payload_only(direction));
        let expected = Direction::ALL.map(|direction| direction == Direction::TxPdo);
        assert_eq!(payload_only, expected);
        options.test.rx_bypass = RxBypass::STAGE;
        assert!(options.bypasses_rx(RxBypass::STAGE));
        assert!(!options.bypasses_rx(RxBypass::PARSE));
    }
}
