//! The table of switches, and the switches that are keys of `[[gateway]]` because they existed before the table.

use ecan_protocol::object::AbortCode;

use super::switch::{
    Alternative, MissingEntries, Number, ServicePeriod, Variant, VariantTable, variants,
};

variants! {
    choices {
        // objects
        missing_abort: MissingAbort, ["H42"],
        "Abort code of an access to a missing entry" {
            NoSubindex = "no_subindex", "0x06090011";
            NoObject = "no_object", "0x06020000";
        }
        mapped_subindex: MappedSubindex, ["H3", "S5"],
        "Subindex of the 16-byte objects 0x6000 and 0x7000 ff. that the PDOs map" {
            One = "one", "1; subindex 0 is their count";
            Zero = "zero", "0; there is no other";
        }
        layout_crc: LayoutCrc, ["H4", "S2"], "Algorithm of the active layout CRC, 0x8010/11:11" {
            Object = "object", "CRC-32 of object index, image size and profile word";
            ProfileWord = "profile_word", "CRC-32 of the profile word";
            Zero = "zero", "none: the value is 0";
        }
        profile_errors: ProfileErrors, ["H20"],
        "Apply status 0x8010/11:02 after an encapsulation error or overflow" {
            InStatus = "in_status", "7 or 8 until it is cleared";
            CountersOnly = "counters_only", "stays 0; 0x8010/11:14 to :16 count";
        }
        assignment_rewritten: AssignmentRewritten, ["H41"],
        "Active profile after a write of its PDO assignment (0x1C12, 0x1C13)" {
            StaysValid = "stays_valid", "stays valid";
            ReloadRequired = "status_5", "stays active, with apply status 5 until it is applied again";
            DroppedAtSafeOp = "dropped_at_safeop",
                "is lost with SAFEOP; OP ends with AL status 0x1D until it is applied again";
        }
        assigned_at_start: AssignedAtStart, ["S3"], "Assigned chunks per direction after power-on" {
            All = "all", "24";
            Nothing = "none", "none";
        }
        empty_mask: EmptyMask, ["H49"], "Channel mask 0 in a PDO profile, 0x8010/11:04" {
            Rejected = "status_3", "apply status 3";
            Accepted = "accepted", "accepted: images without frames";
        }
        inverted_budget: InvertedBudget, ["H50"],
        "Data-path budget with a minimum above its maximum, 0x8021:04 and :05" {
            Rejected = "status_1", "apply status 1";
            Accepted = "accepted", "accepted; the minimum counts";
        }
        compat_bits: CompatBits, ["H51"], "Bits 2 to 15 of the compat mode, 0x8020:04" {
            Accepted = "accepted", "accepted, without effect";
            Rejected = "status_1", "apply status 1";
        }
        rejected_budget: RejectedBudget, ["S20"], "Apply status of an undefined budget policy" {
            UnsupportedOption = "status_10", "10, unsupported option";
            InvalidProfile = "status_4", "4, invalid profile";
        }
        apply_at_safeop: ApplyAtSafeOp, ["S4"],
        "SAFEOP with a requested profile that was never applied" {
            Applied = "applied", "applies it";
            Required = "required", "is rejected with AL status 0x1D";
        }
        sequence_readback: SequenceReadback, ["H35"],
        "Recent direction sequence number of the RxPDO, 0x8011:13" {
            Last = "last", "sequence of the last RxPDO image";
            Zero = "zero", "always 0";
        }
        // states
        safeop_inputs: SafeOpInputs, ["S7"], "TxPDO images in SAFEOP" {
            Published = "published", "published every 1 ms";
            Absent = "none", "none: SM3 is empty";
        }
        safeop_outputs: SafeOpOutputs, ["H8", "S7"], "RxPDO images in SAFEOP" {
            Discarded = "discarded", "SM2 is emptied without parsing";
            Kept = "kept", "SM2 keeps the first one, and rejects others";
        }
        assign_activate: AssignActivate, ["H2"],
        "AssignActivate word with which the gateway takes part in distributed clocks" {
            Sync0 = "0x0300", "Sync0 suffices";
            Sync0AndSync1 = "0x0700", "Sync0 and Sync1: SAFEOP without Sync1 is rejected with AL status 0x30";
        }
        watchdog: ProcessDataWatchdog, ["H34", "S21"], "Process data watchdog" {
            Configured = "configured", "100 ms after power-on; the master can set another time";
            Fixed = "fixed", "always 100 ms";
            Absent = "none", "none: OP is kept without outputs";
        }
        maintenance_mode: MaintenanceMode, ["H27", "S43"], "Access mode that maintenance commands need" {
            ByCommand = "by_command",
                "engineering to save, load, validate and activate; factory for the others";
            Factory = "factory", "factory";
            Run = "run", "none";
        }
        maintenance_status: MaintenanceNumbers, ["H27", "S44"], "Maintenance status numbers, 0xB000:05" {
            ManualOrder = "manual_order", "3 is a CRC error, 4 an invalid image";
            Swapped = "swapped", "4 is a CRC error, 3 an invalid image";
        }
        filter_index: FilterIndex, ["H39"], "Index of a filter editing window, 0x8001:43, at a restart" {
            Lost = "lost", "0";
            Kept = "kept", "keeps its value";
        }
        // CAN side
        channels_at_start: ChannelsAtStart, ["S8"], "Channels after power-on, without saved configuration" {
            Off = "off", "off until 0x8001:01 applies a configuration";
            Active = "active", "active with the default configuration";
        }
        node_modes: NodeModes, ["H9"], "Numbers of the node modes in 0x8001:08" {
            Manual = "manual", "1 is listen-only, 2 internal loopback, 3 external loopback";
            LoopbackFirst = "loopback_first",
                "1 is internal loopback, 2 external loopback, 3 listen-only";
        }
        bit_timing: BitTimingChoice, ["H43"],
        "Bit timing that the firmware chooses from the sample point window" {
            Middle = "middle", "sample point closest to the middle";
            Lowest = "lowest", "lowest sample point in the window";
            Highest = "highest", "highest sample point in the window";
            Driver = "driver",
                "as the public driver of the controller's vendor: lowest, none for some windows";
        }
        manual_timing: ManualTiming, ["H10"], "Values of a manual bit timing, 0x8001:25 to :32" {
            Physical = "physical", "prescaler and numbers of time quanta";
            RegisterValues = "register_values", "contents of the controller's registers: less by one";
        }
        tdc_prescaler: TdcPrescaler, ["H11"],
        "Data prescalers with which delay compensation (TDC) works" {
            OneOrTwo = "one_or_two", "1 and 2; others give apply status 3";
            Any = "any", "any";
        }
        channel_apply_in_op: ChannelApplyInOp, ["H38"], "Apply command of a channel, 0x8001:01, in OP" {
            Executed = "executed", "executed as in other states";
            Rejected = "rejected", "rejected with apply status 1; the channel runs on";
        }
        rotation_direction: RotationDirection, ["H31"], "Connector of a channel by the pin rotation" {
            Up = "up", "channel plus rotation";
            Down = "down", "channel minus rotation";
        }
        rotation_effect: RotationEffect, ["H47"],
        "Time at which a pin rotation written to 0x8000:12 takes effect" {
            Write = "write", "at once; the channels restart";
            ChannelApply = "channel_apply", "with the next apply command of a channel, 0x8001:01";
            Start = "start", "at the next start, if it was saved";
        }
        bit_rates: BitRates, ["H48"],
        "Nominal bit rates above 1 Mbit/s, and data bit rates below the nominal one" {
            NominalLimited = "nominal_limited",
                "apply status 3 above 1 Mbit/s; a slower data phase is accepted";
            Any = "any", "both are accepted";
            Rejected = "rejected", "both have apply status 3";
        }
        bus_off_wait: BusOffWait, ["S16"], "Wait before an automatic recovery from bus-off" {
            BackoffBase = "backoff_base", "as many services as the backoff base cycles";
            Nothing = "none", "none: with the next service";
        }
        protected_register: ProtectedRegister, ["S49"],
        "Write to a protected register of the CAN controller in operation (0xA000)" {
            Ignored = "ignored", "status 0, without effect";
            Rejected = "status_2", "status 2, write denied";
        }
        // data path
        rx_budget: RxBudgetPolicy, ["H7"], "Budget policy of the RxPDO, 0x8011:06" {
            NotApplied = "not_applied", "one channel may fill an image";
            Applied = "applied",
                "packets beyond the budget of a channel are dropped: PDO error 3, TX_RESULT 4";
        }
        pdo_errors: PdoErrorNumbers, ["S9"], "PDO errors of faulty RxPDO images" {
            Assumed = "assumed", "other layout 12, packet beyond the frame area 3";
            HeaderAndTruncated = "header_and_truncated",
                "other layout 14, packet beyond the frame area 8";
        }
        unsendable_result: UnsendableResult, ["S10"],
        "TX_RESULT of a frame for a channel that cannot send" {
            InvalidChannel = "invalid_channel", "3";
            Absent = "none", "none";
        }
        critical_frames: CriticalSet, ["S17"], "Frames that \"CANopen safety\" protects, 0x8021:09" {
            WithoutSync = "without_sync", "NMT, EMCY and heartbeat";
            WithSync = "with_sync", "SYNC, too";
        }
        rx_drain: RxDrain, ["S15"], "Frames that RX drain budget and overflow policies concern" {
            Controller = "controller",
                "the budget limits the frames from the controller into the RX cache";
            Cache = "cache", "all frames enter the RX cache; the budget limits those that leave it";
        }
        txpdo_numbering: TxPdoNumbering, ["H37"],
        "Sequence of the TxPDO images after a session reset (0x8010:08)" {
            FromOne = "from_one", "begins with 1";
            Continued = "continued", "continues";
        }
        rx_pending: RxPending, ["H21"], "Count of waiting received frames in the channel status" {
            WithOwnImage = "with_own_image", "includes the frames of the same image";
            WithoutOwnImage = "without_own_image", "only frames that follow in later images";
        }
        tx_pending: TxPending, ["H22"], "Count of waiting transmit frames in the channel status" {
            WithRunning = "with_running", "includes the frame in arbitration or on the bus";
            WithoutRunning = "without_running", "excludes it";
        }
        late_result: LateResult, ["H23", "S11"], "TX_RESULT of a frame that is dropped as late" {
            Absent = "none", "none: the manual has no code for it";
            Queued = "queued", "1, as if it waited";
            BusBusy = "bus_busy", "2";
        }
        tx_results: TxResults, ["H17", "S11"], "Frames that get a TX_RESULT" {
            EachFrame = "each_frame", "each frame";
            FailuresOnly = "failures_only", "frames that are dropped or rejected";
        }
        scheduled_results: ScheduledResults, ["H23", "S11"], "TX_RESULT packets of a scheduled frame" {
            One = "one", "one, when it is accepted";
            Two = "two", "another one when its phase has come: 0 in the controller, else the cause";
        }
        repeated_image: RepeatedImage, ["H5"], "Effect of an RxPDO image that repeats the last one" {
            NoOp = "no_op", "none";
            CountedAsError = "error_10",
                "PDO error 10, counted in 0x8011:15; its frames are not sent again";
        }
        scheduled_pulse: ScheduledPulse, ["H24", "S12"],
        "Sync0 pulse to which the offset of a scheduled frame refers" {
            Next = "next", "the first one after its image arrived";
            Previous = "previous", "the last one before its image arrived";
            Second = "second", "the second one after its image arrived";
        }
        phase_unit: PhaseUnit, ["H25"], "Unit of the phases 0x9011:04 and :05" {
            Cycles = "cycles", "CPU cycles";
            Nanoseconds = "ns", "nanoseconds";
        }
        delta16_unit: Delta16Unit, ["H14", "S14"], "Unit of delta16 timestamps" {
            Microseconds = "us", "microseconds";
            Ticks = "ticks_24mhz", "ticks of a timer at 24 MHz";
        }
        // mailbox
        sdo_information: SdoInformation, ["S41"], "SDO information" {
            Supported = "supported", "describes the object dictionary";
            Absent = "none", "mailbox error 4; the SII does not offer it";
        }
        emergencies: Emergencies, ["S42"], "CoE emergencies, on the wire" {
            Sent = "sent", "bus-off and AL errors are reported";
            Absent = "none", "none";
        }
    }
    values {
        service_period_us: ServicePeriod, ["S6"], "Period of the data-path service",
        "50 to 1000 us, free-running, and 0" {
            ServicePeriod::AFTER_OUTPUTS => "0", "one service after each SM2 write (`service_delay_us`)";
            "50", "free-running, 50 us";
            "250", "free-running, 250 us";
            "1000", "free-running, 1 ms";
        }
        schedule_depth: Number<1, 1024>, ["H26", "S12"],
        "Scheduled frames that can wait in a gateway, over all channels", "1 to 1024" {
            Number::nearest(64) => "64", "as many as in the transmit queue of a channel";
            "16", "16";
            "256", "256";
        }
        message_ram_bytes: Number<256, 65536>, ["H13"], "Message RAM of a channel in bytes",
        "256 to 65536" {
            Number::nearest(8192) => "8192", "the default layout fits exactly";
            "4096", "half of it";
            "16384", "twice as much";
        }
        missing_entries: MissingEntries, ["H1", "H42"], "Entries that the firmware does not have",
        "a list of entries (`0xF000:26`), ranges (`0xF000:19..30`) and objects (`0x9011`)" {
            MissingEntries::default() => "[]", "none";
            "[\"0xF000:1..3\"]", "device type, channels, capability version";
            "[\"0xF000:4..8\"]", "versions and serial number";
            "[\"0xF000:9\"]", "PDO header versions";
            "[\"0xF000:10..12\"]", "sizes and profiles";
            "[\"0xF000:13..16\"]", "options and features";
            "[\"0xF000:17..18\"]", "size unit and header";
            "[\"0xF000:19..23\"]", "services and extension sets";
            "[\"0xF000:24..27\"]", "tests and option masks";
            "[\"0xF000:28..30\"]", "cache depths and service budget";
            "[\"0x8030:2..6\"]", "test policies";
            "[\"0x8021\"]", "data path of the channels";
            "[\"0x8001:74\"]", "timestamp selection of the channels";
            "[\"0x9011\"]", "cycle performance";
            "[\"0x9020\"]", "data path diagnostics";
        }
    }
}

