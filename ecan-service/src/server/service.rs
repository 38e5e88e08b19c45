//! A running service: its configuration, its start on a Port, and what its threads share.

use super::admission::{AccessRule, Admission};
use super::bus::{Bus, BusView, nanoseconds};
use super::frame_feed::FrameFeed;
use super::listener::Listener;
use super::metrics::{MetricsAddress, MetricsConfig, MetricsSample, MetricsServer};
use super::server_loop::{Limits, ServerLoop};
use super::workers::Extension;
use super::workers::{Waker, Workers};
use crate::protocol::{
    Access, ActiveConfig, Channel, DEFAULT_MAX_AGE_MS, Gateway, Hello, PROTOCOL_VERSION, Response,
    ServiceStats,
};
use ecan_host::{AdapterConfig, Clock, Ecrt};
use ecan_mcan_port::{GatewayConfig, Port};
use ecan_protocol::image::OptionFlags;
use ecan_protocol::mapping::Direction;
use ecan_protocol::text::Printable;
use serde_json::Value;
use std::net::SocketAddr;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};
use std::{fmt, io, thread};
use thiserror::Error;

const MIN_QUEUE_BYTES: usize = 8192;

/// Service of a bus for other programs, on threads of its own. Dropping it closes the connections,
/// removes the socket and ends the threads; it waits for requests in progress for up to 2 s.
#[derive(Debug)]
pub struct Service {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    /// Ends before the thread of the service, which answers it.
    metrics: Option<MetricsServer>,
    path: PathBuf,
    ring_bytes: usize,
    queue_depth: usize,
}

impl Service {
    /// Starts a service on a bus without a cycle: state and SDO transfers only, until
    /// [`attach`](Self::attach). Blocks shortly; not for the cycle.
    ///
    /// # Errors
    /// [`ServiceError`]: the socket is in use or cannot be created.
    pub fn of_bus(
        ecrt: &Ecrt,
        master_index: u32,
        mut config: ServiceConfig,
    ) -> Result<Self, ServiceError> {
        if config.queue_bytes < MIN_QUEUE_BYTES {
            return Err(ServiceError::QueueBytes(config.queue_bytes));
        }
        let access = AccessRule::new(config.control.clone())?;
        let listener = Listener::open(&mut config)?;
        let waker = Waker::new().map_err(|error| ServiceError::Thread(error.into()))?;
        let workers = Workers::start(ecrt, master_index, &config.extensions, &waker)
            .map_err(ServiceError::Thread)?;
        let hello = Hello {
            version: PROTOCOL_VERSION,
            server: config.name,
            server_version: config.version,
            pid: std::process::id(),
            master: master_index,
            is_simulated: ecrt.is_simulated(),
            is_free_running: ecrt.clock().is_free_running(),
            access: Access::Read,
            access_reason: None,
            cycle_ns: None,
            window: config.window,
            max_age_ms: DEFAULT_MAX_AGE_MS,
            gateways: Vec::new(),
        };
        let clock = ecrt.clock().clone();
        let bus = Bus { hello, cycle: None, clock, workers, stats: ServiceStats::default() };
        let shared = Arc::new(Shared::new(waker));
        let socket = (config.mode, config.group.as_deref());
        let metrics = config
            .metrics
            .map(|metrics| MetricsServer::start(&metrics, socket, &shared, ecrt, master_index));
        let metrics = metrics.transpose()?;
        let limits = Limits { queue_bytes: config.queue_bytes, window: config.window };
        let admission = Admission::new(config.max_clients);
        let server = ServerLoop::new(listener, shared.clone(), access, bus, (admission, limits));
        let thread = spawn(server).map_err(ServiceError::Thread)?;
        Ok(Self {
            shared,
            thread: Some(thread),
            metrics,
            path: config.path,
            ring_bytes: config.ring_bytes,
            queue_depth: config.window.max(1) as usize * 4,
        })
    }

    /// Serves the cycle of a Port: frames, images, state, configuration. Call it again after
    /// [`Port::reconfigure`], or with another Port; clients get the notification `gateways`, and their
    /// frames without result end with a record. It takes the image stream and the transmit queues of the
    /// Port. Allocates; not for the cycle.
    pub fn attach(&self, port: &mut Port) {
        let attachment = Attachment::new(port, self.ring_bytes, self.queue_depth);
        self.shared.send(Update::Cycle(Some(Box::new(attachment))));
    }

    /// Stops serving a cycle; requests about the bus remain.
    pub fn detach(&self) {
        self.shared.send(Update::Cycle(None));
    }

