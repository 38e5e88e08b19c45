use super::declare::variants;
use super::{Alternative, MissingEntries, Variant, VariantTable};

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
        // states
        safeop_inputs: SafeOpInputs, ["S7"], "TxPDO images in SAFEOP" {
            Published = "published", "published every 1 ms";
            Absent = "none", "none: SM3 is empty";
        }
        safeop_outputs: SafeOpOutputs, ["H8", "S7"], "RxPDO images in SAFEOP" {
            Discarded = "discarded", "SM2 is emptied without parsing";
            Kept = "kept", "SM2 keeps the first one, and rejects others";
        }
        // CAN side
        node_modes: NodeModes, ["H9"], "Numbers of the node modes in 0x8001:08" {
            Manual = "manual", "1 is listen-only, 2 internal loopback, 3 external loopback";
            LoopbackFirst = "loopback_first",
                "1 is internal loopback, 2 external loopback, 3 listen-only";
        }
        // data path
        repeated_image: RepeatedImage, ["H5"], "Effect of an RxPDO image that repeats the last one" {
            NoOp = "no_op", "none";
            CountedAsError = "error_10",
                "PDO error 10, counted in 0x8011:15; its frames are not sent again";
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
        missing_entries: MissingEntries, ["H42"], "Entries that the firmware does not have",
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
