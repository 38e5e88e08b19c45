//! Configuration of the model of a gateway, and the parts of its board: power supply, assignment of the CAN
//! controllers to the connectors (0x8000:12 to :15), and the EEPROM, which the gateway emulates in its flash
//! (manual 13.7).

use ecan_protocol::device::AlStatusCode;
use ecan_protocol::mapping::CHANNELS;

use super::NS_PER_MS;
use super::variant::{GatewayVariant, RotationDirection};
use crate::bus::PhysicalLayer;

/// Identity and timing of one simulated gateway.
///
/// The manual gives no vendor ID, no product code and no time of the firmware's
/// service loop; the defaults are assumptions that a scenario can replace.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GatewayModelConfig {
    /// Serial number, 0xF000:7 (low half) and :8 (high half).
    pub serial: u64,
    /// Hardware revision, 0xF000:4.
    pub hardware_revision: u32,
    /// Factory firmware version, 0xF000:5 and :6; a firmware update changes it.
    pub firmware: (u16, u16),
    /// Vendor ID of the SII and of 0x1018:1.
    pub vendor_id: u32,
    /// Product code of the SII and of 0x1018:2.
    pub product_code: u32,
    /// Revision number of the SII and of 0x1018:3.
    pub revision: u32,
    /// Milliseconds from power-on or reboot until the slave answers in INIT.
    pub boot_ms: u32,
    /// Milliseconds from the reboot command (0x8000:01) to the reboot. 0: the gateway reboots without
    /// a response to the command.
    pub reboot_delay_ms: u32,
    /// Nanoseconds from a complete SM2 write to the data-path service that handles it.
    pub service_delay_ns: u64,
    /// Upper bound of a pseudo-random addition to `service_delay_ns`, drawn from the
    /// gateway's seed; 0 disables it.
    pub service_jitter_ns: u64,
    /// Upper bound of a pseudo-random delay of the timer that releases scheduled frames,
    /// in nanoseconds. Frames of one phase have the same delay and keep their order.
    pub release_jitter_ns: u64,
    /// Nanoseconds between two services in SAFEOP, where no SM2 write paces them.
    pub idle_service_ns: u64,
    /// Longest wait for the first Sync0 pulse in a transition to OP, in nanoseconds. After
    /// it the transition fails with AL status 0x002D.
    pub sync_wait_ns: u64,
    /// Consecutive Sync0 pulses without an SM2 write after which the slave leaves OP with AL
    /// status 0x002C; 0 disables this check.
    pub missed_sync_limit: u32,
    /// Times around Sync0 at which outputs are missed.
    pub sync0_window: Sync0Window,
    /// Rate of the distributed clock's oscillator above simulated time, in parts per billion:
    /// 50 000 is 50 ppm.
    pub clock_drift_ppb: i32,
    /// Fill level of its TX ring, in percent, from which a channel reports `tx_pressure`. A full
    /// transmit FIFO of the CAN controller also reports it, except with 100.
    pub tx_pressure_percent: u8,
    /// True if a service that finds SM3 full publishes its image when the master has read SM3.
    /// False: SM3 stays empty from that read to the next service.
    pub publishes_after_read: bool,
    /// True if the gateway supports SDO Complete Access, and its SII offers it. The manual does not
    /// mention it.
    pub complete_access: bool,
    /// Nanoseconds from a complete write of the mailbox (SM0) until the firmware's response is
    /// ready in SM1. The manual gives no time. In the operation phase of the simulated libethercat a
    /// response takes at least 2 ms.
    pub mailbox_delay_ns: u64,
    /// Delay of the CAN transceivers from transmit to receive pin, in nanoseconds. The manual gives no
    /// time.
    pub transceiver_ns: u32,
    /// Switches for what the manual leaves open.
    pub variant: GatewayVariant,
}

