//! A client: its socket and session.

use std::os::fd::OwnedFd;
use std::time::{Duration, Instant};

use rustix::event::PollFlags;
use rustix::io::Errno;
use rustix::net::{RecvFlags, SendFlags, recv, send};

use crate::protocol::ClientStats;
use crate::server::permission::Peer;
use crate::server::session::{Host, Session};

/// Reads of one client in a row.
const MAX_READS: usize = 4;

#[derive(Debug)]
pub(crate) struct Client {
    pub(crate) socket: OwnedFd,
    pub(crate) session: Session,
    pub(crate) peer: Option<Peer>,
    connected: Instant,
    /// Checks of the service without a `hello`; counts no time in which the service was stopped.
    pub(crate) silent_checks: u32,
    /// Time since which bytes may wait in the socket that the service did not read.
    unread_since: Option<Duration>,
    /// The connection failed, or the client closed it.
    is_gone: bool,
}

impl Client {
    pub(crate) fn new(socket: OwnedFd, session: Session, peer: Option<Peer>) -> Self {
        let connected = Instant::now();
        Self {
            socket,
            session,
            peer,
            connected,
            silent_checks: 0,
            unread_since: None,
            is_gone: false,
        }
    }

    /// Events that the client waits for.
    pub(crate) fn poll_flags(&self) -> PollFlags {
        let mut flags = PollFlags::empty();
        if self.session.accepts_input() {
            flags |= PollFlags::IN;
        }
        if !self.session.output.pending().is_empty() {
            flags |= PollFlags::OUT;
        }
        flags
    }

    /// Reads what the client sent; it arrived at `arrival` or later, unless the service left it unread
    /// before.
    pub(crate) fn read(&mut self, buffer: &mut [u8], arrival: Duration, host: &mut impl Host) {
        let first = self.unread_since.map_or(arrival, |since| since.min(arrival));
        for _ in 0..MAX_READS {
            if self.is_gone || !self.session.accepts_input() {
                break;
            }
            match recv(&self.socket, &mut *buffer, RecvFlags::DONTWAIT) {
                Ok((0, _)) => self.is_gone = true,
                Ok((count, _)) => {
                    self.session.receive(buffer.get(..count).unwrap_or_default(), first, host);
                }
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) => {
                    self.unread_since = None;
                    return;
                }
                Err(_) => self.is_gone = true,
            }
        }
        self.unread_since = Some(first);
    }

    /// No byte of the client waits in the socket while the service reads it.
    pub(crate) fn end_unread(&mut self) {
        if self.session.accepts_input() {
            self.unread_since = None;
        }
    }

    /// Writes what the client takes.
    pub(crate) fn write(&mut self) {
        self.session.output.end_batch();
        loop {
            let pending = self.session.output.pending();
            if self.is_gone || pending.is_empty() {
                return;
            }
            match send(&self.socket, pending, SendFlags::DONTWAIT | SendFlags::NOSIGNAL) {
                Ok(count) => self.session.output.advance(count),
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) => return,
                Err(_) => self.is_gone = true,
            }
        }
    }

    pub(crate) fn hang_up(&mut self) {
        self.is_gone = true;
    }

    /// Returns whether the connection is to be closed.
    pub(crate) fn is_over(&self) -> bool {
        self.is_gone || self.session.is_ended() && self.session.output.pending().is_empty()
    }

    pub(crate) fn statistics(&self) -> ClientStats {
        let Session { id, ref name, ref output, counters, .. } = self.session;
        let connected_ms = self.connected.elapsed().as_millis();
        ClientStats {
            id,
            name: name.clone(),
            pid: self.peer.map_or(0, |peer| peer.pid),
            uid: self.peer.map_or(0, |peer| peer.uid),
            access: self.session.permission().access,
            connected_ms: u64::try_from(connected_ms).unwrap_or(u64::MAX),
            requests: counters.requests,
            requests_rejected: counters.requests_rejected,
            requests_expired: counters.requests_expired,
            frames_delivered: output.counters.frames_delivered,
            frames_lost: output.counters.frames_lost,
            images_delivered: output.counters.images_delivered,
            images_lost: output.counters.images_lost,
            frames_accepted: counters.frames_accepted,
            frames_rejected: counters.frames_rejected,
            frames_pending: self.session.frames_pending(),
            queued_bytes: output.len() as u64,
        }
    }
}
