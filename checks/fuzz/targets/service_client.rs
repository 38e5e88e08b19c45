//! Messages of a service to a client, with any payloads: the first byte chooses how the socket cuts the stream.
#![no_main]

use ecan_service::protocol::{
    FrameRecords, ImageMessage, MessageKind, MessageReader, Response, Sender, header,
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let [cut, rest @ ..] = data else { return };
    let mut stream = Vec::new();
    let mut rest = rest;
    // Messages of a type and a length; at the end any bytes.
    while let [kind, length, tail @ ..] = rest {
        let length = usize::from(*length) * if kind & 0x80 == 0 { 1 } else { 13 };
        if kind & 0x40 != 0 || tail.len() < length {
            stream.extend_from_slice(rest);
            break;
        }
        let kind = match kind % 3 {
            0 => MessageKind::Rpc,
            1 => MessageKind::Frames,
            _ => MessageKind::Image,
        };
        let (payload, tail) = tail.split_at(length);
        stream.extend_from_slice(&header(kind, payload.len()));
        stream.extend_from_slice(payload);
        rest = tail;
    }
    let whole = messages([stream.as_slice()].into_iter());
    assert_eq!(messages(stream.chunks(usize::from(*cut) + 1)), whole);
    for (kind, payload) in &whole {
        read(*kind, payload);
    }
});

/// The messages up to the first invalid header.
fn messages<'a>(pieces: impl Iterator<Item = &'a [u8]>) -> Vec<(MessageKind, Vec<u8>)> {
    let (mut reader, mut messages) = (MessageReader::new(Sender::Service), Vec::new());
    for piece in pieces {
        reader.push(piece);
        loop {
            match reader.next_message() {
                Ok(Some((kind, payload))) => messages.push((kind, payload.to_vec())),
                Ok(None) => break,
                Err(error) => {
                    assert!(!error.to_string().is_empty());
                    return messages;
                }
            }
        }
    }
    messages
}

fn read(kind: MessageKind, payload: &[u8]) {
    match kind {
        MessageKind::Rpc => {
            if let Ok(response) = serde_json::from_slice::<Response>(payload) {
                let text = serde_json::to_vec(&response).expect("plain data");
                assert_eq!(serde_json::from_slice::<Response>(&text).ok(), Some(response));
            }
        }
        MessageKind::Frames => {
            let records = FrameRecords::new(payload).take(payload.len() + 1).count();
            assert!(records <= payload.len());
        }
        MessageKind::Image => {
            if let Ok(message) = ImageMessage::decode(payload) {
                let mut again = Vec::new();
                message.encode(&mut again);
                assert_eq!(again, payload);
            }
        }
        MessageKind::Transmit => panic!("a type that a service does not send"),
    }
}
