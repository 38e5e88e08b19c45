//! The four sync managers: two mailboxes, and SM2 and SM3 as single buffers (manual 5.3).
//!
//! A write is complete with its last byte and fills the buffer; further writes are rejected until
//! the firmware has read it. A read succeeds only while the buffer is full, and empties it.

use ecan_protocol::device::AlStatusCode;
use ecan_protocol::mapping::{
    Direction, MAX_PDO_BYTES, sync_manager_address, sync_manager_control,
};

use super::config::SyncManagerConfig;

/// Control bit: a write feeds the process data watchdog.
const WATCHDOG_TRIGGER: u8 = 0x40;
/// The shortest mailbox that the services work with.
const SHORTEST_MAILBOX: u16 = 34;
/// End of the registers.
const MEMORY_START: u16 = 0x1000;

#[derive(Clone, Debug)]
pub(super) struct SingleBuffer {
    config: Option<SyncManagerConfig>,
    data: Box<[u8]>,
    full: bool,
}

impl SingleBuffer {
    fn new() -> Self {
        Self { config: None, data: vec![0; MAX_PDO_BYTES].into_boxed_slice(), full: false }
    }

    /// Enables or disables the sync manager. Either empties the buffer; the memory keeps its bytes.
    fn configure(&mut self, config: Option<SyncManagerConfig>) {
        self.config = config;
        self.full = false;
    }

    /// Length in bytes while enabled and within the memory.
    pub(super) fn length(&self) -> Option<usize> {
        self.config
            .map(|sm| usize::from(sm.length))
            .filter(|&length| length > 0 && length <= self.data.len())
    }

    pub(super) fn feeds_watchdog(&self) -> bool {
        self.config.is_some_and(|sm| sm.control & WATCHDOG_TRIGGER != 0)
    }

    pub(super) fn is_full(&self) -> bool {
        self.full
    }

    pub(super) fn empty(&mut self) {
        self.full = false;
    }

    fn clear(&mut self) {
        self.configure(None);
        self.data.fill(0);
    }

    /// A complete write by the master; rejected if disabled, full or of another length.
    pub(super) fn write(&mut self, bytes: &[u8]) -> bool {
        if self.full || self.length() != Some(bytes.len()) {
            return false;
        }
        self.data[..bytes.len()].copy_from_slice(bytes);
        self.full = true;
        true
    }

    /// A complete read by the master; rejected if disabled, empty or of another length.
    pub(super) fn read(&mut self, out: &mut [u8]) -> bool {
        if !self.full || self.length() != Some(out.len()) {
            return false;
        }
        out.copy_from_slice(&self.data[..out.len()]);
        self.full = false;
        true
    }

    /// The image in the memory, empty if the sync manager is disabled.
    pub(super) fn image(&self) -> &[u8] {
        self.data.get(..self.length().unwrap_or(0)).unwrap_or_default()
    }

    pub(super) fn memory(&self) -> &[u8] {
        &self.data
    }

    /// The firmware copies bytes to an offset of the memory; bytes outside are dropped.
    pub(super) fn store_at(&mut self, offset: usize, bytes: &[u8]) {
        if let Some(to) = self.data.get_mut(offset..offset + bytes.len()) {
            to.copy_from_slice(bytes);
        }
    }

    pub(super) fn publish(&mut self, image: &[u8]) {
        self.store_at(0, image);
        self.full = true;
    }
}

#[derive(Clone, Debug)]
pub(super) struct SyncManagers {
    mailboxes: [Option<SyncManagerConfig>; 2],
    /// SM2.
    pub(super) outputs: SingleBuffer,
    /// SM3.
    pub(super) inputs: SingleBuffer,
    /// The master has read a part of SM3.
    pub(super) is_reading_inputs: bool,
    /// A service found that; its image is published after the read.
    is_publish_due: bool,
    pub(super) mailbox_stops: u32,
    pub(super) process_data_stops: u32,
}

impl SyncManagers {
    pub(super) fn new() -> Self {
        Self {
            mailboxes: [None; 2],
            outputs: SingleBuffer::new(),
            inputs: SingleBuffer::new(),
            is_reading_inputs: false,
            is_publish_due: false,
            mailbox_stops: 0,
            process_data_stops: 0,
        }
    }

    pub(super) fn reset(&mut self) {
        self.mailboxes = [None; 2];
        self.outputs.clear();
        self.inputs.clear();
        self.end_partial_read();
    }

    pub(super) fn config(&self, sm: u8) -> Option<SyncManagerConfig> {
        match sm {
            2 => self.outputs.config,
            3 => self.inputs.config,
            _ => self.mailboxes.get(usize::from(sm)).copied().flatten(),
        }
    }

    /// Configures a sync manager, 0 to 3; others are ignored. Returns whether SM2 or SM3 changed.
    pub(super) fn configure(&mut self, sm: u8, config: Option<SyncManagerConfig>) -> bool {
        let buffer = match sm {
            2 => &mut self.outputs,
            3 => &mut self.inputs,
            _ => {
                if let Some(mailbox) = self.mailboxes.get_mut(usize::from(sm)) {
                    *mailbox = config;
                }
                return false;
            }
        };
        if buffer.config == config {
            return false;
        }
        buffer.configure(config);
        true
    }

    /// Returns whether both mailboxes are single buffers of the right direction, long enough for the
    /// services, outside the registers, and do not overlap.
    pub(super) fn are_mailboxes_valid(&self) -> bool {
        let is_valid = |sm: Option<SyncManagerConfig>, written_by_master| {
            sm.is_some_and(|sm| {
                sm.is_single_buffer(written_by_master)
                    && sm.length >= SHORTEST_MAILBOX
                    && sm.start >= MEMORY_START
            })
        };
        let [to_slave, from_slave] = self.mailboxes;
        is_valid(to_slave, true) && is_valid(from_slave, false) && !overlap(to_slave, from_slave)
    }

