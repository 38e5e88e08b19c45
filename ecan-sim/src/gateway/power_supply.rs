use super::NS_PER_MS;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PowerState {
    Off,
    Booting { until: u64 },
    On,
}

#[derive(Clone, Debug)]
pub(super) struct PowerSupply {
    state: PowerState,
    boot_ns: u64,
    /// From the reboot command to the reboot: the master fetches the response in this time.
    reboot_delay_ns: u64,
    pub(super) boots: u32,
    pub(super) booted_at: u64,
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
}
