//! Scenario files.
#![no_main]

use std::path::Path;

use ecan_sim::Scenario;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    if let Err(error) = Scenario::from_toml(text, "fuzz", Path::new(".")) {
        assert!(!error.to_string().is_empty());
    }
});
