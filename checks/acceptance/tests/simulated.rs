//! The list on the simulated library, and its reports.
#![allow(missing_docs, clippy::disallowed_macros, clippy::disallowed_methods)]

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use ecan_test_support::{Killed, output};

/// Timeout of a failing test.
const DEADLINE: Duration = Duration::from_secs(300);

/// Directory of the other programs of the workspace; `None` if they are not built.
fn programs() -> Option<PathBuf> {
    let directory = Path::new(env!("CARGO_BIN_EXE_ecan-acceptance")).parent().unwrap();
    let is_complete =
        directory.join("ecan").is_file() && directory.join("examples/simple_loop").is_file();
    if !is_complete {
        println!(
            "skipped: ecan and the examples are not built; cargo test --workspace builds them"
        );
    }
    is_complete.then(|| directory.to_owned())
}

fn acceptance(directory: &Path, report: &Path, arguments: &[&str]) -> Output {
    output(
        Command::new(env!("CARGO_BIN_EXE_ecan-acceptance"))
            .arg("--bin")
            .arg(directory)
            .arg("--bin")
            .arg(directory.join("examples"))
            .arg("--report")
            .arg(report)
            .args(["--scripts", concat!(env!("CARGO_MANIFEST_DIR"), "/../../scripts")])
            .args(arguments)
            .env_remove("ECAN_ECRT"),
    )
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn read(directory: &Path, name: &str) -> String {
    std::fs::read_to_string(directory.join(name)).unwrap()
}

fn report_json(directory: &Path) -> serde_json::Value {
    serde_json::from_str(&read(directory, "report.json")).unwrap()
}

#[test]
fn short_list_passes_and_all_reports_agree() {
    let Some(programs) = programs() else { return };
    let directory = tempfile::tempdir().unwrap();
    let output = acceptance(&programs, directory.path(), &["--library", "sim", "--quick"]);
    let printed = text(&output.stdout);
    assert!(output.status.success(), "{printed}{}", text(&output.stderr));

    let json = report_json(directory.path());
    assert_eq!((&json["complete"], &json["quick"]), (&true.into(), &true.into()));
    let steps = json["steps"].as_array().unwrap();
    let xml = read(directory.path(), "report.xml");
    let xml = roxmltree::Document::parse(&xml).unwrap();
    let cases: Vec<_> = xml.descendants().filter(|node| node.has_tag_name("testcase")).collect();
    assert_eq!(cases.len(), steps.len());
    for (step, case) in steps.iter().zip(cases) {
        let (group, name) = (step["group"].as_str().unwrap(), step["name"].as_str().unwrap());
        assert_eq!(
            (case.attribute("classname"), case.attribute("name")),
            (Some(group), Some(name))
        );
        let is_skipped = step["status"] == "skipped";
        let skipped = case.children().find(|node| node.has_tag_name("skipped"));
        assert_eq!(is_skipped, skipped.is_some(), "{step}");
        // A skipped step states its reason.
        assert_eq!(skipped.and_then(|node| node.attribute("message")), step["reason"].as_str());
        let has_commands = !step["commands"].as_array().unwrap().is_empty();
        assert!(is_skipped || has_commands, "{step}");
        assert!(printed.contains(&format!("{group}/{name}")), "{printed}");
        assert!(directory.path().join(format!("outputs/{group}-{name}.log")).is_file());
    }
    assert_eq!(printed.lines().next(), read(directory.path(), "report.txt").lines().next());
}

#[test]
fn failed_step_names_its_cause_and_fails_the_run() {
    let Some(programs) = programs() else { return };
    let directory = tempfile::tempdir().unwrap();
    // A program that does something else in place of the example.
    let fake = directory.path().join("fake");
    std::fs::create_dir(&fake).unwrap();
    std::os::unix::fs::symlink("/bin/false", fake.join("simple_loop")).unwrap();
    let report = directory.path().join("report");
    let output = output(
        Command::new(env!("CARGO_BIN_EXE_ecan-acceptance"))
            .args(["--library", "sim", "--only", "startup/n3"])
            .args([Path::new("--bin"), &fake, Path::new("--bin"), &programs])
            .args([Path::new("--report"), &report]),
    );
    assert_eq!(output.status.code(), Some(1));
    let printed = text(&output.stdout);
    assert!(printed.contains("FAILED   startup/n3"), "{printed}");
    assert!(printed.contains("exit status 1; expected 0"), "{printed}");
    let json = report_json(&report);
    assert_eq!(json["steps"][0]["status"], "failed");
    assert_eq!(json["steps"][0]["commands"][0]["exit"], 1);
    let xml = read(&report, "report.xml");
    let xml = roxmltree::Document::parse(&xml).unwrap();
    let failure = xml.descendants().find(|node| node.has_tag_name("failure")).unwrap();
    assert_eq!(failure.attribute("message"), json["steps"][0]["reason"].as_str());
}

#[test]
fn interrupt_ends_the_running_program_and_writes_the_report() {
    let Some(programs) = programs() else { return };
    let directory = tempfile::tempdir().unwrap();
    let fake = directory.path().join("fake");
    std::fs::create_dir(&fake).unwrap();
    let program = fake.join("simple_loop");
    let pid_file = directory.path().join("pid");
    let script = format!(
        "#!/bin/sh\necho $$ > {0}.new\nmv {0}.new {0}\nexec sleep 1000\n",
        pid_file.display()
    );
    std::fs::write(&program, script).unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let report = directory.path().join("report");
    let mut running = Killed::spawn(
        Command::new(env!("CARGO_BIN_EXE_ecan-acceptance"))
            .args(["--library", "sim", "--only", "startup/n3", "--only", "startup/n8"])
            .args([Path::new("--bin"), &fake, Path::new("--bin"), &programs])
            .args([Path::new("--report"), &report])
            .stdout(Stdio::piped()),
    );
    let start = Instant::now();
    let pid = loop {
        if let Ok(text) = std::fs::read_to_string(&pid_file) {
            break Pid::from_raw(text.trim().parse().unwrap());
        }
        assert!(start.elapsed() < DEADLINE && running.try_wait().unwrap().is_none());
        std::thread::yield_now();
    };
    kill(Pid::from_raw(running.id().try_into().unwrap()), Signal::SIGINT).unwrap();
    assert_eq!(running.output().status.code(), Some(1));
    assert_eq!(kill(pid, None), Err(Errno::ESRCH));
    let json = report_json(&report);
    assert_eq!(json["complete"], false);
    let steps = json["steps"].as_array().unwrap();
    assert_eq!((steps.len(), &steps[0]["status"]), (1, &"interrupted".into()));
}

#[test]
fn contradicting_options_are_rejected() {
    let Some(programs) = programs() else { return };
    let directory = tempfile::tempdir().unwrap();
    let cases: [(&[&str], &str); 3] = [
        (&["--library", "sim", "--device"], "no --interface and no --device"),
        (&["--library", "/nowhere/libethercat.so.1"], "--interface or --device is missing"),
        (&["--library", "sim", "--only", "nothing"], "no step has this name"),
    ];
    for (arguments, expected) in cases {
        let output = acceptance(&programs, directory.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        let message = text(&output.stderr);
        assert!(message.contains(expected), "{arguments:?}: {message}");
    }
}
