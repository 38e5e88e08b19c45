//! Responses of a gateway: readback, status, capabilities, codes (manual 5.4.3 D, 13.2, 13.8).

use ecan_protocol::config::{ApplyStatus, ProfileMismatch, ProfileReadback, ProfileStatus};
use ecan_protocol::device::{AlState, AlStatusCode, Capabilities, FeatureFlags};
use ecan_protocol::image::{EncapsulationProfile, OptionFlags, PdoProfile};
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
    assert!(capabilities.has_scheduled_tx() && capabilities.has_foe());
    assert!(!capabilities.supports_features(FeatureFlags::STREAM_CRC32));
    assert!(capabilities.supports_multiplier(1) && capabilities.supports_multiplier(24));
    assert!(!capabilities.supports_multiplier(0) && !capabilities.supports_multiplier(25));
    assert!(capabilities.supports_channels(0x0F) && !capabilities.supports_channels(0x10));
    for profile in EncapsulationProfile::ALL {
        assert!(capabilities.supports_profile(profile));
    }
    assert!(capabilities.supports_options(OptionFlags::ALL));
    assert_eq!(capabilities.serial_number, 0x0102_0304_0102_0304);
    let limited = Capabilities { option_mask: 0x01, profile_mask: 0x01, ..capabilities };
    assert!(!limited.supports_options(OptionFlags::ALIGN4));
    assert!(!limited.supports_profile(EncapsulationProfile::Window64));
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
fn phase_d_readback() {
    let profile = PdoProfile::default();
    assert_eq!(profile.word(), 0x0000_01E7);
    let align4 = PdoProfile { options: OptionFlags::ALIGN4, ..profile };
    assert_eq!(align4.word(), 0x0040_01E7);
    let device = |subindex| -> Result<u32, ()> {
        Ok(match subindex {
            2 => 0,
            9 => 1024,
            10 => 1000,
            12 => 0x1E7,
            _ => panic!("reads subindex {subindex}"),
        })
    };
    let readback = ProfileReadback::read(device).unwrap();
    let mut found = Vec::new();
    profile.verify(&readback, &mut |mismatch| found.push(mismatch));
    assert!(found.is_empty());
    let other = ProfileReadback {
        status: ProfileStatus::from_raw(5),
        pdo_bytes: 384,
        frame_area_bytes: 360,
        profile_word: 0x1E2,
    };
    profile.verify(&other, &mut |mismatch| found.push(mismatch));
    assert_eq!(found.len(), 4);
    assert_eq!(found[0], ProfileMismatch::Status(ProfileStatus::MappingReloadRequired));
    assert_eq!(found[3].to_string(), "active profile word 0x000001E2 instead of 0x000001E7");
}