impl Default for GatewayModelConfig {
    fn default() -> Self {
        Self {
            serial: 0x0000_0001_0000_0001,
            hardware_revision: 1,
            firmware: (0x0202, 0x0001),
            vendor_id: 0x0000_4543,
            product_code: 0x4C49_5445,
            revision: 0x0002_0002,
            boot_ms: 200,
            reboot_delay_ms: 100,
            service_delay_ns: 30_000,
            service_jitter_ns: 0,
            release_jitter_ns: 0,
            idle_service_ns: 1_000_000,
            sync_wait_ns: 2_000_000_000,
            missed_sync_limit: 0,
            sync0_window: Sync0Window::default(),
            clock_drift_ppb: 0,
            tx_pressure_percent: 50,
            publishes_after_read: false,
            complete_access: false,
            mailbox_delay_ns: 200_000,
            transceiver_ns: PhysicalLayer::TRANSCEIVER_NS,
            variant: GatewayVariant::default(),
        }
    }
}

/// Configuration of one sync manager.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SyncManagerConfig {
    /// Physical start address in the slave controller's memory.
    pub start: u16,
    /// Length in bytes.
    pub length: u16,
    /// Control byte: bits 0..1 buffer mode (2 = single buffer), bits 2..3 direction
    /// (1 = the master writes), bit 6 watchdog trigger. The manual's values are 0x66
    /// for SM2 and 0x22 for SM3 (manual 5.3).
    pub control: u8,
}

/// Fields of the control byte, each with the value that matters here.
const CONTROL_MODE: u8 = 0x03;
const CONTROL_SINGLE: u8 = 0x02;
const CONTROL_DIRECTION: u8 = 0x0C;
const CONTROL_WRITTEN_BY_MASTER: u8 = 0x04;

impl SyncManagerConfig {
    /// Single buffer, not three-buffer mode.
    pub(crate) fn is_single(self) -> bool {
        self.control & CONTROL_MODE == CONTROL_SINGLE
    }

    pub(crate) fn is_written_by_master(self) -> bool {
        self.control & CONTROL_DIRECTION == CONTROL_WRITTEN_BY_MASTER
    }

    pub(crate) fn is_single_buffer(self, written_by_master: bool) -> bool {
        // The two other direction values are reserved.
        let is_read = self.control & CONTROL_DIRECTION == 0;
        self.is_single() && if written_by_master { self.is_written_by_master() } else { is_read }
    }
}

/// The mailboxes SM0 and SM1, in the memory below the process data (manual 5.3).
pub(crate) const MAILBOXES: [SyncManagerConfig; 2] = [
    SyncManagerConfig { start: 0x1000, length: 0x80, control: 0x26 },
    SyncManagerConfig { start: 0x1080, length: 0x80, control: 0x22 },
];

/// Configuration of Sync0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sync0 {
    /// Time of the first pulse without the shift, in nanoseconds of the slave's system time.
    /// System time is simulated time until the master writes it.
    pub start_ns: u64,
    /// Period in nanoseconds; 0 counts as one nanosecond.
    pub cycle_ns: u32,
    /// Shift of all pulses against `start_ns`, in nanoseconds.
    pub shift_ns: i32,
}

/// Window around each Sync0 pulse in which outputs of the master are missed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sync0Window {
    /// Begin of the window before the pulse, in nanoseconds. 0 with `after_ns` 0 disables the
    /// window.
    pub before_ns: u32,
    /// End of the window after the pulse, in nanoseconds.
    pub after_ns: u32,
    /// Number of writes in a row within the window after which the slave leaves OP; 0 keeps it in
    /// OP.
    pub missed_limit: u32,
    /// AL status code with which it leaves OP.
    pub al_status: AlStatusCode,
}

impl Sync0Window {
    /// No outputs are missed.
    pub const OFF: Self =
        Self { before_ns: 0, after_ns: 0, missed_limit: 0, al_status: AlStatusCode::SYNC_ERROR };

    pub(super) fn is_off(self) -> bool {
        self.before_ns == 0 && self.after_ns == 0
    }
}

impl Default for Sync0Window {
    /// From 50 us before the pulse (service delay and reading) to 20 us after it; OP is left after
    /// ten missed writes in a row with AL status 0x001A.
    fn default() -> Self {
        Self { before_ns: 50_000, after_ns: 20_000, missed_limit: 10, ..Self::OFF }
    }
}

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

    pub(super) fn active(&self) -> u8 {
        self.active
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