    /// Sets the clients with control, also for connected ones. Their `hello` named the access before.
    ///
    /// # Errors
    /// [`ServiceError::NoSuchGroup`]; nothing is changed.
    pub fn set_control(&self, control: Control) -> Result<(), ServiceError> {
        self.shared.send(Update::Access(AccessRule::new(control)?));
        Ok(())
    }

    /// Sets the limit of clients. Connected clients stay.
    pub fn set_max_clients(&self, max_clients: usize) {
        self.shared.send(Update::MaxClients(max_clients));
    }

    /// Sends a notification to every client.
    pub fn notify(&self, method: impl Into<String>, params: Value) {
        self.shared.send(Update::Notify(method.into(), params));
    }

    /// Path of the socket.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Address of the metrics, with the port that the system has chosen for port 0.
    pub fn metrics_address(&self) -> Option<&MetricsAddress> {
        self.metrics.as_ref().map(MetricsServer::address)
    }
}

fn spawn(server: ServerLoop) -> io::Result<JoinHandle<()>> {
    thread::Builder::new().name("ecan service".into()).spawn(move || server.run())
}

impl Drop for Service {
    fn drop(&mut self) {
        self.metrics = None;
        self.shared.stop();
        if let Some(thread) = self.thread.take() {
            // A panic in it was reported on standard error.
            let _ = thread.join();
        }
    }
}

/// Starts the service of a Port.
pub trait ServePort {
    /// Starts a service with the cycle of this Port; it ends when it is dropped. The cycle only writes
    /// to bounded memory and never waits for the service. Call [`Service::attach`] after a
    /// reconfiguration. Blocks shortly; not for the cycle.
    ///
    /// ```no_run
    /// use ecan_service::server::{ServePort as _, ServiceConfig};
    ///
    /// # fn run(port: &mut ecan_mcan_port::Port) -> Result<(), ecan_service::server::ServiceError> {
    /// let _service = port.serve(ServiceConfig::new("/run/ecan/master0.sock"))?;
    /// # Ok(()) }
    /// ```
    ///
    /// # Errors
    /// As [`Service::of_bus`].
    fn serve(&mut self, config: ServiceConfig) -> Result<Service, ServiceError>;
}

impl ServePort for Port {
    fn serve(&mut self, config: ServiceConfig) -> Result<Service, ServiceError> {
        let ecrt = self.adapter().ecrt().clone();
        let service = Service::of_bus(&ecrt, self.adapter().config().master_index, config)?;
        service.attach(self);
        Ok(service)
    }
}

/// Clients with control: they send frames, download SDOs and call the controlling methods of
/// extensions. All other clients that may open the socket only read.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Control {
    /// No client.
    #[default]
    Nobody,
    /// The user of the service, and root.
    Owner,
    /// Members of a group, the user of the service, and root.
    Group(String),
    /// Every client.
    Everyone,
}

/// Configuration of a [`Service`](super::Service).
#[derive(Debug)]
pub struct ServiceConfig {
    /// Path of the socket. The service creates its directory, but not the directories above.
    pub path: PathBuf,
    /// Permissions of the socket; 0o660 by default. Clients need write permission.
    pub mode: u32,
    /// Group of the socket; `None` for that of the process.
    pub group: Option<String>,
    /// Clients with control; by default none.
    pub control: Control,
    /// Most clients at a time; 64 by default. The last place is for root and the user of the service;
    /// each other user has at most half of the places.
    pub max_clients: usize,
    /// Bytes of frames and images that wait for one client; 1 MiB by default. A client that reads too
    /// slowly loses what exceeds it.
    pub queue_bytes: usize,
    /// Bytes of the ring between the cycle and the service; 4 MiB by default.
    pub ring_bytes: usize,
    /// Frames of one client and channel that may be without result; 64 by default.
    pub window: u32,
    /// Name of the program, for clients and messages.
    pub name: String,
    /// Version of the program, for clients.
    pub version: String,
    /// Methods of the program.
    pub extensions: Vec<Arc<dyn Extension>>,
    /// A socket that listens already, for example one of systemd. Its file and permissions are not the
    /// service's; `path` is for messages only.
    pub listener: Option<UnixListener>,
    /// Metrics for Prometheus; by default none.
    pub metrics: Option<MetricsConfig>,
}

