//! A client with its socket and session, and the admission of clients.

use std::os::fd::OwnedFd;
use std::time::{Duration, Instant};

use nix::unistd::Uid;
use rustix::event::PollFlags;
use rustix::io::Errno;
use rustix::net::{RecvFlags, SendFlags, recv, send};

use super::permission::{Peer, user_name};
use super::session::{Host, Session};
use crate::protocol::{ClientStats, NOT_AVAILABLE};

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

/// Checks of [`SilentClients`] that a client may take for its `hello`: 5 s at 50 ms each.
const MAX_SILENT_CHECKS: u32 = 100;
/// User ID of a client whose user the system does not report.
pub(crate) const UNKNOWN_USER: u32 = u32::MAX;

/// Places of a service. One place is for root and the user of the service, and another user has at most half
/// of the places: no user locks all others out.
#[derive(Debug)]
pub(crate) struct Admission {
    pub(crate) max_clients: usize,
    owner: u32,
    rejected: IncidentLog,
    silent: IncidentLog,
    broken: IncidentLog,
}

impl Admission {
    pub(crate) fn new(max_clients: usize) -> Self {
        Self {
            max_clients,
            owner: Uid::effective().as_raw(),
            rejected: IncidentLog::new("rejected clients"),
            silent: IncidentLog::new("clients without a hello"),
            broken: IncidentLog::new("clients that broke the protocol"),
        }
    }

    /// Checks whether another client has a place; `users` are those of the connected ones.
    pub(crate) fn check(&self, user: u32, users: impl Iterator<Item = u32>) -> Result<(), String> {
        let (mut all, mut own) = (0, 0);
        for other in users {
            all += 1;
            own += usize::from(other == user);
        }
        let max = self.max_clients;
        if all >= max {
            return Err(format!("{all} clients are connected; close one, or raise max_clients"));
        }
        if [0, self.owner].contains(&user) || max < 2 {
            return Ok(());
        }
        if own >= max / 2 {
            return Err(format!(
                "user {} has {own} connections; allowed: {}, half of max_clients; close one, or raise \
                 max_clients",
                user_name(user),
                max / 2
            ));
        }
        if all + 1 >= max {
            return Err(format!(
                "{all} clients are connected, and the last place is for root and user {}; close one, or \
                 raise max_clients",
                user_name(self.owner)
            ));
        }
        Ok(())
    }

    /// Logs a client that has no place.
    pub(crate) fn log_rejection(&mut self, peer: Option<Peer>, reason: &str) {
        let process = peer.map_or(0, |peer| peer.pid);
        self.rejected.report(format!("client of process {process} rejected: {reason}"));
    }

    /// Ends the clients that sent no `hello` in time and returns their number. Called in a fixed interval: a
    /// service that was stopped counts one check.
    pub(crate) fn end_silent<'a>(&mut self, clients: impl Iterator<Item = &'a mut Client>) -> u64 {
        let mut ended = 0;
        for client in clients.filter(|client| !client.session.has_hello()) {
            client.silent_checks += 1;
            if client.silent_checks < MAX_SILENT_CHECKS || client.session.is_ended() {
                continue;
            }
            ended += 1;
            let process = client.peer.map_or(0, |peer| peer.pid);
            let text = "no hello within 5 s; send hello first";
            client.session.end(NOT_AVAILABLE, text.into());
            client.session.take_end();
            let number = client.session.id;
            self.silent.report(format!("client {number} (process {process}) ended: {text}"));
        }
        ended
    }

    /// Logs clients that broke the protocol.
    pub(crate) fn log_ends<'a>(&mut self, clients: impl Iterator<Item = &'a mut Client>) {
        for session in clients.map(|client| &mut client.session) {
            let (number, name) = (session.id, session.name.clone());
            if let Some(text) = session.take_end() {
                self.broken.report(format!("client {number} ({name}) disconnected: {text}"));
            }
        }
    }

    /// Ends the incidents that did not continue. Called once per second.
    pub(crate) fn end_incidents(&mut self) {
        self.logs().for_each(IncidentLog::end_interval);
    }

    /// The incidents that were logged since the last call.
    pub(crate) fn take_incidents(&mut self) -> impl Iterator<Item = String> {
        self.logs().filter_map(|log| log.last.take())
    }

    fn logs(&mut self) -> impl Iterator<Item = &mut IncidentLog> {
        [&mut self.rejected, &mut self.silent, &mut self.broken].into_iter()
    }
}

