//! Recordings that python-can writes.

use std::path::Path;
use std::process::Command;

use ecan_can_io::candump::FrameText;
use ecan_can_io::recording::{Format, ReadOptions, Recording};

use crate::support::python::python_with;

#[test]
fn python_can_recordings_are_read() {
    let Some(python) = python_with(&["can"], "python-can") else { return };
    let directory = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/python/write_recordings.py");
    let output = Command::new(python).arg("-B").arg(script).arg(directory.path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let written = String::from_utf8(output.stdout).unwrap();
    let files = [
        ("all.asc", Format::Asc, 50),
        ("all.log", Format::CandumpLog, 50),
        ("data.trc", Format::Trc, 0),
    ];
    for (file, format, error_frames) in files {
        let text = std::fs::read_to_string(directory.path().join(file)).unwrap();
        let recording = Recording::parse(&text, &ReadOptions::default()).unwrap();
        assert_eq!((recording.format, recording.error_frames), (format, error_frames), "{file}");
        let first_ns = recording.frames.first().unwrap().time_ns;
        let rows = recording.frames.iter().map(|frame| {
            let channel =
                frame.interface.trim_start_matches(|letter: char| !letter.is_ascii_digit());
            let time_us = (frame.time_ns - first_ns + 500) / 1000;
            format!("{file} {channel} {time_us} {}", FrameText(&frame.frame))
        });
        let expected = written.lines().filter(|line| line.starts_with(file));
        let (rows, expected): (Vec<_>, Vec<_>) = (rows.collect(), expected.collect());
        assert_eq!(rows, expected, "{file}");
    }
}
