//! Mailboxes of SM0 and SM1, between accesses of the master and services of the firmware.

use crate::mailbox::MailboxServer;

use super::super::Context;
use super::super::sync_manager::SyncManager;
use super::Controller;
use super::memory::{READ_MAILBOX, WRITE_MAILBOX};
use super::registers::REGISTER_BYTES;

#[derive(Clone, Default)]
pub(super) struct MailboxBuffers {
    server: MailboxServer,
    /// The last message read, for a repeat.
    last_read: Vec<u8>,
    /// A message that a repeat has displaced; it follows the repeat.
    displaced: Option<Vec<u8>>,
}

fn memory_range(sm: SyncManager) -> std::ops::Range<usize> {
    let start = sm.start().saturating_sub(REGISTER_BYTES);
    start..start + sm.length()
}

impl Controller {
    pub(super) fn serve_mailbox(&mut self, context: &mut Context<'_>) {
        let now = context.now;
        if !context.gateway.mailbox_answers(now) {
            return;
        }
        let [write_mailbox, read_mailbox] =
            [WRITE_MAILBOX, READ_MAILBOX].map(|n| self.sync_managers[n]);
        if write_mailbox.is_enabled() && write_mailbox.is_full && self.mailbox.server.has_space() {
            let request = self.memory.get(memory_range(write_mailbox)).unwrap_or_default();
            self.mailbox.server.receive(now, request, read_mailbox.length(), context.gateway);
            self.sync_managers[WRITE_MAILBOX].mark_empty();
        }
        if !read_mailbox.is_enabled() || read_mailbox.is_full {
            return;
        }
        let Self { memory, mailbox, sync_managers, .. } = self;
        let out = memory.get_mut(memory_range(read_mailbox)).unwrap_or_default();
        let is_filled = match mailbox.displaced.take() {
            Some(message) => put(&message, out),
            None => {
                mailbox.server.is_due(now, context.gateway)
                    && mailbox.server.send(now, out, context.gateway)
            }
        };
        if is_filled {
            sync_managers[READ_MAILBOX].mark_full();
        }
    }

    pub(super) fn read_mailbox_was_read(&mut self, context: &mut Context<'_>) {
        let message =
            self.memory.get(memory_range(self.sync_managers[READ_MAILBOX])).unwrap_or_default();
        self.mailbox.last_read.clear();
        self.mailbox.last_read.extend_from_slice(message);
        self.serve_mailbox(context);
    }

    /// Repeats the last message if the master requests it after a loss.
    pub(super) fn repeat_if_requested(&mut self) {
        let Self { memory, mailbox, sync_managers, .. } = self;
        let sm = &mut sync_managers[READ_MAILBOX];
        if !sm.is_enabled() || !sm.take_repeat_request() || mailbox.last_read.is_empty() {
            return;
        }
        let out = memory.get_mut(memory_range(*sm)).unwrap_or_default();
        if sm.is_full {
            mailbox.displaced = Some(out.to_vec());
        }
        if put(&mailbox.last_read, out) {
            sm.mark_full();
        }
    }
}

/// Copies a message into the read mailbox if it has the same length.
fn put(message: &[u8], out: &mut [u8]) -> bool {
    let fits = message.len() == out.len();
    if fits {
        out.copy_from_slice(message);
    }
    fits
}
