//! Recordings of CAN buses.
#![no_main]

use ecan_can_io::recording::{Format, ReadOptions, Recording};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    // The first byte selects the format of a text; binary ones are recognized.
    let Some((first, bytes)) = data.split_first() else { return };
    let format = Format::TEXT.get(usize::from(*first) % 5).copied();
    let lines = String::from_utf8_lossy(bytes).lines().count();
    match Recording::read(bytes, &ReadOptions { format, screen_times: None }) {
        Ok(recording) => {
            let found: Vec<_> = recording.frames.iter().map(|frame| frame.line).collect();
            let is_text = Format::TEXT.contains(&recording.format);
            assert!(found.is_sorted() && (!is_text || found.len() <= lines));
        }
        Err(error) => assert!(error.line >= 1 && !error.to_string().is_empty()),
    }
});
