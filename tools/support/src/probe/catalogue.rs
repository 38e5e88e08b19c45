//! The assumptions about a gateway: those that an experiment decides, in the order of the experiments, and
//! those without one.

use serde::Serialize;

use super::experiments::{
    channel_config, images, loopback, objects, schedule, service_time, startup, wired,
};
use super::outcome::{Interruption, Outcome, Result, Stage, Verdict, unavailable};
use super::run::Probe;
use super::session::Session;

/// Experiment that decides one assumption.
#[derive(Clone, Copy)]
pub struct Experiment {
    /// Rows of docs/ASSUMPTIONS.md.
    pub rows: &'static [&'static str],
    /// Switch of the simulator that the rows name; empty without one.
    pub key: &'static str,
    /// Stage.
    pub stage: Stage,
    /// The assumption.
    pub assumption: &'static str,
    pub(crate) run: fn(&mut Probe) -> Result<Outcome>,
}

impl std::fmt::Debug for Experiment {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Experiment").field("rows", &self.rows).field("key", &self.key).finish()
    }
}

/// Assumption about the device that the probe cannot decide.
#[derive(Clone, Copy, Debug)]
pub struct Undecidable {
    /// Rows of docs/ASSUMPTIONS.md.
    pub rows: &'static [&'static str],
    /// Switch of the simulator; empty without one.
    pub key: &'static str,
    /// The assumption.
    pub assumption: &'static str,
    /// Reason.
    pub reason: &'static str,
}

impl Undecidable {
    pub(crate) fn finding(&self) -> Finding {
        let Self { rows, key, assumption, reason } = *self;
        let verdict = Verdict::Undecided;
        let detail = reason.to_owned();
        Finding { rows, key, stage: None, assumption, verdict, detail, alternative: None }
    }
}

/// Decision about one assumption.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Rows of docs/ASSUMPTIONS.md.
    pub rows: &'static [&'static str],
    /// Switch of the simulator for these rows; empty without one.
    pub key: &'static str,
    /// Stage of the experiment; `None` if no experiment exists.
    pub stage: Option<Stage>,
    /// The assumption.
    pub assumption: &'static str,
    /// The decision.
    pub verdict: Verdict,
    /// What was measured, or why nothing was decided.
    pub detail: String,
    /// The behaviour found, in the form of a scenario file, if it differs.
    pub alternative: Option<String>,
}

impl Finding {
    pub(crate) fn new(experiment: &Experiment, outcome: Outcome) -> Self {
        let Experiment { rows, key, stage, assumption, .. } = *experiment;
        let Outcome { verdict, detail, alternative } = outcome;
        let stage = Some(stage);
        Self { rows, key, stage, assumption, verdict, detail, alternative }
    }
}

/// Declares the experiments: stage, key, rows and function, then the assumption.
macro_rules! experiments {
    ($($stage:ident $key:literal $rows:tt $run:path: $assumption:literal;)*) => {
        const EXPERIMENTS: &[Experiment] = &[$(Experiment {
            rows: &$rows,
            key: $key,
            stage: Stage::$stage,
            assumption: $assumption,
            run: $run,
        }),*];
    };
}

