//! Responses of a gateway: status, capabilities, codes (manual 13.2, 13.8).

use ecan_protocol::config::{ApplyStatus, ProfileStatus};
use ecan_protocol::device::{AlState, AlStatusCode, Capabilities, FeatureFlags};
use ecan_protocol::image::{OptionFlags, PdoProfile};
use ecan_protocol::object::{AbortCode, lookup};

#[test]
fn status_number_round_trip() {
    for raw in 0..=255 {
        assert_eq!(ProfileStatus::from_raw(raw).raw(), raw);
        assert_eq!(ApplyStatus::from_raw(raw).raw(), raw);
        let (_, entry) = lookup(0x8010, 2).unwrap();
        let known = !matches!(ProfileStatus::from_raw(raw), ProfileStatus::Unknown(_));
        assert_eq!(known, entry.meaning(raw.into()).is_some());
        let (_, entry) = lookup(0x8001, 2).unwrap();
        let known = !matches!(ApplyStatus::from_raw(raw), ApplyStatus::Unknown(_));
        assert_eq!(known, entry.meaning(raw.into()).is_some());
    }
    assert_eq!(ProfileStatus::from_raw(6).to_string(), "6 (not in the manual)");
}

#[test]
fn capabilities_of_a_factory_device() {
    let mut asked = Vec::new();
    let capabilities = Capabilities::read(|subindex| -> Result<u32, ()> {
        asked.push(subindex);
        let (_, entry) = lookup(Capabilities::INDEX, subindex).unwrap();
        Ok(entry.default.unwrap_or(0x0102_0304))
    })
    .unwrap();
    assert_eq!(asked, Capabilities::fields());
    assert!(capabilities.looks_like_ecan_lite());
    assert!(capabilities.has_scheduled_tx());
    assert!(!capabilities.features.contains(FeatureFlags::STREAM_CRC32));
    assert_eq!((capabilities.multiplier_min, capabilities.multiplier_max), (1, 24));
    assert_eq!((capabilities.channel_count, capabilities.profile_mask), (4, 0x33));
    assert_eq!(capabilities.option_mask, OptionFlags::ALL.bits());
    assert_eq!(capabilities.serial_number, 0x0102_0304_0102_0304);
    // Another device with an object 0xF000.
    let other = Capabilities { header_bytes: 0, ..capabilities };
    assert!(!other.looks_like_ecan_lite());
    assert_eq!(Capabilities::read(|s| if s == 9 { Err("lost") } else { Ok(0) }), Err("lost"));
}

#[test]
fn code_texts() {
    assert_eq!(AbortCode::RANGE.to_string(), "0x06090030 value range exceeded");
    assert_eq!(AbortCode(0xDEAD_BEEF).to_string(), "0xDEADBEEF unknown abort code");
    assert_eq!(
        AlStatusCode::SM_WATCHDOG.to_string(),
        "0x001B sync manager watchdog: outputs did not arrive in time"
    );
    assert_eq!(AlStatusCode(0xFFFF).to_string(), "0xFFFF unknown AL status code");
    assert_eq!(AlState::from_status(0x14), Some(AlState::SafeOp));
    assert_eq!(AlState::from_status(0x05), None);
    assert_eq!(AlState::Op.to_string(), "OP");
    for code in [
        AbortCode::TOGGLE,
        AbortCode::TIMEOUT,
        AbortCode::COMMAND,
        AbortCode::OUT_OF_MEMORY,
        AbortCode::UNSUPPORTED_ACCESS,
        AbortCode::WRITE_ONLY,
        AbortCode::READ_ONLY,
        AbortCode::SUBINDEX_LOCKED,
        AbortCode::EXCEEDS_MAILBOX,
        AbortCode::NO_OBJECT,
        AbortCode::NOT_MAPPABLE,
        AbortCode::PDO_LENGTH,
        AbortCode::PARAMETER_INCOMPATIBLE,
        AbortCode::HARDWARE,
        AbortCode::LENGTH,
        AbortCode::TOO_LONG,
        AbortCode::TOO_SHORT,
        AbortCode::NO_SUBINDEX,
        AbortCode::TOO_GREAT,
        AbortCode::TOO_SMALL,
        AbortCode::GENERAL,
        AbortCode::NOT_STORED,
        AbortCode::LOCAL_CONTROL,
        AbortCode::DEVICE_STATE,
    ] {
        assert!(code.meaning().is_some(), "{code}");
    }
}

#[test]
fn profile_word_matches_the_manual() {
    let profile = PdoProfile::default();
    assert_eq!(profile.word(), 0x0000_01E7);
    let align4 = PdoProfile { options: OptionFlags::ALIGN4, ..profile };
    assert_eq!(align4.word(), 0x0040_01E7);
}
