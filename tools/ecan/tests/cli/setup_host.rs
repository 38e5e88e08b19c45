//! `scripts/setup_host.sh` on a tree of its own.

use std::path::Path;
use std::process::Command;

use tempfile::TempDir;

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scripts/setup_host.sh");
const RULE: &str = "etc/udev/rules.d/99-ecan-ethercat.rules";
const LIMITS: &str = "etc/security/limits.d/99-ecan-realtime.conf";

/// Exit status, and all that was said.
fn setup(root: &Path, arguments: &[&str]) -> (i32, String) {
    let output = Command::new(SCRIPT).args(arguments).arg("--root").arg(root).output().unwrap();
    let said = [output.stdout, output.stderr].concat();
    (output.status.code().unwrap(), String::from_utf8(said).unwrap())
}

/// Lines of a file that are no comments.
fn lines(root: &Path, file: &str) -> Vec<String> {
    let text = std::fs::read_to_string(root.join(file)).unwrap();
    text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect()
}

fn is_empty(root: &Path) -> bool {
    std::fs::read_dir(root).unwrap().next().is_none()
}

#[test]
fn show_prints_what_apply_writes() {
    let root = TempDir::new().unwrap();
    let root = root.path();
    for arguments in [&[][..], &["show"]] {
        let (status, said) = setup(root, arguments);
        assert_eq!(status, 0, "{said}");
        assert!(
            said.contains("    KERNEL==\"EtherCAT[0-9]*\", GROUP:=\"ethercat\", MODE:=\"0660\"\n")
        );
        assert!(said.contains("    @ethercat - rtprio 80\n    @ethercat - memlock unlimited\n"));
        assert!(is_empty(root));
    }
    let (_, shown) = setup(root, &["show", "--group", "robot", "--rt-priority", "90"]);
    let (status, said) = setup(root, &["apply", "--group", "robot", "--rt-priority", "90"]);
    assert_eq!(status, 0, "{said}");
    assert!(said.contains("usermod -aG robot USER"), "{said}");
    for file in [RULE, LIMITS] {
        let text = std::fs::read_to_string(root.join(file)).unwrap();
        assert!(text.lines().all(|line| shown.contains(&format!("    {line}\n"))), "{text}");
    }
    let rules = ["EtherCAT[0-9]*", "cpu_dma_latency"]
        .map(|device| format!("KERNEL==\"{device}\", GROUP:=\"robot\", MODE:=\"0660\""));
    assert_eq!(lines(root, RULE), rules);
    assert_eq!(lines(root, LIMITS), ["@robot - rtprio 90", "@robot - memlock unlimited"]);
}

/// Of two rules for the device only one can have effect.
#[test]
fn group_of_the_package_is_the_default_where_it_is_installed() {
    let root = TempDir::new().unwrap();
    let rules = root.path().join("lib/udev/rules.d");
    std::fs::create_dir_all(&rules).unwrap();
    std::fs::write(rules.join("60-ecan-lite.rules"), "").unwrap();
    let (status, said) = setup(root.path(), &["show"]);
    assert!(status == 0 && said.contains("GROUP:=\"ecan\""), "{said}");
    let (status, said) = setup(root.path(), &["show", "--group", "robot"]);
    assert!(status == 0 && said.contains("GROUP:=\"robot\""), "{said}");
}

#[test]
fn apply_is_idempotent_and_undoable() {
    let root = TempDir::new().unwrap();
    let root = root.path();
    std::fs::create_dir_all(root.join("etc/udev/rules.d")).unwrap();
    let neighbour = root.join("etc/udev/rules.d/99-ethercat.rules");
    std::fs::write(&neighbour, "KERNEL==\"EtherCAT[0-9]*\", MODE=\"0664\"\n").unwrap();
    assert_eq!(setup(root, &["apply"]).0, 0);
    let (status, said) = setup(root, &["apply"]);
    assert_eq!((status, said.matches("unchanged").count()), (0, 2), "{said}");
    assert!(setup(root, &["show"]).1.contains("(unchanged)"));
    // Another choice replaces what is there.
    let (status, said) = setup(root, &["apply", "--rt-priority", "70"]);
    assert_eq!((status, said.matches("written").count()), (0, 1), "{said}");
    assert_eq!(lines(root, LIMITS)[0], "@ethercat - rtprio 70");
    let (status, said) = setup(root, &["undo"]);
    assert_eq!((status, said.matches("removed").count()), (0, 2), "{said}");
    assert!(!root.join(RULE).exists() && !root.join(LIMITS).exists());
    assert!(neighbour.exists());
    let (status, said) = setup(root, &["undo"]);
    assert_eq!((status, said.matches("missing   ").count()), (0, 2), "{said}");
}

#[test]
fn foreign_files_are_kept() {
    let root = TempDir::new().unwrap();
    let root = root.path();
    std::fs::create_dir_all(root.join("etc/security/limits.d")).unwrap();
    std::fs::write(root.join(LIMITS), "@robot - rtprio 99\n").unwrap();
    let (status, said) = setup(root, &["apply"]);
    assert_eq!(status, 1, "{said}");
    assert!(said.contains("not written by this script; nothing was changed"), "{said}");
    assert!(!root.join(RULE).exists(), "nothing is half done");
    assert!(setup(root, &["show"]).1.contains("another file exists: apply would fail"));
    let (status, said) = setup(root, &["undo"]);
    assert_eq!(status, 1, "{said}");
    assert_eq!(lines(root, LIMITS), ["@robot - rtprio 99"]);
    // Its own file, changed by hand.
    std::fs::remove_file(root.join(LIMITS)).unwrap();
    assert_eq!(setup(root, &["apply"]).0, 0);
    let changed = std::fs::read_to_string(root.join(LIMITS)).unwrap() + "@me - nice -10\n";
    std::fs::write(root.join(LIMITS), &changed).unwrap();
    assert_eq!(setup(root, &["apply"]).0, 1);
    let (status, said) = setup(root, &["undo"]);
    assert_eq!(status, 1);
    assert!(said.contains("modified after this script wrote it; remove it manually"), "{said}");
    assert!(said.contains("removed"), "the other one goes: {said}");
    assert_eq!(std::fs::read_to_string(root.join(LIMITS)).unwrap(), changed);
}

#[test]
fn invalid_use_is_reported() {
    let root = TempDir::new().unwrap();
    let cases: [(&[&str], &str); 7] = [
        (&["install"], "unknown command \"install\""),
        (&["apply", "--groups", "x"], "unknown option \"--groups\""),
        (&["apply", "--group", "A b"], "invalid group name \"A b\""),
        (&["apply", "--group", "x\nroot"], "invalid group name"),
        (&["apply", "--rt-priority", "99"], "99 is out of range; allowed: 1 to 98"),
        (&["apply", "--rt-priority", "high"], "1 to 98"),
        (&["show", "more"], "unknown option \"more\""),
    ];
    for (arguments, words) in cases {
        let (status, said) = setup(root.path(), arguments);
        assert_eq!(status, 2, "{arguments:?}: {said}");
        assert!(said.contains(words), "{arguments:?}: {said}");
        assert!(is_empty(root.path()));
    }
    let (status, said) = setup(Path::new("/nonexistent"), &["apply"]);
    assert_eq!(status, 2);
    assert!(said.contains("directory /nonexistent does not exist"), "{said}");
}
