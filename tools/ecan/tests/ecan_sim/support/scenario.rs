//! Scenarios of gateways for masters on the wire.

use std::fmt::Write;

/// Gateways with echo nodes on CAN0 that miss no outputs around Sync0: masters whose cycle does not
/// follow the clocks of the gateways write at every phase.
pub fn echo_without_sync0_window(gateways: usize) -> String {
    let mut text = String::new();
    for _ in 0..gateways {
        text += "[[gateway]]\nsync0_window = { before_us = 0, after_us = 0 }\n";
    }
    for gateway in 0..gateways {
        let _ = writeln!(text, "[[node]]\nkind = \"echo\"\nbus = \"{gateway}.0\"");
    }
    text
}
