//! What a slave controller on the wire asks of its gateway, beside what every front does.

use ecan_protocol::device::AlStatusCode;

use super::Gateway;

impl Gateway {
    /// How often it has booted; the controller starts anew with it.
    pub(crate) fn boots(&self) -> u32 {
        self.boots
    }

    /// The image that waits in SM3.
    pub(crate) fn input_image(&self) -> &[u8] {
        let length = self.inputs.length().unwrap_or(0);
        self.inputs.memory().get(..length).unwrap_or_default()
    }

    /// The master has begun to read SM3 and will go on in another datagram.
    pub(crate) fn inputs_are_being_read(&mut self) {
        self.are_inputs_being_read = true;
    }

    /// The controller refused an access to SM2 or SM3.
    pub(crate) fn note_refused(&mut self, is_write: bool) {
        let refused = if is_write {
            &mut self.counters.writes_refused
        } else {
            &mut self.counters.reads_refused
        };
        *refused += 1;
    }

    /// Changes whenever what lies in the mailboxes has become void.
    pub(crate) fn mailbox_stops(&self) -> u32 {
        self.mailbox_stops
    }

    /// Changes whenever an access to process data that has begun has become void.
    pub(crate) fn process_data_stops(&self) -> u32 {
        self.process_data_stops
    }

    /// The clock's time since the supply came or the firmware rebooted, ns.
    pub(crate) fn dc_time_since_boot(&self, now: u64) -> u64 {
        self.dc_time(now).saturating_sub(self.dc_time(self.booted_at))
    }

    /// Time of the distributed clock, whoever has set it, ns.
    pub(crate) fn dc_time(&self, now: u64) -> u64 {
        self.clock.line().system(now)
    }

    /// The next Sync0 pulse in the system time of the slave; none without Sync0.
    pub(crate) fn next_sync0_system_time(&self, now: u64) -> Option<u64> {
        self.pulses.and_then(|pulses| pulses.next_system_after(now))
    }

    /// Expirations of the process data watchdog since the boot.
    pub(crate) fn watchdog_expirations(&self) -> u32 {
        self.watchdog_expirations
    }

    /// Whether the process data watchdog has run out and not been fed since.
    pub(crate) fn watchdog_has_expired(&self) -> bool {
        self.is_watchdog_expired
    }

    /// The master asks for a state that there is not.
    pub(crate) fn refuse_unknown_al_state(&mut self, now: u64) {
        self.advance(now);
        if self.is_responding() {
            self.error = true;
            self.status_code = AlStatusCode::UNKNOWN_STATE;
        }
    }
}