experiments! {
    Reading "vendor_id" ["H1", "S1"] objects::vendor:
        "vendor ID 0x00004543 (invented: the manual gives none)";
    Reading "product_code" ["H1", "S1"] objects::product:
        "product code 0x4C495445 (invented: the manual gives none)";
    Reading "serial" ["H19"] objects::serial: "the serial number identifies the gateway";
    Reading "missing_entries" ["H1", "H42"] objects::missing_entries:
        "the gateway has every entry of this version of the manual";
    Reading "missing_abort" ["H42"] objects::missing_abort:
        "an access to a missing entry aborts with 0x06090011";
    Reading "mapped_subindex" ["H3", "S5"] objects::mapped_subindex:
        "the PDOs map subindex 1 of the 16-byte objects";
    PreOp "reboot_delay_ms" ["S37"] startup::restart_answer:
        "the restart command is answered, and the restart follows";
    PreOp "boot_ms" ["S1"] startup::boot_time: "the gateway responds 0.2 s after a restart";
    PreOp "assigned_at_start" ["S3"] startup::assignment_at_start:
        "24 chunks per direction are assigned after a restart";
    PreOp "channels_at_start" ["S8"] startup::channels_off: "channels are off after a restart";
    PreOp "" ["H40"] startup::counters_at_start:
        "a channel that was not applied since the restart has counted nothing";
    PreOp "" ["H16"] startup::volatile_setting: "a volatile setting is lost with a restart";
    PreOp "filter_index" ["H39"] startup::filter_index:
        "the index of a filter editing window is lost with a restart";
    PreOp "" ["H29", "S19"] channel_config::core: "the CAN controller has the registers of the M_CAN core";
    PreOp "node_modes" ["H9"] channel_config::node_modes:
        "node mode 1 is listen-only, 2 internal loopback, 3 external loopback";
    PreOp "bit_timing" ["H43"] channel_config::timing_choice:
        "the firmware chooses the sample point closest to the middle of the window";
    PreOp "manual_timing" ["H10"] channel_config::manual_timing:
        "manual bit timing values are physical values, not register values";
    PreOp "message_ram_bytes" ["H13"] channel_config::message_ram:
        "the Message RAM of a channel has 8192 bytes";
    PreOp "tdc_prescaler" ["H11"] channel_config::tdc_prescaler: "TDC needs a data prescaler of 1 or 2";
    PreOp "rejected_budget" ["S20"] channel_config::rejected_values:
        "an unknown budget policy gives status 10, a test policy without key aborts with 0x06040043";
    PreOp "rotation_effect" ["H47"] channel_config::rotation_effect:
        "a pin rotation takes effect when it is written";
    PreOp "bit_rates" ["H48"] channel_config::bit_rates:
        "a nominal bit rate above 1 Mbit/s is rejected, a slower data phase is accepted";
    PreOp "empty_mask" ["H49"] channel_config::empty_mask:
        "a PDO profile with channel mask 0 gives status 3";
    PreOp "inverted_budget" ["H50"] channel_config::inverted_budget:
        "a data-path budget with a minimum above its maximum gives status 1";
    PreOp "compat_bits" ["H51"] channel_config::compat_bits:
        "bits 2 to 15 of the compat mode are accepted";
    PreOp "protected_register" ["S49"] channel_config::protected_register:
        "a write to a protected register without INIT and CCE returns OK and has no effect";
    PreOp "sdo_information" ["S41"] objects::sdo_information:
        "SDO information describes the object dictionary";
    PreOp "complete_access" ["S27"] objects::complete_access: "SDO Complete Access is not supported";
    PreOp "maintenance_mode" ["H27", "S43"] objects::maintenance_mode:
        "validating a firmware image needs engineering mode";
    PreOp "maintenance_status" ["H27", "S44"] objects::maintenance_status:
        "maintenance status 4 is an invalid image";
    Op "apply_at_safeop" ["S4"] startup::apply_at_safeop:
        "SAFEOP applies a requested profile that was never applied";
    Op "assignment_rewritten" ["H41"] startup::assignment_rewritten:
        "a profile stays valid when the master writes its PDO assignment again";
    Op "safeop_inputs" ["S7"] startup::safeop_inputs: "the gateway publishes TxPDO images in SAFEOP";
    Op "safeop_outputs" ["H8", "S7"] startup::safeop_outputs: "the gateway empties SM2 in SAFEOP";
    Op "mailbox_delay_us" ["S23", "S38"] objects::mailbox_delay: "an SDO response is ready within 2 ms";
    Op "layout_crc" ["H4", "S2"] images::layout_crc:
        "the layout CRC is the CRC-32 of object, image size and profile word";
    Op "sequence_readback" ["H35"] images::sequence: "0x8011:13 is the sequence of the last RxPDO image";
    Op "repeated_image" ["H5"] images::repeated_image: "a repeated RxPDO image has no effect";
    Op "profile_errors" ["H20"] images::profile_errors: "the apply status shows 7 after a faulty image";
    Op "pdo_errors" ["S9"] images::error_numbers:
        "PDO errors: other layout 12, unequal sequences 14, bad CRC 15";
    Op "" ["S10"] images::channel_outside_mask: "a frame of a channel outside the mask is PDO error 6";
    Op "" ["S12"] images::schedule_without_sync0: "a scheduled frame without Sync0 is PDO error 16";
    Op "txpdo_numbering" ["H37"] images::numbering: "TxPDO images are numbered from 1 after a session reset";
    Op "service_period_us" ["S6"] service_time::service_period:
        "a service follows each SM2 write, it does not run freely";
    Op "service_delay_us" ["S6"] service_time::service_delay: "the service reads SM2 30 us after the write";
    Op "service_jitter_us" ["S6"] service_time::service_jitter: "the delay of the service is constant";
    Op "" ["S34"] objects::controller:
        "the slave controller has 8 FMMUs, 8 sync managers and 8 KiB of memory";
    Op "" ["H36"] objects::al_control:
        "a write to AL control takes the gateway out of OP, and the master configures it again";
    Op "assign_activate" ["H2"] objects::sync0: "DC AssignActivate 0x0300 starts Sync0";
    Op "watchdog" ["H34", "S21"] objects::watchdog:
        "the process data watchdog counts in units of 100 us, and ends OP with AL status 0x001B";
    Op "emergencies" ["S42"] objects::emergencies: "a CoE emergency with code 0x8130 reports the watchdog";
    Op "sync0_window" ["H44", "S55"] service_time::sync0_window:
        "outputs that arrive from 50 us before to 20 us after a Sync0 pulse are missed";
    Op "sync0_window" ["H44", "S55"] service_time::loss_of_op:
        "OP ends with AL status 0x1A after ten missed outputs in a row";
    Loopback "tx_pending" ["H22"] loopback::tx_pending: "tx_pending includes the frame in transmission";
    Loopback "tx_pressure_percent" ["H6", "S26"] loopback::tx_pressure:
        "tx_pressure shows before the transmit queue is full";
    Loopback "tx_results" ["H17", "S11"] loopback::tx_results:
        "each frame gets a TX_RESULT with the sequence of its image and its index";
    Loopback "unsendable_result" ["S10"] loopback::channel_off:
        "a frame of a channel that is off gets TX_RESULT 3";
    Loopback "channel_apply_in_op" ["H38"] loopback::apply_in_op: "a channel takes a new configuration in OP";
    Loopback "rx_pending" ["H21"] loopback::rx_pending: "rx_pending includes the frames of the same image";
    Loopback "rx_drain" ["S15"] loopback::rx_drain:
        "the RX drain budget limits the frames from the controller into the cache";
    Loopback "rx_budget" ["H7"] loopback::one_channel: "one channel may fill an RxPDO image";
    Loopback "critical_frames" ["S17"] loopback::critical_frames:
        "heartbeats are critical frames, SYNC is not";
    Loopback "" ["H18"] loopback::no_timestamps: "frames of TxPDO profile 0 carry no timestamp";
    Loopback "delta16_unit" ["H14", "S14"] loopback::timestamps: "delta16 timestamps count microseconds";
    Loopback "late_result" ["H23", "S11"] schedule::late_result:
        "a scheduled frame that is dropped as late gets no TX_RESULT";
    Loopback "scheduled_results" ["H23", "S11"] schedule::result_count:
        "a scheduled frame gets one TX_RESULT";
    Loopback "" ["H24"] schedule::firmware_time:
        "the firmware needs at most 50 us from the image to the Sync0 pulse";
    Loopback "scheduled_pulse" ["H24", "S12"] schedule::pulse:
        "a scheduled frame counts from the first Sync0 pulse after its image";
    Loopback "phase_unit" ["H25"] schedule::phase_readback:
        "0x9011:04 and :05 are distances from a Sync0 pulse to the next image in CPU cycles";
    Loopback "release_jitter_us" ["S30"] schedule::release_jitter:
        "a scheduled frame leaves exactly at its phase";
    Loopback "schedule_depth" ["H26", "S12"] schedule::depth: "the schedule holds 64 frames";
    Wired "" ["H9"] wired::external_loopback: "node mode 0 takes part in the bus, 3 is external loopback";
    Wired "bit_timing" ["H43"] wired::sample_point_by_errors:
        "the chosen sample point, by the error counters of two channels, is that of the middle";
    Wired "transceiver_ns" ["S58"] wired::transceiver_delay:
        "the CAN transceivers need 150 ns from transmit to receive pin";
}

