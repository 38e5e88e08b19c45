//! The service's thread: clients, frames of the cycle, responses of the workers.

use std::collections::BTreeMap;
use std::os::fd::{AsFd as _, OwnedFd};
use std::sync::Arc;
use std::time::Duration;

use ecan_mcan_port::LossWatch;
use ecan_protocol::mapping::Direction;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::net::{SendFlags, send};
use serde_json::Value;

use super::bus::Attachment;
use super::bus_view::{LOSS_INTERVAL, nanoseconds};
use super::client::{Admission, UNKNOWN_USER};
use super::listener::enter_background;
use crate::protocol::{
    BUSY, FrameReport, GatewaysChanged, ImageDirection, ImageMessage, MessageKind, RecordedKind,
    Response, RpcError, ServiceStats, header,
};
use crate::server::bus::Bus;
use crate::server::client::Client;
use crate::server::frame_feed::{FeedSink, Owner};
use crate::server::job_queue::{ClientId, Requester};
use crate::server::listener::Listener;
use crate::server::permission::{AccessRule, Peer};
use crate::server::session::Session;
use crate::server::shared::{Shared, Update, notification};
use crate::server::workers::{Done, time_since_boot};

/// Interval of reading the cycle's ring while a client needs it.
const ACTIVE_INTERVAL: Duration = Duration::from_millis(1);
/// Interval of sampling the cycle, and longest wait: a longer one means that the service was stopped.
const SAMPLE_INTERVAL: Duration = Duration::from_millis(50);
/// Interval of checking the socket file.
const CHECK_INTERVAL: Duration = Duration::from_secs(1);
/// Delay of a wait beyond which bytes may have arrived at its start.
const STOPPED_DELAY: Duration = Duration::from_millis(100);
const READ_BYTES: usize = 64 << 10;

/// Limits of a service.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    pub(crate) queue_bytes: usize,
    pub(crate) window: u32,
}

pub(crate) struct ServerLoop {
    listener: Listener,
    shared: Arc<Shared>,
    access: AccessRule,
    bus: Bus,
    limits: Limits,
    admission: Admission,
    clients: Clients,
    /// Descriptor that is closed to accept, and reject, a client when there is no other one.
    reserve: Option<OwnedFd>,
    /// Conditions that were logged.
    has_no_descriptor: bool,
    cannot_restore: bool,
    /// Frames that were lost for all clients.
    losses: LossWatch,
}

/// The clients, as receivers of frames.
#[derive(Debug, Default)]
struct Clients {
    all: BTreeMap<ClientId, Client>,
    /// Without the list of clients, and the requests of the connected ones.
    stats: ServiceStats,
}

impl ServerLoop {
    pub(crate) fn new(
        listener: Listener,
        shared: Arc<Shared>,
        access: AccessRule,
        bus: Bus,
        (admission, limits): (Admission, Limits),
    ) -> Self {
        Self {
            listener,
            shared,
            access,
            bus,
            limits,
            admission,
            clients: Clients::default(),
            reserve: open_reserve(),
            has_no_descriptor: false,
            cannot_restore: false,
            losses: LossWatch::new(0, LOSS_INTERVAL),
        }
    }

    pub(crate) fn run(mut self) {
        enter_background();
        let mut buffer = vec![0; READ_BYTES];
        let (mut next_check, mut next_sample) = (time_since_boot(), time_since_boot());
        while !self.shared.is_stopped() {
            for update in self.shared.take_updates() {
                self.apply(update);
            }
            while let Some(Done { client, id, result }) = self.bus.workers.next_done() {
                if let Some(client) = self.clients.all.get_mut(&client) {
                    client.session.respond_later(id, result);
                }
            }
            let now = time_since_boot();
            if now >= next_sample {
                next_sample = now + SAMPLE_INTERVAL;
                let clients = self.clients.all.values_mut();
                self.clients.stats.clients_silent += self.admission.end_silent(clients);
                self.bus.cycle.iter_mut().for_each(|cycle| cycle.view.sample());
                self.record_changes();
            }
            if now >= next_check {
                next_check = now + CHECK_INTERVAL;
                self.check_socket();
                self.admission.end_incidents();
            }
            let wait = self.drain();
            self.admission.log_ends(self.clients.all.values_mut());
            let incidents = self.admission.take_incidents();
            incidents.for_each(|text| self.bus.record(RecordedKind::Client, text));
            self.clients.all.values_mut().for_each(Client::write);
            self.remove_clients();
            self.serve(wait, &mut buffer);
        }
        self.close();
    }

    /// Notifies the clients of changes of the cycle, and records these.
    fn record_changes(&mut self) {
        let Self { bus, clients, .. } = self;
        let cycle = bus.cycle.as_mut();
        let changes = cycle.map(|cycle| cycle.view.changes(&mut bus.events)).unwrap_or_default();
        for change in changes {
            clients.notify(&notification("channel", &change));
        }
        let now_ns = nanoseconds(time_since_boot());
        if let Some(frames) = self.losses.next(clients.stats.frames_lost_in_ring, now_ns) {
            let text = format!("{frames} frames lost for all clients: the service was late");
            bus.record(RecordedKind::Losses, text);
        }
    }

