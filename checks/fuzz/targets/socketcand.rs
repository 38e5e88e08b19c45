//! What a client of socketcand writes in raw mode: the first byte chooses how TCP cuts the rest.
#![no_main]

use ecan_can_io::bridge::{BridgeProtocol, OfflineSession};
use libfuzzer_sys::fuzz_target;

const BEGINNING: &[u8] = b"< open can0 >< rawmode >";
const GREETING: &[u8] = b"< hi >< ok >< ok >";

fn hold<'a>(pieces: impl Iterator<Item = &'a [u8]>) -> OfflineSession {
    OfflineSession::hold(BridgeProtocol::Socketcand, None, [BEGINNING].into_iter().chain(pieces))
}

fuzz_target!(|data: &[u8]| {
    let [cut, text @ ..] = data else { return };
    let whole = hold([text].into_iter());
    assert_eq!(whole, hold(text.chunks(usize::from(*cut) + 1)));
    // At most one answer for a command, each of a known form.
    let answers = whole.answers.strip_prefix(GREETING).expect("the beginning is answered");
    let answers = std::str::from_utf8(answers).expect("answers are text");
    let ends = text.iter().filter(|byte| **byte == b'>').count();
    assert!(answers.matches("< ").count() <= ends);
    for answer in answers.split_inclusive('>') {
        assert!(answer == "< echo >" || answer.starts_with("< error "), "{answer}");
    }
    // What others hear of a frame is the frame.
    let heard = String::from_utf8(whole.received).expect("frames are text");
    let mut frames = Vec::new();
    for line in heard.split_inclusive('>') {
        let words: Vec<_> = line.trim_matches(['<', '>']).split(' ').collect();
        let (word, id, data) = (words[1], words[2], words[4]);
        let text = match word {
            "rtr" => format!("< sendrtr {id} {data} >"),
            _ => {
                let bytes: Vec<_> =
                    data.as_bytes().chunks(2).map(String::from_utf8_lossy).collect();
                format!("< send {id} {} {} >", bytes.len(), bytes.join(" "))
            }
        };
        frames.extend(hold([text.as_bytes()].into_iter()).sent);
    }
    assert_eq!(frames, whole.sent);
});