/// Every experiment, in the order in which they run.
pub fn experiments() -> impl Iterator<Item = &'static Experiment> {
    EXPERIMENTS.iter()
}

/// Declares the assumptions without an experiment: rows, key and assumption, then the reason.
macro_rules! undecidable {
    ($($rows:tt $key:literal $assumption:literal $reason:literal;)*) => {
        /// Every assumption without an experiment.
        pub const UNDECIDABLE: &[Undecidable] = &[$(Undecidable {
            rows: &$rows,
            key: $key,
            assumption: $assumption,
            reason: $reason,
        }),*];
    };
}

undecidable! {
    ["S50"] "publishes_after_read" "a TxPDO image that finds SM3 full is published by the next service"
        "the master does not let a program choose the distance between LWR and LRD";
    ["H27", "S43"] "" "which other maintenance commands need engineering or factory mode"
        "a command that is accepted against the assumption would write the Flash";
    ["H28", "S47", "S48"] "" "format of firmware packages, FoE error numbers and texts"
        "needs a firmware file and writes the Flash";
    ["H31"] "rotation_direction" "the connector of a channel is (channel + rotation) mod 4"
        "shows only at the connectors";
    ["H32"] "" "only a restart takes a channel off its bus or deactivates a profile"
        "the manual names no command that could be tried";
    ["H45"] "" "no TX_RESULT of a channel that the TxPDO does not carry"
        "the experiments use the same channels in both directions";
    ["H53"] "" "a TX_RESULT in an RxPDO is PDO error 4" "the SDK sends none";
    ["H54"] "" "no D64 packet in an RxPDO" "a choice of the host, which no device contradicts";
    ["S13"] "" "the balanced budget reserves 16 bytes per channel and lends what is unused"
        "no experiment fills an image from several channels";
    ["S16"] "bus_off_wait" "automatic bus-off recovery waits for the backoff base cycles"
        "needs a bus-off, which the probe does not cause";
    ["S18"] "" "bits of 0x9000:12, 0x902x:15 and :16, 0x8030:09"
        "the events are not caused by the probe";
    ["S21"] "" "AL status 0x2D after 2 s without a Sync0 pulse"
        "the master does not let a program stop Sync0";
    ["S31"] "" "control of the slave's clock"
        "the master corrects the clock in each cycle";
    ["S35"] "" "contents of the SII"
        "the library does not return them; `ecan doctor` reads them with IgH's tool";
    ["S36"] "" "a frame needs 600 ns from one slave to the next"
        "needs a second slave with distributed clocks";
    ["S39", "S54"] "" "mailbox errors, and eight waiting responses"
        "the library sends no faulty mailbox requests";
    ["S40"] "" "blocks of Complete Access"
        "no experiment compares blocks of an object with its entries";
    ["S45", "S46"] "" "Flash times, saved values"
        "would write the Flash";
    ["S51"] "" "AL status 0x16 for wrong mailboxes"
        "the master writes the sync managers of the mailboxes";
    ["S56"] "" "AL status 0x1D or 0x1E for wrong sync managers of the process data"
        "the master writes the sync managers from the SII, which the probe does not change";
    ["S53"] "" "SDO information of missing subindices"
        "the library returns only the number of objects";
}

