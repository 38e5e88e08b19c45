//! Servers of a bridge: over TCP with one accepting thread and two threads for each client, and on a
//! pseudo-terminal.

use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use std::{fmt, io, thread};

use ecan_protocol::can::CanFrame;

use super::client_queue::{ClientQueue, Writer};
use super::clients::{ClientFrame, ClientId, Clients};
use super::config::{
    BridgeConfig, BridgeProtocol, BridgeStatistics, BusRates, Conditions, Uplink, count,
};
use super::connection;
use super::connection::{Connection, Terminal, TerminalLine};
use super::session::Session;

/// Interval of polling for a new client. Stopping does not wait for it.
const ACCEPT_INTERVAL: Duration = Duration::from_millis(10);

/// Reason why a bridge cannot start.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The address is not available.
    #[error("bridge cannot listen on {0}: {1}")]
    Listen(SocketAddr, io::Error),
    /// The thread cannot be started.
    #[error("no thread for the bridge on {0}: {1}")]
    Thread(SocketAddr, io::Error),
}

/// A listening bridge. Dropping it closes every connection and waits for its threads.
#[derive(Debug)]
pub struct BridgeServer {
    info: BridgeInfo,
    clients: Arc<Clients>,
    stop: Arc<AtomicBool>,
    acceptor: Option<JoinHandle<()>>,
}

impl BridgeServer {
    /// Starts to listen; clients may connect at once.
    ///
    /// # Errors
    /// The address is not available, or the thread cannot be started.
    pub fn listen(config: &BridgeConfig) -> Result<Self, ServerError> {
        let clients = Arc::new(Clients::new(config.queue, config.max_clients));
        let address = config.address;
        let listen = || {
            let listener = TcpListener::bind(address)?;
            listener.set_nonblocking(true)?;
            let address = listener.local_addr()?;
            Ok((listener, address))
        };
        let (listener, bound) = listen().map_err(|error| ServerError::Listen(address, error))?;
        let stop = Arc::new(AtomicBool::new(false));
        let acceptor = Acceptor {
            listener,
            protocol: config.protocol,
            bus: config.bus.clone(),
            handshake: (config.protocol == BridgeProtocol::Socketcand).then_some(config.handshake),
            clients: clients.clone(),
            stop: stop.clone(),
        };
        let acceptor = thread::Builder::new()
            .name(format!("bridge {}", bound.port()))
            .spawn(move || acceptor.run())
            .map_err(|error| ServerError::Thread(bound, error))?;
        let info =
            BridgeInfo { protocol: config.protocol, address: bound, clients: clients.clone() };
        Ok(Self { info, clients, stop, acceptor: Some(acceptor) })
    }

    /// Address and counters; remains valid after the server is dropped.
    pub fn info(&self) -> &BridgeInfo {
        &self.info
    }

    /// The clients.
    pub fn clients(&self) -> &Arc<Clients> {
        &self.clients
    }
}

impl Drop for BridgeServer {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        self.clients.close();
        if let Some(acceptor) = self.acceptor.take() {
            acceptor.thread().unpark();
            // A panic in it has been reported on stderr already.
            let _ = acceptor.join();
        }
    }
}

struct Acceptor {
    listener: TcpListener,
    protocol: BridgeProtocol,
    bus: Option<String>,
    handshake: Option<Duration>,
    clients: Arc<Clients>,
    stop: Arc<AtomicBool>,
}

impl Acceptor {
    fn run(self) {
        let mut clients: Vec<JoinHandle<()>> = Vec::new();
        while !self.stop.load(Ordering::Acquire) {
            clients.retain(|client| !client.is_finished());
            match self.listener.accept() {
                Ok((stream, _)) => clients.extend(self.admit(stream)),
                // No client, or one that has already left.
                Err(_) => thread::park_timeout(ACCEPT_INTERVAL),
            }
        }
        for client in clients {
            let _ = client.join();
        }
    }

