//! `scripts/ecan_sii_sm_layout.sh` with a stand-in for IgH's tool over the EEPROM of a simulated
//! gateway, whole and broken.

use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use ecan_sim::{Wire, echo};
use tempfile::TempDir;

use crate::support::terminal::Pty;

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scripts/ecan_sii_sm_layout.sh");

/// As IgH's master does, it gives back the SII of the last scan, not what was written since.
const TOOL: &str = r#"#!/usr/bin/env bash
cd "$(dirname "$0")" || exit 9
printf '%s\n' "$*" >>calls
[[ -f $1.fails ]] && { cat "$1.fails" >&2; exit 1; }
case $1 in
sii_read) cat scanned ;;
sii_write) [[ -f write_is_lost ]] || cat "${!#}" >eeprom ;;
rescan) cp eeprom scanned ;;
master) printf 'Master0\n  Phase: %s\n  Active: no\n' "$(cat phase)" ;;
slaves) printf '0  0:0  %s  +  ECAN-Lite\n' "$(cat state)" ;;
upload) case ${!#} in 17) cat unit ;; 18) echo '0x0018 24' ;; *) exit 1 ;; esac ;;
*) exit 1 ;;
esac
"#;

/// The EEPROM that the simulator's gateway has, up to the end of its categories as a master reads
/// it.
fn good_image() -> Vec<u8> {
    let wire = Wire::new(&echo(1), 0).unwrap();
    let words = wire.world().gateway(0).unwrap().eeprom();
    let mut at = 0x40;
    while words[at] != 0xFFFF {
        at += 2 + usize::from(words[at + 1]);
    }
    words[..=at].iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// Where the first entry of category 41 begins.
fn sync_managers(image: &[u8]) -> usize {
    let first = [0x00, 0x10, 0x80, 0x00, 0x26];
    image.windows(5).position(|window| window == first).unwrap()
}

struct Fixture(TempDir);

impl Fixture {
    fn new(image: &[u8]) -> Self {
        let bench = Self(tempfile::tempdir().unwrap());
        for (name, bytes) in [
            ("eeprom", image),
            ("scanned", image),
            ("state", b"PREOP"),
            ("phase", b"Idle"),
            ("unit", b"0x0080 128"),
            ("calls", b""),
        ] {
            bench.put(name, bytes);
        }
        crate::support::write_program(&bench.path("ethercat"), TOOL);
        // The fake master scans at once.
        crate::support::write_program(&bench.path("sleep"), "#!/bin/sh\n");
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    fn get(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }

    fn search_path(&self) -> String {
        let own = self.0.path().to_str().unwrap();
        format!("{own}:{}", std::env::var("PATH").unwrap())
    }

    fn has_written(&self) -> bool {
        String::from_utf8(self.get("calls")).unwrap().contains("sii_write")
    }

    /// Exit status, and all that was said.
    fn run(&self, arguments: &[&str]) -> (i32, String) {
        let output = Command::new(SCRIPT)
            .args(arguments)
            .args(["--ethercat", self.path("ethercat").to_str().unwrap()])
            .env("PATH", self.search_path())
            .current_dir(self.0.path())
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let said = [output.stdout, output.stderr].concat();
        (output.status.code().unwrap(), String::from_utf8(said).unwrap())
    }
}

/// Bytes to be changed, offsets from the first sync manager's entry.
fn broken(changes: &[(usize, u8)]) -> Vec<u8> {
    let mut image = good_image();
    let at = sync_managers(&image);
    for (offset, value) in changes {
        image[at + offset] = *value;
    }
    image
}

#[test]
fn simulated_layout_is_correct() {
    let bench = Fixture::new(&good_image());
    let arguments = ["check", "--position", "0", "--pdo-bytes", "3072"];
    let (status, said) = bench.run(&arguments);
    assert_eq!(status, 0, "{said}");
    for line in [
        "ok     SM2 start             0x1100\n",
        "ok     SM2 size              3072\n",
        "ok     SM2 control byte      0x66\n",
        "ok     SM3 start             0x1D00\n",
        "ok     SM3 size              3072\n",
        "ok     SM3 control byte      0x22\n",
        "the layout matches the manual (15.7)\n",
    ] {
        assert!(said.contains(line), "{said}");
    }
    let (_, said) = bench.run(&[&arguments[..], &["--rescan"]].concat());
    assert_eq!(
        bench.run(&["fix"]),
        (0, said.replace("the layout matches the manual (15.7)", "nothing to fix"))
    );
    assert!(!bench.has_written());
    // Another size is wanted: what is good for one is wrong for the other.
    let (status, said) = bench.run(&["check", "--pdo-bytes", "1024"]);
    assert_eq!(status, 1);
    assert!(said.contains("WRONG  SM2 size              3072, must be 1024\n"), "{said}");
}

#[test]
fn each_fault_is_reported_fixed_and_restorable() {
    let good = good_image();
    let mut bad_checksum = good.clone();
    bad_checksum[14] ^= 0x40;
    let cases = [
        (broken(&[(17, 0x12)]), "WRONG  SM2 start             0x1200, must be 0x1100"),
        (broken(&[(18, 0x80), (19, 0)]), "WRONG  SM2 size              128, must be 3072"),
        (broken(&[(20, 0x64)]), "WRONG  SM2 control byte      0x64, must be 0x66"),
        (broken(&[(25, 0x1C)]), "WRONG  SM3 start             0x1C00, must be 0x1D00"),
        (broken(&[(27, 0x04)]), "WRONG  SM3 size              1024, must be 3072"),
        (broken(&[(28, 0x20)]), "WRONG  SM3 control byte      0x20, must be 0x22"),
        (broken(&[(16, 1), (20, 0), (24, 1), (28, 0)]), "SM3 start             0x1D01"),
        (bad_checksum, "WRONG  checksum of words 0-6"),
    ];
    for (image, words) in cases {
        let bench = Fixture::new(&image);
        let (status, said) = bench.run(&["check"]);
        assert_eq!(status, 1, "{said}");
        assert!(said.contains(words), "{words}: {said}");
        assert!(!bench.has_written());
        let is_checksum = words.contains("checksum");
        let mut fix = vec!["fix", "--yes", "--backup", "before.bin"];
        if is_checksum {
            let (status, said) = bench.run(&fix);
            assert_eq!(status, 1, "{said}");
            assert!(said.contains("use --force to write a new one"), "{said}");
            assert!(!bench.has_written());
            fix.push("--force");
        }
        let (status, said) = bench.run(&fix);
        assert_eq!(status, 0, "{said}");
        assert!(said.contains("readback matches"), "{said}");
        assert_eq!(bench.get("eeprom"), good, "{words}");
        assert_eq!(bench.get("before.bin"), image);
        assert_eq!(bench.run(&["check"]).0, 0);
        let backup = bench.path("before.bin");
        let mut restore =
            vec!["restore", backup.to_str().unwrap(), "--yes", "--backup", "fixed.bin"];
        if is_checksum {
            let (status, said) = bench.run(&restore);
            assert_eq!(status, 1, "{said}");
            assert!(said.contains("before.bin: its checksum is wrong\n"), "{said}");
            restore.push("--force");
        }
        let (status, said) = bench.run(&restore);
        assert_eq!(status, 0, "{said}");
        assert_eq!((bench.get("eeprom"), bench.get("fixed.bin")), (image, good.clone()));
        // The tool writes a wrong checksum only when it is forced to.
        let calls = String::from_utf8(bench.get("calls")).unwrap();
        let forced =
            calls.lines().any(|call| call.contains("sii_write") && call.contains("--force"));
        assert_eq!(forced, is_checksum, "{calls}");
    }
}

#[test]
fn damaged_words_need_force() {
    let mut image = good_image();
    (image[0], image[8]) = (image[0] ^ 0xFF, 0x34);
    let bench = Fixture::new(&image);
    let (status, said) = bench.run(&["fix", "--yes"]);
    assert_eq!(status, 1, "{said}");
    let words: Vec<_> =
        image[..14].chunks(2).map(|pair| format!(" 0x{:02X}{:02X}", pair[1], pair[0])).collect();
    assert!(said.contains(&format!("words 0-6:{}\n", words.concat())), "{said}");
    assert!(said.contains("restore a backup"), "{said}");
    assert!(!bench.has_written());
}

#[test]
fn suspicious_backup_needs_force() {
    let good = good_image();
    let changed = |at: usize| {
        let mut image = good.clone();
        image[at] ^= 0x55;
        image
    };
    let other = "its vendor, product or serial number differs from the slave";
    let cases = [
        (changed(16), other),
        (changed(20), other),
        (changed(28), other),
        (changed(14), "its checksum is wrong"),
        (changed(0), "its checksum is wrong"),
        (changed(sync_managers(&good) - 4), "the SII has no category 41"),
        ((0..good.len()).map(|at| (at * 37) as u8).collect(), "its checksum is wrong"),
        (good[..good.len() - 2].to_vec(), "bytes, the SII of the slave"),
    ];
    for (image, words) in cases {
        let bench = Fixture::new(&broken(&[(20, 0x64)]));
        bench.put("backup.bin", &image);
        let (status, said) = bench.run(&["restore", "backup.bin", "--yes"]);
        assert_eq!(status, 1, "{said}");
        assert!(said.contains(words), "{words}: {said}");
        assert!(said.contains("use --force to write anyway"), "{said}");
        assert!(!said.contains("or restore a backup"), "{said}");
        assert!(!bench.has_written());
        let (status, said) = bench.run(&["restore", "backup.bin", "--yes", "--force"]);
        assert_eq!((status, bench.get("eeprom")), (0, image), "{said}");
    }
    // The revision may be another one: it changes with the firmware.
    let bench = Fixture::new(&good);
    bench.put("backup.bin", &changed(24));
    assert_eq!(bench.run(&["restore", "backup.bin", "--yes"]).0, 0);
}

#[test]
fn unspecified_fields_are_noted_and_kept() {
    let image = broken(&[(22, 0), (31, 3), (28, 0x20)]);
    let bench = Fixture::new(&image);
    let (status, said) = bench.run(&["fix", "--yes"]);
    assert_eq!(status, 0, "{said}");
    assert!(said.contains("note   SM2 is not enabled by the SII\n"), "{said}");
    assert!(said.contains("note   SM3 has type 3, usually 4\n"), "{said}");
    assert_eq!(bench.get("eeprom"), broken(&[(22, 0), (31, 3)]));
}

#[test]
fn unfixable_images_are_not_changed() {
    let good = good_image();
    let category = sync_managers(&good) - 4;
    let mut no_category = good.clone();
    no_category[category] = 42;
    let mut runs_over = good.clone();
    runs_over[category + 3] = 0x7F;
    let mut two_entries = good.clone();
    two_entries[category + 2] = 8;
    let cases = [
        (1, no_category, "no category 41"),
        (1, two_entries, "only 2 of 4 sync managers"),
        (4, runs_over, "category 41 at byte"),
        (4, good[..100].to_vec(), "has 100 bytes, too few"),
        (4, good[..category].to_vec(), "without category 41 (sync managers) and without end mark"),
        (4, good[..category + 1].to_vec(), "odd number"),
        (4, good[..category + 20].to_vec(), "exceeds the end"),
    ];
    for (expected, image, words) in cases {
        let bench = Fixture::new(&image);
        for command in [&["check"][..], &["fix", "--yes"]] {
            let (status, said) = bench.run(command);
            assert_eq!(status, expected, "{said}");
            assert!(said.contains(words), "{words}: {said}");
            assert!(said.contains("rebuild its EEPROM"), "{said}");
        }
        assert!(!bench.has_written());
    }
    let (status, said) = Fixture::new(b"").run(&["check"]);
    assert_eq!(status, 4);
    assert!(said.contains("returned no data"), "{said}");
}

#[test]
fn truncated_image_is_never_judged() {
    let good = good_image();
    let end = sync_managers(&good) + 32;
    let bench = Fixture::new(&good);
    let lengths = (1..24).chain([127, 128, 129, 130, 131, 132, 133, 134]);
    for length in lengths.chain(end - 40..end) {
        bench.put("scanned", &good[..length]);
        let (status, said) = bench.run(&["check"]);
        assert_eq!(status, 4, "{length} bytes: {said}");
        assert!(!said.contains("unbound") && !said.contains("unexpected"), "{length}: {said}");
    }
}

#[test]
fn layout_is_read_without_process_substitution() {
    let script = std::fs::read_to_string(SCRIPT).unwrap();
    let uses = |line: &&str| !line.trim_start().starts_with('#') && line.contains("<(");
    assert_eq!(script.lines().find(uses), None, "this needs /dev/fd");
}

#[test]
fn change_since_the_scan_needs_a_rescan() {
    let bench = Fixture::new(&good_image());
    bench.put("eeprom", &broken(&[(20, 0x64)]));
    let (status, said) = bench.run(&["check"]);
    assert_eq!(status, 0, "{said}");
    assert!(said.contains("note: this is the copy of the last scan of the master"), "{said}");
    let (status, said) = bench.run(&["check", "--rescan"]);
    assert_eq!(status, 1, "{said}");
    assert!(said.contains("WRONG  SM2 control byte") && !said.contains("note: this is"), "{said}");
    // What is written back contains the changes since the scan.
    let changed = broken(&[(20, 0x64), (2, 0x81)]);
    bench.put("eeprom", &changed);
    let (status, said) = bench.run(&["fix", "--yes", "--backup", "b.bin"]);
    assert_eq!((status, bench.get("b.bin")), (0, changed), "{said}");
    assert_eq!(bench.get("eeprom"), broken(&[(2, 0x81)]));
    bench.put("phase", b"Operation");
    for command in [&["check", "--rescan"][..], &["fix", "--yes"]] {
        let (status, said) = bench.run(command);
        assert_eq!(status, 4, "{said}");
        assert!(said.contains("an application uses the master"), "{said}");
    }
}

#[test]
fn writing_needs_confirmation_and_right_slave() {
    let image = broken(&[(20, 0x64)]);
    let rejected = |prepare: fn(&Fixture), arguments: &[&str], status: i32, words: &str| {
        let bench = Fixture::new(&image);
        prepare(&bench);
        let (found, said) = bench.run(arguments);
        assert_eq!(found, status, "{said}");
        assert!(said.contains(words), "{words}: {said}");
        assert!(!bench.has_written());
        assert_eq!(bench.get("eeprom"), image);
    };
    rejected(|_| (), &["fix"], 2, "nothing was written; use --yes");
    rejected(|bench| bench.put("state", b"OP"), &["fix", "--yes"], 1, "is in OP; stop the app");
    rejected(|bench| bench.put("unit", b"0x0001 1"), &["fix", "--yes"], 1, "as an ECAN-Lite");
    let taken = ["fix", "--yes", "--backup", "state"];
    rejected(|_| (), &taken, 2, "exists and is not overwritten");
    let nowhere = ["fix", "--yes", "--backup", "/nonexistent/backup.bin"];
    rejected(|_| (), &nowhere, 2, "cannot write the backup");
    let failing = |bench: &Fixture| {
        bench.put(
            "sii_read.fails",
            b"Failed to open master device /dev/EtherCAT0: Permission denied",
        );
    };
    let words = "ethercat sii_read: Failed to open master device /dev/EtherCAT0: Permission denied";
    rejected(failing, &["fix", "--yes"], 3, words);
    rejected(failing, &["check"], 3, words);
    rejected(|_| (), &["restore", "state", "--yes"], 2, "state has 5 bytes and is not an SII");
    rejected(|_| (), &["restore", "none.bin", "--yes"], 2, "cannot read none.bin");
    let other_size = |bench: &Fixture| bench.put("other.bin", &[0; 500]);
    rejected(other_size, &["restore", "other.bin", "--yes"], 1, "or not from slave 0");
    // Chosen by hand, the slave need not show itself.
    let bench = Fixture::new(&image);
    bench.put("unit", b"0x0001 1");
    let (status, said) = bench.run(&["fix", "--yes", "--force"]);
    assert_eq!((status, bench.get("eeprom")), (0, good_image()), "{said}");
    // The default name of the backup.
    let names = std::fs::read_dir(bench.0.path()).unwrap().map(|entry| entry.unwrap().file_name());
    let backups = names.filter(|name| name.to_str().unwrap().starts_with("ecan_sii_0_2"));
    assert_eq!(backups.count(), 1);
}

#[test]
fn fix_asks_on_a_terminal() {
    let image = broken(&[(20, 0x64)]);
    for (typed, status, is_fixed) in [("n\n", 2, false), ("y\n", 0, true)] {
        let bench = Fixture::new(&image);
        let mut pty = Pty::open((80, 24));
        pty.master.write_all(typed.as_bytes()).unwrap();
        let output = Command::new(SCRIPT)
            .args(["fix", "--ethercat", bench.path("ethercat").to_str().unwrap()])
            .env("PATH", bench.search_path())
            .current_dir(bench.0.path())
            .stdin(pty.stdio())
            .output()
            .unwrap();
        let said = String::from_utf8(output.stdout).unwrap();
        assert_eq!(output.status.code(), Some(status), "{said}");
        assert!(said.contains("to be changed:\n  SM2 control byte: 0x64 -> 0x66\n"), "{said}");
        assert_eq!(bench.get("eeprom") == good_image(), is_fixed);
        assert_eq!(bench.has_written(), is_fixed);
    }
}

#[test]
fn failed_or_lost_write_is_reported() {
    let bench = Fixture::new(&broken(&[(20, 0x64)]));
    bench.put("sii_write.fails", b"Failed to write SII: Input/output error\n");
    let (status, said) = bench.run(&["fix", "--yes"]);
    assert_eq!(status, 3);
    assert!(said.contains("ethercat sii_write: Failed to write SII: Input/output error"), "{said}");
    let bench = Fixture::new(&broken(&[(20, 0x64)]));
    bench.put("write_is_lost", b"");
    let (status, said) = bench.run(&["fix", "--yes", "--backup", "b.bin", "--attempts", "1"]);
    assert_eq!(status, 1, "{said}");
    assert!(said.contains("readback does not match"), "{said}");
    assert!(said.contains("the backup is b.bin"), "{said}");
}

#[test]
fn invalid_use_is_reported() {
    let bench = Fixture::new(&good_image());
    let cases: [(&[&str], &str); 6] = [
        (&["mend"], "unknown command \"mend\""),
        (&["check", "--positions", "1"], "unknown option \"--positions\""),
        (&["check", "--position", "-1"], "--position needs a number, not \"-1\""),
        (&["check", "--pdo-bytes", "100"], "multiples of 128"),
        (&["check", "--pdo-bytes", "4096"], "multiples of 128"),
        (&["restore", "--yes"], "restore needs the file"),
    ];
    for (arguments, words) in cases {
        let (status, said) = bench.run(arguments);
        assert_eq!(status, 2, "{arguments:?}: {said}");
        assert!(said.contains(words), "{arguments:?}: {said}");
    }
    let output =
        Command::new(SCRIPT).args(["check", "--ethercat", "/nonexistent"]).output().unwrap();
    assert_eq!(output.status.code(), Some(3));
    assert!(String::from_utf8(output.stderr).unwrap().contains("tool /nonexistent"));
    let help = Command::new(SCRIPT).arg("--help").output().unwrap();
    assert!(help.status.success());
    assert!(String::from_utf8(help.stdout).unwrap().starts_with("Usage: ecan_sii_sm_layout.sh"));
}