impl Probe {
    /// Runs every experiment in order and adds the assumptions without one. `progress` gets each experiment
    /// before it begins.
    pub fn run(&mut self, mut progress: impl FnMut(&Experiment)) -> Vec<Finding> {
        let mut findings = Vec::new();
        for experiment in experiments() {
            progress(experiment);
            findings.push(Finding::new(experiment, self.decide(experiment)));
        }
        self.session = None;
        findings.extend(UNDECIDABLE.iter().map(|assumption| assumption.finding()));
        findings
    }

    fn decide(&mut self, experiment: &Experiment) -> Outcome {
        match self.attempt(experiment) {
            Err(Interruption::LinkLost) => {
                self.session = None;
                let again = self.wait_preop().and_then(|()| self.attempt(experiment));
                self.is_lost = matches!(again, Err(Interruption::LinkLost));
                again.unwrap_or_else(|reason| self.not_run(&reason))
            }
            result => result.unwrap_or_else(|reason| self.not_run(&reason)),
        }
    }

    fn not_run(&mut self, reason: &Interruption) -> Outcome {
        self.session = None;
        Outcome::undecided(reason.to_string())
    }

    fn attempt(&mut self, experiment: &Experiment) -> Result<Outcome> {
        if self.is_stopped() {
            return Err(Interruption::Stopped);
        }
        if experiment.stage > self.options.last_stage {
            return unavailable(self.options.reason.clone());
        }
        if experiment.stage == Stage::Wired && self.options.wired.is_none() {
            return unavailable("no wired channels are given (--wired)");
        }
        self.has_changed |= experiment.stage != Stage::Reading;
        if experiment.stage == Stage::PreOp {
            self.session = None;
            self.wait_preop()?;
        }
        if let Some(session) = &mut self.session {
            session.take_missed();
        }
        let outcome = (experiment.run)(self)?;
        // Missing responses can look like another behaviour.
        match self.session.as_mut().map_or(0, Session::take_missed) {
            0 => Ok(outcome),
            _ => Err(Interruption::LinkLost),
        }
    }
}