    /// Checks SM2 and SM3 against the image sizes; the error is that of the first invalid one.
    pub(super) fn check_process_data(
        &self,
        output_bytes: usize,
        input_bytes: usize,
    ) -> Result<(), AlStatusCode> {
        let (outputs, inputs) = (self.outputs.config, self.inputs.config);
        if !is_valid(outputs, Direction::RxPdo, output_bytes) {
            return Err(AlStatusCode::OUTPUT_CONFIGURATION);
        }
        if !is_valid(inputs, Direction::TxPdo, input_bytes) {
            return Err(AlStatusCode::INPUT_CONFIGURATION);
        }
        Ok(())
    }

    pub(super) fn empty_process_data(&mut self) {
        self.outputs.empty();
        self.inputs.empty();
    }

    /// Process data stops: contents and partial accesses are void.
    pub(super) fn stop_process_data(&mut self) {
        self.empty_process_data();
        self.end_partial_read();
        self.process_data_stops = self.process_data_stops.wrapping_add(1);
    }

    fn end_partial_read(&mut self) {
        self.is_reading_inputs = false;
        self.is_publish_due = false;
    }

    /// A service has run. Whether it can publish its image now. If SM3 is being read, or is full
    /// and `waits_for_read`, the image follows the read.
    pub(super) fn can_publish(&mut self, waits_for_read: bool) -> bool {
        let is_full = self.inputs.is_full();
        self.is_publish_due = self.is_reading_inputs || (is_full && waits_for_read);
        !is_full
    }

    /// The master has read SM3 completely. Returns whether an image waits to be published.
    pub(super) fn finish_read(&mut self) -> bool {
        let is_publish_due = self.is_publish_due;
        self.inputs.empty();
        self.end_partial_read();
        is_publish_due
    }
}

/// Returns whether the firmware accepts this sync manager for an image of `bytes`: enabled, exact length,
/// start and control byte of the manual. The watchdog bit is the master's choice.
fn is_valid(config: Option<SyncManagerConfig>, direction: Direction, bytes: usize) -> bool {
    config.is_some_and(|sm| {
        bytes > 0
            && usize::from(sm.length) == bytes
            && sm.start == sync_manager_address(direction)
            && (sm.control ^ sync_manager_control(direction)) & !WATCHDOG_TRIGGER == 0
    })
}

fn overlap(a: Option<SyncManagerConfig>, b: Option<SyncManagerConfig>) -> bool {
    let (Some(a), Some(b)) = (a, b) else {
        return false;
    };
    let end = |sm: SyncManagerConfig| u32::from(sm.start) + u32::from(sm.length);
    u32::from(a.start) < end(b) && u32::from(b.start) < end(a)
}

#[cfg(test)]
mod tests {
    use super::super::config::MAILBOXES;
    use super::*;

    const OUTPUTS: SyncManagerConfig =
        SyncManagerConfig { start: 0x1100, length: 128, control: 0x66 };
    const INPUTS: SyncManagerConfig =
        SyncManagerConfig { start: 0x1D00, length: 128, control: 0x22 };

    fn configured() -> SyncManagers {
        let mut sms = SyncManagers::new();
        for (number, config) in (0..).zip(MAILBOXES) {
            assert!(!sms.configure(number, Some(config)));
        }
        assert!(sms.configure(2, Some(OUTPUTS)));
        assert!(sms.configure(3, Some(INPUTS)));
        sms
    }

    #[test]
    fn overlapping_mailboxes_are_invalid() {
        let mut sms = configured();
        assert!(sms.are_mailboxes_valid());
        let [first, _] = MAILBOXES;
        sms.configure(
            1,
            Some(SyncManagerConfig { start: first.start + 8, control: 0x22, ..first }),
        );
        assert!(!sms.are_mailboxes_valid());
    }

    #[test]
    fn process_data_must_match_the_image_sizes() {
        let mut sms = configured();
        assert_eq!(sms.check_process_data(128, 128), Ok(()));
        let (output, input) =
            (AlStatusCode::OUTPUT_CONFIGURATION, AlStatusCode::INPUT_CONFIGURATION);
        assert_eq!(sms.check_process_data(256, 128), Err(output));
        assert_eq!(sms.check_process_data(128, 0), Err(input));
        sms.configure(3, Some(SyncManagerConfig { start: 0x1108, ..INPUTS }));
        assert_eq!(sms.check_process_data(128, 128), Err(input));
    }

    #[test]
    fn buffer_accepts_one_write_until_it_is_empty() {
        let mut sms = configured();
        assert!(!sms.outputs.write(&[1; 64]));
        assert!(sms.outputs.write(&[1; 128]));
        assert!(!sms.outputs.write(&[2; 128]));
        assert_eq!(sms.outputs.image(), [1; 128]);
        sms.outputs.empty();
        assert!(sms.outputs.write(&[2; 128]));
    }

    #[test]
    fn image_found_during_a_partial_read_follows_it() {
        let mut sms = configured();
        sms.inputs.publish(&[3; 128]);
        sms.is_reading_inputs = true;
        assert!(!sms.can_publish(false));
        assert!(sms.finish_read());
        assert!(sms.can_publish(false));
        assert!(!sms.finish_read());
    }

    #[test]
    fn image_that_finds_the_buffer_full_follows_the_read() {
        for waits_for_read in [true, false] {
            let mut sms = configured();
            sms.inputs.publish(&[3; 128]);
            assert!(!sms.can_publish(waits_for_read));
            assert_eq!(sms.finish_read(), waits_for_read);
            assert!(!sms.finish_read());
        }
    }
}
