//! A running service.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use ecan_host::Ecrt;
use ecan_mcan_port::Port;
use serde_json::Value;

use super::bus::Attachment;
use super::bus_view::EventLog;
use super::client::Admission;
use crate::protocol::{Access, DEFAULT_MAX_AGE_MS, Hello, PROTOCOL_VERSION, ServiceStats};
use crate::server::bus::Bus;
use crate::server::config::{Control, MetricsAddress, ServiceConfig, ServiceError};
use crate::server::listener::Listener;
use crate::server::metrics::{self, MetricsServer};
use crate::server::permission::AccessRule;
use crate::server::server_loop::{Limits, ServerLoop};
use crate::server::shared::{Shared, Update};
use crate::server::workers::{Waker, Workers};

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
        let (stats, events) = (ServiceStats::default(), EventLog::default());
        let bus = Bus { hello, cycle: None, clock, workers, stats, events };
        let shared = Arc::new(Shared::new(waker));
        let socket = (config.mode, config.group.as_deref());
        let metrics = config.metrics.map(|metrics| {
            let text = metrics::source(&metrics, &shared, ecrt, master_index)?;
            MetricsServer::start(&metrics, socket, text)
        });
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

    /// Records what happened in the program for the method `events`, for example why a cycle ended.
    pub fn record_event(&self, text: impl Into<String>) {
        self.shared.send(Update::Record(text.into()));
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