/// Log of an event that another program can repeat at will: its first time, and the number of repetitions
/// once it pauses.
#[derive(Debug)]
struct IncidentLog {
    subject: &'static str,
    is_active: bool,
    is_seen: bool,
    repetitions: u64,
    /// Text that was logged and not taken.
    last: Option<String>,
}

impl IncidentLog {
    const fn new(subject: &'static str) -> Self {
        Self { subject, is_active: false, is_seen: false, repetitions: 0, last: None }
    }

    fn report(&mut self, text: String) {
        if std::mem::replace(&mut self.is_active, true) {
            self.repetitions += 1;
        } else {
            self.log(text);
        }
        self.is_seen = true;
    }

    fn log(&mut self, text: String) {
        tracing::warn!("service: {text}");
        self.last = Some(text);
    }

    fn end_interval(&mut self) {
        if std::mem::take(&mut self.is_seen) || !std::mem::take(&mut self.is_active) {
            return;
        }
        let repetitions = std::mem::take(&mut self.repetitions);
        if repetitions > 0 {
            self.log(format!("{}: {repetitions} further ones since the first", self.subject));
        }
    }
}

#[cfg(test)]
mod tests {
    use ecan_protocol::can::{CanFrame, CanId};

    use super::*;
    use crate::protocol::{Access, FrameEvent, FrameReport};
    use crate::server::config::Permission;
    use crate::server::job_queue::Requester;

    /// The service waits until the client reads, and does not block meanwhile.
    #[test]
    fn client_that_does_not_read_is_polled_for_output() {
        let (service, client) = std::os::unix::net::UnixStream::pair().unwrap();
        let permission = Permission { access: Access::Read, reason: None };
        let session = Session::new(Requester { client: 1, user: 0 }, permission, 4 << 20, 1);
        let mut client_of_service = Client::new(service.into(), session, None);
        assert_eq!(client_of_service.poll_flags(), PollFlags::IN);
        let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[0; 8]).unwrap();
        let event = FrameEvent::Received;
        let report = FrameReport { time_ns: 0, gateway: 0, channel: 0, tag: 0, event, frame };
        (0..50_000).for_each(|_| client_of_service.session.output.push_frame(&report));
        client_of_service.write();
        assert!(!client_of_service.session.output.pending().is_empty(), "the socket is full");
        assert_eq!(client_of_service.poll_flags(), PollFlags::IN | PollFlags::OUT);
        drop(client);
        client_of_service.write();
        assert!(client_of_service.is_over());
    }

    fn check(admission: &Admission, user: u32, users: &[(u32, usize)]) -> Result<(), String> {
        let users = users.iter().flat_map(|(user, count)| std::iter::repeat_n(*user, *count));
        admission.check(user, users)
    }

    #[test]
    fn users_leave_places_to_each_other_and_to_the_owner() {
        let admission = Admission { owner: 900, ..Admission::new(64) };
        assert_eq!(check(&admission, 1, &[(1, 31), (2, 31)]), Ok(()));
        let error = check(&admission, 1, &[(1, 32)]).unwrap_err();
        assert!(error.contains("has 32 connections; allowed: 32"), "{error}");
        assert_eq!(check(&admission, 3, &[(1, 32)]), Ok(()));
        let full = [(1, 32), (2, 31)];
        let error = check(&admission, 3, &full).unwrap_err();
        assert!(error.contains("the last place is for root and user 900"), "{error}");
        for user in [0, 900] {
            assert_eq!(check(&admission, user, &full), Ok(()));
            let error = check(&admission, user, &[(1, 32), (2, 32)]).unwrap_err();
            assert!(error.starts_with("64 clients are connected"), "{error}");
            assert_eq!(
                check(&admission, user, &[(user, 63)]),
                Ok(()),
                "without a limit of its own"
            );
        }
        assert_eq!(check(&Admission { owner: 900, ..Admission::new(1) }, 5, &[]), Ok(()));
    }

    #[test]
    fn repeated_incident_is_counted_until_it_pauses() {
        let mut log = IncidentLog::new("incidents");
        (0..5).for_each(|_| log.report("one".to_owned()));
        log.end_interval();
        assert!(log.is_active && log.repetitions == 4);
        log.end_interval();
        assert!(!log.is_active && log.repetitions == 0);
    }
}
