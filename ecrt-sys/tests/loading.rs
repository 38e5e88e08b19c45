//! Loading a library: success, and the text of each failure.

use std::path::Path;

use crate::fake::{Fake, RELEASES, assert_contains};
use ecrt_sys::{Ecrt, EcrtSetting, LoadError, Origin};

#[test]
fn missing_path_is_reported() {
    let path = Path::new("/nonexistent/libethercat.so.1");
    let error = Ecrt::load(Some(path)).unwrap_err();
    assert!(matches!(error, LoadError::NotFound { .. }), "{error:?}");
    assert_contains(
        &error.to_string(),
        &[
            "/nonexistent/libethercat.so.1",
            "was not found",
            "No such file",
            "name an existing libethercat",
        ],
    );
}

#[test]
fn controls_in_names_are_escaped() {
    let path = Path::new("/none/\u{1b}[2J\n\u{202e}.so");
    let mut texts = vec![Ecrt::load(Some(path)).unwrap_err().to_string()];
    let setting = EcrtSetting::Library(Some(path.into()));
    texts.push(setting.find_loaded().unwrap_err().to_string());
    texts.push(Origin::Library { path: path.into(), version_magic: 0x106 }.to_string());
    texts.push(LoadError::NotSimulated { library: path.display().to_string() }.to_string());
    let (requested, loaded) = (path.display().to_string(), "echo\r".to_owned());
    texts.push(LoadError::OtherScenario { requested, loaded }.to_string());
    texts.push(Origin::Simulated { scenario: path.display().to_string() }.to_string());
    for text in texts {
        assert_contains(&text, &[r"/none/\x1b[2J\n\u{202e}.so"]);
        assert!(!text.contains(ecan_protocol::text::is_control), "{text:?}");
    }
}

#[test]
fn unknown_name_is_reported() {
    let name = Path::new("libethercat-absent.so.1");
    let error = Ecrt::load(Some(name)).unwrap_err();
    assert!(matches!(error, LoadError::NotFound { .. }), "{error:?}");
    assert_contains(
        &error.to_string(),
        &["libethercat-absent.so.1", "install the IgH EtherCAT master"],
    );
}

#[test]
fn file_that_is_not_a_library_is_reported() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("libethercat.so.1");
    std::fs::write(&path, "GROUP ( libethercat.so.1.2.0 )\n").unwrap();
    let error = Ecrt::load(Some(&path)).unwrap_err();
    assert!(matches!(error, LoadError::NotLoadable { .. }), "{error:?}");
    assert_contains(
        &error.to_string(),
        &[path.to_str().unwrap(), "cannot be loaded", std::env::consts::ARCH],
    );
}

#[test]
fn other_library_is_reported() {
    let Some(other) = Fake::from_text("int answer(void) { return 42; }\n") else {
        return;
    };
    let error = Ecrt::load(Some(&other.path())).unwrap_err();
    assert!(matches!(error, LoadError::NotEthercat { .. }), "{error:?}");
    assert_contains(&error.to_string(), &["not IgH's libethercat", "ecrt_version_magic"]);
}

#[test]
fn library_that_lacks_functions_lists_all_of_them() {
    let Some(fake) = Fake::build(&["LACKING"]) else {
        return;
    };
    let error = Ecrt::load(Some(&fake.path())).unwrap_err();
    let LoadError::MissingFunctions { release, missing, .. } = &error else {
        panic!("{error:?}");
    };
    assert_eq!(*release, (1, 6));
    assert_eq!(missing, &["ecrt_domain_queue", "ecrt_sdo_request_read"]);
    assert_contains(
        &error.to_string(),
        &["version 1.6", "lacks ecrt_domain_queue, ecrt_sdo_request_read"],
    );
}

#[test]
fn later_minor_release_needs_all_functions_and_is_announced() {
    let build = |macros| Fake::build(macros);
    let (Some(complete), Some(lacking)) =
        (build(&["MAGIC=0x107"]), build(&["MAGIC=0x107", "LACKING"]))
    else {
        return;
    };
    let ecrt = complete.load();
    assert_eq!(ecrt.version(), (1, 7));
    let warning = ecrt.release_warning().unwrap();
    assert_contains(&warning, &["libfake.so (version 1.7)", "tested with 1.5 and 1.6"]);
    let error = Ecrt::load(Some(&lacking.path())).unwrap_err();
    assert_contains(&error.to_string(), &["version 1.7, but lacks ecrt_domain_queue"]);
}

#[test]
fn unknown_release_is_rejected() {
    for (magic, version) in
        [("MAGIC=0x206", "version 2.6"), ("MAGIC=0x1050a", "version 1.5.10 (a fork")]
    {
        let Some(fake) = Fake::build(&[magic]) else {
            return;
        };
        let error = Ecrt::load(Some(&fake.path())).unwrap_err();
        assert!(matches!(error, LoadError::UnknownVersion { .. }), "{error:?}");
        assert_contains(&error.to_string(), &[version, "1.5 and 1.6 and newer minor"]);
    }
}

#[test]
fn loaded_library_reports_its_origin() {
    for (macros, version) in RELEASES.into_iter().zip([(1, 5), (1, 6)]) {
        let Some(fake) = Fake::build(macros) else {
            return;
        };
        let ecrt = fake.load();
        assert_eq!(ecrt.version(), version);
        assert!(!ecrt.is_simulated());
        assert_eq!(ecrt.release_warning(), None);
        let Origin::Library { path, version_magic } = ecrt.origin() else {
            panic!("{:?}", ecrt.origin());
        };
        assert_eq!(*path, fake.path());
        assert_eq!(*version_magic, u32::from(version.0) << 8 | u32::from(version.1));
        assert_contains(
            &ecrt.origin().to_string(),
            &["libfake.so (version 1.", &version.1.to_string()],
        );
    }
}

#[test]
fn loaded_library_is_found_by_its_path() {
    let Some(fake) = Fake::build(&["MAGIC=0x106"]) else {
        return;
    };
    let setting = EcrtSetting::Library(Some(fake.path()));
    let error = setting.find_loaded().unwrap_err();
    assert_eq!(error, LoadError::NotLoaded { path: fake.path() });
    assert_contains(&error.to_string(), &["has not loaded", "link the program with it"]);
    let loaded = fake.load();
    assert_eq!(setting.find_loaded().unwrap().origin(), loaded.origin());
}

#[test]
fn process_without_libethercat_has_nothing_to_attach_to() {
    for text in ["", "sim", "sim:echo"] {
        let error = EcrtSetting::parse(text).find_loaded().unwrap_err();
        assert!(matches!(error, LoadError::NotLoaded { .. }), "{text}: {error}");
    }
    assert!(EcrtSetting::parse("sim").loaded_simulator().unwrap().is_none());
}
