//! What a client of slcan writes: the first byte chooses the bus, the second how TCP cuts the rest.
#![no_main]

use ecan_can_io::bridge::{BridgeProtocol, BusRates, OfflineSession};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let [choice, cut, text @ ..] = data else { return };
    let rates = match choice % 3 {
        0 => None,
        1 => Some(BusRates::classic(500_000)),
        _ => Some(BusRates::fd(800_000, 5_000_000)),
    };
    let hold = |pieces: &mut dyn Iterator<Item = &[u8]>| {
        OfflineSession::hold(BridgeProtocol::Slcan, rates, pieces)
    };
    let whole = hold(&mut [text].into_iter());
    // Each line has one answer, in whatever pieces it comes.
    let ends = whole.answers.iter().filter(|byte| matches!(byte, b'\r' | 0x07)).count();
    assert_eq!(ends, text.iter().filter(|byte| **byte == b'\r').count());
    assert_eq!(whole, hold(&mut text.chunks(usize::from(*cut) + 1)));
    // What others hear of a frame is the frame. Without `Z` no times are among them.
    let opened =
        |text: &[u8]| OfflineSession::hold(BridgeProtocol::Slcan, None, [&b"O\r"[..], text]);
    let all = opened(text);
    if !all.received.is_empty() && !text.contains(&b'Z') {
        assert_eq!(opened(&all.received).sent, all.sent);
    }
});
