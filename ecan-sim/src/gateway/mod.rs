//! The firmware model of one ECAN-Lite gateway, behind its slave controller.
//!
//! A [`Gateway`] knows no Ethernet frames: a front (a simulated libethercat, or a slave
//! controller on the wire) gives it AL requests, mailbox transfers and complete sync manager
//! accesses, and the world connects its four channels to CAN buses. Time is the caller's, in
//! simulated nanoseconds, and must not run backwards. Equal calls with an equal seed give
//! equal results.
//!
//! What "a cycle" means for the budgets of 0x8021..0x8024 is an assumption of this model: one
//! data-path service per complete SM2 write, `service_delay_ns` behind it, and in SAFEOP one
//! more per `idle_service_ns`. A service parses the image, hands frames from the TX rings to
//! the controllers, drains the controllers into the RX caches, and builds the next TxPDO if
//! SM3 is empty. Nothing in it allocates.

mod al_state;
mod can_side;
mod channel;
mod channel_control;
mod configuration_image;
mod controller;
mod controller_side;
mod crc32;
mod cycle_performance;
mod dc_clock;
mod dictionary_values;
mod eeprom;
mod emergency;
mod filter;
mod firmware_package;
mod firmware_update;
mod flash;
mod flash_commands;
mod gateway_counters;
mod maintenance;
mod object_server;
mod profile_control;
mod readback;
mod receive_fifo;
mod receive_path;
mod register_service;
mod rx_pdo;
mod schedule;
mod service;
mod settings;
mod side_effects;
mod sync_manager;
mod transmit_path;
mod tx_pdo;

use ecan_protocol::config::{CrcTest, DataPathGlobal, DiagnosticTest, Sides};
use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::image::OptionFlags;
use ecan_protocol::mapping::{CHANNELS, Direction};

use crate::earliest::earliest;

use channel::Channel;
use channel_control::FilterLists;
use cycle_performance::CyclePerformance;
use dc_clock::DcClock;
use dictionary_values::DictionaryValues;
use eeprom::Eeprom;
use emergency::EmergencyQueue;
use firmware_update::FirmwareUpdate;
use flash::Flash;
use flash_commands::FlashJob;
use maintenance::Maintenance;
use profile_control::ProfileControl;
use rx_pdo::RxPdoParser;
use schedule::{PulseTrain, ScheduleQueue};
use sync_manager::SingleBuffer;
use transmit_path::ResultQueue;
use tx_pdo::TxPdoBuilder;

pub(crate) use emergency::Emergency;
pub use firmware_package::{FirmwarePackage, FirmwarePackageError};
pub use firmware_update::{FirmwareProgress, FirmwareUpdateError};
pub use gateway_counters::{GatewayCounters, ReceiveLosses, TransmitLosses};
pub(crate) use settings::MAILBOXES;
pub use settings::{GatewayFault, GatewayModelConfig, SmSettings, Sync0};

/// Watchdog time that the slave controller has after power-on, in nanoseconds.
const DEFAULT_WATCHDOG_NS: u64 = 100_000_000;
const NS_PER_MS: u64 = 1_000_000;

/// What the supply and the firmware's boot allow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Power {
    Off,
    Booting { until: u64 },
    On,
}

/// Faults that are still to strike.
#[derive(Debug, Default)]
struct PendingFaults {
    sdo_aborts: Vec<SdoAbort>,
    torn_images: u32,
    crc_errors: u32,
    mailbox_silent_until: u64,
    stalled_until: u64,
    flash_failures: u32,
}

impl PendingFaults {
    /// Whether the flash fails this time.
    fn take_flash_failure(&mut self) -> bool {
        let fails = self.flash_failures > 0;
        self.flash_failures = self.flash_failures.saturating_sub(1);
        fails
    }
}

#[derive(Clone, Copy, Debug)]
struct SdoAbort {
    index: u16,
    subindex: u8,
    code: u32,
    times: u32,
}