const fn alternative(value: &'static str, description: &'static str) -> Alternative {
    Alternative { value, description }
}

const fn key(
    key: &'static str,
    assumptions: &'static [&'static str],
    description: &'static str,
    alternatives: &'static [Alternative],
    permitted: &'static str,
) -> Variant {
    let table = VariantTable::Gateway;
    Variant { key, table, assumptions, description, alternatives, permitted }
}

pub(super) const GATEWAY_KEYS: &[Variant] = &[
    key(
        "boot_ms",
        &["S1"],
        "Time from power-on to the first response",
        &[alternative("200", "0.2 s"), alternative("5000", "5 s")],
        "any number of ms",
    ),
    key(
        "vendor_id",
        &["H1", "S1"],
        "Vendor ID of SII and 0x1018:01",
        &[alternative("0x4543", "invented"), alternative("0x0000_0ABC", "another")],
        "any 32-bit number",
    ),
    key(
        "product_code",
        &["H1", "S1"],
        "Product code of SII and 0x1018:02",
        &[alternative("0x4C49_5445", "invented"), alternative("1", "another")],
        "any 32-bit number",
    ),
    key(
        "serial",
        &["H19"],
        "Serial number in 0xF000:07 and :08",
        &[
            alternative("0x1_0000_0001", "different for each gateway"),
            alternative("0", "no valid OTP memory"),
        ],
        "any 63-bit number",
    ),
    key(
        "mailbox_delay_us",
        &["S23", "S38"],
        "Time from a mailbox request to its response",
        &[alternative("200", "0.2 ms"), alternative("5000", "5 ms"), alternative("50000", "50 ms")],
        "any number of us",
    ),
    key(
        "complete_access",
        &["S27"],
        "SDO Complete Access",
        &[alternative("false", "aborts with 0x06010000"), alternative("true", "supported")],
        "",
    ),
    key(
        "reboot_delay_ms",
        &["S37"],
        "Time from the reboot command 0x8000:01 to the reboot",
        &[
            alternative("100", "the command is answered before"),
            alternative("1", "answered, and immediate"),
            alternative("0", "not answered"),
        ],
        "any number of ms",
    ),
    key(
        "tx_pressure_percent",
        &["H6", "S26"],
        "Fill level of the TX ring from which tx_pressure shows",
        &[alternative("50", "half"), alternative("100", "full only")],
        "1 to 100",
    ),
    key(
        "publishes_after_read",
        &["S50"],
        "Publication of a TxPDO image that finds SM3 full",
        &[alternative("false", "with the next service"), alternative("true", "when SM3 was read")],
        "",
    ),
    key(
        "service_delay_us",
        &["S6"],
        "Time from an SM2 write to the data-path service",
        &[alternative("30", "30 us"), alternative("5", "5 us"), alternative("200", "200 us")],
        "any number of us",
    ),
    key(
        "service_jitter_us",
        &["S6"],
        "Largest additional delay of a data-path service",
        &[alternative("0", "none"), alternative("100", "up to 100 us")],
        "any number of us",
    ),
    key(
        "sync0_window",
        &["H44", "S55"],
        "Times around Sync0 at which outputs are missed, and loss of OP after missed ones",
        &[
            alternative(
                "{ before_us = 50, after_us = 20, missed_limit = 10, al_status = 0x1A }",
                "50 us before to 20 us after; 0x1A after 10 in a row",
            ),
            alternative("{ before_us = 0, after_us = 0 }", "none is missed"),
            alternative("{ missed_limit = 0 }", "OP is kept"),
            alternative("{ al_status = 0x2C }", "AL status 0x2C"),
        ],
        "before_us, after_us, missed_limit: any number; al_status: 0x1A, 0x2C",
    ),
    key(
        "release_jitter_us",
        &["S30"],
        "Largest delay of a scheduled frame after its phase",
        &[alternative("0", "none"), alternative("13", "up to 13 us")],
        "any number of us",
    ),
    key(
        "transceiver_ns",
        &["S58"],
        "Delay of the CAN transceivers from transmit to receive pin",
        &[alternative("150", "150 ns"), alternative("250", "250 ns")],
        "0 to 1000",
    ),
];

impl MappedSubindex {
    pub(crate) const fn number(self) -> u8 {
        match self {
            Self::One => ecan_protocol::object::MAPPED_SUBINDEX,
            Self::Zero => 0,
        }
    }
}

impl GatewayVariant {
    /// The abort code of an access to an entry that the firmware does not have.
    pub(crate) fn missing_entry(&self, index: u16, subindex: u8) -> Option<AbortCode> {
        self.missing_entries.lacks(index, subindex).then_some(match self.missing_abort {
            MissingAbort::NoSubindex => AbortCode::NO_SUBINDEX,
            MissingAbort::NoObject => AbortCode::NO_OBJECT,
        })
    }
}

/// Every switch: those of `[gateway.variant]`, then those of `[[gateway]]`.
pub fn variants() -> impl Iterator<Item = &'static Variant> {
    VARIANTS.iter().chain(GATEWAY_KEYS)
}
