//! `ecan new`: what it writes. The stages of CI build and run the projects.

use std::path::Path;

use super::support::{all_fail, assert_has, fails, good, json_of};

#[test]
fn project_has_program_configuration_and_test() {
    for (lang, program, build) in [
        ("rust", "src/main.rs", "Cargo.toml"),
        ("c", "main.c", "CMakeLists.txt"),
        ("cpp", "main.cpp", "CMakeLists.txt"),
    ] {
        for purpose in ["frames", "axes"] {
            let directory = tempfile::tempdir().unwrap();
            let project = directory.path().join("arm-2");
            let path = project.to_str().unwrap();
            let printed = good(&["--json", "new", path, "--lang", lang, "--for", purpose]);
            assert_eq!(json_of(&printed)["directory"], path);
            let read = |file: &str| std::fs::read_to_string(project.join(file)).unwrap();
            assert_has(&read(build), "arm-2");
            assert!(!read(program).contains("starter"));
            assert_has(&read(".vscode/settings.json"), "ecan-lite.schema.json");
            json_of(&read("ecan-lite.schema.json"));
            good(&["config", "check", project.join("machine.toml").to_str().unwrap()]);
            let scenario = format!("sim:{}", project.join("scenario.toml").display());
            assert_has(&good(&["--ecrt", &scenario, "scan"]), "ECAN-Lite");
            assert_has(&read("machine.toml"), if purpose == "axes" { "[[axis]]" } else { "can0" });
        }
    }
}

#[test]
fn rust_project_depends_on_the_source_tree_of_the_program() {
    let directory = tempfile::tempdir().unwrap();
    let project = directory.path().join("robot");
    good(&["new", project.to_str().unwrap()]);
    let manifest = std::fs::read_to_string(project.join("Cargo.toml")).unwrap();
    let package =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../ecan-lite").canonicalize().unwrap();
    assert_has(&manifest, &format!("ecan-lite = {{ path = {:?}", package.display().to_string()));
}

#[test]
fn nothing_is_written_over_and_wrong_names_are_rejected() {
    let directory = tempfile::tempdir().unwrap();
    let existing = directory.path().join("existing");
    std::fs::create_dir(&existing).unwrap();
    let rejected = fails(2, &["new", existing.to_str().unwrap()]);
    assert_has(&rejected, "exists; choose a name that does not");
    assert_eq!(existing.read_dir().unwrap().count(), 0);
    let other = directory.path().join("robot");
    let other = other.to_str().unwrap();
    all_fail(&[
        (2, &["new", "2nd"], "\"2nd\" is no name of a program"),
        (2, &["new", "a b"], "allowed: a letter, then letters"),
        (2, &["new", other, "--lang", "java"], "possible values: rust, c, cpp"),
        (6, &["new", other, "--sdk", "/no/such"], "cannot find the SDK in /no/such"),
        (2, &["--via", "/run/none.sock", "new", other], "does not use a service"),
    ]);
    assert!(!Path::new(other).exists());
}
