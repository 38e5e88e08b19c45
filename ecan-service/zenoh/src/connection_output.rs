//! What a connection writes to its client.

use std::collections::VecDeque;
use std::io::Write as _;
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::sync::{Condvar, Mutex, PoisonError};

use ecan_service::client::{
    FrameRecord, FrameReport, INTERNAL_ERROR, MAX_SERVICE_PAYLOAD, MessageKind, Response, RpcError,
    header,
};

use crate::publication::lock;

/// Bytes of frames that wait for the client; more are lost.
const MAX_WAITING_BYTES: usize = 4 << 20;

/// Messages that wait for the client. Threads of Zenoh add them, so that no call waits.
#[derive(Debug)]
pub(crate) struct ConnectionOutput {
    stream: UnixStream,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    messages: VecDeque<Vec<u8>>,
    waiting_bytes: usize,
    /// Frames that were lost here.
    lost: u64,
    is_closed: bool,
}

impl ConnectionOutput {
    pub(crate) fn new(stream: UnixStream) -> Self {
        Self { stream, state: Mutex::default(), changed: Condvar::new() }
    }

    pub(crate) fn respond(&self, response: &Response) {
        let payload = serde_json::to_vec(response).unwrap_or_default();
        if payload.len() > MAX_SERVICE_PAYLOAD {
            let text = format!(
                "response has {} bytes; allowed: at most {MAX_SERVICE_PAYLOAD}",
                payload.len()
            );
            let id = response.id.clone().unwrap_or_default();
            return self.respond(&Response::error(id, RpcError::new(INTERNAL_ERROR, text)));
        }
        self.push(&mut lock(&self.state), MessageKind::Rpc, &payload);
    }

    /// Adds the results of own frames, which are never lost: the window of the client bounds them.
    pub(crate) fn push_results(&self, reports: &[FrameReport]) {
        let mut records = Vec::new();
        reports.iter().for_each(|report| report.encode(&mut records));
        self.push(&mut lock(&self.state), MessageKind::Frames, &records);
    }

    /// Adds frames of a subscription, before which others were lost.
    pub(crate) fn push_frames(&self, reports: &[FrameReport], lost: u64) {
        let state = &mut *lock(&self.state);
        state.lost += lost;
        if state.waiting_bytes > MAX_WAITING_BYTES {
            state.lost += reports.len() as u64;
            return;
        }
        let mut records = Vec::new();
        if state.lost > 0 {
            let time_ns = reports.first().map_or(0, |report| report.time_ns);
            let frames = u32::try_from(std::mem::take(&mut state.lost)).unwrap_or(u32::MAX);
            FrameRecord::Lost { time_ns, frames }.encode(&mut records);
        }
        reports.iter().for_each(|report| report.encode(&mut records));
        self.push(state, MessageKind::Frames, &records);
    }

    fn push(&self, state: &mut State, kind: MessageKind, payload: &[u8]) {
        if payload.is_empty() || state.is_closed {
            return;
        }
        let message = [&header(kind, payload.len())[..], payload].concat();
        state.waiting_bytes += message.len();
        state.messages.push_back(message);
        self.changed.notify_all();
    }

    /// Ends the connection.
    pub(crate) fn close(&self) {
        lock(&self.state).is_closed = true;
        self.changed.notify_all();
        // Fails if the client has ended it.
        let _ = self.stream.shutdown(Shutdown::Both);
    }

    /// Writes the messages until the connection ends.
    pub(crate) fn write(&self) {
        loop {
            let message = {
                let mut state = lock(&self.state);
                loop {
                    if state.is_closed {
                        return;
                    }
                    if let Some(message) = state.messages.pop_front() {
                        state.waiting_bytes -= message.len();
                        break message;
                    }
                    state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
                }
            };
            if (&self.stream).write_all(&message).is_err() {
                return self.close();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use ecan_protocol::can::{CanFrame, CanId};
    use ecan_service::client::{FrameEvent, FrameRecords, MessageReader, Sender};

    use super::*;

    #[test]
    fn frames_beyond_the_room_are_lost_and_reported() {
        let (near, mut far) = UnixStream::pair().unwrap();
        let output = ConnectionOutput::new(near);
        let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[]).unwrap();
        let report = |time_ns| FrameReport {
            time_ns,
            gateway: 0,
            channel: 0,
            tag: 0,
            event: FrameEvent::Received,
            frame,
        };
        let batch = [report(1); 1000];
        let mut kept = 0;
        while lock(&output.state).lost == 0 {
            output.push_frames(&batch, 0);
            kept += batch.len();
        }
        kept -= batch.len();
        output.push_frames(&[], 5);
        let (mut frames, mut lost) = (0, 0);
        std::thread::scope(|scope| {
            scope.spawn(|| output.write());
            let mut reader = MessageReader::new(Sender::Service);
            let mut bytes = vec![0; 1 << 16];
            while frames <= kept {
                let count = far.read(&mut bytes).unwrap();
                reader.push(&bytes[..count]);
                while let Some((_, payload)) = reader.next_message().unwrap() {
                    for record in FrameRecords::new(payload) {
                        match record.unwrap() {
                            FrameRecord::Frame(_) => frames += 1,
                            FrameRecord::Lost { frames, .. } => lost += frames,
                        }
                    }
                }
                if frames == kept {
                    // There is room again.
                    output.push_frames(&[report(2)], 0);
                }
            }
            output.close();
        });
        assert_eq!((frames, lost), (kept + 1, 1005));
    }
}
