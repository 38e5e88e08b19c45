//! Parts of the board of a gateway: power supply, assignment of the CAN controllers to the connectors (0x8000:12 to
//! :15), and the EEPROM, which the gateway emulates in its flash (manual 13.7).

use ecan_protocol::mapping::CHANNELS;

use super::NS_PER_MS;
use super::variant::RotationDirection;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PowerState {
    Off,
    Booting { until: u64 },
    On,
}

#[derive(Clone, Debug)]
pub(crate) struct PowerSupply {
    state: PowerState,
    boot_ns: u64,
    /// From the reboot command to the reboot: the master fetches the response in this time.
    reboot_delay_ns: u64,
    pub(crate) boots: u32,
    pub(crate) booted_at: u64,
    pub(super) reboot_at: Option<u64>,
}

impl PowerSupply {
    pub(super) fn new(boot_ms: u32, reboot_delay_ms: u32) -> Self {
        let [boot_ns, reboot_delay_ns] =
            [boot_ms, reboot_delay_ms].map(|ms| u64::from(ms) * NS_PER_MS);
        let state = PowerState::Off;
        Self { state, boot_ns, reboot_delay_ns, boots: 0, booted_at: 0, reboot_at: None }
    }

    pub(super) fn is_off(&self) -> bool {
        self.state == PowerState::Off
    }

    pub(super) fn is_running(&self) -> bool {
        self.state == PowerState::On
    }

    pub(super) fn switch_off(&mut self) {
        self.state = PowerState::Off;
        self.reboot_at = None;
    }

    pub(super) fn boot(&mut self, now: u64) {
        self.reboot_at = None;
        self.boots = self.boots.wrapping_add(1);
        self.booted_at = now;
        self.state = PowerState::Booting { until: now + self.boot_ns };
    }

    pub(super) fn boot_end(&self) -> Option<u64> {
        match self.state {
            PowerState::Booting { until } => Some(until),
            PowerState::Off | PowerState::On => None,
        }
    }

    pub(super) fn finish_boot(&mut self) {
        self.state = PowerState::On;
    }

    pub(super) fn request_reboot(&mut self, now: u64) {
        self.reboot_at = Some(now + self.reboot_delay_ns);
    }
}

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

#[derive(Clone, Debug, Default)]
pub(super) struct Eeprom {
    pub(super) words: Vec<u16>,
    default: Vec<u16>,
}

impl Eeprom {
    /// Sets the contents of a rebuilt EEPROM; an empty one is rebuilt now.
    pub(super) fn install(&mut self, default: Vec<u16>) {
        self.default = default;
        self.start();
    }

    pub(super) fn write(&mut self, word: u16, value: u16) {
        if let Some(to) = self.words.get_mut(usize::from(word)) {
            *to = value;
        }
    }

    /// Start of the firmware: rebuilds an erased EEPROM.
    pub(super) fn start(&mut self) {
        if self.words.is_empty() {
            self.words.clone_from(&self.default);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boot_ends_after_the_configured_time() {
        let mut supply = PowerSupply::new(200, 100);
        assert!(supply.is_off());
        supply.boot(1_000);
        assert_eq!((supply.is_off(), supply.is_running()), (false, false));
        assert_eq!((supply.boot_end(), supply.booted_at), (Some(200_001_000), 1_000));
        supply.finish_boot();
        assert!(supply.is_running());
        assert_eq!(supply.boot_end(), None);
    }

    #[test]
    fn power_loss_cancels_a_requested_reboot() {
        let mut supply = PowerSupply::new(1, 100);
        supply.boot(0);
        supply.finish_boot();
        supply.request_reboot(5);
        assert_eq!(supply.reboot_at, Some(100_000_005));
        supply.switch_off();
        assert_eq!(supply.reboot_at, None);
        supply.boot(10);
        assert_eq!((supply.boots, supply.reboot_at), (2, None));
    }

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

    #[test]
    fn erased_eeprom_is_rebuilt_at_start() {
        let mut eeprom = Eeprom::default();
        eeprom.install(vec![1, 2]);
        eeprom.write(1, 9);
        eeprom.write(2, 9);
        eeprom.start();
        assert_eq!(eeprom.words, [1, 9]);
        eeprom.words.clear();
        assert!(eeprom.words.is_empty());
        eeprom.start();
        assert_eq!(eeprom.words, [1, 2]);
    }
}
