//! What a client writes to a service: the first byte chooses the access, the window and how the socket
//! cuts the rest.
#![no_main]

use ecan_service::protocol::{
    Access, FrameEvent, FrameRecord, FrameRecords, MessageKind, Response, header,
};
use ecan_service::server::OfflineSession;
use libfuzzer_sys::fuzz_target;

const HELLO: &[u8] =
    br#"{"jsonrpc":"2.0","id":0,"method":"hello","params":{"version":1,"client":"fuzz"}}"#;

fuzz_target!(|data: &[u8]| {
    let [choice, rest @ ..] = data else { return };
    let access = if choice & 1 == 0 { Access::Control } else { Access::Read };
    let window = u32::from(choice >> 1 & 7);
    let mut stream = Vec::new();
    if choice & 16 == 0 {
        stream.extend_from_slice(&header(MessageKind::Rpc, HELLO.len()));
        stream.extend_from_slice(HELLO);
    }
    stream.extend_from_slice(rest);
    let whole = OfflineSession::hold(access, window, [stream.as_slice()].into_iter());
    let step = usize::from(choice >> 5) + 1;
    let mut pieces = OfflineSession::hold(access, window, stream.chunks(step));
    // Only the division of rejections into batches depends on the reads.
    let (mut answers, mut rejected) = (Vec::new(), 0);
    for session in [&whole, &pieces] {
        let mut reader = session.messages();
        let mut own = (Vec::new(), Vec::new());
        while let Some((kind, payload)) = reader.next_message().expect("a message") {
            match kind {
                MessageKind::Rpc => {
                    let response: Response = serde_json::from_slice(payload).expect("a response");
                    assert!(response.id.is_some());
                    assert!(response.result.is_some() != response.error.is_some());
                    own.0.push(response);
                }
                MessageKind::Frames => {
                    for record in FrameRecords::new(payload) {
                        let Ok(FrameRecord::Frame(report)) = record else { panic!("{record:?}") };
                        assert!(matches!(report.event, FrameEvent::Rejected(_)));
                        assert_ne!(report.tag, 0);
                        own.1.push(report);
                    }
                }
                _ => panic!("{kind:?}"),
            }
        }
        assert_eq!(reader.pending_bytes(), 0);
        rejected = own.1.len();
        answers.push(own);
    }
    assert_eq!(answers[0], answers[1]);
    pieces.output.clone_from(&whole.output);
    assert_eq!(whole, pieces);
    // Accepted frames reached the bus, the others were rejected to the client.
    assert_eq!(whole.counters, (whole.sent.len() as u64, rejected as u64));
    if access == Access::Read
        || choice & 16 != 0 && whole.requests.is_empty() && answers[0].0.is_empty()
    {
        assert!(whole.sent.is_empty());
    }
});