/// One simulated gateway.
#[derive(Debug)]
pub struct Gateway {
    settings: GatewayModelConfig,
    random: u64,
    now: u64,
    power: Power,
    boots: u32,
    booted_at: u64,
    /// When a reboot that was asked for happens.
    reboot_at: Option<u64>,
    // EtherCAT state machine and process data
    state: AlState,
    error: bool,
    status_code: AlStatusCode,
    /// Since when OP is requested and Sync0 awaited.
    awaiting_sync_since: Option<u64>,
    mailboxes: [Option<SmSettings>; 2],
    outputs: SingleBuffer,
    inputs: SingleBuffer,
    /// The master has begun to read SM3, in parts.
    are_inputs_being_read: bool,
    /// A service found it so: its image is published when the master has read the one before.
    is_publish_due: bool,
    /// How often mailboxes and process data were stopped: what lies in buffers is void then.
    mailbox_stops: u32,
    process_data_stops: u32,
    watchdog_ns: u64,
    watchdog_expirations: u32,
    /// It has run out, and nothing was written since.
    is_watchdog_expired: bool,
    last_outputs: u64,
    clock: DcClock,
    sync0: Option<Sync0>,
    pulses: Option<PulseTrain>,
    // services
    service_due: Option<u64>,
    outputs_at: u64,
    idle_service_at: u64,
    last_service: u64,
    // firmware
    values: DictionaryValues,
    filters: [FilterLists; CHANNELS],
    profiles: [ProfileControl; 2],
    data_path: DataPathGlobal,
    test: DiagnosticTest,
    pin_rotation: u8,
    /// Rotations so far, for the station generations.
    rotations: u32,
    maintenance: Maintenance,
    flash_job: Option<FlashJob>,
    performance: CyclePerformance,
    channels: [Channel; CHANNELS],
    parser: RxPdoParser,
    builder: TxPdoBuilder,
    results: ResultQueue,
    schedule: ScheduleQueue,
    emergencies: EmergencyQueue,
    // what survives power loss
    flash: Flash,
    eeprom: Eeprom,
    firmware: FirmwareUpdate,
    // beside the firmware
    acts: u64,
    faults: PendingFaults,
    counters: GatewayCounters,
}

impl Gateway {
    /// A gateway without supply. `seed` decides whatever is left to chance
    /// ([`GatewayModelConfig::service_jitter_ns`]).
    #[must_use]
    pub fn new(settings: GatewayModelConfig, seed: u64) -> Self {
        let GatewayModelConfig { tx_pressure_percent, release_jitter_ns, firmware, .. } = settings;
        let clock = DcClock::new(settings.clock_drift_ppb);
        let mut gateway = Self {
            settings,
            random: seed ^ 0x9E37_79B9_7F4A_7C15,
            now: 0,
            power: Power::Off,
            boots: 0,
            booted_at: 0,
            reboot_at: None,
            state: AlState::Init,
            error: false,
            status_code: AlStatusCode::OK,
            awaiting_sync_since: None,
            mailboxes: [None; 2],
            outputs: SingleBuffer::new(),
            inputs: SingleBuffer::new(),
            are_inputs_being_read: false,
            is_publish_due: false,
            mailbox_stops: 0,
            process_data_stops: 0,
            watchdog_ns: DEFAULT_WATCHDOG_NS,
            watchdog_expirations: 0,
            is_watchdog_expired: false,
            last_outputs: 0,
            clock,
            sync0: None,
            pulses: None,
            service_due: None,
            outputs_at: 0,
            idle_service_at: 0,
            last_service: 0,
            values: DictionaryValues::new(),
            filters: std::array::from_fn(|_| FilterLists::new()),
            profiles: Direction::ALL.map(ProfileControl::new),
            data_path: DataPathGlobal::default(),
            test: DiagnosticTest::OFF,
            pin_rotation: 0,
            rotations: 0,
            maintenance: Maintenance::default(),
            flash_job: None,
            performance: CyclePerformance::default(),
            channels: std::array::from_fn(|_| Channel::new(tx_pressure_percent)),
            parser: RxPdoParser::new(),
            builder: TxPdoBuilder::new(),
            results: ResultQueue::new(),
            schedule: ScheduleQueue::new(release_jitter_ns, seed),
            emergencies: EmergencyQueue::new(),
            flash: Flash::default(),
            eeprom: Eeprom::default(),
            firmware: FirmwareUpdate::new(firmware),
            acts: 0,
            faults: PendingFaults::default(),
            counters: GatewayCounters::default(),
        };
        gateway.forget_everything();
        gateway
    }

    /// Switches the supply. Off: nothing answers and all volatile state is gone. On: the
    /// firmware boots for [`GatewayModelConfig::boot_ms`] and then answers in INIT. Switching on
    /// what is on does nothing.
    pub fn power(&mut self, now: u64, on: bool) {
        self.advance(now);
        match (on, self.power) {
            (true, Power::Off) => self.boot(),
            (false, _) => {
                self.forget_everything();
                self.power = Power::Off;
            }
            (true, _) => {}
        }
    }

    /// Whether the slave controller answers EtherCAT frames.
    #[must_use]
    pub fn is_responding(&self) -> bool {
        self.power == Power::On
    }

