//! Lines of CAN logs.
#![no_main]

use ecan_can_io::candump::parse_line;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|line: &str| {
    if let Ok(Some(record)) = parse_line(line) {
        // What was understood is understood again.
        let written = record.to_string();
        assert!(matches!(parse_line(&written), Ok(Some(_))), "{written}");
    }
});