    fn apply(&mut self, update: Update) {
        match update {
            Update::Cycle(cycle) => {
                self.record_changes();
                match (&self.bus.cycle, &cycle) {
                    (_, Some(cycle)) => {
                        let (us, gateways) = (cycle.cycle_ns / 1000, cycle.gateways.len());
                        let text = format!("cycle of {us} us, gateways: {gateways}");
                        self.bus.record(RecordedKind::Cycle, text);
                    }
                    (Some(_), None) => {
                        self.bus.record(RecordedKind::Cycle, "the cycle has ended".to_owned());
                    }
                    (None, None) => {}
                }
                if let Some(old) = &mut self.bus.cycle {
                    old.feed.close(&mut self.clients);
                }
                self.bus.set_cycle(cycle);
                let hello = &self.bus.hello;
                let (cycle_ns, gateways) = (hello.cycle_ns, hello.gateways.clone());
                let changed = GatewaysChanged { cycle_ns, gateways };
                self.clients.notify(&notification("gateways", &changed));
            }
            Update::Access(access) => {
                for client in self.clients.all.values_mut() {
                    client.session.set_permission(access.permission(client.peer));
                }
                self.access = access;
            }
            Update::MaxClients(max_clients) => self.admission.max_clients = max_clients,
            Update::Metrics(reply) => {
                let requests_pending = self.bus.workers.pending();
                let stats = ServiceStats { requests_pending, ..self.clients.stats() };
                let clients = self.clients.all.len();
                // The thread of the metrics may no longer wait.
                let _ = reply.send(self.bus.metrics_sample(stats, clients));
            }
            Update::Record(text) => self.bus.record(RecordedKind::Program, text),
            Update::Notify(method, params) => {
                self.clients.notify(&Response::notification(&method, params));
            }
        }
    }

    /// Delivers what the cycle wrote; returns the time until it is read again.
    fn drain(&mut self) -> Duration {
        let is_needed = self.clients.all.values().any(|client| client.session.needs_images());
        let Some(cycle) = &mut self.bus.cycle else { return SAMPLE_INTERVAL };
        let Attachment { feed, view, .. } = &mut **cycle;
        if feed.drain(is_needed, view, &mut self.clients) {
            return Duration::ZERO;
        }
        if cycle.feed.is_active() { ACTIVE_INTERVAL } else { SAMPLE_INTERVAL }
    }

    /// Waits for clients, workers or the time, and reads what clients sent.
    fn serve(&mut self, wait: Duration, buffer: &mut [u8]) {
        let waker = self.shared.waker();
        let mut fds =
            vec![PollFd::new(waker, PollFlags::IN), PollFd::new(&self.listener, PollFlags::IN)];
        let clients = self.clients.all.values();
        fds.extend(clients.map(|client| PollFd::new(&client.socket, client.poll_flags())));
        let timeout = Timespec::try_from(wait).ok();
        let start = time_since_boot();
        if poll(&mut fds, timeout.as_ref()).is_err() {
            return;
        }
        let end = time_since_boot();
        // A service that was stopped, or its machine, finds bytes that arrived long ago.
        let arrival = if end > start + wait + STOPPED_DELAY { start } else { end };
        let ready: Vec<_> = fds.iter().map(PollFd::revents).collect();
        if ready.first().is_some_and(|flags| !flags.is_empty()) {
            waker.clear();
        }
        let has_new = ready.get(1).is_some_and(|flags| !flags.is_empty());
        let with_input = ready.iter().skip(2).any(|flags| flags.contains(PollFlags::IN));
        if with_input {
            let clients = self.clients.all.values().map(Client::statistics).collect();
            self.bus.stats = ServiceStats { clients, ..self.clients.stats() };
        }
        for (client, flags) in self.clients.all.values_mut().zip(ready.iter().skip(2)) {
            if flags.contains(PollFlags::IN) {
                client.read(buffer, arrival, &mut self.bus);
                continue;
            }
            client.end_unread();
            if flags.intersects(PollFlags::ERR | PollFlags::HUP) {
                client.hang_up();
            }
        }
        if has_new {
            self.accept();
        }
    }

    fn accept(&mut self) {
        match self.listener.accept() {
            Ok(socket) => {
                self.has_no_descriptor = false;
                self.admit(socket);
            }
            Err(error @ (Errno::MFILE | Errno::NFILE)) => {
                if !std::mem::replace(&mut self.has_no_descriptor, true) {
                    tracing::error!("service: cannot accept clients: {error}; raise RLIMIT_NOFILE");
                }
                self.reserve = None;
                // Without a descriptor the socket stays readable, and the loop would not wait.
                match self.listener.accept() {
                    Ok(socket) => self.reject(&socket, "the service has no free file descriptor"),
                    Err(_) => std::thread::sleep(SAMPLE_INTERVAL),
                }
                self.reserve = open_reserve();
            }
            // A client that has left.
            Err(_) => {}
        }
    }