    /// Whether the mailbox answers: booted, not in INIT, and not silenced by a fault.
    #[must_use]
    pub fn mailbox_answers(&self, now: u64) -> bool {
        self.is_responding() && self.state.has_mailbox() && now >= self.faults.mailbox_silent_until
    }

    /// The settings that the gateway was made with.
    #[must_use]
    pub fn settings(&self) -> &GatewayModelConfig {
        &self.settings
    }

    /// What really happened so far.
    #[must_use]
    pub fn counters(&self) -> &GatewayCounters {
        &self.counters
    }

    /// Puts a fault into the gateway.
    pub fn inject(&mut self, now: u64, fault: GatewayFault) {
        self.advance(now);
        let until = |ms: u32| now + u64::from(ms) * NS_PER_MS;
        match fault {
            GatewayFault::SdoAbort { index, subindex, code, times } => {
                self.faults.sdo_aborts.push(SdoAbort { index, subindex, code, times })
            }
            GatewayFault::TornTxPdo { images } => {
                self.faults.torn_images = self.faults.torn_images.saturating_add(images)
            }
            GatewayFault::CrcErrorTxPdo { images } => {
                self.faults.crc_errors = self.faults.crc_errors.saturating_add(images)
            }
            GatewayFault::AlError { code } => self.fall_back(AlStatusCode(code)),
            GatewayFault::ClockJump { ns } => self.change_clock(now, |clock| clock.jump(ns, now)),
            GatewayFault::MailboxSilent { ms } => self.faults.mailbox_silent_until = until(ms),
            GatewayFault::ServiceStall { ms } => self.faults.stalled_until = until(ms),
            GatewayFault::FlashFailure { times } => {
                self.faults.flash_failures = self.faults.flash_failures.saturating_add(times);
            }
        }
    }

    // Time

    /// The next instant at which the gateway does something by itself.
    #[must_use]
    pub fn next_event(&self) -> Option<u64> {
        match self.power {
            Power::Off => None,
            Power::Booting { until } => Some(until),
            Power::On => earliest([
                self.service_time(),
                self.idle_service_time(),
                self.watchdog_expiry(),
                self.missed_sync_expiry(),
                self.awaited_sync(),
                self.release_time(),
                self.maintenance.mode_ends(),
                self.flash_job.as_ref().map(FlashJob::done_at),
                self.firmware.reset_time(),
                self.reboot_at,
            ]),
        }
    }

    /// Lets everything happen that is due up to `now`, each at its time.
    pub fn advance(&mut self, now: u64) {
        while let Some(due) = self.next_event().filter(|&due| due <= now) {
            self.now = self.now.max(due);
            self.act();
        }
        self.now = self.now.max(now);
    }

    /// Counts what the gateway did by itself, so that its owner sees whether it did anything.
    pub(crate) fn acts(&self) -> u64 {
        self.acts
    }

    /// Does the first of what is due at the present instant.
    fn act(&mut self) {
        self.acts += 1;
        let now = self.now;
        let due = |time: Option<u64>| time.is_some_and(|time| time <= now);
        if let Power::Booting { until } = self.power {
            if until <= now {
                self.start_firmware();
            }
        } else if due(self.release_time()) {
            self.release_scheduled();
        } else if due(self.service_time()) {
            self.service_due = None;
            self.serve();
        } else if due(self.idle_service_time()) {
            self.idle_service_at = now + self.settings.idle_service_ns.max(1);
            self.serve();
        } else if due(self.awaited_sync()) {
            self.finish_awaiting_sync();
        } else if due(self.watchdog_expiry()) {
            self.watchdog_expirations += 1;
            self.is_watchdog_expired = true;
            self.fall_back(AlStatusCode::SM_WATCHDOG);
        } else if due(self.missed_sync_expiry()) {
            self.fall_back(AlStatusCode::FATAL_SYNC);
        } else if due(self.flash_job.as_ref().map(FlashJob::done_at)) {
            self.finish_flash_job();
        } else if due(self.reboot_at) || due(self.firmware.reset_time()) {
            self.boot();
        } else {
            self.maintenance.expire(now);
        }
    }

    fn boot(&mut self) {
        self.forget_everything();
        self.boots = self.boots.wrapping_add(1);
        self.booted_at = self.now;
        self.power =
            Power::Booting { until: self.now + u64::from(self.settings.boot_ms) * NS_PER_MS };
    }

    /// The boot is over: the marked application runs, with what was saved.
    fn start_firmware(&mut self) {
        self.power = Power::On;
        self.firmware.start();
        self.eeprom.start();
        self.load_at_start();
    }

