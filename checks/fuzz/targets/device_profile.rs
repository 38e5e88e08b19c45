//! Profiles of measured gateways: what is read is written and read again.
#![no_main]

use ecan_lite::config::DeviceProfile;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    match DeviceProfile::parse(text.as_bytes()) {
        Ok(profile) => {
            let written = profile.to_toml();
            assert_eq!(DeviceProfile::parse(written.as_bytes()).ok(), Some(profile), "{written}");
        }
        Err(faults) => {
            let lines = text.matches('\n').count() + 1;
            assert!(!faults.0.is_empty());
            assert!(
                faults.0.iter().all(|fault| (1..=lines).contains(&fault.line) && fault.column > 0)
            );
        }
    }
});