    fn admit(&mut self, socket: OwnedFd) {
        let Limits { queue_bytes, window } = self.limits;
        let peer = Peer::of(&socket);
        let user = peer.map_or(UNKNOWN_USER, |peer| peer.uid);
        let users = self.clients.all.values().map(|client| client.session.user);
        if let Err(reason) = self.admission.check(user, users) {
            self.admission.log_rejection(peer, &reason);
            return self.reject(&socket, &reason);
        }
        let permission = self.access.permission(peer);
        self.clients.stats.clients_accepted += 1;
        let id = self.clients.stats.clients_accepted;
        let requester = Requester { client: id, user };
        let session = Session::new(requester, permission, queue_bytes, window);
        self.clients.all.insert(id, Client::new(socket, session, peer));
    }

    /// Removes the clients whose connection ended, with their requests that wait.
    fn remove_clients(&mut self) {
        let Self { clients: Clients { all, stats }, bus, .. } = self;
        all.retain(|id, client| {
            let is_over = client.is_over();
            if is_over {
                stats.requests_cancelled += bus.workers.cancel(*id) as u64;
                client.session.counters.add_to(stats);
                let session = &client.session;
                let lost = session.output.counters.frames_lost;
                if lost > 0 {
                    let name = &session.name;
                    let text =
                        format!("client {id} ({name}) lost {lost} frames: it read too slowly");
                    bus.record(RecordedKind::Client, text);
                }
            }
            !is_over
        });
    }

    /// Sends the reason, as far as the socket takes it, and closes the connection.
    fn reject(&mut self, socket: &OwnedFd, reason: &str) {
        self.clients.stats.clients_rejected += 1;
        let response = Response::error(Value::Null, RpcError::new(BUSY, reason));
        let payload = serde_json::to_vec(&response).unwrap_or_default();
        let mut message = header(MessageKind::Rpc, payload.len()).to_vec();
        message.extend_from_slice(&payload);
        let _ = send(socket.as_fd(), &message, SendFlags::DONTWAIT | SendFlags::NOSIGNAL);
    }

    fn check_socket(&mut self) {
        match self.listener.restore() {
            Ok(is_new) => {
                self.cannot_restore = false;
                if is_new {
                    tracing::warn!("service: socket file was removed; created again");
                }
            }
            Err(error) if !std::mem::replace(&mut self.cannot_restore, true) => {
                tracing::error!("service: socket file was removed: {error}");
            }
            Err(_) => {}
        }
    }

    /// Ends every connection, with what the clients take.
    fn close(&mut self) {
        if let Some(Attachment { feed, .. }) = self.bus.cycle.as_deref_mut() {
            feed.close(&mut self.clients);
        }
        self.clients.all.values_mut().for_each(Client::write);
    }
}

fn open_reserve() -> Option<OwnedFd> {
    rustix::fs::open("/dev/null", OFlags::RDONLY | OFlags::CLOEXEC, Mode::empty()).ok()
}

impl Clients {
    /// Counters of all clients, also of those that left.
    fn stats(&self) -> ServiceStats {
        let mut stats = self.stats.clone();
        self.all.values().for_each(|client| client.session.counters.add_to(&mut stats));
        stats
    }

    fn notify(&mut self, notification: &Response) {
        for client in self.all.values_mut() {
            client.session.notify(notification);
        }
    }
}

impl FeedSink for Clients {
    fn frame(&mut self, report: &FrameReport, owner: Option<Owner>) {
        self.stats.frames += 1;
        let other = FrameReport { tag: 0, ..*report };
        for (id, client) in &mut self.all {
            match owner {
                Some((owner, _)) if owner == *id => client.session.deliver_own(report),
                _ => client.session.deliver(&other),
            }
        }
    }

    fn image(&mut self, image: ImageMessage<'_>) {
        let direction = match image.direction {
            Direction::TxPdo => ImageDirection::Received,
            Direction::RxPdo => ImageDirection::Published,
        };
        for client in self.all.values_mut() {
            let images = &client.session.images;
            if images.as_ref().is_some_and(|filter| filter.selects(image.gateway, direction)) {
                client.session.output.push_image(image);
            }
        }
    }

    fn lost(&mut self, images: u32, packets: u32) {
        self.stats.images_lost_in_ring += u64::from(images);
        self.stats.frames_lost_in_ring += u64::from(packets);
        for client in self.all.values_mut() {
            if client.session.frames.is_some() {
                client.session.output.lose_frames(packets.into());
            }
            if client.session.images.is_some() {
                client.session.output.lose_images(images);
            }
        }
    }
}