    /// Loses all volatile state, as without supply.
    fn forget_everything(&mut self) {
        let Self { values, filters, channels, counters, .. } = self;
        values.reset();
        values.set(
            ecan_protocol::mapping::assignment_index(Direction::RxPdo),
            0,
            u32::from(ecan_protocol::mapping::MAX_MULTIPLIER),
        );
        values.set(
            ecan_protocol::mapping::assignment_index(Direction::TxPdo),
            0,
            u32::from(ecan_protocol::mapping::MAX_MULTIPLIER),
        );
        for lists in filters.iter_mut() {
            lists.clear();
        }
        for channel in channels.iter_mut() {
            channel.power_off(counters);
        }
        counters.transmit_losses.stale += self.schedule.flush() as u64;
        self.state = AlState::Init;
        self.error = false;
        self.status_code = AlStatusCode::OK;
        self.reboot_at = None;
        self.awaiting_sync_since = None;
        self.mailboxes = [None; 2];
        self.outputs.clear();
        self.inputs.clear();
        (self.are_inputs_being_read, self.is_publish_due) = (false, false);
        self.watchdog_ns = DEFAULT_WATCHDOG_NS;
        self.watchdog_expirations = 0;
        self.is_watchdog_expired = false;
        self.clock = DcClock::new(self.settings.clock_drift_ppb);
        self.sync0 = None;
        self.pulses = None;
        self.service_due = None;
        self.profiles = Direction::ALL.map(ProfileControl::new);
        self.data_path = DataPathGlobal::default();
        self.test = DiagnosticTest::OFF;
        self.pin_rotation = 0;
        self.rotations = self.rotations.wrapping_add(1);
        self.maintenance = Maintenance::default();
        self.flash_job = None;
        self.firmware.stop();
        self.performance = CyclePerformance::default();
        self.parser.reset_session();
        self.parser.configure(None, true);
        self.builder = TxPdoBuilder::new();
        self.results.clear();
        self.emergencies.clear();
    }

    /// A pseudo random number below `bound` (xorshift), 0 for a bound of 0.
    fn draw(&mut self, bound: u64) -> u64 {
        if bound == 0 {
            return 0;
        }
        let mut x = self.random.max(1);
        x ^= x << 13;
        x ^= x >> 7;
        x ^= x << 17;
        self.random = x;
        x % bound
    }

    // What the profile and the test policies of 0x8030 make of the options

    fn profile(&self, direction: Direction) -> &ProfileControl {
        let [tx, rx] = &self.profiles;
        match direction {
            Direction::TxPdo => tx,
            Direction::RxPdo => rx,
        }
    }

    fn profile_mut(&mut self, direction: Direction) -> &mut ProfileControl {
        let [tx, rx] = &mut self.profiles;
        match direction {
            Direction::TxPdo => tx,
            Direction::RxPdo => rx,
        }
    }

    fn has_option(&self, direction: Direction, option: OptionFlags) -> bool {
        self.profile(direction).active().is_some_and(|profile| profile.options.contains(option))
    }

    /// Whether images of a direction carry a CRC.
    fn uses_crc(&self, direction: Direction) -> bool {
        match self.test.crc {
            CrcTest::Follow => !self.has_option(direction, OptionFlags::NO_CRC16),
            CrcTest::Force => true,
            CrcTest::Suppress => false,
        }
    }

    fn is_payload_only(&self, direction: Direction) -> bool {
        self.has_option(direction, OptionFlags::PAYLOAD_ONLY)
            || concerns(self.test.payload_only, direction)
    }

    /// Whether the CAN side is cut off in a direction.
    fn is_app_bypassed(&self, direction: Direction) -> bool {
        self.has_option(direction, OptionFlags::APP_BYPASS)
            || concerns(self.test.app_link_bypass, direction)
    }

    /// Brings parser and builder in line with profiles and test policies.
    fn configure_codecs(&mut self) {
        let tx = self.profile(Direction::TxPdo).active();
        let rx = self.profile(Direction::RxPdo).active();
        let tx_crc = self.uses_crc(Direction::TxPdo);
        let rx_crc = self.uses_crc(Direction::RxPdo);
        let payload_only = self.is_payload_only(Direction::TxPdo);
        self.builder.configure(tx, tx_crc, payload_only);
        self.parser.configure(rx, rx_crc);
    }
}

/// Whether a test policy concerns a direction.
fn concerns(sides: Sides, direction: Direction) -> bool {
    match sides {
        Sides::Off => false,
        Sides::Tx => direction == Direction::TxPdo,
        Sides::Rx => direction == Direction::RxPdo,
        Sides::Both => true,
    }
}