    /// Starts the threads of a client. If there are too many clients or no thread is available, its
    /// connection is closed.
    fn admit(&self, stream: TcpStream) -> Option<JoinHandle<()>> {
        let queue = Arc::new(ClientQueue::new(self.clients.queue()));
        let admit = || -> io::Result<Option<(Connection, ClientId)>> {
            stream.set_nonblocking(false)?;
            stream.set_nodelay(true)?;
            connection::watch(&stream)?;
            let connection = Connection::Tcp(stream);
            let peer = connection.peer();
            let id = self.clients.join(connection.try_clone()?, peer, queue.clone());
            Ok(id.map(|id| (connection, id)))
        };
        let (connection, id) = admit().ok()??;
        let clients = self.clients.clone();
        let session = Session::new(self.protocol, self.bus.clone());
        let handshake = self.handshake;
        let serve = move || serve(&clients, id, &connection, session, &queue, handshake);
        let started = thread::Builder::new().name(format!("bridge client {id}")).spawn(serve);
        if started.is_err() {
            self.clients.leave(id);
        }
        started.ok()
    }
}

/// Serves a client until it leaves; with `handshake`, it has this time to open the bus.
pub(crate) fn serve(
    clients: &Clients,
    id: ClientId,
    stream: &Connection,
    session: Session,
    queue: &ClientQueue,
    handshake: Option<Duration>,
) {
    let mut greeting = Vec::new();
    session.greet(&mut greeting);
    let writer = Writer::new(session.receive_settings());
    thread::scope(|scope| {
        let writer = thread::Builder::new().spawn_scoped(scope, move || {
            write_all(clients, stream, writer, queue, &greeting);
            // Closes the queue, so that the reader does not wait for space in it.
            clients.leave(id);
        });
        if writer.is_ok() {
            Reader { uplink: ClientUplink { clients, id, queue }, stream, session }
                .read_all(handshake);
        }
        clients.leave(id);
    });
}

struct ClientUplink<'a> {
    clients: &'a Clients,
    id: ClientId,
    queue: &'a ClientQueue,
}

impl Uplink for ClientUplink<'_> {
    fn bus(&self) -> Option<BusRates> {
        self.clients.bus()
    }

    fn send(&mut self, frame: CanFrame) -> bool {
        self.clients.submit(ClientFrame { client: self.id, frame, tag: 0 })
    }

    fn take_conditions(&mut self) -> Conditions {
        self.queue.take_conditions()
    }

    fn report_lost(&mut self) {
        self.clients.reject(self.id);
    }

    fn count_rejected(&mut self) {
        count(&self.clients.counters.rejected);
    }

    fn count_mismatched(&mut self) {
        count(&self.clients.counters.mismatched);
    }
}

struct Reader<'a> {
    uplink: ClientUplink<'a>,
    stream: &'a Connection,
    session: Session,
}

impl Reader<'_> {
    fn read_all(mut self, handshake: Option<Duration>) {
        if let Some(limit) = handshake {
            let deadline = Instant::now() + limit;
            let has_opened = self.read_while(Some(deadline), |session| !session.is_open());
            if !has_opened || self.stream.set_read_limit(None).is_err() {
                return;
            }
        }
        self.read_while(None, |_| true);
    }

    /// Processes input while a condition holds; returns false if the client has left or the time is
    /// over.
    fn read_while(&mut self, deadline: Option<Instant>, condition: fn(&Session) -> bool) -> bool {
        let mut bytes = [0; 2048];
        while condition(&self.session) {
            if let Some(deadline) = deadline {
                let left = deadline.saturating_duration_since(Instant::now());
                // A limit of zero would be none.
                if left.is_zero() || self.stream.set_read_limit(Some(left)).is_err() {
                    count(&self.uplink.clients.counters.silent_clients);
                    return false;
                }
            }
            let read = match self.stream.read(&mut bytes) {
                Ok(0) => return false,
                Ok(read) => read,
                Err(error) => match error.kind() {
                    ErrorKind::Interrupted | ErrorKind::WouldBlock | ErrorKind::TimedOut => {
                        continue;
                    }
                    _ => return false,
                },
            };
            if !self.feed(bytes.get(..read).unwrap_or_default()) {
                return false;
            }
        }
        true
    }

    fn feed(&mut self, bytes: &[u8]) -> bool {
        let Self { uplink, session, .. } = self;
        let was_open = session.is_open();
        let mut answer = Vec::new();
        session.feed(bytes, uplink, &mut answer);
        // Before the answer: a client that has received it keeps its place.
        if session.is_open() && !was_open {
            uplink.clients.keep(uplink.id);
        }
        // A client that does not read its answers is not read either. Its receive settings change
        // only with an answer.
        answer.is_empty() || uplink.queue.answer(answer, session.receive_settings())
    }
}

