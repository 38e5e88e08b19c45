//! 0xF000 Device Objects: identity, capabilities and limits (manual 13.8).

use super::ObjectType::{U8, U16, U32};
use super::diagnostic_test::TESTS;
use super::entry::{Entry, Object};
use super::pdo_profile::OptionFlags;
use super::value::ObjectValue;

pub(super) const DEVICE_OBJECTS: Object = Object::single(
    0xF000,
    "Device Objects",
    "13.8",
    &[
        Entry::highest(32),
        Entry::ro(1, "Device type", U8),
        Entry::ro(2, "Channel count", U8).default(4),
        Entry::ro(3, "Capability version", U16).default(1),
        Entry::ro(4, "Hardware revision", U32),
        Entry::ro(5, "Firmware version major", U16),
        Entry::ro(6, "Firmware version minor", U16),
        Entry::ro(7, "Serial number low", U32),
        Entry::ro(8, "Serial number high", U32),
        Entry::ro(9, "PDO header version mask", U16)
            .default(0x0002)
            .bits(&[(1, "header version 1")]),
        Entry::ro(10, "PDO size multiplier min", U8).default(1),
        Entry::ro(11, "PDO size multiplier max", U8).default(24),
        Entry::ro(12, "Encapsulation profile mask", U32).default(0x33).bits(&[
            (0, "profile 0: variable DLC, no timestamp"),
            (1, "profile 1: variable DLC, delta16 allowed"),
            (4, "profile 4: D64 allowed, no timestamp"),
            (5, "profile 5: D64 allowed, delta16 allowed"),
        ]),
        Entry::ro(13, "Max PDO bytes", U16).default(3072).unit("bytes"),
        Entry::ro(14, "Max CAN channels", U8).default(4),
        Entry::ro(15, "PDO option flags mask", U8).default(0x1F).bits(OptionFlags::BITS),
        Entry::ro(16, "PDO feature flags", U32).default(0x1F3B).bits(&[
            (0, "TX_RESULT"),
            (1, "TSF_DELTA16"),
            (2, "TSF_DELTA32"),
            (3, "TSF_FULL64"),
            (4, "D64"),
            (5, "ALIGN4"),
            (6, "STREAM_CRC32"),
            (8, "RX_TSF_SCHEDULE_TX"),
            (9, "NO_CRC16"),
            (10, "APP_BYPASS"),
            (11, "PAYLOAD_ONLY"),
            (12, "FINE_BYPASS"),
        ]),
        Entry::ro(17, "PDO size unit bytes", U16).default(128).unit("bytes"),
        Entry::ro(18, "PDO fixed header bytes", U16).default(24).unit("bytes"),
        Entry::ro(19, "Device service flags", U32).default(0x15).bits(&[
            (0, "FoE firmware update"),
            (2, "configuration persistence"),
            (4, "access levels"),
        ]),
        Entry::ro(20, "Object extension set", U16).default(1),
        Entry::ro(21, "Data path extension set", U16).default(1),
        Entry::ro(22, "Diagnostic extension set", U16).default(1),
        Entry::ro(23, "Reserved capability pad", U16).default(0),
        Entry::ro(24, "Data path feature flags", U32).default(0x1F).bits(TESTS),
        Entry::ro(25, "Diagnostic feature flags", U32).default(0x1F).bits(TESTS),
        Entry::ro(26, "Runtime option flags mask", U32).default(0),
        Entry::ro(27, "Diagnostic option flags mask", U32).default(0),
        Entry::ro(28, "MCAN RX cache max depth", U16).default(32).unit("frames"),
        Entry::ro(29, "MCAN TX cache max depth", U16).default(64).unit("frames"),
        Entry::ro(30, "Max service budget us", U16).default(1000).unit("us"),
        Entry::ro(31, "Reserved capability0", U16).default(0),
        Entry::ro(32, "Reserved capability1", U32).default(0),
    ],
);
