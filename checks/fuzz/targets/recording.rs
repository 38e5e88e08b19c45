//! Recordings of CAN buses.
#![no_main]

use ecan_can_io::recording::{Format, ReadOptions, Recording};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    // The first byte selects the format.
    let Some((first, text)) = data.split_first() else { return };
    let format = Format::ALL.get(usize::from(*first) % 5).copied();
    let text = String::from_utf8_lossy(text);
    match Recording::parse(&text, &ReadOptions { format, screen_times: None }) {
        Ok(recording) => {
            let lines: Vec<_> = recording.frames.iter().map(|frame| frame.line).collect();
            assert!(lines.is_sorted() && lines.len() <= text.lines().count());
        }
        Err(error) => assert!(error.line >= 1 && !error.to_string().is_empty()),
    }
});
