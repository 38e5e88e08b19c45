use std::collections::VecDeque;

use super::errors::MailboxError;
use super::header::{HEADER_BYTES, Header, protocol};

/// Size of the queue; a response of several fragments counts once.
const KEPT: usize = 8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MessageAddress {
    /// Station address of the requester.
    pub(super) address: u16,
    pub(super) protocol: u8,
}

#[derive(Clone, Debug)]
struct Answer {
    ready: u64,
    to: MessageAddress,
    /// Never empty.
    messages: VecDeque<Vec<u8>>,
}

/// Messages for the read mailbox.
#[derive(Clone, Debug, Default)]
pub(super) struct ResponseQueue {
    answers: VecDeque<Answer>,
    counter: u8,
}

impl ResponseQueue {
    pub(super) fn is_full(&self) -> bool {
        self.answers.len() >= KEPT
    }

    /// Adds a response that becomes ready at `ready`; the messages are without mailbox header. A
    /// message too long for a read mailbox of `reply_bytes` becomes a mailbox error. A full queue
    /// drops it.
    pub(super) fn push(
        &mut self,
        ready: u64,
        to: MessageAddress,
        messages: Vec<Vec<u8>>,
        reply_bytes: usize,
    ) {
        let fits = |message: &Vec<u8>| HEADER_BYTES + message.len() <= reply_bytes;
        let answer = if messages.iter().all(fits) {
            Answer { ready, to, messages: messages.into() }
        } else {
            Answer {
                ready,
                to: MessageAddress { protocol: protocol::ERROR, ..to },
                messages: VecDeque::from([MailboxError::InvalidSize.message()]),
            }
        };
        if !self.is_full() && !answer.messages.is_empty() {
            self.answers.push_back(answer);
        }
    }

    pub(super) fn next_ready(&self) -> Option<u64> {
        self.answers.front().map(|answer| answer.ready)
    }

    /// Copies the next message that is ready by `now` into the read mailbox.
    pub(super) fn send(&mut self, now: u64, out: &mut [u8]) -> bool {
        while let Some(answer) = self.answers.front_mut().filter(|answer| answer.ready <= now) {
            let (to, message) = (answer.to, answer.messages.pop_front());
            if answer.messages.is_empty() {
                self.answers.pop_front();
            }
            if message.is_some_and(|message| self.write(to, &message, out)) {
                return true;
            }
        }
        false
    }

    /// Copies a message into the read mailbox; returns `false` if it does not fit.
    pub(super) fn write(&mut self, to: MessageAddress, message: &[u8], out: &mut [u8]) -> bool {
        let Ok(length) = u16::try_from(message.len()) else {
            return false;
        };
        if HEADER_BYTES + message.len() > out.len() {
            return false;
        }
        self.counter = self.counter % 7 + 1;
        let MessageAddress { address, protocol } = to;
        let header = Header { length, address, channel: 0, protocol, counter: self.counter };
        let Some((head, rest)) = out.split_at_mut_checked(HEADER_BYTES) else {
            return false;
        };
        head.copy_from_slice(&header.to_bytes());
        let (body, remaining) = rest.split_at_mut(message.len());
        body.copy_from_slice(message);
        remaining.fill(0);
        true
    }
}
