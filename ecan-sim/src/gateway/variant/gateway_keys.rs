//! Switches that are keys of `[[gateway]]`: they existed before the table of variants.

use super::{Alternative, Variant, VariantTable};

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
