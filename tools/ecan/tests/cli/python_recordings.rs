//! Recordings that python-can writes.

use std::path::Path;
use std::process::Command;

use ecan_can_io::candump::{FrameText, parse_frame};
use ecan_can_io::recording::{BlfWriter, Format, ReadOptions, Recording};

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
        ("all.blf", Format::Blf, 50),
        ("all.log", Format::CandumpLog, 50),
        ("data.trc", Format::Trc, 0),
    ];
    for (file, format, error_frames) in files {
        let bytes = std::fs::read(directory.path().join(file)).unwrap();
        let recording = Recording::read(&bytes, &ReadOptions::default()).unwrap();
        assert_eq!(recording.skipped, [], "{file}");
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

#[test]
fn python_can_reads_blf_files() {
    let Some(python) = python_with(&["can"], "python-can") else { return };
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("own.blf");
    let frames = [
        ("123#1122", "123 False False False False False"),
        ("1ABCDEFF#", "1ABCDEFF True False False False False"),
        ("7FF#R4", "7FF False True False False False"),
        ("124##30102030405060708090A0B0C", "124 False False True True True"),
        ("00000001##0AA", "1 True False True False False"),
    ];
    let mut writer = BlfWriter::new(std::fs::File::create(&path).unwrap()).unwrap();
    let mut expected = Vec::new();
    for (nth, (text, fields)) in (0..).zip(frames) {
        let frame = parse_frame(text).unwrap();
        let time_ns = 1_700_000_000_123_456_000 + nth * 1_500_000;
        writer.comment(time_ns, "gap: a comment").unwrap();
        writer.write(time_ns, nth as u16 % 4, &frame, nth % 2 == 1).unwrap();
        let length = if frame.is_remote() { 4 } else { frame.data().len() };
        let data: String = frame.data().iter().map(|byte| format!("{byte:02x}")).collect();
        let is_received = if nth % 2 == 1 { "False" } else { "True" };
        let row = format!("{} {} {fields} {is_received} {length} {data}", nth * 1500, nth % 4);
        expected.push(row.trim_end().to_owned());
    }
    writer.finish().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/python/read_recording.py");
    let output = Command::new(python).arg("-B").arg(script).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let rows = String::from_utf8(output.stdout).unwrap();
    assert_eq!(rows.lines().map(str::trim_end).collect::<Vec<_>>(), expected);
}