fn write_all(
    clients: &Clients,
    stream: &Connection,
    mut writer: Writer,
    queue: &ClientQueue,
    greeting: &[u8],
) {
    let mut is_written = stream.write_all(greeting).is_ok();
    while is_written && let Some(chunk) = writer.next_chunk(queue, || clients.bus()) {
        is_written = stream.write_all(&chunk.text).is_ok();
        if !chunk.pause.is_zero() {
            thread::sleep(chunk.pause);
        }
    }
}

/// Address and counters of a bridge. Does not keep it alive.
#[derive(Clone, Debug)]
pub struct BridgeInfo {
    pub(crate) protocol: BridgeProtocol,
    pub(crate) address: SocketAddr,
    pub(crate) clients: Arc<Clients>,
}

impl BridgeInfo {
    /// Protocol of the bridge.
    pub fn protocol(&self) -> BridgeProtocol {
        self.protocol
    }

    /// Address on which it listens, with the actual port.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Counters of the bridge.
    pub fn statistics(&self) -> BridgeStatistics {
        self.clients.statistics()
    }
}

impl fmt::Display for BridgeInfo {
    /// Protocol and address, for example "slcan bridge at 127.0.0.1:29536".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bridge at {}", self.protocol.name(), self.address)
    }
}

/// Interval of polling for a program. Stopping does not wait for it.
const LOOK_INTERVAL: Duration = Duration::from_millis(10);

/// A pseudo-terminal that behaves as an slcan adapter with one client: the program that has it
/// open. The next program gets a new session. Dropping it ends its thread.
#[derive(Debug)]
pub struct SerialBridge {
    terminal: Arc<Terminal>,
    clients: Arc<Clients>,
    thread: Option<JoinHandle<()>>,
}

impl SerialBridge {
    /// Creates the terminal; `queue` is the capacity in frames of the queue to the bus and of the
    /// queue to the client.
    ///
    /// # Errors
    /// No pseudo-terminal or no thread is available.
    pub fn open(queue: usize) -> io::Result<Self> {
        let terminal = Arc::new(Terminal::open()?);
        let clients = Arc::new(Clients::new(queue, 1));
        let (line, served) = (terminal.clone(), clients.clone());
        let thread = thread::Builder::new()
            .name("bridge terminal".to_owned())
            .spawn(move || serve_programs(&served, &line))?;
        Ok(Self { terminal, clients, thread: Some(thread) })
    }

    /// Path that other programs open.
    pub fn path(&self) -> &Path {
        self.terminal.path()
    }

    /// The client.
    pub fn clients(&self) -> &Arc<Clients> {
        &self.clients
    }
}

impl Drop for SerialBridge {
    fn drop(&mut self) {
        self.clients.close();
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A panic in it has been reported on stderr already.
            let _ = thread.join();
        }
    }
}

/// Serves one program after the other until the bridge is closed.
fn serve_programs(clients: &Clients, terminal: &Arc<Terminal>) {
    while !clients.is_closed() {
        // A terminal that cannot be polled counts as unused.
        if !terminal.is_in_use().unwrap_or(false) {
            thread::park_timeout(LOOK_INTERVAL);
            continue;
        }
        let line = Arc::new(TerminalLine::new(terminal.clone()));
        let queue = Arc::new(ClientQueue::new(clients.queue()));
        // If the client is not admitted, the bridge was closed just now.
        let connection = Connection::Terminal(line.clone());
        let Some(id) = clients.join(connection, None, queue.clone()) else {
            return;
        };
        let session = Session::new(BridgeProtocol::Slcan, None);
        serve(clients, id, &Connection::Terminal(line), session, &queue, None);
    }
}
