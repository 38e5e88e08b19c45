//! What a simulated gateway is built from, and what may be done to it from outside.

/// Identity and timing of one simulated gateway.
///
/// The manual gives no vendor id, no product code and no time of the firmware's
/// service loop; the defaults are assumptions that a scenario may replace.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GatewayModelConfig {
    /// Serial number, 0xF000:7 (low half) and :8 (high half).
    pub serial: u64,
    /// Hardware revision, 0xF000:4.
    pub hardware_revision: u32,
    /// Firmware version at manufacture, 0xF000:5 and :6; a firmware update brings another.
    pub firmware: (u16, u16),
    /// Vendor id of the SII and of 0x1018:1.
    pub vendor_id: u32,
    /// Product code of the SII and of 0x1018:2.
    pub product_code: u32,
    /// Revision number of the SII and of 0x1018:3.
    pub revision: u32,
    /// Milliseconds from power-on or reboot until the slave answers in INIT.
    pub boot_ms: u32,
    /// Nanoseconds from a complete SM2 write to the data-path service that handles it.
    pub service_delay_ns: u64,
    /// Upper bound of a pseudo random addition to `service_delay_ns`, drawn from the
    /// gateway's seed; 0 makes every service take exactly `service_delay_ns`.
    pub service_jitter_ns: u64,
    /// Upper bound of a pseudo random delay of the timer that releases scheduled frames,
    /// in nanoseconds. Frames of one phase share it and keep their order.
    pub release_jitter_ns: u64,
    /// Nanoseconds between two services in SAFEOP, where no SM2 write paces them.
    pub idle_service_ns: u64,
    /// How long a transition to OP waits for the first Sync0 pulse before it fails with
    /// AL status 0x002D, in nanoseconds.
    pub sync_wait_ns: u64,
    /// Sync0 pulses in a row without an SM2 write that drop the slave out of OP with AL
    /// status 0x002C; 0 leaves that to the watchdog alone.
    pub missed_sync_limit: u32,
    /// How much faster than simulated time the oscillator of the distributed clock runs, in parts
    /// per billion: 50 000 is 50 ppm.
    pub clock_drift_ppb: i32,
    /// Share of its TX ring, in percent, from which on a channel shows `tx_pressure`; a full
    /// transmit FIFO of the CAN controller shows it as well. With 100 only a full ring does.
    pub tx_pressure_percent: u8,
    /// Nanoseconds from a complete write of the mailbox (SM0) until the firmware's answer is
    /// ready for SM1. The manual gives no time. A front that knows no bytes of the mailbox, as the
    /// simulated libethercat, has a pace of its own.
    pub mailbox_delay_ns: u64,
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
            service_delay_ns: 30_000,
            service_jitter_ns: 0,
            release_jitter_ns: 0,
            idle_service_ns: 1_000_000,
            sync_wait_ns: 2_000_000_000,
            missed_sync_limit: 0,
            clock_drift_ppb: 0,
            tx_pressure_percent: 50,
            mailbox_delay_ns: 200_000,
        }
    }
}

/// One sync manager as the master has set it up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SmSettings {
    /// Physical start address in the slave controller's memory.
    pub start: u16,
    /// Length in bytes.
    pub length: u16,
    /// Control byte: bits 0..1 buffer mode (2 = single buffer), bits 2..3 direction
    /// (1 = the master writes), bit 6 watchdog trigger. The manual's values are 0x66
    /// for SM2 and 0x22 for SM3 (manual 5.3).
    pub control: u8,
}

/// Bits of the control byte: buffer mode with the value of a single buffer, direction with the value
/// of "the master writes".
const CONTROL_MODE: u8 = 0x03;
const CONTROL_SINGLE: u8 = 0x02;
const CONTROL_DIRECTION: u8 = 0x0C;
const CONTROL_WRITTEN_BY_MASTER: u8 = 0x04;

impl SmSettings {
    /// The buffer is full or empty, and not three buffers in turn.
    pub(crate) fn is_single(self) -> bool {
        self.control & CONTROL_MODE == CONTROL_SINGLE
    }

    pub(crate) fn is_written_by_master(self) -> bool {
        self.control & CONTROL_DIRECTION == CONTROL_WRITTEN_BY_MASTER
    }

    /// Whether it is a single buffer of this direction.
    pub(crate) fn is_single_buffer(self, written_by_master: bool) -> bool {
        // There are two more direction values, which mean nothing.
        let is_read = self.control & CONTROL_DIRECTION == 0;
        self.is_single() && if written_by_master { self.is_written_by_master() } else { is_read }
    }
}

/// The mailboxes, SM0 and SM1: what is left below the process data (manual 5.3).
pub(crate) const MAILBOXES: [SmSettings; 2] = [
    SmSettings { start: 0x1000, length: 0x80, control: 0x26 },
    SmSettings { start: 0x1080, length: 0x80, control: 0x22 },
];

/// Distributed clock pulses as the master has set them up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sync0 {
    /// Time of the first pulse without the shift, in nanoseconds of the slave's system time,
    /// which is simulated time until the master writes it.
    pub start_ns: u64,
    /// Distance of two pulses in nanoseconds; 0 counts as one nanosecond.
    pub cycle_ns: u32,
    /// Shift of all pulses against `start_ns`, in nanoseconds.
    pub shift_ns: i32,
}

/// A fault that a scenario or a test puts into a gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GatewayFault {
    /// The next `times` transfers of this object, upload or download, are aborted.
    SdoAbort {
        /// Object index.
        index: u16,
        /// Subindex.
        subindex: u8,
        /// Abort code that the master gets.
        code: u32,
        /// Number of transfers concerned.
        times: u32,
    },
    /// The next `images` TxPDO images are published with `seq_end` one behind
    /// `seq_begin`, as if read in the middle of an update.
    TornTxPdo {
        /// Number of images concerned.
        images: u32,
    },
    /// The next `images` TxPDO images carry a wrong payload CRC.
    CrcErrorTxPdo {
        /// Number of images concerned.
        images: u32,
    },
    /// The slave falls back to SAFEOP (or stays where it is, below) and shows this AL
    /// status code with the error indication.
    AlError {
        /// AL status code.
        code: u16,
    },
    /// The distributed clock of the slave jumps.
    ClockJump {
        /// By so many nanoseconds.
        ns: i64,
    },
    /// The mailbox does not answer for so many milliseconds.
    MailboxSilent {
        /// Duration in milliseconds from now.
        ms: u32,
    },
    /// The firmware's data-path services stand still for so many milliseconds, as when
    /// the main loop is blocked: images are neither parsed nor published.
    ServiceStall {
        /// Duration in milliseconds from now.
        ms: u32,
    },
    /// The next erasures or writes of the flash fail: of the saved configuration, or of firmware.
    FlashFailure {
        /// Number of operations concerned.
        times: u32,
    },
}