impl ServiceConfig {
    /// Creates a read-only service at `path`, with the defaults above.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            mode: 0o660,
            group: None,
            control: Control::Nobody,
            max_clients: 64,
            queue_bytes: 1 << 20,
            ring_bytes: 4 << 20,
            window: 64,
            name: "application".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            extensions: Vec::new(),
            listener: None,
            metrics: None,
        }
    }

    /// Sets the clients with control.
    #[must_use]
    pub fn with_control(mut self, control: Control) -> Self {
        self.control = control;
        self
    }

    /// Sets name and version of the program.
    #[must_use]
    pub fn with_name(mut self, name: impl Into<String>, version: impl Into<String>) -> Self {
        (self.name, self.version) = (name.into(), version.into());
        self
    }

    /// Adds methods of the program.
    #[must_use]
    pub fn with_extension(mut self, extension: impl Extension + 'static) -> Self {
        self.extensions.push(Arc::new(extension));
        self
    }

    /// Serves metrics, on a thread of their own.
    #[must_use]
    pub fn with_metrics(mut self, metrics: MetricsConfig) -> Self {
        self.metrics = Some(metrics);
        self
    }
}

/// Longest path of the socket, in bytes: 107 (`sun_path` without its terminating 0), less the suffix of
/// its random name before it is moved to the path.
pub(crate) const MAX_SOCKET_PATH: usize = 99;

/// Error of the start of a service.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ServiceError {
    /// Another service listens at the path.
    #[error(
        "socket {} is in use by {}; stop that service or set another path",
        Printable(path.display()), Process(*pid)
    )]
    InUse {
        /// Path of the socket.
        path: PathBuf,
        /// Process that listens, if the system names it.
        pid: Option<u32>,
    },
    /// A file at the path is not a socket.
    #[error("{} is not a socket; remove it or set another path", Printable(path.display()))]
    NotSocket {
        /// The path.
        path: PathBuf,
    },
    /// Linux does not allow longer paths of sockets.
    #[error(
        "socket path of {} bytes is too long: {}; allowed: at most {MAX_SOCKET_PATH}; set another path",
        path.as_os_str().len(), Printable(path.display())
    )]
    PathTooLong {
        /// The path.
        path: PathBuf,
    },
    /// The socket cannot be created.
    #[error("cannot create socket {}: {what}: {source}", Printable(path.display()))]
    Socket {
        /// Path of the socket.
        path: PathBuf,
        /// The step that failed.
        what: &'static str,
        /// Error of the system.
        source: io::Error,
    },
    /// No such group.
    #[error(
        "group \"{group}\" does not exist; create it (groupadd --system {group}) or set another group",
        group = Printable(.0)
    )]
    NoSuchGroup(String),
    /// The queue of a client is too small for one image.
    #[error("client queue of {0} bytes is out of range; allowed: at least 8192")]
    QueueBytes(usize),
    /// Other hosts reach the address of the metrics.
    #[error(
        "metrics address {0} is not a loopback address; allowed: 127.0.0.1, [::1] or unix:PATH; the \
         metrics have no access control, permit other hosts with allows_remote (--metrics-remote)"
    )]
    RemoteMetrics(SocketAddr),
    /// The address of the metrics cannot be used.
    #[error("cannot listen at metrics address {address}: {source}; {}", metrics_remedy(source))]
    MetricsAddress {
        /// The address.
        address: SocketAddr,
        /// Error of the system.
        source: io::Error,
    },
    /// The thread cannot be started.
    #[error("cannot start the service's thread: {0}")]
    Thread(io::Error),
}

/// Action after a failed listen at a TCP address.
fn metrics_remedy(source: &io::Error) -> &'static str {
    if source.raw_os_error() == Some(rustix::io::Errno::AFNOSUPPORT.raw_os_error()) {
        // The unit of `ecan serve` permits Unix sockets only.
        "a unit of systemd denies TCP by RestrictAddressFamilies: install the drop-in metrics-tcp.conf \
         (docs/SERVICE.md), or set unix:PATH"
    } else {
        "set another address"
    }
}

struct Process(Option<u32>);

impl fmt::Display for Process {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(pid) => write!(f, "process {pid}"),
            None => f.write_str("another process"),
        }
    }
}

/// Parts of a service that belong to one configuration of a Port.
#[derive(Debug)]
pub(crate) struct Attachment {
    pub(crate) feed: FrameFeed,
    pub(crate) view: BusView,
    pub(crate) cycle_ns: u64,
    pub(crate) gateways: Vec<Gateway>,
    pub(crate) config: ActiveConfig,
    pub(crate) adapter: AdapterConfig,
}

