//! A program that is linked statically with musl: no library can be loaded.
#![cfg(all(target_env = "musl", target_feature = "crt-static"))]

use std::path::Path;

use ecrt_sys::{Ecrt, EcrtSetting, LoadError};

#[test]
fn library_is_rejected_with_the_reason() {
    for path in [None, Some(Path::new("/lib/libethercat.so.1"))] {
        let error = Ecrt::load(path).unwrap_err();
        assert!(matches!(error, LoadError::StaticProgram { .. }), "{error:?}");
        let text = error.to_string();
        assert!(text.contains("libethercat.so.1 cannot be loaded"), "{text}");
        assert!(text.contains("allowed: the simulator (`sim`), or a service"), "{text}");
    }
}

#[test]
fn process_has_nothing_to_attach_to() {
    for text in ["", "sim"] {
        let error = EcrtSetting::parse(text).find_loaded().unwrap_err();
        assert!(matches!(error, LoadError::NotLoaded { .. }), "{text}: {error}");
    }
    assert!(EcrtSetting::parse("sim").loaded_simulator().unwrap().is_none());
}