impl Attachment {
    pub(crate) fn new(port: &mut Port, ring_bytes: usize, queue_depth: usize) -> Self {
        let stream = port.image_stream(ring_bytes);
        let queues = port.transmit_queues(queue_depth);
        let since_1970_ns = since_1970_ns(port.adapter().clock());
        let gateways = gateways(port.adapter().config(), &port.config().gateways);
        let has_results = gateways.iter().map(|gateway| gateway.has_results);
        let feed = FrameFeed::new(stream, queues, has_results, since_1970_ns);
        let view = BusView::new(&port.adapter().observer(), since_1970_ns);
        // infallible: plain data
        let config = ActiveConfig {
            adapter: serde_json::to_value(port.adapter().config()).unwrap_or_default(),
            port: serde_json::to_value(port.config()).unwrap_or_default(),
        };
        let cycle_ns = nanoseconds(port.adapter().config().cycle);
        let adapter = *port.adapter().config();
        Self { feed, view, cycle_ns, gateways, config, adapter }
    }
}

/// Offset of a clock to the time since 1970; 0 for stepped time.
fn since_1970_ns(clock: &dyn Clock) -> u64 {
    if !clock.is_free_running() {
        return 0;
    }
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    nanoseconds(since).wrapping_sub(clock.now_ns())
}

fn gateways<'a>(
    adapter: &AdapterConfig,
    gateways: impl IntoIterator<Item = &'a GatewayConfig>,
) -> Vec<Gateway> {
    let gateway = |(slave, config): (&ecan_host::SlaveConfig, &GatewayConfig)| Gateway {
        alias: slave.alias,
        position: slave.position,
        has_results: config.tx_options.contains(OptionFlags::TX_RESULT),
        channels: (0_u8..)
            .zip(&config.channels)
            .filter_map(|(channel, found)| {
                let can = &found.as_ref()?.can;
                Some(Channel {
                    channel,
                    bitrate: can.nominal_bitrate,
                    data_bitrate: can.fd.then_some(can.data_bitrate),
                    receives: config.carries(Direction::TxPdo, channel),
                    sends: config.carries(Direction::RxPdo, channel),
                })
            })
            .collect(),
    };
    adapter.slaves.iter().zip(gateways).map(gateway).collect()
}

/// Time that the thread of the service has for a sample.
const SAMPLE_LIMIT: Duration = Duration::from_secs(2);

/// Change of a running service.
#[derive(Debug)]
pub(crate) enum Update {
    /// A Port runs the cycle, or none.
    Cycle(Option<Box<Attachment>>),
    /// Another rule for all clients.
    Access(AccessRule),
    /// Another limit of clients.
    MaxClients(usize),
    /// A notification for every client.
    Notify(String, Value),
    /// A request for a sample of everything that metrics show.
    Metrics(SyncSender<MetricsSample>),
}

#[derive(Debug)]
pub(crate) struct Shared {
    is_stopped: AtomicBool,
    updates: Mutex<Vec<Update>>,
    waker: Waker,
}

impl Shared {
    pub(crate) fn new(waker: Waker) -> Self {
        Self { is_stopped: AtomicBool::new(false), updates: Mutex::default(), waker }
    }

    pub(crate) fn waker(&self) -> &Waker {
        &self.waker
    }

    pub(crate) fn is_stopped(&self) -> bool {
        self.is_stopped.load(Ordering::Acquire)
    }

    pub(crate) fn stop(&self) {
        self.is_stopped.store(true, Ordering::Release);
        self.waker.wake();
    }

    pub(crate) fn send(&self, update: Update) {
        self.updates.lock().unwrap_or_else(PoisonError::into_inner).push(update);
        self.waker.wake();
    }

    /// Everything that metrics show, from the thread of the service; `None` if it does not answer.
    pub(crate) fn metrics_sample(&self) -> Option<MetricsSample> {
        let (sender, receiver) = sync_channel(1);
        self.send(Update::Metrics(sender));
        receiver.recv_timeout(SAMPLE_LIMIT).ok()
    }

    pub(crate) fn take_updates(&self) -> Vec<Update> {
        std::mem::take(&mut self.updates.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

pub(crate) fn notification(method: &str, params: &impl serde::Serialize) -> Response {
    Response::notification(method, serde_json::to_value(params).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn denied_address_family_names_the_drop_in() {
        let text = |errno: rustix::io::Errno| {
            let address = "127.0.0.1:9464".parse().unwrap();
            ServiceError::MetricsAddress { address, source: errno.into() }.to_string()
        };
        let denied = text(rustix::io::Errno::AFNOSUPPORT);
        assert!(
            denied.contains("127.0.0.1:9464") && denied.contains("metrics-tcp.conf"),
            "{denied}"
        );
        assert!(text(rustix::io::Errno::ADDRINUSE).ends_with("; set another address"));
    }
}
